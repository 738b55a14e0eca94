"""Which orders a channel has: those that stand above the noise beside them, found in rounds, refined between lines.

Each round takes the strongest lines of what the fit so far leaves, and refines all orders with them:
leakage of a strong line is gone before a weak one is believed. A line is believed where noise alone
would bring one as strong once in a hundred recordings. One that the data cannot tell from a whole
order, or from n + k/N of a gear of ratio N, is that order.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import scipy  # pyright: ignore[reportMissingTypeStubs]

from model.arrays import ComplexArray, IntArray
from model.identify.checks import Array
from model.identify.orders.aliases import ONE_AND_THE_SAME, SamplingWindow
from model.identify.orders.comb import GRID_PER_PERIOD, LARGEST_GRID, Comb, median_floor
from model.identify.orders.regression import Moving, Solved, residuals, solve
from model.identify.orders.samples import WHOLE_TURN, OrderSamples, Piece

FALSE_ALARM = 0.01
"""Probability that noise alone brings a line anywhere in the spectrum."""
_MEDIAN_EFFICIENCY = 0.48
"""Of the median of exponentially distributed numbers against their mean."""
FLOOR_LINES = 20
"""Independent lines to each side that tell the floor under a line."""
AT_ONCE = 0.25
"""Share of the strongest line's power over noise from which on others are added with it: weaker ones may be leakage."""
ROUNDS = 14
MOST_LINES = 48
"""Orders that are fitted; a gear has some dozens."""
APART = 0.75
"""Lines between two orders below which they are one."""
_NEAR_WHOLE = 0.1
"""Lines by which a short way may miss a whole order."""
CERTAIN = 3.0
"""Standard uncertainties of an order within which it is a whole one, or one of the gear's lattice."""
GROWTH = 4.0
"""By which the way grows over which an order is refined."""
PADDING = 2
_STRONGER = 1.2
"""Amplitude of a whole order over that of a line from which on the line is its image."""
_BETWEEN_WHOLE = 0.35
"""Orders between two lines from which on nothing stands between two whole orders."""
BLIND = 0.99
"""Correlation of an order with itself, turned back, from which on its sine or cosine is zero at every sample."""
_HARDLY_ALIKE = 0.05
"""Correlation of two orders below which neither is an image of the other."""


@dataclass(frozen=True)
class Line:
    """An order with its standard uncertainty; 0 for one that is taken for whole, or of the lattice."""

    order: float
    uncertainty: float


@dataclass(frozen=True)
class Search:
    """What is looked for: orders up to `highest`, in a gear of `ratio` (NaN: unknown), whole ones preferred or not, in
    so many rounds at most.
    """

    highest: float
    ratio: float = math.nan
    prefers_whole: bool = False
    rounds: int = ROUNDS


def find_orders(samples: OrderSamples, search: Search) -> list[Line]:
    """The orders that stand above the noise in what is held, ascending."""
    window = samples.window
    lines: list[Line] = []
    tried: list[float] = []
    lowest = lowest_order(samples)
    resolution = min(1.0 / max(samples.revolutions(d), 1e-6) for d in samples.directions)
    apart = APART / max(samples.held_revolutions, 1e-6)
    for _ in range(search.rounds):
        taken = np.array([line.order for line in lines])
        found = _strongest(samples, search, taken, lowest)
        only_whole = search.prefers_whole and _BETWEEN_WHOLE < resolution <= 1.0 / WHOLE_TURN
        if only_whole:
            found = np.unique(np.maximum(np.rint(found), 1.0))
        fresh = _fresh(found, taken, apart)
        fresh = [v for v in fresh if window.folded(v) < BLIND and v not in tried]
        fresh = fresh[: MOST_LINES - len(lines)]
        if not fresh:
            break
        tried += fresh
        if only_whole:
            lines = _apart([*lines, *(Line(v, 0.0) for v in fresh)], resolution)
            continue
        lines = _refined(samples, lines, np.array(fresh), search, resolution)
        lines = _unfolded(lines, samples, search, window, resolution)
    return lines


def lowest_order(samples: OrderSamples) -> float:
    """Below it an order is not told from the trend of the stretches."""
    longest = max(s.revolutions for s in samples.stretches)
    degree = max(s.degree for s in samples.stretches)
    return (0.98 if degree <= 1 else 0.75 * degree) / max(longest, 1e-6)


def searched_to(samples: OrderSamples, highest: float) -> float:
    """The order up to which a spectrum has lines of its own: half the samples per revolution where these are most."""
    return min(highest, 0.5 * samples.densest)


