"""The flags of `rig import`, each with its help."""

from __future__ import annotations

import inspect
import typing
from dataclasses import dataclass, fields
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import typer

from rig.commands.signature import with_options


class _MountingChoice(str, Enum):  # noqa: UP042  StrEnum has another str() that shows in the help
    """Which part of the gear is fixed."""

    circular_spline_fixed = "circular-spline-fixed"
    flexspline_fixed = "flexspline-fixed"


class _TimeBaseChoice(str, Enum):  # noqa: UP042
    """What stamped the rows of a foreign recording."""

    hardware = "hardware"
    device = "device"
    host = "host"
    nominal = "nominal"


Words = Annotated[
    list[str],
    typer.Argument(
        metavar="[KIND] FILE...",
        help="The recording of another rig; the files of one run. KIND where the file does not tell it: "
        "csv (any delimited text, TwinCAT scope, LabVIEW .lvm, also .gz), mat (MATLAB 4 to 7.3), "
        "npz (NumPy), hdf5 (columns by path), json (a list of objects), parquet, tdms (LabVIEW), "
        "mdf (ASAM MDF 3 and 4), or what another package brings.",
    ),
]
Accept = Annotated[
    bool,
    typer.Option(
        "--accept",
        help="Take over what is proposed, in a script; what stays open is refused by name.",
    ),
]
OpenPage = Annotated[
    bool,
    typer.Option(
        "--open",
        help="Fit what it can bear first, and open the page of it: numbers, pictures, or why not.",
    ),
]
SaveMap = Annotated[
    Path | None,
    typer.Option(
        "--save-map", metavar="FILE", help="Keep what was accepted as a channel map (TOML)."
    ),
]
Channels = Annotated[
    list[str] | None,
    typer.Option(
        "--channel",
        "-c",
        metavar="NAME=COLUMN[@FILE][:UNIT[:SCALE]]",
        help="One channel; repeat it. COLUMN is a heading or a number from 1, FILE one of several by name "
        "or number; NAME `time` is the time column. The unit is asked for where the heading does not say it. "
        "SCALE: counts per revolution for an angle in `count`, N m per A (or V) for a torque in A (or V), "
        "seconds per tick for a time in `count`, else a factor.",
    ),
]
MapFile = Annotated[
    Path | None,
    typer.Option(
        "--map",
        metavar="FILE",
        help="Channel map in TOML: channels, segments, gear, conditions, several runs.",
    ),
]
Check = Annotated[
    bool,
    typer.Option(
        "--check", help="Write nothing: show what each channel is and what it is good for."
    ),
]
Folder = Annotated[Path, typer.Option("--runs", metavar="DIR", help="Folder of runs.")]
Rate = Annotated[
    float | None,
    typer.Option("--rate", help="Sample rate in Hz, where there is no time column."),
]
Speed = Annotated[
    str,
    typer.Option(
        "--speed",
        metavar="SPEED",
        help='Speed of the input with its unit ("60 r/min"), of a log at constant speed that has no '
        "angle; for orders.",
    ),
]
NoTime = Annotated[
    bool, typer.Option("--no-time", help="The recording has no time base; only angles count.")
]
TimeBaseFlag = Annotated[
    _TimeBaseChoice | None,
    typer.Option(
        "--time-base",
        help="What stamped the rows; without it device, and nominal with --rate.",
    ),
]
Start = Annotated[str, typer.Option("--start", help="When the first row was recorded, ISO 8601.")]
Protocol = Annotated[
    str, typer.Option("--protocol", help="The protocol or analysis that it is for, if any.")
]
Serial = Annotated[str, typer.Option("--gear", metavar="SERIAL", help="Serial number of the gear.")]
NoGear = Annotated[
    bool, typer.Option("--no-gear", help="The gear was taken off: the motor ran alone.")
]
ParameterSet = Annotated[
    Path | None,
    typer.Option("--parameters", metavar="FILE", help="Parameter set of the gear (TOML)."),
]
Ratio = Annotated[
    float | None, typer.Option("--ratio", help="Input revolutions per output revolution.")
]
MountingFlag = Annotated[
    _MountingChoice | None, typer.Option("--mounting", help="Which part of the gear was fixed.")
]
OutputSense = Annotated[
    int,
    typer.Option(
        "--output-sense",
        help="+1 or -1: the output angle counts with the input angle or against it; asked for where both are.",
        min=-1,
        max=1,
    ),
]
Resonance = Annotated[
    float | None, typer.Option("--resonance-hz", help="Known first resonance in Hz.")
]
LoadInertia = Annotated[
    float | None,
    typer.Option(
        "--load-inertia",
        help="Inertia on the output in kg m2; with --parameters it gives the first mode.",
    ),
]
Conditions = Annotated[
    list[str] | None,
    typer.Option("--condition", metavar="NAME=VALUE", help="A condition; repeat it."),
]
TorqueConstant = Annotated[
    float | None, typer.Option("--torque-constant", help="N m per A, for a torque given in A.")
]
Moduli = Annotated[
    list[str] | None,
    typer.Option(
        "--modulus",
        metavar="NAME=RANGE",
        help="Unwrap a channel whose column starts again after RANGE, in the column's own numbers.",
    ),
]
Lags = Annotated[
    list[str] | None,
    typer.Option(
        "--lag",
        metavar="NAME=TIME",
        help="By how much a channel is late, with its unit: torque=2ms; repeat it.",
    ),
]
Accuracies = Annotated[
    list[str] | None,
    typer.Option(
        "--accuracy",
        metavar="NAME=VALUE",
        help="Half-width of an encoder's whole error curve, with its unit: output_angle=5arcsec; repeat it.",
    ),
]
AllowJumps = Annotated[
    bool,
    typer.Option("--allow-jumps", help="Angles that jump as if they were wrapped did so."),
]
IgnoreHeadings = Annotated[
    bool,
    typer.Option("--ignore-headings", help="The units in the headings are wrong: take none."),
]
Delimiter = Annotated[
    str,
    typer.Option("--delimiter", help="Found out without it; `tab`, `space`, `any` are words."),
]
Decimal = Annotated[str, typer.Option("--decimal", help="Decimal mark; found out without it.")]
Skip = Annotated[
    int, typer.Option("--skip", min=0, help="Lines at the beginning that are not looked at.")
]
Header = Annotated[
    int, typer.Option("--header", min=0, help="The line with the headings, counted from 1.")
]
Ragged = Annotated[
    bool, typer.Option("--ragged", help="Lines may end early: what is not there is not there.")
]
Interpolate = Annotated[
    bool,
    typer.Option(
        "--interpolate",
        help="Bring channels with other times onto those of the first, by straight lines.",
    ),
]
Gap = Annotated[
    float | None,
    typer.Option(
        "--gap",
        metavar="STEPS",
        help="Steps of the time longer than so many usual ones are gaps, across which nothing is interpolated (1.5).",
    ),
]
DropBadRows = Annotated[
    bool,
    typer.Option("--drop-bad-rows", help="Leave out rows with holes, count and list them."),
]
Operator = Annotated[str, typer.Option("--operator", help="Who recorded it.")]
Title = Annotated[str, typer.Option("--title", help="What it is, in a few words.")]


