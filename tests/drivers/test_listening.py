"""Listening before bring-up, in bytes: who commands the bus already, and that nothing is sent before that is known."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

import pytest

from drivers.bus.cia402.config import DriveConfig
from drivers.bus.cyclic import CanRig, CanRigConfig
from drivers.bus.listening import listening_time_ns
from drivers.bus.motor_encoder import MotorEncoder
from drivers.clock import VirtualClock
from drivers.errors import BusLostError, OtherMasterError
from drivers.python_can import can
from tests.drivers.foreign_drive import ForeignDrive
from tests.drivers.foreign_slave import MS, Slave, Stranger, Traits, Wire
from tests.drivers.scripted_bus import frame

SECOND = 1_000_000_000
TIME_NS = 1_500_000_000
ENCODER = MotorEncoder(largest_speed=900.0)
OURS = CanRigConfig(motor_encoder=ENCODER)
PRODUCES = 0x40000080
"""0x1005 of a node that produces the SYNC."""


class Somebody(Stranger):
    """Sends one frame every `period_ms` from `first_ms` on, in the words of a manual; keeps when the computer spoke."""

    def __init__(self, wire: Wire, *text: str, period_ms: int = 100, first_ms: int = 100) -> None:
        super().__init__(wire)
        self.frames = [frame(words) for words in text]
        self.period_ns, self.due_ns = period_ms * MS, first_ms * MS
        self.heard: list[tuple[int, int, bytes]] = []

    def receive(self, cob_id: int, data: bytes) -> None:
        self.heard.append((self.wire.clock.monotonic_ns(), cob_id, data))

    def tick(self, now: int) -> None:
        if self.frames and now >= self.due_ns:
            self.due_ns += self.period_ns
            for cob_id, data in self.frames:
                self.wire.feed(cob_id, data)


class Device(Somebody):
    """A node that sends frames and answers SDO reads out of a table; others are refused: no such object."""

    def __init__(self, wire: Wire, node_id: int, table: dict[int, int], *text: str) -> None:
        super().__init__(wire, *text)
        self.node_id, self.table = node_id, table

    def receive(self, cob_id: int, data: bytes) -> None:
        super().receive(cob_id, data)
        if cob_id == 0x600 + self.node_id and data[0] == 0x40:
            (index,) = struct.unpack_from("<H", data, 1)
            value = self.table.get(index)
            head, body = (0x80, 0x06020000) if value is None else (0x43, value)
            self.wire.feed(
                0x580 + self.node_id, bytes([head]) + data[1:4] + struct.pack("<I", body)
            )


class Synchroniser(Somebody):
    """The SYNC producer inside a slave: it beats while bit 30 of the slave's 0x1005 is set."""

    def __init__(self, wire: Wire, slave: Slave) -> None:
        super().__init__(wire, "080", period_ms=10)
        self.slave = slave

    def tick(self, now: int) -> None:
        if self.slave.value(0x1005) & 1 << 30:
            super().tick(now)


@dataclass
class Room:
    """A drive alone on a bus, and the rig that would like to open it."""

    traits: Traits = field(default_factory=Traits)
    config: CanRigConfig = OURS

    def __post_init__(self) -> None:
        self.clock = VirtualClock()
        self.wire = Wire(self.clock)
        self.drive = ForeignDrive(self.wire, self.traits)
        self.ear = Somebody(self.wire)
        self.rig = CanRig(
            self.config,
            self.clock,
            lambda: self.wire,
            pump=self.wire.pump,
            time_base="virtual",
            origin="simulated",
        )

    def refusal(self) -> OtherMasterError:
        with pytest.raises(OtherMasterError) as refused:
            self.rig.open()
        return refused.value

    @property
    def sent(self) -> list[tuple[int, int, bytes]]:
        return self.ear.heard


def test_a_silent_bus_is_brought_up_after_exactly_the_time() -> None:
    room = Room()
    room.rig.open()
    assert room.sent[0][0] == TIME_NS == listening_time_ns(50)
    room.rig.close()


