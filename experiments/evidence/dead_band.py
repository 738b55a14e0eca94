"""Checks of the torque channel about zero: a dead band, a torque that does not begin at zero, and its own steps.

A port and a drive that share one sensor share these too, so that the one is no witness of the other: they are looked
for where the torque passes zero. Noise stops where nothing is read: readings that stand still, there and with the servo
off, while those of the holds do not, are a dead band. A torque ramp begins at no torque: a straight line through its
last part goes back there.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator

import numpy as np

from experiments.evidence.holds import (
    PUSHING,
    TURNING,
    ZERO_AFTER,
    ZERO_BEFORE,
    Recorded,
    part_of,
)
from experiments.evidence.outcomes import not_checked, refused_beyond
from experiments.finding import Finding, Severity
from experiments.recording import Recording, Segment
from model.arrays import FloatArray, joined
from model.units import DEGREE

OFF = (ZERO_BEFORE, ZERO_AFTER, "rest")
"""Labels of segments in which the power may be off, and a reading of nothing is right."""
LOOKED_AT = 20_000
"""Rows of one segment that tell noise and steps."""
_STANDING = 16
"""Equal readings on end that noise of one step does not bring: 0.38^15 a row."""
_OFTEN = 3
"""How often readings stand at one value, from which on it is no chance."""
_CONSTANT = 0.99
"""Share of the readings with the servo off that are one value where a dead band hides their noise."""
FROM, UNTIL = 0.55, 0.92
"""The part of a ramp, up to its motion, whose line is drawn back to its beginning."""
_MOVED = 0.2 * DEGREE
BLOCKS = 8
"""Parts of it whose medians the line goes through: stray readings do not move it."""
LEAST_ROWS = 40
_INTERCEPT = 0.002
"""N m by which a ramp may begin beside zero: the zero, cogging, friction that gives way."""
LAG = 0.02
"""s by which drive and port may follow the ramp."""
STEP_SHARE = 0.05
"""Step of the readings, as a share of the torque, from which on an average of equal readings says too little."""
_UNDITHERED = 0.5
"""Share of equal neighbours from which on noise does not carry the readings from step to step."""


def dead_band(recorded: Recorded) -> Finding:
    """Whether the torque channel reads nothing about zero, or too little above it."""
    if not recorded.torque:
        return not_checked("there is no torque channel in N m")
    found = _beginning(recorded)
    if found.severity is Severity.BLOCKS:
        return found
    standing = _standing(recorded)
    return found if standing.severity is Severity.NOT_LOOKED_AT else standing


def _beginning(recorded: Recorded) -> Finding:
    """The torque along the motion at which the ramps begin, by their last parts."""
    ramps = recorded.recording.labelled(*PUSHING)
    if not ramps:
        return not_checked("the run has no torque ramp")
    lines = [line for ramp in ramps if (line := _line(recorded, ramp)) is not None]
    if len(lines) < 2:
        return not_checked("the ramps are too short to tell where they begin")
    begins, rates = np.array(lines).T
    mean = float(begins.mean())
    error = float(begins.std(ddof=1)) / math.sqrt(len(begins))
    allowed = _INTERCEPT + LAG * float(np.median(np.abs(rates))) + 3.0 * error
    return refused_beyond(
        abs(mean) > allowed,
        f"{1e3 * mean:.2g} mN m where the ramps begin",
        f"within ± {1e3 * allowed:.2g} mN m",
        "the torque does not begin at zero: the port has a dead band, or reads by another scale there",
    )


def _line(recorded: Recorded, ramp: Segment) -> tuple[float, float] | None:
    """Torque at the beginning of a ramp, along its direction [N m], and its rate [N m/s]."""
    recording = recorded.recording
    rows = part_of(ramp, recording.rows)
    angle = recording.si("input_angle", rows)
    still = np.flatnonzero(np.abs(angle - np.median(angle[:5])) <= _MOVED)
    end = int(still.max(initial=-1)) + 1
    if end < LEAST_ROWS:
        return None
    part = slice(int(FROM * end), int(UNTIL * end))
    time = recording.time(rows)
    torque = ramp.direction * (recording.si(recorded.torque, rows) - recorded.zero)
    times = _medians(time[part] - time[0])
    slope, begin = (float(v) for v in np.polyfit(times, _medians(torque[part]), 1))
    return begin, slope


def _medians(values: FloatArray) -> FloatArray:
    return np.array([float(np.median(block)) for block in np.array_split(values, BLOCKS)])


def _standing(recorded: Recorded) -> Finding:
    """Whether readings stand at one value between the holds, where the torque passes zero, while those of the holds
    have noise."""
    recording, name = recorded.recording, recorded.torque
    step = _step(recorded)
    noise = _noise(recorded)
    if not (step > 0.0 and noise >= step):
        return not_checked("the readings have no noise that a dead band would hide")
    between = [s for s in recording.segments if s.label not in (*OFF, *TURNING)]
    if not between:
        return not_checked("the run has no segment in which the torque passes zero")
    stands = Counter(value for s in between for value in _stands(recording, name, s))
    value, often = (stands.most_common(1) or [(math.nan, 0)])[0]
    least = 1 if value == _read_off(recording, name) else _OFTEN
    return refused_beyond(
        often >= least,
        f"the reading stands {often} times at one value between the holds",
        f"< {least}",
        "the torque channel has a dead band: its noise stops where the torque passes zero",
    )


def _stands(recording: Recording, name: str, segment: Segment) -> Iterator[float]:
    """The values at which the readings of a segment stand."""
    values = recording.stored(name, part_of(segment, recording.rows))
    if len(values) < _STANDING:
        return
    ends = np.append(np.flatnonzero(np.diff(values)), len(values) - 1)
    lengths = np.diff(ends, prepend=-1)
    yield from (float(values[end]) for end in ends[lengths >= _STANDING])


def _read_off(recording: Recording, name: str) -> float:
    """The one reading with the servo off, as stored; NaN where there are several."""
    segments = recording.labelled(ZERO_BEFORE, ZERO_AFTER)
    values = joined([recording.stored(name, segment) for segment in segments])
    if not len(values):
        return math.nan
    levels, counts = np.unique(values, return_counts=True)
    most = int(np.argmax(counts))
    return float(levels[most]) if counts[most] >= _CONSTANT * len(values) else math.nan


def _samples(recorded: Recorded) -> list[FloatArray]:
    """Readings of the holds, as stored."""
    recording = recorded.recording
    parts = [part_of(h.segment, recording.rows) for h in recorded.holds]
    rows = [slice(p.start, min(p.stop, p.start + LOOKED_AT)) for p in parts]
    return [np.asarray(recording.stored(recorded.torque, r), dtype=np.float64) for r in rows]


def _step(recorded: Recorded) -> float:
    """The step from one value of the readings to the next, as stored; 0 where there are no two."""
    levels = np.unique(joined(_samples(recorded)))
    return float(np.median(np.diff(levels))) if len(levels) > 1 else 0.0


def _noise(recorded: Recorded) -> float:
    """Noise of single readings of the holds, as stored."""
    parts = [np.diff(s) for s in _samples(recorded)]
    steps = np.concatenate(parts) if parts else np.zeros(1)
    return float(
        np.sqrt(np.mean(np.minimum(np.abs(steps), np.percentile(np.abs(steps), 95.0)) ** 2))
    ) / math.sqrt(2.0)


def steps_of_the_port(recorded: Recorded) -> Finding:
    """The step of the readings against the torque, where noise does not carry them from one to the next."""
    if not (recorded.torque and recorded.holds):
        return not_checked("a torque over segments that count is needed")
    torques = [abs(h.torque) for h in recorded.holds if math.isfinite(h.torque)]
    samples = [s for s in _samples(recorded) if len(s) > 1]
    if not (torques and samples):
        return not_checked("a torque over segments that count is needed")
    step = _step(recorded) * abs(recorded.recording.signals[recorded.torque].gain)
    equal = float(np.mean(np.concatenate([np.diff(s) == 0.0 for s in samples])))
    allowed = STEP_SHARE * float(np.median(torques))
    return refused_beyond(
        step > allowed and equal > _UNDITHERED,
        f"steps of {1e3 * step:.2g} mN m, {100.0 * equal:.0f} % of the readings as the one before",
        f"<= {1e3 * allowed:.2g} mN m",
        "the torque channel reads in steps that are no small part of the torque",
    )