def residual_combs(
    samples: OrderSamples, solved: dict[int, Solved], highest: float, padding: int
) -> dict[int, Comb]:
    """The spectrum of what the fit leaves of what is held, by direction."""
    combs: dict[int, Comb] = {}
    for direction, one in solved.items():
        left = residuals(samples, samples.held, one, direction)
        combs[direction] = Comb.of(left, samples.held_reach(direction), highest, padding)
    return combs


def _strongest(samples: OrderSamples, search: Search, taken: Array, lowest: float) -> Array:
    """Orders of the lines of the residual that noise does not explain, the strongest of them, strongest first."""
    solved = {d: solve(samples, samples.held, d, taken) for d in samples.held_directions}
    combs = residual_combs(samples, solved, searched_to(samples, search.highest), PADDING)
    coarse = max(combs.values(), key=lambda comb: comb.resolution)
    orders = coarse.orders if len(combs) == 1 else _common_orders(combs)
    power, floors, freedom = np.zeros(len(orders)), 0.0, 0.0
    for comb in combs.values():
        floor = median_floor(comb.power[1:], FLOOR_LINES * PADDING)
        share = comb.power[1:] / (floor / _median_share(comb.windows))
        power += comb.windows * np.interp(orders, comb.orders[1:], share, left=0.0)
        freedom += 2.0 * comb.windows
        floors += _MEDIAN_EFFICIENCY * 2 * FLOOR_LINES * 2.0 * comb.windows
    chance = scipy.special.fdtrc(freedom, max(floors, 8.0), 2.0 * power / freedom)
    independent = max(len(orders) / PADDING, 1.0)
    is_top = np.ones(len(orders), dtype=bool)
    is_top[1:] &= power[1:] > power[:-1]
    is_top[:-1] &= power[:-1] >= power[1:]
    believed = is_top & (chance < FALSE_ALARM / independent) & (orders >= lowest * 0.99)
    if not believed.any():
        return np.empty(0)
    believed &= power > AT_ONCE * power[believed].max()
    index = np.flatnonzero(believed)
    found: Array = orders[index[np.argsort(-power[index])]]
    return found


def _common_orders(combs: dict[int, Comb]) -> Array:
    """Orders that both directions are looked at: as fine as the finer of them."""
    finest = min(comb.spacing for comb in combs.values())
    top = min(comb.orders[-1] for comb in combs.values())
    return np.arange(0.0, top, finest)


def _median_share(windows: int) -> float:
    """Median over mean of the power of noise that is the mean of this many windows."""
    return float(scipy.special.gammaincinv(windows, 0.5)) / windows


def _fresh(found: Array, taken: Array, apart: float) -> list[float]:
    """Of the orders found, strongest first, those that are none of the taken and no neighbour of a stronger one."""
    kept: list[float] = []
    for order in found.tolist():
        if all(abs(order - other) > apart for other in [*kept, *taken.tolist()]):
            kept.append(order)
    return kept


def _refined(
    samples: OrderSamples, lines: list[Line], fresh: Array, search: Search, resolution: float
) -> list[Line]:
    """The lines and the fresh orders, moved to where the data have them; then the whole ones made whole.

    What was found in windows of a long way is refined over ways that grow, so that no turn is miscounted.
    """
    known = np.array([line.order for line in lines])
    free = [k for k, line in enumerate(lines) if line.uncertainty > 0.0]
    every = np.concatenate([known, fresh])
    new = np.arange(len(known), len(every))
    for span in _growing(samples, search):
        every, _ = _moved(samples, every, new, search, span)
    moving = np.concatenate([np.array(free, dtype=np.int64), new])
    every, _ = _moved(samples, every, moving, search, math.inf)
    every, uncertainty = _moved(samples, every, moving, search, math.inf)
    moved = dict(zip(moving.tolist(), uncertainty.tolist(), strict=True))
    settled = [
        _settled(Line(order, moved[k]), search.ratio, resolution) if k in moved else lines[k]
        for k, order in enumerate(every.tolist())
    ]
    return _apart(settled, resolution)


def _growing(samples: OrderSamples, search: Search) -> list[float]:
    """Ways [rev], each four times the last, from one that shows the orders apart to below the whole way."""
    longest = max(samples.revolutions(d) for d in samples.directions)
    window = LARGEST_GRID / (GRID_PER_PERIOD * searched_to(samples, search.highest))
    span = min(window, samples.held_revolutions)
    spans: list[float] = []
    while span < 0.9 * longest:
        spans += [span, span] if span <= samples.held_revolutions else [span]
        span *= GROWTH
    return spans


