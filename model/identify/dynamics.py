# pyright: standard
"""The torsional mode of a gear from all velocity steps of a run, by one fit on a ladder of models.

    rigid       theta_o = theta_i/N                                                    nothing fitted
    paper       equation 2 with the values of a parameter set                          nothing fitted
    linear      one spring with the damping of the wave-generator bearing              `model.identify.torsional_mode`
    hardening   the spring hardens at T1 and T2 (K1, K2, K3)
    hysteresis  and a Dahl element beside it

Every fitted rung has the kinematic error as part of its input, so that an order which passes at a step's speed is
never taken for the mode. A rung is chosen by how well it predicts a step that was left out; how
far the next richer rung moves a number is a line of its budget. Stated is the secant stiffness over inertia at a
torque amplitude, beside it the mode's own frequency, which damping raises.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from model.errors import IdentificationError
from model.gear import Harmonic
from model.identify.checks import Array
from model.identify.estimate import NORMAL_COVERAGE_FACTOR, BudgetLine, Estimate, Identifiable
from model.identify.least_squares import student_quantile
from model.identify.step_data import StepData
from model.identify.step_fit import (
    BAD_STEP,
    BASIS,
    Problem,
    Shape,
    Solution,
    StepArrays,
    bounded,
    fit_all,
    reweighted,
    step_arrays,
)
from model.identify.torsional_mode import TorsionModel
from model.units import ARCSEC, REVOLUTION, RPM

LADDER = ("rigid", "paper", "linear", "hardening", "hysteresis")
FITTED = LADDER[2:]
WORTH = 12.0
"""By how much a richer rung must lower the cost (in squares of the noise, its priors counted) to be chosen."""
SHOWN, LEAST_COUNTS, SEEN = 30.0, 0.5, 4.0
"""How much cost a mode must save against a rigid gear; counts of transient below which none is told, and beyond
which it surely is."""
UNKNOWN_ERROR, GIVEN_ERROR = 20.0 * ARCSEC, 5.0 * ARCSEC
"""How wide coefficients of the kinematic error are believed to lie, from nothing and about an identified error."""
BEARING_TORQUE = 1.0
"""N m; how large the friction of the output's bearing is believed to be."""
SCANNED, SCAN_TIME = 6, 0.5
"""Steps, and seconds of each, in which the first look for the mode is made."""
KNOWN_WITHIN = 1.7
"""Factor to either side of an expected frequency within which the mode is looked for."""
LOWEST_HZ, HIGHEST_SHARE = 4.0, 0.4
EXPLAINED, SAME = 1.1, 1.001
"""How many times the noise of counting a fit may leave that is no longer doubted; ratio of the costs of one answer."""
RINGS, RUNG_DOWN = 0.25, 0.4
"""s after the onset of a step until which it rings, and from which on it does no more."""
RINGS_ON = 1.15
"""Ratio of what a fit leaves in the two beyond which the mode is not explained; noise alone makes it 1 within 0.03."""
AWAY = (0.2, -0.2, 0.4, -0.4)
"""Logarithms of the stiffness from the card's at which further searches begin."""
LEAST_SEARCHES, SEARCHED = 2, 30_000
"""Starts of the rungs above the linear one that are tried at least, and samples to fit in all starts of a rung."""
SLIDING = ((0.05, 0.0), (0.2, -1.0))
"""Where a hysteresis element begins: its stiffness over K/J_o, by which the spring is softer, and what is taken off
the logarithm of the damping."""
OTHERS, LOOKS = 30.0, 3
"""Cost beyond the least within which another frequency of the first look is searched from, too."""
BENT = 0.02
"""Logarithms of K2/K1 and K3/K2 with which the hardening rung begins."""
PASSES, ROUNDS_PER_PASS = 4, 8
"""How often the weights of the steps are looked at again, and rounds of Gauss-Newton between."""
RIGID = 6.0
"""Logarithm by which a spring is stiffer that stands for a rigid gear."""
LEAST_RELAXATION = 1e-6
"""s; stands for a wave-generator bearing without damping."""
SHARE_DOUBT = 0.3
"""Relative standard uncertainty of the share of the compliance that is damped."""


