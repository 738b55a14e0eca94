"""Results as tables on a terminal: value ± U, unit, 95 % interval, whether the data identify it;
then what to beware of.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console

    from experiments.result import Result, Verdict

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

    out.print()
    out.print(Text(heading or f"{result.kind} of run {result.run}", style="bold"))
    if result.estimates:
        out.print(estimate_table(result))
    notes = [
        (result.quantity(n).titled(n), e.note)
        for n, e in result.estimates.items()
        if e.note and e.identifiable != "yes"
    ]
    for name, note in notes:
        out.print(Text(f"  {name}: {note}", style="dim"))
    print_metrics(out, result)
    for verdict in result.verdicts:
        line = Text.assemble("  ", (verdict.outcome, VERDICT_STYLE.get(verdict.outcome, "")))
        out.print(line.append(verdict_sentence(result, verdict)))
    print_warnings(out, result.warnings)


def print_metrics(out: Console, result: Result) -> None:
    """The figures of merit of a result."""
    from rich.text import Text

    from rig.analysis.wording import metric_text

    if not result.metrics:
        return
    grid = _grid()
    for name, value in result.metrics.items():
        quantity = result.quantity(name)
        grid.add_row(Text(quantity.titled(name)), Text(metric_text(quantity, float(value))))
    out.print(grid)


def verdict_sentence(result: Result, verdict: Verdict) -> str:
    """What was judged: the value and the limit that it was held against."""
    from rig.present.content import held_against

    value, limit = held_against(result, verdict)
    source = f"{verdict.limit_provenance}: {verdict.limit_source}"
    return f"  {verdict.name}: {value}, limit {limit} ({source})"


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

    from rig.analysis.wording import show

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("quantity")
    table.add_column("value ± U (k = 2)", justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    table.add_column("95 % interval", no_wrap=True)
    table.add_column("identifiable", no_wrap=True)
    for name, estimate in result.estimates.items():
        quantity = result.quantity(name)
        shown = show(estimate, quantity)
        verdict = Text(estimate.identifiable, style=IDENTIFIABLE_STYLE[estimate.identifiable])
        table.add_row(
            Text(quantity.titled(name)),
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