def _moved(
    samples: OrderSamples, orders: Array, places: IntArray, search: Search, span: float
) -> tuple[Array, Array]:
    """The orders with those at `places` moved by the data within `span` revolutions, and standard uncertainties."""
    shift, information = np.zeros(len(places)), np.full(len(places), 1e-300)
    widest = min(span, max(samples.revolutions(d) for d in samples.directions))
    for direction in samples.held_directions:
        held_span = min(span, samples.held_revolutions)
        near = samples.within(direction, held_span)
        first = solve(samples, near(), direction, orders)
        middle = samples.held_middle(direction)
        noise = _noise_at(samples, first, near(), orders[places], direction, search)
        # An order is known to its line before: neighbours that move alike stay where they are.
        moving = Moving(places, first.amplitudes[places], middle, noise * (2.0 * widest) ** 2)
        moved = solve(samples, samples.within(direction, span)(), direction, orders, moving)
        shift += moved.shift / (moved.shift_variance * noise)
        information += 1.0 / (moved.shift_variance * noise)
    step = np.clip(shift / information, -0.5 / widest, 0.5 / widest)
    out = orders.copy()
    out[places] = np.maximum(orders[places] + step, 0.25 / widest)
    return out, 1.0 / np.sqrt(information)


def _noise_at(
    samples: OrderSamples,
    solved: Solved,
    pieces: Iterable[Piece],
    orders: Array,
    direction: int,
    search: Search,
) -> Array:
    """Variance per sample of the noise beside orders, from these pieces."""
    kept = list(pieces)
    left = residuals(samples, kept, solved, direction)
    reach = (
        min(float(piece.angle.min()) for piece in kept),
        max(float(piece.angle.max()) for piece in kept),
    )
    comb = Comb.of(left, reach, searched_to(samples, search.highest), 1)
    noise, _ = comb.noise(orders, solved.orders, 0.0)
    return np.where(np.isfinite(noise), np.maximum(noise, 1e-300), 1e-300)


def _settled(line: Line, ratio: float, resolution: float) -> Line:
    """The whole order, or that of the gear's lattice, that a line cannot be told from; else the line."""
    near = CERTAIN * line.uncertainty + _NEAR_WHOLE * resolution
    whole = round(line.order)
    if whole > 0 and abs(line.order - whole) <= near:
        return Line(float(whole), 0.0)
    if math.isfinite(ratio) and near < 0.25 / ratio:
        lattice = round(line.order * ratio) / ratio
        if lattice > 0.0 and abs(line.order - lattice) <= near:
            return Line(lattice, 0.0)
    return line


def _apart(lines: list[Line], resolution: float) -> list[Line]:
    """Ascending; of two that moved onto each other one is left, the certain one first."""
    kept: list[Line] = []
    for line in sorted(lines, key=lambda one: one.uncertainty):
        if all(abs(line.order - other.order) > APART * resolution for other in kept):
            kept.append(line)
    return sorted(kept, key=lambda one: one.order)


def _unfolded(
    lines: list[Line],
    samples: OrderSamples,
    search: Search,
    window: SamplingWindow,
    resolution: float,
) -> list[Line]:
    """Images replaced by the whole order above the band that explains the data better, where the speed tells them.

    Where it does not, the lower of the two stands for both; the whole one where whole orders are preferred.
    """
    out: list[Line] = []
    for line in lines:
        if line.uncertainty > 0.0:
            lower = window.principal(line.order)
            line = _settled(Line(lower, line.uncertainty), search.ratio, resolution)
        out.append(_whole_instead(line, samples, search, window) if line.uncertainty else line)
    return _apart(out, resolution)


def _whole_instead(
    line: Line, samples: OrderSamples, search: Search, window: SamplingWindow
) -> Line:
    """The whole order of which a line is the image; the line itself where none explains the data better."""
    best, strength = line, _strength(samples, line.order)
    for other, _ in window.candidates(line.order):
        alike = window.correlation(line.order, other)
        if alike > ONE_AND_THE_SAME:
            if search.prefers_whole and other <= search.highest:
                return Line(float(other), 0.0)
        elif alike > _HARDLY_ALIKE:
            its = _strength(samples, float(other))
            if its > _STRONGER * strength:
                best, strength = Line(float(other), 0.0), its
    return best


def _strength(samples: OrderSamples, order: float) -> float:
    """Amplitude of an order alone in what is held [unit of the channel], directions together."""
    size = 0.0
    for direction in samples.held_directions:
        found: ComplexArray = solve(samples, samples.held, direction, np.array([order])).amplitudes
        size = math.hypot(size, abs(complex(found[0])))
    return size
