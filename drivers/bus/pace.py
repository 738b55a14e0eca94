"""The pace of the SYNC: when the next one is due, and how long a cycle that is not complete is waited for."""

from __future__ import annotations

from drivers.acquisition_statistics import AcquisitionStatistics
from drivers.bus.columns import ColumnDecoder
from drivers.bus.frames import CycleStore
from drivers.bus.network import PumpedBus
from drivers.bus.rig_config import CanRigConfig
from drivers.clock import Clock


class Pace:
    """The pace of one opening of a segment."""

    def __init__(
        self,
        config: CanRigConfig,
        clock: Clock,
        store: CycleStore,
        decoder: ColumnDecoder,
        statistics: AcquisitionStatistics,
    ) -> None:
        self._config, self._clock, self._store = config, clock, store
        self._decoder, self._statistics = decoder, statistics
        self.due_ns: int | None = None
        self.is_pause_pending = False

    def pause(self) -> None:
        """No SYNC was due meanwhile: what comes after is neither late nor far from what was before."""
        self._statistics.pause()
        self._decoder.pause()

    def wait_for_turn(self, bus: PumpedBus, *, is_first_row: bool, is_active: bool) -> None:
        """Pump until the next SYNC is due."""
        now = self._clock.monotonic_ns()
        if self.due_ns is None:
            self.due_ns = now
        late = now - self.due_ns
        if late > self._config.cycle_ns // 2:
            stands = not is_active and late > self._config.cycle_ns
            if is_first_row and (self.is_pause_pending or stands):
                self.pause()
            else:
                # A block that is begun late is late like any other cycle.
                self._statistics.overruns += 1
            # No catching up: two SYNCs in quick succession would be a jump of the set-point to the drive.
            self.due_ns = now
        self.is_pause_pending = False
        while self._clock.monotonic_ns() < self.due_ns:
            bus.receive(self.due_ns)
        # What still lies in the queue belongs to earlier cycles and must be paired before a new one begins.
        bus.drain()
        self.due_ns += self._config.cycle_ns

    def patience(self, *, is_first: bool) -> int:
        """How long a frame that is missing is waited for [ns]."""
        if is_first:
            return max(self._config.first_patience_ns, self._config.cycle_ns)
        if self._store.is_silent:
            # It has been waited for in full twice: do not slow everybody else down any more.
            return self._config.cycle_ns
        return round(self._config.patience_cycles * self._config.cycle_ns)

    def collect(self, bus: PumpedBus, sent: int, patience: int) -> None:
        """Pump until the cycle is complete or the patience is over."""
        store, clock = self._store, self._clock
        while not store.has_all and clock.monotonic_ns() < sent + patience:
            bus.receive(sent + patience)
        if store.has_all and store.is_owed:
            settled = sent + round(patience * self._config.settle_factor)
            while store.is_owed and clock.monotonic_ns() < settled:
                bus.receive(settled)
            store.forgive()