def test_three_heartbeats_of_ours_where_that_is_longer() -> None:
    config = CanRigConfig(
        motor_encoder=ENCODER,
        drive=DriveConfig(computer_heartbeat_ms=900, computer_lost_ms=3000),
    )
    room = Room(config=config)
    room.rig.open()
    assert room.sent[0][0] == 2_700_000_000
    room.rig.close()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("77F 05", "heartbeat of node 127, this computer's own node-ID (COB-ID 0x77F) 15 times"),
        ("601 40 41 60 00 00 00 00 00", "SDO requests to node 1 (COB-ID 0x601) 15 times"),
        ("61E 40 00 10 00 00 00 00 00", "SDO requests to node 30 (COB-ID 0x61E) 15 times"),
        ("000 01 00", "NMT commands (COB-ID 0x000) 15 times"),
        ("000 80 01", "NMT commands (COB-ID 0x000) 15 times"),
        ("201 0F 00 E8 03 00 00", "set-points for node 1 (COB-ID 0x201) 15 times"),
        ("501 0F 00", "set-points for node 1 (COB-ID 0x501) 15 times"),
        ("7E5 04 01 00 00 00 00 00 00", "layer setting commands (COB-ID 0x7E5) 15 times"),
    ],
)
def test_a_master_is_refused_in_the_words_of_what_was_heard(text: str, words: str) -> None:
    room = Room()
    Somebody(room.wire, text)
    refused = room.refusal()
    assert words in str(refused)
    assert "within 1.5 s" in str(refused)
    assert refused.remedy
    # Not one frame: neither it nor its drive has noticed that anybody listened.
    assert room.sent == []


def test_a_single_frame_at_the_very_end_is_enough() -> None:
    room = Room()
    Somebody(room.wire, "000 01 01", first_ms=1499)
    assert "NMT commands (COB-ID 0x000) 1 times" in str(room.refusal())


def test_node_guarding_is_a_masters() -> None:
    room = Room()
    room.wire.feed(0x701, b"", is_remote_frame=True)
    assert "node guarding of node 1 (COB-ID 0x701) 1 times" in str(room.refusal())


@pytest.mark.parametrize(
    "text",
    [
        "701 05",  # our node's own heartbeat, left over from the run before
        "181 37 02 00 00 00 00",  # its process data
        "081 30 81 11 00 00 00 00 00",  # its emergency
        "581 4B 41 60 00 37 02 00 00",  # an answer: whoever asked was heard
        "205 0F 00",  # set-points for a node that is not ours
        "100 00 00 00 00 00 00",  # the time of day
    ],
)
def test_what_slaves_send_hinders_nobody(text: str) -> None:
    room = Room()
    Somebody(room.wire, text)
    room.rig.open()
    assert room.sent[0][0] == TIME_NS
    room.rig.close()


def test_frames_of_29_bits_are_none_of_ours() -> None:
    room = Room()
    room.wire.feed(0x601, bytes(8), is_extended_id=True)
    room.rig.open()
    assert room.sent[0][0] == TIME_NS
    room.rig.close()


# Nodes that are not configured --------------------------------------------------------------------


def test_a_heartbeat_of_somebody_who_does_not_say_what_it_is_is_a_masters() -> None:
    room = Room()
    Somebody(room.wire, "77E 05")
    assert "heartbeat of node 126 (COB-ID 0x77E) 15 times, which does not say what it is" in str(
        room.refusal()
    )
    # It was asked, after the listening, and nobody else was.
    assert room.sent[0] == (TIME_NS, *frame("67E 40 00 10 00 00 00 00 00"))
    assert {cob_id for _, cob_id, _ in room.sent} == {0x67E}


def test_a_node_that_calls_itself_the_nmt_master_is_one() -> None:
    room = Room()
    Device(room.wire, 20, {0x1000: 0x191, 0x1F80: 0x01}, "714 05")
    assert "node 20 (COB-ID 0x714) 15 times, which calls itself NMT master" in str(room.refusal())


