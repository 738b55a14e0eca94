"""Tables in a terminal and in a notebook: a grid as text that fits a screen, and as HTML."""

from __future__ import annotations

import textwrap
from html import escape

from rig.content.grid import Grid
from rig.content.phrase import shortened
from rig.content.wording import aligned, visible

WIDTH = 100
"""Letters of a line that fit a screen."""
ROWS, REMARKS = 24, 6
"""Rows of a table, and sentences under it, that fit a screen."""
_CELL = 44
"""Letters of a cell, after which it is cut in a terminal."""


class Tabular:
    """What is shown as a table where it is the value of an expression; each line of its note is a remark."""

    def _grid(self) -> Grid:
        raise NotImplementedError

    def __repr__(self) -> str:
        return text_of(self._grid())

    def _repr_html_(self) -> str:
        return html_of(self._grid())


def text_of(grid: Grid) -> str:
    """A table for a terminal: no more rows than fit a screen, and how many more there are."""
    shown = [
        grid.headings,
        *([shortened(visible(cell), _CELL) for cell in row] for row in grid.rows[:ROWS]),
    ]
    whole = (visible(grid.title), *aligned(shown), *_more(len(grid.rows) - ROWS))
    lines = [shortened(line, WIDTH) for line in whole]
    remarks = grid.note.splitlines()
    for remark in remarks[:REMARKS]:
        lines += textwrap.wrap(visible(remark), WIDTH, subsequent_indent="  ")
    return "\n".join([*lines, *_more(len(remarks) - REMARKS)])


def html_of(grid: Grid) -> str:
    """A table for a notebook: every row; what comes from files is escaped."""

    def cells(texts: tuple[str, ...], tag: str) -> str:
        return "".join(f"<{tag}>{escape(visible(text))}</{tag}>" for text in texts)

    body = "".join(f"<tr>{cells(row, 'td')}</tr>" for row in grid.rows)
    under = "".join(f"<p>{escape(visible(remark))}</p>" for remark in grid.note.splitlines())
    caption = f"<caption>{escape(visible(grid.title))}</caption>"
    head = f"<thead><tr>{cells(grid.headings, 'th')}</tr></thead>"
    return f"<table>{caption}{head}<tbody>{body}</tbody></table>{under}"


def _more(count: int) -> list[str]:
    return [f"... and {count} more"] if count > 0 else []
