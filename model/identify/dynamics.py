"""The torsional mode of a gear from all velocity steps of a run, by one fit on a ladder of models.

    rigid       theta_o = theta_i/N                                                    nothing fitted
    paper       equation 2 with the values of a parameter set                          nothing fitted
    linear      one spring with the damping of the wave-generator bearing              `model.identify.torsional_mode`
    hardening   the spring hardens at T1 and T2 (K1, K2, K3)
    hysteresis  and a Dahl element beside it

Every fitted rung has the kinematic error as part of its input, so that an order which passes at a
step's speed is never taken for the mode. A fit follows the measured speed by an observer (prediction
errors: Ljung, System Identification, chapter 7); what a rung predicts, it predicts alone. A richer rung
is chosen only where its cost on all steps, priors counted, is lower by more than `WORTH`; what each rung
leaves of a step that was left out is shown and chooses nothing. The richer rung that moves a number
most makes a line of its budget. Stated is the secant stiffness over inertia at a torque amplitude,
beside it the mode's own frequency, which damping raises.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from model.errors import IdentificationError
from model.gear import Harmonic
from model.identify.checks import Array
from model.identify.estimate import Estimate
from model.identify.step_data import StepData
from model.identify.step_estimates import (
    FROM_BELOW,
    TO_RICHER,
    WIDEST,
    Reading,
    estimates_of,
    ran_away,
    read_rung,
)
from model.identify.step_fit import BAD_STEP, Solution, bounded, fit_all
from model.identify.step_problem import BASIS, LONGEST, Problem, step_arrays
from model.identify.step_rungs import FITTED, Expected, models_of
from model.identify.step_search import HIGHEST_SHARE, LOWEST_HZ, WORTH, climb
from model.identify.torsional_mode import TorsionModel
from model.units import ARCSEC, REVOLUTION, RPM

SHOWN, LEAST_COUNTS, SEEN = 30.0, 0.5, 4.0
"""How much cost a mode must save against a rigid gear; counts of transient below which none is told, and beyond
which it surely is."""
UNKNOWN_ERROR, GIVEN_ERROR = 20.0 * ARCSEC, 5.0 * ARCSEC
"""How wide coefficients of the kinematic error are believed to lie, from nothing and about an identified error."""
_PER_CYCLE = 40.0
"""Steps of the response per cycle of the expected mode: kinks and hysteresis are taken in the middle of a step, and
with twelve the secant came out one to two per cent wrong while the residual was that of the noise.
"""
OBSERVER = 0.05
"""Damping ratio with which the model follows the measured speed while it is fitted. Alone it has, where an order of
the kinematic error passes near the mode of a spring that bends, two states of motion, and by a hair it is in one or
the other: the squares are full of valleys, and the deepest that a search finds lay up to 90 % beside the damping. With
0.03 some steps still had two.
"""
_RIGID = 6.0
"""Logarithm by which a spring is stiffer that stands for a rigid gear."""


@dataclass(frozen=True, kw_only=True)
class Rung:
    """One model of the ladder on every step: root mean square of what it leaves [rad], fitted and left out (steps,).

    `left_out` is how it does on a step that the fit has not seen; for what was not fitted the same as `rms`.
    """

    name: str
    rms: Array
    left_out: Array
    counts: Array

    @property
    def prediction(self) -> float:
        """Root mean square over all left-out steps [rad]; a bad step counts as its weight has it."""
        return math.sqrt(float(np.average(bounded(self.left_out**2), weights=self.counts)))


@dataclass(frozen=True, kw_only=True)
class Beside:
    """The rung that tells how much of a law may be missing: its torque in the gear over J_o at the stamps of every step
    [rad/s2], its secant stiffness over inertia [1/s2], and the share of a difference to it that is a standard
    uncertainty.
    """

    note: str
    acceleration: tuple[Array, ...]
    secant: float
    share: float


@dataclass(frozen=True, kw_only=True)
class LadderFit:
    """What all steps of a run say of the mode.

    estimates: stiffness_over_inertia (secant, with _forward and _reverse), mode_squared [1/s2], frequency [Hz],
    damping_ratio, skew [s]. `rungs` in the order of the ladder, `chosen` the name of one of them; `predicted` the
    output angle of the chosen rung at the stamps of every step and `ideal` that of a rigid gear with kinematic
    error, `acceleration` its torque in the gear over J_o
    [rad/s2], `transient` the largest torsion of every step [rad]; `weights` of the steps.
    """

    estimates: dict[str, Estimate]
    warnings: tuple[str, ...]
    chosen: str
    model: TorsionModel
    predicted: tuple[Array, ...]
    ideal: tuple[Array, ...]
    acceleration: tuple[Array, ...]
    transient: Array
    weights: Array
    skew: float
    error: dict[tuple[int, int], tuple[float, float]]
    metrics: dict[str, float]
    beside: Beside | None
    answer: Callable[[StepData], Array]
    """Output angle [rad] of the chosen rung at the stamps of a step, whatever its input is: measured or commanded."""
    rungs: tuple[Rung, ...] = ()

    def series(self, ratio: float) -> tuple[Harmonic, ...]:
        """The kinematic error that was fitted, beside what was given; over the input angle."""
        return tuple(
            Harmonic(n + k / ratio, cosine, sine) for (n, k), (cosine, sine) in self.error.items()
        )


def fit_ladder(
    steps: Sequence[StepData],
    expected: Expected,
    *,
    richest: str = "hardening",
    paper: Sequence[Array] = (),
    error_given: bool = False,
) -> LadderFit:
    """Fit every rung up to `richest` to all steps, choose one, and state what it says.

    `paper`: the output angle that equation 2 gives for each step at its stamps, where a parameter set is at hand.
    `error_given`: the steps carry a kinematic error that was identified elsewhere. Raises `IdentificationError`
    where no step rings by a count of the output encoder.
    """
    _refuse_rung(richest)
    problem, noise, period = _problem(steps, expected, error_given=error_given)
    answers = climb(problem, expected, noise, richest, period)
    solutions = {name: found[0] for name, found in answers.items()}
    rungs = _null_rungs(steps, solutions["linear"].values["skew"], paper)
    rungs += [_rung(name, problem, solution) for name, solution in solutions.items()]
    amplitude = expected.amplitude / expected.inertia
    readings = {name: read_rung(problem, found, amplitude) for name, found in answers.items()}
    said = _without_runaways(answers, readings, period)
    chosen = _chosen({name: solutions[name] for name in answers})
    fit = _fit_of_rung(steps, problem, answers, readings, expected, chosen=chosen)
    return replace(fit, rungs=tuple(rungs), warnings=(*said, *fit.warnings))


def _without_runaways(
    answers: dict[str, list[Solution]], readings: dict[str, Reading], period: float
) -> list[str]:
    """Take away the rungs whose search came to no mode, and what is said of them.

    Raises `IdentificationError` where none of them did.
    """
    why = {name: ran_away(reading, period) for name, reading in readings.items()}
    if all(why.values()):
        raise IdentificationError(
            "no model of the spring comes to a mode in these steps",
            where="velocity steps",
            value="; ".join(f"{name}: {words}" for name, words in why.items()),
            limit=f"known within {100.0 * WIDEST:g} %, from {LOWEST_HZ:g} Hz to "
            f"{HIGHEST_SHARE:g} of the sampling rate",
            remedy="Use faster steps, more inertia at the output, a finer output encoder, "
            "or a higher sampling rate.",
        )
    gone = {name: words for name, words in why.items() if words}
    for name in gone:
        del answers[name], readings[name]
    return [f"The {name} rung is not used: {words}." for name, words in gone.items()]


def _refuse_rung(name: str) -> None:
    if name not in FITTED:
        raise IdentificationError(
            "no such rung", where="ladder", value=repr(name), limit=", ".join(FITTED)
        )


def _problem(
    steps: Sequence[StepData], expected: Expected, *, error_given: bool
) -> tuple[Problem, float, float]:
    """The steps made ready, the noise of their counts [rad], and the time between two samples [s]."""
    period = float(np.median(np.concatenate([np.diff(s.time) for s in steps])))
    interval = period / max(2, math.ceil(period * _PER_CYCLE * expected.frequency))
    noise = math.hypot(
        steps[0].output_quantum, steps[0].input_quantum / steps[0].ratio
    ) / math.sqrt(12.0)
    # The speed of an output that moves by less than a count per sample is that of a staircase.
    gain = OBSERVER * (_counts_per_sample(steps) >= 1.0)
    problem = Problem(
        steps=tuple(step_arrays(step, interval, BASIS) for step in steps),
        basis=BASIS,
        error_width=GIVEN_ERROR if error_given else UNKNOWN_ERROR,
        model=models_of(expected),
        swing=expected.amplitude / expected.inertia,
        observer=2.0 * gain * REVOLUTION * expected.frequency,
    )
    return problem, noise, period


def _counts_per_sample(steps: Sequence[StepData]) -> float:
    """Counts by which the output of the median step moves from sample to sample."""
    moved = [abs(s.output_angle[-1] - s.output_angle[0]) / len(s.time) for s in steps]
    return float(np.median(moved)) / steps[0].output_quantum


@dataclass(frozen=True)
class FittedRung:
    """One fitted rung, able to predict the steps of another run of the same gear."""

    solution: Solution
    problem: Problem


def fit_rung(steps: Sequence[StepData], expected: Expected, name: str) -> FittedRung:
    """Fit the ladder up to a rung to all steps, and keep that rung. Raises `IdentificationError` for none such."""
    _refuse_rung(name)
    problem, noise, period = _problem(steps, expected, error_given=False)
    return FittedRung(climb(problem, expected, noise, name, period)[name][0], problem.alone)


def predict_steps(fitted: FittedRung, steps: Sequence[StepData]) -> list[Array]:
    """The output angle [rad] of a fitted rung at the stamps of every step, with the measured input prescribed."""
    problem, solution = fitted.problem, fitted.solution
    tables = problem.tables(solution.values)
    predicted: list[Array] = []
    for step in steps:
        arrays = step_arrays(step, problem.interval, problem.basis)
        ideal = problem.ideal(arrays, solution.error)
        angle, _, _, _ = problem.response(arrays, solution.values, ideal, tables)
        at = step.time + solution.values["skew"]
        predicted.append(np.interp(at, arrays.fine, angle) + step.output_angle[0])
    return predicted


def _null_rungs(steps: Sequence[StepData], skew: float, paper: Sequence[Array]) -> list[Rung]:
    """The rows in which nothing is fitted; offset and skew are the bench's and taken out of them as well."""
    counts = np.array([float(len(s.time)) for s in steps])

    def row(name: str, angles: Sequence[Array]) -> Rung:
        left: list[float] = []
        for step, angle in zip(steps, angles, strict=True):
            away = step.output_angle - np.interp(step.time + skew, step.time, angle)
            left.append(float(np.std(away)))
        return Rung(name=name, rms=np.array(left), left_out=np.array(left), counts=counts)

    rungs = [row("rigid", [s.input_angle / s.ratio for s in steps])]
    if paper:
        rungs.append(row("paper", paper))
    return rungs


