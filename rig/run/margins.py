"""How near a run came to each limit: the peak of every quantity that is watched, and what was left of its limit."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drivers.channel import (
    DRIVE_TORQUE,
    HOUSING_TEMPERATURE,
    INPUT_ANGLE,
    OUTPUT_ANGLE,
    TORQUE,
    Channel,
)
from drivers.port import Bound
from drivers.samples import SampleBlock
from model.units import RPM
from rig.bench import limits as lim
from rig.bench.limits import Limits
from rig.run.bounds import Geometry, Watch
from rig.run.trips import OVER_SPEED_OUTPUT, TORSION_TORQUE

OUTPUT_SPEED = "output_speed"
TRAVEL = "travel"
FOLLOWING = "following_error"
MISSED = "missed_cycles"
STALE = "stale_data"
DIFFERENCE = "torque_difference"
"""What is watched besides the limited quantities: input speed as the output encoder sees it
[rad/s], share of the travel's room, time beyond the tolerance of the speed [s], share of cycles
missed in a window, incomplete cycles in a row, share of
the difference that torque port and drive may have."""


WORDS: Mapping[str, tuple[str, str, float]] = {
    OUTPUT_SPEED: ("speed by output encoder", "r/min", RPM),
    TRAVEL: ("travel", "%", 0.01),
    FOLLOWING: ("time off set-point", "s", 1.0),
    MISSED: ("missed cycles", "%", 0.01),
    STALE: ("stale cycles in a row", "cycles", 1.0),
    DIFFERENCE: ("torque port against drive", "%", 0.01),
}
"""Name, unit and factor from SI of what is watched besides the limited quantities."""
_SI_UNITS: Mapping[str, str] = {
    **lim.UNITS,
    OUTPUT_SPEED: "rad/s",
    FOLLOWING: "s",
    **dict.fromkeys((TRAVEL, MISSED, STALE, DIFFERENCE), "1"),
}
"""The unit of every margin as programs get it."""


def worded(quantity: str) -> tuple[str, str, float]:
    """Name, unit and factor from SI of any watched quantity, for people."""
    if quantity in WORDS:
        return WORDS[quantity]
    unit = lim.UNITS.get(quantity, "")
    name = quantity.replace("_", " ")
    return (name, "r/min", RPM) if unit == "rad/s" else (name, {"degC": "°C"}.get(unit, unit), 1.0)


def number(value: float) -> str:
    """Three digits, or all those before the point."""
    return f"{value:.0f}" if abs(value) >= 99.95 else f"{value:#.3g}"


def with_units(margins: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float | str]]:
    """The margins of a run with the SI unit of each, as `rig run --json` prints them."""
    return {name: {**margin, "unit": _SI_UNITS[name]} for name, margin in margins.items()}


@dataclass(frozen=True)
class Peaks:
    """The largest of everything so far, with the counts and time stamps (n, 2) that lagged
    quantities need. Immutable.
    """

    values: Mapping[str, float] = field(default_factory=dict[str, float])
    input_tail: NDArray[np.int64] = field(default_factory=lambda: np.empty((0, 2), dtype=np.int64))
    output_tail: NDArray[np.int64] = field(default_factory=lambda: np.empty((0, 2), dtype=np.int64))
    stale_run: int = 0

    def with_values(self, larger: Mapping[str, float]) -> Peaks:
        """The same with larger values taken in."""
        values = {**self.values}
        for name, value in larger.items():
            values[name] = max(values.get(name, 0.0), value)
        return Peaks(values, self.input_tail, self.output_tail, self.stale_run)


@dataclass(frozen=True, kw_only=True)
class MarginWatch:
    """Looks for peaks in the blocks of one rig. `bounds` are those of the guard, for the limits
    that they really have.
    """

    channels: Mapping[str, Channel]
    column: Mapping[str, int]
    period: float
    limits: Limits
    watch: Watch
    geometry: Geometry | None
    bounds: tuple[Bound, ...]

    def after(self, peaks: Peaks, block: SampleBlock) -> Peaks:
        """The peaks after a block."""
        values: dict[str, float] = {}
        before = peaks.input_tail[:, 0]
        inner, fastest = self._speed(INPUT_ANGLE, self.watch.speed_window, peaks.input_tail, block)
        outer, output = peaks.output_tail, None
        if self.geometry is not None:
            outer, output = self._speed(
                OUTPUT_ANGLE, self.watch.output_speed_window, peaks.output_tail, block
            )
        if fastest is not None:
            values[lim.INPUT_SPEED] = fastest
        if output is not None and self.geometry is not None:
            values[OUTPUT_SPEED] = output * self.geometry.ratio
        if len(block.complete_counts):
            values.update(self._values(block.complete_counts))
            values.update(self._torsion(block.complete_counts, before))
        run, longest = _runs(~block.complete, peaks.stale_run)
        values[STALE] = float(longest)
        return Peaks(peaks.values, inner, outer, run).with_values(values)

    def _speed(
        self, name: str, window: float, tail: NDArray[np.int64], block: SampleBlock
    ) -> tuple[NDArray[np.int64], float | None]:
        """Counts and times to carry on, and the largest speed over the window [rad/s]; what was
        not received moves nothing.

        A SYNC that came late has left the shaft more time: that between the SYNCs, the nominal one at least.
        """
        lag = max(1, round(window / self.period))
        moved = np.column_stack([block.counts[:, self.column[name]], block.interval_ns])
        lost = np.flatnonzero(~block.complete)
        moved = moved[lost[-1] + 1 :] if len(lost) else np.concatenate([tail, moved])
        if len(moved) <= lag:
            return moved, None
        step, elapsed = np.abs(moved[lag:] - moved[:-lag]).T
        fastest = float((step / np.maximum(elapsed * 1e-9, lag * self.period)).max())
        return moved[-lag:], fastest * self.channels[name].scale

    def _values(self, counts: NDArray[np.int64]) -> dict[str, float]:
        values: dict[str, float] = {}
        torque = TORQUE if TORQUE in self.column else DRIVE_TORQUE
        if torque in self.column:
            values[lim.MOTOR_TORQUE] = float(
                np.abs(self.channels[torque].to_si(counts[:, self.column[torque]])).max()
            )
        if HOUSING_TEMPERATURE in self.column:
            heat = self.channels[HOUSING_TEMPERATURE].to_si(
                counts[:, self.column[HOUSING_TEMPERATURE]]
            )
            values[lim.HOUSING_TEMPERATURE] = float(heat.max())
        for bound in self.bounds:
            if bound.cause == TRAVEL:
                middle, half = 0.5 * (bound.low + bound.high), 0.5 * (bound.high - bound.low)
                total = self._total(bound, counts)
                values[TRAVEL] = float(np.abs(total - middle).max()) / half
        return values

    def _torsion(
        self, rows: NDArray[np.int64], before: NDArray[np.int64]
    ) -> Iterator[tuple[str, float]]:
        """The largest torsion torque [N m] of complete cycles, less what the guard allows for the skew of the
        encoders; `before` are the input's counts in the last complete cycles before them.
        """
        for bound in self.bounds:
            if bound.cause != TORSION_TORQUE:
                continue
            turned = np.concatenate([before, rows[:, self.column[INPUT_ANGLE]]])
            lag = min(bound.allowance_lag, len(turned) - 1)
            moved = np.zeros(len(turned))
            moved[lag:] = turned[lag:] - turned[: len(turned) - lag]
            beyond = np.abs(self._total(bound, rows))
            beyond -= np.abs(bound.allowance[INPUT_ANGLE] * moved[len(before) :])
            yield lim.TORSION_TORQUE, max(0.0, float(beyond.max()))

    def _total(self, bound: Bound, counts: NDArray[np.int64]) -> NDArray[np.float64]:
        total = np.full(len(counts), bound.offset)
        for name, weight in bound.weights.items():
            total += weight * counts[:, self.column[name]]
        return total

    def report(self, peaks: Peaks, following_patience: float) -> dict[str, dict[str, float]]:
        """Peak, limit and what was left of it (share) for every quantity that was watched."""
        values: dict[str, dict[str, float]] = {}
        own = {
            FOLLOWING: following_patience,
            MISSED: self.watch.missed_share,
            STALE: float(self.watch.stale_cycles),
            DIFFERENCE: 1.0,
            TRAVEL: 1.0,
        }
        for name, peak in sorted(peaks.values.items()):
            limit = own[name] if name in own else self._limit(name)
            if math.isfinite(limit) and limit > 0.0:
                values[name] = {"peak": peak, "limit": limit, "margin": 1.0 - peak / limit}
        return values

    def _limit(self, name: str) -> float:
        cause = {OUTPUT_SPEED: OVER_SPEED_OUTPUT, lim.TORSION_TORQUE: TORSION_TORQUE}.get(name)
        if cause is None:
            return self.limits.value(name)
        bound = next((b for b in self.bounds if b.cause == cause), None)
        return math.inf if bound is None else bound.high


def _runs(raised: NDArray[np.bool_], before: int) -> tuple[int, int]:
    """The run of raised cycles at the end of a block, and the longest in it; `before` is the one it began with."""
    if not raised.any():
        return 0, 0
    clear = np.flatnonzero(~raised)
    if not len(clear):
        return before + len(raised), before + len(raised)
    edges = np.concatenate([[-1 - before], clear, [len(raised)]])
    lengths = np.diff(edges) - 1
    return int(lengths[-1]), int(lengths.max())
