"""Brings what the devices of a port tell into the logbook of a run."""

from __future__ import annotations

from drivers.port import LATE_ANSWERS, RigPort
from rig.run.logbook import Logbook


class DeviceListener:
    """Brings what the devices of a port tell into the logbook of a run.

    `latest_error` is in a device's own words, `latest_cause` the cause of a trip that it is; `late_answers`
    says of the latest events how a silence ended, if one did.
    """

    def __init__(self, port: RigPort, logbook: Logbook) -> None:
        self.latest_error = self.latest_cause = self.late_answers = ""
        self._port, self._logbook = port, logbook

    def keep_events(self) -> None:
        """What happened since the last time: emergencies, losses, transitions."""
        self.late_answers = ""
        told = self._port.abilities.events
        for event in told() if told is not None else ():
            if event.code == LATE_ANSWERS:
                self.late_answers = event.text
            if event.level == "error":
                self.latest_error = f"{event.source}: {event.text}"
                self.latest_cause = event.code.replace("-", "_")
            self._logbook.event(event.level, event.code, event.source, event.text, event.time_ns)
