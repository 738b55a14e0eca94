"""What `rig demo` shows on a terminal: progress with time left, then what was found and where the files are."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator

from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from rig.analysis.wording import number, show
from rig.commands.result_tables import VERDICT_STYLE, print_warnings, verdict_sentence
from rig.commands.terminal import console, ruled_table
from rig.commands.visible import Text
from rig.trial.demo.chain import Demonstration
from rig.trial.demo.work import ORDER, Finished, Step


@contextlib.contextmanager
def progress(quiet: bool) -> Iterator[Callable[[Step | Finished], None]]:
    """Bars on a terminal, one line per finished protocol elsewhere, nothing when quiet. Everything goes to stderr."""
    if quiet:
        yield lambda message: None
    elif sys.stderr.isatty():
        with _bars() as show:
            yield show
    else:
        yield _line


def _line(message: Step | Finished) -> None:
    if isinstance(message, Finished):
        done = "run and fitted" if message.result is not None else "ended"
        sys.stderr.write(
            f"{message.protocol}: {message.outcome}, {done} in {message.seconds:.1f} s\n"
        )


@contextlib.contextmanager
def _bars() -> Iterator[Callable[[Step | Finished], None]]:
    columns = (
        TextColumn("{task.description:<16}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[what]}"),
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


def print_demonstration(demonstration: Demonstration) -> None:
    """What was found, and where the files are."""
    out = console()
    numbers = ("found ± U", "truth", "|Δ| / U")
    rows = ruled_table("quantity", *numbers, "in U", numbers=numbers, whole=numbers)
    results = {fit.result.kind: fit.result for fit in demonstration.fits}
    last = ""
    for kind, row in demonstration.truth:
        if row.estimate.name.startswith("phase_"):
            continue
        quantity = results[kind].quantity(row.estimate.name)
        if kind != last:
            rows.add_row(Text(kind, style="bold"))
            last = kind
        shown, u = show(row.estimate, quantity), row.estimate.expanded_uncertainty
        truth = shown.number(row.estimate.value - row.difference)
        rows.add_row(
            "  " + quantity.titled(row.estimate.name).removesuffix(", amplitude"),
            shown.with_uncertainty,
            truth,
            number(abs(row.difference) / u, 2) if u > 0 else "–",
            Text("yes", style="green") if row.within else Text("no", style="yellow"),
        )
    out.print()
    out.print(
        Text("SIMULATED: what was found, and what the simulated gear was made of", style="bold")
    )
    out.print(rows)
    covered, within = (
        sum(getattr(row, what) for _, row in demonstration.truth) for what in ("covered", "within")
    )
    of = f"of {len(demonstration.truth)} true values (phases included)"
    out.print(Text(f"{covered} {of} lie in the statistical part, {within} within ± U (95 %).\n"))
    for fit in demonstration.fits:
        for verdict in fit.result.verdicts:
            line = Text.assemble("  ", (verdict.outcome, VERDICT_STYLE.get(verdict.outcome, "")))
            out.print(line.append(verdict_sentence(fit.result, verdict)))
        print_warnings(out, [f"{fit.result.kind}: {w}" for w in fit.result.warnings])
    out.print()
    for name, path in (
        ("report", demonstration.report),
        ("parameter set", demonstration.parameters),
    ):
        out.print(Text(f"  {name:<14} {path}"), soft_wrap=True)
    for done in demonstration.finished:
        out.print(Text(f"  {done.protocol:<14} {done.path}"), soft_wrap=True)
    out.print(Text(f"\nDone in {demonstration.seconds:.0f} s.", style="dim"))
