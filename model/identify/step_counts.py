"""What whole counts of both encoders do to a fit of velocity steps: its model is driven by them, the gear is not.

The fit prescribes the measured input and follows the measured speed of the output, so that the error of their counts
rings the model's mode. The gear knows nothing of it. Least squares shrink it by a mode that rings less: they tell too
much damping.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from model.identify.checks import Array
from model.identify.least_squares import solution_of
from model.identify.step_fit import Solution, normal_equations
from model.identify.step_problem import Problem, StepArrays, between_samples
from model.units import REVOLUTION

DRAWS, _SEED = 4, 20151
"""How many times the steps are counted anew; each costs as much as a round of the fit."""
_BAND = 0.15
"""Share of the mode's frequency to either side of it within which its damping is told."""


def led_away(problem: Problem, solution: Solution) -> Array:
    """How far the counts of both encoders lead the numbers of a fit (draws, p).

    The gear that was fitted moves alone, is counted, and the fit takes its step of Gauss-Newton from the numbers that
    are true there: on the mean it goes to where counts lead it, and its scatter is what they do by chance.
    """
    generator = np.random.default_rng(_SEED)
    alone, values = problem.alone, solution.values
    tables = alone.tables(values)
    penalty = solution.penalty * solution.noise**2
    responses = [
        alone.response(step, values, alone.ideal(step, solution.error), tables)
        for step in problem.steps
    ]
    led = np.zeros((DRAWS, len(penalty)))
    for draw in range(DRAWS):
        steps = tuple(
            _counted(problem, step, values["skew"], angle, speed, generator)
            for step, (angle, speed, _, _) in zip(problem.steps, responses, strict=True)
        )
        normals = replace(problem, steps=steps).normals(solution.shape, values, solution.error)
        led[draw] = solution_of(
            *normal_equations(solution.weights, normals, penalty, 0.0 * penalty)
        )
    return led


def _counted(
    problem: Problem,
    step: StepArrays,
    skew: float,
    angle: Array,
    speed: Array,
    generator: np.random.Generator,
) -> StepArrays:
    """A step whose output moves like this on the fine grid, in whole counts of both encoders."""
    data = step.data
    time = data.time[data.time <= step.fine[-1]]
    output = problem.at_samples(replace(step, stamps=time), skew, angle, speed)[0]
    output = np.floor(output / data.output_quantum + generator.uniform()) * data.output_quantum
    # The measured input has been counted: it is taken for true, and counted once more.
    away = generator.uniform(-0.5, 0.5, time.size) * data.input_quantum / data.ratio
    first = int(np.searchsorted(time, float(step.stamps[0])))
    return replace(
        step,
        rigid=step.rigid + between_samples(time, away, step.fine),
        measured=output[first : first + len(step.stamps)],
        seen=between_samples(time, output, step.fine, derivative=1),
    )


def left_in_band(problem: Problem, solution: Solution) -> tuple[float, float]:
    """Mean power density of what a fit leaves within `_BAND` of the mode over that of the rest, 1 at least, each over
    what an observer leaves of counts there, |(1 - x^2 + 2i zeta x)/(1 - x^2 + 2i (zeta + zeta_o) x)|^2; and the squares
    of the noise that may be left there beyond it: what is, and twice the standard deviation by which chance hides more.
    """
    frequency, damping = problem.model(solution.values).mode(problem.swing)
    followed = damping + 0.5 * problem.observer / frequency
    inside, outside = np.zeros(3), np.zeros(3)
    for step, normal, weight in zip(problem.steps, solution.normals, solution.weights, strict=True):
        count, period = len(normal.residual), float(np.median(np.diff(step.stamps)))
        power = 2.0 * np.abs(np.fft.rfft(normal.residual))[1:] ** 2 / count
        x = np.asarray(np.fft.rfftfreq(count, period)[1:] * REVOLUTION / frequency, dtype=float)
        quiet = np.abs((1.0 - x**2 + 2j * damping * x) / (1.0 - x**2 + 2j * followed * x)) ** 2
        near = np.abs(x - 1.0) < _BAND
        for sums, part in ((inside, near), (outside, ~near)):
            sums += float(weight) * np.array([power[part].sum(), quiet[part].sum(), part.sum()])
    if not (inside[1] and outside[0]):
        return 1.0, math.inf
    counting = inside[1] * outside[0] / outside[1]
    more = max(0.0, inside[0] - counting) + 2.0 * counting / math.sqrt(inside[2])
    return max(1.0, float(inside[0] / counting)), float(more) / solution.noise**2
