"""What `rig plan` and `rig run` print: help with a protocol's flags, the plan with its margins, how a run ended."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import typer
from rich.console import Console
from rich.panel import Panel

from experiments import catalogue
from experiments.parameters import ParameterField, parameter_fields
from experiments.setting import EVERY_KIND
from model.units import RPM
from rig.commands.terminal import console, echo, fact_table, painted
from rig.content.grid import Grid, columns, number_columns
from rig.content.phrase import yes_or_no
from rig.content.wording import percent
from rig.run.dry_run import margin_grid
from rig.run.margins import number, worded
from rig.run.progress import in_words

if TYPE_CHECKING:
    from rig.commands.ending import Ending
    from rig.run.dry_run import PlannedRun
    from rig.run.parts import RunReport


def print_help(context: typer.Context) -> None:
    """The command's own help, then the protocols, or the flags of the one that is named."""
    text = context.get_help()
    if text:
        echo(text)
    out = console()
    named = next((word for word in context.args if word in catalogue.names()), "")
    if not named:
        protocols = [(name, catalogue.entry(name).summary) for name in catalogue.names()]
        out.print(fact_table(protocols, "Protocols"))
        out.print(f"\n'{context.command_path} PROTOCOL --help' shows the flags of one.")
        return
    experiment = catalogue.load(named)
    rows = [
        (field.flag, field.unit, field.limit, _default(field), field.help)
        for field in parameter_fields(experiment.parameters)
    ]
    heads = columns(("flag", "unit"), ("unit", "unit"), "allowed", "default", "what")
    out.print(painted(Grid(f"{named}: {experiment.title}", heads, rows)))


def print_settings(context: typer.Context, words: Sequence[str]) -> None:
    """The help of `rig fit`, and of the kind that is named its settings: value without it, when to use it."""
    named = next((word for word in words if word in catalogue.kinds()), "")
    if not named:
        echo(context.get_help())
        return
    experiment = catalogue.load(named)
    rows = [(one.name, one.in_words) for one in (*experiment.settings, *EVERY_KIND)]
    out = console()
    out.print(fact_table(rows, f"{named}: {experiment.title}; --set NAME=VALUE, to be used where"))
    out.print(f"\n'{context.command_path} --help' shows the options of every kind.")


def _default(field: ParameterField) -> str:
    value = field.default
    if value is None:
        return "-"
    if isinstance(value, tuple):
        return " ".join(f"{number:g}" for number in value) or "-"
    if isinstance(value, bool):
        return yes_or_no(value)
    return f"{value:g}" if isinstance(value, float) else str(value)


def _facts(planned: PlannedRun) -> Iterator[tuple[str, str]]:
    experiment, ratio = planned.experiment, planned.load.ratio
    yield "gear", f"{planned.gear.name}, {planned.mounting}, ratio {ratio:g}"
    yield "steps", f"{len(planned.plan)}"
    yield "duration", f"{in_words(planned.nominal)} nominal, {in_words(planned.longest)} at most"
    turns = planned.input_revolutions
    of_output = f", {turns / ratio:.2f} of the output" if experiment.gear_mounted else ""
    yield "revolutions", f"{turns:.1f} of the input{of_output}"
    size = planned.file_size() / 1e6
    yield "samples", f"{planned.samples} at {planned.sample_rate:g} Hz, about {size:.1f} MB"
    peak = max((abs(step.speed) for step in planned.steps), default=0.0) / RPM
    yield "peak speed", f"{peak:.4g} r/min"
    aim = next((one for one in experiment.quantities if one.target_text), None)
    if aim is not None:
        members = ", ".join(aim.watched_members)
        title = aim.titled(aim.named(members)) if members else aim.family_title
        yield "of use where", f"U of {title} {aim.target_text}"


def print_plan(planned: PlannedRun) -> None:
    """What a plan will do, and its margin to every limit."""
    out = console()
    title = f"{planned.experiment.name}: {planned.experiment.title}"
    out.print(fact_table(_facts(planned), title))
    out.print(painted(margin_grid(planned.margins)))
    for remark in planned.remarks:
        out.print(f"warning: {remark}", style="yellow", soft_wrap=True)


def _print_alarm(out: Console, problem: str) -> None:
    """A failed make-safe: the loudest thing on the screen, with the terminal's bell."""
    text = f"STANDSTILL WAS NOT VERIFIED\n\nPRESS THE EMERGENCY STOP. DO NOT TOUCH THE RIG.\n\n{problem}"
    out.print(Panel(text, style="bold white on red", padding=(2, 6), expand=True))
    out.bell()


def _print_margins(out: Console, report: RunReport) -> None:
    """How near the run came to each limit, the nearest first."""
    rows = []
    for name, margin in sorted(report.margins.items(), key=lambda item: item[1]["margin"]):
        words, unit, factor = worded(name)
        peak, limit = (f"{number(margin[key] / factor)} {unit}" for key in ("peak", "limit"))
        mark = "! " if margin["margin"] < 0.1 else ""
        rows.append((words, peak, limit, f"{mark}{percent(margin['margin'])}"))
    heads = (*columns("limit on"), *number_columns("peak", "limit", "margin"))
    out.print(painted(Grid("Margins of this run", heads, rows)))


def print_report(
    report: RunReport, bench: str, ending: Ending, *, everything: bool = False
) -> None:
    """How a run ended: outcome, verdict, file, how it was made safe, the values that matter, what to do.

    `bench` is the option that names the bench. Margins are shown with `everything`, and where the run
    was not brought to its end.
    """
    out = console()
    styles = {"COMPLETED": "bold", "ABORTED": "yellow"}
    out.print(f"{report.outcome}  {report.run_id}", style=styles.get(report.outcome, "red"))
    from rig.commands.ending import print_ending
    from rig.commands.result_tables import print_verdict

    print_verdict(out, ending.verdict)
    out.print(f"{report.path}", soft_wrap=True)
    if report.make_safe is not None and not report.safe:
        _print_alarm(out, report.make_safe.problem)
    elif report.make_safe is not None:
        seen = ", ".join(report.make_safe.verified_by)
        out.print(
            f"made safe ({report.make_safe.action.value}), standstill verified by {seen}",
            soft_wrap=True,
        )
    if report.message:
        out.print(report.message, soft_wrap=True)
    if report.margins and (everything or report.outcome != "COMPLETED"):
        _print_margins(out, report)
    if report.trip is not None:
        out.print(
            f"The trip is latched: rig acknowledge --operator NAME {bench}",
            soft_wrap=True,
        )
    for warning in dict.fromkeys(w for w in report.warnings if w != report.message):
        out.print(f"warning: {warning}", style="yellow", soft_wrap=True)
    print_ending(out, ending, report.path, everything=everything)
