"""`rig bench`: what a bench knows of itself."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Iterator, Mapping
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Protocol

import typer

from rig.commands.terminal import Json, console, echo, painted, print_json

if TYPE_CHECKING:
    from rig.analysis.learnt_encoder import Learnt

bench = typer.Typer(
    name="bench",
    no_args_is_help=True,
    help="What a bench knows of itself: its output encoder, its torque scale.",
)
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
    told: list[dict[str, object]] = []
    for kind, named in groups.items():
        lesson = _LESSONS[kind](named, bench_id)
        if not (dry_run or json or lesson.is_certificate):
            # What it found is seen before it is refused as a certificate.
            lesson.show(None)
        path = None
        if not dry_run:
            beside = named[0].parent if runs else folder
            name = f"{lesson.prefix}-{lesson.bench}-{today.isoformat()}"
            path = lesson.write(output or free_name(beside, name, lesson.suffix), today, until)
        told.append({**lesson.as_json(), "file": None if path is None else str(path)})
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
    from rig.content.grid import Grid, columns
    from rig.errors import ConfigurationError

    learnt, tares = [*_curves(folder), *_scales(folder)], list(_tares(folder))
    stated, commissioned = _described(folder, config)
    if not (learnt or tares or stated or commissioned):
        raise ConfigurationError(
            "holds nothing that a bench learnt, and no tare",
            where=str(folder),
            remedy=f"Learn its instruments: rig bench learn --runs {folder}",
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
    heads = columns(
        "what", ("U", "number"), ("age [d]", "number"), "due", "bench", "file", "rests on"
    )
    keys = ("of", "u", "age_days", "due", "bench", "file", "basis")
    rows = [tuple("" if one[key] is None else str(one[key]) for key in keys) for one in learnt]
    out = console()
    if rows:
        out.print(painted(Grid("What the benches learnt of themselves", heads, rows)))
    heads = columns("run", "bench", ("age [d]", "number"))
    rows = [tuple(str(one[key]) for key in ("run", "bench", "age_days")) for one in tares]
    if rows:
        out.print(painted(Grid("Motor tares, the newest first", heads, rows)))
    for title, keys, found in (
        ("Calibrations that the description states", ("channel", "certificate", "due"), stated),
        ("Commissioned", ("stage", "passed", "at", "operator"), commissioned),
    ):
        if found:
            rows = [tuple(str(one[key]) for key in keys) for one in found]
            out.print(painted(Grid(title, columns(*keys), rows)))
    if golden is not None:
        echo(f"golden gear {golden['gear']}: {golden['found']}")


def _described(
    folder: Path, config: Path | None
) -> tuple[list[dict[str, object]], list[dict[str, object]]]:
    """The calibrations that a description states, and the stages of its bench as they came out last; nothing without
    one of hardware.
    """
    from rig.bench.backends.registry import HARDWARE
    from rig.bench.commissioning import read_record
    from rig.bench.config.load import load_configuration
    from rig.bench.config.place import DEFAULT_PATH
    from rig.bench.identity import bench_of

    path = config or DEFAULT_PATH
    if not path.is_file() or not is_bench(path):
        return [], []
    stated = list(_calibrations("", load_configuration(path).model_dump()))
    newest = {done.stage: done for done in read_record(bench_of(HARDWARE, folder, path).state)}
    return stated, [
        {"stage": one.stage, "passed": one.passed, "at": one.at, "operator": one.operator}
        for one in newest.values()
    ]


def is_bench(path: Path) -> bool:
    """Whether a description has more than the tables of a laboratory: a bus."""
    return "bus" in tomllib.loads(path.read_text(encoding="utf-8"))


def _calibrations(place: str, content: object) -> Iterator[dict[str, object]]:
    """Every calibration with a certificate within a description, by its place."""
    if not isinstance(content, Mapping):
        return
    for name, value in content.items():
        where = f"{place}.{name}".lstrip(".")
        if name == "calibration" and isinstance(value, Mapping) and value.get("certificate"):
            yield {
                "channel": place,
                "certificate": value["certificate"],
                "due": "" if value.get("due") is None else str(value["due"]),
            }
        else:
            yield from _calibrations(where, value)


def _days_since(text: str) -> int:
    """Whole days from a date or a time to now."""
    return (datetime.now(UTC).date() - date.fromisoformat(text[:10])).days


def _tares(folder: Path) -> Iterator[dict[str, object]]:
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


def _golden(folder: Path, config: Path | None) -> dict[str, object] | None:
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
        print_json({**found.as_json(), "report": None if output is None else str(output)})
    else:
        console().print(painted(checked_grid(found)))
        for one in found.quantities:
            echo(f"{one.title}: {one.sentence}")
        echo(f"newest run {found.newest}, {found.age_days:.1f} days old")
        if output is not None:
            echo(f"report in {output}")
    if found.is_changed:
        raise typer.Exit(FAIL)


def _curves(folder: Path) -> Iterator[dict[str, object]]:
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
            "due": None if one.header.due is None else one.header.due.isoformat(),
            "gears": sorted(one.header.without),
            "expanded_uncertainty": largest,
            "u": f"{number(largest / ARCSEC, 2)} arcsec",
        }


def _scales(folder: Path) -> Iterator[dict[str, object]]:
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
                "due": None if scale.due is None else scale.due.isoformat(),
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
            if run.protocol in _LESSONS and is_wanted:
                groups.setdefault(run.protocol, []).append(run.path)
    if not groups:
        raise ConfigurationError(
            "hold no run that teaches anything of a bench",
            where=", ".join(map(str, runs)) if runs else str(folder),
            limit=f"complete runs of {', '.join(_LESSONS)}",
        )
    return groups


class _Lesson(Protocol):
    """What the runs of one protocol teach: to be shown, told to a script, and written."""

    bench: str
    prefix: str
    suffix: str
    is_certificate: bool

    def show(self, path: Path | None) -> None: ...

    def as_json(self) -> dict[str, object]: ...

    def write(self, path: Path, today: date, due: date) -> Path: ...


class _EncoderLesson:
    """The output encoder, by kinematic-error runs."""

    suffix = ".csv"

    def __init__(self, runs: list[Path], bench_id: str) -> None:
        from rig.analysis.learnt import PREFIX
        from rig.analysis.learnt_encoder import learn as learn_from

        self.prefix = PREFIX
        self._learnt = learn_from(runs, bench_id)
        self.bench, self.is_certificate = self._learnt.bench, self._learnt.curve.is_parted

    def show(self, path: Path | None) -> None:
        _print(self._learnt, path)

    def as_json(self) -> dict[str, object]:
        return _as_json(self._learnt)

    def write(self, path: Path, today: date, due: date) -> Path:
        from rig.analysis.learnt_encoder import write_learnt

        return write_learnt(self._learnt, path, today, due)


class _TorqueLesson:
    """The scale of the torque channels, by torque-scale runs."""

    suffix = ".toml"
    is_certificate = True

    def __init__(self, runs: list[Path], bench_id: str) -> None:
        from rig.analysis.learnt import SCALE_PREFIX
        from rig.analysis.learnt_torque import learn_torque

        self.prefix = SCALE_PREFIX
        self._learnt = learn_torque(runs, bench_id)
        self.bench = self._learnt.bench

    def show(self, path: Path | None) -> None:
        from rig.content.grid import Grid, columns
        from rig.content.wording import number

        learnt = self._learnt
        rows = [
            (
                name,
                number(gain.value, 5),
                number(100.0 * gain.expanded_uncertainty / gain.value, 2),
                number(1e3 * learnt.lags[name][0], 2) if name in learnt.lags else "",
                max(gain.budget, key=lambda line: line.standard_uncertainty).source,
            )
            for name, gain in learnt.gains.items()
        ]
        heads = columns(
            "channel",
            ("gain", "number"),
            ("U [%]", "number"),
            ("lag [ms]", "number"),
            "largest part of U",
        )
        at = f" at {learnt.temperature:.1f} °C" if math.isfinite(learnt.temperature) else ""
        grid = Grid(f"Torque scale of bench {learnt.bench}{at}", heads, rows)
        console().print(painted(grid.without_empty()))
        echo(
            f"from {'; '.join(learnt.discs)}; the rotor has {number(1e4 * learnt.rotor_inertia, 4)} kg cm2"
        )
        for one in learnt.skipped:
            echo(f"left out: {one.run.name}: {one.skipped}")
        _say_written(path, self.prefix)

    def as_json(self) -> dict[str, object]:
        learnt = self._learnt
        return {
            "of": "torque scale",
            "bench": learnt.bench,
            "origin": learnt.origin,
            "motor": learnt.motor,
            "housing_temperature": learnt.temperature,
            "rotor_inertia": learnt.rotor_inertia,
            "gains": {name: gain.as_json() for name, gain in learnt.gains.items()},
            "lags": {name: {"value": v, "u": u} for name, (v, u) in learnt.lags.items()},
            "left_out": [{"run": one.run.name, "reason": one.skipped} for one in learnt.skipped],
        }

    def write(self, path: Path, today: date, due: date) -> Path:
        from rig.analysis.learnt_torque import write_scale

        return write_scale(self._learnt, path, today, due)


_LESSONS: dict[str, Callable[[list[Path], str], _Lesson]] = {
    "kinematic-error": _EncoderLesson,
    "torque-scale": _TorqueLesson,
}
"""By the protocol whose runs teach it."""


def _say_written(path: Path | None, prefix: str) -> None:
    if path is None:
        return
    echo(f"file         {path}")
    if path.name.startswith(prefix):
        echo(f"next         rig fit RUN of {path.parent}: every analysis takes it")
    else:
        echo(f"next         lay it beside the runs as {prefix}...: there every analysis takes it")


def _print(learnt: Learnt, path: Path | None) -> None:
    from model.units import ARCSEC
    from rig.analysis.learnt import PREFIX
    from rig.content.grid import Grid, columns, number_columns
    from rig.content.wording import number

    curve = learnt.curve
    rows = [
        (
            f"{one.order}/N",
            number(abs(one.wave) / ARCSEC, 3),
            number(one.radius / ARCSEC, 2),
            number(one.gears / ARCSEC, 2),
            "" if one.way == "parted" else "mean: encoder and what gears share",
        )
        for one in curve.orders
    ]
    heads = number_columns("order", "encoder [arcsec]", "U", "gears differ by")
    grid = Grid(
        f"Output encoder of bench {learnt.bench}: {curve.basis}",
        (*heads, *columns(("remark", "sentence"))),
        rows,
        "U: 95 % of the errors of the complex amplitude are no longer. Orders above 8 and the subdivision stay.",
    )
    console().print(painted(grid.without_empty()))
    echo(
        f"{len(curve.gears)} gear{'s' * (len(curve.gears) > 1)} in {curve.mountings} mountings; U of the curve "
        f"{number(curve.expanded_uncertainty / ARCSEC, 2)} arcsec. Not traceable: no laboratory vouches for it."
    )
    for one in learnt.skipped:
        echo(f"left out: {one.run.name}: {one.skipped}")
    _say_written(path, PREFIX)


def _as_json(learnt: Learnt) -> dict[str, object]:
    curve = learnt.curve
    return {
        "of": "output encoder",
        "bench": learnt.bench,
        "encoder": learnt.encoder,
        "origin": learnt.origin,
        "basis": curve.basis,
        "gears": list(curve.gears),
        "mountings": curve.mountings,
        "expanded_uncertainty": curve.expanded_uncertainty,
        "orders": [
            {
                "order": one.order,
                "cosine": one.wave.real,
                "sine": one.wave.imag,
                "standard_uncertainty": one.standard_uncertainty,
                "degrees_of_freedom": one.degrees_of_freedom,
                "radius": one.radius,
                "way": one.way,
                "gears": one.gears,
            }
            for one in curve.orders
        ],
        "left_out": [{"run": one.run.name, "reason": one.skipped} for one in learnt.skipped],
    }
