"""What the columns of a file are, as far as headings and numbers tell: with its evidence, and with what stays open.

Nothing is decided here: a person, or a script that says so, accepts it. What has no evidence is a question.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from model.units import COUNT, RPM
from rig.errors import ConfigurationError, RunFileError
from rig.runfile.importing.adapters.table import Table
from rig.runfile.importing.channel_source import ChannelSource
from rig.runfile.importing.heading_words import Heading, read_heading
from rig.runfile.importing.units import TIME_CHANNEL, dimensions_of, unit_of

LOOKED_AT = 100_000
"""Rows from the beginning that the numbers are judged by."""
_LEAST_ROWS = 20
_EVEN = 0.2
"""Relative scatter of the steps of an even time (median absolute deviation over median)."""
_SAME = 0.98
"""Correlation from which on a column is the derivative of another, or an angle in proportion to another."""
_WHOLE = 0.004
"""How near to a whole number a ratio of two angles is one."""
_SIGN = 0.8
"""Share of moving rows in which an effort has the sign of the speed."""
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
ANGLES = ("input_angle", "output_angle", "position")
SPEEDS = ("input_speed", "output_speed", "speed")
EFFORTS = ("torque", "output_torque", "current", "motor_current", "force", "voltage")
_TEXT, _BY_FILE = "no numbers", "the file says so"
Why = Literal["unit", "counts per revolution", "channel", "rate", "which"]
_COUNTS: Final = "counts per revolution"


@dataclass(frozen=True, kw_only=True)
class ProposedColumn:
    """One column: its heading, the channel that it becomes ("" for one that is left out), its unit, and why.

    `meant` is the channel that it would be, were it not left out for another; `member` the joint or axis of several.
    """

    reference: str
    heading: str
    channel: str = ""
    meant: str = ""
    unit: str = ""
    member: str = ""
    file: str = ""
    evidence: tuple[str, ...] = ()


@dataclass(frozen=True)
class Question:
    """Something that stays open: what it asks of which column, and the answers that are usual."""

    why: Why
    about: str
    text: str
    usual: tuple[str, ...] = ()


@dataclass(frozen=True)
class Proposal:
    """Columns, what the numbers say of the gear, and the questions that stay; `rate` [Hz] 0 where times are there."""

    columns: tuple[ProposedColumn, ...]
    questions: tuple[Question, ...]
    ratio: float = math.nan
    output_sense: int = 0
    is_table: bool = False
    notes: tuple[str, ...] = ()
    counts: Mapping[str, float] = field(default_factory=dict)
    """Counts per revolution by channel, as somebody answered."""
    slopes: Mapping[str, float] = field(default_factory=dict)
    """By the angle's channel: how many of it go by in a second at 1 of its speed, where this is its derivative."""
    slope_of_angles: float = math.nan
    """Output angle over input angle, in the columns' own numbers."""
    rate: float = 0.0
    """Hz, as somebody answered."""

    @property
    def used(self) -> tuple[ProposedColumn, ...]:
        """The columns that become channels."""
        return tuple(column for column in self.columns if column.channel)

    @property
    def sources(self) -> tuple[ChannelSource, ...]:
        """The channels, as an import takes them."""
        return tuple(
            ChannelSource(
                name=one.channel,
                column=one.reference,
                unit=one.unit,
                file=one.file,
                scale=self.counts.get(one.channel),
            )
            for one in self.used
        )

    @property
    def sentences(self) -> tuple[str, ...]:
        """What is proposed and why, one line a channel."""
        lines = [
            f"{one.channel} = {one.heading} [{one.unit or '?'}]: {'; '.join(one.evidence)}"
            for one in self.used
        ]
        if self.output_sense:
            way = "with" if self.output_sense > 0 else "against"
            turns = f", ratio {self.ratio:g}" if math.isfinite(self.ratio) else ""
            lines.append(
                f"the output angle counts {way} the input angle{turns}: both in proportion"
            )
        return tuple(lines)


