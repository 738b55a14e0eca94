"""Two runs and a gear's passport on the terminal, in the units of a laboratory."""

from __future__ import annotations

from collections.abc import Sequence

from rig.analysis.difference import Difference, change_grid
from rig.analysis.judging import GearVerdict
from rig.analysis.passport.analyse import Analysed
from rig.analysis.passport.content import Passport
from rig.analysis.passport.rows import series_grid
from rig.commands.result_tables import print_verdict
from rig.commands.terminal import STYLES, console, painted
from rig.commands.visible import Text
from rig.content.phrase import phrase


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
        if looked_at:
            title = f"{group}: {len(changes)} of {looked_at} differ"
        else:
            title = f"{group}: nothing to compare"
        out.print(Text(title, style="bold" if changes else "dim"))
        if shown:
            out.print(painted(change_grid(shown).without("group").without_empty(), title=None))
    if not compared.differs:
        out.print("Nothing differs but number and time.")


def print_passport(
    passport: Passport, judged: GearVerdict, analysed: Sequence[Analysed] = ()
) -> None:
    """The verdict on a gear, its series, what their charts say, and what is missing."""
    out = console(highlight=True)
    mark = Text(phrase("  {}", passport.mark), style="bold magenta")
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
        grid = series_grid(passport.series)
        out.print(painted(grid.without("catalogue limit", "remarks")))
    for alarm in passport.alarms:
        out.print(Text(f"CHANGED  {alarm.sentence}", style=STYLES["bad"]))
        out.print(Text(f"  {alarm.decides}  →  {alarm.command}"))
    out.print(Text(f"Alarms: {passport.promise}.", style="dim"))
    for heading, lines in (
        ("Missing", passport.missing),
        ("Runs that do not count", passport.left_out),
    ):
        if lines:
            out.print(Text(heading, style="bold"))
        for line in lines:
            run, remedy = phrase("{}: ", line.run), phrase("  →  {}", line.remedy)
            out.print(Text(f"  {run}{line.what}{remedy}"))
