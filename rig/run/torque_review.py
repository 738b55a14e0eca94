"""The torque's share of the review: heat of the motor (i2t) and the torque port against what the drive reports."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rig.run.bounds import Watch
from rig.run.trips import OVERLOAD, TORQUE_DISAGREEMENT, Trip

FloatArray = NDArray[np.float64]

HEAT_PIECE = 4096
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
        return (
            {**figures, "slope": common / spread}
            if spread > 9.0 * scatter and spread > 0.0
            else figures
        )


@dataclass(frozen=True, kw_only=True)
class TorqueState:
    """What is carried from block to block: the i2t integral (1 is the rating) and its largest, and
    an open window of the
    comparison: rows, sums of (port - drive)^2, drive^2, port, drive; share of the allowed
    difference; windows in a row.
    """

    heat: float = 0.0
    hottest: float = 0.0
    rows: int = 0
    sums: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    share: float = 0.0
    windows: int = 0
    agreement: Agreement = field(default_factory=Agreement)


Reviewed = tuple[TorqueState, list[Trip], tuple[tuple[str, str], ...]]
"""The state after a block, trips, and what is worth an event (code, text)."""


@dataclass(frozen=True)
class TorqueReview:
    """Reviews the torques of one rig; `rating` is the motor's rated torque [N m], `period` the SYNC period [s]."""

    watch: Watch
    rating: float
    period: float

    def heated(self, state: TorqueState, torque: FloatArray, start: int) -> Reviewed:
        """Mean square of the torque (n,) with one time constant, against the rating."""
        heat = heat_integral(
            state.heat, np.square(torque / self.rating), self.period / self.watch.thermal_time
        )
        hot = np.flatnonzero(heat > 1.0)
        trips = []
        if len(hot):
            row = int(hot[0])
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
            replace(state, heat=float(heat[-1]), hottest=max(state.hottest, float(heat.max()))),
            trips,
            (),
        )

    def compared(
        self, state: TorqueState, port: FloatArray, drive: FloatArray, start: int
    ) -> Reviewed:
        """Port against drive (n,), r.m.s. over a window (an open line hums about zero): first an event, then a trip."""
        if not len(port):
            return state, [], ()
        state = replace(state, agreement=state.agreement.after(port, drive))
        rows = state.rows + len(port)
        terms = (
            float(np.square(port - drive).sum()),
            float(np.square(drive).sum()),
            float(port.sum()),
            float(drive.sum()),
        )
        sums = tuple(before + more for before, more in zip(state.sums, terms, strict=True))
        if rows * self.period < self.watch.torque_difference_window:
            return replace(state, rows=rows, sums=sums), [], ()
        difference, reference = math.sqrt(sums[0] / rows), math.sqrt(sums[1] / rows)
        allowed = self.watch.torque_offset + self.watch.torque_difference * reference
        state = replace(state, rows=0, sums=(0.0, 0.0, 0.0, 0.0), share=difference / allowed)
        if difference <= allowed:
            return replace(state, windows=0), [], ()
        state = replace(state, windows=state.windows + 1)
        detail = f"port {sums[2] / rows:.4g} N m, drive {sums[3] / rows:.4g} N m on average"
        text = f"torque port and drive differ by {difference:.4g} N m r.m.s., allowed {allowed:.4g} N m ({detail})"
        trips = []
        if state.windows >= self.watch.torque_difference_windows:
            trips.append(
                Trip(
                    TORQUE_DISAGREEMENT,
                    start + len(port) - 1,
                    difference,
                    allowed,
                    "N m r.m.s.",
                    detail,
                )
            )
        return state, trips, (("torque-disagreement", text),)


def heat_integral(before: float, load: FloatArray, step: float) -> FloatArray:
    """The i2t integral of each cycle (n,), h[k] = e^-step h[k-1] + (1 - e^-step) load[k], whatever
    the length of the block.
    """
    heat = np.empty(len(load))
    for begin in range(0, len(load), HEAT_PIECE):
        part = load[begin : begin + HEAT_PIECE]
        decay = np.exp(-step * np.arange(1, len(part) + 1))
        heat[begin : begin + len(part)] = decay * (
            before - math.expm1(-step) * np.cumsum(part / decay)
        )
        before = float(heat[begin + len(part) - 1])
    return heat