@dataclass(frozen=True, kw_only=True)
class Expected:
    """What is known before the fit, of the gear's card: where the search begins and what a run can't tell.

    `stiffness` K/J_o [1/s2], `share` of the wave-generator bearing in the compliance and its `relaxation` C_b/K_b [s],
    `inertia` J_o [kg m2] (turns
    torques into accelerations), `torques` T1 and T2 [N m], `hardening` K2/K1 and K3/K1, `loss` hysteresis [rad],
    `amplitude` [N m] at which the secant stiffness is stated. `is_known`: whether it is this gear's.
    """

    stiffness: float
    share: float
    relaxation: float
    inertia: float
    torques: tuple[float, float]
    hardening: tuple[float, float]
    loss: float
    amplitude: float
    is_known: bool = True

    @property
    def frequency(self) -> float:
        """sqrt(K/J_o) [Hz]."""
        return math.sqrt(self.stiffness) / REVOLUTION


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
    rungs: tuple[Rung, ...]
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
    answer: Callable[[StepData], Array]
    """Output angle [rad] of the chosen rung at the stamps of a step, whatever its input is: measured or commanded."""

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
    answers = _climb(problem, expected, noise, richest, period)
    solutions = {name: found[0] for name, found in answers.items()}
    rungs = _null_rungs(steps, solutions["linear"].values["skew"], paper)
    rungs += [_rung(name, solution) for name, solution in solutions.items()]
    return _stated(steps, problem, answers, tuple(rungs), _chosen(solutions), expected)


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
    interval = period / max(2, math.ceil(period * 12.0 * expected.frequency))
    noise = math.hypot(
        steps[0].output_quantum, steps[0].input_quantum / steps[0].ratio
    ) / math.sqrt(12.0)
    problem = Problem(
        steps=tuple(step_arrays(step, interval, BASIS) for step in steps),
        basis=BASIS,
        error_width=GIVEN_ERROR if error_given else UNKNOWN_ERROR,
        model=_models(expected),
    )
    return problem, noise, period


@dataclass(frozen=True)
class FittedRung:
    """One fitted rung, able to predict the steps of another run of the same gear."""

    solution: Solution
    problem: Problem


def fit_rung(steps: Sequence[StepData], expected: Expected, name: str) -> FittedRung:
    """Fit the ladder up to a rung to all steps, and keep that rung. Raises `IdentificationError` for none such."""
    _refuse_rung(name)
    problem, noise, period = _problem(steps, expected, error_given=False)
    return FittedRung(_climb(problem, expected, noise, name, period)[name][0], problem)


def predict_steps(fitted: FittedRung, steps: Sequence[StepData]) -> list[Array]:
    """The output angle [rad] of a fitted rung at the stamps of every step, with the measured input prescribed."""
    problem, solution = fitted.problem, fitted.solution
    tables = problem.model(solution.values).step(problem.interval)
    predicted: list[Array] = []
    for step in steps:
        arrays = step_arrays(step, problem.interval, problem.basis)
        ideal = problem.ideal(arrays, solution.error)
        angle, _, _, _ = problem.response(arrays, solution.values, ideal, tables)
        at = step.time + solution.values["skew"]
        predicted.append(np.interp(at, arrays.fine, angle) + step.output_angle[0])
    return predicted


def _models(expected: Expected) -> Callable[[Mapping[str, float]], TorsionModel]:
    first, second = (torque / expected.inertia for torque in expected.torques)

    def model(values: Mapping[str, float]) -> TorsionModel:
        hardens = "second" in values
        later = math.exp(values.get("kink", 0.0))
        stiffer = math.exp(values.get("second", 0.0))
        frequency, damping = math.exp(0.5 * values["stiffness"]), math.exp(values["damping"])
        # The bearing damps by no more than its card says; the rest is lost beside the springs and stiffens nothing.
        bearing = 0.5 * expected.share * max(expected.relaxation, LEAST_RELAXATION) * frequency
        return TorsionModel(
            stiffness=math.exp(values["stiffness"]),
            relaxation=2.0 * min(damping, bearing) / (expected.share * frequency),
            loss=2.0 * max(damping - bearing, 0.0) * frequency,
            share=expected.share,
            second=stiffer,
            third=stiffer * math.exp(values.get("third", 0.0)),
            torques=(first * later, second * later) if hardens else (math.inf, math.inf),
            hysteresis=(math.exp(values["soft"]), math.exp(values["limit"]))
            if "soft" in values
            else (0.0, 0.0),
        )

    return model


