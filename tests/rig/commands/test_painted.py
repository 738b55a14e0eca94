"""A grid on the terminal: its title, its note, every letter of its texts, and the colours of its words."""

from __future__ import annotations

import io

from rig.commands.terminal import painted
from rig.commands.visible import VisibleConsole
from rig.content.grid import Grid, columns

LONG = "a-word-that-is-much-longer-than-the-column-has-room-for"
GRID = Grid(
    "A title",
    columns("what", ("value", "number"), ("agrees", "word")),
    [(LONG, "1.25", "no"), ("short", "17.5", "yes")],
    "a note",
)


def shown(grid: Grid, *, colours: bool = False) -> str:
    written = io.StringIO()
    look = "standard" if colours else None
    VisibleConsole(file=written, width=40, force_terminal=colours, color_system=look).print(
        painted(grid)
    )
    return written.getvalue()


def test_a_grid_brings_its_title_and_its_note_and_loses_no_letter() -> None:
    lines = [line.split() for line in shown(GRID).splitlines()]
    assert lines[0] == ["A", "title"]
    assert ["a", "note"] in lines
    rows = lines[4 : lines.index(["short", "17.5", "yes"])]
    assert "".join(row[0] for row in rows) == LONG
    assert rows[0][1:] == ["1.25", "no"]


def test_words_of_a_verdict_have_the_colours_of_their_tones() -> None:
    text = shown(GRID, colours=True)
    assert "\x1b[1;31mno" in text
    assert "\x1b[32myes" in text
