"""Checks of the motion: speed against set-point, both encoders against the ratio, skew between them."""

from __future__ import annotations

import math

from experiments.evidence import rotary_ratio
from experiments.evidence.holds import Hold, Recorded
from experiments.evidence.outcomes import not_checked, refused_beyond
from experiments.evidence.skew import skew_of_encoders
from experiments.finding import Finding
from model.identify.skew import SPEED_SPAN

_SPEED_TOLERANCE = 0.02
"""Relative difference of mean speed and set-point: a speed loop holds its mean to less than a part in a hundred."""
_RIPPLE_AT_AN_END = 0.05
"""rad of the input by which ripple over its revolution changes the travel of a segment: a part of a turn does not
average it out. It is that of a speed that ripples by 5 % once per revolution."""
_COUNTS_AT_AN_END = 2.0
"""Counts by which travel may differ because of where a segment begins and ends."""
_RATIO_TOLERANCE = 0.25
"""In units of one tooth pair: N and N + 1 (the other spline fixed) lie one apart."""
_RATIO_NEEDED = 0.75
"""Tooth pairs of doubt from which on the travel is too short to tell."""
_ANGLE_AT_AN_END = 1e-4
"""rad of the output by which errors of the encoder and wind-up change the travel of one segment between the means
over its first and its last revolution."""
_ANGLE_AT_AN_END_OF_ALL = 5e-4
"""The same from row to row, with all of the kinematic error, and where anything may have happened in between: wound
up one way at one end, the other way at the other."""
LARGEST_SKEW = 1.25
"""SYNC periods: what is latched at the same SYNC is not a cycle apart; a quarter for what is not told from wind-up."""


def speed_against_set_point(recorded: Recorded) -> Finding:
    """Mean speed of every segment that turns against what it was set to."""
    set_to_speed = [h for h in recorded.turning if h.segment.setpoint]
    if not set_to_speed:
        return not_checked("the recording has no segments with a set-point of speed")
    worst = max(set_to_speed, key=lambda h: _excess(h, recorded))
    setpoint = worst.segment.setpoint
    doubt = _doubt_of_set_point(setpoint, recorded)
    found = (
        f"{worst.speed:.5g} rad/s at {setpoint:.5g} ({worst.segment.label} {worst.segment.index})"
    )
    return refused_beyond(
        _excess(worst, recorded) > 0.0,
        found,
        f"set-point ± {100.0 * _SPEED_TOLERANCE:g} %" + (f" ± {doubt:.2g} rad/s" if doubt else ""),
        "the measured speed is not the one that was commanded: counts per revolution, time or set-points are wrong",
    )


def _excess(hold: Hold, recorded: Recorded) -> float:
    """Relative difference of speed and set-point beyond what is allowed."""
    setpoint = hold.segment.setpoint
    counts = _COUNTS_AT_AN_END * recorded.recording.signals["input_angle"].quantum
    doubt = (counts + 2.0 * _RIPPLE_AT_AN_END) / abs(setpoint * hold.duration)
    doubt += _doubt_of_set_point(setpoint, recorded) / abs(setpoint)
    return abs(hold.speed / setpoint - 1.0) - _SPEED_TOLERANCE - doubt


def _doubt_of_set_point(setpoint: float, recorded: Recorded) -> float:
    """How far a set-point may be from the number that was written [rad/s], expanded by 2: a voltage has a zero and a
    scale that somebody measured; a number on a bus has neither.
    """
    channel = recorded.recording.signals.get("target_speed")
    if channel is None:
        return 0.0
    own = channel.calibration
    return 2.0 * math.hypot(
        own.offset_uncertainty or 0.0, (own.scale_relative_uncertainty or 0.0) * setpoint
    )


_RATIO_NOT_STATED = (
    "nobody states the ratio, and the encoders show another than the parameter set's: "
    "state it, --ratio at the import"
)


def encoders_against_ratio(recorded: Recorded) -> Finding:
    """Travel of the output times the ratio against travel of the input, over all that turns.

    Where whole revolutions were turned these tell it: a part of one holds the kinematic error of its ends.
    """
    recording = recorded.recording
    whole = [travel for h in recorded.turning if (travel := recorded.travel_of_means(h))]
    rows = [(h.input_travel, h.output_travel) for h in recorded.turning] or recorded.farthest
    turning = [(i, o) for i, o in whole or rows if i and math.isfinite(o)]
    if not turning:
        return not_checked("both encoders over a way that was turned are needed")
    ratio = rotary_ratio(
        recording, recorded.evidence.gear.mounted_ratio(recording.metadata.mounting)
    )
    inner = sum(abs(i) for i, _ in turning)
    outer = sum(math.copysign(1.0, i) * o for i, o in turning)
    # In tooth pairs: one is the difference between the two mountings.
    at_an_end = _ANGLE_AT_AN_END if whole else _ANGLE_AT_AN_END_OF_ALL
    doubt = at_an_end * len(turning) * ratio / (inner / ratio)
    if doubt > _RATIO_NEEDED:
        return not_checked(f"the output turned only {inner / ratio:.2g} rad")
    seen = inner / outer if outer else math.inf
    consequence = _RATIO_NOT_STATED
    if math.isfinite(recording.metadata.ratio):
        consequence = "the encoders show another ratio than the one stated"
    return refused_beyond(
        abs(seen - ratio) > _RATIO_TOLERANCE + doubt,
        f"{seen:.5g} input revolutions per output revolution",
        f"{ratio:g} ± {_RATIO_TOLERANCE + doubt:.2g}",
        consequence,
    )


def skew(recorded: Recorded) -> Finding:
    """How much later the output encoder is latched than the input encoder, in SYNC periods."""
    rate = recorded.recording.metadata.sample_rate
    speeds = [abs(h.speed) for h in recorded.turning]
    if speeds and max(speeds) < SPEED_SPAN * min(speeds):
        return not_checked("one speed only: skew and wind-up are one number")
    estimate = skew_of_encoders(recorded.recording, recorded.evidence.gear)
    if estimate is None or not math.isfinite(estimate.value):
        why = estimate.note if estimate else "there is no time stamp of each cycle"
        return not_checked(why)
    certain = max(abs(estimate.value) - estimate.expanded_uncertainty, 0.0) * rate
    return refused_beyond(
        certain > LARGEST_SKEW,
        f"{1e6 * estimate.value:.0f} ± {1e6 * estimate.expanded_uncertainty:.0f} us",
        f"{LARGEST_SKEW:g} cycles of {1e6 / rate:.0f} us",
        "the two angles are not of the same cycle",
    )
