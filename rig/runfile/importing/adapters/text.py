"""Delimited text, read in constant memory."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.errors import ConfigurationError, RunFileError
from rig.runfile.importing.adapters.table import (
    BATCH_ROWS,
    BadCell,
    Batch,
    CellReader,
    heading_units,
)
from rig.runfile.importing.adapters.text_form import (
    ANY,
    DECIMAL_COMMA,
    DELIMITERS,
    MARK_WORDS,
    NAMES,
    NUMBER,
    TextForm,
    encoding_of,
    find_delimiter,
    has_content,
    missing_value,
    open_text,
    shown,
    split_line,
)

_LOOK_AHEAD = 60
_LONGEST_PREAMBLE = 4000


class TextRows:
    """The rows of a text file whose form is known: headings, first line of data, delimiter, decimal marks.

    With `is_ragged` lines may be shorter than the table. `last_line` is a text that ends the data.
    """

    line_word = "line"
    period: float | None = None
    start_ns = 0
    may_be_retimed = False
    path: Path
    headings: tuple[str, ...]
    units: tuple[str, ...]
    times: tuple[int | None, ...]
    notes: tuple[str, ...]
    encoding: str
    delimiter: str
    decimal_commas: tuple[bool, ...]
    first_row: int
    is_ragged = False
    last_line = ""

    @property
    def stamped(self) -> Collection[int]:
        """The columns of time that the file says: they count from its start."""
        return {time for time in self.times if time is not None}

    def batches(
        self, columns: Sequence[int], readers: Mapping[int, CellReader] | None = None
    ) -> Iterator[Batch]:
        with open_text(self.path, self.encoding) as stream:
            numbered = (
                (number, line)
                for number, line in enumerate(stream, 1)
                if number >= self.first_row and has_content(line)
            )
            while lines := list(islice(numbered, BATCH_ROWS)):
                yield self._parse(lines, columns, readers or {})

    def split(self, line: str) -> list[str]:
        """The cells of a line of data."""
        return split_line(line, self.delimiter)

    def _parse(
        self,
        lines: list[tuple[int, str]],
        columns: Sequence[int],
        readers: Mapping[int, CellReader],
    ) -> Batch:
        width = len(self.headings)
        bad: dict[int, BadCell] = {}
        blank: set[int] = set()
        cells: list[list[str]] = []
        for row, (number, line) in enumerate(lines):
            split = self.split(line)
            if len(split) == width + 1 and not split[-1]:
                split.pop()
            if len(split) != width:
                is_end = self.last_line and line.strip() == self.last_line
                if (not self.is_ragged and any(split) and not is_end) or len(split) > width:
                    why = f"the line has {len(split)} cells, the table {width}"
                    bad[row] = BadCell(number, "", shown(line.strip()), why)
                if row in bad or is_end:
                    split = []
                split = self._filled(split, width)
            chosen = [split[column] for column in columns]
            if row not in bad and not any(chosen):
                blank.add(row)
            cells.append(chosen)
        numbers = np.array([number for number, _ in lines], dtype=np.int64)
        values = np.full((len(lines), len(columns)), np.nan)
        for index, column in enumerate(columns):
            texts = [row[index] for row in cells]
            values[:, index] = self._numbers(texts, bad, numbers, column, readers.get(column))
        for row in blank:
            bad.pop(row, None)
        return Batch(numbers, values, bad, frozenset(blank))

    @staticmethod
    def _filled(cells: list[str], width: int) -> list[str]:
        return cells + [""] * (width - len(cells))

    def _numbers(
        self,
        texts: list[str],
        bad: dict[int, BadCell],
        lines: NDArray[np.int64],
        column: int,
        reader: CellReader | None,
    ) -> NDArray[np.float64]:
        """The numbers of one column; what is none is NaN and noted."""
        comma = self.decimal_commas[column]
        if reader is None and (plain := _plain_numbers(texts, comma)) is not None:
            return plain
        values = np.full(len(texts), np.nan)
        for row, text in enumerate(texts):
            value = self._number(text, comma) if reader is None else _read(reader, text)
            if isinstance(value, str):
                heading = self.headings[column]
                bad.setdefault(row, BadCell(int(lines[row]), heading, shown(text), value))
            else:
                values[row] = value
        return values

    def _number(self, text: str, comma: bool) -> float | str:
        """The number, or why there is none."""
        text = text.strip()
        if not text:
            return "the cell is empty"
        if comma:
            if "." in text:
                return "a point in a number with a decimal comma"
            text = text.replace(",", ".")
        if text.lower().lstrip("+-") in ("nan", "inf", "infinity"):
            return "not finite"
        if not NUMBER.fullmatch(text):
            return "not a number"
        value = float(text)
        return value if np.isfinite(value) else "not finite"


class DelimitedTable(TextRows):
    """A text file with one row per line; delimiter, decimal marks and headings are found out unless they are given."""

    def __init__(self, path: Path, form: TextForm = TextForm()) -> None:
        self.path = path
        self.encoding = encoding_of(path)
        self.is_ragged = form.is_ragged
        if form.decimal not in ("", ".", ","):
            raise ConfigurationError(
                "is no decimal mark",
                where="--decimal",
                value=repr(form.decimal),
                limit='"." or ","',
            )
        head = self._head(form.skip)
        start = 0
        if form.header:
            start = next((i for i, (number, _) in enumerate(head) if number >= form.header), -1)
            if start < 0 or head[start][0] != form.header:
                raise ConfigurationError(
                    "there is no line of headings", where="--header", value=form.header
                )
        sample = [line for _, line in head[start : start + _LOOK_AHEAD]]
        given = DELIMITERS.get(form.delimiter.lower(), form.delimiter)
        self.delimiter = given or find_delimiter(sample)
        self._find_headings(head[start : start + _LOOK_AHEAD], is_header_given=bool(form.header))
        self.decimal_commas = self._decimal_commas(form.decimal, head)
        self.units = heading_units(self.headings)
        self.times: tuple[int | None, ...] = (None,) * len(self.headings)
        self.notes = (self._described(),)

    def _head(self, skip: int) -> list[tuple[int, str]]:
        """The first lines that have content, with their numbers."""
        with open_text(self.path, self.encoding) as stream:
            head = [
                (number, line)
                for number, line in islice(enumerate(stream, 1), skip, skip + _LONGEST_PREAMBLE)
                if has_content(line)
            ]
        if not head:
            raise RunFileError(
                "has no rows", where=str(self.path), remedy="Is this the right file?"
            )
        return head

    def _described(self) -> str:
        """How the file was read, in words."""
        name = NAMES.get(self.delimiter, repr(self.delimiter))
        if len(set(self.decimal_commas)) == 1:
            mark = f"decimal {MARK_WORDS[self.decimal_commas[0]]}"
        else:
            with_comma = [
                heading
                for heading, comma in zip(self.headings, self.decimal_commas, strict=True)
                if comma
            ]
            mark = f"decimal comma in {', '.join(with_comma)}, decimal point in the others"
        words = [f"columns separated by {name}", mark]
        if self._heading_line > 1:
            words.append(f"headings in line {self._heading_line}")
        return ", ".join(words)

    def _find_headings(self, head: list[tuple[int, str]], *, is_header_given: bool) -> None:
        """The line of headings is the first that is as wide as the table and holds words; a line of
        units may follow.
        """
        split = [(number, self.split(line)) for number, line in head]
        width = Counter(len(cells) for _, cells in split[-20:]).most_common(1)[0][0]
        wide = [(number, cells) for number, cells in split if len(cells) == width]
        if is_header_given and len(split[0][1]) != width:
            raise ConfigurationError(
                "the line of headings is not as wide as the table",
                where=f"{self.path}, line {split[0][0]}",
                value=f"{len(split[0][1])} cells",
                limit=f"{width}",
                remedy="Give the line that holds the headings, or the --delimiter.",
            )
        number, cells = wide[0]
        words = [cell for cell in cells if cell and not self._is_number(cell)]
        if all(map(missing_value, words)):
            self._heading_line = 0
            self.headings = tuple(f"column {index + 1}" for index in range(width))
            self.first_row = number
            return
        self._heading_line = number
        self.headings = tuple(cell.strip().strip('"') for cell in cells)
        self.first_row = number + 1
        for number, cells in wide[1:2]:
            if units := self._line_of_units(cells):
                named = zip(self.headings, units, strict=True)
                self.headings = tuple(f"{name} [{unit}]" for name, unit in named)
                self.first_row = number + 1

    def _line_of_units(self, cells: list[str]) -> list[str]:
        """The units in the line behind the headings; nothing where a cell is a number or stands for one."""
        units = [cell.strip().strip("[]()") for cell in cells]
        if any(map(self._is_number, cells)) or any(map(missing_value, units)):
            return []
        return units

    def _is_number(self, cell: str) -> bool:
        """Whether a cell of the first lines is a number by either decimal mark."""
        cell = cell.strip()
        comma = self.delimiter not in (",", ANY) and DECIMAL_COMMA.fullmatch(cell)
        return bool(comma or NUMBER.fullmatch(cell))

    def _decimal_commas(self, given: str, head: list[tuple[int, str]]) -> tuple[bool, ...]:
        """Whether each column has a decimal comma: by its own numbers, else as the others have it."""
        width = len(self.headings)
        if given or self.delimiter in (",", ANY):
            return (given == ",",) * width
        rows = [
            self.split(line) for number, line in head[: 4 * _LOOK_AHEAD] if number >= self.first_row
        ]
        own: dict[int, bool] = {}
        for column in range(width):
            cells = [row[column].strip() for row in rows if column < len(row)]
            point = any("." in cell and NUMBER.fullmatch(cell) for cell in cells)
            comma = any(map(DECIMAL_COMMA.fullmatch, cells))
            if comma != point:
                own[column] = comma
        common = bool(own) and all(own.values())
        return tuple(own.get(column, common) for column in range(width))


def _plain_numbers(texts: list[str], comma: bool) -> NDArray[np.float64] | None:
    """The numbers of a column of nothing but finite numbers, all at once; None for any other."""
    together = "".join(texts)
    if "_" in together or (comma and "." in together):
        return None
    if comma:
        texts = [text.replace(",", ".") for text in texts]
    try:
        values = np.array(texts, dtype=np.str_).astype(np.float64)
    except ValueError:
        return None
    return values if np.isfinite(values).all() else None


def _read(reader: CellReader, text: str) -> float | str:
    """What a reader of dates or labels makes of a cell, or why it is none."""
    if not text.strip():
        return "the cell is empty"
    try:
        return reader(text.strip())
    except ValueError as error:
        return str(error)