def _shapes(
    expected: Expected, frequency: float
) -> tuple[dict[str, Shape], dict[str, dict[str, float]]]:
    """The numbers of each rung, and where those begin that it adds."""
    damped = math.log(0.02)
    second, third = expected.hardening
    slides = expected.stiffness * 0.5 * expected.loss
    added = {
        "linear": {
            "stiffness": 2.0 * math.log(REVOLUTION * frequency),
            "damping": damped,
            "bearing": 0.1 * BEARING_TORQUE / expected.inertia,
            "skew": 0.0,
        },
        "hardening": {"second": math.log(second), "third": math.log(third / second), "kink": 0.0},
        "hysteresis": {"soft": math.log(0.05 * expected.stiffness), "limit": math.log(slides)},
    }
    prior = {
        "damping": (damped, 1.5),
        "bearing": (0.0, BEARING_TORQUE / expected.inertia),
        "skew": (0.0, 2e-3),
        "second": (math.log(second), 0.3),
        "third": (math.log(third / second), 0.15),
        "kink": (0.05, 0.15),
        "soft": (math.log(0.05 * expected.stiffness), 1.5),
        "limit": (math.log(slides), 1.0),
    }
    names: tuple[str, ...] = ()
    shapes: dict[str, Shape] = {}
    for rung, more in added.items():
        names = (*names, *more)
        shapes[rung] = Shape(names=names, prior=prior)
    return shapes, added


