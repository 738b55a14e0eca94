"""What `rig plan` and `rig run` print: help with a protocol's flags, the plan with its margins, how a run ended."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer
from rich.console import Console
from rich.panel import Panel

from experiments import catalogue
from experiments.parameters import ParameterField, parameter_fields
from model.units import RPM
from rig.commands.terminal import console, echo, table
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
        protocols = table("protocol", "what it measures", title="Protocols", box=None)
        for name in catalogue.names():
            protocols.add_row(name, catalogue.entry(name).summary)
        out.print(protocols)
        out.print(f"\n'{context.command_path} PROTOCOL --help' shows the flags of one.")
        return
    experiment = catalogue.load(named)
    headings = ("flag", "unit", "allowed", "default", "what")
    flags = table(*headings, title=f"{named}: {experiment.title}")
    for field in parameter_fields(experiment.parameters):
        flags.add_row(field.flag, field.unit, field.limit, _default(field), field.help)
    out.print(flags)


def _default(field: ParameterField) -> str:
    value = field.default
    if isinstance(value, tuple):
        return " ".join(f"{number:g}" for number in value) or "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:g}" if isinstance(value, float) else str(value)


def print_plan(planned: PlannedRun) -> None:
    """What a plan will do, and its margin to every limit."""
    out = console()
    turns = planned.input_revolutions
    peak = max((abs(step.speed) for step in planned.steps), default=0.0) / RPM
    title = f"{planned.experiment.name}: {planned.experiment.title}"
    facts = table(show_header=False, box=None, title=title)
    facts.add_row("gear", f"{planned.gear.name}, {planned.mounting}, ratio {planned.load.ratio:g}")
    facts.add_row("steps", f"{len(planned.plan)}")
    facts.add_row(
        "duration", f"{in_words(planned.nominal)} nominal, {in_words(planned.longest)} at most"
    )
    of_output = (
        f", {turns / planned.load.ratio:.2f} of the output"
        if planned.experiment.gear_mounted
        else ""
    )
    facts.add_row("revolutions", f"{turns:.1f} of the input{of_output}")
    facts.add_row(
        "samples",
        f"{planned.samples} at {planned.sample_rate:g} Hz, about {planned.file_size() / 1e6:.1f} MB",
    )
    facts.add_row("peak speed", f"{peak:.4g} r/min")
    aims = [q for q in planned.experiment.quantities if q.target_text]
    for quantity in aims[:1]:
        facts.add_row("of use where", f"U of {quantity.family_title} {quantity.target_text}")
    out.print(facts)
    margins = table(
        "limit on",
        "planned",
        "allowed",
        "margin",
        "where",
        "origin",
        title="Margins",
        overflow="fold",
    )
    for margin in planned.margins:
        factor, unit = (RPM, "r/min") if margin.limit.unit == "rad/s" else (1.0, margin.limit.unit)
        origin = f"{margin.limit.tier}: {margin.limit.origin}"
        if margin.limit.provenance in ("recalled", "assumed"):
            origin += f" ({margin.limit.provenance})"
        margins.add_row(
            margin.quantity.replace("_", " "),
            f"{margin.value / factor:.4g} {unit}",
            f"{margin.limit.value / factor:.4g} {unit}",
            f"{100.0 * margin.margin:.0f} %",
            margin.where,
            origin,
        )
    out.print(margins)
    for remark in planned.remarks:
        out.print(f"warning: {remark}", style="yellow", soft_wrap=True)


def _print_alarm(out: Console, problem: str) -> None:
    """A failed make-safe: the loudest thing on the screen, with the terminal's bell."""
    text = f"STANDSTILL WAS NOT VERIFIED\n\nPRESS THE EMERGENCY STOP. DO NOT TOUCH THE RIG.\n\n{problem}"
    out.print(Panel(text, style="bold white on red", padding=(2, 6), expand=True))
    out.bell()


def _print_margins(out: Console, report: RunReport) -> None:
    """How near the run came to each limit, the nearest first."""
    margins = table("limit on", "peak", "limit", "margin", title="Margins of this run", box=None)
    for name, margin in sorted(report.margins.items(), key=lambda item: item[1]["margin"]):
        style = "red" if margin["margin"] < 0.0 else "yellow" if margin["margin"] < 0.1 else None
        words, unit, factor = worded(name)
        margins.add_row(
            words,
            f"{number(margin['peak'] / factor)} {unit}",
            f"{number(margin['limit'] / factor)} {unit}",
            f"{100.0 * margin['margin']:.0f} %",
            style=style,
        )
    out.print(margins)


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
