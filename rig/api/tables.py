"""Tables in a terminal and in a notebook: the same cells, as text that fits a screen or as HTML."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from rig.content.wording import visible

WIDTH = 100
"""Letters of a line that fit a screen."""
ROWS, REMARKS = 24, 6
"""Rows of a table, and sentences under it, that fit a screen."""
CELL = 44
"""Letters of a cell, after which it is cut in a terminal."""


@dataclass(frozen=True)
class TableView:
    """A titled table: headings, rows of words, and what stands under it."""

    title: str
    headings: tuple[str, ...]
    rows: Sequence[Sequence[str]]
    remarks: tuple[str, ...] = ()

    def text(self) -> str:
        """For a terminal: no more rows than fit a screen, and how many more there are."""
        shown = [[_cut(visible(cell)) for cell in row] for row in self.rows[:ROWS]]
        columns = [*zip(self.headings, *shown, strict=True)]
        widths = [max(map(len, column)) for column in columns]
        lines = [visible(self.title)]
        for row in (self.headings, *shown):
            cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
            lines.append("  ".join(cells).rstrip())
        lines += _more(len(self.rows) - ROWS)
        lines = [_cut(line, WIDTH) for line in lines]
        for remark in self.remarks[:REMARKS]:
            lines += textwrap.wrap(visible(remark), WIDTH, subsequent_indent="  ")
        return "\n".join([*lines, *_more(len(self.remarks) - REMARKS)])

    def html(self) -> str:
        """For a notebook: every row; what comes from files is escaped."""
        head = "".join(f"<th>{escape(heading)}</th>" for heading in self.headings)
        body = "".join(
            f"<tr>{''.join(f'<td>{escape(visible(cell))}</td>' for cell in row)}</tr>"
            for row in self.rows
        )
        under = "".join(f"<p>{escape(visible(remark))}</p>" for remark in self.remarks)
        caption = f"<caption>{escape(visible(self.title))}</caption>"
        return f"<table>{caption}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{under}"


def _more(count: int) -> list[str]:
    return [f"... and {count} more"] if count > 0 else []


def _cut(text: str, length: int = CELL) -> str:
    return text if len(text) <= length else f"{text[: length - 1]}…"
