"""The only list of protocols and analyses: names and summaries at once, modules only when one is asked for.

Behind ours stand those of other packages (`experiments.extensions`), imported only by whoever uses them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib import import_module
from typing import TYPE_CHECKING

from experiments import extensions
from experiments.errors import ExtensionError, PlanError
from experiments.extensions import Extension
from experiments.quantity import Quantity, quantity_of

if TYPE_CHECKING:
    from experiments.contract import Evidence, Experiment
    from experiments.ladder import Ladder
    from experiments.recording import Recording
    from experiments.result import Result


@dataclass(frozen=True)
class Entry:
    """One line of the catalogue: the name people type, its module, one line of summary, and whether it moves a rig.

    `ladder` is the module of the models that its runs can be judged by, where there is one. `extension` is what
    another package brought.
    """

    name: str
    module: str
    summary: str
    has_plan: bool = True
    ladder: str = ""
    extension: Extension | None = None


ENTRIES: tuple[Entry, ...] = (
    Entry(
        "kinematic-error",
        "experiments.protocols.kinematic_error.declaration",
        "kinematic error over whole output revolutions at low speed, both directions (figures 12, 13, 16)",
        ladder="experiments.protocols.kinematic_error.ladder",
    ),
    Entry(
        "compensated-error",
        "experiments.protocols.compensated_error.declaration",
        "the same turn of the output without and with a table that takes the kinematic error out",
    ),
    Entry(
        "friction",
        "experiments.protocols.friction.declaration",
        "no-load running torque at constant speeds, both directions, up and down (figures 9, 17)",
        ladder="experiments.protocols.friction.ladder",
    ),
    Entry(
        "velocity-steps",
        "experiments.protocols.velocity_steps.declaration",
        "speed steps, simulated output against measured output per speed (figure 19)",
        ladder="experiments.protocols.velocity_steps.ladder",
    ),
    Entry(
        "motor-tare",
        "experiments.protocols.motor_tare.declaration",
        "friction and cogging of the bare motor, gear removed",
    ),
    Entry(
        "torque-scale",
        "experiments.protocols.torque_scale.declaration",
        "torque shown per torque that accelerates a known inertia, gear removed",
    ),
    Entry(
        "warm-up",
        "experiments.protocols.warm_up.declaration",
        "turn until the running torque is steady",
    ),
    Entry(
        "starting-torque",
        "experiments.protocols.starting_torque.declaration",
        "slow torque ramps at several wave-generator positions, ended by first motion",
    ),
    Entry(
        "home",
        "experiments.protocols.home.declaration",
        "index marks of both encoders, slowly, from one side",
    ),
    Entry(
        "motion",
        "experiments.recordings.motion.declaration",
        "inertia and friction from any motion (inverse dynamics)",
        has_plan=False,
        ladder="experiments.recordings.motion_models",
    ),
    Entry(
        "friction-curve",
        "experiments.recordings.friction_curve.declaration",
        "friction law of a table of speed and torque: Coulomb, viscous, Stribeck",
        has_plan=False,
    ),
    Entry(
        "revolution",
        "experiments.recordings.revolution.declaration",
        "Fourier series of a channel per revolution, both ways",
        has_plan=False,
    ),
    Entry(
        "order-spectrum",
        "experiments.recordings.order_spectrum.declaration",
        "order spectrum of a channel over an angle",
        has_plan=False,
        ladder="experiments.recordings.order_models",
    ),
    Entry(
        "skew",
        "experiments.recordings.skew.declaration",
        "delay between two channels, apart from hysteresis",
        has_plan=False,
    ),
    Entry(
        "hysteresis",
        "experiments.recordings.hysteresis.declaration",
        "stiffness, loss and lost motion from loops of output torque",
        has_plan=False,
    ),
)
"""Protocols first, in the order of a day on the rig; then the analyses that need no plan."""


def entries() -> tuple[Entry, ...]:
    """Ours, then those of other packages; nothing is imported."""
    brought = extensions.usable(("protocols", "fits"), {ours.name for ours in ENTRIES})
    return (*ENTRIES, *(_entry_of(one) for one in brought))


def _entry_of(one: Extension) -> Entry:
    summary = f"{one.summary or 'no summary'} ({one.package} {one.version})"
    return Entry(one.name, "", summary, has_plan=one.group == "protocols", extension=one)


def names() -> tuple[str, ...]:
    """The protocols that can be planned and run."""
    return tuple(entry.name for entry in entries() if entry.has_plan)


def kinds() -> tuple[str, ...]:
    """Every kind of fit: the protocols' own analyses and those that need no plan."""
    return tuple(entry.name for entry in entries())