def _rung(name: str, problem: Problem, solution: Solution) -> Rung:
    """A fitted rung, which runs alone, with its prediction of each step from all the others."""
    counts = np.array([n.count for n in solution.normals], dtype=np.float64)
    alone = problem.alone.normals(solution.shape, solution.values, solution.error, gradient=False)
    rms = np.array([n.rms for n in alone])
    left = np.array(
        [solution.predicted_square(k) - n.square for k, n in enumerate(solution.normals)]
    )
    return Rung(
        name=name,
        rms=rms,
        left_out=np.sqrt(np.maximum(rms**2 + left / counts, 0.0)),
        counts=counts,
    )


def _chosen(solutions: Mapping[str, Solution]) -> str:
    """The lowest rung that no higher one explains the steps better than by `WORTH`."""
    best = min(s.robust_cost() for s in solutions.values())
    return next(name for name, s in solutions.items() if s.robust_cost() <= best + WORTH)


def _fit_of_rung(
    steps: Sequence[StepData],
    problem: Problem,
    answers: Mapping[str, Sequence[Solution]],
    readings: Mapping[str, Reading],
    expected: Expected,
    *,
    chosen: str,
) -> LadderFit:
    solution = answers[chosen][0]
    model = problem.model(solution.values)
    best = {name: found[0] for name, found in answers.items()}
    beside = _beside(chosen, best)
    responses = [_response(problem, solution, step) for step in steps]
    largest = np.array([one.transient for one in responses])
    quantum = steps[0].output_quantum
    if float(np.max(largest)) < SEEN * quantum:
        _refuse_unseen(steps, problem, solution, float(np.max(largest)) / quantum)
    swings = np.array([model.carried(float(torsion)) for torsion in largest])
    estimates = estimates_of(
        steps,
        problem,
        answers,
        readings,
        chosen=chosen,
        others=_others(chosen, best),
        swings=swings,
    )
    return LadderFit(
        estimates=estimates,
        warnings=tuple(_warnings(steps, solution, largest, quantum)),
        chosen=chosen,
        model=model,
        predicted=tuple(one.angle for one in responses),
        ideal=tuple(one.ideal for one in responses),
        acceleration=tuple(one.acceleration for one in responses),
        transient=largest,
        weights=solution.weights,
        skew=solution.values["skew"],
        error={
            pair: (float(a), float(b))
            for pair, (a, b) in zip(problem.basis, solution.error.reshape(-1, 2), strict=True)
        },
        metrics={"largest_torque": float(np.max(largest)) * model.stiffness * expected.inertia},
        beside=beside and _described(steps, problem, beside, expected),
        answer=lambda step: _response(problem, solution, step).angle,
    )


