"""Friction of a rig whose friction is known: parameters, tare, labels, zero, bracket, and what must
be refused or said.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from experiments.catalogue import load
from experiments.contract import Evidence
from experiments.errors import AnalysisError
from experiments.protocols.friction import analysis as friction
from experiments.protocols.friction import declaration as friction_declaration
from experiments.protocols.friction import plan as friction_plan
from experiments.protocols.friction.points import measure_friction
from experiments.protocols.motor_tare import analysis as motor_tare
from experiments.protocols.motor_tare import declaration as motor_tare_declaration
from experiments.protocols.motor_tare import plan as motor_tare_plan
from experiments.recording import ArraySource, Recording
from experiments.result import Result
from experiments.steps.vocabulary import ServoOff
from experiments.tares.tare import read_tare
from experiments.torque.zero import torque_zero
from model.friction import friction_torque, mesh_lever
from model.gear import HarmonicDrive, Origin
from model.identify.estimate import Cause
from model.identify.stribeck import NAMES
from model.units import DEGREE, REVOLUTION, RPM
from tests.experiments.synthetic import Bench, record


@pytest.fixture(scope="module")
def result(friction_run: Recording, gear: HarmonicDrive, tare: Result) -> Result:
    return friction.analyse(friction_run, Evidence(gear, tare, settings={"genetic": True}))


def test_the_gears_friction_is_recovered_behind_the_motors(
    result: Result, gear: HarmonicDrive
) -> None:
    """A straight line of friction in the motor taken for the gear's would give 93 N instead of 70 N."""
    truth = gear.mesh_friction
    for name in NAMES:
        estimate = result.estimates[name]
        half = 0.5 * (estimate.high - estimate.low)
        assert abs(estimate.value - getattr(truth, name)) <= 2.0 * half, name
    assert result.estimates["coulomb"].value == pytest.approx(truth.coulomb, rel=0.01)
    # One standard uncertainty of it in this recording.
    assert result.estimates["viscous"].value == pytest.approx(truth.viscous, rel=0.05)
    assert result.options["torque_is_of"] == "gear"


def test_running_torque_at_the_catalogues_speeds(result: Result, gear: HarmonicDrive) -> None:
    for rpm in (500.0, 1000.0, 2000.0):
        found = result.estimates[f"running_torque_{rpm:.0f}_rpm"]
        assert found.value == pytest.approx(float(friction_torque(gear, rpm * RPM)), rel=3e-3)
        assert {line.source for line in found.budget} >= {"torque scale", "tare"}
    assert "running_torque_3500_rpm" not in result.estimates


def test_the_budget_of_the_coulomb_friction_has_all_of_type_b(result: Result) -> None:
    sources = {line.source for line in result.estimates["coulomb"].budget if line.kind == "B"}
    assert sources >= {"torque scale", "tare", "bearing no-load torque"}
    assert (
        result.estimates["coulomb"].expanded_uncertainty > 0.02 * result.estimates["coulomb"].value
    )


def test_without_a_tare_it_is_motor_and_gear_and_nothing_is_claimed(
    friction_run: Recording, gear: HarmonicDrive
) -> None:
    result = friction.analyse(friction_run, Evidence(gear))
    assert result.options["torque_is_of"] == "motor + gear"
    assert any("motor and gear together" in w for w in result.warnings)
    assert result.estimates["coulomb"].value > 1.2 * gear.mesh_friction.coulomb
    assert friction.identified(result, gear) is gear
    assert all("motor + gear" in p.y_label for p in result.plots if p.figure in ("9", "17"))


def test_a_tare_that_does_not_cover_the_speeds_is_not_used(
    friction_run: Recording, gear: HarmonicDrive, bench: Bench
) -> None:
    bare = dataclasses.replace(bench, mounted=False)
    plan = motor_tare_plan.plan(
        motor_tare_declaration.Parameters(speeds_rpm=(100.0, 300.0, 1000.0)), gear
    )
    short = motor_tare.analyse(record(plan, bare, "motor-tare"), Evidence(gear))
    result = friction.analyse(friction_run, Evidence(gear, short))
    assert result.options["torque_is_of"] == "motor + gear"
    assert any("was not used" in w for w in result.warnings)


