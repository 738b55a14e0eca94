"""Brings what the devices of a port tell into the logbook of a run."""

from __future__ import annotations

from drivers.port import RigPort, TellsEvents
from rig.run.logbook import Logbook


class DeviceListener:
    """Brings what the devices of a port tell into the logbook of a run. `told` is the latest error
    in a device's own words.
    """

    def __init__(self, port: RigPort, logbook: Logbook) -> None:
        self.told = ""
        self._port, self._logbook = port, logbook

    def keep_events(self) -> None:
        """What happened since the last time: emergencies, losses, transitions."""
        if isinstance(self._port, TellsEvents):
            for event in self._port.events():
                if event.level == "error":
                    self.told = f"{event.source}: {event.text}"
                self._logbook.event(
                    event.level, event.code, event.source, event.text, event.time_ns
                )
