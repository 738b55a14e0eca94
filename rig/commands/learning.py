"""`rig bench`: what a bench knows of itself."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.analysis import Json
from rig.commands.terminal import console, echo, painted, print_json

if TYPE_CHECKING:
    from rig.analysis.learnt_encoder import Learnt

bench = typer.Typer(
    name="bench", no_args_is_help=True, help="What a bench knows of itself: its output encoder."
)
_RUNS = typer.Option("--runs", metavar="DIR", help="Folder of the runs.")


@bench.callback()
def _group() -> None:
    """What a bench knows of itself: its output encoder."""


@bench.command("learn")
def learn(
    runs: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[RUN]...", help="Kinematic-error runs; all of the folder without."),
    ] = None,
    folder: Annotated[Path, _RUNS] = Path("runs"),
    bench_id: Annotated[
        str, typer.Option("--bench", metavar="ID", help="Which bench, where there are several.")
    ] = "",
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="FILE", help="A new file; beside the runs without it."
        ),
    ] = None,
    due: Annotated[
        datetime | None,
        typer.Option(
            formats=["%Y-%m-%d"],
            metavar="YYYY-MM-DD",
            help="Until when it is taken; a year without it.",
        ),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Say what is learnt, write nothing.")
    ] = (False),
    json: Json = False,
) -> None:
    """Learn the output encoder from gears that were mounted at stated angles, and write its certificate.

    Several gears (eight, at angles spread over the turn) or one gear at three angles (0, 30, 150 degrees) part what
    is the encoder's from what is the gears'. The angle stands on the gear's card (mounted at deg). Every later
    analysis of a run of this bench takes the curve; a run of a gear that taught it gets what the others teach.
    Without stated angles the encoder holds what all gears share, which is said, with a line for it.
    """
    from rig.analysis.learnt_curve import PREFIX
    from rig.analysis.learnt_encoder import learn as learn_from
    from rig.analysis.learnt_encoder import write_learnt

    named = list(runs or ()) or _runs_of(folder)
    learnt = learn_from(named, bench_id)
    path = None
    if not (dry_run or json or learnt.curve.is_parted):
        # What it found is seen before it is refused as a certificate.
        _print(learnt, None)
    if not dry_run:
        today = datetime.now(UTC).date()
        until = today + timedelta(days=365) if due is None else due.date()
        beside = named[0].parent if runs else folder
        where = output or beside / f"{PREFIX}-{learnt.bench}-{today.isoformat()}.csv"
        path = write_learnt(learnt, where, today, until)
    if json:
        print_json(_as_json(learnt, path))
    else:
        _print(learnt, path)


@bench.command("show")
def show(
    folder: Annotated[Path, _RUNS] = Path("runs"),
    json: Json = False,
) -> None:
    """Show what was learnt of the benches whose runs lie in a folder, what it rests on, and until when it holds."""
    from model.units import ARCSEC
    from rig.analysis.learnt_curve import learnt_files
    from rig.content.grid import Grid, columns
    from rig.content.wording import number
    from rig.errors import ConfigurationError

    found = learnt_files(folder)
    if not found:
        raise ConfigurationError(
            "holds nothing that a bench learnt",
            where=str(folder),
            remedy=f"Learn its encoder: rig bench learn --runs {folder}",
        )
    if json:
        rows = [
            {
                "file": one.path,
                "bench": one.header.bench,
                "encoder": one.header.serial_number,
                "basis": one.header.learnt,
                "date": one.header.date.isoformat(),
                "due": None if one.header.due is None else one.header.due.isoformat(),
                "gears": sorted(one.header.without),
                "expanded_uncertainty": max(one.curve.expanded_uncertainties),
            }
            for one in found
        ]
        print_json({"learnt": rows})
        return
    heads = columns("file", "bench", "rests on", "gears", "date", "due", ("U [arcsec]", "number"))
    rows = [
        (
            one.path,
            one.header.bench,
            one.header.learnt,
            str(len(one.header.without)),
            one.header.date.isoformat(),
            "" if one.header.due is None else one.header.due.isoformat(),
            number(max(one.curve.expanded_uncertainties) / ARCSEC, 2),
        )
        for one in found
    ]
    console().print(painted(Grid("Output encoders that were learnt", heads, rows)))


def _runs_of(folder: Path) -> list[Path]:
    """The complete kinematic-error runs of a folder."""
    from rig.analysis.learnt_encoder import KIND
    from rig.library.index import LibraryIndex

    folders = (folder, *sorted(one for one in folder.glob("[!.]*") if one.is_dir()))
    found = [run for one in folders for run in LibraryIndex(one).search()]
    return [run.path for run in found if run.protocol == KIND and run.is_complete]


def _print(learnt: Learnt, path: Path | None) -> None:
    from model.units import ARCSEC
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
        f"{len(curve.gears)} gears in {curve.mountings} mountings; U of the curve "
        f"{number(curve.expanded_uncertainty / ARCSEC, 2)} arcsec. Not traceable: no laboratory vouches for it."
    )
    for one in learnt.skipped:
        echo(f"left out: {one.run.name}: {one.skipped}")
    if path is not None:
        echo(f"certificate  {path}")
        echo(f"next         rig fit RUN of {path.parent}: every analysis takes it")


def _as_json(learnt: Learnt, path: Path | None) -> dict[str, object]:
    curve = learnt.curve
    return {
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
        "file": None if path is None else str(path),
    }