@dataclass(frozen=True)
class _Response:
    """What a fitted rung says of a step at its stamps (n,): the output angle of a rigid gear with the kinematic error
    and of this one, which runs alone [rad]; the output's acceleration beside its measured speed [rad/s2]; and the
    largest torsion [rad].
    """

    ideal: Array
    angle: Array
    acceleration: Array
    transient: float


def _response(problem: Problem, solution: Solution, step: StepData) -> _Response:
    """The response to the end of the step: more than its fit looks at, where it is long."""
    kept = (one for one in problem.steps if one.data is step and step.time[-1] <= LONGEST)
    arrays = next(kept, None) or step_arrays(
        step, problem.interval, problem.basis, longest=math.inf
    )
    ideal = problem.ideal(arrays, solution.error)
    predicted, followed = (
        one.response(arrays, solution.values, ideal, one.tables(solution.values))
        for one in (problem.alone, problem)
    )
    at = step.time + solution.values["skew"]
    return _Response(
        ideal=np.interp(at, arrays.fine, ideal) + step.output_angle[0],
        angle=np.interp(at, arrays.fine, predicted[0]) + step.output_angle[0],
        acceleration=np.interp(step.time, arrays.fine, np.gradient(followed[1], arrays.interval)),
        transient=float(np.max(np.abs(ideal - predicted[0]))),
    )


