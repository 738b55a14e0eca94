"""Inertia and stiffness of the output, from the torque port during the steps in which it rings."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable

import numpy as np

from experiments.budget import scale_line, torque_scale_uncertainty
from experiments.evidence.inertia import METHOD, Moved, inertia_of_the_input
from experiments.protocols.velocity_steps.data import RecordedStep
from experiments.recording import Recording
from experiments.tares.motor_heat import MotorHeat, motor_heat
from experiments.torque.running_torque import TEMPERATURE
from model.arrays import FloatArray
from model.identify.dynamics import Beside, LadderFit
from model.identify.estimate import BudgetLine, Estimate, Identifiable, coverage_factor
from model.identify.step_inertia import LEAST_STEPS, InertiaFit, fit_inertia
from model.units import RPM

_INERTIA_ABOVE = 250.0 * RPM
"""Input speed from which the torque of a step is asked for the inertia of the output."""
SCATTER, SMOOTHING = "scatter between the steps, and what they share", "smoothing of the rise"
SKEW = "torque delay"
TWICE = "all sides smoothed twice as wide"
AGAINST_CARDS = "input inertia against the cards"
_RUNG = "choice of the rung"
"""The line of the mode's budget that is computed anew for what torque tells."""


def output_inertia(
    recording: Recording,
    steps: list[RecordedStep],
    ladder: LadderFit,
    ratio: Estimate,
) -> dict[str, Estimate]:
    """J_o, the inertia on the input shaft and K from the torque of the steps in which the output rings.

    The acceleration of the output is measured, whatever its spring is: of the doubt of K/J_o (`ratio`) only that goes
    into J_o which another rung of the ladder makes of the acceleration. K has all of it.
    """
    rings = ladder.transient > steps[0].data.output_quantum
    asked = [
        index
        for index, (step, rung) in enumerate(zip(steps, rings, strict=True))
        if step.torque is not None and rung and abs(step.data.target) >= _INERTIA_ABOVE
    ]
    if len(asked) < LEAST_STEPS:
        return {}
    heat = motor_heat(recording, _housing(recording, steps))
    found = _fitted(steps, asked, ladder, ladder.acceleration)
    other = None
    if ladder.beside is not None:
        beside = _fitted(steps, asked, ladder, ladder.beside.acceleration)
        other = _OtherRung(ladder.beside, beside)
    estimates: dict[str, Estimate] = {}
    for name in ("output_inertia", "input_inertia"):
        value, own = found.values[name], _own_lines(found, name)
        if other is not None:
            own.append(other.line(value, other.fit.values[name]))
        bench = _bench_lines(recording, found, value, heat)
        estimates[name] = _estimate(name, "kg m2", value, own, bench, ratio)
    told = estimates["output_inertia"]
    estimates["output_stiffness"] = dataclasses.replace(
        _stiffness(recording, found, other, heat, ratio),
        identifiable=told.identifiable,
        note=told.note,
    )
    return estimates


@dataclasses.dataclass(frozen=True)
class _OtherRung:
    """What another rung of the ladder makes of the same torque."""

    rung: Beside
    fit: InertiaFit

    def line(self, value: float, here: float) -> BudgetLine:
        """How far a value is from what it is `here`."""
        return BudgetLine(_RUNG, "B", self.rung.share * abs(here - value), self.rung.note)


def _own_lines(found: InertiaFit, name: str) -> list[BudgetLine]:
    """What the steps do not tell of an inertia, whatever the rung of the ladder is."""
    smoothing, skew = found.smoothing[name] / math.sqrt(3.0), found.skew[name] / math.sqrt(3.0)
    return [
        BudgetLine(SCATTER, "A", found.errors[name], degrees_of_freedom=found.freedom[name]),
        BudgetLine(SMOOTHING, "B", smoothing, TWICE),
        BudgetLine(SKEW, "B", skew, "latched within half a cycle of the angles"),
    ]


