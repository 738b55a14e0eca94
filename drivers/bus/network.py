"""The CAN bus that its owner pumps: opening it, sending, dispatching by COB-ID, NMT, heartbeats both ways, emergencies.

There is no thread and no notifier. Whoever owns the bus calls `receive`, and the same call sends the computer's own
heartbeat when it is due: a loop that is dead beats no more, and the drive stops by itself (CiA 301, 7.2.8.2.2).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal, Protocol, cast

from drivers.bus.cia301 import (
    EMCY_BASE,
    HEARTBEAT_BASE,
    HIGHEST_NODE_ID,
    SDO_REQUEST_BASE,
    NmtCommand,
    NmtState,
    error_code_text,
    error_register_text,
    nmt_state,
)
from drivers.bus.frame_log import ERROR, SENT, FrameLog
from drivers.clock import Clock
from drivers.errors import BusLostError, DriverError
from drivers.event import Event, Level
from drivers.python_can import can

TimeBase = Literal["hardware", "device", "host", "virtual"]
FrameHandler = Callable[[bytes, int], None]
Pump = Callable[[int], None]
"""Lets simulated devices of the same process run: it may advance a virtual clock up to the given
instant, never beyond.
"""

_ADAPTERS_WITH_STAMPS: Final = frozenset({"gs_usb", "pcan", "kvaser"})
"""python-can interfaces whose time stamps are the adapter's own clock; socketcan delivers the kernel's receive time."""
_ADAPTERS_WITH_ECHO: Final = frozenset({"socketcan", "virtual", "kvaser", "vector", "ixxat"})
"""python-can interfaces that hand back what they sent when asked to (gs_usb and udp_multicast do so unasked)."""
OPENED_TWICE: Final[Mapping[str, bool | None]] = {
    "socketcand": True,
    "udp_multicast": True,
    "virtual": True,
    "socketcan": None,
    "gs_usb": None,
    "ixxat": None,
    "kvaser": None,
    "pcan": None,
    "slcan": None,
    "vector": None,
}
"""python-can interfaces that one process can open twice, as the watchdog wants it: tried, or None: not tried. One that
is not named here was not tried either.
"""
_IDLE_STEP_NS: Final = 1_000_000
_EVENTS_KEPT: Final = 10_000


@dataclass(frozen=True)
class BusConfig:
    """How to reach the bus: python-can's interface, channel, bit rate [bit/s], further arguments,
    and what its stamps are.

    `stamps` None: derived from the interface. `own_node_id` is the node-ID that the computer's heartbeat carries.
    """

    interface: str = "socketcan"
    channel: str | int | None = "can0"
    bit_rate: int = 1_000_000
    arguments: Mapping[str, object] = field(default_factory=dict[str, object])
    stamps: TimeBase | None = None
    own_node_id: int = 127

    @property
    def time_base(self) -> TimeBase:
        """What the time stamps of received frames are."""
        if self.stamps is not None:
            return self.stamps
        return "hardware" if self.interface in _ADAPTERS_WITH_STAMPS else "host"


class RawBus(Protocol):
    """The part of python-can's bus that is used; a simulated bus needs no more."""

    def send(self, msg: can.Message, /) -> None: ...

    def recv(self, timeout: float | None = None, /) -> can.Message | None: ...

    def shutdown(self) -> None: ...


@dataclass(frozen=True)
class Emergency:
    """An EMCY message: node, error code, error register 0x1001, five bytes of the manufacturer."""

    node_id: int
    code: int
    register: int
    vendor: bytes


@dataclass(kw_only=True)
class NodeWatch:
    """What is known of a node by listening: NMT state, when it was heard last, heartbeat time-out, boots, loss."""

    node_id: int
    timeout_ns: int = 0
    state: NmtState = NmtState.UNKNOWN
    heard_ns: int = 0
    is_lost: bool = False
    boots: int = 0
    emergencies: int = 0


def second_handle_words(interface: str) -> str:
    """What is known of opening an interface twice, in words."""
    found = OPENED_TWICE.get(interface)
    known = {True: "can be opened twice", False: "cannot be opened twice"}
    return f"{interface} {known[found]}" if found is not None else f"{interface}: not tried"


