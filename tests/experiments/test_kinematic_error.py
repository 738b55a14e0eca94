"""The kinematic error of a rig whose error is known: orders, accuracy, figure 16, and what must be refused or said."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from experiments.contract import Evidence
from experiments.errors import AnalysisError
from experiments.planning.speeds import first_resonances
from experiments.protocols.kinematic_error import analysis as kinematic_error
from experiments.protocols.kinematic_error import declaration as kinematic_error_declaration
from experiments.protocols.kinematic_error import plan as kinematic_error_plan
from experiments.protocols.kinematic_error.traverses import spring_of
from experiments.recording import ArraySource, Recording
from experiments.result import Result
from model.channel import Calibration
from model.gear import Harmonic, HarmonicDrive, Origin
from model.identify.estimate import BudgetLine, Estimate
from model.kinematic_error import peak_to_peak
from model.units import ARCMIN, ARCSEC, DEGREE
from tests.experiments.conftest import SERIES
from tests.experiments.synthetic import Bench, record

NAMES = {1.0 / 120.0: "1/N", 1.0: "1", 2.0: "2", 2.0 * (1.0 + 1.0 / 120.0): "2+2/N", 4.0: "4"}


@pytest.fixture(scope="module")
def result(kinematic_error_run: Recording, gear: HarmonicDrive) -> Result:
    return kinematic_error.analyse(kinematic_error_run, Evidence(gear))


@pytest.mark.parametrize("harmonic", SERIES, ids=lambda h: NAMES[h.order])
def test_orders_are_recovered_within_their_intervals(result: Result, harmonic: Harmonic) -> None:
    """Four standard uncertainties: one test in thousands of orders may miss a 95 % interval."""
    label = NAMES[harmonic.order]
    amplitude, phase = result.estimates[f"amplitude_{label}"], result.estimates[f"phase_{label}"]
    assert abs(amplitude.value - harmonic.amplitude) <= 2.0 * (amplitude.high - amplitude.low) / 2.0
    true_phase = math.atan2(harmonic.sine, harmonic.cosine)
    away = math.remainder(phase.value - true_phase, 2.0 * math.pi)
    assert abs(away) <= 2.0 * (phase.high - phase.low) / 2.0
    assert amplitude.high - amplitude.low < 0.5 * ARCSEC


def test_every_order_is_a_row_of_the_table(result: Result) -> None:
    (table,) = (one for one in result.tables if one.name == "orders")
    rows = {row[0]: row for row in table.rows}
    assert set(NAMES.values()) <= set(rows)
    for harmonic in SERIES:
        label, order, a, b, size, *_ = rows[NAMES[harmonic.order]]
        assert order == pytest.approx(harmonic.order)
        assert (a, b) == pytest.approx(
            (harmonic.cosine / ARCSEC, harmonic.sine / ARCSEC), abs=0.5
        ), label
        assert size == pytest.approx(math.hypot(float(a), float(b)))


def test_what_figure_12_leaves_of_raw_samples_is_what_the_fit_leaves(result: Result) -> None:
    (plot,) = (one for one in result.plots if one.name == "kinematic-error")
    *_, left = plot.series
    note = float(plot.note.rpartition("it is ")[2].split()[0])
    assert np.std(left.y) * 60.0 == pytest.approx(note, rel=0.1)


def test_phases_count_from_the_index_marks(result: Result) -> None:
    assert result.options["phases_count_from"] == "index marks"


def test_transmission_accuracy_is_the_peak_to_peak_of_the_fitted_curve(result: Result) -> None:
    truth = peak_to_peak(SERIES, 120.0, 720)
    for way in ("forward", "reverse"):
        found = result.estimates[f"transmission_accuracy_{way}"]
        assert found.name == f"transmission_accuracy_{way}"
        assert found.value == pytest.approx(truth, rel=0.01)
        assert result.metrics[f"raw_peak_to_peak_{way}"] > found.value
        assert result.metrics[f"mse_curve_{way}"] < 1.0


def test_figure_16_friction_in_phase_with_the_error_is_called_so(result: Result) -> None:
    found = result.estimates["figure_16_phase_difference"]
    assert found.low - 1.0 * DEGREE <= 0.0 <= found.high + 1.0 * DEGREE
    assert "same angle" in result.options["figure_16"]
    assert result.estimates["figure_16_friction_amplitude"].value == pytest.approx(
        math.hypot(3e-3, 1.2e-3), rel=0.03
    )
    assert result.estimates["figure_16_conservative_amplitude"].value == pytest.approx(
        1e-3, rel=0.1
    )


def test_figure_16_friction_a_quarter_turn_away_is_told_apart(
    bench: Bench, gear: HarmonicDrive
) -> None:
    turned = dataclasses.replace(bench, depth=(Harmonic(2.0, 1.2e-3, 3e-3),))
    run = record(
        kinematic_error_plan.plan(kinematic_error_declaration.Parameters(speed_rpm=185.3), gear),
        turned,
        "kinematic-error",
    )
    result = kinematic_error.analyse(run, Evidence(gear))
    assert result.estimates["figure_16_phase_difference"].value == pytest.approx(
        0.5 * math.pi, abs=2.0 * DEGREE
    )
    assert "do not have" in result.options["figure_16"]


def test_the_papers_figures_are_there(result: Result) -> None:
    assert {"12", "13", "16"} <= {p.figure for p in result.plots}
    for plot in result.plots:
        assert "[" in plot.x_label or plot.x_label.endswith(("revolutions", "revolution"))
        for series in plot.series:
            assert len(series.x) == len(series.y) > 0
            assert np.isfinite(series.x).all()
            assert np.isfinite(series.y).all()


def test_the_curve_of_one_turn_holds_what_is_taken_off_the_transmission_accuracy(
    result: Result,
) -> None:
    (plot,) = (one for one in result.plots if one.name == "transmission-accuracy")
    drawn = {series.label: float(np.ptp(series.y)) * ARCMIN for series in plot.series}
    for way, height in drawn.items():
        taken_off = result.metrics[f"raised_by_bench_{way}"]
        value = result.estimates[f"transmission_accuracy_{way}"].value
        assert taken_off > 0.0
        assert height == pytest.approx(value + taken_off, rel=1e-3)
    assert "peak-to-peak less what these add" in plot.note


def test_every_type_b_of_the_encoders_is_in_the_budget(
    kinematic_error_run: Recording, gear: HarmonicDrive
) -> None:
    """10 micrometres of eccentricity on a 110 mm scale are 37 arcsec: far more than the fit's own scatter."""
    signals = dict(kinematic_error_run.signals)
    signals["output_angle"] = dataclasses.replace(
        signals["output_angle"], calibration=Calibration(accuracy=37.0 * ARCSEC)
    )
    run = dataclasses.replace(kinematic_error_run, signals=signals)
    result = kinematic_error.analyse(run, Evidence(gear))
    accuracy = result.estimates["transmission_accuracy_forward"]
    assert accuracy.expanded_uncertainty > 1.95 * 37.0 * ARCSEC / math.sqrt(3.0)
    assert any(line.kind == "B" for line in accuracy.budget)
    table = next(t for t in result.tables if t.name == "budget")
    assert any(row[0] == "transmission_accuracy_forward" and row[2] == "B" for row in table.rows)


