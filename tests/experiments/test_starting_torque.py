"""What may not move a starting torque, and what its budget holds."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from experiments import catalogue
from experiments.contract import Evidence
from experiments.errors import AnalysisError
from experiments.evidence.conclusion import judged
from experiments.evidence.dead_band import dead_band
from experiments.evidence.holds import Recorded
from experiments.finding import Finding, Severity
from experiments.protocols.starting_torque import analysis as starting_torque
from experiments.protocols.starting_torque.plan import Parameters, plan
from experiments.recording import ArraySource, Recording, Segment
from experiments.result import Result
from model.channel import Calibration, Channel
from model.gear import HarmonicDrive
from model.identify.estimate import Estimate
from tests.experiments.synthetic import Bench, record

Counts = NDArray[np.int64]


@pytest.fixture(scope="module")
def ramps(bench: Bench, gear: HarmonicDrive) -> Recording:
    # The encoder without errors: its cogging stands at one phase in all of four positions.
    plain = dataclasses.replace(bench, cogging=())
    return record(plan(Parameters(positions=4, approach_rpm=30.0), gear), plain, "starting-torque")


@pytest.fixture(scope="module")
def honest(ramps: Recording, gear: HarmonicDrive) -> Result:
    return starting_torque.analyse(ramps, Evidence(gear))


def changed(
    recording: Recording, change: Callable[[Counts, Segment], None], *channels: str
) -> Recording:
    """A copy in which something is done to the counts of channels within each ramp."""
    source = recording.source
    assert isinstance(source, ArraySource)
    arrays = {name: source.arrays[name].copy() for name in channels}
    for segment in recording.labelled("torque-ramp"):
        for values in arrays.values():
            change(values, segment)
    source = dataclasses.replace(source, arrays={**source.arrays, **arrays})
    return dataclasses.replace(recording, source=source)


def the_torque(result: Result) -> Estimate:
    return result.estimates["starting_torque"]


@pytest.mark.parametrize("size", [4000, -4000, 40])
@pytest.mark.parametrize("channel", ["input_angle", "output_angle", "torque"])
def test_stray_rows_do_not_move_breakaway(
    ramps: Recording, honest: Result, gear: HarmonicDrive, channel: str, size: int
) -> None:
    def stray(values: Counts, segment: Segment) -> None:
        third = (segment.stop - segment.start) // 3
        values[segment.start + third] += size
        # Where a straight line hangs on them most: before the motion.
        late = segment.start + (segment.stop - segment.start) * 9 // 10
        values[late : late + 2] -= size
        values[segment.start] += size

    found = starting_torque.analyse(changed(ramps, stray, channel), Evidence(gear))
    for name, estimate in honest.estimates.items():
        assert found.estimates[name].value == pytest.approx(estimate.value, rel=2e-3), name


def test_counts_that_jump_are_no_motion(ramps: Recording, gear: HarmonicDrive) -> None:
    first = ramps.labelled("torque-ramp")[0]

    def jump(values: Counts, segment: Segment) -> None:
        if segment == first:
            values[(segment.start + segment.stop) // 2 :] += 40

    found = starting_torque.analyse(changed(ramps, jump, "input_angle"), Evidence(gear))
    assert found.metrics["ramps"] == 7.0
    assert any("1 of 8 ramps ended by a jump" in w for w in found.warnings)

    def every(values: Counts, segment: Segment) -> None:
        values[(segment.start + segment.stop) // 2 : segment.stop] += 40

    with pytest.raises(AnalysisError, match="no motion of the gear"):
        starting_torque.analyse(changed(ramps, every, "input_angle"), Evidence(gear))


def test_both_encoders_tell_the_motion(ramps: Recording, gear: HarmonicDrive) -> None:
    first = ramps.labelled("torque-ramp")[0]

    def creep(values: Counts, segment: Segment) -> None:
        """The coupling of the motor's encoder slips by a quarter of a turn, little by little."""
        if segment == first:
            half = (segment.stop - segment.start) // 2
            values[segment.stop - half : segment.stop] += np.linspace(0, 8192, half).astype(int)

    found = starting_torque.analyse(changed(ramps, creep, "input_angle"), Evidence(gear))
    assert found.metrics["ramps"] == 7.0
    assert any("1 of 8 ramps moved by one encoder only" in w for w in found.warnings)


def test_ramps_that_disagree_are_refused(ramps: Recording, gear: HarmonicDrive) -> None:
    first = ramps.labelled("torque-ramp")[0]
    ends = first.start + (first.stop - first.start) // 3

    def early(values: Counts, segment: Segment) -> None:
        """One ramp was ended by a hand at the shaft, at a third of the torque."""
        if segment == first:
            values[ends:] += values[segment.stop - 1] - values[segment.stop - 1 - 60]
            moved = values[segment.stop - 60 : segment.stop] - values[segment.stop - 60]
            values[ends : ends + 60] = values[segment.start] + moved

    with pytest.raises(AnalysisError, match="the ramps disagree") as refused:
        starting_torque.analyse(changed(ramps, early, "input_angle"), Evidence(gear))
    assert refused.value.remedy


