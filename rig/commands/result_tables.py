"""Results as tables on a terminal: value ± U, unit, whether the data identify it; then what to beware of."""

from __future__ import annotations

from rich.console import Console

from experiments.assumed import replacing
from experiments.finding import Severity
from experiments.result import Result
from rig.analysis.judging import GearVerdict
from rig.analysis.rows import (
    LIMIT,
    estimate_grid,
    metric_grid,
    proof_words,
    statistical_grid,
)
from rig.commands.judgement import verdict_text
from rig.commands.terminal import painted, toned
from rig.commands.visible import Text
from rig.content.phrase import phrase


def print_result(
    out: Console,
    result: Result,
    heading: str = "",
    verdict: GearVerdict | None = None,
    *,
    everything: bool = False,
) -> None:
    """One analysed run on the terminal, with what it is worth where that is known.

    With `everything` the statistical part of every interval as well.
    """
    out.print()
    out.print(Text(heading or f"{result.kind} of run {result.run}", style="bold"))
    if result.estimates:
        grid = estimate_grid(result)
        out.print(painted(grid.without(LIMIT, "remark"), title=None))
        if everything:
            out.print(painted(statistical_grid(result)))
    notes = [
        (result.quantity(n).titled(n), e.note)
        for n, e in result.estimates.items()
        if e.note and e.identifiable != "yes"
    ]
    for name, note in notes:
        out.print(Text(f"  {name}: {note}", style="dim"), soft_wrap=True)
    for kind, how in replacing(result.estimates.values()).items():
        words = f"  {kind} is assumed; what states it: {how}"
        out.print(Text(words, style="dim"), soft_wrap=True)
    print_metrics(out, result)
    if verdict is not None:
        print_verdict(out, verdict)
    print_proof(out, result)
    print_warnings(out, result.warnings)
    for check in result.checks:
        if check.severity is Severity.NOT_LOOKED_AT:
            out.print(Text(f"  not checked  {check.sentence}", style="dim"), soft_wrap=True)


def print_proof(out: Console, result: Result) -> None:
    """What a run along a compensation table proved; nothing of every other."""
    if words := proof_words(result):
        out.print(Text.assemble(("  proof  ", "bold"), words), soft_wrap=True)


def print_metrics(out: Console, result: Result) -> None:
    """The figures of merit of a result."""
    if result.metrics:
        out.print(painted(metric_grid(result)))


def print_verdict(out: Console, verdict: GearVerdict) -> None:
    """The verdict in a word with its reasons, then every limit with its own."""
    from rig.analysis.next_run import next_step_of

    out.print(
        Text.assemble("  verdict  ", toned(verdict.verdict)),
        soft_wrap=True,
    )
    if not verdict.lines:
        for reason in verdict.because:
            out.print(Text(f"    {reason}"), soft_wrap=True)
    for line in verdict.lines:
        text = Text.assemble("    ", toned(line.outcome))
        out.print(text.append(f"  {verdict_text(line)}"), soft_wrap=True)
        if step := next_step_of(line):
            out.print(Text(f"      next: {step}", style="yellow"), soft_wrap=True)
    for words in _not_yet_told(verdict):
        out.print(Text(f"    {words}", style="yellow"), soft_wrap=True)
    if verdict.source:
        remark = phrase(", {}", verdict.remark)
        out.print(Text(f"    by {verdict.source}{remark}", style="dim"), soft_wrap=True)


def _not_yet_told(verdict: GearVerdict) -> list[str]:
    """What is stale beside what the lines say: of what no limit is about, or a limit that nobody confirmed."""
    said = " ".join(line.because for line in verdict.lines)
    return [words for words in verdict.stale if words.partition(": ")[2] not in said]


def print_warnings(out: Console, warnings: tuple[str, ...] | list[str]) -> None:
    """Warnings, each on its own line."""
    for warning in warnings:
        out.print(Text.assemble(("  warning  ", "bold yellow"), warning), soft_wrap=True)
