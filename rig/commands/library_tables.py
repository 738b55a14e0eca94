"""Two runs and a gear's passport on the terminal, in the units of a laboratory."""

from __future__ import annotations

from collections.abc import Sequence

from rich.table import Table

from rig.analysis.difference import Change, Difference
from rig.analysis.judging import GearVerdict
from rig.analysis.passport.analyse import Analysed
from rig.analysis.passport.content import Passport, PassportSeries
from rig.commands.result_tables import print_verdict
from rig.commands.terminal import console, table
from rig.commands.visible import Text
from rig.content.wording import number

_STATE_COLOURS = {"in control": "green", "to be watched": "yellow", "out of control": "bold red"}


def print_difference(
    compared: Difference,
    verdicts: Sequence[tuple[str, GearVerdict | None]],
    *,
    everything: bool,
) -> None:
    """What differs, group by group; with `everything` what does not as well. Outcome and verdict of both come first."""
    out = console(highlight=True)
    out.print(
        Text(compared.first, style="bold")
        + Text("  against  ")
        + Text(compared.second, style="bold")
    )
    for run, (outcome, verdict) in zip((compared.first, compared.second), verdicts, strict=True):
        out.print(Text(f"{run}: outcome {outcome or '-'}"))
        if verdict is not None:
            print_verdict(out, verdict)
    for group, looked_at in compared.compared.items():
        changes = compared.of(group)
        shown = [
            *changes,
            *(change for change in compared.same if change.group == group and everything),
        ]
        title = (
            f"{group}: {len(changes)} of {looked_at} differ"
            if looked_at
            else f"{group}: nothing to compare"
        )
        out.print(Text(title, style="bold" if changes else "dim"))
        if shown:
            out.print(_change_table(shown, results=group == "results"))
    if not compared.differs:
        out.print("Nothing differs but number and time.")


def _change_table(changes: Sequence[Change], *, results: bool) -> Table:
    headings = (
        "what",
        "first",
        "second",
        *(("difference", "significant", "remark") if results else ()),
    )
    rows = table(*headings, overflow="fold", box=None, header_style="dim")
    for change in changes:
        kind = change.name.partition(": ")[0] + ": " if results and change.title else ""
        what = f"{kind}{change.title or change.name}"
        row = [
            Text(what),
            Text(change.in_words(change.first)),
            Text(change.in_words(change.second)),
        ]
        if results:
            row += [Text(change.shown), _significance(change), Text(change.note)]
        rows.add_row(*row)
    return rows


def _significance(change: Change) -> Text:
    if change.significant is None:
        return Text("")
    return (
        Text("yes", style="bold yellow")
        if change.significant
        else Text("no: within U_c", style="dim")
    )


def print_passport(
    passport: Passport, judged: GearVerdict, analysed: Sequence[Analysed] = ()
) -> None:
    """The verdict on a gear, its series, what their charts say, and what is missing."""
    out = console(highlight=True)
    mark = Text(f"  {passport.mark}", style="bold magenta") if passport.mark else Text("")
    out.print(Text(f"Gear {passport.serial}", style="bold") + Text(f"  {passport.gear}") + mark)
    for one in analysed:
        out.print(
            Text(
                f"fitted {one.run.run_id}: {one.stored or one.problem}",
                style="" if one.stored else "bold red",
            )
        )
    first, last = (
        (passport.runs[0].start[:10], passport.runs[-1].start[:10]) if passport.runs else ("-", "-")
    )
    out.print(f"{len(passport.runs)} runs, {first} to {last}")
    print_verdict(out, judged)
    if passport.series:
        out.print(_series_table(passport.series))
    for series in passport.series:
        for point in series.points:
            for signal in point.signals:
                text = f"{series.title}, {point.run}: {passport.rules[signal]}"
                text += " (within the measuring uncertainty)" if point.within_uncertainty else ""
                out.print(
                    Text(
                        text,
                        style=_STATE_COLOURS[
                            "out of control" if signal == "1" else "to be watched"
                        ],
                    )
                )
    for heading, lines in (
        ("Missing", passport.missing),
        ("Runs that do not count", passport.left_out),
    ):
        if lines:
            out.print(Text(heading, style="bold"))
        for line in lines:
            remedy = f"  →  {line.remedy}" if line.remedy else ""
            out.print(Text(f"  {line.run + ': ' if line.run else ''}{line.what}{remedy}"))


def _series_table(series: Sequence[PassportSeries]) -> Table:
    measured = ("runs", "newest", "U (95 %)")
    rows = table(
        "quantity",
        *measured,
        "unit",
        "centre",
        "control limits",
        "state",
        numbers=(*measured, "centre"),
        overflow="fold",
        box=None,
        header_style="bold",
        pad_edge=False,
    )
    for one in series:
        newest, control = one.points[-1], one.control
        centre = "-" if control is None else number(control.centre / one.factor, 4)
        limits = (
            "-"
            if control is None
            else " … ".join(number(v / one.factor, 4) for v in (control.lower, control.upper))
        )
        rows.add_row(
            Text(one.title),
            str(len(one.points)),
            number(newest.value / one.factor, 4),
            number(newest.expanded_uncertainty / one.factor, 2),
            one.display_unit,
            centre,
            limits,
            Text(one.state, style=_STATE_COLOURS.get(one.state, "dim")),
        )
    return rows
