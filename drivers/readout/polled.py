"""The ND 287 as a source: asked again as soon as it has answered, its latest value in every cycle, with its own stamp.

An answer of 17 characters takes 18 ms at 9600 baud, so that a value stands in many cycles. It is latched within the
storage delay after the question: its stamp is the middle of that.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from drivers.channel import Channel
from drivers.clock import Clock
from drivers.errors import DriverError
from drivers.event import Event, Level
from drivers.readout.nd287 import (
    LINE_ERRORS,
    LINE_LENGTH,
    STX,
    Readout,
    ReadoutConfig,
    SerialPort,
    parse_line,
)
from drivers.samples import CycleFlag
from drivers.source import Reading, taken_channel

CHANNEL: Final = "readout_angle"
"""What the readout's value is called: a second opinion, no part of a pair."""
_MS: Final = 1_000_000


@dataclass(frozen=True)
class _Value:
    count: int
    is_valid: bool
    taken_ns: int


class PolledReadout:
    """The readout beside a rig. `connect` opens a port whose `read` does not wait."""

    def __init__(
        self, config: ReadoutConfig, clock: Clock, connect: Callable[[], SerialPort]
    ) -> None:
        self._config, self._clock, self._connect = config, clock, connect
        self._port: SerialPort | None = None
        self._quantum = 0.0
        self._begin()

    def _begin(self) -> None:
        self._asked_ns: int | None = None
        self._sync_ns = 0
        self._line = b""
        self._value: _Value | None = None
        self._is_silent = False
        self._events: list[Event] = []

    @property
    def name(self) -> str:
        """What it is called."""
        return "readout ND 287"

    @property
    def channels(self) -> Sequence[Channel]:
        """Its angle, in counts of the display's last decimal, and when it was taken. Known once it is open."""
        angle = Channel(
            name=CHANNEL,
            unit="rad",
            scale=self._quantum or 1.0,
            long_name="angle by the readout",
            model="ND 287",
            acquired="polled",
        )
        return (angle, taken_channel(angle))

    @property
    def largest_steps(self) -> Sequence[int]:
        """A value may be of any cycle before: nothing is a jump."""
        return (0, 0)

    def open(self, cycle_ns: int) -> Mapping[str, str]:
        """Open the line and read once: what it shows must be an angle. Raises `DriverError`."""
        self._begin()
        self._port = self._connect()
        reader = Readout(self._port, self._clock, self._config)
        told = reader.identification()
        reading = reader.read()
        if reading.unit != "rad" or not reading.quantum > 0.0:
            raise DriverError(
                "the readout shows no angle",
                where=self._config.url,
                value=reading.unit or "no value",
                limit="degrees, degrees-minutes-seconds or radian",
                remedy="Set its display to an angle, and look at its encoder's signal.",
            )
        self._quantum = reading.quantum
        return {"model": told[0].strip(), "answer": "; ".join(line.strip() for line in told)}

    def request(self, cycle: int) -> None:
        """Ask, where nothing is on its way."""
        now = self._sync_ns = self._clock.monotonic_ns()
        if self._asked_ns is not None and now - self._asked_ns < self._config.answer_ms * _MS:
            return
        if self._asked_ns is not None and not self._is_silent:
            self._is_silent = True
            self._tell("warning", "source-silent", "the readout does not answer")
        self._ask(now)

    def collect(self, cycle: int, until_ns: int) -> Reading | None:
        """The latest value and when it was taken; None before the first."""
        self._listen()
        value = self._value
        if value is None:
            return None
        flags = 0 if value.is_valid else int(CycleFlag.SIGNAL_ERROR)
        return Reading((value.count, value.taken_ns - self._sync_ns), flags)

    def events(self) -> list[Event]:
        """What happened since the last call."""
        told, self._events = self._events, []
        return told

    def close(self) -> None:
        """Release the line."""
        if self._port is not None:
            Readout(self._port, self._clock, self._config).close()
            self._port = None

    def _ask(self, now: int) -> None:
        if self._port is None:
            return
        try:
            # Half lines of before are not believed.
            self._port.reset_input_buffer()
            self._port.write(STX)
        except LINE_ERRORS as error:
            self._lose(error)
            return
        self._line, self._asked_ns = b"", now

    def _listen(self) -> None:
        """Take what has come, without waiting; a whole line is a value."""
        if self._port is None or self._asked_ns is None:
            return
        try:
            self._line += self._port.read(LINE_LENGTH - len(self._line))
        except LINE_ERRORS as error:
            self._lose(error)
            return
        if len(self._line) < LINE_LENGTH:
            return
        line, asked, self._asked_ns = self._line, self._asked_ns, None
        try:
            reading = parse_line(line)
        except DriverError as error:
            self._tell("warning", "source-garbage", str(error))
            return
        self._is_silent = False
        taken = asked + round(self._config.storage_delay_ms * _MS / 2.0)
        valid = not reading.is_fault
        before = self._value.count if self._value is not None else 0
        count = round(reading.value / self._quantum) if valid else before
        self._value = _Value(count, valid, taken)

    def _lose(self, error: BaseException) -> None:
        self.close()
        self._tell("error", "source-lost", f"the serial line is gone: {error}")

    def _tell(self, level: Level, code: str, text: str) -> None:
        self._events.append(Event(self._clock.calendar_ns(), level, code, self.name, text))
