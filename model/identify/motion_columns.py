"""What one axis' effort is explained by, sample by sample: acceleration, speed, its sign, load over position.

Velocity and acceleration come from the position (or from a measured speed) by a zero-phase
low-pass Butterworth filter and central differences of fourth order. Then every regressor and the effort pass the
same short window of raised cosine and are decimated together (parallel filter; Gautier and Khalil
1990): whatever the window does to one side it does to the other, so that neither lag nor aliasing
comes of it.

Where the axis stands still its effort is whatever holds it, between - F_c and + F_c: such rows are
no samples of sliding friction. Slower than `least_speed` for longer than a period of the cut-off
frequency is standstill; a passage through zero is none, it keeps its sign.

The noise of the position is white from sample to sample, so that even and odd samples see two
independent ones of it. Half the difference of what both make of speed and acceleration is a column
of its own: its square is what the noise adds to the normal equations (`model.identify.motion_moments`).
Where neighbouring samples share their noise that says nothing; speed and acceleration of a few periods
of the cut-off frequency before and after are columns too, whose noise is another one
(`model.identify.motion_shared`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy  # pyright: ignore[reportMissingTypeStubs]

from model.arrays import BoolArray, IntArray
from model.errors import IdentificationError
from model.identify.checks import Array
from model.identify.motion_source import MotionBlock, MotionSource, UnbrokenRows

HIGHEST_SHARE = 0.4
"""Of the sampling frequency: above it nothing is differentiated."""
SETTLING = 2.5
"""Periods of the cut-off frequency at both ends of a stretch that the filter needs, and that are dropped."""
APART = 2.5
"""Periods of the cut-off frequency to the columns before and after: the filtered noise has forgotten itself by then."""
REACH = 10.0
"""Periods of the cut-off frequency around a block that are read with it, so that blocks meet without a seam."""
BLOCK_ROWS = 1 << 16
_STANDING_SHARE = 0.02
"""Share of a sample's window at standstill from which on it is left out."""
LEAST_SAMPLES = 20


@dataclass(frozen=True)
class MotionFilter:
    """How velocity and acceleration are taken from the position: the recipe of the fit.

    cutoff_hz of the zero-phase Butterworth filter of `order`; `decimation` of regressors and effort
    (1 = none); `least_speed` [rad/s or m/s] below which the axis stands (0: it never does);
    `keeps_passages`: whether a passage through zero that is too short to be a standstill is kept.
    """

    order: int = 4
    cutoff_hz: float = 100.0
    decimation: int = 10
    least_speed: float = 0.0
    keeps_passages: bool = True

    def check(self, period: float) -> None:
        """Raise `IdentificationError` for a filter that this sampling period [s] does not allow."""
        nyquist = 0.5 / period
        if not 0.0 < self.cutoff_hz < nyquist:
            raise IdentificationError(
                "is outside the band of the recording",
                where="filter.cutoff_hz",
                value=self.cutoff_hz,
                limit=f"> 0 and < {nyquist:g} Hz",
                remedy="Choose a cut-off well above the motion and below half of the sampling rate.",
            )
        if self.order < 1 or self.decimation < 1 or not self.least_speed >= 0.0:
            raise IdentificationError(
                "order and decimation start at 1, the least speed at 0", where="filter", value=self
            )

    def window(self) -> Array:
        """The window of every decimated sample, a raised cosine of two of its steps, of sum one."""
        window = scipy.signal.windows.hann(2 * self.decimation + 1)[1:-1]
        return np.asarray(window / window.sum(), dtype=np.float64)

    def settling(self, period: float) -> int:
        """Rows at each end of a stretch that are dropped."""
        return math.ceil(SETTLING / (self.cutoff_hz * period))

    def reach(self, period: float) -> int:
        """Rows around a block that are read with it."""
        return math.ceil(REACH / (self.cutoff_hz * period)) + 2 * self.decimation


