"""`rig next`: which run, calibration or other day decides what is open, and what U becomes by it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.commands.judgement import AcceptanceFile, acceptance_said
from rig.commands.terminal import Json, echo, print_json
from rig.content.phrase import phrase, quoted

if TYPE_CHECKING:
    from rig.analysis.advised import Advised
    from rig.analysis.next_run import Advice


_Source = Annotated[
    str,
    typer.Argument(
        metavar="GEAR|RUN",
        help="Serial number of a gear, or an analysed run: file, number, name.",
    ),
]

_Target = Annotated[
    list[str] | None,
    typer.Option(
        "--target",
        metavar="QUANTITY=U",
        help="A U that is wanted, such as running_torque_1000_rpm=3% or transmission_accuracy=0.1 arcmin; may be "
        "given several times.",
    ),
]


def next_(
    source: _Source,
    target: _Target = None,
    folder: Annotated[Path, typer.Option("--runs", metavar="DIR", help="Folder of runs.")] = Path(
        "runs"
    ),
    acceptance: AcceptanceFile = "",
    json: Json = False,
) -> None:
    """Say what to run next: for every limit that is open or MARGINAL, and for each --target, one sentence, one command.

    The sentence names the largest line of the budget with its share of U², who can lower it, and what U becomes: more
    visits, other days, or a calibration with the size that it must have. Where more than half of U² is not scatter
    within the run, no run helps, and it says so. It moves nothing.
    """
    from rig.analysis.advised import advised

    found = advised(source, folder, target or (), acceptance_said(acceptance))
    rows = [_row(one, found, folder) for one in found.advice]
    if json:
        told = found.as_json()
        told["advice"] = [{**one, **row} for one, row in zip(told["advice"], rows, strict=True)]
        print_json(told)
        return
    if not rows and not found.open:
        echo(
            f"{found.subject}: {found.verdict.verdict}. Nothing is open that a number of it would decide."
        )
    for sentence, protocol in found.open:
        echo(sentence)
        if protocol:
            echo(f"  rig run {protocol} --gear {quoted(found.serial)}")
    for one, row in zip(found.advice, rows, strict=True):
        echo(one.sentence)
        if row["command"]:
            minutes = "" if row["minutes"] is None else f"   ({row['minutes']:.0f} min)"
            echo(f"  {row['command']}{minutes}")


def _row(one: Advice, found: Advised, folder: Path) -> dict[str, Any]:
    """The command of an advice, and its minutes by the planner; "" and null where no run helps."""
    gear = phrase(" --gear {}", found.serial and quoted(found.serial))
    if one.helps == "visits" and one.parameters:
        (name, value), *_ = one.parameters.items()
        command = f"rig run {one.kind}{gear} --{name.replace('_', '-')} {value}"
        return {"command": command, "minutes": _minutes(one, found.serial, folder)}
    if one.helps == "other days":
        return {
            "command": f"rig run {one.kind}{gear}",
            "minutes": _minutes(one, found.serial, folder),
        }
    return {"command": "", "minutes": None}


def _minutes(one: Advice, serial: str, folder: Path) -> float | None:
    """How long such a run takes by its plan; None where it cannot be planned here."""
    from rig.errors import RigError
    from rig.run.ordering import order_of
    from rig.run.start import plan_order

    def silent(_: str) -> None:
        """What a card was warned of is told where a run is ordered."""

    said = {"serial": serial, "folder": folder}
    try:
        order = order_of(one.kind, dict(one.parameters), said, silent)
        return plan_order(order).nominal / 60.0
    except RigError:
        return None
