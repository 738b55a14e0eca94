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
    float | None,
    typer.Option(
        "--mount-turn",
        metavar="DEG",
        rich_help_panel=_PANEL,
        help="Angle on the output flange from where mounting 1 had the gear, as the encoder counts [deg]; "
        "with --mount, because a gear that is turned is fitted anew. Without it nobody knows the angle.",
    ),
]
Hours = Annotated[
    float,
    typer.Option(
        "--hours",
        metavar="H",
        rich_help_panel=_PANEL,
        help="How long the gear has run: friction, order 2, stiffness and backlash wear at rates of its own.",
    ),
]
DayCorrelation = Annotated[
    float | None,
    typer.Option(
        "--day-correlation",
        metavar="R",
        rich_help_panel=_PANEL,
        help="How much a day resembles the one before, 0 to 0.95; 0 without it, of a wide bench 0 to 0.4.",
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


def world_choice(mount_turn_deg: float | None = None, **others: Any) -> WorldChoice:
    """The choice that flags make. Raises `ConfigurationError` for a value that names no world."""
    from rig.bench.backends.assembly import WorldChoice

    turn = None if mount_turn_deg is None else math.radians(mount_turn_deg)
    return WorldChoice(mount_turn=turn, **others)
