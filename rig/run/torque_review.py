"""The torque's share of the review: heat of the motor (i2t) and the torque port against what the drive reports."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from drivers.counting import changes
from rig.run.bounds import Watch
from rig.run.trips import OVERLOAD, TORQUE_DISAGREEMENT, TORQUE_FROZEN, TORQUE_ZERO, Trip

FloatArray = NDArray[np.float64]

_HEAT_PIECE = 4096
"""Cycles of the heat integral at a time, so that its powers stay numbers."""


@dataclass(frozen=True)
class Agreement:
    """Torque port against what the drive reports, over the complete cycles of a run: so many of
    them, their sums of port, drive,
    drive^2, port drive, port^2, and the largest difference."""

    cycles: int = 0
    sums: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)
    worst: float = 0.0

    def after(self, port: FloatArray, drive: FloatArray) -> Agreement:
        """The same with further cycles (n,)."""
        if not len(port):
            return self
        more = (port.sum(), drive.sum(), drive @ drive, port @ drive, port @ port)
        sums = tuple(before + float(term) for before, term in zip(self.sums, more, strict=True))
        return Agreement(
            self.cycles + len(port), sums, max(self.worst, float(np.abs(port - drive).max()))
        )

    def figures(self) -> dict[str, float]:
        """Mean and standard deviation of port - drive, the worst cycle [N m], and the slope of port
        over drive (1 is agreement).

        The slope is left out where the torque varied by less than its own scatter: then only the mean says something.
        """
        n = self.cycles
        if n < 2:
            return {}
        port, drive, squares, products, port_squares = (s / n for s in self.sums)
        spread, common = squares - drive**2, products - port * drive
        scatter = max((port_squares - port**2) - 2.0 * common + spread, 0.0)
        figures = {
            "cycles": float(n),
            "offset": port - drive,
            "scatter": math.sqrt(scatter),
            "worst": self.worst,
        }
        if spread > 9.0 * scatter and spread > 0.0:
            return {**figures, "slope": common / spread}
        return figures


@dataclass(frozen=True, kw_only=True)
class _Still:
    """A stretch of complete cycles in which the torque port stood on one value: which, for how many cycles, the least
    and the largest torque by the drive meanwhile, and for how many cycles they have been too far apart.
    """

    value: float = math.nan
    cycles: int = 0
    low: float = math.inf
    high: float = -math.inf
    changed: int = 0


@dataclass(frozen=True, kw_only=True)
class Window:
    """An open window of port against drive [N m]: so many complete cycles, their sums of (port - drive)^2, drive^2,
    port, drive and (change of drive from cycle to cycle)^2, and the drive's last torque.
    """

    cycles: int = 0
    sums: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)
    last: float = math.nan

    def after(self, port: FloatArray, drive: FloatArray) -> Window:
        """The same with further cycles (n,)."""
        before = drive[0] if math.isnan(self.last) else self.last
        terms = (
            np.square(port - drive).sum(),
            np.square(drive).sum(),
            port.sum(),
            drive.sum(),
            np.square(changes(drive, before)).sum(),
        )
        sums = tuple(so_far + float(term) for so_far, term in zip(self.sums, terms, strict=True))
        return Window(cycles=self.cycles + len(port), sums=sums, last=float(drive[-1]))

    @property
    def difference(self) -> float:
        """Of port and drive, r.m.s."""
        return math.sqrt(self.sums[0] / self.cycles)

    @property
    def drive(self) -> float:
        """R.m.s."""
        return math.sqrt(self.sums[1] / self.cycles)

    @property
    def mean_port(self) -> float:
        return self.sums[2] / self.cycles

    @property
    def mean_drive(self) -> float:
        return self.sums[3] / self.cycles

    def lagging(self, lag: float, period: float) -> float:
        """The largest difference r.m.s. that a port shows whose torque follows the drive's with a time constant of at
        most `lag` [s], cycles of `period` [s].

        At an angular frequency w it is |1 - 1/(1 + i w lag)| <= min(w lag, 1) of the drive's swing there.
        """
        rate = math.sqrt(self.sums[4] / self.cycles) / period
        swing = math.sqrt(max(self.drive**2 - self.mean_drive**2, 0.0))
        return min(lag * rate, swing)


@dataclass(frozen=True, kw_only=True)
class TorqueState:
    """What is carried from block to block: the i2t integral (1 is the rating) and its largest, an open window of the
    comparison, the last one's share of the allowed difference, and windows in a row above it.
    """

    heat: float = 0.0
    hottest: float = 0.0
    window: Window = field(default_factory=Window)
    share: float = 0.0
    windows: int = 0
    zero: float | None = None
    apart: int = 0
    still: _Still = field(default_factory=_Still)
    agreement: Agreement = field(default_factory=Agreement)


_Reviewed = tuple[TorqueState, list[Trip], tuple[tuple[str, str], ...]]
"""The state after a block, trips, and what is worth an event (code, text)."""


@dataclass(frozen=True)
class TorqueReview:
    """Reviews the torques of one rig; `rating` is the motor's rated torque [N m], `period` the SYNC period [s]."""

    watch: Watch
    rating: float
    period: float

    def heated(self, state: TorqueState, torque: FloatArray, start: int) -> _Reviewed:
        """Mean square of the torque (n,) with one time constant, against the rating."""
        heat = heat_integral(
            state.heat, np.square(torque / self.rating), self.period / self.watch.thermal_time
        )
        hottest = float(heat.max())
        trips: list[Trip] = []
        if hottest > 1.0:
            row = int(np.argmax(heat > 1.0))
            trips.append(
                Trip(
                    OVERLOAD,
                    start + row,
                    math.sqrt(heat[row]) * self.rating,
                    self.rating,
                    "N m r.m.s.",
                )
            )
        return (
            replace(state, heat=float(heat[-1]), hottest=max(state.hottest, hottest)),
            trips,
            (),
        )

    def compared(
        self, state: TorqueState, port: FloatArray, drive: FloatArray, start: int
    ) -> _Reviewed:
        """Port against drive (n,), r.m.s. over a window (an open line hums about zero): first an event, then a trip."""
        if not len(port):
            return state, [], ()
        state, trips = self._frozen(state, port, drive, start)
        state = replace(state, agreement=state.agreement.after(port, drive))
        window = state.window.after(port, drive)
        if window.cycles * self.period < self.watch.torque_difference_window:
            return replace(state, window=window), trips, ()
        (found, allowed), share = self._apart(window)
        state = replace(state, window=Window(last=window.last), share=share)
        means = window.mean_port, window.mean_drive
        detail = f"port {means[0]:.4g} N m, drive {means[1]:.4g} N m on average"
        row = start + len(port) - 1
        state, drifted = self._moved_apart(state, *means, row)
        if share <= 1.0:
            return replace(state, windows=0), trips + drifted, ()
        state = replace(state, windows=state.windows + 1)
        text = f"torque port and drive differ by {found:.4g} N m r.m.s., allowed {allowed:.4g} N m ({detail})"
        if state.windows >= self.watch.torque_difference_windows:
            trips.append(Trip(TORQUE_DISAGREEMENT, row, found, allowed, "N m r.m.s.", detail))
        return state, trips + drifted, (("torque-disagreement", text),)

    def _apart(self, window: Window) -> tuple[tuple[float, float], float]:
        """What port and drive differ by over a window and what they may [N m], and the share of that.

        The whole difference may be larger by what a lag makes of a torque that swings; its mean may not.
        """
        allowed = self.watch.torque_offset + self.watch.torque_difference * window.drive
        mean = abs(window.mean_port - window.mean_drive)
        lagging = allowed + window.lagging(self.watch.torque_lag, self.period)
        pairs = (mean, allowed), (window.difference, lagging)
        return max(((pair, pair[0] / pair[1]) for pair in pairs), key=lambda found: found[1])

    def _moved_apart(
        self, state: TorqueState, port: float, drive: float, row: int
    ) -> tuple[TorqueState, list[Trip]]:
        """Mean of the port over a window less that of the drive, against the first window of the run: its zero."""
        if state.zero is None:
            return replace(state, zero=port - drive), []
        moved = port - drive - state.zero
        allowed = self.watch.torque_zero_absolute + self.watch.torque_zero_share * abs(drive)
        state = replace(state, apart=state.apart + 1 if abs(moved) > allowed else 0)
        if state.apart < self.watch.torque_zero_windows:
            return state, []
        detail = f"port {port:.4g} N m, drive {drive:.4g} N m on average"
        limit = math.copysign(allowed, moved)
        return state, [Trip(TORQUE_ZERO, row, moved, limit, "N m", detail)]

    def _frozen(
        self, state: TorqueState, port: FloatArray, drive: FloatArray, start: int
    ) -> tuple[TorqueState, list[Trip]]:
        """A port on one count while the drive's torque (n,) changes: converters have steps, but not such ones."""
        change = self.watch.torque_still_share * self.rating
        least, settled = (
            max(1, round(seconds / self.period))
            for seconds in (self.watch.torque_still_time, self.watch.torque_settling)
        )
        edges = np.concatenate([[0], np.flatnonzero(np.diff(port)) + 1, [len(port)]])
        lengths, still = np.diff(edges), state.still
        if port[0] != still.value:
            still = _Still()
        lengths[0] += still.cycles
        last = still
        trips: list[Trip] = []
        # Only a stretch that is long enough, and the last one, which may become so.
        for i in np.union1d(np.flatnonzero(lengths >= least), [len(lengths) - 1]).tolist():
            before = still if i == 0 else _Still()
            part = drive[edges[i] : edges[i + 1]]
            lows = np.minimum(np.minimum.accumulate(part), before.low)
            highs = np.maximum(np.maximum.accumulate(part), before.high)
            changed = before.changed + np.cumsum(highs - lows > change)
            cycles = before.cycles + np.arange(1, len(part) + 1)
            raised = np.flatnonzero((changed >= settled) & (cycles >= least))
            if len(raised) and not trips:
                row = int(raised[0])
                found, unit = float(highs[row] - lows[row]), "N m by the drive"
                trips.append(Trip(TORQUE_FROZEN, start + int(edges[i]) + row, found, change, unit))
            last = _Still(
                value=float(port[-1]),
                cycles=len(part) + before.cycles,
                low=float(lows[-1]),
                high=float(highs[-1]),
                changed=int(changed[-1]),
            )
        return replace(state, still=last), trips


def heat_integral(before: float, load: FloatArray, step: float) -> FloatArray:
    """The i2t integral of each cycle (n,), h[k] = e^-step h[k-1] + (1 - e^-step) load[k], whatever
    the length of the block.
    """
    heat = np.empty(len(load))
    for begin in range(0, len(load), _HEAT_PIECE):
        part = load[begin : begin + _HEAT_PIECE]
        decay = np.exp(-step * np.arange(1, len(part) + 1))
        heat[begin : begin + len(part)] = decay * (
            before - math.expm1(-step) * np.cumsum(part / decay)
        )
        before = float(heat[begin + len(part) - 1])
    return heat
