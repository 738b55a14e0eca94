"""`rig bench`: what a bench knows of itself."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import Annotated

import typer

from rig.commands.lessons import LESSONS
from rig.commands.terminal import Json, console, echo, painted, print_json
from rig.content.phrase import quoted

bench = typer.Typer(
    name="bench",
    no_args_is_help=True,
    help="What a bench knows of itself: its output encoder, its torque scale.",
)
_Told = dict[str, object]
"""One thing that is known, as a script is told it."""
_RUNS = typer.Option("--runs", metavar="DIR", help="Folder of the runs.")


@bench.callback()
def _group() -> None:
    """What a bench knows of itself: its output encoder, its torque scale."""


_Runs = Annotated[
    list[Path] | None,
    typer.Argument(
        metavar="[RUN]...",
        help="Runs of kinematic-error or torque-scale; all of the folder without.",
    ),
]

_BenchId = Annotated[
    str, typer.Option("--bench", metavar="ID", help="Which bench, where there are several.")
]

_Output = Annotated[
    Path | None,
    typer.Option("--output", "-o", metavar="FILE", help="A new file; beside the runs without it."),
]

_Due = Annotated[
    datetime | None,
    typer.Option(
        formats=["%Y-%m-%d"],
        metavar="YYYY-MM-DD",
        help="Until when it is taken; a year without it.",
    ),
]

_DryRun = Annotated[bool, typer.Option("--dry-run", help="Say what is learnt, write nothing.")]


@bench.command("learn")
def learn(
    runs: _Runs = None,
    folder: Annotated[Path, _RUNS] = Path("runs"),
    bench_id: _BenchId = "",
    output: _Output = None,
    due: _Due = None,
    dry_run: _DryRun = (False),
    json: Json = False,
) -> None:
    """Learn the output encoder from gears that were mounted at stated angles, and the torque scale from known inertias.

    Runs of torque-scale with a disc on the bare motor and without one give the gain and the lag of the torque channels.
    Several gears (eight, at angles spread over the turn) or one gear at three angles (0, 30, 150 degrees) part what
    is the encoder's from what is the gears'. The angle stands on the gear's card (mounted at deg). Every later
    analysis of a run of this bench takes the curve; a run of a gear that taught it gets what the others teach.
    Without stated angles the encoder holds what all gears share, which is said, with a line for it.
    """
    from rig.analysis.learnt import free_name
    from rig.errors import ConfigurationError

    groups = _by_kind(runs, folder)
    if output is not None and len(groups) > 1:
        raise ConfigurationError(
            "is one file, and two things are learnt",
            where="--output",
            value=str(output),
            remedy="Name the runs of one protocol: kinematic-error, or torque-scale.",
        )
    today = datetime.now(UTC).date()
    until = today + timedelta(days=365) if due is None else due.date()
    told: list[_Told] = []
    for kind, named in groups.items():
        lesson = LESSONS[kind](named, bench_id)
        if not (dry_run or json or lesson.is_certificate):
            # What it found is seen before it is refused as a certificate.
            lesson.show(None)
        path = None
        if not dry_run:
            beside = named[0].parent if runs else folder
            name = f"{lesson.prefix}-{lesson.bench}-{today.isoformat()}"
            path = lesson.write(output or free_name(beside, name, lesson.suffix), today, until)
        told.append({**lesson.as_json(), "file": path})
        if not json:
            lesson.show(path)
    if json:
        print_json({"learnt": told})


_CONFIG = typer.Option("--config", metavar="FILE", help="The rig's description; rig.toml without.")


@bench.command("show")
def show(
    folder: Annotated[Path, _RUNS] = Path("runs"),
    config: Annotated[Path | None, _CONFIG] = None,
    json: Json = False,
) -> None:
    """Show what the benches of a folder know of themselves: learnt curves and scales, motor tares, the golden gear.

    Each with its age and until when it holds. With a description (--config, or rig.toml here) the calibrations that it
    states and what was commissioned of that bench besides.
    """
    from rig.errors import ConfigurationError

    learnt, tares = [*_curves(folder), *_scales(folder)], list(_tares(folder))
    stated, commissioned = _described(folder, config)
    if not (learnt or tares or stated or commissioned):
        raise ConfigurationError(
            "holds nothing that a bench learnt, and no tare",
            where=str(folder),
            remedy=f"Learn its instruments: rig bench learn --runs {quoted(folder)}",
        )
    golden = _golden(folder, config)
    if json:
        print_json(
            {
                "learnt": learnt,
                "tares": tares,
                "golden": golden,
                "stated": stated,
                "commissioned": commissioned,
            }
        )
        return
    _print_known(learnt, tares, stated, commissioned)
    if golden is not None:
        echo(f"golden gear {golden['gear']}: {golden['found']}")


def _print_known(
    learnt: list[_Told], tares: list[_Told], stated: list[_Told], commissioned: list[_Told]
) -> None:
    """One table for each kind of thing that is known."""
    from rig.content.grid import Grid, columns

    age = ("age [d]", "number")
    of_learnt = columns("what", ("U", "number"), age, "due", "bench", "file", "rests on")
    of_tares = columns("run", "bench", age)
    in_learnt = ("of", "u", "age_days", "due", "bench", "file", "basis")
    in_stated = ("channel", "certificate", "due")
    in_commissioned = ("stage", "passed", "at", "operator")
    out = console()
    for title, heads, keys, told in (
        ("What the benches learnt of themselves", of_learnt, in_learnt, learnt),
        ("Motor tares, the newest first", of_tares, ("run", "bench", "age_days"), tares),
        ("Calibrations that the description states", columns(*in_stated), in_stated, stated),
        ("Commissioned", columns(*in_commissioned), in_commissioned, commissioned),
    ):
        if told:
            rows = [
                tuple("" if one[key] is None else str(one[key]) for key in keys) for one in told
            ]
            out.print(painted(Grid(title, heads, rows)))


def _described(folder: Path, config: Path | None) -> tuple[list[_Told], list[_Told]]:
    """The calibrations that a description states, and the stages of its bench as they came out last; nothing without
    one of hardware.
    """
    from rig.bench.backends.registry import HARDWARE
    from rig.bench.commissioning import read_record
    from rig.bench.config.load import load_configuration
    from rig.bench.config.place import DEFAULT_PATH
    from rig.bench.identity import bench_of

    path = config or DEFAULT_PATH
    # A description may have the tables of a laboratory alone: a bench has a bus.
    if not path.is_file() or "bus" not in tomllib.loads(path.read_text(encoding="utf-8")):
        return [], []
    stated = list(_calibrations("", load_configuration(path).model_dump()))
    newest = {done.stage: done for done in read_record(bench_of(HARDWARE, folder, path).state)}
    return stated, [
        {"stage": one.stage, "passed": one.passed, "at": one.at, "operator": one.operator}
        for one in newest.values()
    ]


def _calibrations(place: str, content: object) -> Iterator[_Told]:
    """Every calibration with a certificate within a description, by its place."""
    if not isinstance(content, Mapping):
        return
    for name, value in content.items():
        where = f"{place}.{name}".lstrip(".")
        if name == "calibration" and isinstance(value, Mapping) and value.get("certificate"):
            yield {
                "channel": place,
                "certificate": value["certificate"],
                "due": str(value.get("due") or ""),
            }
        else:
            yield from _calibrations(where, value)


def _days_since(text: str) -> int:
    """Whole days from a date or a time to now."""
    return (datetime.now(UTC).date() - date.fromisoformat(text[:10])).days


def _tares(folder: Path) -> Iterator[_Told]:
    """The complete motor tares of a folder, the newest first; five are enough."""
    from rig.library.index import LibraryIndex

    runs = [run for run in LibraryIndex(folder).search(protocol="motor-tare") if run.is_complete]
    for run in sorted(runs, key=lambda one: one.start, reverse=True)[:5]:
        yield {
            "run": run.run_id,
            "bench": run.bench,
            "started": run.start,
            "age_days": _days_since(run.start),
        }


def _golden(folder: Path, config: Path | None) -> _Told | None:
    """What the golden gear says, where one is named."""
    from rig.analysis.alarm.laboratory import watching_in_force
    from rig.analysis.golden import golden_check
    from rig.errors import RigError

    serial = watching_in_force(config).golden_gear
    if not serial:
        return None
    try:
        found = golden_check(folder, serial, datetime.now(UTC))
    except RigError as error:
        return {"gear": serial, "found": str(error), "changed": None}
    state = "changed" if found.is_changed else "no change seen"
    words = f"{state}, newest run {found.newest}, {found.age_days:.0f} days old"
    return {"gear": serial, "found": words, "changed": found.is_changed}


@bench.command("check")
def check(
    folder: Annotated[Path, _RUNS] = Path("runs"),
    gear: Annotated[
        str,
        typer.Option("--gear", metavar="SERIAL", help="The golden gear; rig.toml names it else."),
    ] = "",
    config: Annotated[Path | None, _CONFIG] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="The chart as HTML or PDF."),
    ] = None,
    json: Json = False,
) -> None:
    """Hold the golden gear against its first five runs: what changes with it is the bench.

    The serial, and every how many days it is to be measured, stand in [alarms] of rig.toml (golden_gear, golden_days).
    What all its runs share cancels in the difference; exit code 1 where a quantity has changed.
    """
    from rig.analysis.alarm.laboratory import watching_in_force
    from rig.analysis.golden import golden_check
    from rig.exits import FAIL
    from rig.present.golden import checked_grid, write_golden_page

    watching = watching_in_force(config)
    now = datetime.now(UTC)
    found = golden_check(folder, gear or watching.golden_gear, now)
    if output is not None:
        write_golden_page(found, output, now.astimezone().isoformat(timespec="seconds"))
    if json:
        print_json({**found.as_json(), "report": output})
    else:
        console().print(painted(checked_grid(found)))
        for one in found.quantities:
            echo(f"{one.title}: {one.sentence}")
        echo(f"newest run {found.newest}, {found.age_days:.1f} days old")
        if output is not None:
            echo(f"report in {output}")
    if found.is_changed:
        raise typer.Exit(FAIL)


def _curves(folder: Path) -> Iterator[_Told]:
    """The learnt curves of encoders."""
    from model.units import ARCSEC
    from rig.analysis.learnt import learnt_files
    from rig.content.wording import number

    for one in learnt_files(folder):
        largest = max(one.curve.expanded_uncertainties)
        yield {
            "file": one.path,
            "bench": one.header.bench,
            "of": "output encoder",
            "encoder": one.header.serial_number,
            "basis": f"{one.header.learnt}, {len(one.header.without)} gears",
            "date": one.header.date.isoformat(),
            "age_days": _days_since(one.header.date.isoformat()),
            "due": one.header.due,
            "gears": sorted(one.header.without),
            "expanded_uncertainty": largest,
            "u": f"{number(largest / ARCSEC, 2)} arcsec",
        }


def _scales(folder: Path) -> Iterator[_Told]:
    """The learnt scales of torque channels."""
    from rig.analysis.learnt import learnt_scales
    from rig.content.wording import number

    for file in learnt_scales(folder):
        scale = file.scale
        for one in scale.channel:
            yield {
                "file": file.path,
                "bench": scale.bench,
                "of": f"scale of {one.name}",
                "basis": scale.certificate,
                "date": scale.date.isoformat(),
                "age_days": _days_since(scale.date.isoformat()),
                "due": scale.due,
                "gain": one.gain,
                "expanded_uncertainty": 2.0 * one.relative_uncertainty,
                "u": f"{number(200.0 * one.relative_uncertainty, 2)} %",
            }


def _by_kind(runs: list[Path] | None, folder: Path) -> dict[str, list[Path]]:
    """The complete runs that teach something, by their protocol: those that were named, or all of a folder."""
    from rig.errors import ConfigurationError
    from rig.library.index import LibraryIndex

    named = set(runs or ())
    folders = {run.parent for run in named} or {
        folder,
        *(one for one in folder.glob("[!.]*") if one.is_dir()),
    }
    groups: dict[str, list[Path]] = {}
    for one in sorted(folders):
        for run in LibraryIndex(one).search():
            is_wanted = run.is_complete and (not named or run.path in named)
            if run.protocol in LESSONS and is_wanted:
                groups.setdefault(run.protocol, []).append(run.path)
    if not groups:
        raise ConfigurationError(
            "hold no run that teaches anything of a bench",
            where=", ".join(map(str, runs or [folder])),
            limit=f"complete runs of {', '.join(LESSONS)}",
        )
    return groups
