"""Tables of numbers from other rigs: delimited text read in constant memory, and MATLAB files."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rig.errors import ConfigurationError, RunFileError

BATCH_ROWS = 16384
_LOOK_AHEAD = 60
_COMMENTS = ("#", "%", "//")
_BRACKETED = re.compile(r"(.*?)\s*[\[(]([^\])]*)[\])]\s*")
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_WHITESPACE = "whitespace"
DELIMITERS = {
    "tab": "\t",
    "\\t": "\t",
    "space": _WHITESPACE,
    _WHITESPACE: _WHITESPACE,
    "comma": ",",
    "semicolon": ";",
}
"""Words for delimiters besides the character itself."""


@dataclass(frozen=True)
class BadCell:
    """A cell that is no number: the line (or row) that the file's owner sees, the column, what
    stands there, and why.
    """

    line: int
    column: str
    text: str
    why: str


@dataclass(frozen=True)
class Batch:
    """Consecutive rows of the wanted columns: line numbers (n,), values (n, columns), and the bad cells by row."""

    lines: NDArray[np.int64]
    values: NDArray[np.float64]
    bad: dict[int, BadCell] = field(default_factory=dict)


class Table(Protocol):
    """Named columns of numbers in a file."""

    path: Path
    headings: tuple[str, ...]
    line_word: str

    def batches(self, columns: Sequence[int]) -> Iterator[Batch]:
        """The rows of these columns, a batch at a time."""
        ...


def find_column(table: Table, wanted: str) -> int:
    """The index of a column by its heading (with or without its unit) or its number, counted from 1."""
    plain = [split_heading(heading)[0] for heading in table.headings]
    for names in (list(table.headings), plain, [name.lower() for name in plain]):
        key = wanted.lower() if names and names == [name.lower() for name in plain] else wanted
        if names.count(key) == 1:
            return names.index(key)
        if names.count(key) > 1:
            raise ConfigurationError(
                "the file has more than one column of this name",
                where=str(table.path),
                value=wanted,
                remedy="Give the column's number, counted from 1.",
            )
    if wanted.isascii() and wanted.isdigit() and 1 <= int(wanted) <= len(table.headings):
        return int(wanted) - 1
    shown = ", ".join(table.headings[:20]) + (", ..." if len(table.headings) > 20 else "")
    raise ConfigurationError(
        "there is no such column",
        where=str(table.path),
        value=wanted,
        limit=f"{shown}, or a number from 1 to {len(table.headings)}",
    )


def split_heading(heading: str) -> tuple[str, str]:
    """Name and unit of a heading such as `Position [deg]` or `t (s)`."""
    match = _BRACKETED.fullmatch(heading)
    return (match.group(1).strip(), match.group(2).strip()) if match else (heading.strip(), "")


class DelimitedTable:
    """A text file with one row per line; delimiter, decimal comma and heading are found out unless they are given."""

    line_word = "line"

    def __init__(self, path: Path, delimiter: str = "", decimal: str = "") -> None:
        self.path = path
        self._encoding = _encoding(path)
        if decimal not in ("", ".", ","):
            raise ConfigurationError(
                "is no decimal mark", where="--decimal", value=repr(decimal), limit='"." or ","'
            )
        with self._text() as stream:
            head = [
                (number, line)
                for number, line in islice(enumerate(stream, 1), 4000)
                if _has_content(line)
            ]
        if not head:
            raise RunFileError("has no rows", where=str(path), remedy="Is this the right file?")
        sample = [line for _, line in head[:_LOOK_AHEAD]]
        given = DELIMITERS.get(delimiter.lower(), delimiter)
        self._delimiter = given or _find_delimiter(sample)
        self._decimal_comma = decimal == "," or (
            not decimal and self._looks_like_decimal_comma(sample)
        )
        self._find_headings(head[:_LOOK_AHEAD])

    @property
    def description(self) -> str:
        """How the file was read, in words."""
        names = {
            "\t": "tab",
            ",": "comma",
            ";": "semicolon",
            "|": "bar",
            _WHITESPACE: "white space",
        }
        name = names.get(self._delimiter, repr(self._delimiter))
        return f"columns separated by {name}, decimal {'comma' if self._decimal_comma else 'point'}"

    def batches(self, columns: Sequence[int]) -> Iterator[Batch]:
        with self._text() as stream:
            numbered = (
                (number, line)
                for number, line in enumerate(stream, 1)
                if number >= self._first_row and _has_content(line)
            )
            while True:
                lines = list(islice(numbered, BATCH_ROWS))
                if not lines:
                    return
                yield self._parse(lines, columns)

    def _parse(self, lines: list[tuple[int, str]], columns: Sequence[int]) -> Batch:
        width = len(self.headings)
        bad: dict[int, BadCell] = {}
        cells: list[list[str]] = []
        for row, (number, line) in enumerate(lines):
            split = self._split(line)
            if len(split) == width + 1 and not split[-1]:
                split.pop()
            if len(split) != width:
                why = f"the line has {len(split)} cells, the table {width}"
                bad[row] = BadCell(number, "", _shown(line.strip()), why)
                split = [""] * width
            cells.append([split[column] for column in columns])
        numbers = np.array([number for number, _ in lines], dtype=np.int64)
        values = np.full((len(lines), len(columns)), np.nan)
        for index, column in enumerate(columns):
            texts = [row[index] for row in cells]
            values[:, index] = self._numbers(texts, bad, numbers, self.headings[column])
        return Batch(numbers, values, bad)

    def _numbers(
        self, texts: list[str], bad: dict[int, BadCell], lines: NDArray[np.int64], heading: str
    ) -> NDArray[np.float64]:
        """The numbers of one column; what is none is NaN and noted."""
        plain = [text.replace(",", ".") for text in texts] if self._decimal_comma else texts
        together = "".join(texts)
        if "_" not in together and not (self._decimal_comma and "." in together):
            try:
                values = np.array(plain, dtype=np.str_).astype(np.float64)
            except ValueError:
                pass
            else:
                if np.isfinite(values).all():
                    return values
        values = np.full(len(texts), np.nan)
        for row, text in enumerate(texts):
            value = self._number(text)
            if isinstance(value, str):
                bad.setdefault(row, BadCell(int(lines[row]), heading, _shown(text), value))
            else:
                values[row] = value
        return values

    def _number(self, text: str) -> float | str:
        """The number, or why there is none."""
        text = text.strip()
        if not text:
            return "the cell is empty"
        if self._decimal_comma:
            if "." in text:
                return "a point in a number with a decimal comma"
            text = text.replace(",", ".")
        if not _NUMBER.fullmatch(text):
            return (
                "not finite"
                if text.lower().lstrip("+-") in ("nan", "inf", "infinity")
                else "not a number"
            )
        value = float(text)
        return value if np.isfinite(value) else "not finite"

    def _find_headings(self, head: list[tuple[int, str]]) -> None:
        """The line of headings is the first that is as wide as the table and holds words; a line of
        units may follow.
        """
        split = [(number, self._split(line)) for number, line in head]
        width = Counter(len(cells) for _, cells in split[-20:]).most_common(1)[0][0]
        wide = [(number, cells) for number, cells in split if len(cells) == width]
        number, cells = wide[0]
        words = [bool(cell) and not isinstance(self._number(cell), float) for cell in cells]
        if any(words) and not all(
            _missing_value(cell) for cell, word in zip(cells, words, strict=True) if word
        ):
            self.headings = tuple(cell.strip().strip('"') for cell in cells)
            self._first_row = number + 1
            if len(wide) > 1 and not any(
                isinstance(self._number(cell), float) for cell in wide[1][1]
            ):
                units = [cell.strip().strip("[]()") for cell in wide[1][1]]
                if not any(map(_missing_value, units)):
                    self.headings = tuple(
                        f"{name} [{unit}]" for name, unit in zip(self.headings, units, strict=True)
                    )
                    self._first_row = wide[1][0] + 1
        else:
            self.headings = tuple(f"column {index + 1}" for index in range(width))
            self._first_row = number

    def _looks_like_decimal_comma(self, sample: list[str]) -> bool:
        if self._delimiter == ",":
            return False
        cells = [cell.strip() for line in sample for cell in self._split(line)]
        return any(_DECIMAL_COMMA.fullmatch(cell) for cell in cells) and not any(
            "." in cell and _NUMBER.fullmatch(cell) for cell in cells
        )

    def _split(self, line: str) -> list[str]:
        return _split_line(line, self._delimiter)

    def _text(self) -> io.TextIOWrapper:
        try:
            return self.path.open(encoding=self._encoding, errors="replace", newline=None)
        except OSError as error:
            raise RunFileError(
                f"cannot be read: {error.strerror or error}", where=str(self.path)
            ) from error


def _encoding(path: Path) -> str:
    """The encoding by its mark or by trying; a file with zero bytes is no text."""
    try:
        with path.open("rb") as stream:
            head = stream.read(65536)
    except OSError as error:
        raise RunFileError(f"cannot be read: {error.strerror or error}", where=str(path)) from error
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    if b"\0" in head:
        raise RunFileError(
            "is not a text file",
            where=str(path),
            remedy="For a MATLAB file use `rig import mat`; a run file needs no import.",
        )
    try:
        head[: head.rfind(b"\n") + 1].decode("utf-8")
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"


def _find_delimiter(sample: list[str]) -> str:
    """The delimiter that cuts the later lines, which are no headings, into one and the same number (> 1) of cells."""
    lines = sample[len(sample) // 2 :][-20:]
    for candidate in ("\t", ";", "|"):
        if len({line.count(candidate) for line in lines}) == 1 and candidate in lines[0]:
            return candidate
    commas = {len(_split_line(line, ",")) for line in lines}
    words = [line.split() for line in lines]
    if len({len(row) for row in words}) == 1 and len(words[0]) > 1:
        numeric = all(
            _DECIMAL_COMMA.fullmatch(cell) or _NUMBER.fullmatch(cell)
            for row in words
            for cell in row
        )
        if numeric or commas == {1}:
            return _WHITESPACE
    counts = {
        c: Counter(line.count(c) for line in lines if line.count(c)).most_common(1) for c in ",;\t|"
    }
    best = max(counts, key=lambda c: counts[c][0][1] if counts[c] else 0)
    return best if counts[best] else _WHITESPACE


def _split_line(line: str, delimiter: str) -> list[str]:
    if delimiter == _WHITESPACE:
        return line.split()
    line = line.rstrip("\r\n")
    if '"' in line:
        try:
            return [
                cell.strip()
                for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
            ]
        except csv.Error:
            return line.split(delimiter)
    return [cell.strip() for cell in line.split(delimiter)]


def _has_content(line: str) -> bool:
    stripped = line.strip()
    return bool(stripped) and not stripped.startswith(_COMMENTS)


def _missing_value(cell: str) -> bool:
    """Whether a cell that is no number stands for one that is missing, rather than for a heading."""
    return cell.strip().lower().lstrip("+-") in (
        "",
        "nan",
        "inf",
        "infinity",
        "na",
        "n/a",
        "null",
        "none",
        "-",
    )


def _shown(text: str) -> str:
    return repr(text if len(text) <= 40 else text[:37] + "...")
