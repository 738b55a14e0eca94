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
from model.identify.dynamics import LadderFit
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
    beside = ladder.beside
    other = None if beside is None else _fitted(steps, asked, ladder, beside.acceleration)

    def lines_of(name: str) -> list[BudgetLine]:
        value, error = found.values[name], found.errors[name]
        lines = [
            BudgetLine(SCATTER, "A", error, degrees_of_freedom=found.freedom[name]),
            BudgetLine(SMOOTHING, "B", found.smoothing[name] / math.sqrt(3.0), TWICE),
            BudgetLine(
                SKEW,
                "B",
                found.skew[name] / math.sqrt(3.0),
                "latched within half a cycle of the angles",
            ),
        ]
        if beside is not None and other is not None:
            away = abs(other.values[name] - value)
            lines.append(BudgetLine(_RUNG, "B", beside.share * away, beside.note))
        return lines

    estimates: dict[str, Estimate] = {}
    for name in ("output_inertia", "input_inertia"):
        own = lines_of(name)
        bench = _bench_lines(recording, found, found.values[name], heat)
        estimates[name] = _estimate(name, "kg m2", found.values[name], own, bench, ratio)
    inertia = found.values["output_inertia"]
    value = inertia * ratio.value
    lines = [
        _share(line, ratio.value) for line in lines_of("output_inertia") if line.source != _RUNG
    ]
    lines += [_share(line, abs(inertia)) for line in ratio.budget if line.source != _RUNG]
    if beside is not None and other is not None:
        away = abs(other.values["output_inertia"] * beside.secant - value)
        lines.append(BudgetLine(_RUNG, "B", beside.share * away, beside.note))
    stiffness = _estimate(
        "output_stiffness",
        "N m/rad",
        value,
        lines,
        _bench_lines(recording, found, value, heat),
        ratio,
    )
    told = estimates["output_inertia"]
    estimates["output_stiffness"] = dataclasses.replace(
        stiffness, identifiable=told.identifiable, note=told.note
    )
    return estimates


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
    known = None if gear is None else inertia_of_the_input(recording, gear)
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
    verdict, note = _told(value, half, ratio)
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


def _told(value: float, half: float, ratio: Estimate) -> tuple[Identifiable, str]:
    """Whether an inertia is told: by the torque, and by a mode that the steps tell."""
    if value <= 2.0 * half:
        return ("weakly" if value > half else "no"), "the torque of the ringing hardly shows it"
    if ratio.identifiable != "yes":
        return "weakly", f"it rests on the mode, and {ratio.note}"
    return "yes", ""