def test_a_wrong_ratio_is_refused_with_the_ratio_that_was_seen(
    kinematic_error_run: Recording, gear: HarmonicDrive
) -> None:
    run = dataclasses.replace(
        kinematic_error_run, metadata=dataclasses.replace(kinematic_error_run.metadata, ratio=121.0)
    )
    with pytest.raises(AnalysisError, match=r"ratio|slope") as refused:
        kinematic_error.analyse(run, Evidence(gear))
    assert "120" in str(refused.value)


def test_a_slipped_count_is_said(kinematic_error_run: Recording, gear: HarmonicDrive) -> None:
    source = kinematic_error_run.source
    assert isinstance(source, ArraySource)
    arrays = dict(source.arrays)
    traverse = kinematic_error_run.labelled("traverse")[0]
    middle = (traverse.start + traverse.stop) // 2
    slipped = arrays["output_angle"].copy()
    slipped[middle:] += 3
    arrays["output_angle"] = slipped
    run = dataclasses.replace(
        kinematic_error_run, source=dataclasses.replace(source, arrays=arrays)
    )
    result = kinematic_error.analyse(run, Evidence(gear))
    assert any("slip" in w.lower() for w in result.warnings)
    assert result.metrics["slipped_counts"] >= 1.0


def test_too_many_missed_cycles_are_refused_and_few_are_said(
    kinematic_error_run: Recording, gear: HarmonicDrive
) -> None:
    source = kinematic_error_run.source
    assert isinstance(source, ArraySource)
    for share, refused in ((0.0005, False), (0.01, True)):
        flags = np.zeros(kinematic_error_run.rows, dtype=np.uint16)
        flags[:: round(1.0 / share)] = 1
        run = dataclasses.replace(
            kinematic_error_run, source=dataclasses.replace(source, cycle_flags=flags)
        )
        if refused:
            with pytest.raises(AnalysisError, match="missed"):
                kinematic_error.analyse(run, Evidence(gear))
        else:
            result = kinematic_error.analyse(run, Evidence(gear))
            assert any("incomplete" in w for w in result.warnings)


