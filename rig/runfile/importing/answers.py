"""What follows from answers: the unit of one column from that of another, ratio and sense, and which questions stay."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from model.units import COUNT, RPM
from rig.errors import ConfigurationError
from rig.runfile.importing.proposed import (
    ANGLES,
    BY_FILE,
    COUNTS,
    EFFORTS,
    SPEEDS,
    Proposal,
    ProposedColumn,
    Question,
)
from rig.runfile.importing.units import TIME_CHANNEL, dimensions_of, unit_of

_WHOLE = 0.004
"""How near to a whole number a ratio of two angles is one."""
_FITS = 0.01
"""How near a slope must come to that of two units."""
_PAIR_UNITS: tuple[tuple[str, str, float], ...] = (
    ("rad", "rad/s", 1.0),
    ("deg", "r/min", 6.0),
    ("rad", "r/min", RPM),
    ("rad", "deg/s", math.pi / 180.0),
    ("deg", "rad/s", 180.0 / math.pi),
    ("rev", "r/min", 1.0 / 60.0),
)
"""Units of an angle and a speed, and how many of the first a second at one of the other is. A slope of one leaves the
unit itself open: rad and rad/s, deg and deg/s are alike.
"""


def answered(proposal: Proposal, question: Question, answer: str) -> Proposal:
    """The proposal with one answer taken over. Raises `ConfigurationError` for one that is not to be understood."""
    answer = answer.strip()
    rest = tuple(one for one in proposal.questions if one is not question)
    made = replace(proposal, questions=rest)
    if question.why == "which":
        if answer not in question.usual:
            raise _not_one_of(question, answer)
        if answer == question.about:
            return made
        columns = tuple(only(proposal.columns, answer))
        # What the numbers told was of the other one.
        return settle(replace(made, columns=columns, slopes={}, slope_of_angles=math.nan))
    if question.why == "channel":
        if answer not in question.usual:
            raise _not_one_of(question, answer)
        asked = dict.fromkeys(question.usual, "") | {answer: question.about}
        columns = [
            replace(one, channel=asked.get(one.heading, one.channel)) for one in proposal.columns
        ]
        return settle(replace(made, columns=tuple(columns)))
    if question.why == "unit":
        if not answer:
            return settle(replace(made, columns=_without(proposal.columns, question.about)))
        channel = _channel_in(question, answer)
        columns_now = _with_unit(proposal.columns, question.about, answer, channel)
        return settle(replace(made, columns=columns_now))
    number = _positive(question, answer)
    if question.why == "rate":
        return replace(made, rate=number)
    return settle(replace(made, counts={**proposal.counts, question.about: number}))


def corrected(proposal: Proposal, key: str, channel: str, unit: str) -> Proposal:
    """The proposal in which somebody says what one column is; "" leaves it out, and frees its channel for another.

    Raises `ConfigurationError` for a unit that the channel cannot have.
    """
    if channel and unit:
        read, allowed = unit_of(unit, channel, dimensions_of(channel) or ()), dimensions_of(channel)
        if allowed and read.si not in allowed and read.symbol != COUNT:
            limit = ", ".join(_usual(channel))
            raise ConfigurationError("is no unit of it", where=channel, value=unit, limit=limit)

    def said(one: ProposedColumn) -> ProposedColumn:
        if one.key == key:
            return replace(one, channel=channel, unit=unit, evidence=(*one.evidence, "as said"))
        return one.freed_of(channel)

    columns = tuple(map(said, proposal.columns))
    known = {one.channel for one in columns if one.channel}
    # A question about what is left out, or which of several it is, has had its answer.
    rest = (one for one in proposal.questions if one.why not in ("channel", "which"))
    questions = tuple(q for q in rest if q.why != "rate" or TIME_CHANNEL not in known)
    # What the numbers told was of the columns as they were.
    return settle(
        replace(proposal, columns=columns, questions=questions, slopes={}, slope_of_angles=math.nan)
    )


def only(columns: Sequence[ProposedColumn], member: str) -> list[ProposedColumn]:
    """The columns with the channels of one member, and those that belong to all."""
    several = {one.meant for one in columns if one.member == member and one.meant}

    def chosen(one: ProposedColumn) -> ProposedColumn:
        if one.meant not in several:
            return one
        return replace(one, channel=one.meant if one.member == member else "")

    return [chosen(one) for one in columns]


def settle(proposal: Proposal) -> Proposal:
    """What follows from what is known by now: units of pairs, ratio and sense, and which questions stay."""
    columns = _with_units(proposal.columns, proposal.slopes)
    used = [one for one in columns if one.channel]
    questions = [one for one in proposal.questions if one.why not in ("unit", COUNTS)]
    for one in used:
        if not one.unit and BY_FILE not in one.evidence:
            text = f"unit of {one.heading} ({one.channel})"
            questions.append(Question("unit", one.channel, text, _usual(one.channel)))
        elif one.is_counted and one.channel in ANGLES and one.channel not in proposal.counts:
            text = f"counts per revolution of {one.heading}"
            questions.append(Question(COUNTS, one.channel, text))
    ratio, sense = _proportion(used, proposal.slope_of_angles)
    return replace(
        proposal, columns=columns, questions=tuple(questions), ratio=ratio, output_sense=sense
    )


def _with_units(
    columns: Sequence[ProposedColumn], slopes: Mapping[str, float]
) -> tuple[ProposedColumn, ...]:
    """Units that follow from an angle and its speed: of one where the other is known, or where one pair alone fits."""
    by_channel = {one.channel: one for one in columns if one.channel}
    found: dict[str, ProposedColumn] = {}
    for angle_name, slope in slopes.items():
        angle = by_channel.get(angle_name)
        speed = by_channel.get(SPEEDS[ANGLES.index(angle_name)])
        # One of them may have been left out since.
        if angle is None or speed is None or (angle.unit and speed.unit):
            continue
        units = _pair(angle.unit, speed.unit, slope)
        if units is None:
            continue
        words = f"{slope:.4g} of {angle.heading} a second at 1 of {speed.heading}"
        for one, unit in ((angle, units[0]), (speed, units[1])):
            if not one.unit:
                found[one.key] = replace(one, unit=unit, evidence=(*one.evidence, words))
    return tuple(found.get(one.key, one) for one in columns)


def _pair(angle: str, speed: str, slope: float) -> tuple[str, str] | None:
    """Units of an angle and a speed by how many of the first a second at one of the other is; None: it stays open."""
    fitting = [
        (a, s)
        for a, s, expected in (*_PAIR_UNITS, ("deg", "deg/s", 1.0))
        if abs(slope / expected - 1.0) < _FITS
        and (not angle or _same(a, angle))
        and (not speed or _same(s, speed))
    ]
    return fitting[0] if len(fitting) == 1 else None


def _same(one: str, other: str) -> bool:
    return unit_of(one, "").scale == unit_of(other, "").scale


def factor(column: ProposedColumn) -> float | None:
    """SI of one of a column's own; None where its unit is open or needs more than itself."""
    if not column.unit:
        return None
    return unit_of(column.unit, column.channel, dimensions_of(column.channel) or ()).scale


