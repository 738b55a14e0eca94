"""Results as tables on a terminal: value ± U, unit, statistical part, whether the data identify it;
then what to beware of.
"""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from experiments.result import Result, Verdict
from rig.analysis.judging import GearVerdict
from rig.analysis.wording import STATISTICAL_PART, metric_text, show
from rig.commands.terminal import ruled_table
from rig.commands.visible import Text
from rig.present.content import held_against

VERDICT_STYLE = {
    "PASS": "bold green",
    "MARGINAL": "bold yellow",
    "FAIL": "bold red",
    "NOT JUDGED": "dim",
}
IDENTIFIABLE_STYLE = {"yes": "green", "weakly": "yellow", "no": "red"}


def print_result(out: Console, result: Result, heading: str = "") -> None:
    """One analysed run on the terminal."""
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
    for check in result.checks:
        if check.outcome == "not checked":
            out.print(Text(f"  not checked  {check.name}: {check.words}", style="dim"))


def print_metrics(out: Console, result: Result) -> None:
    """The figures of merit of a result."""
    if not result.metrics:
        return
    grid = _grid()
    for name, value in result.metrics.items():
        quantity = result.quantity(name)
        grid.add_row(Text(quantity.titled(name)), Text(metric_text(quantity, float(value))))
    out.print(grid)


def verdict_sentence(result: Result, verdict: Verdict) -> str:
    """What was judged: the value and the limit that it was held against."""
    value, limit = held_against(result, verdict)
    source = f"{verdict.limit_provenance}: {verdict.limit_source}"
    because = f"; {verdict.because}" if verdict.because else ""
    return f"  {verdict.name}: {value}, limit {limit} ({source}){because}"


def print_gear_verdict(out: Console, verdict: GearVerdict) -> None:
    """The one verdict on a gear, and why it is not a better one."""
    out.print(Text.assemble("verdict  ", (verdict.verdict, VERDICT_STYLE[verdict.verdict])))
    for reason in verdict.because:
        out.print(Text(f"  {reason}"), soft_wrap=True)


def print_warnings(out: Console, warnings: tuple[str, ...] | list[str]) -> None:
    """Warnings, each on its own line."""
    for warning in warnings:
        out.print(Text.assemble(("  warning  ", "bold yellow"), warning))


def estimate_table(result: Result) -> Table:
    """The estimates of a result as a rich table."""
    value = "value ± U (95 %)"
    facts = ("unit", STATISTICAL_PART, "identifiable")
    estimates = ruled_table("quantity", value, *facts, numbers=(value,), whole=(value, *facts))
    for name, estimate in result.estimates.items():
        quantity = result.quantity(name)
        shown = show(estimate, quantity)
        verdict = Text(estimate.identifiable, style=IDENTIFIABLE_STYLE[estimate.identifiable])
        estimates.add_row(
            Text(quantity.titled(name)),
            f"{shown.value} ± {shown.expanded or '?'}",
            shown.unit,
            f"{shown.low} … {shown.high}",
            verdict,
        )
    return estimates


def _grid() -> Table:
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="dim")
    grid.add_column(justify="right")
    return grid
