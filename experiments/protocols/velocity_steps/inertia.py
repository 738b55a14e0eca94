"""Inertia and stiffness of the output, from the torque port during the steps in which it rings."""

from __future__ import annotations

import dataclasses
import math

from experiments.budget import scale_line
from experiments.protocols.velocity_steps.data import RecordedStep
from experiments.recording import Recording
from model.identify.dynamics import LadderFit
from model.identify.estimate import (
    NORMAL_COVERAGE_FACTOR,
    BudgetLine,
    Estimate,
    Identifiable,
    coverage_factor,
)
from model.identify.least_squares import student_quantile
from model.identify.step_inertia import LEAST_STEPS, fit_inertia
from model.units import RPM

INERTIA_ABOVE = 250.0 * RPM
"""Input speed from which the torque of a step is asked for the inertia of the output."""


def output_inertia(
    recording: Recording, steps: list[RecordedStep], ladder: LadderFit, ratio: Estimate
) -> dict[str, Estimate]:
    """J_o, the inertia on the input shaft and K from the torque of the steps in which the output rings."""
    rings = ladder.transient > steps[0].data.output_quantum
    asked = [
        (step.data, step.torque, acceleration)
        for step, acceleration, rung in zip(steps, ladder.acceleration, rings, strict=True)
        if step.torque is not None and rung and abs(step.data.target) >= INERTIA_ABOVE
    ]
    if len(asked) < LEAST_STEPS:
        return {}
    data, torques, accelerations = zip(*asked, strict=True)
    series = (*steps[0].data.kinematic_error, *ladder.series(steps[0].data.ratio))
    found = fit_inertia(data, torques, accelerations, series)
    # The ringing torque over J_o is the fitted mode's: what is in doubt of K/J_o is, the other way round, in J_o.
    mode = [line for line in ratio.budget if line.kind == "B"]
    estimates: dict[str, Estimate] = {}
    for name in ("output_inertia", "input_inertia"):
        value, error = found.values[name], found.errors[name]
        lines = [BudgetLine(SMOOTHING, "B", found.smoothing[name] / math.sqrt(3.0), TWICE)]
        if name == "output_inertia":
            lines += [_share(line, abs(value) / ratio.value) for line in mode]
        half = math.hypot(
            student_quantile(found.freedom[name]) * error,
            *(NORMAL_COVERAGE_FACTOR * line.standard_uncertainty for line in lines),
        )
        scatter = BudgetLine(SCATTER, "A", error, degrees_of_freedom=found.freedom[name])
        verdict, note = _told(value, half, ratio)
        estimates[name] = Estimate(
            name=name,
            value=value,
            unit="kg m2",
            low=value - half,
            high=value + half,
            identifiable=verdict,
            note=note,
            budget=(scatter, *lines, scale_line(recording, value)),
        )
    inertia = estimates["output_inertia"]
    value = inertia.value * ratio.value
    # In K = J_o (K/J_o) the doubt of the mode cancels; the scatter of both stays.
    sources = {line.source for line in mode}
    lines = [_share(line, ratio.value) for line in inertia.budget if line.source not in sources] + [
        _share(line, abs(inertia.value)) for line in ratio.budget if line.kind == "A"
    ]
    scale = scale_line(recording, value).source
    half = math.hypot(
        *(
            coverage_factor(line.degrees_of_freedom) * line.standard_uncertainty
            for line in lines
            if line.source != scale
        )
    )
    estimates["output_stiffness"] = Estimate(
        name="output_stiffness",
        value=value,
        unit="N m/rad",
        low=value - half,
        high=value + half,
        identifiable=inertia.identifiable,
        note=inertia.note,
        budget=tuple(lines),
    )
    return estimates


SCATTER, SMOOTHING = "scatter between the steps (jackknife)", "smoothing of the rise"
TWICE = "all sides smoothed twice as wide"


def _share(line: BudgetLine, factor: float) -> BudgetLine:
    return dataclasses.replace(line, standard_uncertainty=line.standard_uncertainty * factor)


def _told(value: float, half: float, ratio: Estimate) -> tuple[Identifiable, str]:
    """Whether an inertia is told: by the torque, and by a mode that the steps tell."""
    if value <= 2.0 * half:
        return ("weakly" if value > half else "no"), "the torque of the ringing hardly shows it"
    if ratio.identifiable != "yes":
        return "weakly", f"it rests on the mode, and {ratio.note}"
    return "yes", ""
