"""The run that the long studies make: to and fro at constant speed for as long as is asked, by the real session.

The session, engine, supervisor, recorder and make-safe are those of every run; only the plan is of the studies' own.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from experiments.contract import Evidence, Experiment
from experiments.recording import Recording
from experiments.result import Result
from experiments.steps import vocabulary as s
from model.gear import HarmonicDrive
from model.units import REVOLUTION, RPM

SPEED = 1013.0 * RPM
"""rad/s at the input, incommensurate with the SYNC."""
ACCELERATION = 1000.0
HOLD = 14.0
"""s at constant speed before the direction changes."""
ZERO = 2.0


@dataclass(frozen=True)
class LongRunParameters:
    """Nothing to choose: the duration is the plan's."""


def plan(parameters: LongRunParameters, gear: HarmonicDrive, duration: float) -> Iterator[s.Step]:
    """Servo off, forward and reverse by turns for `duration` [s] in all, servo off."""
    yield s.ServoOff(ZERO, s.SegmentLabel("torque-zero-before"))
    left, direction = duration - 2.0 * ZERO, 1
    while left > 0.0:
        yield s.Ramp(direction * SPEED, ACCELERATION)
        hold = min(HOLD, left)
        # By revolutions, not by cycles: where SYNCs come late a hold of so many cycles would turn too far.
        turns = hold * SPEED / REVOLUTION
        yield s.HoldRevolutions(
            turns, 2.0 * hold + 5.0, s.SegmentLabel("hold", direction * SPEED, direction)
        )
        left, direction = left - hold - 2.0 * SPEED / ACCELERATION, -direction
    yield s.Ramp(0.0, ACCELERATION)
    yield s.ServoOff(ZERO, s.SegmentLabel("torque-zero-after"))


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """Nothing is judged: the studies ask how the run was acquired."""
    return Result(run=recording.metadata.run_id, kind="long-run", estimates={}, metrics={})


def long_run(duration: float) -> Experiment:
    """The experiment whose plan lasts for `duration` [s]."""
    return Experiment(
        name="long-run",
        title="long run",
        summary="to and fro at constant speed",
        parameters=LongRunParameters,
        plan=partial(plan, duration=duration),
        analyse=analyse,
        needs=("input_angle", "output_angle", "torque"),
    )


def resident_megabytes() -> float:
    """Memory of this process that is in use now [MB]; what it held at most where the system does not tell."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
    except (OSError, IndexError, ValueError):
        import resource

        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def load_average() -> str:
    """Processes that wanted to run during the last 1, 5 and 15 minutes."""
    return (
        ", ".join(f"{value:.1f}" for value in os.getloadavg())
        if hasattr(os, "getloadavg")
        else "not told"
    )
