"""Whether the steps of a run are steps: a drive without a cyclic speed mode shapes them by ramps of its own.

A ramp of duration T excites a mode of frequency f by |sin(pi f T)/(pi f T)| of what a step does.
"""

from __future__ import annotations

import math

import numpy as np

from experiments.evidence import usable
from experiments.evidence.holds import Recorded
from experiments.evidence.outcomes import not_checked, noted, passed
from experiments.finding import Finding
from experiments.recording import Recording, Segment
from model.arrays import FloatArray

_SPEED_MODE = "speed_mode"
"""What a run file calls the mode in which its drive turned by speed."""
PROFILE, POSITION = "profile velocity", "cyclic position"
STEADY = 0.5
"""Share of a step after which its speed is taken to be the one that it ends with."""


def tells_mode(recorded: Recorded) -> bool:
    """Whether the run file says in which mode its drive turned."""
    return bool(recorded.recording.metadata.process.get(_SPEED_MODE))


def shape_of_the_steps(recorded: Recorded) -> Finding:
    """In profile velocity the drive's ramps, in cyclic position its position loop, not the plan's jumps, are what the
    gear was asked to follow.
    """
    recording = recorded.recording
    mode = str(recording.metadata.process.get(_SPEED_MODE, ""))
    if POSITION in mode:
        words = (
            "The drive was led by target positions: its position loop, and the filter of what it feeds forward, shaped "
            "the steps; the commanded input of figure 19 has no such loop."
        )
        return noted(mode, "cyclic velocity", words)
    if PROFILE not in mode:
        return passed(mode, "cyclic velocity")
    steps = recording.labelled("step")
    if not steps or not recording.has("input_angle"):
        return not_checked("step segments and the input's angle are needed")
    ramps = [ramp for step in steps if math.isfinite(ramp := ramp_time(recording, step))]
    found, how_long = mode, "how long they took cannot be told"
    if ramps:
        typical = float(np.median(ramps))
        found = f"{mode}, ramps of {typical:.2g} s (median)"
        how_long = (
            f"they took {typical:.2g} s in the median of {len(ramps)}, {max(ramps):.2g} s at most"
        )
    may_have = "" if mode == PROFILE else "may have "
    words = (
        f"The drive ran in {mode}: its own ramps {may_have}shaped the steps; {how_long}. A ramp that is longer than a "
        "mode's period excites it by less than a third of what a step does, and the commanded input of figure 19 has "
        "no such ramp."
    )
    return noted(found, "cyclic velocity", words)


def ramp_time(recording: Recording, step: Segment) -> float:
    """Duration [s] of the straight ramp that a step lags behind its final speed by: T = 2 (t - theta/omega), with
    time and angle since the step began; NaN where it does not turn.
    """
    good = usable(recording, step)
    time: FloatArray = recording.time(step)[good]
    angle: FloatArray = recording.si("input_angle", step)[good]
    if len(time) < 10:
        return math.nan
    half = round(STEADY * len(time))
    speed = float(angle[-1] - angle[half]) / float(time[-1] - time[half])
    if not abs(speed) > 0.5 * abs(step.setpoint) > 0.0:
        return math.nan
    return max(0.0, 2.0 * (float(time[-1] - time[0]) - float(angle[-1] - angle[0]) / speed))
