"""What `rig demo` shows on a terminal: progress with time left, then what was found and where the files are."""

from __future__ import annotations

import contextlib
import sys
import threading
from collections.abc import Callable, Iterator, Mapping

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TimeRemainingColumn

from experiments.result import Result
from rig.analysis.rows import truth_grid
from rig.commands.result_tables import print_verdict, print_warnings
from rig.commands.terminal import console, echo, painted
from rig.commands.visible import Text, plain_column
from rig.content.wording import show
from rig.trial.demo.chain import ORDER, Demonstration, Finished, Step
from rig.trial.demo.first_screen import first_screen


@contextlib.contextmanager
def progress(quiet: bool) -> Iterator[Callable[[Step | Finished], None]]:
    """Bars on a terminal, one line per finished protocol elsewhere, nothing when quiet. Everything goes to stderr."""
    if quiet:
        yield lambda message: None
    elif sys.stderr.isatty():
        with _bars() as show:
            yield show
    else:
        with beating(lines := Lines()):
            yield lines.show


EVERY = 5.0
"""s between two lines of progress where there is no terminal."""


_WRITING = "writing report and certificate"


class Lines:
    """Progress as lines: one for each protocol that ended, and where it stands whenever it is asked."""

    def __init__(self) -> None:
        self._stands = "starting: the first start compiles what is computed"
        self._said = ""

    def show(self, message: Step | Finished) -> None:
        """Take up what a demonstration tells."""
        if isinstance(message, Finished):
            done = f"{message.protocol}: {message.outcome} in {message.seconds:.1f} s"
            sys.stderr.write(f"{done}\n")
            last = message.protocol == ORDER[-1]
            self._stands = _WRITING if last else f"after {message.protocol}"
        else:
            self._stands = (
                f"{message.protocol}: {message.what}, {message.left:.0f} s of the rig left"
            )

    def beat(self) -> None:
        """Say where it stands; that the pages are written, which is the last of it, once."""
        if self._said == self._stands == _WRITING:
            return
        self._said = self._stands
        sys.stderr.write(f"{self._stands}\n")
        sys.stderr.flush()


@contextlib.contextmanager
def beating(lines: Lines, every: float = EVERY) -> Iterator[None]:
    """Where it stands, every so many seconds, from a thread: nothing else speaks while kernels are compiled."""
    over = threading.Event()

    def beat() -> None:
        while not over.wait(every):
            lines.beat()

    thread = threading.Thread(target=beat, name="progress", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


@contextlib.contextmanager
def _bars() -> Iterator[Callable[[Step | Finished], None]]:
    columns = (
        plain_column("{task.description:<16}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(),
        plain_column("{task.fields[what]}"),
    )
    with Progress(*columns, console=console(errors=True, highlight=True), transient=True) as bars:
        tasks = {name: bars.add_task(name, total=1.0, what="waiting") for name in ORDER}

        def show(message: Step | Finished) -> None:
            task = tasks[message.protocol]
            if isinstance(message, Finished):
                bars.update(task, completed=1.0, what=f"{message.outcome}, {message.seconds:.1f} s")
                return
            share = message.done / max(message.done + message.left, 1e-9)
            bars.update(task, completed=0.9 * share, what=message.what)

        yield show


_ELSEWHERE = ("test", "|Δ| / U", "this bench sees", "in the statistical part")
"""Columns of the truth that a terminal of eighty letters has no room for; the report has them."""


def _print_misses(
    out: Console, demonstration: Demonstration, results: Mapping[str, Result]
) -> None:
    """Every row that misses one of its truths, phases included, and which one."""
    for kind, row in demonstration.truth:
        estimate, quantity = row.estimate, results[kind].quantity(row.estimate.name)
        shown = show(estimate, quantity)
        what = f"{kind}: {quantity.titled(estimate.name)} {shown.with_uncertainty}"
        if not row.within:
            truth = shown.number(estimate.value - row.error)
            out.print(Text(f"  misses the measurand       {what}, true {truth}", style="yellow"))
        if not row.covered:
            truth = shown.number(estimate.value - row.difference)
            inside = f"[{shown.low}, {shown.high}]"
            out.print(Text(f"  misses what the bench sees {what}, {inside}, true {truth}"))
    out.print()


def print_demonstration(demonstration: Demonstration, *, everything: bool = False) -> None:
    """One screen: verdict, numbers beside the truth, what to look out for. With `everything` all of it first."""
    if everything:
        _print_everything(demonstration)
    for line in first_screen(demonstration):
        echo(line)


def _print_everything(demonstration: Demonstration) -> None:
    """Every number beside both truths, every warning, every limit, and where the files are."""
    out = console()
    results = {fit.result.kind: fit.result for fit in demonstration.fits}
    out.print()
    out.print(
        Text("SIMULATED: what was found, and what the simulated gear was made of", style="bold")
    )
    for kind, result in results.items():
        told = [
            row
            for row in demonstration.truth
            if row[0] == kind and not row[1].estimate.name.startswith("phase_")
        ]
        grid = truth_grid(told, [result]).without(*_ELSEWHERE)
        out.print(painted(grid, title=kind))
    out.print(
        Text(
            "found ± U is held against the measurand: gear or motor alone, at the run's temperature."
        )
    )
    covered, within = (
        sum(getattr(row, what) for _, row in demonstration.truth) for what in ("covered", "within")
    )
    out.print(
        Text(
            f"Of {len(demonstration.truth)} rows (phases included) {within} lie within ± U, "
            f"{covered} in the statistical part.\n"
        )
    )
    _print_misses(out, demonstration, results)
    for fit in demonstration.fits:
        print_warnings(out, [f"{fit.result.kind}: {w}" for w in fit.result.warnings])
    print_verdict(out, demonstration.campaign.verdict)
    out.print()
    for name, path in (
        *(("certificate", path) for path in demonstration.certificate),
        ("report", demonstration.report),
        ("parameter set", demonstration.parameters),
    ):
        out.print(Text(f"  {name:<14} {path}"), soft_wrap=True)
    for done in demonstration.finished:
        out.print(Text(f"  {done.protocol:<14} {done.path}"), soft_wrap=True)
    out.print(Text(f"\nDone in {demonstration.seconds:.0f} s.", style="dim"))
