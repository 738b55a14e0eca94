"""What whole counts of the input do to a fit of velocity steps: its model is driven by them, the gear is not.

The fit prescribes the measured input, so that the error of its counts rings the model's mode, up to 1/(2 zeta) times.
The gear knows nothing of it. Least squares shrink it by a mode that rings less: they tell too much damping.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from model.identify.checks import Array
from model.identify.step_fit import Solution
from model.identify.step_problem import STEPS, Problem, StepArrays
from model.units import REVOLUTION

_BAND = 0.15
"""Share of the mode's frequency to either side of it within which its damping is told."""
_UNMOVED = ("skew", "bearing")
"""Numbers that change nothing of what counts ring up."""


def rung_up(problem: Problem, step: StepArrays, values: Mapping[str, float]) -> float:
    """Mean square [rad2] over a step of what the counts of the input ring up in the model; NaN where nothing damps it.

        V = (S/4) (omega/zeta) (1 + 4 zeta^2) (1 - (1 - exp(-x))/x) ,   x = 2 zeta omega L

    of noise of the density S (two-sided), which began L before the end of the step.
    """
    frequency, damping = problem.model(values).mode(problem.swing)
    if not damping > 0.0:
        return math.nan
    lasts = 2.0 * damping * frequency * float(step.stamps[-1] - max(step.stamps[0], 0.0))
    built = 1.0 + math.expm1(-lasts) / lasts
    return problem.input_density * frequency * (0.25 / damping + damping) * built


def led_away(problem: Problem, solution: Solution) -> Array:
    """How far the numbers of a fit (p,) lie from where they would without what the counts of the input ring up.

    p - p_0 = -(J'J)^-1 sum n grad V/2 ,   to first order

    Nothing where that is no number: the fit has no mode that could be led.
    """
    pull = np.zeros(len(solution.vector))
    steps = list(zip(problem.steps, solution.weights, solution.normals, strict=True))

    def squares(values: Mapping[str, float]) -> float:
        return sum(float(w) * n.count * rung_up(problem, step, values) for step, w, n in steps)

    here = squares(solution.values)
    for j, name in enumerate(solution.shape.names):
        if name not in _UNMOVED:
            h = STEPS.get(name, 1e-3)
            there = {**solution.values, name: solution.values[name] + h}
            pull[j] = -0.5 * (squares(there) - here) / h
    led = solution.inverse() @ pull
    return led if np.all(np.isfinite(led)) else np.zeros_like(led)


def louder_in_band(problem: Problem, solution: Solution) -> float:
    """How many times the noise that a fit leaves the noise is at the peak of the mode, by the counts of the input."""
    damping = problem.model(solution.values).mode(problem.swing)[1]
    count = sum(w * n.count for w, n in zip(solution.weights, solution.normals, strict=True))
    period = float(np.median(np.diff(problem.steps[0].stamps)))
    peak = 1.0 + 0.25 / damping**2 if damping > 0.0 else 1.0
    return 1.0 + problem.input_density / period * peak * float(count) / solution.square


def left_in_band(problem: Problem, solution: Solution) -> float:
    """Mean power density of what a fit leaves within `_BAND` of the mode over that of the rest, 1 at least."""
    frequency = problem.model(solution.values).mode(problem.swing)[0] / REVOLUTION
    inside, outside = np.zeros(2), np.zeros(2)
    for step, normal, weight in zip(problem.steps, solution.normals, solution.weights, strict=True):
        count, period = len(normal.residual), float(np.median(np.diff(step.stamps)))
        power = np.abs(np.fft.rfft(normal.residual))[1:] ** 2 / count
        near = np.abs(np.fft.rfftfreq(count, period)[1:] - frequency) < _BAND * frequency
        for sums, part in ((inside, power[near]), (outside, power[~near])):
            sums += float(weight) * np.array([part.sum(), len(part)])
    if not (inside[1] and outside[0]):
        return 1.0
    return max(1.0, float(inside[0] / inside[1] / (outside[0] / outside[1])))
