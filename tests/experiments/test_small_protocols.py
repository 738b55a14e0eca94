"""Warm-up, starting torque and home on a rig that is known."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from experiments.contract import Evidence
from experiments.errors import AnalysisError
from experiments.protocols.home import analysis as home
from experiments.protocols.home import declaration as home_declaration
from experiments.protocols.home import plan as home_plan
from experiments.protocols.starting_torque import analysis as starting_torque
from experiments.protocols.starting_torque import breakaway
from experiments.protocols.starting_torque import declaration as starting_torque_declaration
from experiments.protocols.starting_torque import plan as starting_torque_plan
from experiments.protocols.starting_torque.balance import balanced
from experiments.protocols.warm_up import analysis as warm_up
from experiments.protocols.warm_up import declaration as warm_up_declaration
from experiments.protocols.warm_up import plan as warm_up_plan
from experiments.recording import ArraySource, Recording
from experiments.steps.vocabulary import MoveRevolutions, MoveToAngle, ServoOff, TorqueRamp
from model.channel import Channel
from model.friction import friction_torque
from model.gear import HarmonicDrive
from model.identify.estimate import Estimate
from model.units import REVOLUTION, RPM
from tests.experiments.synthetic import Bench, record


@pytest.fixture(scope="module")
def ramps(bench: Bench, gear: HarmonicDrive) -> Recording:
    parameters = starting_torque_declaration.Parameters(positions=4, approach_rpm=30.0)
    return record(starting_torque_plan.plan(parameters, gear), bench, "starting-torque")


def test_the_starting_torque_is_where_the_input_begins_to_turn(
    ramps: Recording, bench: Bench, gear: HarmonicDrive
) -> None:
    result = starting_torque.analyse(ramps, Evidence(gear))
    found = {name: e.value for name, e in result.estimates.items()}
    assert found["starting_torque"] == pytest.approx(bench.breakaway, rel=0.02)
    assert found["starting_torque_reverse"] == pytest.approx(-bench.breakaway, rel=0.02)
    assert result.metrics["ramps"] == 8.0
    assert result.options["torque_is_of"] == "motor + gear"


CARD = {
    "coulomb": 0.55,
    "coulomb_u": 0.52,
    "viscous": 3.0,
    "viscous_u": 1.0,
    "source": "class of the bench",
}


def test_the_output_bearing_of_a_starting_torque_is_that_of_friction(
    ramps: Recording, gear: HarmonicDrive
) -> None:
    def found(process: dict[str, Any], settings: dict[str, Any]) -> tuple[Estimate, float]:
        metadata = dataclasses.replace(ramps.metadata, process=process)
        recording = dataclasses.replace(ramps, metadata=metadata)
        result = starting_torque.analyse(recording, Evidence(gear, settings=settings))
        one = result.estimates["starting_torque"]
        (line,) = [b for b in one.budget if b.source == "output bearing"]
        return one, line.standard_uncertainty * gear.ratio

    silent, unknown = found({}, {})
    # 0.1 to 1 N m that are not subtracted: their root mean square.
    assert unknown == pytest.approx(0.608, abs=1e-3)
    carded, known = found({"output_bearing": CARD}, {})
    # At rest nothing viscous counts.
    assert silent.value - carded.value == pytest.approx(0.55 / gear.ratio)
    assert known == pytest.approx(0.26)
    named = {"output_bearing_date": "2026-05-02", "output_bearing_source": "spun with a cord"}
    entered, measured = found({"output_bearing": CARD}, {"output_bearing": (0.48, 0.04), **named})
    assert silent.value - entered.value == pytest.approx(0.48 / gear.ratio)
    assert measured == pytest.approx(0.02)


def test_an_approach_that_sticks_and_slips_leaves_the_wind_up_unknown(
    ramps: Recording, gear: HarmonicDrive
) -> None:
    source = ramps.source
    assert isinstance(source, ArraySource)
    angle = source.arrays["input_angle"].copy()
    approaches = ramps.labelled("position")
    for segment in approaches[: len(approaches) // 2]:
        # It stands still for half of the time, and then comes loose.
        angle[segment.start : (segment.start + segment.stop) // 2] = angle[segment.start]
    stuck = dataclasses.replace(
        ramps, source=dataclasses.replace(source, arrays={**source.arrays, "input_angle": angle})
    )
    smooth, rough = (starting_torque.analyse(run, Evidence(gear)) for run in (ramps, stuck))
    assert any("50 % of the approaches stuck" in w for w in rough.warnings)
    before, after = (r.estimates["starting_torque"] for r in (smooth, rough))
    assert after.value == pytest.approx(before.value)
    # Half of the ramps may have lost up to the bearing's torque, that of a bench that says nothing.
    lost = 0.5 * 2.0 * 0.608 / gear.ratio / math.sqrt(3.0)
    assert after.high - after.value == pytest.approx(1.96 * lost, rel=0.05)
    assert before.high - before.value < 0.2 * (after.high - after.value)


def test_every_ramp_is_approached_in_its_own_direction_and_starts_without_power(
    gear: HarmonicDrive,
) -> None:
    steps = list(
        starting_torque_plan.plan(starting_torque_declaration.Parameters(positions=5), gear)
    )
    ramps = {k: step.rate for k, step in enumerate(steps) if isinstance(step, TorqueRamp)}
    assert len(ramps) == 10
    for k, rate in ramps.items():
        way = math.copysign(1.0, rate)
        before, creep, off = steps[k - 3 : k]
        assert isinstance(before, MoveToAngle)
        assert isinstance(creep, MoveRevolutions)
        assert isinstance(off, ServoOff)
        assert before.speed * way > 0.0
        assert creep.revolutions * way > 0.0
    # A revolution at least in the new direction before its first ramp.
    first_reverse = next(k for k, rate in ramps.items() if rate < 0.0)
    travel = steps[first_reverse - 4]
    assert isinstance(travel, MoveRevolutions)
    assert travel.revolutions <= -1.0
    # Many positions need no revolution between them; the first of a direction still has one.
    many = list(
        starting_torque_plan.plan(starting_torque_declaration.Parameters(positions=360), gear)
    )
    moves = [s.revolutions for s in many if isinstance(s, MoveRevolutions)]
    assert moves[0] >= 1.0
    assert min(moves) <= -1.0


def test_positions_are_spread_over_a_turn_of_input_and_output(gear: HarmonicDrive) -> None:
    steps = list(starting_torque_plan.plan(starting_torque_declaration.Parameters(), gear))
    forward = [s for s in steps if isinstance(s, TorqueRamp) and s.rate > 0.0]
    phases = sorted(s.segment.setpoint for s in forward if s.segment is not None)
    assert np.allclose(np.diff(phases), REVOLUTION / 23.0)
    # No sideband n + k/N stands at the same phase in all ramps, so that every one cancels in the mean.
    inner = np.array([s.segment.setpoint for s in forward if s.segment is not None])
    outer = REVOLUTION * np.arange(23) / 23.0
    for n in range(1, 7):
        for k in (-2, -1, 0, 1, 2):
            assert abs(np.exp(1j * (n * inner + k * outer)).mean()) < 1e-9
    turned = sum(
        s.revolutions for s in steps if isinstance(s, MoveRevolutions) and s.revolutions > 0.0
    )
    assert turned == pytest.approx(gear.ratio, rel=0.1)


def test_a_heavier_output_is_brought_to_rest_more_gently(gear: HarmonicDrive) -> None:
    def creep(output: float) -> MoveRevolutions:
        heavy = gear.with_values({"inertia.output": output})
        steps = list(
            starting_torque_plan.plan(starting_torque_declaration.Parameters(positions=2), heavy)
        )
        ramp = next(k for k, step in enumerate(steps) if isinstance(step, TorqueRamp))
        found = steps[ramp - 2]
        assert isinstance(found, MoveRevolutions)
        return found

    light, heavy = creep(0.02), creep(1.0)
    assert heavy.speed < light.speed
    assert heavy.acceleration < light.acceleration


def test_a_ramp_that_was_approached_from_the_other_side_is_said(
    ramps: Recording, gear: HarmonicDrive
) -> None:
    assert not any(
        "against their own direction" in w
        for w in starting_torque.analyse(ramps, Evidence(gear)).warnings
    )
    turned = tuple(
        dataclasses.replace(s, direction=-s.direction) for s in ramps.labelled("torque-ramp")
    )
    (said,) = breakaway.approach_remarks(ramps, turned)
    assert "8 ramps were approached against" in said


@pytest.mark.parametrize("power", [2.0, 3.0])
def test_the_moment_of_first_motion_lies_between_two_laws(power: float) -> None:
    begin, threshold = 0.5, breakaway.FIRST_MOTION
    time = np.arange(0.0, 0.6, 1e-3)
    moved = threshold * (np.maximum(time - begin, 0.0) / 0.04) ** power
    upto = int(np.flatnonzero(moved > threshold)[0]) + 1
    first, within = breakaway.first_motion(time[:upto], moved[:upto], threshold)
    assert within > 0.0
    assert abs(first - begin) <= 1.2 * within


def test_a_pattern_over_the_angle_is_no_scatter() -> None:
    count, ratio = 23, 120.0
    # Wave-generator positions ten on with every ramp, the output a 23rd of its turn; then back again.
    forward = REVOLUTION * (5.0 * np.arange(count) + (10.0 * np.arange(count) % count) / count)
    angles = np.concatenate([forward, forward[::-1]])
    noise = np.random.default_rng(3).normal(0.0, 1e-4, 2 * count)
    ramps = []
    for k, (angle, error) in enumerate(zip(angles, noise, strict=True)):
        way = 1 if k < count else -1
        friction = 0.07 + 4e-3 * np.cos(2.0 * angle) + 2e-3 * np.sin(angle / ratio)
        cogging = 3e-3 * np.cos(24.0 * angle)
        torque = float(way * friction + cogging + error)
        place = round(float(angle % REVOLUTION), 6)
        ramps.append(breakaway.Breakaway(place, way, torque, float(angle), 0.0))
    balance = balanced(ramps, "run")
    assert balance.scatter == pytest.approx(1e-4, rel=0.5)
    assert balance.friction == pytest.approx(0.07, abs=1e-4)
    few = balanced([*ramps[:7], *ramps[-7:]], "run")
    assert few.scatter > 1e-3
    alone = balanced(ramps[:count], "run")
    assert alone.direction == 1
    assert alone.scatter > 1e-3
    with pytest.raises(AnalysisError, match="too few ramps"):
        balanced([ramps[0], ramps[-1]], "run")


def test_ramps_that_move_nothing_are_said_or_refused(ramps: Recording, gear: HarmonicDrive) -> None:
    source = ramps.source
    assert isinstance(source, ArraySource)
    stuck = source.arrays["input_angle"].copy()
    segments = ramps.labelled("torque-ramp")
    for segment in segments[:2]:
        stuck[segment.start : segment.stop] = stuck[segment.start]
    run = dataclasses.replace(
        ramps, source=dataclasses.replace(source, arrays={**source.arrays, "input_angle": stuck})
    )
    result = starting_torque.analyse(run, Evidence(gear))
    assert any("without a motion that stays" in w for w in result.warnings)
    assert result.metrics["ramps"] == 6.0
    only = tuple(s for s in run.segments if s.label != "torque-ramp" or s in segments[:2])
    with pytest.raises(AnalysisError, match="no ramp"):
        starting_torque.analyse(dataclasses.replace(run, segments=only), Evidence(gear))


def test_home_finds_both_marks(bench: Bench, gear: HarmonicDrive) -> None:
    parameters = home_declaration.Parameters(input_speed_rpm=30.0, output_speed_rpm=120.0)
    result = home.analyse(record(home_plan.plan(parameters, gear), bench, "home"), Evidence(gear))
    assert result.estimates["input_index"].value == pytest.approx(
        bench.index % REVOLUTION, abs=4e-4
    )
    # The output encoder counts against the input's sense.
    assert result.estimates["output_index"].value == pytest.approx(
        -bench.output_index % REVOLUTION, abs=2e-4
    )
    table = result.tables[0]
    assert [row[0] for row in table.rows] == ["input"] * 3 + ["output"]
    # All passes latch one count, and a count is a rectangle: its half width times 0.95.
    index = result.estimates["input_index"]
    count = next(line for line in index.budget if line.source == "one count of the encoder")
    assert index.high - index.low == pytest.approx(
        0.95 * math.sqrt(12.0) * count.standard_uncertainty
    )


def test_a_mark_is_no_better_known_than_its_encoder(bench: Bench, gear: HarmonicDrive) -> None:
    parameters = home_declaration.Parameters(input_speed_rpm=60.0, output_speed_rpm=120.0)
    run = record(home_plan.plan(parameters, gear), bench, "home")
    signal = run.signals["input_index"]
    coarse = dataclasses.replace(
        signal, calibration=dataclasses.replace(signal.calibration, accuracy=3e-3)
    )
    result = home.analyse(
        dataclasses.replace(run, signals={**run.signals, "input_index": coarse}), Evidence(gear)
    )
    index = result.estimates["input_index"]
    assert index.expanded_uncertainty == pytest.approx(1.96 * 3e-3 / math.sqrt(3.0), rel=1e-2)
    assert index.high - index.low < 1e-3


def test_home_without_index_channels_says_what_is_lacking(
    bench: Bench, gear: HarmonicDrive
) -> None:
    run = record(
        home_plan.plan(
            home_declaration.Parameters(input_speed_rpm=60.0, output_speed_rpm=120.0), gear
        ),
        bench,
        "home",
    )
    signals = {name: s for name, s in run.signals.items() if "index" not in name}
    with pytest.raises(AnalysisError, match="input_index"):
        home.analyse(dataclasses.replace(run, signals=signals), Evidence(gear))


def test_home_that_saw_no_mark_is_refused(bench: Bench, gear: HarmonicDrive) -> None:
    run = record(
        home_plan.plan(
            home_declaration.Parameters(input_speed_rpm=60.0, output_speed_rpm=120.0), gear
        ),
        bench,
        "home",
    )
    source = run.source
    assert isinstance(source, ArraySource)
    blind = {**source.arrays, "index_seen": np.zeros(run.rows, dtype=np.int64)}
    with pytest.raises(AnalysisError, match="no index mark"):
        home.analyse(
            dataclasses.replace(run, source=dataclasses.replace(source, arrays=blind)),
            Evidence(gear),
        )


def test_warm_up_sees_the_torque_become_steady(bench: Bench, gear: HarmonicDrive) -> None:
    parameters = warm_up_declaration.Parameters(speed_rpm=1500.0, window=5.0, at_most=600.0)
    run = record(
        warm_up_plan.plan(parameters, gear),
        bench,
        "warm-up",
        parameters=dataclasses.asdict(parameters),
    )
    steady = warm_up.analyse(run, Evidence(gear))
    assert steady.metrics["steady"] == 1.0
    assert not any("not steady" in w for w in steady.warnings)
    truth = float(friction_torque(gear, 1500.0 * RPM)) + float(
        bench.motor(np.array([1500.0 * RPM]))[0]
    )
    assert steady.estimates["running_torque"].value == pytest.approx(truth, rel=0.01)
    assert steady.metrics["speed"] == pytest.approx(1500.0 * RPM, rel=0.01)
    lines = {line.source: line for line in steady.estimates["running_torque"].budget}
    # Nobody measured how warm the motor was: 5 K of a tenth of a percent each.
    assert lines["warmth of the motor"].standard_uncertainty == pytest.approx(5e-3 * truth, rel=0.5)


def test_a_warm_up_takes_off_what_warm_magnets_make_the_port_read_too_much(
    bench: Bench, gear: HarmonicDrive
) -> None:
    parameters = warm_up_declaration.Parameters(speed_rpm=1500.0, window=1.0, at_most=60.0)
    run = record(
        warm_up_plan.plan(parameters, gear),
        bench,
        "warm-up",
        parameters=dataclasses.asdict(parameters),
    )
    source = run.source
    assert isinstance(source, ArraySource)
    warm = {**source.arrays, "housing_temperature": np.full(run.rows, 45, dtype=np.int64)}
    channel = Channel(name="housing_temperature", unit="degC", scale=1.0)
    measured = dataclasses.replace(
        run,
        signals={**run.signals, "housing_temperature": channel},
        source=dataclasses.replace(source, arrays=warm),
    )
    cold, hot = (warm_up.analyse(one, Evidence(gear)) for one in (run, measured))
    assert hot.metrics["torque_constant_factor"] == pytest.approx(0.975)
    torque = hot.estimates["running_torque"]
    assert torque.value / cold.estimates["running_torque"].value == pytest.approx(0.975, rel=2e-3)
    (line,) = [line for line in torque.budget if line.source == "warmth of the motor"]
    # 1.5 K of the motor's temperature at 0.1 % each, 25 K at 0.03 %.
    assert line.standard_uncertainty == pytest.approx(7.65e-3 * torque.value, rel=1e-2)


def test_what_ripples_change_is_taken_off_and_put_back_with_its_sign(
    bench: Bench, gear: HarmonicDrive, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the shaken output takes is no friction; what the port's lag takes off the mean is."""
    parameters = warm_up_declaration.Parameters(speed_rpm=1500.0, window=1.0, at_most=60.0)
    steps = warm_up_plan.plan(parameters, gear)
    run = record(steps, bench, "warm-up", parameters=dataclasses.asdict(parameters))
    plain, ripple_of = warm_up.analyse(run, Evidence(gear)), warm_up.ripple_of

    def rippled(**more: float) -> float:
        def of(*given: Any) -> Any:
            ripple = ripple_of(*given)
            return dataclasses.replace(
                ripple, **{name: getattr(ripple, name) + by for name, by in more.items()}
            )

        monkeypatch.setattr(warm_up, "ripple_of", of)
        return warm_up.analyse(run, Evidence(gear)).estimates["running_torque"].value

    before = plain.estimates["running_torque"].value
    assert rippled(loss=1e-3) == pytest.approx(before - 1e-3, abs=1e-6)
    assert rippled(lag=1e-3) == pytest.approx(before + 1e-3, abs=1e-6)
    assert rippled(between=1e-3) == pytest.approx(before + 1e-3, abs=1e-6)


def test_warm_up_that_ended_too_early_says_so(bench: Bench, gear: HarmonicDrive) -> None:
    parameters = warm_up_declaration.Parameters(speed_rpm=1500.0, window=5.0, at_most=600.0)
    run = record(
        warm_up_plan.plan(parameters, gear),
        bench,
        "warm-up",
        parameters=dataclasses.asdict(parameters),
    )
    source = run.source
    assert isinstance(source, ArraySource)
    falling = 0.02 * np.exp(-np.arange(run.rows) / 8000.0) / run.signals["torque"].scale
    warming = {
        **source.arrays,
        "torque": source.arrays["torque"] + np.round(falling).astype(np.int64),
    }
    result = warm_up.analyse(
        dataclasses.replace(run, source=dataclasses.replace(source, arrays=warming)), Evidence(gear)
    )
    assert result.metrics["steady"] == 0.0
    assert result.metrics["total_change"] < -1e-3
    assert any("not steady" in w for w in result.warnings)