def test_without_an_output_encoder_it_says_what_is_lacking(
    kinematic_error_run: Recording, gear: HarmonicDrive
) -> None:
    signals = {name: s for name, s in kinematic_error_run.signals.items() if name != "output_angle"}
    with pytest.raises(AnalysisError, match="output_angle"):
        kinematic_error.analyse(
            dataclasses.replace(kinematic_error_run, signals=signals), Evidence(gear)
        )


def test_without_index_torque_and_segments_the_error_is_still_found(
    kinematic_error_run: Recording, gear: HarmonicDrive, result: Result
) -> None:
    """What a foreign recording has: two angles. Phases then count from its start, and it is said."""
    signals = {name: kinematic_error_run.signals[name] for name in ("input_angle", "output_angle")}
    run = dataclasses.replace(kinematic_error_run, signals=signals, segments=())
    found = kinematic_error.analyse(run, Evidence(gear))
    words = " ".join(found.warnings)
    assert "no segments" in words
    assert "index" in words
    assert "torque" in words
    assert found.estimates["amplitude_2"].value == pytest.approx(
        result.estimates["amplitude_2"].value, rel=5e-3
    )


def test_an_unknown_setting_is_refused(kinematic_error_run: Recording, gear: HarmonicDrive) -> None:
    with pytest.raises(AnalysisError, match="no such setting"):
        kinematic_error.analyse(kinematic_error_run, Evidence(gear, settings={"hihgest_order": 3}))


def test_the_identified_gear_scores_better_than_the_assumed_one(
    kinematic_error_run: Recording, gear: HarmonicDrive, result: Result, bench: Bench
) -> None:
    """MSE (22) of the identified set on a run that it was not fitted to is excellent; that of the
    shipped set is not.
    """
    identified = kinematic_error.identified(result, gear)
    assert {h.order for h in identified.kinematic_error} >= {1.0, 2.0, 4.0}
    origin = identified.origins["kinematic_error.2"]
    assert origin.provenance == "identified"
    assert origin.standard_uncertainty is not None
    parameters = kinematic_error_declaration.Parameters(speed_rpm=185.3)
    other = record(
        kinematic_error_plan.plan(parameters, gear),
        dataclasses.replace(bench, seed=77),
        "kinematic-error",
    )
    ours = kinematic_error.compare(other, identified, Evidence(gear))
    theirs = kinematic_error.compare(other, gear, Evidence(gear))
    assert ours.metrics["mse_forward_0"] < 1.0
    assert theirs.metrics["mse_forward_0"] > 10.0
    assert ours.options["fitted"] == "nothing"


def test_repeats_are_pooled_and_scored_on_each_other(bench: Bench, gear: HarmonicDrive) -> None:
    run = record(
        kinematic_error_plan.plan(
            kinematic_error_declaration.Parameters(speed_rpm=185.3, repeats=2), gear
        ),
        bench,
        "kinematic-error",
    )
    result = kinematic_error.analyse(run, Evidence(gear))
    assert result.metrics["mse_on_other_repeats"] < 1.0
    for name in ("amplitude_2", "transmission_accuracy_forward"):
        assert "between repeats" in [line.source for line in result.estimates[name].budget], name
    one, other = (result.estimates[n] for n in ("amplitude_2", "figure_16_error_amplitude"))
    assert (one.value, one.expanded_uncertainty) == (other.value, other.expanded_uncertainty)


def test_the_spring_is_as_well_known_as_a_run_or_the_set_says(gear: HarmonicDrive) -> None:
    """+-40 % of stiffness in a rectangle: 1/K has a relative standard uncertainty of 26 %."""
    inertia = gear.inertia.output
    stated = gear.with_values({"inertia.output": inertia}, Origin("measured", "gear card of 7"))
    assert spring_of(stated, 120.0).relative_uncertainty == pytest.approx(0.2622, abs=1e-4)
    known = gear.with_values(
        {"inertia.output": inertia}, Origin("identified", "run 7", 0.01 * inertia)
    )
    spring = spring_of(known, 120.0)
    assert spring.relative_uncertainty == pytest.approx(0.01)
    assert spring.first_mode == pytest.approx(first_resonances(gear)[-1], rel=1e-3)


