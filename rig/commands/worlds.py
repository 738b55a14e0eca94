"""The flags that choose a simulated world, the same in every command that has one."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from rig.bench.backends.assembly import WorldChoice

_PANEL = "Simulated world"

GearSeed = Annotated[
    int | None,
    typer.Option(
        "--gear-seed",
        metavar="G",
        rich_help_panel=_PANEL,
        help="Which individual gear; follows from the serial number.",
    ),
]
BenchSeed = Annotated[
    int | None,
    typer.Option(
        "--bench-seed",
        metavar="B",
        rich_help_panel=_PANEL,
        help="Which bench: encoders, torque port, motor, bearing; --seed without it.",
    ),
]
Mount = Annotated[
    int,
    typer.Option(
        "--mount",
        metavar="M",
        rich_help_panel=_PANEL,
        help="How often the gear was fitted: a new number is a gear taken off and refitted.",
    ),
]
MountTurn = Annotated[
    float,
    typer.Option(
        "--mount-turn",
        metavar="DEG",
        rich_help_panel=_PANEL,
        help="Angle that the gear is turned by on the output flange, as the encoder counts [deg].",
    ),
]
Day = Annotated[
    int,
    typer.Option(
        "--day",
        metavar="D",
        rich_help_panel=_PANEL,
        help="Which day: temperature of the room, zero of the torque port.",
    ),
]
Number = Annotated[
    int | None,
    typer.Option(
        "--number",
        metavar="K",
        rich_help_panel=_PANEL,
        help="Number that owns noise and start angle; the next in the folder.",
    ),
]
PopulationName = Annotated[
    str,
    typer.Option(
        "--population",
        metavar="NAME",
        rich_help_panel=_PANEL,
        help="narrow: gears of one series and a good bench; wide: as different as they come.",
    ),
]
StartStateName = Annotated[
    str,
    typer.Option(
        "--start-state",
        metavar="STATE",
        rich_help_panel=_PANEL,
        help="How warm it starts: auto (as the latest run of this gear, bench, mounting and day ended), ambient, "
        "or as the RUN ended whose number or file is given.",
    ),
]


def world_choice(mount_turn_deg: float = 0.0, **others: Any) -> WorldChoice:
    """The choice that flags make. Raises `ConfigurationError` for a value that names no world."""
    from rig.bench.backends.assembly import WorldChoice

    return WorldChoice(mount_turn=math.radians(mount_turn_deg), **others)
