"""The search for the rungs of the ladder: where each begins, and which of its answers is the best.

Where an order of the kinematic error passes near the mode a spring has several answers; each start leads to one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from model.identify.checks import Array
from model.identify.step_fit import BAD_STEP, ROUGHLY, Solution, fit_all, reweighted
from model.identify.step_problem import Normal, Problem, Shape, StepArrays
from model.identify.step_rungs import BEARING_TORQUE, FITTED, Expected, shapes_of
from model.units import REVOLUTION

SCANNED, SCAN_TIME = 6, 0.5
"""Steps, and seconds of each, in which the first look for the mode is made."""
_KNOWN_WITHIN = 1.7
"""Factor to either side of an expected frequency within which the mode is looked for."""
LOWEST_HZ, HIGHEST_SHARE = 4.0, 0.4
EXPLAINED, WORTH = 1.1, 12.0
"""How many times the noise of counting a fit may leave that is no longer doubted, and by how much a richer rung must
lower the cost (in squares of the noise, its priors counted) to be chosen.
"""
_AWAY = (0.2, -0.2, 0.4, -0.4)
"""Logarithms of the stiffness from the card's at which further searches begin."""
LEAST_SEARCHES, SEARCHED = 2, 30_000
"""Starts of the rungs above the linear one that are tried at least, and samples to fit in all starts of a rung."""
SLIDING = ((0.05, 0.0), (0.2, -0.3))
"""Where a hysteresis element begins: its stiffness over K/J_o, by which the spring is softer, and what is taken off
the logarithm of the damping. Either leads to the better answer on some gears: both are always tried."""
LIMITS = (-0.7, 0.0)
"""Logarithms of its limit there over that of the card's loss. One that slides late is hardly told from a damper, and
the search stays in that valley; one that slides early mostly leads out of it."""
OTHERS, LOOKS = 30.0, 3
"""Cost beyond the least within which another frequency of the first look is searched from, and an answer is the same
and is fitted to the end, too; and how many frequencies at most."""
BENT = 0.02
"""Logarithms of K2/K1 and K3/K2 with which the hardening rung begins."""
PASSES, ROUNDS_PER_PASS = 4, 8
"""How often the weights of the steps are looked at again, and rounds of Gauss-Newton between."""


def climb(
    problem: Problem, expected: Expected, noise: float, richest: str, period: float
) -> dict[str, list[Solution]]:
    """The answers of the rungs, the best first, each begun where the one below ended."""
    still = np.zeros(2 * len(problem.basis))
    frequencies = _first_look(problem, expected, noise, period)
    shapes, added = shapes_of(expected, frequencies[0])
    card = {**added["linear"], "stiffness": math.log(expected.stiffness)}
    answers: dict[str, list[Solution]] = {}
    few = max(1, SEARCHED // sum(len(step.stamps) for step in problem.steps))
    for rung in FITTED[: FITTED.index(richest) + 1]:
        card |= added[rung] if rung != "linear" else {}
        least = few
        around = [({**card, "stiffness": card["stiffness"] + away}, still) for away in _AWAY]
        if rung == "linear":
            looks = [
                ({**card, "stiffness": 2.0 * math.log(REVOLUTION * f)}, still) for f in frequencies
            ]
            starts = [*looks, (card, still), *around]
            least = max(len(looks), min(few, len(starts)))
        elif rung == "hardening":
            starts = [*_bends(answers["linear"][0], added[rung]), (card, still), *around]
        else:
            starts = _slides(answers["hardening"][0], added, expected)
        below = answers["hardening"][0].robust_cost() if rung == "hysteresis" else math.inf
        answers[rung] = _answers(problem, shapes[rung], starts, noise, least, below)
    if richest == "hysteresis":
        one = _without_element(problem, shapes["hardening"], answers[richest][0], noise)
        answers["hardening"] = sorted([*answers["hardening"], one], key=lambda s: s.robust_cost())
    return answers


def _without_element(problem: Problem, shape: Shape, above: Solution, noise: float) -> Solution:
    """The hardening rung begun where the one above it ended: what the element was worth is held against the best spring
    without it, not against one that was searched from below in vain.
    """
    share = math.exp(above.values["soft"] - above.values["stiffness"])
    values = {name: above.values[name] for name in shape.names}
    values["stiffness"] += math.log1p(share)
    return _settled(problem, shape, values, above.error, noise)


def _slides(
    below: Solution, added: Mapping[str, Mapping[str, float]], expected: Expected
) -> list[tuple[dict[str, float], Array]]:
    """Starts of the hysteresis rung beside a hardening spring: an element that takes over some or most of its loss.

    A hardening spring alone bends by too little, or not at all, where a hysteresis softens it: it is begun as bent as
    the card says.
    """
    return [
        (
            {
                **below.values,
                **added["hardening"],
                **added["hysteresis"],
                "soft": math.log(share * expected.stiffness),
                "limit": added["hysteresis"]["limit"] + limit,
                "stiffness": below.values["stiffness"] - share,
                "damping": below.values["damping"] + less,
            },
            below.error,
        )
        for limit in LIMITS
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
    below: float,
) -> list[Solution]:
    """The fits from several starts, the best first.

    Where an order of the kinematic error passes near the mode, a spring has several answers, and each start leads
    to one of them. After `least_starts` the search ends with an answer that two starts lead to, below the richest rung
    also with one that leaves what counting does. The many speeds of a long run leave one answer: it is searched from
    fewer starts. Where the rung `below` (its cost) explains the steps and the first start adds nothing to it, no other
    is tried.
    """
    found: list[Solution] = []
    # The linear rung of a gear that hardens is never explained: the next rung searches on, and the richest to the end.
    fewest = LEAST_SEARCHES if "second" in shape.names else 1
    is_richest = "soft" in shape.names
    most = len(starts) if is_richest else max(fewest, least_starts)
    for tried, (values, error) in enumerate(starts[:most], start=1):
        found.append(_settled(problem, shape, values, error, noise))
        found.sort(key=lambda s: s.robust_cost())
        least = found[0].robust_cost()
        is_explained = least < EXPLAINED**2 * found[0].samples
        if is_explained and abs(least - below) < WORTH:
            break
        is_found_again = len(found) > 1 and found[1].robust_cost() < least + OTHERS
        if tried >= least_starts and (is_found_again or (is_explained and not is_richest)):
            break
    near = found[0].robust_cost() + OTHERS
    ended = [
        fit_all(
            problem,
            shape,
            one.values,
            one.error,
            noise=noise,
            weights=one.weights,
            known=one.normals,
        )
        for one in found
        if one.robust_cost() <= near
    ]
    return sorted([*ended, *found[len(ended) :]], key=lambda s: s.robust_cost())


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
    fit = partial(fit_all, problem, shape, noise=noise, converged=ROUGHLY)
    known: Sequence[Normal] = ()
    while True:
        solution = fit(values, error, weights=weights, rounds=ROUNDS_PER_PASS, known=known)
        values, error, known, left = solution.values, solution.error, solution.normals, left - 1
        wanted = reweighted(solution)
        if not left or float(np.max(np.abs(wanted - weights))) < 0.05:
            if solution.is_converged:
                return solution
            return fit(values, error, weights=weights, known=known)
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
        low = max(low, expected.frequency / _KNOWN_WITHIN)
        high = min(high, expected.frequency * _KNOWN_WITHIN)
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
        own=step.own[:, :rows],
        seen=step.seen[:rows],
    )
