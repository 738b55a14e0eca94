"""How wide the columns of a table stand on paper: estimated from the letters, so that every table fits its page."""

from __future__ import annotations

import math
import re
import unicodedata
from dataclasses import dataclass, replace

from rig.present.content import Grid

PORTRAIT, LANDSCAPE = 174.0 / 25.4 * 72.0, 261.0 / 25.4 * 72.0
"""Width of the text on A4 [pt]."""
SIZES = (8.0, 7.5, 7.0, 6.5)
"""Sizes of a table's text [pt], the largest that fits is taken; smaller than the last one nothing is set."""
INSET = 7.0
"""Space beside the text of a column, both sides [pt]."""
LONG = 30.0
"""Widths [em] above which a column of text is broken into lines."""
LONGEST = 60.0
"""Width above which a longer text gets no larger a share [em]."""
NARROWEST = 9.0
"""Width that a column of broken text keeps at least [em]."""
SPARE = 0.5
"""What a column is wider than its text by the table of letters [em]."""
MANY, NAMING = 12, 3
"""Columns from which on a table is split with as many naming ones."""
KEPT_LINES = 26
"""Lines of a table that stands on one page whatever comes before it."""


@dataclass(frozen=True)
class Layout:
    """A table on paper: size of its text [pt], widths of its columns [em], about how many lines,
    and crosswise or not.
    """

    size: float
    widths: tuple[float, ...]
    landscape: bool
    lines: int = 0

    @property
    def fits_one_page(self) -> bool:
        """Whether the table is short enough to stand on one page."""
        return self.lines <= KEPT_LINES


def laid_out(grid: Grid, largest: float = SIZES[0]) -> tuple[tuple[Grid, Layout], ...]:
    """A table with its layout; one that fits no page comes in several, each with the first columns,
    which name the row.
    """
    whole = layout_of(grid, largest)
    if whole is not None:
        return ((grid, whole),)
    columns = len(grid.columns)
    if columns <= 2:
        return ((grid, _squeezed(grid)),)
    names = NAMING if columns >= MANY else 1
    middle = (names + columns + 1) // 2
    halves = (tuple(range(middle)), (*range(names), *range(middle, columns)))
    return tuple(pair for half in halves for pair in laid_out(_of_columns(grid, half), largest))


def _of_columns(grid: Grid, chosen: tuple[int, ...]) -> Grid:
    return replace(
        grid,
        columns=tuple(grid.columns[i] for i in chosen),
        numeric=tuple(grid.numeric[i] for i in chosen),
        rows=tuple(tuple(row[i] for i in chosen) for row in grid.rows),
    )


def layout_of(grid: Grid, largest: float = SIZES[0]) -> Layout | None:
    """The layout of a table: no wider than its text, broken where it must be, crosswise where it fits no other way.

    `largest` size of its text [pt]. None for a table that fits no page.
    """
    columns = range(len(grid.columns))
    heads = [_heading_width(grid.columns[i]) for i in columns]
    hashes = [column in grid.hashes for column in grid.columns]
    letters = [_hash_width if is_hash else width_of for is_hash in hashes]
    bodies = [max((letters[i](row[i]) for row in grid.rows), default=0.0) for i in columns]
    unbroken = [max((_longest_word(row[i]) for row in grid.rows), default=0.0) for i in columns]
    wanted = [max(head, body) + SPARE for head, body in zip(heads, bodies, strict=True)]
    flexible = [not grid.numeric[i] and bodies[i] > LONG and not hashes[i] for i in columns]
    for landscape, room in ((False, PORTRAIT), (True, LANDSCAPE)):
        for size in (size for size in SIZES if size <= largest):
            space = (room - INSET * len(wanted)) / size
            if sum(wanted) <= space:
                return _fixed(grid, size, wanted, landscape)
            for broken in (flexible, [not numeric for numeric in grid.numeric]):
                least = [
                    max(heads[i], min(max(unbroken[i], NARROWEST), LONG)) + SPARE for i in columns
                ]
                if (
                    any(broken)
                    and sum(min(least[i], wanted[i]) if broken[i] else wanted[i] for i in columns)
                    <= space
                ):
                    return _shared(
                        grid,
                        size,
                        wanted=wanted,
                        least=least,
                        broken=broken,
                        space=space,
                        landscape=landscape,
                    )
    return None