def propose(tables: Sequence[Table]) -> Proposal:
    """What the columns of the files of one run are. Raises `RunFileError` for a file that cannot be read."""
    columns: list[ProposedColumn] = []
    numbers: dict[str, NDArray[np.float64]] = {}
    for index, table in enumerate(tables):
        values = _head(table)
        several = len(tables) > 1
        for at in range(len(table.headings)):
            column = _by_heading(table, at, values[:, at])
            if several:
                column = replace(column, file=str(index + 1))
            columns.append(column)
            numbers[_key(column)] = values[:, at]
    columns = _times(columns, numbers, tables)
    columns = [replace(one, meant=one.channel) for one in _by_numbers(columns, numbers)]
    chosen, asked = _one_of_several(columns, numbers)
    return _concluded(chosen, numbers, asked, tables)


def _key(column: ProposedColumn) -> str:
    return f"{column.reference}@{column.file}"


def _head(table: Table) -> NDArray[np.float64]:
    """The first rows of all columns (n, columns); what is no number, or of another length than most, is NaN."""
    try:
        return _rows(table, range(len(table.headings)))
    except RunFileError:
        alone = [_rows(table, [at])[:, 0] for at in range(len(table.headings))]
    rows = Counter(len(one) for one in alone).most_common(1)[0][0]
    return np.column_stack([one if len(one) == rows else np.full(rows, np.nan) for one in alone])


def _rows(table: Table, columns: Sequence[int]) -> NDArray[np.float64]:
    parts: list[NDArray[np.float64]] = []
    rows = 0
    for batch in table.batches(columns):
        parts.append(batch.values)
        rows += len(batch.values)
        if rows >= LOOKED_AT:
            break
    return np.concatenate(parts) if parts else np.zeros((0, len(columns)))


def _by_heading(table: Table, at: int, values: NDArray[np.float64]) -> ProposedColumn:
    heading = table.headings[at]
    said: Heading = read_heading(heading, table.path.stem)
    is_once = Counter(table.headings)[heading] == 1
    plain = is_once and heading.strip() and not set(heading) & set("=:@[](),")
    reference = heading if plain and not heading.strip().isdigit() else str(at + 1)
    unit = said.unit or (table.units[at] if at < len(table.units) else "")
    is_numeric = len(values) > 0 and np.isfinite(values).mean() > 0.5
    shown = heading.strip() or f"column {at + 1}"
    if not is_numeric:
        return ProposedColumn(reference=reference, heading=shown, evidence=(_TEXT,))
    evidence = (said.why,) if said.channel else ()
    return ProposedColumn(
        reference=reference,
        heading=shown,
        channel=said.channel,
        unit=unit,
        member=said.member,
        evidence=(*evidence, *((f"unit {unit} as written",) if unit else ())),
    )


def _times(
    columns: list[ProposedColumn],
    numbers: Mapping[str, NDArray[np.float64]],
    tables: Sequence[Table],
) -> list[ProposedColumn]:
    """One column of time: the one that the file names, else one that rises evenly; others are left out."""
    named = {
        (table.headings[time].strip(), str(index + 1) if len(tables) > 1 else "")
        for index, table in enumerate(tables)
        for time in table.times
        if time is not None
    }
    rising = [one for one in columns if _rises(numbers[_key(one)])]
    by_file = [one for one in columns if (one.heading, one.file) in named]
    by_word = [
        one for one in columns if one.channel == TIME_CHANNEL and _never_falls(numbers[_key(one)])
    ]
    nameless = [one for one in rising if not one.channel and not one.unit]
    chosen = next(iter((*by_file, *by_word, *nameless)), None)
    made = []
    for one in columns:
        if one is chosen and one in by_file:
            evidence = (*(word for word in one.evidence if word != _TEXT), _BY_FILE)
            one = replace(one, channel=TIME_CHANNEL, evidence=evidence)
        elif one is chosen:
            step = float(np.median(np.diff(numbers[_key(one)])))
            evidence = (*one.evidence, f"rises by {step:.4g} from row to row")
            one = replace(one, channel=TIME_CHANNEL, evidence=evidence)
            if not one.unit and 1e-5 <= step <= 0.2:
                one = replace(one, unit="s", evidence=(*evidence, "a step that is usual in s"))
        elif one.channel == TIME_CHANNEL:
            one = replace(one, channel="", evidence=(*one.evidence, "not the time of the others"))
        made.append(one)
    return made


