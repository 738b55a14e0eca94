"""The socketcand protocol, and the bench behind it as any CANopen tool sees it. Ports are free ones; nothing sleeps."""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import Iterator

import canopen
import pytest
import serial
from hypothesis import given
from hypothesis import strategies as st

from drivers.clock import WallClock
from drivers.errors import DriverError
from drivers.python_can import can
from drivers.readout.nd287 import Readout as ReadoutDriver
from drivers.readout.nd287 import ReadoutConfig, open_port
from sim_backend.individuals import individual_gear
from sim_backend.wire.faults import HubGone
from sim_backend.wire.hub import LONGEST_LINE, frame_line, parse_send, read_message
from sim_backend.wire.serve import Addresses, Server, make_bench
from sim_backend.world import World
from tests.sim_backend.rigs import GEAR, MOTOR

WAIT = 600.0
"""Seconds after which something that must come has not come."""


@pytest.mark.parametrize(
    ("message", "frame"),
    [
        ("send 201 2 0F 00", (0x201, b"\x0f\0")),
        ("send 80 0", (0x80, b"")),
        ("send 80 0 ", (0x80, b"")),
        ("send 7FF 8 1 2 3 4 5 6 7 8", (0x7FF, bytes(range(1, 9)))),
        ("send 800 0", None),
        ("send 00000201 0", None),
        ("send 12345678 0", None),
        ("send 201 3 0F 00", None),
        ("send 201 1 0F 00", None),
        ("send 201 1 100", None),
        ("send 201 9 1 2 3 4 5 6 7 8 9", None),
        ("send x 0", None),
        ("send 201 -1", None),
        ("send", None),
        ("", None),
        ("echo", None),
        ("sendpdu", None),
    ],
)
def test_send_messages(message: str, frame: tuple[int, bytes] | None) -> None:
    assert parse_send(message) == frame


def test_frame_messages_carry_the_stamp() -> None:
    assert frame_line(0x181, b"\x01\xab", 12_345_678_901_234) == b"< frame 181 12345.678901 01AB >"
    assert frame_line(0x080, b"", 0) == b"< frame 080 0.000000  >"


@given(st.text(max_size=80))
def test_any_message_is_a_frame_or_none(message: str) -> None:
    frame = parse_send(message)
    assert frame is None or (0 <= frame[0] < 0x800 and len(frame[1]) <= 8)


@given(st.binary(max_size=2 * LONGEST_LINE))
def test_any_bytes_end_in_messages_or_in_a_closed_connection(data: bytes) -> None:
    async def feed() -> None:
        reader = asyncio.StreamReader()
        reader.feed_data(data)
        reader.feed_eof()
        while True:
            message = await read_message(reader)
            assert len(message) <= LONGEST_LINE

    with pytest.raises((asyncio.IncompleteReadError, ConnectionError)):
        asyncio.run(feed())


class Served:
    """The bench in a thread of its own."""

    def __init__(self, *, readout=None, faults=()) -> None:
        self.bench = make_bench(
            individual_gear(GEAR, 3), MOTOR, None, World.of(7), time="sync", faults=faults
        )
        self._ready, self._readout = threading.Event(), readout
        self._thread = threading.Thread(target=lambda: asyncio.run(self._main()), daemon=True)
        self.addresses = Addresses("", 0, "")
        self._thread.start()
        assert self._ready.wait(WAIT)

    async def _main(self) -> None:
        self._loop, self._until = asyncio.get_running_loop(), asyncio.Event()
        server = Server(self.bench, readout=self._readout)
        self.addresses = await server.start()
        self._ready.set()
        try:
            await server.run(self._until)
        finally:
            await server.stop()

    def inject(self, fault) -> None:
        self._loop.call_soon_threadsafe(self.bench.inject, fault)

    def bus(self) -> can.BusABC:
        return can.Bus(
            interface="socketcand",
            host=self.addresses.host,
            port=self.addresses.port,
            channel="can0",
            tcp_tune=True,
        )

    def stop(self) -> None:
        self._loop.call_soon_threadsafe(self._until.set)
        self._thread.join(WAIT)
        assert not self._thread.is_alive()


@pytest.fixture
def served() -> Iterator[Served]:
    made = Served(readout="socket")
    yield made
    made.stop()


