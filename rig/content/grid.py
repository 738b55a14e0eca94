"""Tables and facts as plain words: what every painter shows, with no letter, colour or width chosen."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from rig.content.phrase import phrase

Kind = Literal[
    "text", "sentence", "name", "number", "unit", "word", "quantity", "symbol", "figure", "hash"
]
"""What stands in a column: text that may be broken into lines; sentences, for which the table is there, so that they
are never left out; what names its row; numbers, to the right; units; words of a verdict, which have a tone; names of
quantities, in which symbols may stand; symbols alone; figures by their numbers; hashes, compared letter by letter.
"""
Tone = Literal["good", "warning", "bad", "muted"]

TONES: Mapping[str, Tone] = {
    "yes": "good",
    "weakly": "warning",
    "no": "bad",
    "PASS": "good",
    "MARGINAL": "warning",
    "FAIL": "bad",
    "NOT JUDGED": "muted",
    "significant": "warning",
    "within U": "muted",
    "ok": "good",
    "error": "bad",
    "warning": "warning",
    "no change seen": "good",
    "changed": "bad",
    "learning": "muted",
    "not watched": "muted",
    "unreadable": "bad",
    "ABORTED": "warning",
    "INTERRUPTED": "warning",
    "TRIPPED": "bad",
    "ERROR": "bad",
    "left behind": "bad",
}
"""How a word of a verdict is to be taken; a word that is not here has no tone."""
_WORD = re.compile(rf"({'|'.join(TONES)})(?= \(|[:,;]|$)")


_NOTHING_SAID = frozenset({"", "–"})
"""What stands in a cell about which there is nothing to say."""


@dataclass(frozen=True)
class Column:
    """One column of a table: its heading, with its unit where all cells share one, and what stands in it."""

    heading: str
    kind: Kind = "text"


def columns(*headings: str | tuple[str, Kind]) -> tuple[Column, ...]:
    """Columns of a table; a heading alone is one of text."""
    return tuple(Column(one) if isinstance(one, str) else Column(*one) for one in headings)


def number_columns(*headings: str) -> tuple[Column, ...]:
    """Columns of numbers."""
    return tuple(Column(one, "number") for one in headings)


@dataclass(frozen=True)
class Grid:
    """A table: a title, columns, rows of text, and a remark under it."""

    title: str
    columns: tuple[Column, ...]
    rows: Sequence[tuple[str, ...]]
    note: str = ""

    @property
    def headings(self) -> tuple[str, ...]:
        """The headings of the columns."""
        return tuple(column.heading for column in self.columns)

    @property
    def names_rows(self) -> bool:
        """Whether the first column names what stands in the row: facts of several runs side by side."""
        return self.columns[0].kind == "name"

    def texts(self, heading: str) -> list[str]:
        """What stands in a column. Raises `ValueError` for one that is not there."""
        place = self.headings.index(heading)
        return [row[place] for row in self.rows]

    def without(self, *headings: str) -> Grid:
        """The table without these columns."""
        return self._only([one.heading not in headings for one in self.columns])

    def without_empty(self) -> Grid:
        """The table without the columns that say nothing; the whole one where none says anything."""
        places = range(len(self.columns))
        says = [any(row[place] not in _NOTHING_SAID for row in self.rows) for place in places]
        return self._only(says) if any(says) else self

    def _only(self, kept: Sequence[bool]) -> Grid:
        def chosen(cells: Sequence[str]) -> tuple[str, ...]:
            return tuple(cell for cell, is_kept in zip(cells, kept, strict=True) if is_kept)

        columns = tuple(one for one, is_kept in zip(self.columns, kept, strict=True) if is_kept)
        return replace(self, columns=columns, rows=tuple(map(chosen, self.rows)))


@dataclass(frozen=True)
class Fact:
    """One thing that is known: what it is called, what it is, in which unit, and among what it stands."""

    title: str
    value: str
    unit: str = ""
    group: str = ""
    name: str = ""
    """By what a file calls it, where that is not the title."""

    @property
    def text(self) -> str:
        """The value with its unit."""
        return phrase("{} {}", self.value, self.unit).rstrip()


def tone_of(text: str) -> Tone | None:
    """The tone of a text that begins with a word of a verdict."""
    match = _WORD.match(text)
    return match and TONES[match[1]]


def capital(text: str) -> str:
    """A heading as it begins a line: with a capital, unless it begins with a symbol or a unit."""
    begins_with_a_word = text[:1].islower() and text[1:2].islower()
    return text[:1].upper() + text[1:] if begins_with_a_word else text
