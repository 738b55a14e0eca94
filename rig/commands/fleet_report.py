"""`rig fleet report`: a lot of gears in one page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.terminal import Json, console, print_json
from rig.content.phrase import phrase

if TYPE_CHECKING:
    from rig.fleet.lot import Lot

Origin = Annotated[
    str,
    typer.Option(
        metavar="WORD",
        help="hardware, simulated, replay or imported; hardware alone where there is any.",
    ),
]
PartName = Annotated[
    str, typer.Option(metavar="NAME", help="Only gears of this part, letter for letter.")
]


def report(
    results: Annotated[
        Path | None,
        typer.Argument(metavar="[DATASET]", help="Folder of results, or of the runs with them."),
    ] = None,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="FILE", help="What to write: .html or .pdf."),
    ] = Path("lot.html"),
    origin: Origin = "",
    part: PartName = "",
    json: Json = False,
) -> None:
    """Write the report of a lot: verdicts, capability of each key quantity, benches, time, the gears to look at.

    From the results of `rig fleet fit`; nothing is fitted. Every gear counts once, by its newest run of each kind. No
    capability is told of fewer than ten judged gears or without a limit. The exit code is 0 whatever the verdicts.
    """
    from datetime import datetime

    from rig.extras import require
    from rig.fleet.questions import results_folder

    require("a lot's report", "fleet", "pyarrow", "duckdb")
    from rig.fleet.lot import lot_of
    from rig.fleet.lot_page import write_lot_report

    lot = lot_of(results_folder(results), origin=origin, part=part)
    now = datetime.now().astimezone().isoformat(timespec="seconds")
    written = write_lot_report(lot, output, now)
    if json:
        print_json({"report": str(written), **lot.as_json()})
    else:
        _print(lot, written)


def _print(lot: Lot, written: Path) -> None:
    from rig.commands.visible import Text
    from rig.fleet.lot import why_of
    from rig.fleet.lot_words import with_interval
    from rig.runfile.header import ORIGIN_WORDS

    counted = ", ".join(f"{count} {word}" for word, count in lot.verdicts.items())
    mark = phrase("  {}", ORIGIN_WORDS.get(lot.data.origin, lot.data.origin.upper()))
    out = console()
    out.print(
        Text(f"Lot of {len(lot.gears)} gears, {lot.data.runs} runs{mark}: {counted}"),
        soft_wrap=True,
    )
    for one in lot.quantities:
        found = one.capability
        if one.limits is None:
            continue
        if isinstance(found, str):
            told = f"no capability: {found}"
        else:
            told = f"Cpk {with_interval(found.actual, found.actual_interval)}"
        out.print(Text(f"  {one.title}: {told}"), soft_wrap=True)
    for gear in lot.to_look_at:
        out.print(Text(f"  look at {gear.gear}: {'; '.join(why_of(gear))}"), soft_wrap=True)
    for note in lot.notes:
        out.print(Text(f"  {note}"), soft_wrap=True)
    out.print(Text(f"report in {written}"), soft_wrap=True)
