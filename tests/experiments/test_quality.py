"""What a recording must be before anything is computed from it, and what is said of one that is not quite that."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.samples import CycleFlag
from experiments.contract import Evidence
from experiments.errors import AnalysisError
from experiments.evidence import BAD_CYCLE, check_recording, require_time_base, time_base_remark
from experiments.evidence.skew import skews, viscous_windup
from experiments.protocols.friction import analysis as friction
from experiments.protocols.motor_tare import analysis as motor_tare
from experiments.protocols.velocity_steps import analysis as velocity_steps
from experiments.recording import ArraySource, Recording, RunMetadata, Segment
from experiments.recordings.motion import analysis as motion
from model.channel import Channel
from model.gear import HarmonicDrive

PERIOD_NS = 1_000_000


class WithCycles(ArraySource):
    """A source that knows the SYNC cycle of each row."""

    gap = 0

    def cycles(self, start: int, stop: int) -> NDArray[np.int64]:
        rows = np.arange(start, min(stop, self.rows))
        return rows + self.gap * (rows >= self.rows // 2)


def made(
    rows: int = 1000, flags: NDArray[np.uint16] | None = None, gap: int = 0, **metadata: Any
) -> Recording:
    arrays = {"input_angle": np.arange(rows), "output_angle": -np.arange(rows) // 120}
    signals = {
        "input_angle": Channel(name="input_angle", unit="rad", scale=1e-3),
        "output_angle": Channel(name="output_angle", unit="rad", scale=8.7e-5),
    }
    source = WithCycles(arrays, np.arange(rows, dtype=np.int64) * PERIOD_NS, flags)
    object.__setattr__(source, "gap", gap)
    about = {"time_base": "device", "sample_rate": 1000.0, "ratio": 120.0} | metadata
    segments = (
        Segment(index=0, label="hold", start=0, stop=rows, setpoint=300.0, direction=1, repeat=0),
    )
    return Recording(
        RunMetadata(run_id="run-1", experiment="", origin="imported", **about),
        signals,
        segments,
        (),
        source,
    )  # type: ignore[arg-type]


def with_torque(recording: Recording) -> Recording:
    signals = {
        **recording.signals,
        "torque": Channel(name="torque", unit="N m", scale=1e-4, is_counted=False),
    }
    arrays = {**recording.source.arrays, "torque": np.zeros(recording.rows)}  # type: ignore[attr-defined]
    return dataclasses.replace(
        recording, signals=signals, source=ArraySource(arrays, recording.source.times)
    )  # type: ignore[attr-defined]


def flags_of(rows: int, flag: int, count: int) -> NDArray[np.uint16]:
    found = np.zeros(rows, dtype=np.uint16)
    found[10 : 10 + count] = flag
    return found


def test_the_flags_that_cost_a_cycle_are_those_of_the_drivers() -> None:
    assert (
        BAD_CYCLE
        == CycleFlag.INCOMPLETE | CycleFlag.SHORT | CycleFlag.JUMPED | CycleFlag.SIGNAL_ERROR
    )


@pytest.mark.parametrize(
    ("missed", "allowed", "is_refused"), [(1, 1e-3, False), (2, 1e-3, True), (50, 0.05, False)]
)
def test_the_share_of_missed_cycles_is_what_was_asked_for(
    missed: int, allowed: float, is_refused: bool
) -> None:
    recording = made(flags=flags_of(1000, CycleFlag.INCOMPLETE | CycleFlag.STALE_OUTPUT, missed))
    if is_refused:
        with pytest.raises(AnalysisError, match=r"too many cycles.*largest-missed-share"):
            check_recording(recording, "a test", allowed)
        return
    checked = check_recording(recording, "a test", allowed)
    assert checked.missed == missed
    assert checked.missed_share == pytest.approx(missed / 1000)


def test_cycles_that_never_became_a_row_are_missed_as_well() -> None:
    with pytest.raises(AnalysisError, match="20 of 1020"):
        check_recording(made(gap=20), "a test", 1e-3)
    assert check_recording(made(gap=20), "a test", 0.02).missed == 20


@pytest.mark.parametrize("time_base", ["host", "nominal", "none"])
def test_speeds_are_refused_without_true_time(time_base: str, gear: HarmonicDrive) -> None:
    recording = made(time_base=time_base)
    with pytest.raises(AnalysisError, match="true time of each cycle"):
        require_time_base(recording, "a speed")
    for analysis in (velocity_steps.analyse, motion.analyse):
        with pytest.raises(AnalysisError, match="needs the true time of each cycle"):
            analysis(with_torque(recording), Evidence(gear))
    assert skews(recording, gear) == {}


def test_a_recording_without_any_time_has_no_speeds(gear: HarmonicDrive) -> None:
    assert time_base_remark(made()) == []
    assert "average rate" in time_base_remark(made(time_base="host"))[0]
    recording = with_torque(made(time_base="none"))
    with pytest.raises(AnalysisError, match="without time has no speeds"):
        friction.analyse(recording, Evidence(gear))
    bare_motor = dataclasses.replace(recording.metadata, gear_mounted=False)
    with pytest.raises(AnalysisError, match="without time has no speeds"):
        motor_tare.analyse(dataclasses.replace(recording, metadata=bare_motor), Evidence(gear))


def test_what_the_acquisition_found_is_said_with_the_result() -> None:
    quiet = {
        "index_marks": {"input_angle": {"worst_excess": 2}},
        "skew": {"encoder_skew": {"value": 1e-5}},
    }
    assert check_recording(made(process={"acquisition": quiet}), "a test", 0.001).warnings == ()
    loud = {
        "index_marks": {"input_angle": {"worst_excess": -40}},
        "skew": {"encoder_skew": {"value": 1e-4}},
    }
    said = check_recording(made(process={"acquisition": loud}), "a test", 0.001).warnings
    assert "lost or gained counts" in said[0]
    # 300 rad/s / 120 * 100 us
    assert "52 arcsec at the fastest set-point" in said[1]
    for broken in (
        "text",
        {"index_marks": 3, "skew": {"encoder_skew": None}},
        {"skew": {"encoder_skew": {"value": None}}},
    ):
        assert (
            check_recording(made(process={"acquisition": broken}), "a test", 0.001).warnings == ()
        )


def turning(skew: float, wind_up: float = 2e-5) -> Recording:
    """The input at four speeds each way for an output revolution in all, the output latched `skew` later."""
    ratio, lines = 120.0, 72000
    speeds = [s * d for s in (40.0, 90.0, 160.0, 280.0) for d in (1, 1, -1, -1)]
    speed = np.repeat(speeds, 2000)
    angle = np.cumsum(speed) * 1e-3
    output = (
        angle / ratio
        + skew * speed / ratio
        + wind_up * np.sign(speed)
        + 3e-5 * np.cos(angle / ratio)
    )
    output += 7e-5 * np.sin(2.0 * angle)
    quanta = {"input_angle": 2.0 * math.pi / 32768, "output_angle": 2.0 * math.pi / lines}
    signals = {n: Channel(name=n, unit="rad", scale=q) for n, q in quanta.items()}
    arrays = {
        "input_angle": np.floor(angle / quanta["input_angle"]),
        "output_angle": np.floor(-output / quanta["output_angle"]),
    }
    times = np.arange(len(angle), dtype=np.int64) * PERIOD_NS
    about = RunMetadata(
        run_id="run-2",
        experiment="",
        origin="simulated",
        ratio=ratio,
        sample_rate=1000.0,
        time_base="hardware",
    )
    return Recording(about, signals, (), (), ArraySource(arrays, times))


@pytest.mark.parametrize("skew", [0.0, 3e-5, -2e-4])
def test_the_skew_is_found_in_a_recording_without_segments(
    skew: float, gear: HarmonicDrive
) -> None:
    found = skews(turning(skew))["encoder_skew"]
    assert found.identifiable == "yes"
    assert found.low < skew < found.high
    assert found.expanded_uncertainty < 1.5e-5
    doubted = skews(turning(skew), gear)["encoder_skew"]
    assert doubted.identifiable == "weakly"
    assert doubted.value == found.value
    assert doubted.expanded_uncertainty == pytest.approx(
        2.0 * viscous_windup(gear, np.array([0.4, 2.3]), 120.0), rel=0.2
    )


@pytest.mark.parametrize(("skew", "late"), [(1e-3, "output angle is"), (-1e-3, "input angle is")])
def test_process_data_that_are_always_one_sync_late_are_found_by_the_motion(
    skew: float, late: str
) -> None:
    recording = turning(skew)
    found = skews(recording)["encoder_skew"]
    assert found.value == pytest.approx(skew, abs=5e-6)
    process = {"acquisition": {"skew": {"encoder_skew": found.as_json()}}}
    told = dataclasses.replace(
        recording, metadata=dataclasses.replace(recording.metadata, process=process)
    )
    (said,) = check_recording(told, "a test", 0.001).warnings
    assert late in said
    assert "1.00 SYNC cycles" in said


def test_a_short_or_standing_recording_has_no_skew(gear: HarmonicDrive) -> None:
    assert skews(made(), gear)["encoder_skew"].identifiable == "no"
    still = made(200)
    source = ArraySource({n: np.zeros(200) for n in still.signals}, still.source.times)  # type: ignore[attr-defined]
    assert (
        skews(dataclasses.replace(still, source=source), gear)["encoder_skew"].identifiable == "no"
    )
    assert skews(made(gear_mounted=False), gear) == {}
