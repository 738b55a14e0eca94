"""Which analyses a recording is good for, as far as its channels, its time base and its labels tell."""

from __future__ import annotations

import math
from dataclasses import dataclass

from experiments import catalogue
from experiments.recordings.channels import ANGLES, EFFORTS
from rig.runfile.importing.channel_map import ImportOptions
from rig.runfile.importing.looking import Look

SPEEDS = ("speed", "input_speed", "output_speed")
MEASURED = "any other channel"


@dataclass(frozen=True, kw_only=True)
class Need:
    """What an analysis asks of a recording.

    `channels` is a list of alternatives, of each of which one must be there; `labels` are the
    segments that it looks for; `gear_off` where the motor must have run alone; `revolutions` where
    a length in metres is no angle.
    """

    channels: tuple[tuple[str, ...], ...]
    time: bool = True
    ratio: bool = False
    labels: tuple[str, ...] = ()
    gear_off: bool = False
    revolutions: bool = False


_BOTH = (("input_angle",), ("output_angle",))
_TORQUES = ("torque", "drive_torque")
NEEDS = {
    "motion": Need(channels=((*ANGLES, *SPEEDS), EFFORTS)),
    "order-spectrum": Need(channels=(ANGLES, (MEASURED,)), revolutions=True),
    "revolution": Need(channels=(ANGLES, (MEASURED,)), time=False, revolutions=True),
    "friction-curve": Need(channels=(SPEEDS, EFFORTS), time=False),
    "skew": Need(channels=((*ANGLES, *SPEEDS, *EFFORTS), (MEASURED,))),
    "hysteresis": Need(channels=(ANGLES, ("output_torque", *_TORQUES))),
    "friction": Need(channels=(("input_angle",), (*_TORQUES, "current"))),
    "kinematic-error": Need(channels=_BOTH, ratio=True),
    "velocity-steps": Need(channels=_BOTH, ratio=True, labels=("step",)),
    "warm-up": Need(channels=(("input_angle",), _TORQUES), labels=("warm-up",)),
    "starting-torque": Need(channels=(("input_angle",), _TORQUES), labels=("torque-ramp",)),
    "motor-tare": Need(channels=(("input_angle",), _TORQUES), labels=("hold",), gear_off=True),
    "home": Need(channels=_BOTH, ratio=True, labels=("home-input", "home-output")),
}
"""What each analysis asks for."""


def reach_of(look: Look, options: ImportOptions) -> dict[str, str]:
    """Each kind of analysis with "" where the recording may be good for it, else why it is not."""
    return {
        kind: _why_not(need, look, options)
        for kind, need in NEEDS.items()
        if kind in catalogue.kinds()
    }


def _why_not(need: Need, look: Look, options: ImportOptions) -> str:
    names = [channel.name for channel in look.channels]
    for alternatives in need.channels:
        if alternatives == (MEASURED,):
            lacks = len(names) < 2
        else:
            lacks = not any(name in names for name in alternatives)
        if lacks:
            return f"no channel {' or '.join(alternatives)}"
    if need.time and options.no_time:
        return "no time base"
    known = options.gear is not None or math.isfinite(options.ratio)
    if need.ratio and not known:
        return "no ratio (--ratio)"
    if need.ratio and not options.output_sense:
        return "nobody says the sense of the output angle (--output-sense)"
    if need.gear_off and options.gear_mounted:
        return "the gear was not taken off (--no-gear)"
    labels = {segment.label for segment in options.segments}
    if options.segments_from is not None:
        labels |= {*options.segments_from.labels.values(), options.segments_from.label}
    if need.labels and not labels & set(need.labels):
        return f"no segment labelled {' or '.join(need.labels)}"
    angles = [c for c in look.channels if c.name in ANGLES]
    if need.revolutions and not any(c.unit == "rad" for c in angles):
        return "no channel that is an angle"
    wrapped = [c.name for c in look.channels if c.wraps]
    if wrapped:
        return f"{wrapped[0]} jumps as if it were wrapped (--modulus)"
    return ""