@pytest.mark.parametrize("table", [{0x1000: 0x191}, {0x1000: 0x191, 0x1F80: 0x04}])
def test_a_slave_that_is_not_configured_is_named_and_left_alone(table: dict[int, int]) -> None:
    room = Room()
    Device(room.wire, 20, table, "714 05")
    room.rig.open()
    told = [event for event in room.rig.events() if event.code == "stranger"]
    assert [event.source for event in told] == ["node 20"]
    assert {data[0] for _, cob_id, data in room.sent if cob_id == 0x614} == {0x40}
    room.rig.close()


# SYNC ---------------------------------------------------------------------------------------------


def test_a_slave_of_ours_that_produces_the_sync_is_named_and_switched_off() -> None:
    room = Room(Traits(values={(0x1005, 0): PRODUCES}))
    Synchroniser(room.wire, room.drive)
    room.rig.open()
    assert room.drive.value(0x1005) == 0x80
    told = [event for event in room.rig.events() if event.code == "sync-producer"]
    assert [event.source for event in told] == ["node 1"]
    # Read first, written, read back; and heard to be silent before anything else is sent.
    assert [(at, cob_id, data[:4]) for at, cob_id, data in room.sent[:3]] == [
        (TIME_NS, 0x601, bytes.fromhex("40051000")),
        (TIME_NS, 0x601, bytes.fromhex("23051000")),
        (TIME_NS, 0x601, bytes.fromhex("40051000")),
    ]
    assert room.sent[3][0] == 2 * TIME_NS
    room.rig.close()


def test_a_sync_that_none_of_our_nodes_sends_is_refused() -> None:
    room = Room()
    Somebody(room.wire, "080", period_ms=10)
    refused = str(room.refusal())
    assert "SYNC (COB-ID 0x080) 141 times, and none of our nodes sends it" in refused
    # Only read: nothing was written to the drive that somebody else leads.
    assert {data[0] for _, _, data in room.sent} == {0x40}


def test_a_stranger_that_goes_on_when_our_producer_is_off_is_refused() -> None:
    room = Room(Traits(values={(0x1005, 0): PRODUCES}))
    Synchroniser(room.wire, room.drive)
    Somebody(room.wire, "080", period_ms=10)
    assert "nodes [1] were switched off" in str(room.refusal())


def test_a_producer_that_cannot_be_told_not_to_is_refused() -> None:
    room = Room(Traits(values={(0x1005, 0): PRODUCES}, refused={(0x1005, 0): 0x06010002}))
    Synchroniser(room.wire, room.drive)
    refused = room.refusal()
    assert refused.where == "node 1"
    assert "cannot be told not to" in str(refused)


def test_a_producer_that_keeps_its_bit_is_refused() -> None:
    room = Room(Traits(values={(0x1005, 0): PRODUCES}))
    room.drive.fixed = frozenset()
    room.drive.on_store = lambda key, data: (  # type: ignore[method-assign]
        room.drive.od.update({key: PRODUCES.to_bytes(4, "little")}) if key == (0x1005, 0) else None
    )
    Synchroniser(room.wire, room.drive)
    assert "cannot be told not to" in str(room.refusal())


def test_whoever_leads_with_a_sync_as_well_is_asked_nothing() -> None:
    room = Room(Traits(values={(0x1005, 0): PRODUCES}))
    Somebody(room.wire, "080", "201 0F 00 E8 03 00 00", period_ms=10)
    refused = str(room.refusal())
    assert "set-points for node 1" in refused
    assert "SYNC (COB-ID 0x080) 141 times" in refused
    assert room.sent == []


# Endings ------------------------------------------------------------------------------------------


def test_a_bus_that_is_pulled_out_while_it_is_listened_to_is_lost() -> None:
    room = Room()

    def gone(timeout: float | None = None) -> can.Message | None:
        raise can.CanOperationError("no such device")

    room.wire.recv = gone  # type: ignore[method-assign]
    with pytest.raises(BusLostError):
        room.rig.open()
    assert room.sent == []


def test_a_rig_that_was_refused_opens_when_the_other_has_gone() -> None:
    room = Room()
    other = Somebody(room.wire, "000 01 00")
    room.refusal()
    assert room.sent == []
    other.frames.clear()
    room.rig.open()
    assert room.sent[0][0] == 2 * TIME_NS
    room.rig.close()