def test_the_truth_in_the_file_changes_nothing(
    kinematic_error_run: Recording, gear: HarmonicDrive, result: Result
) -> None:
    lie = {"truth": {"kinematic_error": {"orders": [{"order": 2.0, "cosine": 1.0, "sine": 1.0}]}}}
    run = dataclasses.replace(
        kinematic_error_run, metadata=dataclasses.replace(kinematic_error_run.metadata, process=lie)
    )
    assert kinematic_error.analyse(run, Evidence(gear)).as_json() == result.as_json()


def test_a_traverse_that_was_cut_short_claims_no_accuracy(
    kinematic_error_run: Recording, gear: HarmonicDrive
) -> None:
    first = kinematic_error_run.labelled("traverse")[0]
    part = dataclasses.replace(first, label="traverse (cut)", stop=(first.start + first.stop) // 2)
    others = tuple(s for s in kinematic_error_run.segments if s.label.startswith("torque-zero"))
    result = kinematic_error.analyse(
        dataclasses.replace(kinematic_error_run, segments=(*others, part)), Evidence(gear)
    )
    assert result.estimates["transmission_accuracy"].identifiable == "no"
    assert any("One direction only" in w for w in result.warnings)
    with pytest.raises(AnalysisError, match="no traverse"):
        kinematic_error.analyse(
            dataclasses.replace(kinematic_error_run, segments=others), Evidence(gear)
        )


def test_goodness_stands_beside_the_papers(result: Result) -> None:
    """The paper's 0.71, 5 and 1 are told as the paper's, with what differs; ours on samples fitted and on others."""
    table = next(t for t in result.tables if t.name == "goodness")
    for figure in ("0.71", "below 5 good", "below 1 excellent"):
        assert figure in table.note
    assert "differs" in table.note
    rows = {row[0]: row[1:] for row in table.rows}
    fitted, left_out = (
        rows[f"MSE (22), {what}"]
        for what in ("samples that were fitted", "revolutions that were left out")
    )
    for k, way in enumerate(("forward", "reverse")):
        assert fitted[k] == result.metrics[f"mse_curve_{way}"]
        assert left_out[k] == result.metrics[f"mse_left_out_{way}"]
        assert 0.0 < float(fitted[k]) < float(left_out[k]) < 1.0
        assert result.metrics[f"harmonics_{way}"] >= 26.0


def test_the_mounting_and_the_classes_of_the_encoders_are_lines_of_the_budget(
    kinematic_error_run: Recording, gear: HarmonicDrive
) -> None:
    bare = {"output_eccentricity": 0.0, "input_eccentricity": 0.0}
    for settings, once in ((bare, 0.0), ({}, 2.0), ({"output_eccentricity": 9.0}, 9.0)):
        found = kinematic_error.analyse(kinematic_error_run, Evidence(gear, settings=settings))
        lines = {
            line.source: line.standard_uncertainty
            for line in found.estimates["amplitude_1/N"].budget
        }
        added = lines.get("eccentricity of the mounting", 0.0)
        assert added == pytest.approx(once * ARCSEC / math.sqrt(2.0))
    sources = {line.source for line in found.estimates["transmission_accuracy_forward"].budget}
    assert "eccentricity of the mounting" in sources
    assert "peak-to-peak raised by encoders and mounting, corrected" in sources


def test_the_mean_of_repeats_keeps_what_its_statistical_part_is_of() -> None:
    """The value is less the bench's share, the interval of the data is not: so is their mean."""
    repeats = [
        Estimate(name="transmission_accuracy", value=v, unit="rad", low=v + 1.5, high=v + 2.5)
        for v in (10.0, 10.1)
    ]
    mean = kinematic_error._mean_of("transmission_accuracy_forward", repeats)
    assert mean.value == pytest.approx(10.05)
    assert 0.5 * (mean.low + mean.high) == pytest.approx(12.05)


def test_what_repeats_share_is_no_smaller_by_their_number() -> None:
    """Scatter falls with the root of the repeats; an encoder's error is the same in each of them."""
    budget = (BudgetLine("scatter", "A", 3e-6), BudgetLine("output encoder", "B", 2e-6))
    one = Estimate(
        name="amplitude_2", value=8e-5, unit="rad", low=7.4e-5, high=8.6e-5, budget=budget
    )
    mean = kinematic_error._mean_of("amplitude_2", [one, one, one, one])
    lines = {line.source: line.standard_uncertainty for line in mean.budget}
    assert lines == pytest.approx(
        {"scatter": 1.5e-6, "output encoder": 2e-6, "between repeats": 0.0}
    )
