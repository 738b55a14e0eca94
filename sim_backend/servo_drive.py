"""The virtual servo drive: CiA 402 states, set-points and limits as its objects hold them, in counts.

0x60FF target velocity   0.001 r/min per count (I32)        0x6080 speed limit          1 r/min per count
0x6071 target torque     0.1 % of rated torque (I16)        0x6072 torque limit         0.1 % of rated torque
                                                            0x6083-5 ramps              1 (r/min)/s per count

Enabling takes no cycle: the states up to "operation enabled" are walked between two SYNCs, as a
driver does by SDO, so that the first set-point acts at its own SYNC. Leaving it is one transition
per SYNC, with the controlword of that cycle. Quick stop ramps down by the drive's own deceleration
and then holds ("quick stop active", option code 6) until the servo is switched off or enabled
again. Limits are rounded down: never above what was asked.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drivers.drive_state import STATUSWORD_OF, DriveState
from drivers.errors import DriverError
from drivers.port import DriveLimits, Mode
from model import closed_loop
from model.arrays import FloatArray, IntArray
from model.motor import ServoMotor
from model.units import RPM

SPEED_COUNT = 1e-3 * RPM
"""rad/s per count of the target velocity."""
TORQUE_COUNT_OF_RATED = 1e-3
"""Share of the rated torque per count of target, limit and actual torque."""

_CAN_BE_ENABLED = frozenset(
    {DriveState.SWITCH_ON_DISABLED, DriveState.READY, DriveState.SWITCHED_ON, DriveState.QUICK_STOP}
)
_LOOP_MODE = {Mode.SPEED: closed_loop.SPEED, Mode.TORQUE: closed_loop.TORQUE}
_FAULTED = frozenset({DriveState.FAULT, DriveState.FAULT_REACTION})


@dataclass(frozen=True)
class CycleRun:
    """Consecutive cycles [start, stop) of a block with one state: statusword latched, and what the loop is told."""

    start: int
    stop: int
    statusword: int
    loop_mode: int


class ServoDrive:
    """State machine and registers of the drive; `state` is all that changes from cycle to cycle."""

    def __init__(self, motor: ServoMotor) -> None:
        self._motor = motor
        self.state = DriveState.SWITCH_ON_DISABLED
        self.torque_count = TORQUE_COUNT_OF_RATED * motor.rated_torque
        self.limits = self.stored(
            DriveLimits(motor.peak_torque, motor.maximum_speed, 1e5, 1e5, 1e5)
        )

    def stored(self, limits: DriveLimits) -> DriveLimits:
        """What the registers hold after these limits [SI] were written: rounded down, within the
        motor's own ratings.
        """
        for name in ("torque", "speed", "acceleration", "deceleration", "quick_stop_deceleration"):
            value = getattr(limits, name)
            if not (math.isfinite(value) and value > 0.0):
                raise DriverError(
                    "a limit of the drive must be a positive number",
                    where=f"drive limits, {name}",
                    value=value,
                    limit="> 0",
                    remedy="Derive the limits from the gear's ratings.",
                )
        return DriveLimits(
            torque=_down(min(limits.torque, self._motor.peak_torque), self.torque_count),
            speed=_down(min(limits.speed, self._motor.maximum_speed), RPM),
            acceleration=_down(limits.acceleration, RPM),
            deceleration=_down(limits.deceleration, RPM),
            quick_stop_deceleration=_down(limits.quick_stop_deceleration, RPM),
        )

    def quantised(self, mode: Mode, target: FloatArray) -> IntArray:
        """Set-points [SI] as the drive receives them, in counts of the mode's object."""
        count = SPEED_COUNT if mode is Mode.SPEED else self.torque_count
        limit = 2**31 - 1 if mode is Mode.SPEED else 2**15 - 1
        if not np.all(np.isfinite(target)) or np.any(np.abs(target) > limit * count):
            raise DriverError(
                "a set-point is not a number that the drive's object can hold",
                where=mode.value,
                value=float(target[np.argmax(~(np.abs(target) <= limit * count))]),
                limit=f"within {limit * count:.6g}",
            )
        return np.rint(target / count).astype(np.int64)

    def stretches(self, mode: Mode, cycles: int) -> Iterator[CycleRun]:
        """Walk the state machine over a block: the statusword latched at each SYNC, then one transition."""
        if mode in _LOOP_MODE and self.state in _CAN_BE_ENABLED:
            self.state = DriveState.ENABLED
        done = 0
        while done < cycles:
            latched, self.state = self.state, self._after(mode)
            stop = done + 1
            if self._after(mode) is self.state and latched is self.state:
                stop = cycles
            yield CycleRun(done, stop, STATUSWORD_OF[latched], self._loop_mode(mode))
            done = stop

    def trip(self) -> None:
        """A device fault: the power stage goes off at once, the fault is reported from the next SYNC on."""
        if self.state not in _FAULTED:
            self.state = DriveState.FAULT_REACTION

    def reset_fault(self) -> None:
        """Leave FAULT by the rising edge of controlword bit 7."""
        if self.state in _FAULTED:
            self.state = DriveState.SWITCH_ON_DISABLED

    def _after(self, mode: Mode) -> DriveState:
        """The state after one more cycle with this command."""
        if self.state in _FAULTED:
            return DriveState.FAULT
        if mode is Mode.OFF:
            return DriveState.SWITCH_ON_DISABLED
        if mode is Mode.QUICK_STOP:
            powered = self.state in (DriveState.ENABLED, DriveState.QUICK_STOP)
            return DriveState.QUICK_STOP if powered else DriveState.SWITCH_ON_DISABLED
        return self.state

    def _loop_mode(self, mode: Mode) -> int:
        if self.state is DriveState.QUICK_STOP:
            return closed_loop.QUICK_STOP
        if self.state is DriveState.ENABLED:
            return _LOOP_MODE[mode]
        return closed_loop.OFF


def _down(value: float, count: float) -> float:
    """The largest whole number of counts not above the value; values that are whole counts stay."""
    return math.floor(value / count + 1e-6) * count