def _never_falls(values: NDArray[np.float64]) -> bool:
    """Whether a column that is called a time can be one."""
    return (
        len(values) > 1 and bool(np.isfinite(values).all()) and float(np.diff(values).min()) >= 0.0
    )


def _rises(values: NDArray[np.float64]) -> bool:
    """Whether a column is a time: it only rises, and mostly by the same."""
    if len(values) < _LEAST_ROWS or not np.isfinite(values).all():
        return False
    steps = np.diff(values)
    middle = float(np.median(steps))
    if middle <= 0.0 or steps.min() < 0.0:
        return False
    return float(np.median(np.abs(steps - middle))) <= _EVEN * middle


def _by_numbers(
    columns: list[ProposedColumn], numbers: Mapping[str, NDArray[np.float64]]
) -> list[ProposedColumn]:
    """Angle, speed and effort of columns whose headings say nothing: by derivative, and by the sign of the speed."""
    time = next((numbers[_key(one)] for one in columns if one.channel == TIME_CHANNEL), None)
    if any(one.channel in (*ANGLES, *SPEEDS, *EFFORTS) for one in columns) or time is None:
        return columns
    free = [one for one in columns if not one.channel and _TEXT not in one.evidence]
    found: dict[str, ProposedColumn] = {}
    pairs = [
        (r, a, b)
        for a in free
        for b in free
        if a is not b and (r := _derivative(numbers[_key(a)], numbers[_key(b)], time)[0]) > _SAME
    ]
    pairs.sort(key=lambda pair: -float(np.nanstd(numbers[_key(pair[1])])))
    taken: set[str] = set()
    for r, angle, speed in pairs:
        if {_key(angle), _key(speed)} & taken:
            continue
        taken |= {_key(angle), _key(speed)}
        member = angle.reference
        words = f"{speed.heading} is its derivative (r = {r:.3f})"
        found[_key(angle)] = replace(
            angle, channel="position", member=member, evidence=(*angle.evidence, words)
        )
        words = f"the derivative of {angle.heading} (r = {r:.3f})"
        found[_key(speed)] = replace(
            speed, channel="speed", member=member, evidence=(*speed.evidence, words)
        )
        effort = _effort(free, numbers, numbers[_key(speed)], taken)
        if effort is not None:
            share, column = effort
            taken.add(_key(column))
            words = f"has the sign of {speed.heading} in {100.0 * share:.0f} % of the moving rows"
            found[_key(column)] = replace(
                column, channel="torque", member=member, evidence=(*column.evidence, words)
            )
    return [found.get(_key(one), one) for one in columns]


