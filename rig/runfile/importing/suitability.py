"""Which analyses a recording is good for, as far as its channels, its time base and its labels tell."""

from __future__ import annotations

import math

from experiments import catalogue
from experiments.need import MEASURED, TURNING, Need
from rig.runfile.importing.channel_map import ImportOptions
from rig.runfile.importing.looking import Look


def unsuited_for(look: Look, options: ImportOptions) -> dict[str, str]:
    """Each kind of analysis with "" where the recording may be good for it, else why not; none without a channel."""
    if not look.channels:
        return {}
    return {one.name: _why_not(one.foreign_need, look, options) for one in catalogue.every()}


def is_of_tables(kind: str) -> bool:
    """Whether recordings of this kind are tables, which have no time base; False for a kind that is none."""
    experiment = catalogue.declared(kind)
    return experiment is not None and experiment.foreign_need.is_table


def _why_not(need: Need, look: Look, options: ImportOptions) -> str:
    return _no_channel(need, look) or _not_said(need, options) or _no_angle(need, look)


def _no_channel(need: Need, look: Look) -> str:
    names = {channel.name for channel in look.channels}
    for alternatives in need.channels:
        is_there = bool(names & set(alternatives))
        if alternatives == MEASURED:
            is_there = len(look.channels) > 1
        if not is_there:
            return f"no channel {' or '.join(alternatives)}"
    return ""


def _not_said(need: Need, options: ImportOptions) -> str:
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
    return ""


def _no_angle(need: Need, look: Look) -> str:
    angles = [c for c in look.channels if c.name in TURNING]
    if need.revolutions and not any(c.unit == "rad" for c in angles):
        return "no channel that is an angle"
    wrapped = [c.name for c in look.channels if c.wraps]
    if wrapped:
        return f"{wrapped[0]} jumps as if it were wrapped (--modulus)"
    return ""
