"""`rig model`: every quantity that the model derives from a parameter set."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rig.commands.terminal import print_json


def model(
    parameters: Annotated[
        Path | None,
        typer.Option(
            "--parameters", metavar="FILE", help="Parameter set (TOML); CSF-25-120 without it."
        ),
    ] = None,
    json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object on standard output, in SI.")
    ] = False,
) -> None:
    """Show what the model derives from a parameter set: stiffnesses, modes, resonance speeds, friction, in SI."""
    from model.gear_file import load_gear, shipped_gear
    from model.summary import derived_quantities

    gear = load_gear(parameters) if parameters else shipped_gear()
    summary = derived_quantities(gear)
    if json:
        print_json(summary.as_json())
        return
    from rig.commands.terminal import console, painted
    from rig.commands.visible import Text
    from rig.content.wording import readable
    from rig.gears.derived import summary_grids

    out = console()
    out.print(Text(f"{gear.name}: what the model derives from its parameters, in SI", style="bold"))
    options = ", ".join(f"{readable(name)} {value}" for name, value in summary.options.items())
    out.print(Text(f"options: {options}", style="dim"))
    for grid in summary_grids(summary):
        out.print(painted(grid))
