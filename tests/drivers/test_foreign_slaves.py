"""Slaves that do what the standards allow and our simulated ones do not: they are brought up, or
refused in clear words.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from canopen import SdoAbortedError

from drivers.bus.cia301 import I32, U16, ObjectRef
from drivers.bus.cia402.config import DriveConfig
from drivers.bus.cia402.drive import ServoAmplifier
from drivers.bus.device import RemoteDevice
from drivers.bus.network import PumpedBus
from drivers.bus.pdo import map_objects, read_pdo
from drivers.bus.sdo import SdoAbortError, SdoClient, SdoTimeoutError
from drivers.clock import VirtualClock
from drivers.drive_state import DriveState
from drivers.errors import DriverError, ReadbackError
from drivers.port import Command, DriveLimits, Guard, Mode
from tests.drivers.can_bench import Setup, close, setup
from tests.drivers.canopen_peer import DrivePeer, Peer, drive_eds, entry, record
from tests.drivers.scripted_bus import ScriptedBus

READ_ONLY, INVALID, NOT_NOW = 0x06010002, 0x06090030, 0x08000022
HEARTBEAT = entry(0x1017, None, "producer heartbeat", 6, "rw", "0")
MODES = entry(0x6502, None, name="modes", kind=7, access="rw", default=hex(0x30D), mappable=1)


def refuses(
    peer: Peer, index: int, code: int, when: Callable[[int, bytes], bool] = lambda sub, data: True
) -> None:
    """Let a slave abort writes to an object."""

    def callback(index: int, subindex: int, od: Any, data: bytes) -> None:
        if index == wanted and when(subindex, data):
            raise SdoAbortedError(code)

    wanted = index
    peer.node.add_write_callback(callback)


def keeps(
    peer: Peer, index: int, changed: Callable[[int], int], size: int = 2, sub: int = 0
) -> None:
    """Let a slave make another value of what is written to an object, as soon as it looks."""
    before = peer.after_message

    def after() -> None:
        value = peer.get(index, sub)
        if changed(value) != value:
            peer.put(index, changed(value), size, sub)
        before()

    peer.after_message = after  # type: ignore[method-assign]


@contextmanager
def opened(made: Setup) -> Iterator[Setup]:
    try:
        made.rig.open()
        yield made
    finally:
        close(made)


# Heartbeat and communication objects --------------------------------------------------------------


def test_a_heartbeat_that_is_rounded_is_watched_as_it_is() -> None:
    made = setup()
    keeps(made.counter, 0x1017, lambda ms: -(-ms // 64) * 64)
    with opened(made):
        assert made.rig.nodes.counters[0].device.watch.timeout_ns == 3 * 128 * 1_000_000
        assert "own-value" in made.codes()
        assert not made.rig.exchange(Command(Mode.OFF), 300, Guard()).flags.any()
        assert "heartbeat-lost" not in made.codes()


@pytest.mark.parametrize("how", ["no 0x1017 (node guarding only)", "fixed at 0", "stays at 0"])
def test_a_slave_without_heartbeat_is_brought_up_and_said_to_be_unwatched(how: str) -> None:
    made = setup(eds_text=drive_eds().replace(HEARTBEAT, "") if how.startswith("no") else "")
    if how == "fixed at 0":
        refuses(made.drive, 0x1017, READ_ONLY)
    elif how == "stays at 0":
        keeps(made.drive, 0x1017, lambda ms: 0)
    else:
        made.drive.send_heartbeat = lambda: None  # type: ignore[method-assign]
    with opened(made):
        missing = {m.index: m.consequence for m in made.rig.missing()[1]}
        assert "shows only by its missing data" in missing[0x1017]
        assert not made.speed(100, 20).flags.any()


def test_a_consumer_that_rounds_up_is_taken_and_one_that_watches_somebody_else_is_not() -> None:
    made = setup()
    keeps(made.drive, 0x1016, lambda word: word + 6 if word & 0xFF == 250 else word, 4, 1)
    with opened(made):
        assert made.drive.get(0x1016, 1) == 127 << 16 | 256
        assert any("waits 256 ms" in event.text for event in made.rig.events())
    made = setup()
    keeps(made.drive, 0x1016, lambda word: 5 << 16 | 250 if word else 0, 4, 1)
    with pytest.raises(ReadbackError, match="consumer heartbeat"), opened(made):
        pass


def test_a_sync_period_is_supervised_by_no_slave() -> None:
    made = setup()
    made.drive.put(0x1006, 1000, 4)
    with opened(made):
        assert made.drive.get(0x1006) == 0
        assert "own-value" not in made.codes()


def test_periods_that_a_slave_keeps_for_itself_are_warnings() -> None:
    made = setup()
    made.drive.put(0x1006, 2000, 4)
    keeps(made.drive, 0x1006, lambda us: 2000, 4)
    with opened(made):
        assert "own-value" in made.codes()


def test_a_boot_up_message_that_is_repeated_before_the_start_is_no_restart() -> None:
    made = setup()
    for _ in range(3):
        made.drive.bus.send(_frame(0x701, b"\0"))
    with opened(made):
        assert {e.level for e in made.rig.events() if e.code == "boot-up"} <= {"info"}
        assert not made.speed(100, 5).flags.any()


def _frame(cob_id: int, data: bytes) -> Any:
    from drivers.python_can import can

    return can.Message(arbitration_id=cob_id, data=data, is_extended_id=False)


def test_a_process_data_frame_at_the_start_of_operation_is_marked_and_no_more() -> None:
    made = setup()
    # Not beside its wrap: a count that is not trusted is no base for the next.
    made.counter.position = 5000
    with opened(made):
        # A TPDO goes out once by itself when the node becomes operational, before any SYNC.
        made.counter.bus.send(_frame(0x182, made.counter.position.to_bytes(4, "little") + b"\0\0"))
        flags = made.rig.exchange(Command(Mode.OFF), 5, Guard()).flags
        assert flags[0] != 0
        assert not flags[1:].any()
        assert "foreign-tpdo" not in made.codes()


# Process data -------------------------------------------------------------------------------------


def test_an_rpdo_that_acts_at_once_is_used_with_a_warning_and_a_synchronous_one_without() -> None:
    made = setup()
    refuses(made.drive, 0x1400, READ_ONLY, lambda sub, data: sub == 2)
    with opened(made):
        assert any(e.code == "rpdo-type" and "type 255" in e.text for e in made.rig.events())
        made.speed(100, 5)
        assert made.drive.state == "ENABLED"
    made = setup()
    made.drive.put(0x1400, 0, 1, 2)
    refuses(made.drive, 0x1400, READ_ONLY, lambda sub, data: sub == 2)
    with opened(made):
        assert "rpdo-type" not in made.codes()


@pytest.mark.parametrize("kind", [0, 240, 252, 255])
def test_a_tpdo_that_cannot_follow_every_sync_is_refused_by_its_type(kind: int) -> None:
    made = setup()
    for index in range(0x1800, 0x1804):
        made.counter.put(index, kind, 1, 2)
        refuses(made.counter, index, INVALID, lambda sub, data: sub == 2)
    with (
        pytest.raises(DriverError, match=rf"every SYNC; value transmission type {kind}") as caught,
        opened(made),
    ):
        pass
    assert "0x1800:2" in str(caught.value)


def test_bit_30_of_a_cob_id_stays_and_an_identifier_never_changes_while_the_pdo_exists() -> None:
    made = setup()
    words: list[int] = []

    def callback(index: int, subindex: int, od: Any, data: bytes) -> None:
        if (index, subindex) == (0x1800, 1):
            words.append(int.from_bytes(data, "little"))

    made.drive.node.add_write_callback(callback)
    with opened(made):
        assert words[:2] == [0xC0000181, 0x40000181]


def test_a_fixed_mapping_with_dummies_and_bits_is_read_as_it_lies() -> None:
    raw = ScriptedBus()
    device = RemoteDevice(PumpedBus(raw, VirtualClock()), 2)
    # Dummy U8, eight single bits, the position, a dummy U16.
    words = [0x00050008, *(0x20000001 | n << 8 for n in range(1, 9)), 0x60040020, 0x00060010]
    dictionary = {(0x1800, 1): (0x182, 4), (0x1800, 2): (1, 1), (0x1A00, 0): (len(words), 1)}
    dictionary |= {(0x1A00, i): (word, 4) for i, word in enumerate(words, 1)}
    serve(raw, dictionary)
    pdo = read_pdo(device, 1, is_transmit=True)
    assert pdo is not None
    assert (pdo.length, pdo.offset_of((0x6004, 0))) == (8, 2)
    dictionary[0x1A00, 0] = (4, 1)
    assert (
        read_pdo(device, 1, is_transmit=True) is None
    )  # three bits, and then a byte that starts within a byte


def serve(
    raw: ScriptedBus, dictionary: dict[tuple[int, int], tuple[int, int]], fixed: bool = False
) -> None:
    """The least SDO server: expedited uploads of a dictionary; every download is refused if `fixed`, else stored."""
    send = raw.send

    def answered(msg: Any) -> None:
        send(msg)
        data = bytes(msg.data)
        if msg.arbitration_id != 0x602:
            return
        key = (int.from_bytes(data[1:3], "little"), data[3])
        if key not in dictionary:
            raw.feed(0x582, b"\x80" + data[1:4] + (0x06020000).to_bytes(4, "little"))
        elif data[0] == 0x40:
            value, size = dictionary[key]
            head = bytes([0x43 | (4 - size) << 2])
            raw.feed(0x582, head + data[1:4] + value.to_bytes(size, "little").ljust(4, b"\0"))
        elif fixed and not (key[1] == 0 and key[0] >= 0x1A00) and key[1] != 1:
            raw.feed(0x582, b"\x80" + data[1:4] + READ_ONLY.to_bytes(4, "little"))
        else:
            size = dictionary[key][1]
            dictionary[key] = (int.from_bytes(data[4 : 4 + size], "little"), size)
            raw.feed(0x582, b"\x60" + data[1:4] + bytes(4))

    raw.send = answered  # type: ignore[method-assign]


def test_what_a_fixed_rpdo_carries_besides_set_points_keeps_its_value() -> None:
    """A vendor's RPDO1: controlword, target velocity, mode; RPDO2: target torque, max torque. Zeros would undo both."""
    made = setup()
    fixed = {
        0x1600: [0x60400010, 0x60FF0020, 0x60600008],
        0x1601: [0x60710010, 0x60720010, 0x00060010],
    }
    for index, words in fixed.items():
        made.drive.put(index, len(words), 1)
        for sub, word in enumerate(words, 1):
            made.drive.put(index, word, 4, sub)
    for index in (0x1600, 0x1601, 0x1602, 0x1603):
        refuses(made.drive, index, READ_ONLY)
    dictionary = made.drive.node.object_dictionary
    dictionary.add_object(_dummy())
    with opened(made):
        assert made.rig.write_limits(
            DriveLimits(0.5, 300.0, 1000.0, 1000.0, 2000.0)
        ).torque == pytest.approx(0.5, rel=2e-3)
        limit = made.drive.get(0x6072)
        assert limit > 700
        block = made.speed(477, 10)
        assert (made.drive.get(0x6060), made.drive.get(0x6061), made.drive.state) == (
            9,
            9,
            "ENABLED",
        )
        assert block.counts[-1, made.column("input_angle")] == 4770
        made.rig.exchange(Command(Mode.TORQUE, _zeros(5)), 5, Guard())
        assert (made.drive.get(0x6060), made.drive.get(0x6072)) == (10, limit)