def _squeezed(grid: Grid) -> Layout:
    """One or two columns wider than any page: each gets its share, and breaks its text."""
    wanted = [
        min(max(width_of(row[i]) for row in (grid.columns, *grid.rows)), LONGEST)
        for i in range(len(grid.columns))
    ]
    space = (PORTRAIT - INSET * len(wanted)) / SIZES[-1]
    return _fixed(grid, SIZES[-1], [w * min(1.0, space / sum(wanted)) for w in wanted], False)


def _fixed(grid: Grid, size: float, widths: list[float], landscape: bool) -> Layout:
    rounded = tuple(round(w, 2) for w in widths)
    return Layout(size, rounded, landscape, _lines(grid, rounded))


def _lines(grid: Grid, widths: tuple[float, ...]) -> int:
    """About how many lines of text a table takes, its title among them."""
    deepest = [
        max(
            (
                math.ceil(1.08 * width_of(text) / max(w, 1.0))
                for text, w in zip(row, widths, strict=True)
            ),
            default=1,
        )
        for row in grid.rows
    ]
    return 4 + sum(max(one, 1) for one in deepest)


def _shared(
    grid: Grid,
    size: float,
    wanted: list[float],
    least: list[float],
    broken: list[bool],
    space: float,
    landscape: bool,
) -> Layout:
    """What the least widths leave over goes to the columns of broken text, by what each lacks of its whole text."""
    base = [
        min(low, whole) if b else whole for whole, low, b in zip(wanted, least, broken, strict=True)
    ]
    lack = [max(min(whole, LONGEST) - low, 0.0) for whole, low in zip(wanted, base, strict=True)]
    given = min(1.0, (space - sum(base)) / (sum(lack) or 1.0))
    return _fixed(
        grid, size, [low + given * more for low, more in zip(base, lack, strict=True)], landscape
    )


def width_of(text: str) -> float:
    """Width of a text in one line [em], rather too wide than too narrow."""
    return sum(_letter(c) for c in text)


HASH_LETTER = 0.85 * 0.602
"""Width of a letter of the face in which hashes stand, set somewhat smaller than the text beside it [em]."""


def _hash_width(text: str) -> float:
    return HASH_LETTER * len(text.replace("\u200b", ""))


BOLD = 1.12
"""Width of the headings' letters over those of the text."""


def _heading_width(text: str) -> float:
    """A heading may stand in three lines, its words unbroken."""
    return BOLD * max(
        _longest_word(text), width_of(text) / 3.0 + 1.0 if len(text) > 12 else width_of(text)
    )


def _longest_word(text: str) -> float:
    return max((width_of(word) for word in re.split(r"[ \u200b]", text)), default=0.0)


_WIDTHS = (
    (0.0, "\u200b"), (0.16, "\u202f\u2009"), (0.25, " ,.:;'|·\u00a0"), (0.31, "!()Iilj{}\\°²³¹⁰⁴⁵⁶⁷⁸⁹⁻"), (0.34, "-/"),
    (0.39, "JfrtS[]\"*s"), (0.47, "0123456789aecz$#`?~"), (0.51, "bdgoqvxSF_"), (0.55, "hknpuyµ+=<>±−–×≤≥LP^"), (0.61, "BERTYZ"),  # noqa: E501
    (0.66, "CKUVXΔαβσωνρ%"), (0.71, "ADGNOQ&"), (0.75, "Hw…"), (0.85, "mM∞"),
)  # fmt: skip
"""Widths of the letters of the report's face [em], rounded up."""
_LETTERS = {letter: width for width, letters in _WIDTHS for letter in letters}
_OTHER, _WIDEST = 0.72, 1.0


def _letter(c: str) -> float:
    """Width of a letter; one of another script by whether it is a wide one."""
    return _LETTERS.get(
        c, _WIDEST if c in "W@" or unicodedata.east_asian_width(c) in "WF" else _OTHER
    )
