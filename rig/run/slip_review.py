"""The slip's share of the review: input and output that have gone apart by less than the guard sees, and stay so.

Slip is twist, against the position at the start and over a window, that neither the torque nor the
kinematic error of a gear `_SLIP_ROOM` times worse than its catalogue nor the encoders account for.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.channel import DRIVE_TORQUE, INPUT_ANGLE, OUTPUT_ANGLE, TORQUE, Channel
from drivers.samples import SampleBlock
from experiments.assumed import half_width_of
from model.units import ARCMIN
from rig.run.bounds import Geometry, Watch
from rig.run.trips import SLIP, Trip

FloatArray = NDArray[np.float64]

_SLIP_ROOM = 3.0
"""Times its kinematic error that a gear may twist without slipping: a bad gear is measured, not tripped."""
_SOFTEST = 0.5
"""Share of its stiffest torsion spring that a gear has at small torques (K1 over K3 of the catalogues)."""


@dataclass(frozen=True)
class SlipState:
    """What is carried from block to block: the window (cycles, sums of twist [rad] and torque [N m], input angle [rad]
    at its begin), windows beyond the limit in a row, and between which two skews of the encoders [s] the run so far
    leaves room (None: whatever the watch allows).
    """

    rows: int = 0
    sums: tuple[float, float] = (0.0, 0.0)
    begin: float | None = None
    windows: int = 0
    skew: tuple[float, float] | None = None


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
        good = block.complete_counts
        if not len(good):
            return state, []
        inner = self._turned(INPUT_ANGLE, good)
        twist = inner / geometry.ratio
        twist -= geometry.output_sense * self._turned(OUTPUT_ANGLE, good)
        pull = np.abs(self.channels[torque].to_si(good[:, self.column[torque]]))
        rows = state.rows + len(good)
        sums = (state.sums[0] + float(twist.sum()), state.sums[1] + float(pull.sum()))
        begin = float(inner[0]) if state.begin is None else state.begin
        if rows * self.period < self.watch.slip_window:
            return replace(state, rows=rows, sums=sums, begin=begin), []
        value, carried = sums[0] / rows, geometry.ratio * sums[1] / rows
        allowed = self._allowed(geometry) + carried / (_SOFTEST * geometry.stiffness)
        speed = (float(inner[-1]) - begin) / (rows * self.period * geometry.ratio)
        before = state.skew or (-self.watch.encoder_skew, self.watch.encoder_skew)
        skew = _skew_left(before, speed, value, allowed)
        windows = 0 if skew else state.windows + 1
        state = SlipState(windows=windows, skew=skew or before)
        if windows < self.watch.slip_windows:
            return state, []
        allowed += max(math.copysign(1.0, value) * speed * end for end in before)
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
        doubt = 2.0 * half_width_of(outer) + outer.scale
        doubt += (2.0 * half_width_of(inner) + inner.scale) / geometry.ratio
        return _SLIP_ROOM * geometry.free_angle + doubt


def _skew_left(
    skew: tuple[float, float], speed: float, twist: float, allowed: float
) -> tuple[float, float] | None:
    """The skews [s] of those so far that account for this twist [rad] at this output speed [rad/s]; None: none does.

    Encoders that are latched at different times read the way between as twist. The skew is the bench's and does not
    change: what a window leaves open, a slip in a later one may not use.
    """
    ends = sorted((speed * skew[0], speed * skew[1]))
    if twist < ends[0] - allowed or twist > ends[1] + allowed:
        return None
    if speed == 0.0:
        return skew
    least, most = sorted(((twist - allowed) / speed, (twist + allowed) / speed))
    return max(skew[0], least), min(skew[1], most)