def test_holds_that_are_faster_than_the_tare_are_left_out_and_named(
    friction_run: Recording, gear: HarmonicDrive, tare: Result, result: Result
) -> None:
    half = 0.5 * float(tare.tables[0].rows[-1][0])
    table = dataclasses.replace(
        tare.tables[0], rows=tuple(r for r in tare.tables[0].rows if float(r[0]) < half)
    )
    slower = dataclasses.replace(tare, tables=(table, *tare.tables[1:]))
    left = friction.analyse(friction_run, Evidence(gear, slower))
    assert left.options["torque_is_of"] == "gear"
    assert left.metrics["points"] < result.metrics["points"]
    assert any("were left out. Repeat the tare" in w for w in left.warnings)
    coulomb = left.estimates["coulomb"]
    assert abs(coulomb.value - gear.mesh_friction.coulomb) < coulomb.expanded_uncertainty


def test_a_result_that_is_no_tare_is_not_used(result: Result) -> None:
    tare, said = read_tare(result, np.array([1.0, 100.0]))
    assert tare is None
    assert "not of motor-tare" in said[0]


def test_a_tare_with_the_gear_mounted_is_refused(bench: Bench, gear: HarmonicDrive) -> None:
    plan = motor_tare_plan.plan(motor_tare_declaration.Parameters(speeds_rpm=(100.0, 300.0)), gear)
    with pytest.raises(AnalysisError, match="gear mounted"):
        motor_tare.analyse(record(plan, bench, "motor-tare"), Evidence(gear))


def test_the_friction_of_a_run_without_a_gear_is_refused(
    tare_run: Recording, gear: HarmonicDrive
) -> None:
    with pytest.raises(AnalysisError, match=r"without a gear.*motor-tare"):
        friction.analyse(tare_run, Evidence(gear))


def test_a_tare_of_two_speeds_has_no_interval(tare_run: Recording, gear: HarmonicDrive) -> None:
    """A line through two points leaves nothing to tell its error from."""
    holds = tare_run.labelled("hold")
    two = sorted({abs(segment.setpoint) for segment in holds})[-2:]
    others = {segment.index for segment in holds if abs(segment.setpoint) not in two}
    segments = tuple(s for s in tare_run.segments if s.index not in others)
    result = motor_tare.analyse(dataclasses.replace(tare_run, segments=segments), Evidence(gear))
    assert result.metrics["speeds"] == 2.0
    estimate = result.estimates["motor_viscous"]
    assert (estimate.identifiable, estimate.expanded_uncertainty) == ("no", math.inf)


def test_the_tare_finds_motor_friction_and_cogging(tare: Result) -> None:
    assert tare.estimates["motor_coulomb"].value == pytest.approx(0.012, rel=0.01)
    assert tare.estimates["motor_viscous"].value == pytest.approx(3.8e-5, rel=0.01)
    assert tare.metrics["strongest_cogging_order"] == 24.0
    spectrum = next(p for p in tare.plots if p.name == "cogging").series[0]
    assert spectrum.y[23] == pytest.approx(2.0, rel=0.05)
    assert spectrum.y[1] == pytest.approx(1.0, rel=0.1)


def test_the_zero_is_taken_servo_off_and_its_drift_is_said(
    bench: Bench, gear: HarmonicDrive
) -> None:
    parameters = friction_declaration.Parameters(speeds_rpm=(60.0, 200.0, 600.0), up_and_down=False)
    for drift in (0.0, 0.008):
        run = record(
            friction_plan.plan(parameters, gear),
            dataclasses.replace(bench, drift=drift),
            "friction",
        )
        zero = torque_zero(run)
        assert zero.before is not None
        assert zero.before.value == pytest.approx(0.01, abs=5e-4)
        assert zero.after is not None
        share = (zero.after.time - zero.before.time) / float(run.time()[-1])
        assert zero.drift == pytest.approx(drift * share, abs=3e-4)
        assert bool(zero.warnings) == (drift > 0.0)
        middle = float(run.time()[-1]) / 2.0
        assert float(zero.at(middle)) == pytest.approx(0.01 + drift / 2.0, abs=5e-4)


def test_the_zero_cancels_in_the_half_difference_and_stands_in_the_half_sum(
    bench: Bench,
    gear: HarmonicDrive,
    tare: Result,
    friction_parameters: friction_declaration.Parameters,
) -> None:
    """54 mN m taken as zero servo-on: friction must not move, the offset must show it."""
    run = record(
        friction_plan.plan(friction_parameters, gear),
        dataclasses.replace(bench, offset=0.01),
        "friction",
    )
    segments = tuple(s for s in run.segments if not s.label.startswith("torque-zero"))
    unzeroed = dataclasses.replace(run, segments=segments)
    result = friction.analyse(unzeroed, Evidence(gear, tare))
    assert any("no servo-off segment" in w for w in result.warnings)
    assert result.estimates["coulomb"].value == pytest.approx(gear.mesh_friction.coulomb, rel=0.01)
    assert result.estimates["offset"].value == pytest.approx(0.01, abs=3e-4)


