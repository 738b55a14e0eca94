"""What the fit of all steps says of the mode: the stated numbers with their budgets, and whether they are told."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from model.errors import IdentificationError
from model.identify.checks import Array
from model.identify.estimate import NORMAL_COVERAGE_FACTOR, BudgetLine, Estimate, Identifiable
from model.identify.least_squares import student_quantile
from model.identify.step_counts import led_away, left_in_band
from model.identify.step_data import StepData
from model.identify.step_fit import Solution
from model.identify.step_problem import Problem
from model.identify.step_rungs import LEAST_RELAXATION
from model.identify.step_search import EXPLAINED, HIGHEST_SHARE, LOWEST_HZ
from model.identify.torsional_mode import TorsionModel
from model.units import REVOLUTION

RINGS, RUNG_DOWN = 0.25, 0.4
"""s after the onset of a step until which it rings, and from which on it does no more."""
RINGS_ON = 1.15
"""Ratio of what a fit leaves in the two beyond which the mode is not explained; noise alone makes it 1 within 0.03."""
_UNEXPLAINED = 2.0
"""Power that a fit leaves near the mode over what it leaves beside it beyond which the mode is not explained."""
_UNEXPLAINED_LOSS = 1.2
"""The same for its damping: a frequency stands beside a small ringing that no rung holds, how fast it dies does not."""
LEAST_SPEEDS = 3
"""Speeds whose steps are left out in turn: with two, each would be held against the other alone."""
ALIKE = 0.1
"""Of their standard error, by which the numbers of two starts may differ that led to one answer."""
_SHARE_DOUBT = 0.3
"""Relative standard uncertainty of the share of the compliance that is damped."""

BY_RUNG, NO_HYSTERESIS, BY_LAW = "choice of the rung", "hysteresis", "law of the hysteresis"
"""Sources of lines of the budget."""
_ASTRAY = 10.0
"""Squares of the noise by which a richer rung is no worse that was searched well: so much its prior may pull."""
TO_RICHER, FROM_BELOW = (
    "to the next richer rung",
    "what the richest rung changed, as far as more of it may be hidden, rectangular",
)
STATED = (
    ("stiffness_over_inertia", "1/s2"),
    ("mode_squared", "1/s2"),
    ("frequency", "Hz"),
    ("damping_ratio", "1"),
    ("skew", "s"),
)
"""What is stated, in the order of `_numbers`: logarithms but for the skew."""
BOTH_WAYS, FREQUENCY, DAMPING = (0, 2, 3), 2, 3
WIDEST = 0.5
"""Share of its frequency within which a rung must tell it, with 95 %, to be one: beyond it the search ran away."""
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


def estimates_of(
    steps: Sequence[StepData],
    problem: Problem,
    answers: Mapping[str, Sequence[Solution]],
    readings: Mapping[str, Reading],
    *,
    chosen: str,
    others: Sequence[tuple[str, str]],
    swings: Array,
) -> dict[str, Estimate]:
    """The stated numbers with their budgets, and those of which a direction alone has something to say.

    `swings`: the torque over J_o [rad/s2] with which each step begins to ring (steps,). `answers` of every rung, the
    best first, and how each is read; `others`: rungs by what they are to the chosen one. What these lead to is a line
    of the budget, but for the damping ratio, which is that of all rungs by their evidence.
    """
    solution = answers[chosen][0]
    reading = readings[chosen]
    if not np.all(np.isfinite(reading.centre)):
        raise IdentificationError("the steps lead to no mode that rings", where="velocity steps")
    richest = list(answers)[-1]
    swung = damped_at(answers[richest][0], readings[richest], swings)
    told = _weighed_damping(
        _rung_answer(problem, solution, readings, chosen, others), problem, answers, readings, swung
    )
    estimates = {name: told.estimate(index) for index, (name, _) in enumerate(STATED)}
    direction = np.array([math.copysign(1.0, s.target) for s in steps])
    for way, sign in (("forward", 1.0), ("reverse", -1.0)):
        opposite = np.flatnonzero(direction == -sign)
        if not 0 < len(opposite) < len(steps):
            continue
        alone = reading.numbers(solution.vector + solution.left_out(opposite.tolist()))
        moved = alone - reading.centre
        if not np.all(np.isfinite(alone)) or abs(moved[FREQUENCY]) > WIDEST:
            # The other direction carries it all: to first order this one leads anywhere.
            continue
        estimates |= _one_way(told, moved, way)
    return estimates


def _one_way(told: _RungAnswer, moved: Array, way: str) -> dict[str, Estimate]:
    """The numbers of which one direction alone says something, where leaving out the other moves them so far."""
    # Left out to first order: that is in doubt by as much as it leads away.
    away = np.abs(moved)
    first_order = ("first order", "of leaving the other direction out", away / math.sqrt(3.0))
    alone = replace(
        told,
        centre=told.centre + moved,
        error=math.sqrt(2.0) * told.error,
        lines=(*told.lines, first_order),
    )
    estimates: dict[str, Estimate] = {}
    for index in BOTH_WAYS:
        estimate = alone.estimate(index)
        if away[index] > WEAK and estimate.identifiable == "yes":
            note = "one direction alone leads too far from both to be told to first order"
            estimate = replace(estimate, identifiable="weakly", note=note)
        name = f"{estimate.name}_{way}"
        estimates[name] = replace(estimate, name=name)
    return estimates


@dataclass(frozen=True)
class Reading:
    """What one rung says of the numbers of `STATED` (n,): values, standard errors with their degrees of freedom, how
    far counts had led them, which is taken off, how many times the power is near the mode that is beside it, how many
    squares of the noise may be hidden there, its cost, and the numbers as a function of those of the fit.
    """

    centre: Array
    error: Array
    freedom: Array
    counts: Array
    left: float
    hidden: float
    cost: float
    numbers: Callable[[Array], Array]


def read_rung(problem: Problem, answers: Sequence[Solution], amplitude: float) -> Reading:
    """A rung of these answers, the best first, at a torque amplitude over J_o [rad/s2]."""
    solution = answers[0]
    plain = _stated(problem, solution, amplitude)
    left, hidden = left_in_band(problem, solution)
    slopes = _slopes(plain, solution.vector, len(solution.shape.names))
    led = led_away(problem, solution) @ slopes.T
    led = np.where(np.isfinite(led), led, 0.0)
    off, drawn = led.mean(axis=0), led.std(axis=0, ddof=1)

    def numbers(vector: Array) -> Array:
        return plain(vector) - off

    error, freedom = _standard_error(problem, solution, slopes, left)
    return Reading(
        centre=numbers(solution.vector),
        error=np.sqrt(
            np.maximum(error, drawn) ** 2
            + drawn**2 / len(led)
            + _between_answers(answers, numbers, left, error) ** 2
        ),
        freedom=freedom,
        counts=np.abs(off),
        left=left,
        hidden=hidden,
        cost=solution.robust_cost(),
        numbers=numbers,
    )


def ran_away(reading: Reading, period: float) -> str:
    """Why the search for a rung came to no mode, for samples `period` [s] apart; "" where it did."""
    frequency = math.exp(reading.centre[FREQUENCY]) if np.all(np.isfinite(reading.centre)) else 0.0
    if not LOWEST_HZ <= frequency <= HIGHEST_SHARE / period:
        return f"its search ran to {frequency:.3g} Hz, where none was looked for"
    half = student_quantile(float(reading.freedom[FREQUENCY])) * float(reading.error[FREQUENCY])
    if half > WIDEST:
        return f"it tells {frequency:.3g} Hz within {100.0 * half:.0f} % only"
    return ""


def _rung_answer(
    problem: Problem,
    solution: Solution,
    readings: Mapping[str, Reading],
    chosen: str,
    others: Sequence[tuple[str, str]],
) -> _RungAnswer:
    """What the chosen rung says, with the other rungs as a line of the budget.

    Beyond the richest rung stands a law that is none of them. What it would change is what the last one did, by the
    root of the squares that may be hidden over those that the last one gained: a change is as large as what it
    explains, squares go as its square.
    """
    reading, model = readings[chosen], problem.model(solution.values)
    counts = reading.counts / math.sqrt(3.0)
    lines = [
        *_lines(model, reading.centre),
        ("counts of both encoders", "what they lead to, which is taken off", counts),
    ]
    if others:
        note, neighbour = others[0]
        found = [readings[name].centre - reading.centre for _, name in others]
        # A rung that leads to no mode says nothing of this one.
        moved = np.max([np.abs(np.nan_to_num(f)) for f in found], axis=0)
        if note == FROM_BELOW:
            gained = readings[neighbour].cost - reading.cost
            moved *= math.sqrt(min(1.0, reading.hidden / gained) / 3.0)
        lines.append((BY_RUNG, note, moved))
    if model.hysteresis[1] == 0.0:
        lines.append((NO_HYSTERESIS, "not part of this rung", _unfitted_hysteresis(model)))
    ringing = _ringing_left(problem, solution)
    return _RungAnswer(
        reading.centre, reading.error, reading.freedom, tuple(lines), ringing, reading.left
    )


def _weighed_damping(
    told: _RungAnswer,
    problem: Problem,
    answers: Mapping[str, Sequence[Solution]],
    readings: Mapping[str, Reading],
    swung: float,
) -> _RungAnswer:
    """The same with the damping ratio of all rungs by their evidence; that of the chosen one where hysteresis is none
    of them or explains less than the spring that it holds, so that its search ran astray, or where the best of them
    leaves more than the noise of counting: then they may all be wrong.

    A hysteresis damps by its swing. Where even the calmest steps that tell it ring by more than the swing at which it
    is stated (`swung`), there is nothing but the law of the element between the two: the damping may have all of that,
    or none.
    """
    names = [name for name in readings if np.all(np.isfinite(readings[name].centre))]
    best = min(names, key=lambda name: answers[name][0].robust_cost())
    solution = answers[best][0]
    power = solution.robust_cost() / solution.samples
    if "hysteresis" not in names or power > EXPLAINED**2:
        return told
    richest = answers["hysteresis"][0]
    if richest.robust_cost() > solution.robust_cost() + _ASTRAY:
        return told
    likely = _likely([answers[name][0] for name in names], readings[best].left * max(1.0, power))
    values = np.array([readings[name].centre[DAMPING] for name in names])
    errors = np.array([readings[name].error[DAMPING] for name in names])
    centre, error, freedom = told.centre.copy(), told.error.copy(), told.freedom.copy()
    centre[DAMPING] = likely @ values
    error[DAMPING] = math.sqrt(float(likely @ errors**2))
    freedom[DAMPING] = likely @ np.array([readings[name].freedom[DAMPING] for name in names])
    rungs = np.zeros(len(STATED))
    rungs[DAMPING] = math.sqrt(float(likely @ (values - centre[DAMPING]) ** 2))
    others = ~np.isin(np.arange(len(STATED)), DAMPING)
    lines = [
        (source, note, share * others if source in (BY_RUNG, NO_HYSTERESIS) else share)
        for source, note, share in told.lines
    ]
    lines.append((BY_RUNG, "scatter of the rungs, weighed by their evidence", rungs))
    law = np.zeros(len(STATED))
    there = math.log(problem.model(richest.values).mode(swung)[1])
    weight = float(likely[names.index("hysteresis")])
    law[DAMPING] = weight * abs(there - readings["hysteresis"].centre[DAMPING]) / math.sqrt(3.0)
    lines.append(
        (BY_LAW, "from the swing of the calmest steps that tell it to the one that is stated", law)
    )
    return replace(told, centre=centre, error=error, freedom=freedom, lines=tuple(lines))


def ringing(swings: Array) -> float:
    """The swing at which steps ring that begin with these (steps,), each by the energy that it has: of a ringing that
    dies as exp(-t) two thirds of its first.
    """
    return 2.0 / 3.0 * float(np.sum(swings**3) / np.sum(swings**2))


def damped_at(solution: Solution, reading: Reading, swings: Array) -> float:
    """The swing [rad/s2] of the calmest steps that by themselves tell the damping as well as it is asked for; of all
    steps where no fewer do.

    The other steps only have to agree with them: what the law says between their swings and these was looked at.
    """
    slopes = _slopes(reading.numbers, solution.vector, len(solution.shape.names))[DAMPING]
    damping = math.exp(float(reading.centre[DAMPING]))
    calmest = np.argsort(swings)
    for count in range(1, len(calmest)):
        covariance = solution.covariance(without=calmest[count:].tolist())
        error = math.sqrt(reading.left * float(slopes @ covariance @ slopes))
        if NORMAL_COVERAGE_FACTOR * error * damping <= WANTED["damping_ratio"]:
            return ringing(swings[calmest[:count]])
    return ringing(swings)


def _stated(problem: Problem, solution: Solution, amplitude: float) -> Callable[[Array], Array]:
    """The stated numbers as a function of those of a fit (p,), NaN where these are no spring."""
    names = solution.shape.names

    def stated(vector: Array) -> Array:
        there = {**solution.values, **dict(zip(names, vector[: len(names)].tolist(), strict=True))}
        try:
            return _numbers(problem.model(there), there["skew"], amplitude)
        except (ArithmeticError, ValueError):
            # Numbers to first order can lead out of all springs.
            return np.full(len(STATED), math.nan)

    return stated


@dataclass(frozen=True)
class _RungAnswer:
    """What the steps say of the numbers of `STATED` (n,): values, standard errors with their degrees of freedom,
    lines of type B, how many times the noise the fit leaves while the steps ring, and how many times the power near
    the mode that it leaves beside it.
    """

    centre: Array
    error: Array
    freedom: Array
    lines: tuple[tuple[str, str, Array], ...]
    ringing: float
    left: float = 1.0

    def estimate(self, index: int) -> Estimate:
        """One of the numbers with its budget."""
        name, unit = STATED[index]
        is_log = unit != "s"
        value, scale, relative = float(self.centre[index]), 1.0, float(self.error[index])
        if is_log:
            value = scale = math.exp(value)
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
        return Estimate.about(
            name, value, half, unit, (noise, *lines), identifiable=verdict, note=note
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
        if self.left > (_UNEXPLAINED_LOSS if name == "damping_ratio" else _UNEXPLAINED):
            note = f"near the mode the model leaves {self.left:.3g} times the power that it leaves beside it"
            return "weakly", note
        return "yes", ""


def _lines(model: TorsionModel, centre: Array) -> list[tuple[str, str, Array]]:
    """Type B: how much damping stiffens rests on the share of the compliance that is damped."""
    bare = replace(model, relaxation=LEAST_RELAXATION).mode()[0]
    stiffened = 2.0 * math.log(model.mode()[0] / bare)
    doubt = np.zeros(len(centre))
    doubt[0] = _SHARE_DOUBT * abs(stiffened)
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


def _between_answers(
    answers: Sequence[Solution], numbers: Callable[[Array], Array], louder: float, error: Array
) -> Array:
    """Standard deviation of the numbers (n,) over several answers, each as likely as its cost has it.

    Starts that led to one answer count once: no number of theirs is apart by more than a share of its `error` (n,).
    """
    apart: list[Solution] = []
    stated: list[Array] = []
    for answer in answers:
        its = numbers(answer.vector)
        if not any(np.all(np.abs(its - other) <= ALIKE * error) for other in stated):
            apart.append(answer)
            stated.append(its)
    likely = _likely(apart, louder)
    values = np.array(stated)
    return np.sqrt(likely @ (values - likely @ values) ** 2)


def _likely(fits: Sequence[Solution], louder: float) -> Array:
    """How likely each of several fits is by the others, (n,) with the sum one: exp(-cost/2), the pull of the priors in
    the cost, of a noise that is so many times `louder` than the one in which the cost is counted.

    A richer rung holds the poorer ones, so that nothing more is laid on the numbers that it adds.
    """
    cost = np.array([fit.robust_cost() for fit in fits])
    likely = np.exp(-0.5 * (cost - cost.min()) / louder)
    return np.asarray(likely / likely.sum(), dtype=float)


def _slopes(numbers: Callable[[Array], Array], here: Array, size: int) -> Array:
    """Derivatives of the stated numbers by those of the shape (numbers, p); none depends on the kinematic error."""
    slopes = np.zeros((len(numbers(here)), len(here)))
    for k in range(size):
        h = np.zeros(len(here))
        h[k] = 1e-4 if abs(here[k]) > 1e-2 else 1e-7
        slopes[:, k] = (numbers(here + h) - numbers(here - h)) / (2.0 * h[k])
    return slopes


def _standard_error(
    problem: Problem, solution: Solution, slopes: Array, louder: float
) -> tuple[Array, Array]:
    """Standard error of each number, and its degrees of freedom.

    What the noise of the samples gives, so many times `louder` near the mode than over all, and what the steps pull
    each their own way, as a root sum of squares: the second holds the first once more, which stands for what the few
    steps of a run share. Steps of one speed share what the model lacks there: where they pull further together, that
    counts.
    """
    covariance = louder * solution.covariance()
    white = np.sqrt(np.einsum("ij,jk,ik->i", slopes, covariance, slopes))
    between, effective = _spread(solution.influence() @ slopes.T)
    groups = problem.by_speed()
    if len(groups) >= LEAST_SPEEDS:
        # Left out as a whole: the speed that says most would hide behind its own weight.
        without = [slopes @ solution.left_out(group) for group in groups]
        apart, independent = _spread(np.array(without) - np.mean(without, axis=0))
        apart = apart * (len(without) - 1) / len(without)
        effective = np.where(apart > between, independent, effective)
        between = np.maximum(between, apart)
    return np.hypot(white, between), effective


def _spread(pulls: Array) -> tuple[Array, Array]:
    """Standard error of a sum of pulls (n, numbers) that are independent, and its degrees of freedom."""
    count = len(pulls)
    square = (pulls**2).sum(axis=0)
    effective = square**2 / np.maximum((pulls**4).sum(axis=0), 1e-300)
    return np.sqrt(square * count / (count - 1)), np.clip(effective, 3.0, max(count - 1.0, 3.0))
