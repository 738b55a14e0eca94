"""A run once more: every identity, the start state, the parameters and the seeds are those that its file names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from experiments.recording import RunMetadata
from model.gear_file import gear_from_mapping
from rig.bench.backends.assembly import WORLD_OF_0_2_0
from rig.bench.backends.order import Order, StartState, WorldChoice
from rig.errors import ConfigurationError
from rig.program import version as program_version
from rig.run.start import plan_order
from rig.runfile.read import close_recording, open_run, read_run_header


def repetition(path: Path, order: Order) -> tuple[Order, str]:
    """The order that gives the counts of a recorded run again, and a warning where another program made it.

    Folder, operator, motor, limits and block length are those of `order`. Raises `RunFileError`
    for a file that cannot be read or was changed, `ConfigurationError` for a run that was made in no simulated
    world, or under other limits than those of this order.
    """
    # Against its seal first: what was changed since is no run to go by.
    close_recording(open_run(path, rows=False))
    header = read_run_header(path)
    run, process = header.metadata, header.metadata.process
    world = _world(run, path)
    repeated = replace(
        order,
        protocol=run.experiment,
        gear=_nominal(world, run.gear, order),
        values=run.parameters,
        backend=process["backend"],
        mounting=run.mounting,
        serial=run.gear_serial,
        seed=process["seed"],
        sample_rate=run.sample_rate,
        conditions=run.conditions,
        world=_choice(world, run.run_id),
    )
    planned = plan_order(repeated)
    for what, then, now in (
        ("limits", dict(header.limits), planned.limits.as_json()),
        ("motor", process["motor"], planned.motor.name),
    ):
        if then != now:
            raise ConfigurationError(
                f"the {what} are not those of the run that is to be repeated",
                where="--repeat",
                value=path.name,
                limit=f"the {what} that its file names",
                remedy="Give the --config that it was made with.",
            )
    version, now = process["program_version"], program_version()
    if version == now:
        return repeated, ""
    return (
        repeated,
        f"{run.run_id} was made by version {version}, this is {now}: counts may differ",
    )


def _world(run: RunMetadata, path: Path) -> Mapping[str, Any]:
    """The simulated world of a run. Raises `ConfigurationError` where it names none."""
    world: Mapping[str, Any] | None = run.process.get("world")
    if not isinstance(world, Mapping):
        raise ConfigurationError(
            "this run cannot be made again",
            where="--repeat",
            value=path.name,
            limit="a run of a simulated rig that names its world",
            remedy="Only a simulated rig does the same twice; version 0.1.0 did not say which it was.",
        )
    return world


def _nominal(world: Mapping[str, Any], gear: Any, order: Order) -> Any:
    """The gear that the world's own was drawn about: the run's own card, but in a population with cards of its own."""
    if "drawn_about" in world:
        return gear_from_mapping(world["drawn_about"], "world.drawn_about")
    return gear or order.gear


def _choice(world: Mapping[str, Any], run_id: str) -> WorldChoice:
    names = {f.name for f in fields(WorldChoice)} - {"start", "repeats"}
    start, stated = dict(world["start"]), {**WORLD_OF_0_2_0, **world}
    return WorldChoice(
        **{name: stated[name] for name in names & stated.keys()},
        start=StartState(start.pop("run"), start),
        repeats=run_id,
    )