def test_a_drifting_reference_speed_is_said_and_a_large_drift_is_refused(
    bench: Bench, gear: HarmonicDrive, friction_parameters: friction_declaration.Parameters
) -> None:
    run = record(friction_plan.plan(friction_parameters, gear), bench, "friction")
    source = run.source
    assert isinstance(source, ArraySource)
    for fall, refused in ((0.1, False), (0.5, True)):
        factor = 1.0 - fall * np.linspace(0.0, 1.0, run.rows)
        zero = bench.offset / run.signals["torque"].scale
        cooled = np.round((source.arrays["torque"] - zero) * factor + zero).astype(np.int64)
        warm = dataclasses.replace(
            run, source=dataclasses.replace(source, arrays={**source.arrays, "torque": cooled})
        )
        if refused:
            with pytest.raises(AnalysisError, match="drifted"):
                friction.analyse(warm, Evidence(gear))
        else:
            result = friction.analyse(warm, Evidence(gear))
            assert any("drifted" in w for w in result.warnings)
            assert result.metrics["bracket_drift"] == pytest.approx(0.1, abs=0.03)


def test_holds_in_which_the_input_stops_and_goes_are_left_out_and_named(
    friction_run: Recording, gear: HarmonicDrive, tare: Result
) -> None:
    """At the slowest speed the shaft stands for half of every half degree, and the torque is a tenth low."""
    source = friction_run.source
    assert isinstance(source, ArraySource)
    angle, torque = (source.arrays[n].copy() for n in ("input_angle", "torque"))
    slowest = min(abs(s.setpoint) for s in friction_run.labelled("hold"))
    beat = 0.5 * DEGREE / friction_run.signals["input_angle"].scale
    for s in friction_run.labelled("hold"):
        if abs(s.setpoint) < 1.01 * slowest:
            rows = slice(s.start - 1, s.stop)
            turned = (angle[rows] - angle[s.start - 1]) * s.direction / beat
            stepped = np.floor(turned) + np.clip(2.0 * (turned % 1.0) - 1.0, 0.0, 1.0)
            angle[rows] = angle[s.start - 1] + np.round(s.direction * beat * stepped)
            torque[rows] -= round(s.direction * 0.006 / friction_run.signals["torque"].scale)
    arrays = {**source.arrays, "input_angle": angle, "torque": torque}
    stuck = dataclasses.replace(friction_run, source=dataclasses.replace(source, arrays=arrays))
    result = friction.analyse(stuck, Evidence(gear, tare))
    assert any(f"at {slowest / RPM:.2g} r/min" in w and "left out" in w for w in result.warnings)
    assert result.metrics["slowest_speed"] > 1.1 * slowest
    static = result.estimates["static"]
    assert abs(static.value - gear.mesh_friction.static) < static.expanded_uncertainty


def test_the_warmth_of_the_tares_motor_is_no_part_of_what_the_data_say(result: Result) -> None:
    """A motor that is warmer has less friction by a factor, which passes for the gear's whatever the run shows."""
    estimate = result.estimates["running_torque_1000_rpm"]
    tare = next(b for b in estimate.budget if b.source == "tare")
    assert tare.kind == "B"
    assert tare.cause is Cause.TARE
    inside = [
        b
        for b in estimate.budget
        if b.source not in ("tare", "torque scale", "output bearing", "warmth of the motor")
        and b.source not in ("from run to run", "torque zero", "thermometer")
    ]
    size = math.sqrt(sum(b.standard_uncertainty**2 for b in inside))
    assert 0.5 * (estimate.high - estimate.low) < 2.2 * size


def test_nothing_is_brought_anywhere_where_nothing_varies(result: Result) -> None:
    assert result.options["points_brought_to"] == "nothing"


def test_a_slowest_speed_that_saw_little_of_the_bend_is_said_and_the_interval_decides(
    bench: Bench, gear: HarmonicDrive, tare: Result
) -> None:
    parameters = friction_declaration.Parameters(lowest_rpm=40.0, points=9)
    result = load("friction").analyse(
        record(friction_plan.plan(parameters, gear), bench, "friction"),
        Evidence(gear, tare),
    )
    assert any("slowest speed" in w for w in result.warnings)
    shape = result.estimates["shape"]
    assert abs(shape.value - gear.mesh_friction.shape) <= shape.expanded_uncertainty


