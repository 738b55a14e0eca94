"""What a port may offer beyond exchanging cycles: events of its devices, figures of its
acquisition, a way past the loop.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

from drivers.port import RigPort
from rig.run.logbook import Logbook


class DeviceEvent(Protocol):
    """Something that a device said: time in the base of the samples [ns], level, code, source, text."""

    @property
    def time_ns(self) -> int: ...

    @property
    def level(self) -> str: ...

    @property
    def code(self) -> str: ...

    @property
    def source(self) -> str: ...

    @property
    def text(self) -> str: ...


@runtime_checkable
class TellsEvents(Protocol):
    """A port whose devices tell what happens."""

    def events(self) -> Sequence[DeviceEvent]:
        """What happened since the last call, oldest first."""
        ...


@runtime_checkable
class TellsAcquisition(Protocol):
    """A port that counts how well it kept time."""

    def acquisition(self) -> Any:
        """A dataclass of numbers: achieved rate, jitter, missed cycles."""
        ...


@runtime_checkable
class StopsAlone(Protocol):
    """A port whose drive can be stopped by a few frames from another handle on the bus."""

    def quick_stop_frames(self) -> list[tuple[int, bytes]]:
        """(COB-ID, data) of the frames."""
        ...


class DeviceListener:
    """Brings what the devices of a port tell into the logbook of a run. `latest_error` is in a
    device's own words.
    """

    def __init__(self, port: RigPort, logbook: Logbook) -> None:
        self.latest_error = ""
        self._port, self._logbook = port, logbook

    def keep_events(self) -> None:
        """What happened since the last time: emergencies, losses, transitions."""
        if isinstance(self._port, TellsEvents):
            for event in self._port.events():
                if event.level == "error":
                    self.latest_error = f"{event.source}: {event.text}"
                self._logbook.event(
                    event.level, event.code, event.source, event.text, event.time_ns
                )
