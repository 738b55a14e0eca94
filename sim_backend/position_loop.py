"""The position loop of a simulated drive in cyclic synchronous position, the same for every simulated rig.

    speed = u_k + gain (target[k-2] - position[k-1]),   u_k = filtered (target[k] - target[k-1]) / T

The drive is to be at target[k-1] at SYNC k; what it measured one cycle before is held against what it should have been
then. The difference of whole counts is rough, so that drives filter it before it is fed forward.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from drivers.drive_state import FOLLOWS_BIT, STATUSWORD_OF, DriveState
from drivers.port import Mode
from model.units import REVOLUTION

GAIN = 40.0
"""rad/s of speed per rad of following error."""
FRACTION = 1 << 16
"""Parts of a count in which set speeds are kept."""
FILTER = 0.004
"""Time constant of the speed that is fed forward [s]."""


class PositionLoop:
    """Target positions in counts of the encoder become speeds."""

    def __init__(self, counts_per_revolution: int, cycle_ns: int) -> None:
        self._count, self._period = REVOLUTION / counts_per_revolution, cycle_ns * 1e-9
        self._kept = math.exp(-self._period / FILTER)
        self.begin(0)

    def begin(self, target: int) -> None:
        """It stands, and this is where it is to stand."""
        self._before = self._last = target
        self._speed = 0.0
        self.error = 0

    def demand(self, target: int, position: int) -> float:
        """The speed [rad/s] from this SYNC on; both in counts of 32 bits, `position` of one SYNC before."""
        fed = _wrapped(target - self._last) * self._count / self._period
        self._speed = fed + (self._speed - fed) * self._kept
        self.error = _wrapped(self._before - position)
        self._before, self._last = self._last, target
        return self._speed + GAIN * self.error * self._count


class PositionLead:
    """Set speeds become target positions, and these the speeds of the loop: what driver and drive do together.

    Speeds are whole numbers of 1/65536 count per cycle, as `drivers.bus.cia402.positions` has them.
    """

    def __init__(self, counts_per_revolution: int, cycle_ns: int) -> None:
        self.scale = REVOLUTION / counts_per_revolution / FRACTION / (cycle_ns * 1e-9)
        self._loop = PositionLoop(counts_per_revolution, cycle_ns)
        self._fine = 0
        self.leads = self._is_chosen = False

    def begin(self, position: int) -> None:
        """The first target is where it stands [counts]."""
        self._fine, self.leads = position * FRACTION, True
        self._loop.begin(position)

    def show(self, statuswords: NDArray[np.int64], mode: Mode) -> None:
        """Add to statuswords (n,) of a block in this mode that the target is followed, where it is."""
        if mode in (Mode.SPEED, Mode.TORQUE):
            self._is_chosen = mode is Mode.SPEED
        if self._is_chosen:
            statuswords[statuswords == STATUSWORD_OF[DriveState.ENABLED]] |= FOLLOWS_BIT

    def demand(self, speed: int, position: int) -> float:
        """The speed [rad/s] from this SYNC on, by the position of one SYNC before."""
        self._fine += speed
        return self._loop.demand((self._fine + FRACTION // 2) // FRACTION, position)


def _wrapped(difference: int) -> int:
    return (difference + 2**31) % 2**32 - 2**31