def _dummy() -> Any:
    from canopen.objectdictionary import UNSIGNED16, ODVariable

    variable = ODVariable("dummy", 0x0006, 0)
    variable.data_type = UNSIGNED16
    return variable


@pytest.mark.parametrize("which", ["drive", "counter", "analog"])
def test_a_slave_that_insists_on_a_sync_with_counter_is_refused_in_clear_words(which: str) -> None:
    made = setup()
    peer = getattr(made, which)
    from canopen.objectdictionary import UNSIGNED8, ODVariable

    variable = ODVariable("SYNC counter", 0x1019, 0)
    variable.data_type = UNSIGNED8
    peer.node.object_dictionary.add_object(variable)
    peer.put(0x1019, 16, 1)
    refuses(peer, 0x1019, READ_ONLY)
    with pytest.raises(DriverError, match="insists on a SYNC with counter; value 16"), opened(made):
        pass


def test_entries_that_turn_out_fixed_are_put_back_and_used() -> None:
    raw = ScriptedBus()
    words = [0x65000010, 0x60040020]
    dictionary = {(0x1800, 1): (0x40000182, 4), (0x1800, 2): (1, 1), (0x1A00, 0): (2, 1)}
    dictionary |= {(0x1A00, i): (word, 4) for i, word in enumerate(words, 1)}
    serve(raw, dictionary, fixed=True)
    # The number of entries and the COB-ID can be written, the entries cannot.
    device = RemoteDevice(PumpedBus(raw, VirtualClock()), 2)
    refused = {(0x1A00, 1), (0x1A00, 2)}
    store = raw.send

    def send(msg: Any) -> None:
        data = bytes(msg.data)
        key = (int.from_bytes(data[1:3], "little"), data[3])
        if data[0] != 0x40 and key in refused:
            raw.feed(0x582, b"\x80" + data[1:4] + (0x06010002).to_bytes(4, "little"))
            return
        store(msg)

    raw.send = send  # type: ignore[method-assign]
    (pdo,) = map_objects(device, [ObjectRef(0x6004, 0, I32)], is_transmit=True)
    assert pdo.offset_of((0x6004, 0)) == 2
    assert dictionary[0x1A00, 0] == (2, 1)
    assert dictionary[0x1800, 1] == (0x40000182, 4)