@dataclass(frozen=True)
class Basis:
    """Which columns are made besides acceleration, speed and sign.

    `load_orders` k give sin and cos of k times the load's angle, which is `load_turn` times the
    position; `stribeck` are speeds v_s of exp[-(v/v_s)^2] sgn v; `lag` [s] by which the effort is
    late, `instrument_lag` the same of the instrument; `instrument_is_speed` says what that is.
    `tried_lags` [s] give the effort brought forward by each, beside the effort itself.
    """

    load_orders: tuple[int, ...] = ()
    load_turn: float = 1.0
    stribeck: tuple[float, ...] = ()
    lag: float = 0.0
    instrument_lag: float = 0.0
    instrument_is_speed: bool = False
    tried_lags: tuple[float, ...] = ()

    @property
    def load_names(self) -> tuple[str, ...]:
        return tuple(f"load_{part}_{k}" for k in self.load_orders for part in ("sin", "cos"))

    @property
    def stribeck_names(self) -> tuple[str, ...]:
        return tuple(f"stribeck_{k}" for k in range(len(self.stribeck)))

    @property
    def tried_names(self) -> tuple[str, ...]:
        return tuple(f"effort_{k}" for k in range(len(self.tried_lags)))

    def names(self, with_instrument: bool) -> tuple[str, ...]:
        """The names of the columns in their order; the last is the effort."""
        slopes = tuple(f"{name}_slope" for name in self.stribeck_names)
        instrument = ("instrument_acceleration", "instrument_speed") if with_instrument else ()
        return (
            *("acceleration", "speed", "sign", "one", "speed_size"),
            *self.load_names,
            *self.stribeck_names,
            *slopes,
            *("noise_acceleration", "noise_speed", "jerk", "sign_rate", "effort_rate"),
            *("apart_acceleration", "apart_speed"),
            *self.tried_names,
            *instrument,
            "effort",
        )


@dataclass(frozen=True)
class Samples:
    """Decimated samples of one block: time (n,), columns (n, p), and which of them are at standstill (n,)."""

    time: Array
    columns: Array
    standing: BoolArray


@dataclass(frozen=True)
class _Even:
    """One block on an even axis: what each signal is there, and half the difference of its two halves."""

    time: Array
    first: int
    is_position: bool
    motion: Array
    halves: Array
    effort: Array
    instrument: Array | None
    tried: tuple[Array, ...]


def low_pass(values: Array, recipe: MotionFilter, period: float) -> Array:
    """The zero-phase filter of the recipe."""
    sections = scipy.signal.butter(recipe.order, recipe.cutoff_hz * 2.0 * period, output="sos")
    return np.asarray(scipy.signal.sosfiltfilt(sections, values, axis=0), dtype=np.float64)


def slope(values: Array, period: float) -> Array:
    """Central differences of fourth order; those of the two rows at each end are of lower order."""
    out = np.gradient(values, period, axis=0)
    if len(values) > 4:
        wide, near = values[4:] - values[:-4], values[3:-1] - values[1:-3]
        out[2:-2] = (8.0 * near - wide) / (12.0 * period)
    return out


def samples(source: MotionSource, recipe: MotionFilter, basis: Basis) -> Iterator[Samples]:
    """The decimated samples of every stretch, block by block, in the order of time."""
    recipe.check(source.period)
    for stretch in source.stretches:
        yield from _of_stretch(source, stretch, recipe, basis)


