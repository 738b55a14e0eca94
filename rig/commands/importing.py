"""`rig import`: a recording of another rig made into a run, or looked at beforehand."""

from __future__ import annotations

import math
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.commands.terminal import echo, print_json

if TYPE_CHECKING:
    from rig.runfile.importing.channel_map import ImportOptions, RunMap
    from rig.runfile.importing.convert import Imported

WITHOUT_TIME = ("friction-curve",)
"""Analyses of tables that have no time base."""


class FileKind(str, Enum):  # noqa: UP042  StrEnum has another str() that shows in the help
    """Kinds of files that can be imported."""

    csv = "csv"
    mat = "mat"
    npz = "npz"
    hdf5 = "hdf5"
    json = "json"
    parquet = "parquet"
    tdms = "tdms"
    mdf = "mdf"


class MountingChoice(str, Enum):  # noqa: UP042
    """Which part of the gear is fixed."""

    circular_spline_fixed = "circular-spline-fixed"
    flexspline_fixed = "flexspline-fixed"


class TimeBaseChoice(str, Enum):  # noqa: UP042
    """What stamped the rows of a foreign recording."""

    hardware = "hardware"
    device = "device"
    host = "host"
    nominal = "nominal"


def import_(
    format: Annotated[
        FileKind,
        typer.Argument(
            help="csv (any delimited text, TwinCAT scope, LabVIEW .lvm, also .gz), mat (MATLAB 4 to 7.3), "
            "npz (NumPy), hdf5 (columns by path), json (a list of objects), parquet, tdms (LabVIEW), "
            "mdf (ASAM MDF 3 and 4)."
        ),
    ],
    file: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...", help="The recording of another rig; the files of one run."
        ),
    ],
    channel: Annotated[
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
    ] = None,
    map_file: Annotated[
        Path | None,
        typer.Option(
            "--map",
            metavar="FILE",
            help="Channel map in TOML: channels, segments, gear, conditions, several runs.",
        ),
    ] = None,
    check: Annotated[
        bool,
        typer.Option(
            "--check", help="Write nothing: show what each channel is and what it is good for."
        ),
    ] = False,
    output: Annotated[Path, typer.Option("--runs", metavar="DIR", help="Folder of runs.")] = Path(
        "runs"
    ),
    rate: Annotated[
        float | None,
        typer.Option("--rate", help="Sample rate in Hz, where there is no time column."),
    ] = None,
    no_time: Annotated[
        bool, typer.Option("--no-time", help="The recording has no time base; only angles count.")
    ] = False,
    time_base: Annotated[
        TimeBaseChoice | None,
        typer.Option(
            "--time-base",
            help="What stamped the rows; without it device, and nominal with --rate.",
        ),
    ] = None,
    start: Annotated[
        str, typer.Option("--start", help="When the first row was recorded, ISO 8601.")
    ] = "",
    protocol: Annotated[
        str, typer.Option("--protocol", help="The protocol or analysis that it is for, if any.")
    ] = "",
    gear: Annotated[
        str, typer.Option("--gear", metavar="SERIAL", help="Serial number of the gear.")
    ] = "",
    no_gear: Annotated[
        bool, typer.Option("--no-gear", help="The gear was taken off: the motor ran alone.")
    ] = False,
    parameters: Annotated[
        Path | None,
        typer.Option("--parameters", metavar="FILE", help="Parameter set of the gear (TOML)."),
    ] = None,
    ratio: Annotated[
        float | None, typer.Option("--ratio", help="Input revolutions per output revolution.")
    ] = None,
    mounting: Annotated[
        MountingChoice | None, typer.Option("--mounting", help="Which part of the gear was fixed.")
    ] = None,
    output_sense: Annotated[
        int,
        typer.Option(
            "--output-sense",
            help="+1 or -1: the output angle counts with the input angle or against it; asked for where both are.",
            min=-1,
            max=1,
        ),
    ] = 0,
    resonance_hz: Annotated[
        float | None, typer.Option("--resonance-hz", help="Known first resonance in Hz.")
    ] = None,
    load_inertia: Annotated[
        float | None, typer.Option("--load-inertia", help="Inertia on the output in kg m2.")
    ] = None,
    condition: Annotated[
        list[str] | None,
        typer.Option("--condition", metavar="NAME=VALUE", help="A condition; repeat it."),
    ] = None,
    torque_constant: Annotated[
        float | None, typer.Option("--torque-constant", help="N m per A, for a torque given in A.")
    ] = None,
    modulus: Annotated[
        list[str] | None,
        typer.Option(
            "--modulus",
            metavar="NAME=RANGE",
            help="Unwrap a channel whose column starts again after RANGE, in the column's own numbers.",
        ),
    ] = None,
    allow_jumps: Annotated[
        bool,
        typer.Option("--allow-jumps", help="Angles that jump as if they were wrapped did so."),
    ] = False,
    ignore_headings: Annotated[
        bool,
        typer.Option("--ignore-headings", help="The units in the headings are wrong: take none."),
    ] = False,
    delimiter: Annotated[
        str,
        typer.Option("--delimiter", help="Found out without it; `tab`, `space`, `any` are words."),
    ] = "",
    decimal: Annotated[
        str, typer.Option("--decimal", help="Decimal mark; found out without it.")
    ] = "",
    skip: Annotated[
        int, typer.Option("--skip", min=0, help="Lines at the beginning that are not looked at.")
    ] = 0,
    header: Annotated[
        int, typer.Option("--header", min=0, help="The line with the headings, counted from 1.")
    ] = 0,
    ragged: Annotated[
        bool, typer.Option("--ragged", help="Lines may end early: what is not there is not there.")
    ] = False,
    interpolate: Annotated[
        bool,
        typer.Option(
            "--interpolate",
            help="Bring channels with other times onto those of the first, by straight lines.",
        ),
    ] = False,
    drop_bad_rows: Annotated[
        bool,
        typer.Option("--drop-bad-rows", help="Leave out rows with holes, count and list them."),
    ] = False,
    operator: Annotated[str, typer.Option("--operator", help="Who recorded it.")] = "",
    title: Annotated[str, typer.Option("--title", help="What it is, in a few words.")] = "",
    json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object on standard output.")
    ] = False,
) -> None:
    """Make a run of a recording from another rig, marked IMPORTED; every analysis then works on it
    or says what it lacks. Units, signs and ratios are asked for, never guessed.
    """
    from rig.runfile.importing.channel_map import RunMap, read_channel_map
    from rig.runfile.importing.channel_source import parse_channel

    if ratio is not None and not math.isfinite(ratio):
        raise typer.BadParameter(f"{ratio} is no ratio", param_hint="--ratio")
    gear_set = None
    if parameters is not None:
        from model.gear_file import load_gear

        gear_set = load_gear(parameters)
    said = {
        "channels": tuple(parse_channel(text) for text in channel or ()),
        "rate": rate,
        "no_time": no_time or protocol in WITHOUT_TIME,
        "time_base": time_base and time_base.value,
        "start_time": start,
        "drop_bad_rows": drop_bad_rows,
        "torque_constant": torque_constant,
        "delimiter": delimiter,
        "decimal": decimal,
        "skip": skip,
        "header": header,
        "is_ragged": ragged,
        "interpolate": interpolate,
        "allow_jumps": allow_jumps,
        "ignore_headings": ignore_headings,
        "experiment": protocol,
        "title": title,
        "operator": operator,
        "gear": gear_set,
        "gear_serial": gear,
        "ratio": ratio,
        "mounting": mounting and mounting.value,
        "output_sense": output_sense,
        "resonance_hz": resonance_hz,
        "load_inertia_kg_m2": load_inertia,
        "conditions": _pairs(condition, "--condition"),
    }
    given: dict[str, Any] = {key: value for key, value in said.items() if value or value == 0.0}
    given = {key: value for key, value in given.items() if value is not False}
    if no_gear:
        given["gear_mounted"] = False
    if not output_sense:
        given.pop("output_sense", None)
    maps = read_channel_map(map_file) if map_file else (RunMap("", {}),)
    ranges = _pairs(modulus, "--modulus")
    runs = [(one, _unwrapped(one.options(given), ranges)) for one in maps]
    if check:
        _check(format.value, file, runs, json=json)
    else:
        _import(format.value, file, runs, output, json=json)