def _described(
    steps: Sequence[StepData],
    problem: Problem,
    beside: tuple[str, Solution],
    expected: Expected,
) -> Beside:
    note, solution = beside
    return Beside(
        note=note,
        acceleration=tuple(_response(problem, solution, step).acceleration for step in steps),
        secant=problem.model(solution.values).secant(expected.amplitude / expected.inertia),
        share=1.0 if note == TO_RICHER else 1.0 / math.sqrt(3.0),
    )


def _beside(chosen: str, solutions: Mapping[str, Solution]) -> tuple[str, Solution] | None:
    """The rung that tells how much of a law may be missing: the next richer one, or of the richest the next below.

    What the last step of the ladder changed is the most that another one is believed to.
    """
    others = _others(chosen, solutions)
    return next(((note, solutions[rung]) for note, rung in others), None)


def _others(chosen: str, solutions: Mapping[str, Solution]) -> list[tuple[str, str]]:
    """The rungs that tell how much of a law may be missing from the numbers, and what they are to the chosen one: every
    richer one, or of the richest the next below.
    """
    place = FITTED.index(chosen)
    richer = [(TO_RICHER, name) for name in FITTED[place + 1 :] if name in solutions]
    below = [(FROM_BELOW, name) for name in FITTED[:place] if name in solutions]
    return richer or below[-1:]


