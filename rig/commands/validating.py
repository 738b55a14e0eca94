"""`rig validate`: models fitted to some runs and judged on others; a parameter set held against a run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.analysis import (
    Json,
    MissedShare,
    NoTare,
    Parameters,
    Settings,
    Tare,
    choices_of_flags,
    hold_against,
)
from rig.commands.naming import RUNS, RunsFolder, run_meant, runs_meant
from rig.commands.sealing import Unsealed
from rig.commands.terminal import console, painted, print_json
from rig.errors import nearest

if TYPE_CHECKING:
    from rig.analysis.validate import Validation


_Runs = Annotated[
    list[Path],
    typer.Argument(
        metavar="RUN...",
        help="Runs of one protocol, to be fitted: files, or their numbers in --runs.",
    ),
]

_On = Annotated[
    list[Path] | None,
    typer.Option(
        "--on",
        metavar="RUN",
        help="Judge on this run, which is not fitted; repeat it. Without it each run is held out in its turn.",
    ),
]

_Against = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Fit nothing: hold this parameter set (TOML) against one run, and say how far apart they are.",
    ),
]

_Kind = Annotated[str, typer.Option(help="Kind of fit, where the runs' protocol does not say it.")]

_Plot = Annotated[
    Path | None, typer.Option("--plot", metavar="FILE", help="Draw it as a picture (.png).")
]


def validate(
    runs: _Runs,
    on: _On = None,
    against: _Against = None,
    kind: _Kind = "",
    tare: Tare = None,
    no_tare: NoTare = False,
    parameters: Parameters = None,
    setting: Settings = None,
    largest_missed_share: MissedShare = None,
    plot: _Plot = None,
    runs_folder: RunsFolder = RUNS,
    unsealed: Unsealed = False,
    json: Json = False,
) -> None:
    """Judge models by runs that they were not fitted to: hold-out error, skill against the null model, BIC.

    Ladders: friction (mean torque to the paper's model), kinematic-error (no error to whole orders and
    sidebands), velocity-steps (rigid gear, the paper's equation 2, springs with hardening and hysteresis),
    motion (mean effort to Stribeck and load), order-spectrum (no order to the orders that are found).

    With --against no model is fitted: what a parameter set predicts of one run, and what was measured.
    """
    from rig.analysis.validate import validate_runs
    from rig.runfile.damage import refuse_missing

    _refuse_unknown_kind(kind)
    if against is not None and (len(runs) != 1 or on or plot or parameters):
        raise typer.BadParameter(
            "holds one parameter set against one run: leave --on, --plot and --parameters out",
            param_hint="--against",
        )
    runs, on = runs_meant(runs_folder, runs), runs_meant(runs_folder, on or ())
    tare = tare and run_meant(runs_folder, tare)
    refuse_missing(*runs, *on)
    choices = choices_of_flags(
        against or parameters,
        tare,
        setting,
        no_tare=no_tare,
        largest_missed_share=largest_missed_share,
    )
    if against is not None:
        hold_against(runs[0], against, kind, choices, json=json)
        return
    found = validate_runs(runs, on, kind, choices)
    if plot is not None:
        _draw(found, plot)
    if json:
        print_json(found.as_json())
    else:
        _print(found)


def _refuse_unknown_kind(kind: str) -> None:
    from experiments import catalogue

    if kind and kind not in catalogue.kinds():
        raise typer.BadParameter(
            f"no such kind of fit: {kind!r}. {nearest(kind, catalogue.kinds())}",
            param_hint="--kind",
        )


def _draw(found: Validation, path: Path) -> None:
    from rig.errors import RigError
    from rig.present.figure import draw_png

    try:
        path.write_bytes(draw_png(found.plot(), found.origin))
    except OSError as error:
        raise RigError(
            "the picture cannot be written",
            where=str(path),
            value=error.strerror or str(error),
            remedy="Choose another --plot.",
        ) from None


def _print(found: Validation) -> None:
    from rig.commands.visible import Text
    from rig.content.data import data_grid

    out, grid = console(), data_grid(found.table())
    out.print()
    out.print(painted(grid, title=f"{found.kind}: {grid.title}"))
    out.print(
        Text.assemble("  least hold-out error  ", (found.best.name, "bold")),
        soft_wrap=True,
    )
    out.print(
        Text(
            f"  least BIC             {found.best_by_bic.name} "
            f"(the rows are worth {found.independent:.0f} independent values)"
        ),
        soft_wrap=True,
    )
