"""LabVIEW measurement files (.lvm): two headers, a line of headings, rows, perhaps a column of comments.

Without a column of X the step stands in the header (Delta_X); with one, it stands first, or before
each channel. The decimal mark of the data is stated, or it is a point.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from rig.errors import RunFileError
from rig.runfile.importing.adapters.text import TextRows
from rig.runfile.importing.adapters.text_form import (
    MARK_WORDS,
    encoding_of,
    has_content,
    open_text,
)

_MARK = "LabVIEW Measurement"
_END = "***End_of_Header***"
_LONGEST_HEADER = 400
_SHOWN = 5
_DELIMITERS = {"tab": "\t", "comma": ",", "semicolon": ";", "": "\t"}
_X_HEADING = "X_Value"
_CELLS_PER_CHANNEL = {"Multi": 2}
"""Cells of a line of the header for each channel, by X_Columns; else one."""


def is_labview(path: Path) -> bool:
    """Whether a text file begins as these files do."""
    with open_text(path, encoding_of(path)) as stream:
        return stream.readline().startswith(_MARK)


class LabviewTable(TextRows):
    """The channels of one block of a LabVIEW measurement file; the unit of each is the one of the header."""

    is_ragged = True
    period: float | None = None

    def __init__(self, path: Path) -> None:
        self.path = path
        self.encoding = encoding_of(path)
        with open_text(path, self.encoding) as stream:
            lines = [line.rstrip("\r\n") for line in islice(stream, _LONGEST_HEADER)]
        ends = [number for number, line in enumerate(lines, 1) if line.startswith(_END)]
        if len(ends) < 2 or len(lines) <= ends[1]:
            raise RunFileError(
                "is a LabVIEW file without the header of a measurement",
                where=str(path),
                value=f"{len(ends)} lines {_END}",
                limit="2 in the first 400 lines, a line of headings, rows",
            )
        separator = _header_value(lines[: ends[0]], "Separator").lower()
        self.delimiter = _DELIMITERS.get(separator, separator)
        block = {
            cells[0]: cells[1:]
            for line in lines[ends[0] : ends[1] - 1]
            if (cells := [cell.strip() for cell in line.split(self.delimiter)])[0]
        }
        headings = [cell.strip() for cell in lines[ends[1]].split(self.delimiter)]
        self._comments = [*headings, "Comment"].index("Comment")
        self.headings = tuple(headings)
        self.first_row = ends[1] + 2
        comma = _header_value(lines[: ends[0]], "Decimal_Separator") == ","
        self.decimal_commas = (comma,) * len(headings)
        kind = _header_value(lines[: ends[0]], "X_Columns") or "One"
        self._refuse_second_block()
        is_time = all(cell in ("Time", "") for cell in block.get("X_Dimension", ["Time"]))
        self._find_times(block.get("Y_Unit_Label", []), kind, is_time=is_time)
        if kind == "No" and is_time:
            self.period = self._common_step(block.get("Delta_X", []), comma=comma)
        self.notes = (
            f"LabVIEW measurement, {len(self.headings)} columns, X_Columns {kind}, "
            f"decimal {MARK_WORDS[comma]}",
            *self._recorded(block),
            *self._row_comments(block),
        )

    def _find_times(self, labels: list[str], kind: str, *, is_time: bool) -> None:
        """Each column's unit and its column of time: the last one before it."""
        # The cells of a header stand below the channels: one per channel, or with X columns between them.
        below = iter(labels[:: _CELLS_PER_CHANNEL.get(kind, 1)])
        units = [""] * len(self.headings)
        times: list[int | None] = [None] * len(self.headings)
        latest = None
        for index, name in enumerate(self.headings):
            if name == _X_HEADING:
                if is_time and kind != "No":
                    units[index], latest = "s", index
            elif index < self._comments:
                units[index], times[index] = next(below, ""), latest
        self.units, self.times = tuple(units), tuple(times)

    def _common_step(self, stated: list[str], *, comma: bool) -> float:
        """The step of all channels that stands in the header."""
        steps = {cell for cell in stated if cell}
        if len(steps) != 1:
            raise RunFileError(
                "its channels have no common step",
                where=f"{self.path}, Delta_X",
                value=", ".join(sorted(steps)) or "none",
                remedy="Write it with X_Columns Multi.",
            )
        (step,) = steps
        try:
            return float(step.replace(",", ".") if comma else step)
        except ValueError:
            raise RunFileError(
                "the step is no number", where=f"{self.path}, Delta_X", value=repr(step)
            ) from None

    def _refuse_second_block(self) -> None:
        """A block with a header of its own has a start, a step and channels of its own."""
        with open_text(self.path, self.encoding) as stream:
            for number, line in enumerate(stream, 1):
                if number >= self.first_row and line.startswith(_END):
                    raise RunFileError(
                        "holds a second block with a header of its own",
                        where=f"{self.path}, line {number}",
                        remedy="Save each block as a file of its own.",
                    )

    def _recorded(self, block: dict[str, list[str]]) -> Iterator[str]:
        """When it was recorded, as the header says it: local time, without a zone."""
        said = " ".join(next((c for c in block.get(key, []) if c), "") for key in ("Date", "Time"))
        if said.strip():
            yield f"recorded {said.strip()}, local time: give it with --start"

    def _row_comments(self, block: dict[str, list[str]]) -> list[str]:
        """Comments beside the rows, and a number of samples that is not the one of the rows."""
        rows, comments, first = 0, 0, []
        with open_text(self.path, self.encoding) as stream:
            for number, line in enumerate(stream, 1):
                if number < self.first_row or not has_content(line):
                    continue
                rows += 1
                cells = line.rstrip("\r\n").split(self.delimiter)
                text = "".join(cells[self._comments : self._comments + 1]).strip()
                if text:
                    comments += 1
                    first.append(f"line {number}: {text}")
                    del first[_SHOWN:]
        said = []
        stated = {int(cell) for cell in block.get("Samples", []) if re.fullmatch(r"[1-9]\d*", cell)}
        if stated and stated != {rows}:
            said.append(
                f"WARNING: the header says {', '.join(map(str, sorted(stated)))} samples, there are {rows} rows"
            )
        if comments:
            said.append(f"WARNING: {comments} rows carry a comment: {'; '.join(first)}")
        return said


def _header_value(header: list[str], name: str) -> str:
    """A value of the first header; "" where it is not there."""
    for line in header:
        if line.startswith(name):
            return line[len(name) :].strip()
    return ""