def test_no_cob_id_is_invented_beyond_the_four_predefined_ones() -> None:
    text = (
        drive_eds(entries=1)
        + record(0x1804, "TPDO5", [("cob", 7, "rw", "0x80000000"), ("type", 5, "rw", "0xFE")])
        + record(0x1A04, "TPDO5 map", [("e1", 7, "rw", "0")])
    )
    made = setup(eds_text=text)
    with opened(made):
        used = [pdo.cob_id for pdo in made.rig.nodes.layout.pdos]
        assert len(set(used)) == len(used)


# The drive ----------------------------------------------------------------------------------------


def test_a_drive_without_0x6502_shows_its_modes_by_refusing_the_others() -> None:
    made = setup(eds_text=drive_eds().replace(MODES, ""))
    refuses(made.drive, 0x6060, INVALID, lambda sub, data: data[0] not in (3, 4))
    with opened(made):
        made.speed(100, 5)
        assert (made.drive.get(0x6060), made.drive.state) == (3, "ENABLED")
        assert "mode" in made.codes()


def test_a_mode_that_nobody_takes_is_an_error_and_leaves_the_servo_off() -> None:
    made = setup(eds_text=drive_eds().replace(MODES, ""))
    refuses(made.drive, 0x6060, INVALID)
    with opened(made):
        with pytest.raises(SdoAbortError, match="invalid value"):
            made.speed(100, 5)
        assert made.drive.state == "SOD"