def _stiffness(
    recording: Recording,
    found: InertiaFit,
    other: _OtherRung | None,
    heat: MotorHeat,
    ratio: Estimate,
) -> Estimate:
    """K, the inertia of the output by torque times K/J_o of the mode."""
    inertia = found.values["output_inertia"]
    value = inertia * ratio.value
    lines = [_share(line, ratio.value) for line in _own_lines(found, "output_inertia")]
    lines += [_share(line, abs(inertia)) for line in ratio.budget if line.source != _RUNG]
    if other is not None:
        lines.append(other.line(value, other.fit.values["output_inertia"] * other.rung.secant))
    bench = _bench_lines(recording, found, value, heat)
    return _estimate("output_stiffness", "N m/rad", value, lines, bench, ratio)


def _fitted(
    steps: list[RecordedStep],
    asked: list[int],
    ladder: LadderFit,
    accelerations: tuple[FloatArray, ...],
) -> InertiaFit:
    data = [steps[k].data for k in asked]
    torques = [torque for k in asked if (torque := steps[k].torque) is not None]
    series = (*steps[0].data.kinematic_error, *ladder.series(steps[0].data.ratio))
    return fit_inertia(data, torques, [accelerations[k] for k in asked], series)


def _housing(recording: Recording, steps: list[RecordedStep]) -> float:
    """Mean temperature of the housing in the steps [degC]; NaN where none was recorded."""
    if not recording.has(TEMPERATURE):
        return math.nan
    return float(np.mean([recording.si(TEMPERATURE, step.segment).mean() for step in steps]))


def _bench_lines(
    recording: Recording, found: InertiaFit, value: float, heat: MotorHeat
) -> list[BudgetLine]:
    """What the bench adds to a number that is proportional to torque."""
    lines = [scale_line(recording, value), heat.line(value)]
    moved = _against_the_cards(recording, found)
    if moved is not None and moved.is_apart:
        note = f"the input shaft shows {moved.ratio:.3g} of the inertia of rotor and wave generator"
        lines.append(BudgetLine(AGAINST_CARDS, "B", moved.scale * abs(value), note))
    return lines


def _against_the_cards(recording: Recording, found: InertiaFit) -> Moved | None:
    """The inertia of the input shaft over that of the cards of motor and gear; None where they are not at hand."""
    gear = recording.metadata.gear
    known = gear and inertia_of_the_input(recording, gear)
    if known is None:
        return None
    shown, error = found.values["input_inertia"], found.errors["input_inertia"]
    smoothing = found.smoothing["input_inertia"] / math.sqrt(3.0)
    own = math.hypot(error, smoothing) / abs(shown)
    ratio = shown / known[0]
    scale = torque_scale_uncertainty(recording)[0]
    return Moved(ratio, abs(ratio) * math.hypot(known[1] / known[0], own, scale, METHOD))


def _estimate(
    name: str,
    unit: str,
    value: float,
    own: list[BudgetLine],
    bench: Iterable[BudgetLine],
    ratio: Estimate,
) -> Estimate:
    """A number of the torque: its interval holds what these data cannot tell, its budget the bench as well."""
    half = math.hypot(
        *(coverage_factor(line.degrees_of_freedom) * line.standard_uncertainty for line in own)
    )
    verdict, note = _identifiability(value, half, ratio)
    return Estimate(
        name=name,
        value=value,
        unit=unit,
        low=value - half,
        high=value + half,
        identifiable=verdict,
        note=note,
        budget=(*own, *bench),
    )


def _share(line: BudgetLine, factor: float) -> BudgetLine:
    return dataclasses.replace(line, standard_uncertainty=line.standard_uncertainty * factor)


def _identifiability(value: float, half: float, ratio: Estimate) -> tuple[Identifiable, str]:
    """Whether an inertia is told: by the torque, and by a mode that the steps tell."""
    if value <= 2.0 * half:
        return ("weakly" if value > half else "no"), "the torque of the ringing hardly shows it"
    if ratio.identifiable != "yes":
        return "weakly", f"it rests on the mode, and {ratio.note}"
    return "yes", ""
