"""The bounds that every cycle of a run is held against: what is linear in the counts, made from the limits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.channel import (
    DRIVE_TORQUE,
    GUARD_CLOSED,
    HOUSING_TEMPERATURE,
    INPUT_ANGLE,
    OUTPUT_ANGLE,
    STATUSWORD,
    TORQUE,
    Channel,
)
from drivers.port import Bound
from experiments.assumed import half_width_of
from rig.bench import limits as lim
from rig.bench.limits import Limits
from rig.run.trips import (
    DRIVE_FAULT,
    GUARD_OPEN,
    OVER_SPEED,
    OVER_SPEED_OUTPUT,
    OVER_TEMPERATURE,
    OVER_TORQUE,
    TORSION_TORQUE,
    TRAVEL,
    UNEXPECTED_STATE,
)

_FAULT_BIT = 0x08
"""Set in "fault" and "fault reaction active", clear in every other state (CiA 402)."""
STATE_MASK, ENABLED = 0x6F, 0x27
"""Bits of the statusword that tell "operation enabled"."""


@dataclass(frozen=True, kw_only=True)
class Watch:
    """How closely the supervisor looks. Times in s, shares of cycles, torques at the motor in N m."""

    speed_window: float = 0.004
    output_speed_window: float = 0.04
    encoder_skew: float = 1e-3
    """How much earlier or later than the input's encoder the output's may be latched: at speed it reads as twist."""
    torque_room: float = 1.15
    torque_offset: float = 0.05
    torque_cycles: int = 3
    stale_cycles: int = 5
    missed_share: float = 0.01
    missed_window: float = 1.0
    following_window: float = 0.05
    following_time: float = 0.3
    following_absolute: float = 1.5
    following_share: float = 0.25
    signal_cycles: int = 3
    torque_port_cycles: int = 20
    host_time_cycles: int = 20
    torque_difference: float = 0.25
    torque_difference_window: float = 0.25
    torque_difference_windows: int = 2
    torque_lag: float = 2e-3
    """Time constant with which the port's torque may follow the drive's: what swings looks different meanwhile."""
    index_repeatability: int = 2
    """Counts by which an index mark may lie elsewhere than before."""
    index_lost_counts: int = 20
    """Counts too many or lost at an index mark, at `index_marks` of them in a row, that are a trip."""
    index_marks: int = 2
    torque_still_time: float = 0.25
    torque_settling: float = 0.05
    """How long the drive's torque must have changed before the port, filtered and averaged, must have followed."""
    torque_still_share: float = 0.05
    """Share of the rated torque by which the drive's torque must change for a port that stands still to be frozen."""
    torque_zero_absolute: float = 0.02
    torque_zero_share: float = 0.15
    torque_zero_windows: int = 2
    creep_speed: tuple[float, float] = (0.5, 5.0)
    """rad/s at a commanded standstill: slower is rest, faster is the following error's."""
    creep_time: float = 0.3
    slip_window: float = 0.1
    slip_windows: int = 2
    still_time: float = 5.0
    """Least time for which a thermometer that trembled must stand on one count to be told of."""
    coldest: float = -20.0
    hottest: float = 150.0
    """degC between which a housing can be; anything else is the sensor's fault."""
    thermal_time: float = 30.0
    smallest_free_space: int = 100_000_000


@dataclass(frozen=True)
class Geometry:
    """What ties both encoders together: ratio, sense of the output encoder, stiffest torsion
    spring, angle that is not torque.
    """

    ratio: float
    output_sense: int
    stiffness: float
    free_angle: float