def keeps_its_mode(drive: DrivePeer) -> None:
    """It changes its mode only while it is not enabled."""
    publish, shown = drive.publish, [0]

    def publish_its_mode() -> None:
        publish()
        if drive.state != "ENABLED":
            shown[0] = drive.get(0x6060)
        drive.put(0x6061, shown[0], 1)

    drive.publish = publish_its_mode  # type: ignore[method-assign]


@pytest.mark.parametrize("how", ["refuses", "ignores"])
def test_a_drive_that_changes_modes_only_while_disabled_is_disabled_for_it(how: str) -> None:
    made = setup()
    if how == "ignores":
        keeps_its_mode(made.drive)
    else:
        refuses(made.drive, 0x6060, NOT_NOW, lambda sub, data: made.drive.state == "ENABLED")
    with opened(made):
        made.rig.write_limits(DriveLimits(0.5, 300.0, 1000.0, 1000.0, 2000.0))
        made.speed(0, 5)
        assert made.drive.state == "ENABLED"
        block = made.rig.exchange(Command(Mode.TORQUE, _zeros(5)), 5, Guard())
        assert not block.flags.any()
        assert (made.drive.get(0x6061), made.drive.state) == (10, "ENABLED")


def _zeros(n: int) -> Any:
    import numpy as np

    return np.zeros(n)


