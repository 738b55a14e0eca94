"""What a command prints, table by table, held against the width of a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import pytest
from rich.table import Table
from typer.testing import CliRunner

from rig.commands.terminal import HIGHEST_ROW, FittedTable
from rig.commands.visible import VisibleConsole
from rig.content.grid import Grid
from rig.main import app

WIDTHS = (80, 100, 160)


@dataclass(frozen=True)
class Printed:
    """A table as it stood on a console, and the grid behind it."""

    console: VisibleConsole
    grid: Grid
    table: Table

    def troubles(self) -> Iterator[str]:
        """What is cut, too high or too wide."""
        room = self.console.options.update_width(self.console.width - self.table._extra_width)
        widths = self.table._calculate_column_widths(self.console, room)
        if sum(widths) + self.table._extra_width > self.console.width:
            yield f"{self.grid.headings}: {sum(widths)} wide"
        for place, (column, width) in enumerate(zip(self.grid.columns, widths, strict=True)):
            inner = width - (place < len(widths) - 1)
            for row in self.grid.rows:
                text = self.console.render_str(row[place])
                lines = text.wrap(self.console, max(inner, 1), overflow="fold")
                if column.kind in ("number", "unit") and len(text) > inner:
                    yield f"{column.heading}: {text.plain!r} is cut"
                if column.kind == "sentence" or column.kind == "hash":
                    continue
                if len(lines) > HIGHEST_ROW:
                    yield f"{column.heading}: {text.plain!r} has {len(lines)} lines"
                if any(len(word) > inner for word in text.plain.split()):
                    yield f"{column.heading}: {text.plain!r} has a cut word"


@dataclass(frozen=True)
class Lines:
    """Facts or findings as they stood on a console, which go on below themselves and leave nothing out."""

    console: VisibleConsole
    table: Table

    def troubles(self) -> Iterator[str]:
        """What is cut or too wide. A word that is longer than a third of a line (a path, a hash) may be folded."""
        lines = self.console.render_lines(self.table, self.console.options, pad=False)
        told = ["".join(part.text for part in line).rstrip() for line in lines]
        yield from (
            f"{line!r} is {len(line)} wide" for line in told if len(line) > self.console.width
        )
        printed = set(" ".join(told).split())
        for column in self.table.columns:
            for cell in column.cells:
                for word in self.console.render_str(str(cell)).plain.split():
                    if word not in printed and len(word) <= self.console.width // 3:
                        yield f"{word!r} is cut"


def tables_of(words: Sequence[str], monkeypatch: pytest.MonkeyPatch) -> list[Printed | Lines]:
    """Every table that a command prints, at each width: no row higher than two lines, no cut word, no line over it."""
    printed: list[Printed | Lines] = []
    plain = VisibleConsole.print

    def noting(console: VisibleConsole, *objects: Any, **look: Any) -> None:
        for one in objects:
            if isinstance(one, FittedTable):
                shown, left_out = one.fitted(console, console.options)
                assert set(shown.headings) | set(left_out) == set(one.grid.headings)
                printed.append(Printed(console, shown, one.table(shown)))
            elif isinstance(one, Table):
                printed.append(Lines(console, one))
        plain(console, *objects, **look)

    with monkeypatch.context() as patched:
        patched.setattr(VisibleConsole, "print", noting)
        for width in WIDTHS:
            printed.clear()
            answer = CliRunner().invoke(app, list(words), env={"COLUMNS": str(width)})
            # A refused description is told as a table too.
            assert answer.exit_code in ((0, 1, 2, 3) if printed else (0, 1, 3)), answer.output
            troubles = [trouble for one in printed for trouble in one.troubles()]
            assert not troubles, (width, *troubles)
    return printed


@contextmanager
def every_table_has_room() -> Iterator[list[str]]:
    """Holds every table that commands print meanwhile against the three widths; gives the titles of what it saw."""
    seen: list[str] = []
    troubles: list[str] = []
    plain = VisibleConsole.print

    def noting(console: VisibleConsole, *objects: Any, **look: Any) -> None:
        for one in objects:
            if isinstance(one, FittedTable):
                seen.append(one.grid.title)
                for width in WIDTHS:
                    wide = VisibleConsole(width=width)
                    shown, _ = one.fitted(wide, wide.options)
                    troubles.extend(Printed(wide, shown, one.table(shown)).troubles())
        plain(console, *objects, **look)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(VisibleConsole, "print", noting)
        yield seen
    assert seen, "no table was printed"
    assert not troubles