@dataclass(frozen=True)
class BoundMaker:
    """Makes the bounds of one rig: its channels by name, SYNC period [s], limits, and what is known of its geometry."""

    channels: Mapping[str, Channel]
    period: float
    limits: Limits
    geometry: Geometry | None
    travel: tuple[float, float]
    watch: Watch

    def always(self, reference: NDArray[np.int64]) -> tuple[Bound, ...]:
        """What must hold in every cycle; `reference` are the counts at the untwisted start, in the
        order of the channels.
        """
        counts = dict(zip(self.channels, reference.tolist(), strict=True))
        twist = self.twist(counts)
        bounds = [
            *self.speeds(),
            *self.torques(),
            *self._travels(counts),
            *([twist] if twist is not None else []),
        ]
        if HOUSING_TEMPERATURE in self.channels:
            channel = self.channels[HOUSING_TEMPERATURE]
            weights, high = (
                {channel.name: _weight(channel)},
                self.limits.value(lim.HOUSING_TEMPERATURE),
            )
            bounds.append(
                Bound(
                    cause=OVER_TEMPERATURE,
                    weights=weights,
                    low=self.watch.coldest,
                    high=high,
                    offset=channel.offset,
                    consecutive=10,
                )
            )
        if STATUSWORD in self.channels:
            bounds.append(
                Bound(cause=DRIVE_FAULT, weights={STATUSWORD: 1.0}, high=0.5, mask=_FAULT_BIT)
            )
        return tuple(bounds)

    def enabled(self) -> tuple[Bound, ...]:
        """What must hold while the drive is to be in operation enabled."""
        bounds: list[Bound] = []
        if GUARD_CLOSED in self.channels:
            bounds.append(Bound(cause=GUARD_OPEN, weights={GUARD_CLOSED: 1.0}, low=0.5))
        if STATUSWORD in self.channels:
            bounds.append(
                Bound(
                    cause=UNEXPECTED_STATE,
                    weights={STATUSWORD: 1.0},
                    low=ENABLED - 0.5,
                    high=ENABLED + 0.5,
                    mask=STATE_MASK,
                )
            )
        return tuple(bounds)

    def speeds(self) -> list[Bound]:
        """Input speed by its own encoder, and by the output's, which sees what a failing motor encoder hides."""
        limit = self.limits.value(lim.INPUT_SPEED)
        lag = max(1, round(self.watch.speed_window / self.period))
        weight = self.channels[INPUT_ANGLE].scale / (lag * self.period)
        bounds = [
            Bound(
                cause=OVER_SPEED,
                weights={INPUT_ANGLE: weight},
                low=-limit,
                high=limit,
                lag=lag,
                consecutive=2,
            )
        ]
        if self.geometry is not None:
            lag = max(1, round(self.watch.output_speed_window / self.period))
            weight = self.geometry.ratio * self.channels[OUTPUT_ANGLE].scale / (lag * self.period)
            # Torsional vibration rides on the output's speed: room for it, the input is watched tighter.
            room = 1.3 * limit + 2.0 * weight
            bounds.append(
                Bound(
                    cause=OVER_SPEED_OUTPUT,
                    weights={OUTPUT_ANGLE: weight},
                    low=-room,
                    high=room,
                    lag=lag,
                    consecutive=2,
                )
            )
        return bounds

    def torques(self) -> list[Bound]:
        """Motor torque at the port and as the drive reports it, with room for the port's offset and scale."""
        limit = (
            self.watch.torque_room * self.limits.value(lim.MOTOR_TORQUE) + self.watch.torque_offset
        )
        torques = [self.channels[name] for name in (TORQUE, DRIVE_TORQUE) if name in self.channels]
        cycles = self.watch.torque_cycles
        return [
            Bound(
                cause=OVER_TORQUE,
                weights={c.name: _weight(c)},
                low=-limit,
                high=limit,
                offset=c.offset,
                consecutive=cycles,
            )
            for c in torques
        ]

    def _travels(self, reference: Mapping[str, int]) -> list[Bound]:
        """The input angle from the start [rad]; nothing where the plan has no end to its travel."""
        low, high = self.travel
        if math.isinf(low) and math.isinf(high):
            return []
        weight = _weight(self.channels[INPUT_ANGLE])
        return [
            Bound(
                cause=TRAVEL,
                weights={INPUT_ANGLE: weight},
                low=low,
                high=high,
                offset=-weight * reference[INPUT_ANGLE],
            )
        ]

    def twist(self, reference: Mapping[str, int]) -> Bound | None:
        """K (theta_i/N - theta_o), zero at the reference; the angle that is not torque is taken off the limit.

        What the encoders' skew may make of the speed is allowed for, K skew omega_o: without it a gear that runs
        fast looks strained. A shaft that jams slows down, and with it this allowance goes: a standing gear has none.
        """
        geometry, limit = self.geometry, self.limits.value(lim.TORSION_TORQUE)
        if geometry is None or math.isinf(limit):
            return None
        inner, outer = self.channels[INPUT_ANGLE], self.channels[OUTPUT_ANGLE]
        weights = {
            INPUT_ANGLE: geometry.stiffness * _weight(inner) / geometry.ratio,
            OUTPUT_ANGLE: -geometry.stiffness * geometry.output_sense * _weight(outer),
        }
        doubt = geometry.free_angle + 2.0 * half_width_of(outer) + outer.scale
        doubt += (2.0 * half_width_of(inner) + inner.scale) / geometry.ratio
        high = max(limit - geometry.stiffness * doubt, 0.25 * limit)
        offset = -sum(weight * reference[name] for name, weight in weights.items())
        lag = max(1, round(self.watch.speed_window / self.period))
        skewed = weights[INPUT_ANGLE] * self.watch.encoder_skew / (lag * self.period)
        return Bound(
            cause=TORSION_TORQUE,
            weights=weights,
            low=-high,
            high=high,
            offset=offset,
            allowance={INPUT_ANGLE: skewed},
            allowance_lag=lag,
        )


def _weight(channel: Channel) -> float:
    """SI per count, signed."""
    return channel.direction * channel.scale
