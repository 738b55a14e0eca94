"""What every command writes to a terminal with: a console that guesses at nothing, a table, one JSON object."""

from __future__ import annotations

import contextlib
import itertools
import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions
    from rich.table import Table

    from rig.commands.visible import Text
    from rig.content.grid import Grid

# Every start of `rig` imports this module; what writing needs is imported when something is written.


def console(*, errors: bool = False, highlight: bool = False) -> Console:
    """A terminal that does not guess at links and marks inside our text, nor at colours unless asked to."""
    from rig.commands.visible import VisibleConsole

    return VisibleConsole(stderr=errors, highlight=highlight)


def echo(text: str, *, errors: bool = False, is_line: bool = True) -> None:
    """A line on standard output, or on that of the errors, with nothing in it that a terminal obeys.

    Not `is_line`: what is written next goes on behind it.
    """
    from rig.content.wording import visible

    typer.echo(visible(text), err=errors, nl=is_line)


STYLES = {"good": "green", "warning": "yellow", "bad": "bold red", "muted": "dim"}
"""How the tone of a word looks on a terminal."""


def toned(text: str) -> Text:
    """A text that begins with a word of a verdict, in the colour of its tone; any other as it is."""
    from rig.commands.visible import Text
    from rig.content.grid import tone_of

    return Text(text, style=STYLES.get(tone_of(text) or "", ""))


_ON_ONE_LINE = {"no_wrap": True, "overflow": "ellipsis"}
_LOOKS: Mapping[str, Mapping[str, Any]] = {
    "number": {"justify": "right", **_ON_ONE_LINE},
    "unit": _ON_ONE_LINE,
    "name": {"style": "dim"},
}
"""How rich sets a column by what stands in it; text to the left, and in the next line where it is long."""
HIGHEST_ROW = 2
"""Lines of a row in a table. What needs more is left out, and said to be."""


def painted(grid: Grid, **look: Any) -> FittedTable:
    """A grid as a table under its title, its note below. Numbers and units stand on one line; text goes on in the next.

    `look` is what rich's table takes.
    """
    return FittedTable(grid, look)


class FittedTable:
    """A grid that is painted when its width is known: with the columns with which no row is higher than two lines.

    The first column, which names the row, always stands. What was left out is said below: a wider terminal shows it, as
    `--json` does.
    """

    def __init__(self, grid: Grid, look: Mapping[str, Any]) -> None:
        self.grid, self.look = grid, look

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Table | Text]:
        from rig.commands.visible import Text

        shown, left_out = self.fitted(console, options)
        yield self.table(shown)
        if left_out:
            yield Text(
                f"{options.max_width} columns leave out: {', '.join(left_out)}.", style="dim"
            )

    def fitted(self, console: Console, options: ConsoleOptions) -> tuple[Grid, list[str]]:
        """The grid without the columns that have no room, and their headings as they stand.

        Where nothing helps, sentences stand beside the first column alone, and a word that has no room anywhere is
        folded where it stands.
        """
        left_out: tuple[str, ...] = ()
        for left_out in self.choices():
            if self._has_room(self.grid.without(*left_out), console, options):
                break
        else:
            if not any(one.kind == "sentence" for one in self.grid.columns):
                left_out = ()
        return self.grid.without(*left_out), [h for h in self.grid.headings if h in left_out]

    def choices(self) -> Iterator[tuple[str, ...]]:
        """What may be left out, by the headings: as few columns of text as will do, the rightmost first; then numbers
        as well, from the right. The first column and sentences always stand, of numbers the first.
        """
        others = [one for one in reversed(self.grid.columns[1:]) if one.kind != "sentence"]
        texts = [one.heading for one in others if one.kind == "text"]
        numbers = [one.heading for one in others if one.kind != "text"]
        for count in range(len(texts) + 1):
            yield from itertools.combinations(texts, count)
        for count in range(1, len(numbers)):
            yield (*texts, *numbers[:count])

    def _has_room(self, grid: Grid, console: Console, options: ConsoleOptions) -> bool:
        """Whether no row of the grid takes more than two lines at this width, and no word is cut."""
        from rich.cells import cell_len

        # rich has no public word for the widths that it will paint with.
        table = self.table(grid)
        room = options.update_width(options.max_width - table._extra_width)
        widths = table._calculate_column_widths(console, room)
        for place, (column, width) in enumerate(zip(grid.columns, widths, strict=True)):
            inner = max(width - (place < len(widths) - 1), 1)
            if column.kind == "hash":
                continue
            if table.columns[place].no_wrap:
                if any(cell_len(row[place]) > inner for row in grid.rows):
                    return False
                continue
            for row in grid.rows:
                # Most cells stand on one line: wrapping each of thousands would take longer than to paint them.
                if cell_len(row[place]) <= inner and "\n" not in row[place]:
                    continue
                cell = console.render_str(row[place])
                if max(map(len, cell.plain.split()), default=0) > inner:
                    return False
                if len(cell.wrap(console, inner, overflow="fold")) > HIGHEST_ROW:
                    return False
        return True

    def table(self, grid: Grid) -> Table:
        """The grid in rich's words."""
        from rich import box
        from rich.table import Table

        plain = {
            "box": box.SIMPLE_HEAD,
            "pad_edge": False,
            "padding": (0, 1, 0, 0),
            "title_style": "bold",
        }
        sides = {"title_justify": "left", "caption_justify": "left"}
        texts = {"title": grid.title or None, "caption": grid.note or None}
        rows = Table(**{**plain, **sides, **texts, **self.look})
        for column in grid.columns:
            look = {"overflow": "fold", **_LOOKS.get(column.kind, {})}
            rows.add_column(column.heading, **look)
        are_words = [one.kind == "word" for one in grid.columns]
        for row in grid.rows:
            cells = zip(row, are_words, strict=True)
            rows.add_row(*(toned(text) if is_word else text for text, is_word in cells))
        return rows