def test_directions_apart_are_in_the_budget_or_refused(
    ramps: Recording, honest: Result, gear: HarmonicDrive
) -> None:
    def louder(milli: float) -> Recording:
        counts = round(milli * 1e-3 / ramps.signals["torque"].scale)

        def more(values: Counts, segment: Segment) -> None:
            values[segment.start : segment.stop] += counts

        return changed(ramps, more, "torque")

    widened = starting_torque.analyse(louder(5.0), Evidence(gear))
    assert not any(b.source == "directions apart" for b in the_torque(honest).budget)
    assert the_torque(widened).value == pytest.approx(the_torque(honest).value, rel=1e-3)
    for name, one in honest.estimates.items():
        found = widened.estimates[name]
        assert abs(found.value - one.value) <= found.expanded_uncertainty
    (line,) = (b for b in the_torque(widened).budget if b.source == "directions apart")
    assert line.standard_uncertainty == pytest.approx(5e-3 / math.sqrt(3.0), rel=0.05)
    with pytest.raises(AnalysisError, match="the directions disagree"):
        starting_torque.analyse(louder(40.0), Evidence(gear))


def warm(ramps: Recording, degrees: float) -> Recording:
    """The same ramps of a housing at this temperature, by a thermometer within 0.5 K."""
    source = ramps.source
    assert isinstance(source, ArraySource)
    channel = Channel(
        name="housing_temperature",
        unit="degC",
        scale=0.01,
        calibration=Calibration(offset_uncertainty=0.5),
    )
    arrays = {**source.arrays, channel.name: np.full(ramps.rows, round(degrees / 0.01))}
    return dataclasses.replace(
        ramps,
        signals={**ramps.signals, channel.name: channel},
        source=dataclasses.replace(source, arrays=arrays),
    )


def test_a_value_stands_at_20_degrees_beside_that_of_the_run(
    ramps: Recording, honest: Result, gear: HarmonicDrive
) -> None:
    assert "starting_torque_at_20_degrees" not in honest.estimates
    settings = {"dry_per_kelvin": (-0.004, 0.001), "per_kelvin_source": "four runs"}
    assumed = starting_torque.analyse(warm(ramps, 30.0), Evidence(gear))
    known = starting_torque.analyse(warm(ramps, 30.0), Evidence(gear, settings=settings))
    for result, factor in ((assumed, 0.95), (known, 0.96)):
        own, cold = the_torque(result), result.estimates["starting_torque_at_20_degrees"]
        assert cold.value == pytest.approx(own.value / factor)
        assert cold.low < cold.value < cold.high
        lines = {b.source: b.standard_uncertainty for b in cold.budget}
        assert lines["thermometer"] == pytest.approx(
            (1.0 / factor - 1.0) / 20.0 * cold.value, rel=0.1
        )
        assert cold.expanded_uncertainty > own.expanded_uncertainty

    def by_coefficient(result: Result) -> float:
        budget = result.estimates["starting_torque_at_20_degrees"].budget
        lines = [b for b in budget if b.source == "temperature of dry friction"]
        return lines[0].standard_uncertainty

    # 0 to -1 % per kelvin over ten kelvin; of four runs a quarter of that, the motor's share beside it.
    assert by_coefficient(assumed) == pytest.approx(
        0.1 / math.sqrt(12.0) / 0.95**2 * 0.09, rel=0.05
    )
    assert 5e-3 * 0.09 < by_coefficient(known) < 0.4 * by_coefficient(assumed)


def test_the_budget_has_what_no_ramp_shows(honest: Result) -> None:
    found = the_torque(honest)
    lines = {b.source: b.standard_uncertainty for b in found.budget}
    assert lines["from run to run"] == pytest.approx(0.01 * found.value)
    # Nobody recorded a temperature: 5 K of a tenth of a percent each.
    assert lines["warmth of the motor"] == pytest.approx(5e-3 * found.value)


def test_the_number_stands_in_its_picture_with_what_was_taken_off(honest: Result) -> None:
    (plot,) = honest.plots
    estimate = honest.estimates["starting_torque"]
    line = next(one for one in plot.series if one.label == "starting torque")
    assert line.y == pytest.approx([1e3 * estimate.value] * 2)
    assert (
        f"{1e3 * estimate.value:.3g} ± {1e3 * estimate.expanded_uncertainty:.2g} mN m" in plot.note
    )


def test_a_torque_that_reaches_zero_was_not_measured() -> None:
    quantities = catalogue.load("starting-torque").quantities
    for quantity in (q for q in quantities if q.is_above_zero):
        wide = Estimate(name="x", value=0.0127, unit="N m", low=0.0, high=0.02)
        reaching = dataclasses.replace(wide, low=-0.0013, high=0.0267)
        assert judged(quantity, wide).identifiable != "no"
        found = judged(quantity, reaching)
        assert (found.identifiable, "must be above zero" in found.note) == ("no", True)
    assert sum(q.is_above_zero for q in quantities) == 3


def test_a_ramp_begins_at_no_torque(ramps: Recording, gear: HarmonicDrive) -> None:
    experiment = catalogue.load("starting-torque")

    def found(milli: float) -> Finding:
        def less(values: Counts, segment: Segment) -> None:
            counts = round(1e-3 * milli / ramps.signals["torque"].scale)
            values[segment.start : segment.stop] -= segment.direction * counts

        recording = changed(ramps, less, "torque")
        return dead_band(Recorded(recording, experiment, Evidence(gear)))

    assert found(0.0).severity is Severity.PASSED
    assert found(1.5).severity is Severity.PASSED
    for milli in (5.0, -5.0):
        refused = found(milli)
        assert refused.severity is Severity.BLOCKS
        assert float(refused.found.split()[0]) == pytest.approx(-milli, abs=0.5)
