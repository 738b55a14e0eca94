"""What every command writes to a terminal with: a console that guesses at nothing, a table, one JSON object."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, cast

import typer

if TYPE_CHECKING:
    from rich.console import Console
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


def painted(grid: Grid, **look: Any) -> Table:
    """A grid as a table under its title, its note below. Numbers and units stand on one line; text goes on in the next.

    `look` is what rich's table takes.
    """
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
    rows = Table(**{**plain, **sides, **texts, **look})
    for column in grid.columns:
        whole = column.kind in ("number", "unit")
        rows.add_column(
            column.heading,
            justify="right" if column.kind == "number" else "left",
            style="dim" if column.kind == "name" else "",
            no_wrap=whole,
            overflow="ellipsis" if whole else "fold",
        )
    are_words = [one.kind == "word" for one in grid.columns]
    for row in grid.rows:
        cells = zip(row, are_words, strict=True)
        rows.add_row(*(toned(text) if is_word else text for text, is_word in cells))
    return rows


def fact_table(facts: Iterable[tuple[str, str]], title: str = "") -> Table:
    """Facts, one a line: what it is called, and what it is."""
    from rig.content.grid import Grid, columns

    heads = columns(("", "name"), "")
    return painted(
        Grid(title, heads, list(facts)), box=None, show_header=False, padding=(0, 2, 0, 0)
    )


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


def nearest(word: str, words: Sequence[str]) -> str:
    """What may have been meant by a word that there is not, else all that there are."""
    import difflib

    near = difflib.get_close_matches(word, words, n=2, cutoff=0.5)
    return f"Did you mean {' or '.join(near)}?" if near else f"There are: {', '.join(words)}."
