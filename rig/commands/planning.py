"""`rig plan`: a protocol walked without a rig, and what the model expects of it on this gear."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.ordering import NoCard, Said, with_order
from rig.commands.running import Help, Json, read_protocol, with_protocol_flags
from rig.commands.terminal import console, painted, print_json

if TYPE_CHECKING:
    from rig.present.preview.plan import PlanPreview


@with_protocol_flags
@with_order(
    "gear",
    "mounting",
    "sample_rate",
    "config",
    "serial",
    "folder",
    "world",
    world=("gear_seed", "population"),
)
def plan(
    context: typer.Context,
    said: Said,
    figures: Annotated[
        Path | None,
        typer.Option(
            "--figures", metavar="DIR", help="Write speed, torque, output and friction as PNG here."
        ),
    ] = None,
    no_card: NoCard = False,
    json: Json = False,
    show_help: Help = False,
) -> None:
    """Walk a protocol without a rig: duration, revolutions, samples, file size, peaks; margin to each
    limit as planned and as predicted.

    Usage: rig plan PROTOCOL \\[flags of the protocol]. A plan that would break a limit is refused
    with the step, the value and the limit (exit code 2). Torque and output are predicted quasi-statically,
    by the gear's parameter set, with their uncertainty; a gear card gives the load inertia.
    """
    if show_help:
        from rig.commands.run_tables import print_help

        print_help(context)
        raise typer.Exit
    from rig.analysis.tare import tares_wanted
    from rig.commands.ordering import order_of
    from rig.commands.run_tables import print_plan
    from rig.present.preview.plan import preview_plan
    from rig.run.start import plan_order

    protocol, values = read_protocol(context.args)
    order = order_of(protocol, values, said, no_card=no_card)
    planned = plan_order(order)
    prediction = preview_plan(planned)
    written = _write_figures(prediction, figures) if figures is not None else []
    wanted = tares_wanted(protocol, order.folder)
    if json:
        told = prediction.as_json()
        if wanted:
            told["warnings"].append(wanted)
        figures_told = [str(path) for path in written]
        print_json({**planned.as_json(), "prediction": told, "figures": figures_told})
        return
    print_plan(planned)
    _print(prediction, written)
    if wanted:
        console().print(f"warning: {wanted}", style="yellow", soft_wrap=True)


def _write_figures(prediction: PlanPreview, folder: Path) -> list[Path]:
    from rig.errors import RigError
    from rig.present.figure import draw_png
    from rig.present.preview.figures import figures_of

    written = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, plot in figures_of(prediction).items():
            path = folder / f"{prediction.planned.experiment.name}-preview-{name}.png"
            # A prediction is marked as what it is; it is no recording that could be a rig's own.
            path.write_bytes(draw_png(plot, "prediction"))
            written.append(path)
    except OSError as error:
        raise RigError(
            f"the figures cannot be written: {error.strerror or error}", where=str(folder)
        ) from error
    return written


def _print(prediction: PlanPreview, written: list[Path]) -> None:
    from rig.present.preview.plan import predicted_grid

    out = console()
    start = prediction.starting
    out.print(
        f"predicted starting torque {1e3 * float(start.value):.0f} ± {1e3 * float(start.uncertainty):.0f} mN m (95 %)"
    )
    # What is commanded stands in the plan's own table; here is what depends on the gear.
    grid = predicted_grid(margin for margin in prediction.margins if margin.uncertainty)
    out.print(painted(grid.without("held by")))
    for warning in prediction.warnings:
        out.print(f"warning: {warning.text}", style="yellow", soft_wrap=True)
    for path in written:
        out.print(str(path), soft_wrap=True)
