"""An encoder counter on TCP: one line of text asks, one line answers.

    I                 I model=... serial=... lines=... multiplication=... [simulated=1]
    T <cycle>         T <cycle> <edges> <count> <status>            latched at the latest edge of the trigger line
    P <cycle>         P <cycle> <count> <status> <age in us>        taken when the box read the question

Lines end in LF; numbers are decimal, `status` hexadecimal: bit 0 the signal of the encoder is not valid, bit 1 no edge
of the trigger line was seen since the connection was made. `edges` counts the edges since then. Asked `T`, the box must
hear the SYNC on its trigger line: where the edges do not go on with the cycles, a value belongs to another SYNC, and
its cycle is INCOMPLETE. A count is signed, of 64 bits, and does not wrap.
"""

from __future__ import annotations

import math
import select
import socket
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, Literal, Protocol

from drivers.channel import Calibration, Channel, encoder_channel
from drivers.clock import Clock
from drivers.counting import largest_step
from drivers.errors import BusLostError, DecodeError, DriverError
from drivers.event import Event, Level
from drivers.samples import CycleFlag
from drivers.source import Reading, taken_channel

LONGEST_LINE: Final = 256
"""Bytes of an answer at most."""
_TOLD_AFTER: Final = 3
"""Answers in a row that did not come in time, of which the run file is told."""
_LONGEST_SILENCE: Final = 1000
"""Questions that are remembered until their answer comes."""
_OPENING_NS: Final = 2_000_000_000
"""How long the box may take to say who it is."""
_NOT_VALID, _NO_TRIGGER = 0x1, 0x2


class Line(Protocol):
    """A line of bytes that never waits longer than it is told. A lost one raises `BusLostError`."""

    def send(self, data: bytes) -> None:
        """Send, without waiting for anybody."""
        ...

    def receive(self, until_ns: int) -> bytes:
        """What has come; where there is nothing, wait for it until an instant of the clock at most."""
        ...

    def close(self) -> None:
        """Let go. Never raises."""
        ...


class SocketLine:
    """A connected socket as a line."""

    def __init__(self, connected: socket.socket, clock: Clock) -> None:
        self._socket, self._clock = connected, clock
        connected.setblocking(False)

    def send(self, data: bytes) -> None:
        """Send; a socket that takes nothing has nobody at its other end."""
        try:
            sent = self._socket.send(data)
        except OSError as error:
            raise BusLostError(f"the line is lost: {error}", where="TCP") from error
        if sent != len(data):
            raise BusLostError("nobody takes what is sent", where="TCP", value=f"{sent} bytes")

    def receive(self, until_ns: int) -> bytes:
        """What has come until then at the latest."""
        left = max(until_ns - self._clock.monotonic_ns(), 0) * 1e-9
        if not select.select([self._socket], [], [], left)[0]:
            return b""
        try:
            data = self._socket.recv(4096)
        except OSError as error:
            raise BusLostError(f"the line is lost: {error}", where="TCP") from error
        if not data:
            raise BusLostError("the other end has closed the line", where="TCP")
        return data

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def connect(host: str, port: int, clock: Clock, patience: float = 2.0) -> SocketLine:
    """A line to a box. Raises `BusLostError` where nobody answers within `patience` [s]."""
    try:
        connected = socket.create_connection((host, port), timeout=patience)
    except OSError as error:
        raise BusLostError(
            f"nobody answers: {error}",
            where=f"{host}:{port}",
            remedy="Is the box powered, and are its address and port those of the file?",
        ) from error
    connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return SocketLine(connected, clock)


@dataclass(frozen=True, kw_only=True)
class CounterBoxConfig:
    """What the box counts, and how: `latched_by` the trigger line, or the question itself ("request": polled).

    `largest_speed` of its shaft [rad/s] bounds the counts of one cycle.
    """

    channel: str
    lines: int
    multiplication: int
    direction: int = 1
    latched_by: Literal["trigger", "request"] = "trigger"
    largest_speed: float
    model: str = ""
    serial_number: str = ""
    calibration: Calibration = field(default_factory=Calibration)

    def __post_init__(self) -> None:
        if not 0.0 < self.largest_speed < math.inf:
            raise DriverError(
                "the greatest speed of the shaft must be known: jumps of the counts are told by it",
                where=f"counter box, {self.channel}",
                value=self.largest_speed,
                limit="> 0 rad/s",
            )

    @property
    def angle(self) -> Channel:
        """The counted angle."""
        channel = encoder_channel(
            self.channel,
            lines=self.lines,
            multiplication=self.multiplication,
            direction=self.direction,
            model=self.model,
            serial_number=self.serial_number,
            calibration=self.calibration,
        )
        return replace(channel, acquired="latched" if self.is_triggered else "polled")

    @property
    def is_triggered(self) -> bool:
        """Whether the trigger line latches, at the SYNC."""
        return self.latched_by == "trigger"