def entry(name: str) -> Entry:
    """The line of one name; an unknown one is a `PlanError` that lists those there are."""
    for candidate in entries():
        if candidate.name == name:
            return candidate
    for one, why in extensions.left_out():
        if one.name == name:
            raise one.refused(why)
    raise PlanError(
        "no such protocol or analysis", where="protocol", value=repr(name), limit=", ".join(kinds())
    )


def extension_of(name: str) -> Extension | None:
    """The package that brought a protocol or analysis; None for ours and for a name that is none."""
    return next((one.extension for one in entries() if one.name == name), None)


def every() -> Iterator[Experiment]:
    """All that are there, loaded one after the other; one of another package that does not load is left out."""
    for name in kinds():
        experiment = declared(name)
        if experiment is not None:
            yield experiment


def ladders() -> tuple[str, ...]:
    """The kinds whose runs can be judged by a ladder of models."""
    return tuple(entry.name for entry in entries() if entry.ladder)


def ladder(name: str) -> Ladder:
    """The ladder of models of this kind, for recordings that pass its checks; a kind without one is a `PlanError`."""
    from experiments.evidence.conclusion import checked_sample

    found = entry(name)
    if not found.ladder:
        raise PlanError(
            "there is no ladder of models of this kind",
            where="kind",
            value=repr(name),
            limit=", ".join(ladders()),
        )
    made: Ladder = import_module(found.ladder).LADDER
    return replace(made, sample=checked_sample(load(name), made.sample))


def declared(name: str) -> Experiment | None:
    """The protocol or analysis of this name; None for a name in a recording that this catalogue does not have, or whose
    package does not load.
    """
    if name not in kinds():
        return None
    try:
        return load(name)
    except ExtensionError:
        # It is named among those that were left out (`experiments.extensions.left_out`).
        return None


def declared_quantity(kind: str, name: str) -> Quantity | None:
    """What a protocol declares of a quantity; None of one that it does not declare, or that nobody knows any more."""
    experiment = declared(kind)
    return experiment and quantity_of(experiment.quantities, name)


def load(name: str) -> Experiment:
    """The protocol (or plan-less analysis) of this name, its module imported now.

    Its `analyse` is the protocol's own after every recording has passed the table of checks.
    """
    found = entry(name)
    experiment = _brought(found) if found.extension else import_module(found.module).EXPERIMENT

    def checked(recording: Recording, evidence: Evidence) -> Result:
        # The checks need the array libraries, and whoever asks only what a protocol declares does not.
        from experiments.evidence.conclusion import checked_analysis

        return checked_analysis(experiment)(recording, evidence)

    return replace(experiment, analyse=checked)


def _brought(found: Entry) -> Experiment:
    """What another package declares. Raises `ExtensionError` where that is no experiment of its group."""
    from experiments.contract import Experiment

    assert found.extension is not None
    experiment: Experiment = found.extension.loaded(Experiment)
    if experiment.has_plan != found.has_plan:
        wrong = "fits" if found.has_plan else "protocols"
        raise found.extension.refused(f"belongs into the group {extensions.PREFIX}{wrong}")
    return experiment
