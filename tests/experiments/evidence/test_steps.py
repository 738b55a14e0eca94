"""Steps that a drive shaped by its own ramps are told from steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from experiments import catalogue
from experiments.contract import Evidence
from experiments.evidence.holds import Recorded
from experiments.evidence.steps import shape_of_the_steps
from experiments.evidence.table import TABLE
from experiments.finding import Severity
from experiments.recording import ArraySource, Recording, RunMetadata, Segment
from model.channel import Channel
from model.gear import HarmonicDrive

RATE, DURATION, SPEED = 500, 1.5, 60.0
(ROW,) = (row for row in TABLE if row.name == "shape of the steps")


def ramped(*ramps: float, mode: str | None) -> Recording:
    """Steps to +-60 rad/s by straight ramps of so many seconds, one after the other."""
    time = np.arange(round(DURATION * RATE)) / RATE
    parts, segments = [], []
    for index, ramp in enumerate(ramps):
        way = -1 if index % 2 else 1
        speed = np.clip(time / ramp, 0.0, 1.0) if ramp else np.ones(len(time))
        parts.append(way * SPEED * np.concatenate([[0.0], np.cumsum(speed[:-1]) / RATE]))
        start = index * len(time)
        segments.append(
            Segment(
                index=index,
                label="step",
                start=start,
                stop=start + len(time),
                setpoint=way * SPEED,
                direction=way,
            )
        )
    stamps = np.arange(len(time) * len(ramps)) * round(1e9 / RATE)
    return Recording(
        metadata=RunMetadata(
            run_id="R",
            experiment="velocity-steps",
            origin="simulated",
            sample_rate=RATE,
            process={} if mode is None else {"speed_mode": mode},
        ),
        signals={"input_angle": Channel(name="input_angle", unit="rad", scale=1.0)},
        segments=tuple(segments),
        events=(),
        source=ArraySource({"input_angle": np.concatenate(parts)}, stamps),
    )


def recorded(recording: Recording, gear: HarmonicDrive, kind: str = "velocity-steps") -> Recorded:
    return Recorded(recording, catalogue.load(kind), Evidence(gear))


def test_the_drives_ramps_are_a_finding_with_their_length(gear: HarmonicDrive) -> None:
    found = shape_of_the_steps(recorded(ramped(0.1, 0.2, 0.6, mode="profile velocity"), gear))
    assert found.severity is Severity.NOTES
    assert found.found == "profile velocity, ramps of 0.2 s (median)"
    assert "its own ramps shaped the steps" in found.follows
    assert "0.6 s at most" in found.follows


def test_a_step_of_a_drive_that_follows_every_sync_is_one(gear: HarmonicDrive) -> None:
    found = shape_of_the_steps(recorded(ramped(0.0, 0.0, mode="cyclic velocity"), gear))
    assert (found.severity, found.follows) == ("passed", "")


def test_a_position_loop_that_shaped_the_steps_is_a_finding(gear: HarmonicDrive) -> None:
    found = shape_of_the_steps(recorded(ramped(0.0, mode="cyclic position"), gear))
    assert found.severity is Severity.NOTES
    assert "position loop" in found.follows


def test_a_mode_that_only_choosing_shows_is_told_as_one_that_may_have(gear: HarmonicDrive) -> None:
    mode = "cyclic velocity or profile velocity"
    found = shape_of_the_steps(recorded(ramped(0.0, mode=mode), gear))
    assert "may have shaped" in found.follows
    assert found.severity is Severity.NOTES


@pytest.mark.parametrize(
    ("mode", "kind", "concerned"),
    [
        ("profile velocity", "velocity-steps", True),
        (None, "velocity-steps", False),
        ("profile velocity", "friction", False),
    ],
)
def test_it_concerns_what_rests_on_jumps_of_speed(
    mode: str | None, kind: str, concerned: bool, gear: HarmonicDrive
) -> None:
    assert ROW.concerns(recorded(ramped(0.2, mode=mode), gear, kind)) == concerned


def test_steps_that_did_not_turn_are_told_without_a_length(gear: HarmonicDrive) -> None:
    still = ramped(0.2, mode="profile velocity")
    source = ArraySource({"input_angle": np.zeros(still.rows)}, still.source.time_ns(0, still.rows))
    found = shape_of_the_steps(recorded(replace(still, source=source), gear))
    assert "cannot be told" in found.follows
