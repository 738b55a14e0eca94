"""The slip's share of the review: input and output that have gone apart by less than the guard sees, and stay so.

Slip is twist, against the position at the start and over a window, that neither the torque nor the
kinematic error of a gear `SLIP_ROOM` times worse than its catalogue nor the encoders account for.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.channel import DRIVE_TORQUE, INPUT_ANGLE, OUTPUT_ANGLE, TORQUE, Channel
from drivers.samples import CycleFlag, SampleBlock
from model.units import ARCMIN
from rig.run.bounds import Geometry, Watch
from rig.run.trips import SLIP, Trip

FloatArray = NDArray[np.float64]

SLIP_ROOM = 3.0
"""Times its kinematic error that a gear may twist without slipping: a bad gear is measured, not tripped."""
SOFTEST = 0.5
"""Share of its stiffest torsion spring that a gear has at small torques (K1 over K3 of the catalogues)."""


@dataclass(frozen=True)
class SlipState:
    """What is carried from block to block: the window (cycles, sums of twist [rad] and torque [N m]), and windows
    beyond the limit in a row.
    """

    rows: int = 0
    sums: tuple[float, float] = (0.0, 0.0)
    windows: int = 0


@dataclass(frozen=True, kw_only=True)
class SlipReview:
    """Reviews the twist of one rig; `reference` are the counts at the untwisted start, by channel."""

    watch: Watch
    period: float
    channels: Mapping[str, Channel]
    column: Mapping[str, int]
    geometry: Geometry | None
    reference: Mapping[str, int]

    def reviewed(
        self, state: SlipState, block: SampleBlock, start: int
    ) -> tuple[SlipState, list[Trip]]:
        """Mean twist over a window of complete cycles against what torque, gear and encoders account for."""
        geometry, torque = self.geometry, TORQUE if TORQUE in self.column else DRIVE_TORQUE
        if geometry is None or torque not in self.column or not self.reference:
            return state, []
        good = block.counts[(block.flags & CycleFlag.INCOMPLETE) == 0]
        twist = self._turned(INPUT_ANGLE, good) / geometry.ratio
        twist -= geometry.output_sense * self._turned(OUTPUT_ANGLE, good)
        pull = np.abs(self.channels[torque].to_si(good[:, self.column[torque]]))
        rows = state.rows + len(good)
        sums = (state.sums[0] + float(twist.sum()), state.sums[1] + float(pull.sum()))
        if rows * self.period < self.watch.slip_window:
            return replace(state, rows=rows, sums=sums), []
        value, carried = sums[0] / rows, geometry.ratio * sums[1] / rows
        allowed = self._allowed(geometry) + carried / (SOFTEST * geometry.stiffness)
        windows = state.windows + 1 if abs(value) > allowed else 0
        state = replace(state, rows=0, sums=(0.0, 0.0), windows=windows)
        if windows < self.watch.slip_windows:
            return state, []
        limit = math.copysign(allowed, value) / ARCMIN
        row = start + len(block) - 1
        return state, [Trip(SLIP, row, value / ARCMIN, limit, "arcmin at the output")]

    def _turned(self, name: str, counts: NDArray[np.int64]) -> FloatArray:
        channel = self.channels[name]
        turned: FloatArray = (counts[:, self.column[name]] - self.reference[name]).astype(
            np.float64
        )
        return turned * (channel.direction * channel.scale)

    def _allowed(self, geometry: Geometry) -> float:
        """Twist [rad] without any torque: kinematic error, errors and counts of both encoders."""
        inner, outer = self.channels[INPUT_ANGLE], self.channels[OUTPUT_ANGLE]
        doubt = 2.0 * outer.calibration.accuracy + outer.scale
        doubt += (2.0 * inner.calibration.accuracy + inner.scale) / geometry.ratio
        return SLIP_ROOM * geometry.free_angle + doubt