def _proportion(used: Sequence[ProposedColumn], slope: float) -> tuple[float, int]:
    """The ratio of input to output where the slope makes it a whole number; and the sense of the output."""
    by_channel = {one.channel: one for one in used}
    first, second = (by_channel.get(angle) for angle in ("input_angle", "output_angle"))
    if not math.isfinite(slope) or first is None or second is None:
        return math.nan, 0
    sense = int(math.copysign(1.0, slope))
    scales = (factor(first), factor(second))
    if scales[0] is None or scales[1] is None or first.is_counted or second.is_counted:
        return math.nan, sense
    ratio = abs(scales[0] / (slope * scales[1]))
    whole = round(ratio)
    # Half a tooth is the nearest that another gear comes.
    is_whole = whole >= 2 and abs(ratio - whole) < _WHOLE * whole and abs(ratio - whole) < 0.25
    return (float(whole) if is_whole else math.nan), sense


def _usual(channel: str) -> tuple[str, ...]:
    """The units that people write for a channel."""
    if channel == TIME_CHANNEL:
        return ("s", "ms", "us", "ns")
    if channel in ANGLES:
        return ("rad", "deg", "rev", "count")
    if channel in SPEEDS:
        return ("rad/s", "deg/s", "r/min")
    if channel.endswith("temperature"):
        return ("degC",)
    if channel in EFFORTS:
        return tuple(dict.fromkeys((*(dimensions_of(channel) or ()), *_EFFORT_IN)))
    return dimensions_of(channel) or ()


_EFFORT_IN = {"N m": "torque", "A": "current", "V": "voltage", "N": "force"}
"""What an effort is, by the SI unit that somebody says of it."""


def _channel_in(question: Question, unit: str) -> str:
    """The channel of a column whose unit is this: an effort in A is a current. Raises `ConfigurationError`."""
    channel = question.about
    allowed = dimensions_of(channel) or ()
    if channel in EFFORTS:
        allowed = tuple(_EFFORT_IN)
    read = unit_of(unit, question.text, allowed)
    if allowed and read.si not in allowed and read.symbol != COUNT:
        raise ConfigurationError(
            "is no unit of it", where=question.text, value=unit, limit=", ".join(question.usual)
        )
    if channel in EFFORTS and read.si not in (dimensions_of(channel) or ()):
        return _EFFORT_IN.get(read.si, channel)
    return channel


def _with_unit(
    columns: Sequence[ProposedColumn], channel: str, unit: str, now: str
) -> tuple[ProposedColumn, ...]:
    return _replaced(columns, channel, "unit as answered", channel=now, unit=unit)


def _without(columns: Sequence[ProposedColumn], channel: str) -> tuple[ProposedColumn, ...]:
    return _replaced(columns, channel, "left out: nobody knows its unit", channel="")


def _replaced(
    columns: Sequence[ProposedColumn], of: str, evidence: str, **values: str
) -> tuple[ProposedColumn, ...]:
    """The columns with new values in those of one channel, and why."""
    return tuple(
        one if one.channel != of else replace(one, **values, evidence=(*one.evidence, evidence))
        for one in columns
    )


def _not_one_of(question: Question, answer: str) -> ConfigurationError:
    limit = ", ".join(question.usual)
    return ConfigurationError("is none of them", where=question.text, value=answer, limit=limit)


def _positive(question: Question, answer: str) -> float:
    try:
        number = float(answer)
    except ValueError:
        number = math.nan
    if not 0.0 < number < math.inf:
        raise ConfigurationError(
            "is no number above 0", where=question.text, value=repr(answer), limit="> 0"
        )
    return number