def _derivative(
    angle: NDArray[np.float64], speed: NDArray[np.float64], time: NDArray[np.float64]
) -> tuple[float, float]:
    """Correlation of the derivative of one column with another, and the slope; (0, 0) where nothing moves."""
    n = min(len(angle), len(speed), len(time))
    good = np.isfinite(angle[:n]) & np.isfinite(speed[:n]) & np.isfinite(time[:n])
    a, s, t = angle[:n][good], speed[:n][good], time[:n][good]
    if len(a) < _LEAST_ROWS or np.ptp(a) == 0.0 or np.ptp(s) == 0.0:
        return 0.0, 0.0
    # Over stretches, so that the resolution of the angle does not drown it.
    stride = max(1, len(a) // 2000)
    rows = np.arange(0, len(a) - 4 * stride, stride)
    rate = (a[rows + 4 * stride] - a[rows]) / np.maximum(t[rows + 4 * stride] - t[rows], 1e-300)
    cumulated = np.concatenate(([0.0], np.cumsum(s)))
    mean = (cumulated[rows + 4 * stride] - cumulated[rows]) / (4 * stride)
    if np.ptp(rate) == 0.0 or np.ptp(mean) == 0.0:
        return 0.0, 0.0
    return float(np.corrcoef(rate, mean)[0, 1]), float(rate @ mean / (mean @ mean))


def _effort(
    free: Sequence[ProposedColumn],
    numbers: Mapping[str, NDArray[np.float64]],
    speed: NDArray[np.float64],
    taken: set[str],
) -> tuple[float, ProposedColumn] | None:
    """The column that has the sign of the speed where it moves, with how often; None where none has it often enough."""
    moving = np.abs(speed) > 0.1 * np.nanmax(np.abs(speed))
    found: list[tuple[float, ProposedColumn]] = []
    for one in free:
        values = numbers[_key(one)]
        if _key(one) in taken or len(values) != len(speed) or np.nanstd(values) == 0.0:
            continue
        share = float(np.mean(np.sign(values[moving]) == np.sign(speed[moving])))
        if share >= _SIGN:
            found.append((share, one))
    return max(found, key=lambda pair: pair[0], default=None)


def _one_of_several(
    columns: list[ProposedColumn], numbers: Mapping[str, NDArray[np.float64]]
) -> tuple[list[ProposedColumn], list[Question]]:
    """Of joints and axes the one that moves most; the others are left out, and which one it is, is asked for."""
    counts = Counter(one.channel for one in columns if one.channel)
    if all(count == 1 for count in counts.values()):
        return columns, []
    repeated = {channel for channel, count in counts.items() if count > 1}
    members = list(
        dict.fromkeys(one.member for one in columns if one.channel in repeated and one.member)
    )
    if not members:
        return _first_of_each(columns, repeated)
    moving = [one for one in columns if one.channel in (*ANGLES, *SPEEDS)]

    def moved(member: str) -> float:
        of_it = (np.nanstd(numbers[_key(one)]) for one in moving if one.member == member)
        return max(map(float, of_it), default=0.0)

    chosen = max(members, key=moved)
    question = Question("which", chosen, f"which of {', '.join(members)}", tuple(members))
    return only(columns, chosen), [question]


def only(columns: Sequence[ProposedColumn], member: str) -> list[ProposedColumn]:
    """The columns with the channels of one member, and those that belong to all."""
    several = {one.meant for one in columns if one.member == member and one.meant}
    return [
        replace(one, channel=one.meant if one.member == member else "")
        if one.meant in several
        else one
        for one in columns
    ]


def _first_of_each(
    columns: list[ProposedColumn], repeated: set[str]
) -> tuple[list[ProposedColumn], list[Question]]:
    """Two columns of one name and no number: it is asked which; the first until then."""
    made, seen, questions = [], set[str](), []
    for one in columns:
        if one.channel in repeated and one.channel in seen:
            one = replace(one, channel="")
        elif one.channel in repeated:
            seen.add(one.channel)
            alike = tuple(o.heading for o in columns if o.channel == one.channel)
            text = f"which column is {one.channel}"
            questions.append(Question("channel", one.channel, text, alike))
        made.append(one)
    return made, questions


def _slopes(
    columns: Sequence[ProposedColumn], numbers: Mapping[str, NDArray[np.float64]]
) -> dict[str, float]:
    """By each angle whose speed is there as well: its derivative over the speed, where the two go together."""
    by_channel = {one.channel: one for one in columns if one.channel}
    time = by_channel.get(TIME_CHANNEL)
    found: dict[str, float] = {}
    for angle_name, speed_name in zip(ANGLES, SPEEDS, strict=True):
        angle, speed = by_channel.get(angle_name), by_channel.get(speed_name)
        if angle is None or speed is None or time is None or not time.unit:
            continue
        seconds = numbers[_key(time)] * (_factor(time) or math.nan)
        r, slope = _derivative(numbers[_key(angle)], numbers[_key(speed)], seconds)
        if abs(r) >= _SAME and math.isfinite(slope):
            found[angle_name] = slope
    return found


def _with_units(
    columns: Sequence[ProposedColumn], slopes: Mapping[str, float]
) -> tuple[ProposedColumn, ...]:
    """Units that follow from an angle and its speed: of one where the other is known, or where one pair alone fits."""
    by_channel = {one.channel: one for one in columns if one.channel}
    found: dict[str, ProposedColumn] = {}
    for angle_name, slope in slopes.items():
        angle = by_channel[angle_name]
        speed = by_channel[SPEEDS[ANGLES.index(angle_name)]]
        units = None if angle.unit and speed.unit else _pair(angle.unit, speed.unit, slope)
        if units is None:
            continue
        words = f"{slope:.4g} of {angle.heading} a second at 1 of {speed.heading}"
        for one, unit in ((angle, units[0]), (speed, units[1])):
            if not one.unit:
                found[_key(one)] = replace(one, unit=unit, evidence=(*one.evidence, words))
    return tuple(found.get(_key(one), one) for one in columns)


def _pair(angle: str, speed: str, slope: float) -> tuple[str, str] | None:
    """Units of an angle and a speed by how many of the first a second at one of the other is; None: it stays open."""
    fitting = [
        (a, s)
        for a, s, expected in (*_PAIR_UNITS, ("deg", "deg/s", 1.0))
        if abs(slope / expected - 1.0) < 0.03
        and (not angle or _same(a, angle))
        and (not speed or _same(s, speed))
    ]
    return fitting[0] if len(fitting) == 1 else None


def _same(one: str, other: str) -> bool:
    return unit_of(one, "").scale == unit_of(other, "").scale


def _factor(column: ProposedColumn) -> float | None:
    """SI of one of a column's own; None where its unit is open or needs more than itself."""
    if not column.unit:
        return None
    return unit_of(column.unit, column.channel, dimensions_of(column.channel) or ()).scale


def _concluded(
    columns: list[ProposedColumn],
    numbers: Mapping[str, NDArray[np.float64]],
    asked: list[Question],
    tables: Sequence[Table],
) -> Proposal:
    """The proposal with what the numbers tell of pairs of columns, and its questions."""
    slopes = _slopes(columns, numbers)
    used = [one for one in columns if one.channel]
    has_time = any(one.channel == TIME_CHANNEL for one in used) or any(t.period for t in tables)
    is_table = _is_table(used) and not any(map(_is_called_time, columns))
    if not has_time and not is_table and used:
        asked = [*asked, Question("rate", "", "sample rate in Hz")]
    made = Proposal(
        tuple(columns),
        tuple(asked),
        is_table=is_table,
        slopes=slopes,
        slope_of_angles=_slope_of_angles(used, numbers),
    )
    return _settled(made)


def _is_called_time(column: ProposedColumn) -> bool:
    return read_heading(column.heading).channel == TIME_CHANNEL


def _settled(proposal: Proposal) -> Proposal:
    """What follows from what is known by now: units of pairs, ratio and sense, and which questions stay."""
    columns = _with_units(proposal.columns, proposal.slopes)
    used = [one for one in columns if one.channel]
    questions = [one for one in proposal.questions if one.why not in ("unit", _COUNTS)]
    for one in used:
        if not one.unit and _BY_FILE not in one.evidence:
            text = f"unit of {one.heading} ({one.channel})"
            questions.append(Question("unit", one.channel, text, _usual(one.channel)))
        elif _is_counted(one) and one.channel in ANGLES and one.channel not in proposal.counts:
            text = f"counts per revolution of {one.heading}"
            questions.append(Question(_COUNTS, one.channel, text))
    ratio, sense = _proportion(used, proposal.slope_of_angles)
    return replace(
        proposal, columns=columns, questions=tuple(questions), ratio=ratio, output_sense=sense
    )


def _is_counted(column: ProposedColumn) -> bool:
    return column.unit in ("count", "counts")


def _is_table(used: Sequence[ProposedColumn]) -> bool:
    """Pairs of a speed and an effort without a time: a table of friction over speed."""
    names = {one.channel for one in used}
    return TIME_CHANNEL not in names and bool(names & {*SPEEDS}) and bool(names & {*EFFORTS})


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


def _slope_of_angles(
    used: Sequence[ProposedColumn], numbers: Mapping[str, NDArray[np.float64]]
) -> float:
    """Output angle over input angle in the columns' own numbers, where the two are in proportion; else NaN."""
    by_channel = {one.channel: one for one in used}
    first, second = by_channel.get("input_angle"), by_channel.get("output_angle")
    if first is None or second is None:
        return math.nan
    a, b = numbers[_key(first)], numbers[_key(second)]
    n = min(len(a), len(b))
    good = np.isfinite(a[:n]) & np.isfinite(b[:n])
    a, b = a[:n][good], b[:n][good]
    if len(a) < _LEAST_ROWS or np.ptp(a) == 0.0 or np.ptp(b) == 0.0:
        return math.nan
    if abs(float(np.corrcoef(a, b)[0, 1])) < _SAME:
        return math.nan
    return float(np.polyfit(a - a.mean(), b - b.mean(), 1)[0])


def _proportion(used: Sequence[ProposedColumn], slope: float) -> tuple[float, int]:
    """The ratio of input to output where the slope makes it a whole number; and the sense of the output."""
    if not math.isfinite(slope):
        return math.nan, 0
    sense = 1 if slope > 0.0 else -1
    by_channel = {one.channel: one for one in used}
    first, second = by_channel["input_angle"], by_channel["output_angle"]
    scales = (_factor(first), _factor(second))
    if scales[0] is None or scales[1] is None or _is_counted(first) or _is_counted(second):
        return math.nan, sense
    ratio = abs(scales[0] / (slope * scales[1]))
    whole = round(ratio)
    # Half a tooth is the nearest that another gear comes.
    is_whole = whole >= 2 and abs(ratio - whole) < _WHOLE * whole and abs(ratio - whole) < 0.25
    return (float(whole) if is_whole else math.nan), sense


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
        return _settled(replace(made, columns=columns, slopes={}, slope_of_angles=math.nan))
    if question.why == "channel":
        if answer not in question.usual:
            raise _not_one_of(question, answer)
        columns = [
            replace(one, channel=question.about if one.heading == answer else "")
            if one.heading in question.usual
            else one
            for one in proposal.columns
        ]
        return _settled(replace(made, columns=tuple(columns)))
    if question.why == "unit":
        if not answer:
            return _settled(replace(made, columns=_without(proposal.columns, question.about)))
        channel = _channel_in(question, answer)
        columns_now = _with_unit(proposal.columns, question.about, answer, channel)
        return _settled(replace(made, columns=columns_now))
    number = _positive(question, answer)
    if question.why == "rate":
        return replace(made, rate=number)
    return _settled(replace(made, counts={**proposal.counts, question.about: number}))


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
    is_other = channel in EFFORTS and read.si not in (dimensions_of(channel) or ())
    return _EFFORT_IN.get(read.si, channel) if is_other else channel


def _with_unit(
    columns: Sequence[ProposedColumn], channel: str, unit: str, now: str
) -> tuple[ProposedColumn, ...]:
    return tuple(
        replace(one, channel=now, unit=unit, evidence=(*one.evidence, "unit as answered"))
        if one.channel == channel
        else one
        for one in columns
    )


def _without(columns: Sequence[ProposedColumn], channel: str) -> tuple[ProposedColumn, ...]:
    return tuple(
        replace(one, channel="", evidence=(*one.evidence, "left out: nobody knows its unit"))
        if one.channel == channel
        else one
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


def kind_of(path: Path) -> str:
    """The kind of a file by its first bytes, and by its name where these say nothing."""
    try:
        with path.open("rb") as stream:
            head = stream.read(64)
    except OSError:
        head = b""
    for mark, kind in _MARKS:
        if head.startswith(mark):
            return kind
    text = head.lstrip(b"\xef\xbb\xbf \t\r\n")
    if text[:1] in (b"{", b"["):
        return "json"
    return {".mat": "mat", ".npz": "npz", ".npy": "npz"}.get(path.suffix.lower(), "csv")


_MARKS = (
    (b"MATLAB", "mat"),
    (b"\x89HDF", "hdf5"),
    (b"PAR1", "parquet"),
    (b"TDSm", "tdms"),
    (b"MDF ", "mdf"),
    (b"\x93NUMPY", "npz"),
    (b"PK\x03\x04", "npz"),
)
"""First bytes of a kind of file."""
