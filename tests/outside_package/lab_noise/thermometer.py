"""A thermometer that writes a line a second, "21.50", on a serial line: the room's temperature beside every run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from pydantic import Field

from harmonic_rig.sources import (
    Channel,
    Clock,
    DriverError,
    Event,
    Reading,
    Shafts,
    SourceDescription,
    SourceKind,
    taken_channel,
)

DEGREES = 0.01
"""Degrees Celsius of a count."""


class Line(Protocol):
    """The serial line; `read` gives what is there and does not wait."""

    def read(self, size: int) -> bytes: ...

    def close(self) -> None: ...


class Described(SourceDescription):
    """What `rig.toml` says of it: where its line is."""

    channel: str = "ambient_temperature"
    url: str = Field(min_length=1)

    @property
    def place(self) -> str:
        """Where it is reached."""
        return self.url


class Thermometer:
    """The source: its latest line stands in every cycle, with the time at which it came."""

    name = "laboratory thermometer"
    largest_steps: Sequence[int] = (0, 0)

    def __init__(self, clock: Clock, connect: Callable[[], Line]) -> None:
        self._clock, self._connect = clock, connect
        self._line: Line | None = None
        self._bytes = b""
        self._latest: tuple[int, int] | None = None
        self._sync_ns = 0
        self._told: list[Event] = []
        room = Channel(name="ambient_temperature", unit="degC", scale=DEGREES, acquired="polled")
        self.channels: Sequence[Channel] = (room, taken_channel(room))

    def open(self, cycle_ns: int) -> Mapping[str, str]:
        """Open the line. Raises `DriverError`."""
        try:
            self._line = self._connect()
        except OSError as error:
            raise DriverError("cannot be opened", where=self.name, value=str(error)) from error
        return {"model": "laboratory thermometer"}

    def request(self, cycle: int) -> None:
        """It writes by itself: only the time of the SYNC is kept."""
        self._sync_ns = self._clock.monotonic_ns()

    def collect(self, cycle: int, until_ns: int) -> Reading | None:
        """The latest temperature; None before the first."""
        try:
            self._bytes += self._line.read(64) if self._line else b""
        except OSError as error:
            self._line = None
            self._tell("source-lost", str(error))
        *lines, self._bytes = self._bytes.split(b"\n")
        for line in lines:
            try:
                self._latest = (round(float(line) / DEGREES), self._clock.monotonic_ns())
            except ValueError:
                self._tell("source-garbage", repr(line[:20]))
        if self._latest is None:
            return None
        count, at = self._latest
        return Reading((count, at - self._sync_ns))

    def events(self) -> list[Event]:
        """What happened since the last call."""
        told, self._told = self._told, []
        return told

    def close(self) -> None:
        """Let go of the line."""
        line, self._line = self._line, None
        if line is not None:
            line.close()

    def _tell(self, code: str, text: str) -> None:
        self._told.append(Event(self._clock.monotonic_ns(), "warning", code, self.name, text))


def make(described: Any, shafts: Shafts, clock: Clock) -> Thermometer:
    """The driver of what `rig.toml` describes; nothing is opened yet."""
    from serial import serial_for_url

    return Thermometer(clock, lambda: serial_for_url(described.url, timeout=0))


KIND = SourceKind(Described, make)
