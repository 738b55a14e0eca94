"""Results as tables on a terminal: value ± U, unit, 95 % interval, whether the data identify it;
then what to beware of.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console

    from experiments.result import Result

VERDICT_STYLE = {
    "PASS": "bold green",
    "MARGINAL": "bold yellow",
    "FAIL": "bold red",
    "no verified limit": "dim",
}
IDENTIFIABLE_STYLE = {"yes": "green", "weakly": "yellow", "no": "red"}


def console(*, errors: bool = False) -> Console:
    """A terminal that does not guess at colours and links inside our text."""
    from rich.console import Console

    return Console(stderr=errors, highlight=False, markup=False)


def print_result(out: Console, result: Result, heading: str = "") -> None:
    """One analysed run on the terminal."""
    from rich.text import Text

    from rig.analysis.wording import readable

    out.print()
    out.print(Text(heading or f"{result.kind} of run {result.run}", style="bold"))
    if result.estimates:
        out.print(estimate_table(result))
    notes = [
        (readable(n), e.note)
        for n, e in result.estimates.items()
        if e.note and e.identifiable != "yes"
    ]
    for name, note in notes:
        out.print(Text(f"  {name}: {note}", style="dim"))
    print_metrics(out, result)
    for verdict in result.verdicts:
        line = Text.assemble("  ", (verdict.outcome, VERDICT_STYLE.get(verdict.outcome, "")))
        line.append(f"  {verdict.name}: {verdict_sentence(verdict)}")
        out.print(line)
    print_warnings(out, result.warnings)


def print_metrics(out: Console, result: Result) -> None:
    """The figures of merit of a result."""
    from rich.text import Text

    from rig.analysis.wording import metric, readable

    if not result.metrics:
        return
    grid = _grid()
    for name, value in result.metrics.items():
        grid.add_row(Text(readable(name)), Text(metric(result.kind, name, float(value))))
    out.print(grid)


def verdict_sentence(verdict: Any) -> str:
    """What was found against which limit."""
    from rig.analysis.wording import display_unit, number, show

    estimate = verdict.estimate
    shown = show(estimate)
    factor, unit = display_unit(estimate.name, estimate.unit, estimate.value)
    limit = f"{number(verdict.limit / factor)} {unit}".rstrip()
    return f"{shown.with_uncertainty}, limit {limit} ({verdict.limit_provenance}: {verdict.limit_source})"


def print_warnings(out: Console, warnings: tuple[str, ...] | list[str]) -> None:
    """Warnings, each on its own line."""
    from rich.text import Text

    for warning in warnings:
        out.print(Text.assemble(("  warning  ", "bold yellow"), warning))


def estimate_table(result: Result) -> Any:
    """The estimates of a result as a rich table."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    from rig.analysis.wording import readable, show

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("quantity")
    table.add_column("value ± U (k = 2)", justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    table.add_column("95 % interval", no_wrap=True)
    table.add_column("identifiable", no_wrap=True)
    for name, estimate in result.estimates.items():
        shown = show(estimate)
        verdict = Text(estimate.identifiable, style=IDENTIFIABLE_STYLE[estimate.identifiable])
        table.add_row(
            Text(readable(name)),
            f"{shown.value} ± {shown.expanded or '?'}",
            shown.unit,
            f"{shown.low} … {shown.high}",
            verdict,
        )
    return table


def _grid() -> Any:
    from rich.table import Table

    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="dim")
    grid.add_column(justify="right")
    return grid