def test_the_genetic_search_finds_no_better_minimum_where_it_is_asked_for(
    result: Result, friction_run: Recording, gear: HarmonicDrive
) -> None:
    assert result.metrics["genetic_chi_square_excess"] > -1e-6
    unasked = friction.analyse(friction_run, Evidence(gear)).metrics
    assert not [name for name in unasked if name.startswith("genetic")]


def test_identified_friction_goes_into_the_parameter_set(
    result: Result, gear: HarmonicDrive
) -> None:
    identified = friction.identified(result, gear)
    assert identified.mesh_friction.coulomb == result.estimates["coulomb"].value
    origin = identified.origins["mesh_friction.coulomb"]
    assert origin.provenance == "identified"
    assert origin.standard_uncertainty == pytest.approx(
        result.estimates["coulomb"].standard_uncertainty
    )
    assert identified.options.torque_balance == result.options["torque_balance"]


def test_the_published_balance_is_kept_with_its_numbers(
    friction_run: Recording, gear: HarmonicDrive, tare: Result
) -> None:
    """Equation 20 as printed needs 3.9 times the mesh friction for the same torque."""
    result = friction.analyse(friction_run, Evidence(gear, tare, settings={"balance": "published"}))
    identified = friction.identified(result, gear)
    assert identified.options.torque_balance == "published"
    assert result.estimates["coulomb"].value == pytest.approx(
        3.906 * gear.mesh_friction.coulomb, rel=0.03
    )
    speed = 1000.0 * RPM
    assert float(friction_torque(identified, speed)) == pytest.approx(
        float(friction_torque(gear, speed)), rel=5e-3
    )


def test_compare_scores_without_fitting(
    friction_run: Recording, gear: HarmonicDrive, tare: Result
) -> None:
    good = friction.compare(friction_run, gear, Evidence(gear, tare))
    wrong = gear.with_values(
        {"mesh_friction.coulomb": 90.0, "mesh_friction.static": 110.0}, Origin("assumed")
    )
    bad = friction.compare(friction_run, wrong, Evidence(gear, tare))
    assert good.metrics["mse"] < 1.0
    assert good.metrics["skill_against_mean"] > 0.9
    assert good.metrics["skill_against_straight_line"] > 0.5
    assert bad.metrics["skill_against_mean"] < good.metrics["skill_against_mean"]
    assert bad.metrics["mean_residual"] < -0.005
    assert good.estimates == {}


def test_the_papers_figures_are_there(result: Result) -> None:
    assert {"9", "17"} <= {p.figure for p in result.plots}
    low = next(p for p in result.plots if p.name == "friction-curve-low")
    assert max(s.x.max() for s in low.series) <= 100.1
    both = next(p for p in result.plots if p.figure == "17")
    assert {s.label for s in both.series} >= {
        "measured, forward",
        "measured, reverse",
        "fitted, forward",
        "fitted, reverse",
    }


def test_a_foreign_recording_of_angle_and_current_gives_friction_in_amperes(
    bench: Bench, gear: HarmonicDrive
) -> None:
    """No segments, no zero, no output encoder; whole revolutions at steady speed are found from the angle."""
    parameters = friction_declaration.Parameters(
        lowest_rpm=15.0, points=10, up_and_down=False, bracket_every=100, measure_time=10.0
    )
    run = record(friction_plan.plan(parameters, gear), bench, "friction")
    source = run.source
    assert isinstance(source, ArraySource)
    names = {"input_angle": "input_angle", "torque": "current"}
    signals = {new: dataclasses.replace(run.signals[old], name=new) for old, new in names.items()}
    signals["current"] = dataclasses.replace(signals["current"], unit="A")
    foreign = Recording(
        dataclasses.replace(run.metadata, experiment="", origin="imported", time_base="device"),
        signals,
        (),
        (),
        ArraySource({new: source.arrays[old] for old, new in names.items()}, source.times),
    )
    result = friction.analyse(foreign, Evidence(gear, settings={"channel": "current"}))
    assert result.estimates["coulomb"].unit == "A"
    words = " ".join(result.warnings)
    assert "no segments" in words
    assert "not N m" in words
    slow = 30.0 * RPM
    curve = result.estimates
    shape = np.exp(-((slow / curve["stribeck_velocity"].value) ** curve["shape"].value))
    found = (
        curve["coulomb"].value
        + (curve["static"].value - curve["coulomb"].value) * shape
        + curve["viscous"].value * slow
    )
    truth = float(friction_torque(gear, slow)) + float(bench.motor(np.array([slow]))[0])
    assert found == pytest.approx(truth, rel=0.03)