def fact_table(facts: Iterable[tuple[str, str]], title: str = "") -> Table:
    """Facts, one a line: what it is called, and what it is; a long one goes on below itself."""
    from rig.content.grid import Grid, columns

    grid = Grid(title, columns(("", "name"), ""), list(facts))
    look = {"box": None, "show_header": False, "padding": (0, 2, 0, 0)}
    return FittedTable(grid, look).table(grid)


Json = Annotated[
    bool,
    typer.Option("--json", help="Print one JSON object on standard output and nothing else."),
]
"""The flag of every command that a script calls."""


def print_json(value: Any) -> None:
    """The one object that `--json` promises on standard output."""
    from rig.analysis.store import json_text
    from rig.content.wording import visible

    typer.echo(visible(json_text(value)))


class _LastingStream:
    """A standard stream that goes silent when nobody is at its other end any more, and raises nothing."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write a text, or lose it."""
        try:
            return int(self._stream.write(text))
        except (OSError, ValueError):
            self._let_go()
            return len(text)

    def flush(self) -> None:
        """Write what is buffered, or lose it."""
        try:
            self._stream.flush()
        except (OSError, ValueError):
            self._let_go()

    def _let_go(self) -> None:
        # What is still buffered would fail again at the exit, and change its code.
        with contextlib.suppress(OSError, ValueError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._stream.fileno())
            os.close(nowhere)


def tell_if_deaf() -> None:
    """Say how a run is stopped that was started in the background, where a shell has Ctrl-C ignored."""
    import signal

    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        how = f"stop it by `kill {os.getpid()}` (SIGTERM)"
        echo(f"SIGINT is ignored in this process (started in the background): {how}", errors=True)


@contextlib.contextmanager
def outliving_the_terminal() -> Iterator[None]:
    """Standard output and error that may end (a closed terminal, a reader that has gone) and raise nothing:
    what a run has to say must not cost its ramp or its file.
    """
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = lasting = cast(Any, tuple(_LastingStream(s) for s in before))
    try:
        yield
    finally:
        for stream in lasting:
            stream.flush()
        sys.stdout, sys.stderr = before