def test_a_drive_that_its_panel_holds_says_so() -> None:
    clock = VirtualClock()
    raw = ScriptedBus()
    serve(raw, {(0x6040, 0): (0, 2), (0x6041, 0): (0x0050, 2)})
    drive = ServoAmplifier(PumpedBus(raw, clock), DriveConfig(node_id=2, state_timeout_ms=50))
    from drivers.bus.cia402 import tables as obj

    with pytest.raises(DriverError, match=r"does not listen to the bus \(remote, bit 9\)"):
        drive._walk(obj.TO_ENABLED, DriveState.ENABLED, "operation enabled")


# SDO ----------------------------------------------------------------------------------------------


def test_an_abort_in_the_middle_of_a_segmented_upload_names_the_object_or_nothing() -> None:
    for named in ("08 10 00", "00 00 00"):
        raw = ScriptedBus(
            [
                ("601 40 08 10 00 00 00 00 00", ["581 41 08 10 00 14 00 00 00"]),
                ("601 60 00 00 00 00 00 00 00", ["581 00 53 47 44 56 2D 4F 43"]),
                ("601 70 00 00 00 00 00 00 00", [f"581 80 {named} 00 00 04 05"]),
            ]
        )
        with pytest.raises(SdoAbortError, match="timed out") as caught:
            SdoClient(PumpedBus(raw, VirtualClock()), 1).upload(0x1008, 0)
        assert caught.value.code == 0x05040000
        raw.assert_finished()


def test_a_slow_server_whose_answer_comes_after_the_abort_spoils_nothing() -> None:
    raw = ScriptedBus()
    sdo = SdoClient(PumpedBus(raw, VirtualClock()), 1, 50_000_000)
    with pytest.raises(SdoTimeoutError):
        sdo.upload(0x6041, 0)
    assert raw.sent[-1] == (0x601, bytes.fromhex("80 41 60 00 00 00 04 05"))
    raw.feed(
        0x581, bytes.fromhex("4B 41 60 00 37 02 00 00")
    )  # too late, and of another object than the next
    raw.feed(0x581, bytes.fromhex("4B 40 60 00 06 00 00 00"))
    asked: list[bytes] = []
    send = raw.send

    def answer(msg: Any) -> None:
        asked.append(bytes(msg.data))
        send(msg)
        raw.feed(0x581, bytes.fromhex("4B 64 60 00 12 00 00 00"))

    raw.send = answer  # type: ignore[method-assign]
    assert sdo.read_as(0x6064, 0, U16) == 0x12
    assert len(asked) == 1


def test_numbers_in_segments_and_without_a_size_are_numbers() -> None:
    raw = ScriptedBus(
        [
            ("601 40 64 60 00 00 00 00 00", ["581 40 64 60 00 00 00 00 00"]),
            ("601 60 00 00 00 00 00 00 00", ["581 07 FE FF FF FF 00 00 00"]),
            ("601 40 41 60 00 00 00 00 00", ["581 42 41 60 00 37 02 00 00"]),
        ]
    )
    device = RemoteDevice(PumpedBus(raw, VirtualClock()), 1)
    assert device.read(ObjectRef(0x6064, 0, I32)) == -2
    assert device.read(ObjectRef(0x6041, 0, U16)) == 0x0237
    raw.assert_finished()
