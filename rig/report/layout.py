"""How wide the columns of a table stand on paper: estimated from the letters, so that every table fits its page."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass

from rig.report.content import Grid

PORTRAIT, LANDSCAPE = 174.0 / 25.4 * 72.0, 257.0 / 25.4 * 72.0
"""Width of the text on A4 [pt]."""
SIZES = (8.0, 7.5, 7.0, 6.5)
"""Sizes of a table's text [pt], the largest that fits is taken."""
SMALLEST = 5.5
"""For tables that fit no other way."""
INSET = 7.0
"""Space beside the text of a column, both sides [pt]."""
LONG = 30.0
"""Widths [em] above which a column of text is broken into lines."""
LONGEST = 60.0
"""Width above which a longer text gets no larger a share [em]."""
NARROWEST = 9.0
"""Width that a column of broken text keeps at least [em]."""
BOLD = 1.1
"""Width of the headings' letters over those of the text."""


@dataclass(frozen=True)
class Layout:
    """A table on paper: size of its text [pt], widths of its columns [em], and whether its page is laid crosswise."""

    size: float
    widths: tuple[float, ...]
    landscape: bool


def layout_of(grid: Grid) -> Layout:
    """The layout of a table: no wider than its text, broken where it must be, crosswise where it fits no other way."""
    columns = range(len(grid.columns))
    heads = [_heading_width(grid.columns[i]) for i in columns]
    bodies = [max((width_of(row[i]) for row in grid.rows), default=0.0) for i in columns]
    unbroken = [max((_longest_word(row[i]) for row in grid.rows), default=0.0) for i in columns]
    wanted = [max(head, body) for head, body in zip(heads, bodies, strict=True)]
    flexible = [not grid.numeric[i] and bodies[i] > LONG and not _is_whole(grid.columns[i]) for i in columns]
    for landscape, room in ((False, PORTRAIT), (True, LANDSCAPE)):
        for size in SIZES:
            space = (room - INSET * len(wanted)) / size
            if sum(wanted) <= space:
                return _fixed(size, wanted, landscape)
            for broken in (flexible, [not numeric for numeric in grid.numeric]):
                least = [max(heads[i], min(max(unbroken[i], NARROWEST), LONG)) for i in columns]
                if any(broken) and sum(least[i] if broken[i] else wanted[i] for i in columns) <= space:
                    return _shared(size, wanted, least, broken, space, landscape)
    space = (LANDSCAPE - INSET * len(wanted)) / SMALLEST
    return _fixed(SMALLEST, [w * min(1.0, space / sum(wanted)) for w in wanted], True)


def _is_whole(heading: str) -> bool:
    """Hashes are compared letter by letter: they stand in one line."""
    return heading.startswith("SHA-256")


def _fixed(size: float, widths: list[float], landscape: bool) -> Layout:
    return Layout(size, tuple(round(w, 2) for w in widths), landscape)


def _shared(
    size: float, wanted: list[float], least: list[float], broken: list[bool], space: float, landscape: bool
) -> Layout:
    """What the least widths leave over goes to the columns of broken text, by what each lacks of its whole text."""
    base = [low if b else whole for whole, low, b in zip(wanted, least, broken, strict=True)]
    lack = [max(min(whole, LONGEST) - low, 0.0) for whole, low in zip(wanted, base, strict=True)]
    given = min(1.0, (space - sum(base)) / (sum(lack) or 1.0))
    return _fixed(size, [low + given * more for low, more in zip(base, lack, strict=True)], landscape)


def width_of(text: str) -> float:
    """Width of a text in one line [em], rather too wide than too narrow."""
    return sum(_letter(c) for c in text)


def _heading_width(text: str) -> float:
    """A heading may stand in three lines, its words unbroken."""
    return BOLD * max(_longest_word(text), width_of(text) / 3.0 + 1.0 if len(text) > 12 else width_of(text))


def _longest_word(text: str) -> float:
    return max((width_of(word) for word in re.split(r"[ \u200b]", text)), default=0.0)


_NARROW, _WIDE = frozenset("iljtfr.,:;'|!()[]/ \u202f-"), frozenset("mwMW@%…—×")


def _letter(c: str) -> float:
    if c == "\u200b":
        return 0.0
    if c in _NARROW:
        return 0.36
    if c in _WIDE or unicodedata.east_asian_width(c) in "WF":
        return 0.95
    return 0.50 if c.islower() or c.isdigit() else 0.68
