"""SYNC of the simulated rig: when each cycle's values are really latched, and the hardware stamp that says so.

A SYNC comes late or early by a jitter; encoders latch at that instant, and the stamp names it. So
the jitter is harmless to an analysis that uses the stamps and ruinous to one that uses index times
period. The jitter is bounded by a quarter of the period, so that stamps never run backwards. The clock that
stamps runs too fast or too slow by a constant share of its own.
"""

from __future__ import annotations

import numpy as np

from model.arrays import IntArray
from sim_backend.streams import CycleNoise

NANOSECOND = 1e-9


class SyncTimer:
    """The instants of SYNC: nominal period [ns], standard deviation of the jitter [s], start on the
    hardware's clock, and by what share that clock runs too fast.
    """

    def __init__(
        self, cycle_ns: int, jitter: float, seed: int, start_ns: int = 0, *, rate_error: float = 0.0
    ) -> None:
        self.cycle_ns, self.start_ns = cycle_ns, start_ns
        self._jitter, self._rate_error = jitter, rate_error
        self._noise = CycleNoise(seed, "sync jitter")

    def lateness_ns(self, first_cycle: int, cycles: int) -> IntArray:
        """How much later than nominal each SYNC comes [ns] (cycles,)."""
        if self._jitter <= 0.0:
            return np.zeros(cycles, dtype=np.int64)
        limit = 0.25 * self.cycle_ns
        late = self._noise.at(first_cycle, cycles) * (self._jitter / NANOSECOND)
        return np.rint(np.clip(late, -limit, limit)).astype(np.int64)

    def stamps_ns(self, first_cycle: int, lateness_ns: IntArray) -> IntArray:
        """The hardware stamp of each SYNC [ns] (cycles,)."""
        nominal = (
            np.arange(first_cycle, first_cycle + len(lateness_ns), dtype=np.int64) * self.cycle_ns
        )
        passed = nominal + lateness_ns
        return self.start_ns + passed + np.rint(passed * self._rate_error).astype(np.int64)
