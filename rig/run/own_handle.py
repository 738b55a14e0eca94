"""The watchdog's own handle on the bus: opened once the rig is, because an adapter may allow one handle alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

from drivers.errors import BusLostError


class _SecondBus(Protocol):
    """As much of a bus as is needed to stop a drive."""

    def send(self, msg: Any, /) -> None: ...

    def shutdown(self) -> None: ...


class OwnHandle:
    """Sends the frames that stop the drive, past the loop. `open` once the rig is open, `close` at the end."""

    def __init__(
        self,
        open_bus: Callable[[], _SecondBus],
        frames: Callable[[], Sequence[tuple[int, bytes]]],
        known: str = "",
    ) -> None:
        self.known = known
        """What is known of opening this adapter twice, in words."""
        self._open_bus, self._frames = open_bus, frames
        self._bus: _SecondBus | None = None

    def open(self) -> None:
        """Open the bus for the second time. Raises whatever the adapter's library raises."""
        self._bus = self._open_bus()

    def quick_stop(self) -> None:
        """Stop the drive by process data. Raises `BusLostError` where there is no such handle."""
        if self._bus is None:
            raise BusLostError("the watchdog has no handle on the bus", where="watchdog")
        from drivers.python_can import can

        for cob_id, data in self._frames():
            self._bus.send(can.Message(arbitration_id=cob_id, data=data, is_extended_id=False))

    def close(self) -> None:
        """Release it, if it was opened."""
        bus, self._bus = self._bus, None
        if bus is not None:
            bus.shutdown()