@dataclass(frozen=True, kw_only=True)
class ImportFlags:
    """What was said of an import, in the order of its help; words and `--json` apart."""

    channel: Channels = None
    map_file: MapFile = None
    check: Check = False
    accept: Accept = False
    save_map: SaveMap = None
    output: Folder = Path("runs")
    rate: Rate = None
    speed: Speed = ""
    no_time: NoTime = False
    time_base: TimeBaseFlag = None
    start: Start = ""
    protocol: Protocol = ""
    gear: Serial = ""
    no_gear: NoGear = False
    parameters: ParameterSet = None
    ratio: Ratio = None
    mounting: MountingFlag = None
    output_sense: OutputSense = 0
    resonance_hz: Resonance = None
    load_inertia: LoadInertia = None
    condition: Conditions = None
    torque_constant: TorqueConstant = None
    modulus: Moduli = None
    lag: Lags = None
    accuracy: Accuracies = None
    allow_jumps: AllowJumps = False
    ignore_headings: IgnoreHeadings = False
    delimiter: Delimiter = ""
    decimal: Decimal = ""
    skip: Skip = 0
    header: Header = 0
    ragged: Ragged = False
    interpolate: Interpolate = False
    gap: Gap = None
    drop_bad_rows: DropBadRows = False
    operator: Operator = ""
    title: Title = ""
    open_page: OpenPage = False


_KINDS = typing.get_type_hints(ImportFlags, include_extras=True)
_FIELDS = tuple(
    inspect.Parameter(
        one.name, inspect.Parameter.KEYWORD_ONLY, default=one.default, annotation=_KINDS[one.name]
    )
    for one in fields(ImportFlags)
)


def _gathered(given: dict[str, Any]) -> ImportFlags:
    return ImportFlags(**{one.name: given.pop(one.name) for one in _FIELDS})


with_flags = with_options(_FIELDS, _gathered)
"""Give a command these flags in the place of its parameter `said`."""