def _of_stretch(
    source: MotionSource, stretch: UnbrokenRows, recipe: MotionFilter, basis: Basis
) -> Iterator[Samples]:
    period, n = source.period, recipe.decimation
    latest = max(abs(lag) for lag in (basis.lag, basis.instrument_lag, *basis.tried_lags, 0.0))
    edge, reach = recipe.settling(period), recipe.reach(period) + math.ceil(latest / period)
    if stretch.rows < 2 * edge + 4 * n + 8:
        return
    origin = source.stamp(stretch.start)
    end = round((source.stamp(stretch.stop - 1) - origin) / period)
    for begin in range(stretch.start, stretch.stop, BLOCK_ROWS):
        stop = min(begin + BLOCK_ROWS, stretch.stop)
        first, last = max(begin - reach, stretch.start), min(stop + reach, stretch.stop)
        offset = first - stretch.start if source.is_even else None
        even = _even(source.read(first, last), origin, period, offset, basis)
        # A block owns the even instants from its first row up to the first row of the next block.
        low = max(_instant(source, stretch, begin), edge)
        high = end - edge if stop == stretch.stop else _instant(source, stretch, stop)
        wanted = np.arange(-(-low // n) * n, min(high, end - edge), n) - even.first
        wanted = wanted[(wanted >= n - 1) & (wanted < len(even.time) - n + 1)]
        if len(wanted):
            yield _decimated(even, wanted, recipe, basis, period)


def _instant(source: MotionSource, stretch: UnbrokenRows, row: int) -> int:
    """The first even instant, counted from the start of the stretch, that is not before a row."""
    if source.is_even:
        return row - stretch.start
    return math.ceil((source.stamp(row) - source.stamp(stretch.start)) / source.period - 1e-6)


def _even(
    block: MotionBlock, origin: float, period: float, offset: int | None, basis: Basis
) -> _Even:
    """The block on an even axis; left alone where it is on one already and nothing is late."""
    time = block.time
    motion = block.place
    if motion is None:
        raise IdentificationError("has neither position nor speed", where="motion")
    if offset is None:
        first = math.ceil((float(time[0]) - origin) / period - 1e-6)
        stop = math.floor((float(time[-1]) - origin) / period + 1e-6) + 1
        axis = np.asarray(origin + period * np.arange(first, stop), dtype=np.float64)
    else:
        first, axis = offset, time

    def at(values: Array, lag: float = 0.0) -> Array:
        is_there = offset is not None and lag == 0.0
        return values if is_there else np.interp(axis + lag, time, values)

    even = np.interp(axis, time[::2], motion[::2])
    odd = np.interp(axis, time[1::2], motion[1::2])
    return _Even(
        time=axis,
        first=first,
        is_position=block.position is not None,
        motion=at(motion),
        halves=0.5 * (even - odd),
        effort=at(block.effort, basis.lag),
        instrument=None if block.instrument is None else at(block.instrument, basis.instrument_lag),
        tried=tuple(at(block.effort, lag) for lag in basis.tried_lags),
    )


def _decimated(
    even: _Even, wanted: IntArray, recipe: MotionFilter, basis: Basis, period: float
) -> Samples:
    """The columns of the even rows, through the window, at the wanted rows."""
    place, noise = low_pass(np.column_stack([even.motion, even.halves]), recipe, period).T
    speed, noise_speed = place, noise
    if even.is_position:
        speed, noise_speed = slope(place, period), slope(noise, period)
    acceleration = slope(speed, period)
    below = np.abs(speed) < recipe.least_speed
    standing = below
    if recipe.keeps_passages:
        standing = _long_runs(below, 1.0 / (recipe.cutoff_hz * period))
    sign = np.sign(speed) * ~standing
    table = {
        "acceleration": acceleration,
        "speed": speed,
        "sign": sign,
        "one": np.ones_like(speed),
        "speed_size": speed * sign,
        "noise_acceleration": slope(noise_speed, period),
        "noise_speed": noise_speed,
        "jerk": slope(acceleration, period),
        "sign_rate": slope(sign, period),
        "effort_rate": slope(even.effort, period),
        "effort": even.effort,
        "apart_acceleration": _apart(acceleration, recipe, period),
        "apart_speed": _apart(speed, recipe, period),
        **dict(zip(basis.tried_names, even.tried, strict=True)),
    }
    for k in basis.load_orders:
        angle = k * basis.load_turn * place
        table[f"load_sin_{k}"], table[f"load_cos_{k}"] = np.sin(angle), np.cos(angle)
    for name, critical in zip(basis.stribeck_names, basis.stribeck, strict=True):
        ratio = (speed / critical) ** 2
        table[name] = sign * np.exp(-ratio)
        table[f"{name}_slope"] = sign * np.exp(-ratio) * 2.0 * ratio / critical
    if even.instrument is not None:
        guide = low_pass(even.instrument, recipe, period)
        if not basis.instrument_is_speed:
            guide = slope(guide, period)
        table["instrument_speed"] = guide
        table["instrument_acceleration"] = slope(guide, period)
    names = basis.names(even.instrument is not None)
    window = recipe.window()
    span = np.arange(-(len(window) // 2), len(window) // 2 + 1)
    rows = wanted[:, None] + span
    columns = np.stack([table[name][rows] @ window for name in names], axis=1)
    share = standing[rows].astype(np.float64) @ window
    return Samples(even.time[wanted], columns, share > _STANDING_SHARE)


def _apart(values: Array, recipe: MotionFilter, period: float) -> Array:
    """Mean of what lies before and after; at the ends of a stretch of what is nearest to that."""
    away, edge = math.ceil(APART / (recipe.cutoff_hz * period)), recipe.settling(period)
    row, last = np.arange(len(values)), len(values) - 1
    before = np.maximum(row - away, min(edge, last))
    after = np.minimum(row + away, max(last - edge, 0))
    return 0.5 * (values[before] + values[after])


def _long_runs(below: BoolArray, least: float) -> BoolArray:
    """Of rows that are below, those that are so for at least so many rows in a row."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], below.astype(np.int8), [0]])))
    long = np.zeros_like(below)
    for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if stop - start >= least:
            long[start:stop] = True
    return long