def expect(bus: can.BusABC, cob_id: int) -> can.Message:
    """The next frame of a COB-ID."""
    for _ in range(200):
        message = bus.recv(WAIT)
        assert message is not None, f"0x{cob_id:03X} has not come"
        if message.arbitration_id == cob_id:
            return message
    raise AssertionError(f"0x{cob_id:03X} is not among 200 frames")


def test_canopen_reads_the_identity_and_gets_process_data(served: Served) -> None:
    network = canopen.Network()
    network.connect(
        interface="socketcand",
        host=served.addresses.host,
        port=served.addresses.port,
        channel="can0",
        tcp_tune=True,
    )
    try:
        node = network.add_node(1, canopen.ObjectDictionary())
        node.sdo.RESPONSE_TIMEOUT = WAIT
        assert node.sdo.upload(0x1018, 2) == (0x402).to_bytes(4, "little")
        assert node.sdo.upload(0x1008, 0) == b"Simulated servo amplifier"
        with pytest.raises(canopen.SdoAbortedError):
            node.sdo.download(0x6041, 0, b"\0\0")
        arrived = threading.Event()
        frames: list[bytes] = []

        def take(_cob_id: int, data: bytearray, _stamp: float) -> None:
            frames.append(bytes(data))
            arrived.set()

        network.subscribe(0x181, take)
        network.nmt.state = "OPERATIONAL"
        network.sync.transmit()
        assert arrived.wait(WAIT)
        assert len(frames[0]) == 8
        assert frames[0][:2] == b"\x50\x02"
    finally:
        network.disconnect()


def test_clients_hear_each_other_and_stamps_are_the_adapters(served: Served) -> None:
    with served.bus() as one, served.bus() as other:
        one.send(can.Message(arbitration_id=0x000, data=[1, 2], is_extended_id=False))
        start = expect(other, 0x000)
        assert start.data == b"\x01\x02"
        # A small identifier is an 11-bit one like any other: NMT, SYNC and EMCY are heard.
        assert not start.is_extended_id
        for k in range(3):
            one.send(can.Message(arbitration_id=0x080, is_extended_id=False))
            sync, data = expect(other, 0x080), expect(one, 0x182)
            assert sync.timestamp == pytest.approx(1.0 + 1e-3 * k, abs=5e-4)
            assert 0.0 < data.timestamp - sync.timestamp < 1e-3


def send_often(bus: can.BusABC) -> None:
    for _ in range(500):
        bus.send(can.Message(arbitration_id=0x080, is_extended_id=False))
        bus.recv(0.02)


def test_a_hub_that_goes_away_disconnects(served: Served) -> None:
    with served.bus() as bus:
        served.inject(HubGone(0))
        # python-can's client takes the end of the connection for silence; sending finds out.
        with pytest.raises((can.CanError, OSError)):
            send_often(bus)


def test_an_unknown_channel_is_refused(served: Served) -> None:
    with socket.create_connection((served.addresses.host, served.addresses.port), WAIT) as line:
        line.settimeout(WAIT)
        assert line.recv(64) == b"< hi >"
        line.sendall(b"< open can7 >")
        assert line.recv(64) == b"< error could not open bus >"
        line.sendall(b"< open can0 >")
        assert line.recv(64) == b"< ok >"


def test_the_readout_over_a_socket(served: Served) -> None:
    read_once(served.addresses.readout)


def test_the_readout_over_a_pty() -> None:
    made = Served(readout="pty")
    try:
        read_once(made.addresses.readout)
    finally:
        made.stop()


def read_once(url: str) -> None:
    config = ReadoutConfig(url=url, baud=115200, answer_ms=1000.0 * WAIT)
    port = open_port(config)
    assert isinstance(port, serial.SerialBase)
    driver = ReadoutDriver(port, WallClock(), config)
    try:
        assert driver.identification() == ["ND-287", "646118-01", "V1-01"]
        assert abs(driver.read().value) < 6.3
    finally:
        driver.close()


def test_a_taken_port_is_an_error(served: Served) -> None:
    async def start() -> None:
        server = Server(make_bench(GEAR, MOTOR))
        await server.start(served.addresses.host, served.addresses.port)

    with pytest.raises(DriverError, match="cannot listen"):
        asyncio.run(start())