def _import(
    kind: str,
    files: list[Path],
    runs: list[tuple[RunMap, ImportOptions]],
    output: Path,
    *,
    json: bool,
) -> None:
    """Make the runs, and say what came of each."""
    from rig.library.folder import claim_run
    from rig.runfile.importing.convert import import_tables
    from rig.runfile.importing.opening import open_tables

    made: list[Imported] = []
    for one, options in runs:
        serial = options.gear_serial or one.name or files[0].stem
        tables = open_tables(kind, files, options.form)
        recording = import_tables(
            tables,
            options,
            lambda o=options, s=serial: claim_run(output, o.experiment or "import", s).path,
        )
        made.append(recording)
        if not json:
            echo(f"{recording.rows} rows imported into {recording.path} (IMPORTED)")
            for note in recording.notes:
                echo(f"  {note}")
    if json:
        told = [
            {
                "run": str(recording.path),
                "rows": recording.rows,
                "rows_left_out": recording.dropped,
                "notes": recording.notes,
            }
            for recording in made
        ]
        print_json(told[0] if len(told) == 1 else {"runs": told})


def _check(
    kind: str, files: list[Path], runs: list[tuple[RunMap, ImportOptions]], *, json: bool
) -> None:
    """Show what the import would make of the files; nothing is written."""
    from rig.commands.import_tables import columns_as_json, look_as_json, print_columns, print_look
    from rig.runfile.importing.looking import columns_of, look_at
    from rig.runfile.importing.opening import open_tables

    told: list[dict[str, Any]] = []
    for one, options in runs:
        tables = open_tables(kind, files, options.form)
        if not options.channels:
            listed = columns_of(tables)
            notes = [note for table in tables for note in table.notes]
            told.append(columns_as_json(listed, notes))
            if not json:
                print_columns(listed, notes)
            continue
        look = look_at(tables, options)
        told.append({"map": one.name, **look_as_json(look, options)})
        if not json:
            print_look(one.name, look, options)
    if json:
        print_json(told[0] if len(told) == 1 else {"runs": told})


def _pairs(texts: list[str] | None, flag: str) -> dict[str, Any]:
    """NAME=VALUE pairs; values that are numbers are read as such."""
    pairs: dict[str, Any] = {}
    for text in texts or ():
        name, equals, value = text.partition("=")
        if not equals or not name.strip():
            raise typer.BadParameter(f"{text!r}: write NAME=VALUE", param_hint=flag)
        try:
            pairs[name.strip()] = float(value)
        except ValueError:
            pairs[name.strip()] = value.strip()
    return pairs


def _unwrapped(options: ImportOptions, ranges: dict[str, Any]) -> ImportOptions:
    """The options with the ranges after which columns wrap."""
    from dataclasses import replace

    names = {source.name for source in options.channels}
    for name, value in ranges.items():
        if name not in names or not isinstance(value, float):
            raise typer.BadParameter(
                f"{name}={value}: write a channel of the import and a number",
                param_hint="--modulus",
            )
    channels = tuple(
        replace(source, modulus=ranges[source.name]) if source.name in ranges else source
        for source in options.channels
    )
    return replace(options, channels=channels)