def _climb(
    problem: Problem, expected: Expected, noise: float, richest: str, period: float
) -> dict[str, list[Solution]]:
    """The answers of the rungs, the best first, each begun where the one below ended."""
    still = np.zeros(2 * len(problem.basis))
    frequencies = _first_look(problem, expected, noise, period)
    shapes, added = _shapes(expected, frequencies[0])
    card = {**added["linear"], "stiffness": math.log(expected.stiffness)}
    answers: dict[str, list[Solution]] = {}
    few = max(1, SEARCHED // sum(len(step.stamps) for step in problem.steps))
    for rung in FITTED[: FITTED.index(richest) + 1]:
        card |= added[rung] if rung != "linear" else {}
        around = [({**card, "stiffness": card["stiffness"] + away}, still) for away in AWAY]
        if rung == "linear":
            looks = [
                ({**card, "stiffness": 2.0 * math.log(REVOLUTION * f)}, still) for f in frequencies
            ]
            starts, least = [*looks, (card, still), *around], len(looks)
        elif rung == "hardening":
            starts = [*_bends(answers["linear"][0], added[rung]), (card, still), *around]
            least = 1
        else:
            starts = _slides(answers["hardening"][0], added[rung], expected)
            least = min(len(starts), few)
        answers[rung] = _answers(problem, shapes[rung], starts, noise, least)
    return answers


def _slides(
    below: Solution, added: Mapping[str, float], expected: Expected
) -> list[tuple[dict[str, float], Array]]:
    """Starts of the hysteresis rung beside a hardening spring: an element that takes over some or most of its loss."""
    return [
        (
            {
                **below.values,
                **added,
                "soft": math.log(share * expected.stiffness),
                "stiffness": below.values["stiffness"] - share,
                "damping": below.values["damping"] + less,
            },
            below.error,
        )
        for share, less in SLIDING
    ]


def _bends(linear: Solution, added: Mapping[str, float]) -> list[tuple[dict[str, float], Array]]:
    """Starts of the hardening rung beside the linear spring: hardly bent, and bent as the card says."""
    values, stiff = linear.values, linear.values["stiffness"]
    hardly = {**values, **dict.fromkeys(added, BENT), "kink": 0.0}
    return [(hardly, linear.error), ({**values, **added, "stiffness": stiff - BENT}, linear.error)]


def _answers(
    problem: Problem,
    shape: Shape,
    starts: Sequence[tuple[dict[str, float], Array]],
    noise: float,
    least_starts: int,
) -> list[Solution]:
    """The fits from several starts, the best first.

    Where an order of the kinematic error passes near the mode, a spring has several answers, and each start leads
    to one of them. After `least_starts` the search ends with an answer that leaves what counting does, or that two
    starts lead to. The many speeds of a long run leave one answer: it is searched from fewer starts.
    """
    found: list[Solution] = []
    samples = sum(len(step.stamps) for step in problem.steps)
    # The linear rung of a gear that hardens is never explained: the next rung searches on.
    fewest = LEAST_SEARCHES if "second" in shape.names else 1
    most = max(fewest, least_starts, SEARCHED // samples)
    for tried, (values, error) in enumerate(starts[:most], start=1):
        one = _settled(problem, shape, values, error, noise)
        found.append(one)
        if (
            "second" in shape.names
            and "soft" not in shape.names
            and float(np.min(one.weights)) < 0.9
        ):
            # Steps that were left aside may fit, once the others have found the spring.
            ones = np.ones(len(problem.steps))
            held = replace(shape, names=("bearing", "skew"))
            only = fit_all(problem, held, one.values, one.error, noise=noise, weights=ones)
            found.append(
                fit_all(problem, shape, only.values, only.error, noise=noise, weights=ones)
            )
        found.sort(key=lambda s: s.robust_cost())
        least = found[0].robust_cost()
        if tried < least_starts:
            continue
        if least < EXPLAINED**2 * found[0].samples:
            break
        if len(found) > 1 and found[1].robust_cost() < SAME * least:
            break
    return found


def _settled(
    problem: Problem,
    shape: Shape,
    values: Mapping[str, float],
    error: Array,
    noise: float,
    weights: Array | None = None,
) -> Solution:
    """A fit in which steps that fit badly count little: weights and numbers in turn until neither changes."""
    if weights is None:
        at_start = problem.normals(shape, values, error, gradient=False)
        rms = np.array([n.rms for n in at_start])
        weights = np.asarray(np.minimum(1.0, (BAD_STEP * np.median(rms) / rms) ** 4), dtype=float)
    left = PASSES
    while True:
        solution = fit_all(
            problem, shape, values, error, noise=noise, weights=weights, rounds=ROUNDS_PER_PASS
        )
        values, error, left = solution.values, solution.error, left - 1
        wanted = reweighted(solution)
        if not left or float(np.max(np.abs(wanted - weights))) < 0.05:
            if solution.is_converged:
                return solution
            return fit_all(problem, shape, values, error, noise=noise, weights=weights)
        weights = wanted


def _first_look(problem: Problem, expected: Expected, noise: float, period: float) -> list[float]:
    """The frequencies [Hz] at which the rises of the liveliest steps are explained best, kinematic error included.

    The best first, then the other minima that leave no more than `OTHERS` beyond it, at most three in all.
    """
    lively = sorted(problem.steps, key=lambda s: -_liveliness(s))[:SCANNED]
    basis = tuple(pair for pair in problem.basis if pair[1] == 0)
    short = replace(problem, steps=tuple(_shortened(s) for s in lively), basis=basis)
    low, high = LOWEST_HZ, HIGHEST_SHARE / period
    if expected.is_known:
        low = max(low, expected.frequency / KNOWN_WITHIN)
        high = min(high, expected.frequency * KNOWN_WITHIN)
    count = max(3, round(math.log(high / low) / 0.04))
    error = np.zeros(2 * len(basis))
    shape = Shape(names=("bearing", "skew"))
    trials: list[tuple[float, float]] = []
    for frequency in np.geomspace(low, high, count):
        values = {
            "stiffness": 2.0 * math.log(REVOLUTION * frequency),
            "damping": math.log(0.03),
            "bearing": 0.0,
            "skew": 0.0,
        }
        normals = short.normals(shape, values, error)
        total = sum((n.matrix for n in normals), np.zeros_like(normals[0].matrix))
        pull = sum((n.gradient for n in normals), np.zeros_like(normals[0].gradient))
        widths = np.array(
            [BEARING_TORQUE / expected.inertia, 2e-3, *np.full(len(error), problem.error_width)]
        )
        total = total + np.diag((noise / widths) ** 2)
        left = sum(n.square for n in normals) - float(pull @ np.linalg.solve(total, pull))
        trials.append((left / noise**2, float(frequency)))
    cost = np.array([math.inf, *(left for left, _ in trials), math.inf])
    low_points = (cost[1:-1] <= cost[:-2]) & (cost[1:-1] <= cost[2:])
    near = sorted(trial for trial, low_point in zip(trials, low_points, strict=True) if low_point)
    return [f for left, f in near if left < near[0][0] + OTHERS][:LOOKS]


def _liveliness(step: StepArrays) -> float:
    """How hard a step pulls: the largest change of speed of theta_i/N within 5 ms."""
    width = max(1, round(5e-3 / step.interval))
    speed = np.diff(step.rigid)
    return float(np.max(np.abs(speed[width:] - speed[:-width])))


def _shortened(step: StepArrays) -> StepArrays:
    """The first half second of a step."""
    rows = int(np.searchsorted(step.fine, SCAN_TIME))
    samples = int(np.searchsorted(step.stamps, SCAN_TIME - 3e-3))
    return replace(
        step,
        fine=step.fine[:rows],
        rigid=step.rigid[:rows],
        whole=np.ascontiguousarray(step.whole[:, :, :rows]),
        slow=np.ascontiguousarray(step.slow[:, :, :rows]),
        stamps=step.stamps[:samples],
        measured=step.measured[:samples],
        own=step.own[:samples],
    )


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
    return [*rungs, row("paper", paper)] if paper else rungs


def _rung(name: str, solution: Solution) -> Rung:
    """A fitted rung with its prediction of each step from all the others."""
    counts = np.array([n.count for n in solution.normals], dtype=np.float64)
    left = np.array([solution.predicted_square(k) for k in range(len(counts))])
    return Rung(
        name=name,
        rms=np.array([n.rms for n in solution.normals]),
        left_out=np.sqrt(np.maximum(left, 0.0) / counts),
        counts=counts,
    )


def _chosen(solutions: Mapping[str, Solution]) -> str:
    """The lowest rung that no higher one explains the steps better than by `WORTH`."""
    best = min(s.robust_cost() for s in solutions.values())
    return next(name for name, s in solutions.items() if s.robust_cost() <= best + WORTH)


def _stated(
    steps: Sequence[StepData],
    problem: Problem,
    answers: Mapping[str, Sequence[Solution]],
    rungs: tuple[Rung, ...],
    chosen: str,
    expected: Expected,
) -> LadderFit:
    solution = answers[chosen][0]
    model = problem.model(solution.values)
    beside = _beside(chosen, {name: found[0] for name, found in answers.items()})
    tables = model.step(problem.interval)
    predicted: list[Array] = []
    rigid: list[Array] = []
    acceleration: list[Array] = []
    transient: list[float] = []

    def respond(arrays: StepArrays) -> tuple[Array, Array, Array]:
        """Input with its kinematic error, output angle and output speed on the fine grid of a step."""
        ideal = problem.ideal(arrays, solution.error)
        angle, speed, _, _ = problem.response(arrays, solution.values, ideal, tables)
        return ideal, angle, speed

    def at_stamps(step: StepData, arrays: StepArrays, angle: Array) -> Array:
        at = step.time + solution.values["skew"]
        return np.interp(at, arrays.fine, angle) + step.output_angle[0]

    def whole(step: StepData) -> StepArrays:
        """The step to its end: more than its fit looks at, where it is long."""
        return step_arrays(step, problem.interval, problem.basis, longest=math.inf)

    def answer(step: StepData) -> Array:
        arrays = whole(step)
        return at_stamps(step, arrays, respond(arrays)[1])

    for step in steps:
        arrays = whole(step)
        ideal, angle, speed = respond(arrays)
        predicted.append(at_stamps(step, arrays, angle))
        rigid.append(at_stamps(step, arrays, ideal))
        acceleration.append(np.interp(step.time, arrays.fine, np.gradient(speed, arrays.interval)))
        transient.append(float(np.max(np.abs(ideal - angle))))
    largest = np.array(transient)
    quantum = steps[0].output_quantum
    if float(np.max(largest)) < SEEN * quantum:
        _refuse_unseen(steps, problem, solution, float(np.max(largest)) / quantum)
    estimates = _estimates(steps, problem, answers[chosen], beside, expected)
    return LadderFit(
        estimates=estimates,
        warnings=tuple(_warnings(steps, solution, largest, quantum)),
        rungs=rungs,
        chosen=chosen,
        model=model,
        predicted=tuple(predicted),
        ideal=tuple(rigid),
        acceleration=tuple(acceleration),
        transient=largest,
        weights=solution.weights,
        skew=solution.values["skew"],
        error={
            pair: (float(a), float(b))
            for pair, (a, b) in zip(problem.basis, solution.error.reshape(-1, 2), strict=True)
        },
        metrics={"largest_torque": float(np.max(largest)) * model.stiffness * expected.inertia},
        answer=answer,
    )


def _beside(chosen: str, solutions: Mapping[str, Solution]) -> tuple[str, Solution] | None:
    """The rung that tells how much of a law may be missing: the next richer one, or of the richest the next below.

    What the last step of the ladder changed is the most that another one is believed to.
    """
    place = FITTED.index(chosen)
    for name, note in ((FITTED[place + 1 :][:1], TO_RICHER), (FITTED[:place][-1:], FROM_BELOW)):
        if name and name[0] in solutions:
            return note, solutions[name[0]]
    return None


TO_RICHER, FROM_BELOW = "to the next richer rung", "what the richest rung changed, rectangular"


def _refuse_unseen(
    steps: Sequence[StepData], problem: Problem, solution: Solution, counts: float
) -> None:
    """A mode is refused that explains the steps hardly better than a rigid gear with the same kinematic error.

    Many samples of a moving output tell a transient (`counts` of the output encoder) below one count: the motion
    spreads what counting takes away. So not its size is asked for but what it explains of all steps together. While
    an output moves by less than a count per sample, its samples are no more independent than its counts; and a
    transient of less than half a count may be all rounding.
    """
    stiff = {**solution.values, "stiffness": solution.values["stiffness"] + RIGID}
    shape = replace(solution.shape, names=("bearing", "skew"))
    rigid = fit_all(
        problem, shape, stiff, solution.error, noise=solution.noise, weights=solution.weights
    )
    saved = (rigid.square - solution.square) / solution.noise**2 + rigid.pull - solution.pull
    moved = [abs(s.output_angle[-1] - s.output_angle[0]) / len(s.time) for s in steps]
    saved *= min(1.0, float(np.median(moved)) / steps[0].output_quantum)
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


STATED = (
    ("stiffness_over_inertia", "1/s2"),
    ("mode_squared", "1/s2"),
    ("frequency", "Hz"),
    ("damping_ratio", "1"),
    ("skew", "s"),
)
"""What is stated, in the order of `_numbers`: logarithms but for the skew."""
BOTH_WAYS = (0, 2, 3)
WEAK, POOR = 0.05, 0.2
"""Relative standard errors above which a number is identified weakly, and not at all; the first also bounds what
leaving out a direction may move one by.
"""


WANTED = {"damping_ratio": 0.01}
"""Half widths of the interval above which a number is weak whose target is absolute, as its quantity declares it."""


def _numbers(model: TorsionModel, skew: float, amplitude: float) -> Array:
    frequency, damping = model.mode(amplitude)
    return np.array(
        [
            math.log(model.secant(amplitude)),
            2.0 * math.log(frequency),
            math.log(frequency / REVOLUTION),
            math.log(damping),
            skew,
        ]
    )


def _estimates(
    steps: Sequence[StepData],
    problem: Problem,
    answers: Sequence[Solution],
    beside: tuple[str, Solution] | None,
    expected: Expected,
) -> dict[str, Estimate]:
    """The stated numbers with their budgets, and those of which a direction alone has something to say."""
    solution = answers[0]
    names = solution.shape.names
    amplitude = expected.amplitude / expected.inertia

    def numbers(vector: Array) -> Array:
        there = {**solution.values, **dict(zip(names, vector[: len(names)].tolist(), strict=True))}
        return _numbers(problem.model(there), there["skew"], amplitude)

    here = solution.vector
    model, centre = problem.model(solution.values), numbers(here)
    error, freedom = _standard_error(solution, _slopes(numbers, here, len(names)))
    error = np.hypot(error, _between_answers(answers, numbers))
    lines = _lines(model, centre)
    if beside is not None:
        note, other = beside
        moved = np.abs(
            _numbers(problem.model(other.values), other.values["skew"], amplitude) - centre
        )
        lines.append(
            ("choice of the rung", note, moved if note == TO_RICHER else moved / math.sqrt(3.0))
        )
    if model.hysteresis[1] == 0.0:
        lines.append(("hysteresis", "not part of this rung", _unfitted_hysteresis(model)))
    ringing = _ringing_left(problem, solution)
    told = _Told(centre, error, freedom, tuple(lines), ringing)
    estimates = {name: told.estimate(index) for index, (name, _) in enumerate(STATED)}
    direction = np.array([math.copysign(1.0, s.target) for s in steps])
    for way, sign in (("forward", 1.0), ("reverse", -1.0)):
        others = np.flatnonzero(direction == -sign)
        if not 0 < len(others) < len(steps):
            continue
        moved = numbers(here + solution.left_out(others.tolist()))
        # Left out to first order: that is in doubt by as much as it leads away.
        away = np.abs(moved - centre)
        first_order = ("first order", "of leaving the other direction out", away / math.sqrt(3.0))
        alone = replace(
            told, centre=moved, error=math.sqrt(2.0) * error, lines=(*told.lines, first_order)
        )
        for index in BOTH_WAYS:
            estimate = alone.estimate(index)
            if away[index] > WEAK and estimate.identifiable == "yes":
                note = "one direction alone leads too far from both to be told to first order"
                estimate = replace(estimate, identifiable="weakly", note=note)
            name = f"{estimate.name}_{way}"
            estimates[name] = replace(estimate, name=name)
    return estimates


@dataclass(frozen=True)
class _Told:
    """What the steps say of the numbers of `STATED` (n,): values, standard errors with their degrees of freedom,
    lines of type B, and how many times the noise the fit leaves while the steps ring.
    """

    centre: Array
    error: Array
    freedom: Array
    lines: tuple[tuple[str, str, Array], ...]
    ringing: float

    def estimate(self, index: int) -> Estimate:
        """One of the numbers with its budget."""
        name, unit = STATED[index]
        is_log = unit != "s"
        value = math.exp(self.centre[index]) if is_log else float(self.centre[index])
        scale, relative = value if is_log else 1.0, float(self.error[index])
        freedom = float(self.freedom[index])
        # What these data cannot tell of the gear's law is in the statistical part as well: any bench would show it.
        half = scale * math.hypot(
            student_quantile(freedom) * relative,
            *(NORMAL_COVERAGE_FACTOR * float(share[index]) for _, _, share in self.lines),
        )
        noise = BudgetLine(
            "noise, and scatter between the steps",
            "A",
            relative * scale,
            degrees_of_freedom=freedom,
        )
        lines = [
            BudgetLine(source, "B", float(share[index]) * scale, note)
            for source, note, share in self.lines
            if share[index] > 0.0
        ]
        verdict, note = self._verdict(name, relative, half) if is_log else ("yes", "")
        return Estimate(
            name=name,
            value=value,
            unit=unit,
            low=value - half,
            high=value + half,
            identifiable=verdict,
            note=note,
            budget=(noise, *lines),
        )

    def _verdict(self, name: str, relative: float, half: float) -> tuple[Identifiable, str]:
        if name in WANTED:
            if half > WANTED[name]:
                note = f"the steps tell it within {half:.2g}, and {WANTED[name]:g} is asked for"
                return ("weakly" if half <= 4.0 * WANTED[name] else "no"), note
        elif relative > WEAK:
            note = f"the steps tell it to {100.0 * relative:.0f} %"
            return ("weakly" if relative <= POOR else "no"), note
        if self.ringing > RINGS_ON:
            note = f"while the steps ring the model leaves {self.ringing:.3g} times what it leaves later"
            return "weakly", note
        return "yes", ""


def _lines(model: TorsionModel, centre: Array) -> list[tuple[str, str, Array]]:
    """Type B: how much damping stiffens rests on the share of the compliance that is damped."""
    bare = replace(model, relaxation=LEAST_RELAXATION).mode()[0]
    stiffened = 2.0 * math.log(model.mode()[0] / bare)
    doubt = np.zeros(len(centre))
    doubt[0] = SHARE_DOUBT * abs(stiffened)
    return [("share of the damped compliance", "of the parameter set", doubt)]


def _unfitted_hysteresis(model: TorsionModel) -> Array:
    """What a hysteresis that a rung leaves out may do to its numbers: relative standard uncertainties.

    A Dahl element of stiffness s beside K that slides over a travel l has, at the amplitude x l, the damping ratio
    zeta = 2 s x/(3 pi K), and softens from its smallest amplitudes by s x^2/(3 K) = (pi/2) zeta x, with x <= 1.
    The damping beyond that of the bearing is the most that it can be; what is stated lies between none and all of it.
    """
    frequency, damping = model.mode()
    lost = 0.5 * model.loss / frequency
    uniform = 1.0 / math.sqrt(3.0)
    softer = 0.5 * math.pi * lost * uniform
    return np.array([softer, softer, 0.5 * softer, uniform * lost / damping, 0.0])


def _ringing_left(problem: Problem, solution: Solution) -> float:
    """How many times what a fit leaves long after the onset of the steps it leaves while they ring.

    Noise is alike in both; a wrong mode leaves a ringing. 1 where no step lasts long enough to say.
    """
    early, late = np.zeros(2), np.zeros(2)
    for step, normal, weight in zip(problem.steps, solution.normals, solution.weights, strict=True):
        for sums, inside in (
            (early, (step.stamps > 0.0) & (step.stamps < RINGS)),
            (late, step.stamps > RUNG_DOWN),
        ):
            sums += float(weight) * np.array(
                [np.sum(normal.residual[inside] ** 2), np.count_nonzero(inside)]
            )
    if not (early[1] and late[0]):
        return 1.0
    return math.sqrt(early[0] / early[1] / (late[0] / late[1]))


def _between_answers(answers: Sequence[Solution], numbers: Callable[[Array], Array]) -> Array:
    """Standard deviation of the numbers over several answers, each as likely as exp(-cost/2) has it."""
    cost = np.array([a.robust_cost() for a in answers])
    likely = np.exp(-0.5 * (cost - cost[0]))
    stated = np.array([numbers(a.vector) for a in answers])
    mean = likely @ stated / likely.sum()
    return np.sqrt(likely @ (stated - mean) ** 2 / likely.sum())


def _slopes(numbers: Callable[[Array], Array], here: Array, size: int) -> Array:
    """Derivatives of the stated numbers by those of the shape (numbers, p); none depends on the kinematic error."""
    slopes = np.zeros((len(numbers(here)), len(here)))
    for k in range(size):
        h = np.zeros(len(here))
        h[k] = 1e-4 if abs(here[k]) > 1e-2 else 1e-7
        slopes[:, k] = (numbers(here + h) - numbers(here - h)) / (2.0 * h[k])
    return slopes


def _standard_error(solution: Solution, slopes: Array) -> tuple[Array, Array]:
    """Standard error of each number, and its degrees of freedom.

    What the noise of the samples gives and what the steps pull each their own way, as a root sum of squares: the
    second holds the first once more, which stands for what the few steps of a run share.
    """
    white = np.sqrt(np.einsum("ij,jk,ik->i", slopes, solution.covariance(), slopes))
    pulls = solution.influence() @ slopes.T
    count = len(pulls)
    square = (pulls**2).sum(axis=0)
    between = np.sqrt(square * count / (count - 1))
    effective = square**2 / np.maximum((pulls**4).sum(axis=0), 1e-300)
    return np.hypot(white, between), np.clip(effective, 3.0, count - 1.0)
