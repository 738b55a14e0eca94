"""Spectra over angle of samples where they are: power per order, and the noise beside an order.

The sums  sum_i r_i e^{-i v theta_i}  at evenly spaced orders come from a fast transform: each sample
is laid onto the two nearest points of a fine grid. A long way is cut into windows, whose powers are
averaged. Only *where* orders stand and how strong the noise beside them is are read from it; their
amplitudes never are.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import scipy  # pyright: ignore[reportMissingTypeStubs]

from model.identify.checks import Array
from model.units import REVOLUTION

GRID_PER_PERIOD = 4
"""Points of the grid per period of the highest order."""
LARGEST_GRID = 1 << 20
"""Points of one window."""
NEIGHBOURS = 24
"""Free lines of the spectrum beside an order that tell its noise."""
_MEDIANS_AT_ONCE = 1 << 20
"""Numbers of which medians are taken at a time."""
_EMPTIED = 1.2
"""Lines to each side of a fitted order that the fit has emptied."""

Weighted = tuple[Array, Array, Array]
"""Angle [rad], value, samples that each stands for."""


@dataclass(frozen=True)
class Comb:
    """Mean power per order: line k at order k x spacing; power is that of white noise of this variance per sample.

    Of `windows` windows, with `padding` lines to each independent one.
    """

    spacing: float
    power: Array
    windows: int
    padding: int

    @property
    def orders(self) -> Array:
        """The order of each line."""
        return self.spacing * np.arange(len(self.power), dtype=np.float64)

    @property
    def resolution(self) -> float:
        """Orders between two independent lines."""
        return self.spacing * self.padding

    @classmethod
    def of(
        cls,
        parts: Iterable[Weighted],
        reach: tuple[float, float],
        highest: float,
        padding: int,
    ) -> Comb:
        """The spectrum of values over the angles from `reach[0]` to `reach[1]` [rad] up to order `highest`."""
        turns = max((reach[1] - reach[0]) / REVOLUTION, 1e-6)
        windows = max(1, math.ceil(turns * highest * GRID_PER_PERIOD / LARGEST_GRID))
        length = turns / windows
        points = max(math.ceil(GRID_PER_PERIOD * highest * length), 16)
        scale = points / (REVOLUTION * length)
        power = np.zeros(0)
        total = 0.0
        grid, current, filled = np.zeros(points + 2), -1, 0.0
        used = 0
        size = scipy.fft.next_fast_len(padding * points, real=True)
        lines = int(highest * length * size / points) + 1
        power = np.zeros(lines)

        def flush() -> None:
            nonlocal used, total, grid
            if filled <= 0.0:
                return
            power[:] += np.abs(scipy.fft.rfft(grid[:points], size)[:lines]) ** 2
            total += filled
            used += 1
            grid = np.zeros(points + 2)

        for angle, value, count in parts:
            place = (angle - reach[0]) * scale
            window = np.clip((place / points).astype(np.int64), 0, windows - 1)
            for number in np.unique(window).tolist():
                if number != current:
                    flush()
                    current, filled = number, 0.0
                chosen = window == number if windows > 1 else slice(None)
                at = np.maximum(place[chosen] - number * points, 0.0)
                low = np.minimum(at.astype(np.int64), points)
                share = at - low
                weighted = value[chosen] * count[chosen]
                grid += np.bincount(low, weighted * (1.0 - share), points + 2)
                grid += np.bincount(low + 1, weighted * share, points + 2)[: points + 2]
                filled += float(count[chosen].sum())
        flush()
        # The two points that a sample is laid on take sinc^2 of its power at the order of the grid.
        spacing = points / (length * size)
        loss = np.sinc(np.arange(lines) / size) ** 4
        return cls(spacing, power / loss / max(total, 1.0), max(used, 1), padding)

    def noise(self, orders: Array, taken: Array, lowest: float) -> tuple[Array, Array]:
        """Variance per sample of the noise beside each order, and the degrees of freedom that it is known with.

        From the nearest lines that no order of `taken` has emptied, above `lowest`. A comb without padding.
        """
        free = np.ones(len(self.power), dtype=bool)
        free[: math.ceil(lowest / self.spacing)] = False
        for order in np.asarray(taken) / self.spacing:
            low, high = math.ceil(order - _EMPTIED), math.floor(order + _EMPTIED)
            free[max(low, 0) : high + 1] = False
        places = np.flatnonzero(free)
        if not len(places):
            return np.full(len(orders), math.nan), np.zeros(len(orders))
        summed = np.concatenate([[0.0], np.cumsum(self.power[places])])
        wanted = min(NEIGHBOURS, len(places))
        middle = np.searchsorted(places, np.asarray(orders) / self.spacing)
        low = np.clip(middle - wanted // 2, 0, len(places) - wanted)
        density = np.maximum(summed[low + wanted] - summed[low], 0.0) / wanted
        return density, np.full(len(orders), 2.0 * wanted * self.windows)


def median_floor(power: Array, half: int) -> Array:
    """Mean of noise power about each line from the median of the lines within `half` of it, (n,)."""
    n = len(power)
    half = max(min(half, (n - 1) // 2), 1)
    # A running median over a few thousand lines is exact; longer spectra take it block by block.
    block = max(1, half // 8) if n > 4096 else 1
    centres = np.arange(0, n, block)
    window = np.arange(min(2 * half + 1, n))
    low = np.clip(centres - half, 0, max(n - 2 * half - 1, 0))
    parts = np.array_split(low, max(1, low.size * window.size // _MEDIANS_AT_ONCE))
    medians = np.concatenate([np.median(power[part[:, None] + window], axis=1) for part in parts])
    floor: Array = np.interp(np.arange(n), centres, medians)
    return np.maximum(floor, np.finfo(float).tiny)
