"""`rig preview`: what the model expects of a plan on this gear, before anything moves."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.running import (
    Config,
    Help,
    Json,
    MountedHow,
    Parameters,
    SampleRate,
    read_protocol,
    with_protocol_flags,
)
from rig.commands.terminal import console, print_json, table
from rig.commands.worlds import GearSeed, PopulationName, world_choice

if TYPE_CHECKING:
    from rig.present.preview.plan import PlanPreview


@with_protocol_flags
def preview(
    context: typer.Context,
    parameters: Parameters = None,
    mounting: MountedHow = None,
    sample_rate: SampleRate = None,
    config: Config = None,
    gear_serial: Annotated[
        str,
        typer.Option(
            "--gear",
            metavar="SERIAL",
            help="Gear whose card tells part, mounting and load inertia.",
        ),
    ] = "",
    output: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder of the run files, with the gear cards.")
    ] = Path("runs"),
    figures: Annotated[
        Path | None,
        typer.Option(
            "--figures", metavar="DIR", help="Write speed, torque, output and friction as PNG here."
        ),
    ] = None,
    gear_seed: GearSeed = None,
    population: PopulationName = "narrow",
    json: Json = False,
    show_help: Help = False,
) -> None:
    """Predict torque and output of a plan with their uncertainty, and say which limit they touch.

    Usage: rig preview PROTOCOL [flags of the protocol]. Quasi-static, by the gear's parameter set;
    a gear card gives the load inertia with its uncertainty. Nothing is connected.
    """
    if show_help:
        from rig.commands.run_tables import print_help

        print_help(context)
        raise typer.Exit
    from rig.commands.ordering import request_of
    from rig.errors import ConfigurationError
    from rig.gears.card import card_for
    from rig.present.preview.plan import preview_plan
    from rig.run.start import plan_request

    protocol, values = read_protocol(context.args)
    if gear_serial and card_for(output, gear_serial) is None:
        raise ConfigurationError(
            "there is no card of this gear",
            where=str(output),
            value=gear_serial,
            remedy="Write one with `rig gear set`.",
        )
    request = request_of(
        protocol,
        values,
        config=config,
        parameters=parameters,
        mounting=mounting,
        sample_rate=sample_rate,
        output=output,
        gear_serial=gear_serial,
        world=world_choice(gear_seed=gear_seed, population=population),
    )
    prediction = preview_plan(plan_request(request))
    written = _write_figures(prediction, figures, request.backend) if figures is not None else []
    if json:
        print_json({**prediction.as_json(), "figures": [str(path) for path in written]})
        return
    _print(prediction, written)


def _write_figures(prediction: PlanPreview, folder: Path, backend: str) -> list[Path]:
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
    from model.units import RPM
    from rig.present.preview.plan import percent
    from rig.run.progress import in_words

    out = console()
    planned = prediction.planned
    out.print(
        f"{planned.experiment.name} on {planned.gear.name}, {planned.mounting}: {in_words(planned.nominal)} nominal",
        markup=False,
    )
    start = prediction.starting
    out.print(
        f"predicted starting torque {1e3 * float(start.value):.0f} ± {1e3 * float(start.uncertainty):.0f} mN m (95 %)"
    )
    headings = ("limit on", "predicted", "limit", "margin", "least margin", "where")
    margins = table(*headings, title="Margins with their uncertainty")
    for margin in prediction.margins:
        factor, unit = (RPM, "r/min") if margin.limit.unit == "rad/s" else (1.0, margin.limit.unit)
        doubt = f" ± {margin.uncertainty / factor:.2g}" if margin.uncertainty else ""
        margins.add_row(
            margin.quantity.replace("_", " "),
            f"{margin.value / factor:.4g}{doubt} {unit}",
            f"{margin.limit.value / factor:.4g} {unit}",
            percent(margin.margin),
            percent(margin.least_margin),
            margin.where,
            style="yellow" if margin.touches else None,
        )
    out.print(margins)
    for warning in prediction.warnings:
        out.print(f"warning: {warning.text}", style="yellow", soft_wrap=True)
    for path in written:
        out.print(str(path), soft_wrap=True)