def _refuse_unseen(
    steps: Sequence[StepData], problem: Problem, solution: Solution, counts: float
) -> None:
    """A mode is refused that explains the steps hardly better than a rigid gear with the same kinematic error.

    Many samples of a moving output tell a transient (`counts` of the output encoder) below one count: the motion
    spreads what counting takes away. So not its size is asked for but what it explains of all steps together. While
    an output moves by less than a count per sample, its samples are no more independent than its counts; and a
    transient of less than half a count may be all rounding.
    """
    stiff = {**solution.values, "stiffness": solution.values["stiffness"] + _RIGID}
    shape = replace(solution.shape, names=("bearing", "skew"))
    rigid = fit_all(
        problem, shape, stiff, solution.error, noise=solution.noise, weights=solution.weights
    )
    saved = (rigid.square - solution.square) / solution.noise**2 + rigid.pull - solution.pull
    saved *= min(1.0, _counts_per_sample(steps))
    if saved < SHOWN or counts < LEAST_COUNTS:
        raise IdentificationError(
            "no step has a transient that is told from a rigid gear",
            where="velocity steps",
            value=f"{counts:.2g} counts, {max(saved, 0.0):.3g} squares of the noise explained, {len(steps)} steps",
            limit=f">= {LEAST_COUNTS:g} counts, >= {SHOWN:g} squares",
            remedy="Use faster steps, more inertia at the output, or a finer output encoder.",
        )


def _warnings(
    steps: Sequence[StepData], solution: Solution, transient: Array, quantum: float
) -> list[str]:
    warnings: list[str] = []
    small = sorted(
        {round(abs(s.target) / RPM) for s, t in zip(steps, transient, strict=True) if t <= quantum}
    )
    if small:
        speeds = ", ".join(str(s) for s in small)
        warnings.append(
            f"Steps at {speeds} r/min have a torsional transient below one output count: not resolvable."
        )
    short = [
        s for s in steps if abs(s.input_angle[-1] - s.input_angle[0]) < 3.0 * REVOLUTION * 0.99
    ]
    if short:
        warnings.append(
            f"{len(short)} steps last less than three input revolutions, too few for their ripple."
        )
    rms = np.array([n.rms for n in solution.normals])
    for step, left, weight in zip(steps, rms, solution.weights, strict=True):
        if left > BAD_STEP * float(np.median(rms)):
            way = "forward" if step.target > 0 else "reverse"
            warnings.append(
                f"{abs(step.target) / RPM:.0f} r/min {way}: leaves {left / ARCSEC:.2g} arcsec, the median step "
                f"{float(np.median(rms)) / ARCSEC:.2g}; it counts {100.0 * weight:.0f} % in the fit."
            )
    return warnings