def test_a_run_without_a_whole_revolution_is_refused(
    gear: HarmonicDrive, friction_run: Recording
) -> None:
    short = tuple(
        dataclasses.replace(s, stop=s.start + 50) if s.label in ("hold", "bracket") else s
        for s in friction_run.segments
    )
    slow = tuple(s for s in short if abs(s.setpoint) < 100.0 * RPM)
    with pytest.raises(AnalysisError, match="whole input revolution"):
        friction.analyse(dataclasses.replace(friction_run, segments=slow), Evidence(gear))


def test_a_linear_axis_is_sent_to_another_kind(
    friction_run: Recording, gear: HarmonicDrive
) -> None:
    signals = dict(friction_run.signals)
    signals["input_angle"] = dataclasses.replace(signals["input_angle"], unit="m")
    with pytest.raises(AnalysisError, match="motion"):
        friction.analyse(dataclasses.replace(friction_run, signals=signals), Evidence(gear))


def test_holds_cover_whole_revolutions_of_the_plan(
    friction_run: Recording, gear: HarmonicDrive
) -> None:
    measured = measure_friction(friction_run, Evidence(gear))
    for hold in measured.holds:
        turned = (
            abs(friction_run.si("input_angle", hold.segment)[[0, -1]] @ [-1.0, 1.0]) / REVOLUTION
        )
        assert hold.torque.revolutions == round(turned)


def test_servo_off_is_where_the_plan_puts_it(gear: HarmonicDrive) -> None:
    steps = list(friction_plan.plan(friction_declaration.Parameters(), gear))
    assert [k for k, s in enumerate(steps) if isinstance(s, ServoOff)] == [0, len(steps) - 1]


ENTERED = {
    "output_bearing": (0.5, 0.04),
    "output_bearing_date": "2026-05-02",
    "output_bearing_source": "spun with a cord",
}


def test_an_output_bearing_that_is_entered_is_subtracted_with_its_uncertainty(
    friction_run: Recording, gear: HarmonicDrive, tare: Result, result: Result
) -> None:
    entered = friction.analyse(friction_run, Evidence(gear, tare, settings=ENTERED))
    force = 0.5 / (gear.ratio * mesh_lever(gear))
    before, after = (r.estimates["coulomb"] for r in (result, entered))
    assert after.value == pytest.approx(before.value - force, abs=0.02)
    assert entered.metrics["output_bearing_subtracted"] == pytest.approx(force)
    assert after.expanded_uncertainty < 0.5 * before.expanded_uncertainty
    (line,) = [b for b in after.budget if b.source == "output bearing"]
    assert line.standard_uncertainty == pytest.approx(0.04 * force, rel=1e-3)
    assert "2026-05-02" in entered.options["output_bearing"]
    (unknown,) = [b for b in before.budget if b.source == "output bearing"]
    assert unknown.standard_uncertainty == pytest.approx(0.608 / 0.5 * force, rel=0.01)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"output_bearing": (0.5, 0.04)}, "without output_bearing_source"),
        ({**ENTERED, "output_bearing": 0.5}, "needs a value and its expanded uncertainty"),
        ({"viscous_per_kelvin": (-0.03, 0.01)}, "without per_kelvin_source"),
    ],
)
def test_a_number_without_uncertainty_or_source_is_not_taken(
    friction_run: Recording, gear: HarmonicDrive, settings: dict[str, object], words: str
) -> None:
    with pytest.raises(AnalysisError, match=words):
        friction.analyse(friction_run, Evidence(gear, settings=settings))


def test_points_off_the_curve_are_refused(friction_run: Recording, gear: HarmonicDrive) -> None:
    """A resonance that takes a fifth more at one speed, both times it is visited."""
    source = friction_run.source
    assert isinstance(source, ArraySource)
    counts = source.arrays["torque"].copy()
    fast = max(abs(s.setpoint) for s in friction_run.labelled("hold"))
    second = max(
        abs(s.setpoint) for s in friction_run.labelled("hold") if abs(s.setpoint) < 0.9 * fast
    )
    for s in friction_run.labelled("hold"):
        if abs(abs(s.setpoint) - second) < 0.01 * second:
            rows = slice(s.start - 1, s.stop)
            counts[rows] += round(s.direction * 0.02 / friction_run.signals["torque"].scale)
    bent = dataclasses.replace(
        friction_run, source=dataclasses.replace(source, arrays={**source.arrays, "torque": counts})
    )
    with pytest.raises(AnalysisError, match="do not lie on the curve"):
        friction.analyse(bent, Evidence(gear))
