"""Both ends of the simulated lines: a python-can bus and a serial port without threads, and what
can go wrong on them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Protocol

from drivers.errors import BusLostError
from drivers.python_can import can
from sim_backend.faults import Fault
from sim_backend.wire.readout import Readout

Frame = tuple[int, bytes]
"""COB-ID and data."""


class Bench(Protocol):
    """What the lines need of the bench behind them."""

    bus_off: bool
    readout: Readout

    @property
    def is_lost(self) -> bool: ...

    def note_refusal(self) -> None: ...

    @property
    def stamp_ns(self) -> int: ...

    def send(self, cob_id: int, data: bytes, owner: object = None) -> None: ...

    def listen(self, owner: object, listener: Callable[[int, bytes, int], None]) -> None: ...

    def leave(self, owner: object) -> None: ...

    def wire_faults(self) -> list[WireFault]: ...


_LONGEST_QUEUE = 1 << 16
"""Frames that a client may leave unread; then the oldest are lost, as in an adapter."""


class WireFault(Fault):
    """A fault of a device on the wire, of frames, of the serial line. Every method may be left as it is; `bench` is the
    `WireBench` on which it falls."""

    stamp_offset_ns: ClassVar[int] | int = 0
    """What is added to the adapter's time stamps while it is active."""

    def act(self, bench: Any, cycle: int) -> None:
        """Called at every SYNC while it is active, before the devices see the SYNC."""

    def end_of(self, bench: Any) -> None:
        """Called once when it is over."""

    def from_devices(self, frame: Frame, bench: Any) -> Sequence[Frame]:
        """What becomes of a frame that a device sends."""
        return (frame,)

    def to_devices(self, frame: Frame, bench: Any) -> Sequence[Frame]:
        """What becomes of a frame on its way to the devices."""
        return (frame,)

    def from_readout(self, answer: bytes) -> bytes:
        """What becomes of the bytes that the readout sends."""
        return answer

    def from_box(self, answer: bytes) -> bytes:
        """What becomes of a line that the counter box on TCP sends."""
        return answer

    def cuts_box(self) -> bool:
        """Whether its network cable is pulled."""
        return False

    # The same, counted: for the bench that lets it happen.

    def fall_on(self, bench: Any, cycle: int) -> None:
        """Act, and count it where this fault has something to do."""
        self.act(bench, cycle)
        if type(self).act is not WireFault.act:
            self.effects.acted(cycle)

    def alter_from_devices(self, frames: Sequence[Frame], bench: Any) -> Sequence[Frame]:
        """What becomes of frames that a device sends."""
        return self._counted(frames, [f for sent in frames for f in self.from_devices(sent, bench)])

    def alter_to_devices(self, frames: Sequence[Frame], bench: Any) -> Sequence[Frame]:
        """What becomes of frames on their way to the devices."""
        return self._counted(frames, [f for sent in frames for f in self.to_devices(sent, bench)])

    def alter_from_readout(self, answer: bytes) -> bytes:
        """What becomes of the bytes that the readout sends."""
        altered = self.from_readout(answer)
        self.effects.frames += altered != answer
        return altered

    def alter_from_box(self, answer: bytes) -> bytes:
        """What becomes of a line that the counter box sends."""
        altered = self.from_box(answer)
        self.effects.frames += altered != answer
        return altered

    def _counted(self, sent: Sequence[Frame], arrived: list[Frame]) -> list[Frame]:
        if arrived != [*sent]:
            self.effects.frames += max(len(sent), 1)
        return arrived


class BenchBus(can.BusABC):
    """The bus as one client in the same process has it: `send` runs the devices, `recv` returns what they answered.

    There is no thread and no waiting: an empty bus gives None at once, whatever the timeout; who owns the clock pumps.
    """

    def __init__(self, bench: Bench, *, receive_own_messages: bool = True) -> None:
        super().__init__(channel="bench", receive_own_messages=receive_own_messages)
        self.channel_info = "simulated CAN bus"
        self.receives_own = receive_own_messages
        self._bench = bench
        self._queue: deque[can.Message] = deque(maxlen=_LONGEST_QUEUE)
        self._error_sent = False
        bench.listen(self, self._hear)

    @property
    def is_waiting(self) -> bool:
        """Whether frames wait to be received."""
        return bool(self._queue)

    @property
    def state(self) -> can.BusState:
        """ERROR once the controller is bus-off."""
        return can.BusState.ERROR if self._bench.bus_off else can.BusState.ACTIVE

    @state.setter
    def state(self, new_state: can.BusState) -> None:
        raise can.CanOperationError("the simulated controller changes its state by itself")

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame; what the devices answer waits to be received."""
        self._require_bus()
        if not (msg.is_extended_id or msg.is_remote_frame):
            self._bench.send(msg.arbitration_id, bytes(msg.data), self)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next frame, None when there is none."""
        if self._bench.bus_off and not self._error_sent:
            self._error_sent = True
            return can.Message(is_error_frame=True, timestamp=self._bench.stamp_ns * 1e-9)
        self._require_bus()
        return self._queue.popleft() if self._queue else None

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        return self.recv(timeout), True

    def shutdown(self) -> None:
        """Leave the bus."""
        self._bench.leave(self)
        super().shutdown()

    def _hear(self, cob_id: int, data: bytes, stamp_ns: int) -> None:
        self._queue.append(
            can.Message(
                timestamp=stamp_ns * 1e-9,
                arbitration_id=cob_id,
                is_extended_id=False,
                data=data,
                check=False,
            )
        )

    def _require_bus(self) -> None:
        if self._bench.is_lost:
            self._bench.note_refusal()
            raise can.CanOperationError("the simulated bus is gone")


class BenchSerial:
    """The readout's serial line as a port of pyserial: what is written is answered at once."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._waiting = b""
        self._is_open = True

    def write(self, b: bytes, /) -> int:
        """Send bytes to the readout."""
        self._require_line()
        answer = self._bench.readout.receive(bytes(b))
        for fault in self._bench.wire_faults():
            answer = fault.alter_from_readout(answer)
        self._waiting += answer
        return len(b)

    def read(self, size: int = 1, /) -> bytes:
        """At most `size` bytes that wait."""
        self._require_line()
        taken, self._waiting = self._waiting[:size], self._waiting[size:]
        return taken

    def reset_input_buffer(self) -> None:
        """Forget what waits."""
        self._require_line()
        self._waiting = b""

    def close(self) -> None:
        """Release the line."""
        self._is_open = False

    def _require_line(self) -> None:
        if not self._is_open:
            raise BusLostError("the serial line has been closed", where="simulated readout")
