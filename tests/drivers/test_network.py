"""The pumped bus: dispatch, NMT, heartbeats both ways, emergencies, and losing it."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.bus.cia301 import NmtCommand, NmtState
from drivers.bus.network import BusConfig, PumpedBus, open_raw_bus
from drivers.bus.socketcand import read_message
from drivers.clock import VirtualClock, WallClock
from drivers.errors import BusLostError, DriverError
from drivers.python_can import can
from tests.drivers.scripted_bus import ScriptedBus

MS = 1_000_000


def bus() -> tuple[ScriptedBus, VirtualClock, PumpedBus]:
    raw, clock = ScriptedBus(None), VirtualClock()
    return raw, clock, PumpedBus(raw, clock)


def test_nmt_commands_as_the_standard_has_them() -> None:
    raw, _, pumped = bus()
    for command in (
        NmtCommand.START,
        NmtCommand.STOP,
        NmtCommand.PRE_OPERATIONAL,
        NmtCommand.RESET_NODE,
    ):
        pumped.nmt(command, 5)
    assert raw.sent == [(0, b"\x01\x05"), (0, b"\x02\x05"), (0, b"\x80\x05"), (0, b"\x81\x05")]


def test_a_lost_heartbeat_is_one_event_and_its_return_another() -> None:
    raw, clock, pumped = bus()
    node = pumped.watch(2, timeout_ns=300 * MS)
    raw.feed(0x702, b"\x05")
    pumped.drain()
    assert node.state is NmtState.OPERATIONAL
    clock.advance_ns(300 * MS)
    pumped.check_heartbeats()
    assert not node.is_lost
    clock.advance_ns(1)
    pumped.check_heartbeats()
    pumped.check_heartbeats()
    assert node.is_lost
    raw.feed(0x702, b"\x05")
    pumped.drain()
    events = pumped.events()
    assert [(e.level, e.code) for e in events] == [
        ("error", "heartbeat-lost"),
        ("info", "heartbeat-back"),
    ]
    assert events[0].source == "node 2"
    assert "300 ms" in events[0].text


def test_a_reset_in_motion_and_leaving_operational_are_errors() -> None:
    raw, _, pumped = bus()
    pumped.watch(1)
    for byte in (b"\x00", b"\x05", b"\x00", b"\x05", b"\x04"):
        raw.feed(0x701, byte)
    pumped.drain()
    assert [(e.level, e.code) for e in pumped.events()] == [
        ("info", "boot-up"),
        ("error", "boot-up"),
        ("error", "not-operational"),
    ]


def test_the_computers_heartbeat_beats_only_in_the_owners_turns() -> None:
    raw, clock, pumped = bus()
    pumped.start_heartbeat(50 * MS)
    for _ in range(10):
        clock.advance_ns(10 * MS)
        pumped.receive(clock.monotonic_ns())
    assert raw.sent == [(0x77F, b"\x05")] * 3  # at 0, 50 and 100 ms
    clock.advance_ns(1000 * MS)
    assert len(raw.sent) == 3  # nobody turned
    pumped.receive(clock.monotonic_ns())
    assert len(raw.sent) == 4  # one, however late


def test_waiting_beats_on() -> None:
    raw, clock, pumped = bus()
    pumped.start_heartbeat(50 * MS)
    pumped.idle(200 * MS)
    assert clock.monotonic_ns() == 200 * MS
    assert 4 <= len(raw.sent) <= 5


def test_emergencies_in_words() -> None:
    raw, _, pumped = bus()
    pumped.watch(1)
    raw.feed(0x081, bytes.fromhex("1023 03 0102030405"))
    raw.feed(0x081, bytes(8))
    pumped.drain()
    error, reset = pumped.events()
    assert (error.level, reset.level) == ("error", "info")
    assert "0x2310 current on the device's output side" in error.text
    assert "generic, current" in error.text
    assert pumped.nodes[1].emergencies == 2


def test_a_bus_that_is_gone_says_so() -> None:
    raw, _, pumped = bus()
    raw.is_gone = True
    with pytest.raises(BusLostError, match="nothing can be sent"):
        pumped.send(0x80, b"")
    with pytest.raises(BusLostError, match="nothing can be received"):
        pumped.drain()
    pumped.close()
    with pytest.raises(BusLostError, match="closed"):
        pumped.send(0x80, b"")


def test_bus_off_is_a_loss() -> None:
    raw, _, pumped = bus()
    raw.waiting.append(can.Message(is_error_frame=True))
    pumped.drain()
    assert pumped.events()[0].code == "error-frame"
    raw.state = can.BusState.ERROR  # type: ignore[attr-defined]
    raw.waiting.append(can.Message(is_error_frame=True))
    with pytest.raises(BusLostError, match="bus-off"):
        pumped.drain()


@pytest.mark.parametrize(
    "config",
    [
        BusConfig("no-such-interface", "x"),
        BusConfig("socketcan", "no-such-can"),
        BusConfig("slcan", "/dev/no-such-tty"),
    ],
)
def test_a_bus_that_cannot_be_opened(config: BusConfig) -> None:
    with pytest.raises(BusLostError, match="cannot be opened"):
        open_raw_bus(config)


def test_stamps_by_interface() -> None:
    assert BusConfig("gs_usb").time_base == "hardware"
    assert BusConfig("socketcan").time_base == "host"
    assert BusConfig("socketcand", stamps="virtual").time_base == "virtual"


def test_a_node_id_is_checked() -> None:
    with pytest.raises(DriverError, match="node-ID"):
        bus()[2].watch(0)


@given(st.lists(st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8), st.floats())))
def test_any_frames_are_dispatched_without_an_exception(
    frames: list[tuple[int, bytes, float]],
) -> None:
    raw, _, pumped = bus()
    for node_id in (1, 2, 3):
        pumped.watch(node_id, 100 * MS)
    for cob_id, data, stamp in frames:
        raw.feed(cob_id, data, stamp)
    assert pumped.drain() == len(frames)
    for event in pumped.events():
        assert event.text


# The socketcand hub: a script of what it says, one list per connection.

GREETED = [b"< hi >", b"< ok >", b"< ok >"]
ANSWERS = (b"< ok >", b"< error")
"""What it says only after the client has said something."""


@contextmanager
def hub(*connections: list[bytes]) -> Iterator[BusConfig]:
    """A hub that follows a script, then says no more and hangs up when the client does."""
    with socket.create_server(("127.0.0.1", 0)) as door:

        def follow() -> None:
            for words in connections:
                line, _ = door.accept()
                with line:
                    for word in words:
                        if word.startswith(ANSWERS):
                            line.recv(64)
                        line.sendall(word)
                    # Closed with something unread, a socket would reset the connection and take its last words with it.
                    line.shutdown(socket.SHUT_WR)
                    while line.recv(64):
                        pass

        thread = threading.Thread(target=follow)
        thread.start()
        host, port = door.getsockname()
        yield BusConfig("socketcand", "can0", arguments={"host": host, "port": port})
        thread.join(600.0)
        assert not thread.is_alive()


def test_a_hub_that_is_not_there_is_said_at_once() -> None:
    with socket.create_server(("127.0.0.1", 0)) as door:
        port = door.getsockname()[1]
    clock = WallClock()
    start = clock.monotonic_ns()
    with pytest.raises(BusLostError, match="cannot be opened"):
        open_raw_bus(BusConfig("socketcand", "can0", arguments={"host": "127.0.0.1", "port": port}))
    assert clock.monotonic_ns() - start < 3e9


@pytest.mark.parametrize(
    ("connections", "words"),
    [
        ([[b"HTTP/1.1 400 Bad Request"]], "no socketcand hub"),
        ([[]], "no socketcand hub"),
        ([[b"< hi >"], [b"< hi >", b"< error could not open bus >"]], "could not open bus"),
        ([[b"< hi >"], [b"< hi >"]], "expected"),
    ],
)
def test_what_is_no_hub_or_has_no_such_channel_is_said(
    connections: list[list[bytes]], words: str
) -> None:
    with hub(*connections) as config, pytest.raises(BusLostError, match=words):
        open_raw_bus(config)


def test_a_bus_that_is_busy_is_joined() -> None:
    frame = b"< frame 701 1.000000 05 >"
    with hub([b"< hi >"], [b"< h", b"i >", b"< ok >", b"< ok >" + 50 * frame]) as config:
        raw = open_raw_bus(config)
        for _ in range(50):
            message = raw.recv(600.0)
            assert message is not None
            assert message.arbitration_id == 0x701
        raw.shutdown()


def test_a_hub_that_goes_away_is_a_lost_bus_after_everything_it_sent() -> None:
    frames = [b"< frame 081 1.000000 1023", b"010000000000 >< frame 702 1.000100 05 >"]
    with hub([b"< hi >"], [*GREETED, *frames]) as config:
        clock = WallClock()
        pumped = PumpedBus(open_raw_bus(config), clock)
        node = pumped.watch(2)
        with pytest.raises(BusLostError, match="closed the connection"):
            pumped.idle(10_000_000_000)
        assert node.state is NmtState.OPERATIONAL
        assert [event.code for event in pumped.events()] == ["emcy"]
        with pytest.raises(BusLostError):
            pumped.drain()
        pumped.close()


class Reset:
    """The socket of a line that was reset: there is something to be read, and reading it fails."""

    def __init__(self) -> None:
        self._line, self._other = socket.socketpair()
        self._other.send(b"x")

    def fileno(self) -> int:
        return self._line.fileno()

    def recv(self, length: int) -> bytes:
        raise ConnectionResetError(104, "Connection reset by peer")

    def close(self) -> None:
        self._line.close()
        self._other.close()


def test_a_hub_that_resets_the_line_is_said_in_a_sentence() -> None:
    """The client of python-can puts a whole traceback into the text of its error, its head into the first line."""
    with hub([b"< hi >"], GREETED) as config:
        raw = open_raw_bus(config)
        line = vars(raw)["_SocketCanDaemonBus__socket"]
        vars(raw)["_SocketCanDaemonBus__socket"] = reset = Reset()
        with pytest.raises(BusLostError) as caught:
            PumpedBus(raw, WallClock()).drain()
        vars(raw)["_SocketCanDaemonBus__socket"] = line
        reset.close()
        raw.shutdown()
    assert "Connection reset by peer" in str(caught.value)
    assert "Traceback" not in str(caught.value)


class ResetLine:
    """The end of a connection that the other side has reset after some words."""

    def __init__(self, words: bytes) -> None:
        self._words = words

    def recv(self, length: int) -> bytes:
        if not self._words:
            raise ConnectionResetError(104, "Connection reset by peer")
        taken, self._words = self._words[:length], self._words[length:]
        return taken


@pytest.mark.parametrize("words", [b"", b"< h", b"HTTP"])
def test_a_reset_connection_is_an_end_like_any_other(words: bytes) -> None:
    assert read_message(cast("socket.socket", ResetLine(words))) == words
