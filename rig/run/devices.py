"""Brings what the devices of a port tell into the logbook of a run."""

from __future__ import annotations

from drivers.port import RigPort, TellsEvents
from rig.run.logbook import Logbook


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
