"""Lines of progress, with the time left: of a run, of files being read; on stderr and only for a terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from model.units import RPM
from rig.commands.terminal import console
from rig.run.progress import in_words

if TYPE_CHECKING:
    from rich.progress import ProgressColumn

    from experiments.recording import Event
    from rig.run.parts import Progress

    Listeners = tuple[Callable[[Progress], None], Callable[[Event], None]]
    """What to call with progress, and with events."""

_STYLES = {"warning": "yellow", "error": "red"}
"""How events are told that are more than information, by their level."""
_REDRAW_INTERVAL = 0.1
"""s of wall time between two redraws; a rig in virtual time reports far more often."""


def _columns() -> tuple[ProgressColumn, ...]:
    """What the line of a run shows."""
    from rich.progress import BarColumn

    from rig.commands.visible import plain_column

    return (
        plain_column("{task.description}"),
        BarColumn(),
        plain_column("{task.fields[left]} left"),
        plain_column("{task.fields[speed]:>8.1f} r/min"),
        plain_column("step {task.fields[step]}: {task.fields[what]}"),
        plain_column("margin {task.fields[margin]}"),
    )


@contextmanager
def progress_line(title: str, duration: float, quiet: bool = False) -> Iterator[Listeners]:
    """Draws while the block runs; yields what to call with progress and with events. Silent without a terminal."""
    if quiet or not sys.stderr.isatty():
        yield _nothing, _nothing
        return
    from rich.progress import Progress as Bar

    out = console(errors=True)
    with Bar(*_columns(), console=out, transient=True) as bar:
        task = bar.add_task(
            title,
            total=duration,
            left=in_words(duration),
            speed=0.0,
            step="",
            what="preflight",
            margin="-",
        )
        last = [-_REDRAW_INTERVAL]

        def on_progress(now: Progress) -> None:
            instant = time.monotonic()
            if instant - last[0] < _REDRAW_INTERVAL:
                return
            last[0] = instant
            bar.update(
                task,
                completed=now.elapsed,
                total=now.elapsed + now.left,
                left=in_words(now.left),
                speed=now.speed / RPM,
                step=f"{now.step}/{now.steps}",
                what=now.what,
                margin=f"{100.0 * now.margin:.0f} % {now.nearest.replace('_', ' ')}",
            )

        def on_event(event: Event) -> None:
            if style := _STYLES.get(event.level):
                out.print(f"{event.level}: {event.text}", style=style)

        yield on_progress, on_event


@contextmanager
def reading_bar(title: str, quiet: bool = False) -> Iterator[Callable[[int, int], None]]:
    """A bar with the time left, drawn once there is something to count; yields what to call with (done, of)."""
    if quiet or not sys.stderr.isatty():
        yield lambda done, of: None
        return
    from rich.progress import BarColumn, MofNCompleteColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    from rig.commands.visible import plain_column

    columns = (
        plain_column("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        plain_column("left"),
    )
    with Bar(*columns, console=console(errors=True), transient=True) as bar:
        task = bar.add_task(title, total=None, visible=False)
        yield lambda done, of: bar.update(task, completed=done, total=of, visible=True)


def _nothing(_: object) -> None:
    return None
