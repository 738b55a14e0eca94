"""What analyses share: quality, phase reference, stretches, budgets, verdicts, and truth beside findings."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.angle.phase_reference import phase_reference
from experiments.angle.traverses import traverses_of
from experiments.budget import budget_table, torque_scale_uncertainty
from experiments.contract import Evidence
from experiments.errors import AnalysisError
from experiments.evidence import check_recording, require_time_base
from experiments.protocols.kinematic_error import analysis as kinematic_error
from experiments.recording import ArraySource, Recording, RunMetadata
from experiments.recordings.channels import chosen_channel
from experiments.result import Result, outcome_against
from experiments.truth import truth_of, truth_rows
from model.channel import Calibration, Channel
from model.gear import HarmonicDrive
from model.identify.estimate import NORMAL_COVERAGE_FACTOR, BudgetLine, Estimate
from model.units import REVOLUTION
from tests.experiments.conftest import SERIES
from tests.experiments.synthetic import Bench


def of_angle(angle: np.ndarray, quantum: float = 0.0) -> Recording:
    """A recording of an input angle alone, 1 kHz."""
    stored = np.round(angle / quantum).astype(np.int64) if quantum else angle
    signal = Channel(name="input_angle", unit="rad", scale=quantum or 1.0, is_counted=quantum > 0.0)
    times = np.arange(len(angle), dtype=np.int64) * 1_000_000
    metadata = RunMetadata(run_id="angle-1", experiment="", origin="imported", time_base="device")
    return Recording(
        metadata, {"input_angle": signal}, (), (), ArraySource({"input_angle": stored}, times)
    )


def test_a_short_recording_is_refused() -> None:
    with pytest.raises(AnalysisError, match="too short"):
        check_recording(of_angle(np.linspace(0.0, 1.0, 50)), "a test", 0.001)


@given(turns=st.lists(st.floats(2.3, 6.0), min_size=1, max_size=4), speed=st.floats(2.0, 60.0))
def test_stretches_lie_in_one_direction_and_leave_the_wind_up_out(
    turns: list[float], speed: float
) -> None:
    parts, here = [np.zeros(200)], 0.0
    for k, turn in enumerate(turns):
        way = 1.0 if k % 2 == 0 else -1.0
        travel = np.arange(0.0, turn * REVOLUTION, speed / 1000.0)
        parts += [here + way * travel, np.full(300, here + way * travel[-1])]
        here += way * float(travel[-1])
    recording = of_angle(np.concatenate(parts), quantum=REVOLUTION / 32768)
    found = traverses_of(recording)
    assert len(found) == len(turns)
    for segment, turn in zip(found, turns, strict=True):
        moved = np.diff(recording.si("input_angle", segment))
        assert np.all(segment.direction * moved >= 0.0)
        covered = abs(float(moved.sum())) / REVOLUTION
        assert turn - 1.5 <= covered <= turn
        assert 0.8 * speed <= segment.direction * segment.setpoint <= 1.01 * speed


def test_a_standstill_has_no_stretch() -> None:
    assert traverses_of(of_angle(np.zeros(1000), REVOLUTION / 8192)) == ()


def test_the_phase_reference_is_the_mark_before_the_outputs(
    kinematic_error_run: Recording, bench: Bench
) -> None:
    reference = phase_reference(kinematic_error_run)
    assert reference.what == "index marks"
    away = (reference.input_angle - bench.index) / REVOLUTION
    assert away == pytest.approx(round(away), abs=1e-4)
    there = bench.output_index * bench.gear.ratio
    assert (
        -1.0
        <= (reference.input_angle - there) / REVOLUTION % bench.gear.ratio - bench.gear.ratio
        <= 0.1
    )


def test_without_marks_phases_count_from_the_start_and_are_called_so(
    kinematic_error_run: Recording,
) -> None:
    signals = {n: s for n, s in kinematic_error_run.signals.items() if "index" not in n}
    reference = phase_reference(dataclasses.replace(kinematic_error_run, signals=signals))
    assert not reference.carries
    assert reference.warnings()


@pytest.mark.parametrize("time_base", ["hardware", "device", "virtual"])
def test_stamps_of_device_and_sync_are_times(time_base: str) -> None:
    recording = of_angle(np.linspace(0.0, 1.0, 200))
    require_time_base(
        dataclasses.replace(
            recording, metadata=dataclasses.replace(recording.metadata, time_base=time_base)
        ),
        "a test",  # type: ignore[arg-type]
    )


def test_what_was_polled_is_no_half_of_a_pair() -> None:
    recording = of_angle(np.linspace(0.0, 1.0, 200))
    name, channel = next(iter(recording.signals.items()))
    assert name in ("input_angle", "output_angle")
    check_recording(recording, "a test", 0.1)
    polled = {**recording.signals, name: dataclasses.replace(channel, acquired="polled")}
    with pytest.raises(AnalysisError, match="polled at times of their own"):
        check_recording(dataclasses.replace(recording, signals=polled), "a test", 0.1)


def test_a_channel_without_calibration_gets_the_assumed_scale() -> None:
    recording = of_angle(np.linspace(0.0, 1.0, 200))
    bare = dataclasses.replace(
        recording, signals={"torque": Channel(name="torque", unit="N m", is_counted=False)}
    )
    known = dataclasses.replace(
        recording,
        signals={
            "torque": Channel(
                name="torque",
                unit="N m",
                is_counted=False,
                calibration=Calibration(scale_relative_uncertainty=0.002),
            )
        },
    )
    assert torque_scale_uncertainty(bare)[0] == pytest.approx(0.03)
    assert torque_scale_uncertainty(known)[0] == 0.002


def test_a_channel_is_named_or_the_first_that_is_there() -> None:
    recording = of_angle(np.linspace(0.0, 1.0, 200))
    assert (
        chosen_channel(recording, {}, "angle", ("position", "input_angle"), "a test")
        == "input_angle"
    )
    with pytest.raises(AnalysisError, match="position"):
        chosen_channel(recording, {"angle": "position"}, "angle", ("input_angle",), "a test")
    with pytest.raises(AnalysisError, match="torque or force"):
        chosen_channel(recording, {}, "effort", ("torque", "force"), "a test")


def estimate(value: float, u: float) -> Estimate:
    return Estimate(
        name="x",
        value=value,
        unit="1",
        low=value - u,
        high=value + u,
        budget=(BudgetLine("a", "A", 0.6 * u), BudgetLine("b", "B", 0.8 * u)),
    )


@given(value=st.floats(0.1, 10.0), u=st.floats(0.001, 1.0), limit=st.floats(0.1, 10.0))
def test_verdicts_use_the_expanded_uncertainty(value: float, u: float, limit: float) -> None:
    found = estimate(value, u)
    assert found.expanded_uncertainty == pytest.approx(1.96 * u, rel=1e-4)
    outcome = outcome_against(found, limit)
    low, high = value - NORMAL_COVERAGE_FACTOR * u, value + NORMAL_COVERAGE_FACTOR * u
    expected = "PASS" if high <= limit else "FAIL" if low > limit else "MARGINAL"
    if min(abs(high - limit), abs(low - limit)) > 1e-9:
        assert outcome == expected
    lower = "PASS" if low >= limit else "FAIL" if high < limit else "MARGINAL"
    if min(abs(high - limit), abs(low - limit)) > 1e-9:
        assert outcome_against(found, limit, is_upper=False) == lower


def test_a_budget_adds_up() -> None:
    rows = budget_table([estimate(1.0, 0.1)]).rows
    assert [row[1] for row in rows] == ["a", "b", "combined", "expanded, k = 1.96"]
    assert float(rows[3][3]) == pytest.approx(
        1.959964 * math.hypot(float(rows[0][3]), float(rows[1][3]))
    )


def truth_for(result: Result) -> dict[str, object]:
    """The truth of the synthetic bench in the words of the simulated rig: phases over the recorded input angle."""
    reference = float(result.options["phase_reference_angle"])
    orders = []
    for h in SERIES:
        phase = math.atan2(h.sine, h.cosine) + h.order * reference
        orders.append(
            {
                "order": h.order,
                "cosine": h.amplitude * math.cos(phase),
                "sine": h.amplitude * math.sin(phase),
                "amplitude": h.amplitude,
            }
        )
    return {"kinematic_error": {"measurable_recorded": orders}}


def test_truth_stands_beside_what_was_found(
    kinematic_error_run: Recording, gear: HarmonicDrive
) -> None:
    result = kinematic_error.analyse(kinematic_error_run, Evidence(gear))
    rows = [row for row in truth_rows(result, truth_for(result)) if row.seen]
    assert len(rows) == 2 * len(SERIES)
    # Quantisation without noise is the same in every run: what it leaves is no random number, only of that size.
    halves = [0.5 * (row.estimate.high - row.estimate.low) for row in rows]
    assert all(abs(row.difference) < 2.0 * half for row, half in zip(rows, halves, strict=True))
    assert sum(row.covered for row in rows) >= 7
    assert all(row.within for row in rows if row.covered)


def test_a_run_that_knows_no_truth_says_so() -> None:
    with pytest.raises(AnalysisError, match="no truth"):
        truth_of({})