def open_raw_bus(config: BusConfig) -> RawBus:
    """Open the bus through python-can. Raises `BusLostError` with what python-can says."""
    arguments = dict(config.arguments)
    if config.interface in _ADAPTERS_WITH_ECHO:
        arguments.setdefault("receive_own_messages", True)
    if config.interface == "socketcand":
        # Without it the small frames wait for each other's acknowledgement: 40 ms instead of 0.3 ms.
        arguments.setdefault("tcp_tune", True)
    try:
        if config.interface == "socketcand":
            from drivers.bus.socketcand import SocketcandBus

            return SocketcandBus(str(config.channel), **arguments)  # type: ignore[arg-type, return-value]
        return can.Bus(
            interface=config.interface,
            channel=config.channel,
            bitrate=config.bit_rate,
            **cast("dict[str, Any]", arguments),
        )
    except (
        can.CanError,
        OSError,
        ValueError,
        TypeError,
        ImportError,
        NotImplementedError,
        AttributeError,
    ) as error:
        raise BusLostError(
            f"the bus cannot be opened: {error}",
            where=f"{config.interface} {config.channel}",
            remedy="Check interface, channel and bit rate in the rig's configuration, and "
            "that the adapter is plugged in.",
        ) from error


class PumpedBus:
    """A bus, its clock and its dispatch table; single owner, single thread.

    `pump` lets devices of the same process answer; without it frames are waited for in real time.
    """

    def __init__(
        self,
        raw: RawBus,
        clock: Clock,
        *,
        pump: Pump | None = None,
        time_base: TimeBase = "host",
        own_node_id: int = 127,
    ) -> None:
        self._raw, self._clock, self._pump = raw, clock, pump
        self.time_base: TimeBase = time_base
        self.own_node_id = own_node_id
        self.nodes: dict[int, NodeWatch] = {}
        self.frames_received = self.frames_unknown = self.error_frames = self.events_dropped = 0
        self.errors_seen = 0
        self.echoes = False
        """Whether the bus hands back what was sent: it shows with the first request or heartbeat."""
        self.last_error: Event | None = None
        self.while_waiting: Callable[[], int] | None = None
        """Asked whenever the owner waits: turns if it is time to and says 0, else the instant at which it will be."""
        self.sample_time_ns: Callable[[], int] = clock.calendar_ns
        self.emergency_texts: dict[int, Mapping[int, str]] = {}
        self._handlers: dict[int, FrameHandler] = {}
        self._events: deque[Event] = deque(maxlen=_EVENTS_KEPT)
        self._heartbeat_period_ns = self._heartbeat_due_ns = 0
        self._is_open = True
        self._asked: tuple[int, bytes] | None = None
        self.log: FrameLog | None = None
        """Where every frame is kept that is sent or taken in."""

    @property
    def clock(self) -> Clock:
        """The clock that was handed in."""
        return self._clock

    # --- frames

    def subscribe(self, cob_id: int, handler: FrameHandler) -> None:
        """Hand every frame of `cob_id` to `handler(data, stamp_ns)`; one handler per COB-ID, the latest holds."""
        self._handlers[cob_id] = handler

    def handler_of(self, cob_id: int) -> FrameHandler | None:
        """Who takes the frames of `cob_id`: for whoever borrows the COB-ID and gives it back."""
        return self._handlers.get(cob_id)

    def send(self, cob_id: int, data: bytes) -> None:
        """Send one frame with an 11-bit identifier. Raises `BusLostError`."""
        self._require_open()
        message = can.Message(arbitration_id=cob_id, data=data, is_extended_id=False)
        if cob_id >= SDO_REQUEST_BASE:
            self._asked = (cob_id, data)
        if self.log is not None:
            self.log.put(self._clock.monotonic_ns(), cob_id, data, SENT)
        try:
            self._raw.send(message)
        except (can.CanError, OSError, ValueError) as error:
            raise self._lost("nothing can be sent", error) from error

    def drain(self) -> int:
        """Dispatch all frames that are already there, without waiting; how many."""
        count = 0
        while (message := self._take(0.0)) is not None:
            self._dispatch(message)
            count += 1
        return count

    def receive(self, deadline_ns: int) -> int:
        """Dispatch frames; wait for the first of them until `deadline_ns` of the clock. How many there were."""
        self.send_heartbeat()
        if self.while_waiting is not None:
            due = self.while_waiting()
            if not due:
                return 0
            deadline_ns = min(deadline_ns, due)
        if self._pump is not None:
            return self._receive_pumped(self._pump, deadline_ns)
        if count := self.drain():
            return count
        remaining = deadline_ns - self._clock.monotonic_ns()
        if remaining <= 0:
            return 0
        if self._heartbeat_period_ns:
            remaining = min(remaining, max(1, self._heartbeat_due_ns - self._clock.monotonic_ns()))
        until = self._clock.monotonic_ns() + remaining
        message = self._take(remaining * 1e-9)
        if message is None:
            self._clock.wait_until_ns(until)
            return 0
        self._dispatch(message)
        return 1 + self.drain()

    def wait_for(self, is_there: Callable[[], bool], timeout_ns: int) -> bool:
        """Pump until `is_there()` or until `timeout_ns` have passed on the clock; whether it came."""
        deadline = self._clock.monotonic_ns() + timeout_ns
        while not is_there():
            if self._clock.monotonic_ns() >= deadline:
                return is_there()
            self.receive(deadline)
        return True

    def idle(self, duration_ns: int) -> None:
        """Pump for `duration_ns` of the clock."""
        self.wait_for(lambda: False, duration_ns)

    def close(self) -> None:
        """Release the bus; never raises because it is already gone."""
        if self._is_open:
            self._is_open = False
            try:
                self._raw.shutdown()
            except (can.CanError, OSError, ValueError, RuntimeError) as error:
                self.emit("warning", "bus-close", "bus", f"closing the bus: {error}")

    # --- NMT and heartbeats

    def nmt(self, command: NmtCommand, node_id: int = 0) -> None:
        """Send an NMT command to a node, to all nodes with 0."""
        self.send(0x000, bytes([command, node_id]))

    def watch(self, node_id: int, timeout_ns: int = 0) -> NodeWatch:
        """Listen to a node: heartbeat, boot-up and EMCY. `timeout_ns` > 0 arms the loss detection from now on."""
        if not 1 <= node_id <= HIGHEST_NODE_ID:
            raise DriverError(
                "not a CANopen node-ID", where="bus", value=node_id, limit=f"1 to {HIGHEST_NODE_ID}"
            )
        node = self.nodes.setdefault(node_id, NodeWatch(node_id=node_id))
        node.timeout_ns, node.heard_ns, node.is_lost = timeout_ns, self._clock.monotonic_ns(), False
        return node

    def start_heartbeat(self, period_ns: int) -> None:
        """Send the computer's heartbeat every `period_ns` from within the owner's own turns; 0 stops it."""
        self._heartbeat_period_ns, self._heartbeat_due_ns = period_ns, self._clock.monotonic_ns()
        self.send_heartbeat()

    def send_heartbeat(self) -> None:
        """Send the heartbeat if it is due; one frame, however late it is."""
        if self._heartbeat_period_ns and self._clock.monotonic_ns() >= self._heartbeat_due_ns:
            now = self._clock.monotonic_ns()
            self._heartbeat_due_ns = max(
                self._heartbeat_due_ns + self._heartbeat_period_ns,
                now + self._heartbeat_period_ns // 2,
            )
            self.send(HEARTBEAT_BASE + self.own_node_id, bytes([NmtState.OPERATIONAL.value]))

    def check_heartbeats(self) -> None:
        """Mark the nodes that have not been heard within their time-out; each loss is one event."""
        now = self._clock.monotonic_ns()
        for node in self.nodes.values():
            if node.timeout_ns and not node.is_lost and now - node.heard_ns > node.timeout_ns:
                node.is_lost = True
                silent_ms, allowed_ms = (now - node.heard_ns) / 1e6, node.timeout_ns / 1e6
                self.emit(
                    "error",
                    "heartbeat-lost",
                    f"node {node.node_id}",
                    f"no heartbeat for {silent_ms:.0f} ms, allowed {allowed_ms:.0f} ms",
                )

    # --- events

    def emit(self, level: Level, code: str, source: str, text: str) -> None:
        """Keep an event until it is drained."""
        event = Event(self.sample_time_ns(), level, code, source, text)
        if level == "error":
            self.errors_seen += 1
            self.last_error = event
        if len(self._events) == self._events.maxlen:
            self.events_dropped += 1
        self._events.append(event)

    def events(self) -> list[Event]:
        """The events since the last call, oldest first."""
        drained = list(self._events)
        self._events.clear()
        return drained

    # --- inside

    def _receive_pumped(self, pump: Pump, deadline_ns: int) -> int:
        while True:
            before = self._clock.monotonic_ns()
            pump(deadline_ns)
            if count := self.drain():
                return count
            now = self._clock.monotonic_ns()
            if now >= deadline_ns:
                return 0
            if now == before:
                # A pump that moves no clock: time passes here, in small steps, so that its devices'
                # timers get their turn.
                self._clock.wait_until_ns(min(deadline_ns, now + _IDLE_STEP_NS))
            self.send_heartbeat()

    def _take(self, timeout: float) -> can.Message | None:
        self._require_open()
        try:
            return self._raw.recv(timeout)
        except (can.CanError, OSError, ValueError) as error:
            raise self._lost("nothing can be received", error) from error

    def _dispatch(self, message: can.Message) -> None:
        self.frames_received += 1
        cob_id = message.arbitration_id
        if self.log is not None and not message.is_extended_id:
            marks = ERROR if message.is_error_frame else 0
            self.log.put(self._clock.monotonic_ns(), cob_id & 0x7FF, message.data, marks)
        if message.is_error_frame:
            self._on_error_frame()
        elif message.is_extended_id or message.is_remote_frame:
            self.frames_unknown += 1
        elif (handler := self._handlers.get(cob_id)) is not None:
            handler(bytes(message.data), _stamp_ns(message.timestamp))
        elif HEARTBEAT_BASE < cob_id <= HEARTBEAT_BASE + HIGHEST_NODE_ID:
            self._on_heartbeat(cob_id - HEARTBEAT_BASE, bytes(message.data))
        elif EMCY_BASE < cob_id <= EMCY_BASE + HIGHEST_NODE_ID:
            self.on_emergency(cob_id - EMCY_BASE, bytes(message.data))
        else:
            self.echoes = self.echoes or (cob_id, bytes(message.data)) == self._asked
            self.frames_unknown += 1

    def _on_heartbeat(self, node_id: int, data: bytes) -> None:
        node = self.nodes.get(node_id)
        if node_id == self.own_node_id:
            # The bus hands back what was sent: the SYNC's own time stamp can be had.
            self.echoes = self.echoes or (HEARTBEAT_BASE + node_id, data) == self._asked
            return
        if node is None or len(data) != 1:
            self.frames_unknown += 1
            return
        previous, node.state = node.state, nmt_state(data[0])
        node.heard_ns = self._clock.monotonic_ns()
        source = f"node {node_id}"
        if node.is_lost:
            node.is_lost = False
            self.emit("info", "heartbeat-back", source, f"heard again, {node.state.name}")
        if node.state is NmtState.BOOT_UP:
            node.boots += 1
            level: Level = "error" if previous is NmtState.OPERATIONAL else "info"
            self.emit(
                level,
                "boot-up",
                source,
                "the node has restarted" if level == "error" else "boot-up",
            )
        elif previous is NmtState.OPERATIONAL and node.state is not NmtState.OPERATIONAL:
            self.emit(
                "error",
                "not-operational",
                source,
                f"left OPERATIONAL, now {node.state.name} (0x{data[0]:02X})",
            )

    def on_emergency(self, node_id: int, data: bytes) -> None:
        """Take an EMCY message of a node; also the handler for one that uses another COB-ID (0x1014)."""
        source = f"node {node_id}"
        if len(data) < 3:
            self.emit(
                "error",
                "emcy",
                source,
                f"emergency with {len(data)} bytes instead of 8: {data.hex(' ') or 'empty'}",
            )
            return
        emergency = Emergency(node_id, int.from_bytes(data[:2], "little"), data[2], data[3:])
        if node_id in self.nodes:
            self.nodes[node_id].emergencies += 1
        text = error_code_text(emergency.code, self.emergency_texts.get(node_id))
        if emergency.code & 0xFF00 == 0:
            self.emit("info", "emcy", source, f"0x{emergency.code:04X} {text}")
            return
        # Somebody else's device on the same bus is worth a line, and does not stop this rig.
        level: Level = "error" if node_id in self.nodes else "warning"
        self.emit(
            level,
            "emcy",
            source,
            f"0x{emergency.code:04X} {text}; register: {error_register_text(emergency.register)}; "
            f"manufacturer: {emergency.vendor.hex(' ')}",
        )

    def _on_error_frame(self) -> None:
        self.error_frames += 1
        if self.error_frames == 1 or self.error_frames % 1000 == 0:
            self.emit(
                "warning",
                "error-frame",
                "bus",
                f"{self.error_frames} error frames so far; check cable and termination",
            )
        if getattr(self._raw, "state", None) is can.BusState.ERROR:
            raise self._lost("the adapter is bus-off", None)

    def _require_open(self) -> None:
        if not self._is_open:
            raise BusLostError("the bus has been closed", where="bus")

    def _lost(self, what: str, error: Exception | None) -> BusLostError:
        return BusLostError(
            what + (f": {error}" if error else ""),
            where="bus",
            remedy="Check cable, termination, adapter or hub, then open the rig again.",
        )


def _stamp_ns(seconds: float) -> int:
    """A frame's time stamp in ns; an adapter that delivers nonsense delivers 0, which counts as no stamp."""
    return round(seconds * 1e9) if math.isfinite(seconds) else 0
