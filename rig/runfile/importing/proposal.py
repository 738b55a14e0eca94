"""What the columns of a file are, as far as headings and numbers tell: with its evidence, and with what stays open.

Nothing is decided here: a person, or a script that says so, accepts it. What has no evidence is a question.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rig.content.phrase import phrase
from rig.errors import RunFileError
from rig.runfile.importing.adapters.table import Table
from rig.runfile.importing.answers import factor, only, settle
from rig.runfile.importing.clocks import is_date
from rig.runfile.importing.column_evidence import (
    SAME,
    Numbers,
    derivative,
    never_falls,
    rises_evenly,
    sign_share,
    slope_of,
)
from rig.runfile.importing.heading_words import Heading, channel_by_unit, read_heading
from rig.runfile.importing.proposed import (
    ANGLES,
    BY_FILE,
    EFFORTS,
    NO_NUMBERS,
    SPEEDS,
    Proposal,
    ProposedColumn,
    Question,
)
from rig.runfile.importing.units import ISO_TIME, TIME_CHANNEL, dimensions_of

LOOKED_AT = 100_000
"""Rows from the beginning that the numbers are judged by."""
_PAIRED = 20_000
"""Rows by which columns without headings are held against each other, each with each."""
_LARGEST = 1e100
_SIGN = 0.8
"""Share of moving rows in which an effort has the sign of the speed."""
_SECONDS = (1e-5, 0.02)
"""Steps of a time that nobody gave a unit and that can hardly be anything but seconds: in ms it would be 50 kHz."""


def propose(tables: Sequence[Table], heads: Sequence[Numbers] | None = None) -> Proposal:
    """What the columns of the files of one run are, by their first rows (`head`, where they were read already).

    Raises `RunFileError` for a file that cannot be read.
    """
    columns: list[ProposedColumn] = []
    numbers: dict[str, Numbers] = {}
    if heads is None:
        heads = [head(table) for table in tables]
    for file, table, values in zip(_files(tables), tables, heads, strict=True):
        if not len(values):
            raise RunFileError(
                "has no rows under its headings",
                where=str(table.path),
                remedy="Is this the right file?",
            )
        # What is no size of anything is no number either: its square would overflow.
        values = np.where(np.abs(values) < _LARGEST, values, np.nan)
        for at in range(len(table.headings)):
            column = replace(_by_heading(table, at, values[:, at]), file=file)
            columns.append(column)
            numbers[column.key] = values[:, at]
    columns = _times(columns, numbers, tables)
    columns = _by_numbers(_by_units(columns), numbers)
    columns = [replace(one, meant=one.channel) for one in columns]
    chosen, asked = _one_of_several(columns, numbers)
    return _concluded(chosen, numbers, asked, tables)


def _files(tables: Sequence[Table]) -> list[str]:
    """How the columns name the files: by number, and not at all where there is one."""
    if len(tables) == 1:
        return [""]
    return [str(number) for number in range(1, len(tables) + 1)]


def head(table: Table) -> Numbers:
    """The first rows of all columns (n, columns); what is no number, or of another length than most, is NaN."""
    try:
        return _rows(table, range(len(table.headings)))
    except RunFileError:
        alone = [_rows(table, [at])[:, 0] for at in range(len(table.headings))]
    rows = Counter(len(one) for one in alone).most_common(1)[0][0]
    return np.column_stack([one if len(one) == rows else np.full(rows, np.nan) for one in alone])


def _rows(table: Table, columns: Sequence[int]) -> Numbers:
    parts: list[Numbers] = []
    rows = 0
    for batch in table.batches(columns):
        parts.append(batch.values)
        rows += len(batch.values)
        if rows >= LOOKED_AT:
            break
    return np.concatenate([*parts, np.zeros((0, len(columns)))])


def _by_heading(table: Table, at: int, values: Numbers) -> ProposedColumn:
    heading = table.headings[at]
    said: Heading = read_heading(heading, table.path.stem)
    is_once = Counter(table.headings)[heading] == 1
    plain = is_once and heading.strip() and not set(heading) & set("=:@[](),")
    reference = heading if plain and not heading.strip().isdigit() else str(at + 1)
    unit = said.unit or "".join(table.units[at : at + 1])
    is_numeric = len(values) > 0 and np.isfinite(values).mean() > 0.5
    shown = heading.strip() or f"column {at + 1}"
    if said.channel == TIME_CHANNEL and _is_dated(table, at):
        unit, is_numeric = ISO_TIME, True
    if not is_numeric:
        return ProposedColumn(reference=reference, heading=shown, evidence=(NO_NUMBERS,))
    evidence: list[str] = []
    if said.channel:
        evidence.append(said.why)
    if unit:
        evidence.append(f"unit {unit} as written")
    return ProposedColumn(
        reference=reference,
        heading=shown,
        channel=said.channel,
        unit=unit,
        member=said.member,
        evidence=tuple(evidence),
    )


def _is_dated(table: Table, at: int) -> bool:
    """Whether the first cell of a column is a date."""
    batch = next(iter(table.batches([at])), None)
    return batch is not None and 0 in batch.bad and is_date(batch.bad[0].text)


def _times(
    columns: list[ProposedColumn],
    numbers: Mapping[str, Numbers],
    tables: Sequence[Table],
) -> list[ProposedColumn]:
    """One column of time: the one that the file names, else one that rises evenly; others are left out."""
    by_file = _named_by_file(columns, tables)
    called = [one for one in columns if one.channel == TIME_CHANNEL]
    by_word = [one for one in called if never_falls(numbers[one.key])]
    open_ones = (one for one in columns if not one.channel and not one.unit)
    nameless = (one for one in open_ones if rises_evenly(numbers[one.key]))
    chosen = next(iter((*by_file, *by_word, *nameless, *called)), None)
    made = []
    for one in columns:
        if one is chosen and one in by_file:
            evidence = (*(word for word in one.evidence if word != NO_NUMBERS), BY_FILE)
            one = replace(one, channel=TIME_CHANNEL, evidence=evidence)
        elif one is chosen:
            one = _rising_time(one, numbers[one.key])
        elif one.channel == TIME_CHANNEL:
            one = replace(one, channel="", evidence=(*one.evidence, "not the time of the others"))
        made.append(one)
    return made


def _named_by_file(columns: list[ProposedColumn], tables: Sequence[Table]) -> list[ProposedColumn]:
    """The columns that the files themselves name as a time."""
    named = {
        (table.headings[time].strip(), file)
        for file, table in zip(_files(tables), tables, strict=True)
        for time in table.times
        if time is not None
    }
    return [one for one in columns if (one.heading, one.file) in named]


def _rising_time(column: ProposedColumn, values: Numbers) -> ProposedColumn:
    """A column that is the time by its numbers, with its unit where the step is usual in one."""
    if column.unit == ISO_TIME or len(values) < 2:
        return column
    step = float(np.nanmedian(np.diff(values)))
    evidence = (*column.evidence, f"rises by {step:.4g} from row to row")
    column = replace(column, channel=TIME_CHANNEL, evidence=evidence)
    if not column.unit and _SECONDS[0] <= step <= _SECONDS[1]:
        column = replace(column, unit="s", evidence=(*evidence, "a step that is usual in s"))
    return column


def _by_numbers(
    columns: list[ProposedColumn], numbers: Mapping[str, Numbers]
) -> list[ProposedColumn]:
    """Angle, speed and effort of columns whose headings say nothing: by derivative, and by the sign of the speed."""
    time = next((numbers[one.key] for one in columns if one.channel == TIME_CHANNEL), None)
    if any(one.channel in (*ANGLES, *SPEEDS, *EFFORTS) for one in columns) or time is None:
        return columns
    free = [one for one in columns if not one.channel and NO_NUMBERS not in one.evidence]
    found: dict[str, ProposedColumn] = {}
    head = {one.key: numbers[one.key][:_PAIRED] for one in free}
    pairs = [
        (r, a, b)
        for a in free
        for b in free
        if a is not b and (r := derivative(head[a.key], head[b.key], time[:_PAIRED])[0]) > SAME
    ]
    pairs.sort(key=lambda pair: -float(np.nanstd(numbers[pair[1].key])))
    taken: set[str] = set()
    for r, angle, speed in pairs:
        if {angle.key, speed.key} & taken:
            continue
        taken |= {angle.key, speed.key}
        member = angle.reference
        words = f"{speed.heading} is its derivative (r = {r:.3f})"
        found[angle.key] = replace(
            angle, channel="position", member=member, evidence=(*angle.evidence, words)
        )
        words = f"the derivative of {angle.heading} (r = {r:.3f})"
        found[speed.key] = replace(
            speed, channel="speed", member=member, evidence=(*speed.evidence, words)
        )
        effort = _effort(free, numbers, numbers[speed.key], taken)
        if effort is not None:
            share, column = effort
            taken.add(column.key)
            words = f"has the sign of {speed.heading} in {100.0 * share:.0f} % of the moving rows"
            found[column.key] = replace(
                column, channel="torque", member=member, evidence=(*column.evidence, words)
            )
    return [found.get(one.key, one) for one in columns]


def _by_units(columns: list[ProposedColumn]) -> list[ProposedColumn]:
    """Torque and speed of columns whose headings say nothing but the unit, where no other column is one."""
    known = {si for one in columns for si in dimensions_of(one.channel) or ()}
    made: list[ProposedColumn] = []
    for one in columns:
        channel, unit = channel_by_unit(one.heading, one.unit)
        is_open = channel and not one.channel and NO_NUMBERS not in one.evidence
        if is_open and known.isdisjoint(dimensions_of(channel) or ()):
            words = f"{unit} is a unit of {channel}"
            one = replace(one, channel=channel, unit=unit, evidence=(*one.evidence, words))
        made.append(one)
    return made


def _effort(
    free: Sequence[ProposedColumn],
    numbers: Mapping[str, Numbers],
    speed: Numbers,
    taken: set[str],
) -> tuple[float, ProposedColumn] | None:
    """The column that has the sign of the speed where it moves, with how often; None where none has it often enough."""
    found = [
        (share, one)
        for one in free
        if one.key not in taken and (share := sign_share(numbers[one.key], speed)) >= _SIGN
    ]
    return max(found, key=lambda pair: pair[0], default=None)


def _one_of_several(
    columns: list[ProposedColumn], numbers: Mapping[str, Numbers]
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
        of_it = (np.nanstd(numbers[one.key]) for one in moving if one.member == member)
        return max(map(float, of_it), default=0.0)

    chosen = max(members, key=moved)
    question = Question("which", chosen, f"which of {', '.join(members)}", tuple(members))
    return only(columns, chosen), [question]


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


def _slopes(columns: Sequence[ProposedColumn], numbers: Mapping[str, Numbers]) -> dict[str, float]:
    """By each angle whose speed is there as well: its derivative over the speed, where the two go together."""
    by_channel = {one.channel: one for one in columns if one.channel}
    time = by_channel.get(TIME_CHANNEL)
    found: dict[str, float] = {}
    for angle_name, speed_name in zip(ANGLES, SPEEDS, strict=True):
        angle, speed = by_channel.get(angle_name), by_channel.get(speed_name)
        if angle is None or speed is None or time is None or not time.unit:
            continue
        seconds = numbers[time.key] * (factor(time) or math.nan)
        r, slope = derivative(numbers[angle.key], numbers[speed.key], seconds)
        if abs(r) >= SAME and math.isfinite(slope):
            found[angle_name] = slope
    return found


def _concluded(
    columns: list[ProposedColumn],
    numbers: Mapping[str, Numbers],
    asked: list[Question],
    tables: Sequence[Table],
) -> Proposal:
    """The proposal with what the numbers tell of pairs of columns, and its questions."""
    slopes = _slopes(columns, numbers)
    used = [one for one in columns if one.channel]
    has_time = any(one.channel == TIME_CHANNEL for one in used) or any(t.period for t in tables)
    is_table = _is_table(used) and not any(map(_is_called_time, columns))
    if not has_time and not is_table and used:
        called = ", ".join(one.heading for one in columns if _is_called_time(one))
        text = f"sample rate in Hz{phrase(' ({} is no time that is understood)', called)}"
        asked = [*asked, Question("rate", "", text)]
    made = Proposal(
        tuple(columns),
        tuple(asked),
        is_table=is_table,
        slopes=slopes,
        slope_of_angles=_slope_of_angles(used, numbers),
    )
    return settle(made)


def _is_called_time(column: ProposedColumn) -> bool:
    return read_heading(column.heading).channel == TIME_CHANNEL


def _is_table(used: Sequence[ProposedColumn]) -> bool:
    """Pairs of a speed and an effort without a time: a table of friction over speed."""
    names = {one.channel for one in used}
    return TIME_CHANNEL not in names and bool(names & {*SPEEDS}) and bool(names & {*EFFORTS})


def _slope_of_angles(used: Sequence[ProposedColumn], numbers: Mapping[str, Numbers]) -> float:
    """Output angle over input angle in the columns' own numbers, where both are there and in proportion; else NaN."""
    by_channel = {one.channel: one for one in used}
    first, second = by_channel.get("input_angle"), by_channel.get("output_angle")
    if first is None or second is None:
        return math.nan
    return slope_of(numbers[first.key], numbers[second.key])