@dataclass(frozen=True)
class _Answer:
    cycle: int
    count: int
    status: int
    edges: int = 0
    age_ns: int = 0
    heard_ns: int = 0


class CounterBox:
    """The box as a source of one angle. `connect` opens its line."""

    def __init__(self, config: CounterBoxConfig, clock: Clock, connect: Callable[[], Line]) -> None:
        self._config, self._clock, self._connect = config, clock, connect
        self._line: Line | None = None
        self._cycle_ns = 0
        self._begin()

    def _begin(self) -> None:
        self._rest = b""
        self._answers: dict[int, _Answer] = {}
        self._asked: dict[int, int] = {}
        self._unanswered = 0
        self._missed: set[int] = set()
        self._ahead: int | None = None
        self._is_paired = True
        self._latest: tuple[_Answer, int] | None = None
        self._events: list[Event] = []

    @property
    def name(self) -> str:
        """What it is called."""
        return f"counter box {self._config.channel}"

    @property
    def channels(self) -> Sequence[Channel]:
        """The angle; where it is polled, when it was taken as well."""
        angle = self._config.angle
        return (angle,) if self._config.is_triggered else (angle, taken_channel(angle))

    @property
    def largest_steps(self) -> Sequence[int]:
        """Counts of one cycle at most; a polled value may be of any cycle before."""
        if not self._config.is_triggered:
            return (0, 0)
        resolution = self._config.lines * self._config.multiplication
        return (largest_step(resolution, self._config.largest_speed, self._cycle_ns),)

    def open(self, cycle_ns: int) -> Mapping[str, str]:
        """Connect, and compare what the box says with what it was described as. Raises `DriverError`."""
        self._cycle_ns = cycle_ns
        self._begin()
        self._line = line = self._connect()
        line.send(b"I\n")
        told = self._identity(line)
        wanted = self._config.lines * self._config.multiplication
        found = _number(told, "lines") * _number(told, "multiplication")
        if found != wanted:
            raise DriverError(
                "the box counts another encoder than the file describes",
                where=self.name,
                value=f"{found} counts per revolution",
                limit=f"{self._config.lines} lines x {self._config.multiplication}",
                remedy="Set the box, or correct lines and multiplication.",
            )
        return told

    def _identity(self, line: Line) -> dict[str, str]:
        until = self._clock.monotonic_ns() + _OPENING_NS
        said = b""
        while b"\n" not in said:
            before = self._clock.monotonic_ns()
            said += line.receive(until)
            if before >= until or len(said) > LONGEST_LINE:
                raise DecodeError(
                    "the box does not say who it is", where=self.name, value=said[:40] or "nothing"
                )
        words = said.partition(b"\n")[0].decode("ascii", "replace").split()
        if words[:1] != ["I"]:
            raise DecodeError("this is no counter box", where=self.name, value=said[:40])
        return {key: value for key, _, value in (word.partition("=") for word in words[1:])}

    def request(self, cycle: int) -> None:
        """Ask for the count of this SYNC."""
        if len(self._asked) >= _LONGEST_SILENCE:
            self._asked.clear()
        self._asked[cycle] = self._clock.monotonic_ns()
        letter = "T" if self._config.is_triggered else "P"
        self._say(f"{letter} {cycle}\n".encode("ascii"))

    def collect(self, cycle: int, until_ns: int) -> Reading | None:
        """The count of this SYNC; polled: the latest one, and when it was taken."""
        self._listen(0)
        while cycle not in self._answers and self._clock.monotonic_ns() < until_ns:
            if self._line is None:
                break
            self._listen(until_ns)
        came, self._answers = self._answers, {}
        answer = came.pop(cycle, None)
        # Of SYNCs between two blocks nobody collects the answers: those are not late.
        late = self._missed.intersection(came)
        self._missed -= late
        self._count_silence(cycle, answer is not None)
        if not self._config.is_triggered:
            return self._polled(cycle, answer or next(iter(came.values()), None))
        if answer is None or not self._is_of_this_sync(answer):
            return None
        return Reading((answer.count,), _flags(answer) | (CycleFlag.LATE if late else 0))

    def _count_silence(self, cycle: int, is_answered: bool) -> None:
        self._unanswered = 0 if is_answered else self._unanswered + 1
        if not is_answered:
            self._missed = {one for one in self._missed if one > cycle - _LONGEST_SILENCE} | {cycle}
        if self._unanswered == _TOLD_AFTER:
            self._tell(
                "warning", "source-silent", f"{_TOLD_AFTER} cycles without an answer in time"
            )

    def _is_of_this_sync(self, answer: _Answer) -> bool:
        """Whether the edges went on with the cycles. The first value after the opening says how far they are apart."""
        ahead = answer.edges - answer.cycle
        due = ahead if self._ahead is None else self._ahead
        self._ahead = ahead
        paired = ahead == due and not answer.status & _NO_TRIGGER
        if self._is_paired and not paired:
            seen = f"{answer.edges} edges of the trigger line at SYNC {answer.cycle}"
            self._tell("warning", "source-trigger", f"{seen}, {answer.cycle + due} are due")
        self._is_paired = paired
        return paired

    def _polled(self, cycle: int, answer: _Answer | None) -> Reading | None:
        """The latest value with its own stamp: halfway between question and answer, less the age that the box tells."""
        sync_ns = self._asked[cycle]
        if answer is not None:
            asked = self._asked.get(answer.cycle, answer.heard_ns)
            self._latest = answer, (asked + answer.heard_ns) // 2 - answer.age_ns
            self._asked = {k: at for k, at in self._asked.items() if k > answer.cycle}
        if self._latest is None:
            return None
        latest, taken_ns = self._latest
        return Reading((latest.count, taken_ns - sync_ns), _flags(latest))

    def events(self) -> list[Event]:
        """What happened since the last call."""
        told, self._events = self._events, []
        return told

    def close(self) -> None:
        """Let go of the line."""
        if self._line is not None:
            self._line.close()
            self._line = None

    def _say(self, data: bytes) -> None:
        if self._line is not None:
            try:
                self._line.send(data)
            except BusLostError as error:
                self._lose(error)

    def _listen(self, until_ns: int) -> None:
        """Take what has come; wait for it until then at most."""
        if self._line is None:
            return
        try:
            self._rest += self._line.receive(until_ns)
        except BusLostError as error:
            self._lose(error)
            return
        *lines, self._rest = self._rest.split(b"\n")
        if len(self._rest) > LONGEST_LINE:
            self._rest = b""
        for line in lines:
            self._take(line)

    def _take(self, line: bytes) -> None:
        try:
            answer = _read(line)
        except (ValueError, UnicodeDecodeError):
            self._tell("warning", "source-garbage", f"not understood: {line[:40]!r}")
            return
        self._answers[answer.cycle] = replace(answer, heard_ns=self._clock.monotonic_ns())

    def _lose(self, error: BusLostError) -> None:
        self.close()
        self._tell("error", "source-lost", str(error))

    def _tell(self, level: Level, code: str, text: str) -> None:
        self._events.append(Event(self._clock.calendar_ns(), level, code, self.name, text))


def _flags(answer: _Answer) -> int:
    return int(CycleFlag.SIGNAL_ERROR) if answer.status & _NOT_VALID else 0


def _read(line: bytes) -> _Answer:
    """An answer of the box. Raises `ValueError` for anything else."""
    letter, *numbers = line.decode("ascii").split()
    if letter == "T":
        cycle, edges, count, status = numbers
        return _Answer(int(cycle), int(count), int(status, 16), edges=int(edges))
    if letter == "P":
        cycle, count, status, age = numbers
        return _Answer(int(cycle), int(count), int(status, 16), age_ns=round(float(age) * 1e3))
    raise ValueError(letter)


def _number(told: Mapping[str, str], name: str) -> int:
    text = told.get(name, "")
    return int(text) if text.isascii() and text.isdigit() else 0
