"""A simulated encoder counter on TCP, and the line to it: the other end of `drivers.readout.counter_box`.

The trigger line carries the SYNC: at each of its edges the box latches the output encoder's count.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Protocol

from drivers.clock import Clock
from drivers.errors import BusLostError
from sim_backend.wire.line import WireFault

ANSWER_NS = 60_000
"""How long the box takes for an answer, the network included."""
NOT_VALID, NO_TRIGGER = 0x1, 0x2


class CounterBox:
    """The device: `receive` takes bytes and returns the lines that it answers. `count`: what its encoder shows now."""

    def __init__(self, count: Callable[[], int], counts_per_revolution: int) -> None:
        self._count, self._resolution = count, counts_per_revolution
        self._latched = self._edges = 0
        self._rest = b""
        self.answer_ns = ANSWER_NS
        self.hears_trigger = self.is_valid = True

    def trigger(self) -> None:
        """An edge of the trigger line."""
        if self.hears_trigger:
            self._edges += 1
            self._latched = self._count()

    def receive(self, data: bytes) -> list[bytes]:
        """The answers to some bytes; a question may come in pieces."""
        *questions, self._rest = (self._rest + data).split(b"\n")
        return [self._answer(question.decode("ascii", "replace").split()) for question in questions]

    def _answer(self, words: Sequence[str]) -> bytes:
        status = 0 if self.is_valid else NOT_VALID
        if words[:1] == ["T"]:
            status |= 0 if self._edges else NO_TRIGGER
            return f"T {words[1]} {self._edges} {self._latched} {status:X}\n".encode()
        if words[:1] == ["P"]:
            return f"P {words[1]} {self._count()} {status:X} 0\n".encode()
        if words[:1] == ["I"]:
            about = f"lines={self._resolution} multiplication=1"
            return f"I model=counter-box serial=BOX-1 {about} simulated=1\n".encode()
        return b"?\n"


class BoxBench(Protocol):
    """What the line needs of the bench behind it."""

    clock: Clock

    @property
    def counter_box(self) -> CounterBox: ...

    def line_faults(self) -> list[WireFault]: ...

    def elapse(self) -> None: ...


class BoxLine:
    """The line to the box as `drivers.readout.counter_box.Line`, in the bench's time."""

    def __init__(self, bench: BoxBench) -> None:
        self._bench = bench
        self._coming: deque[tuple[int, bytes]] = deque()

    def send(self, data: bytes) -> None:
        """Send a question; its answer comes after the box's time for it."""
        self._require()
        box = self._bench.counter_box
        due = self._bench.clock.monotonic_ns() + box.answer_ns
        for answer in box.receive(data):
            for fault in self._bench.line_faults():
                answer = fault.alter_from_box(answer)
            if answer:
                self._coming.append((due, answer))

    def receive(self, until_ns: int) -> bytes:
        """What has come until then at the latest; time passes for everybody."""
        self._require()
        clock = self._bench.clock
        due = self._coming[0][0] if self._coming else until_ns
        if min(due, until_ns) > clock.monotonic_ns():
            clock.wait_until_ns(min(due, until_ns))
            self._bench.elapse()
        now, data = clock.monotonic_ns(), b""
        while self._coming and self._coming[0][0] <= now:
            data += self._coming.popleft()[1]
        return data

    def close(self) -> None:
        """Let go."""
        self._coming.clear()

    def _require(self) -> None:
        if any([fault.cuts_box() for fault in self._bench.line_faults()]):
            raise BusLostError("the other end has closed the line", where="simulated counter box")
