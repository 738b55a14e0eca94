"""The simulated slaves before a master of another CANopen stack: every object of their EDS, and every service."""

from __future__ import annotations

import struct
from collections.abc import Iterator

import canopen
import pytest
from canopen.objectdictionary import ODVariable
from canopen.profiles.p402 import BaseNode402

from drivers.bus.dictionary.eds import parse_eds
from drivers.drive_state import DriveState
from sim_backend.wire.bench import WireBench
from sim_backend.wire.eds import electronic_data_sheet
from sim_backend.world import World
from tests.sim_backend.rigs import GEAR, MOTOR
from tests.sim_backend.wire.master import MAKERS, abort_of, master

READ_ONLY, NO_OBJECT, NO_SUB, NOT_NOW, NO_DATA = (
    0x06010002,
    0x06020000,
    0x06090011,
    0x08000022,
    0x08000024,
)
TOO_LONG, TOO_SHORT, BAD_VALUE, TOO_HIGH, TOO_LOW, BAD_COMMAND = (
    0x06070012,
    0x06070013,
    0x06090030,
    0x06090031,
    0x06090032,
    0x05040001,
)
TIED = {0x1019, *range(0x1600, 0x1800), *range(0x1A00, 0x1C00)}
"""Objects that change only while the PDO does not exist, or while there is no cycle period."""


def variables(remote: canopen.RemoteNode) -> Iterator[ODVariable]:
    for index, entry in remote.object_dictionary.items():
        if index >= 0x1000:
            yield from [entry] if isinstance(entry, ODVariable) else entry.values()


def is_tied(variable: ODVariable) -> bool:
    is_inhibit_time = 0x1800 <= variable.index < 0x1A00 and variable.subindex == 3
    return variable.index in TIED or is_inhibit_time


@pytest.mark.parametrize("name", MAKERS)
def test_every_object_of_the_eds_is_what_sdo_answers(name: str) -> None:
    """Value, length, access, limits and wrong sub-indices of every entry."""
    remote = master(name).remote
    for variable in variables(remote):
        where, key = (
            f"0x{variable.index:04X}:{variable.subindex}",
            (variable.index, variable.subindex),
        )
        if variable.index == 0x1003 and variable.subindex:
            assert abort_of(lambda key=key: remote.sdo.upload(*key)) == NO_DATA, where
            continue
        data = remote.sdo.upload(*key)
        found = data.decode() if variable.data_type == 0x09 else variable.decode_raw(data)
        assert found == variable.default or key == (0x60B9, 0), where
        assert abort_of(lambda key=key: remote.sdo.upload(key[0], 0xEE)) == NO_SUB, where
        if "w" not in variable.access_type:
            assert (
                abort_of(lambda key=key, data=data: remote.sdo.download(*key, data)) == READ_ONLY
            ), where
            continue

        def written(data: bytes, key: tuple[int, int] = key) -> int:
            return abort_of(lambda: remote.sdo.download(*key, data))

        assert written(data) in ((0, NOT_NOW) if is_tied(variable) else (0,)), where
        assert written(data + b"\0") == TOO_LONG, where
        assert written(data + bytes(8)) == TOO_LONG, where
        assert len(data) == 1 or written(data[:-1]) == TOO_SHORT, where
        for limit, step, code in ((variable.min, -1, TOO_LOW), (variable.max, 1, TOO_HIGH)):
            if limit is not None and not (
                limit == 0 and step < 0 and variable.data_type in (0x05, 0x06, 0x07)
            ):
                assert (
                    written((limit + step).to_bytes(len(data), "little", signed=limit + step < 0))
                    == code
                ), where


@pytest.mark.parametrize("name", MAKERS)
@pytest.mark.parametrize("node_id", [1, 42])
def test_the_eds_has_no_defects_and_serves_every_node_id(name: str, node_id: int) -> None:
    slave, _ = MAKERS[name]()
    text = electronic_data_sheet(slave.dictionary, product=name, vendor="nobody", vendor_number=0)
    described = parse_eds(text, node_id)
    assert described.defects == ()
    assert (described.entries[0x1800, 1].default, described.entries[0x1014, 0].default) in (
        (0x4000_0180 + node_id, 0x80 + node_id),
        (0xC000_0180 + node_id, 0x80 + node_id),
    )


@pytest.mark.parametrize("name", MAKERS)
def test_what_it_does_not_have_is_refused_by_its_name(name: str) -> None:
    remote = master(name).remote
    for index in (0x0001, 0x1010, 0x1011, 0x100C, 0x2FFF, 0x67FF, 0xFFFF):
        assert abort_of(lambda index=index: remote.sdo.upload(index, 1)) == NO_OBJECT
        assert abort_of(lambda index=index: remote.sdo.download(index, 1, b"save")) == NO_OBJECT


# SDO ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [None, 4])
def test_segments_in_both_directions(size: int | None) -> None:
    sdo = master("drive").remote.sdo
    with sdo.open(0x60FF, 0, "wb", size=size, force_segment=True) as file:
        file.write(struct.pack("<i", -5))
    assert sdo[0x60FF].raw == -5
    assert sdo[0x1008].raw == "Simulated servo amplifier"


def test_block_transfer_is_refused_and_leaves_everything_as_it_was() -> None:
    remote = master("drive").remote
    remote.sdo[0x60FF].raw = 7

    def upload() -> None:
        with remote.sdo.open(0x1008, 0, "rb", block_transfer=True) as file:
            file.read()

    assert abort_of(upload) == BAD_COMMAND
    assert (
        abort_of(lambda: remote.sdo.open(0x60FF, 0, "wb", size=4, block_transfer=True))
        == BAD_COMMAND
    )
    assert remote.sdo[0x60FF].raw == 7


@pytest.mark.parametrize(
    ("requests", "answer"),
    [
        (["40 08 10 00", "70"], "80 08 10 00 00 00 03 05"),
        (["60"], "80 00 00 00 01 00 04 05"),
        (["00"], "80 00 00 00 01 00 04 05"),
        (["E0 FF 60"], "80 00 00 00 01 00 04 05"),
        (["40 08 10 00", "80 08 10 00", "60"], "80 00 00 00 01 00 04 05"),
        (["40 08 10 00", "40 00 10 00"], "43 00 10 00 92 01 02 00"),
        (["22 40 60 00 06"], "60 40 60 00 00 00 00 00"),
        (["21 FF 60 00 05"], "80 FF 60 00 12 00 07 06"),
        (["21 00 10 00 04"], "80 00 10 00 02 00 01 06"),
        (["21 FF 60 00 04", "0B 01 02"], "80 FF 60 00 10 00 07 06"),
        (["2F FF 60 00 01"], "80 FF 60 00 13 00 07 06"),
        (["80 08 10 00"], ""),
        (["A0 08 10 00 7F"], "80 08 10 00 01 00 04 05"),
    ],
)
def test_transfers_that_go_wrong(requests: list[str], answer: str) -> None:
    m = master("drive")
    for request in requests:
        m.frames.clear()
        m.send_message(0x601, bytes.fromhex(request).ljust(8, b"\0"))
    assert [data.hex(" ").upper() for cob_id, data in m.frames if cob_id == 0x581] == (
        [answer] if answer else []
    )


# NMT, heartbeat, resets ---------------------------------------------------------------------------


def test_every_nmt_command_shows_in_the_heartbeat_and_the_period_changes_at_once() -> None:
    m = master("drive")
    remote = m.remote
    remote.sdo[0x1017].raw = 10
    for state in ("OPERATIONAL", "STOPPED", "PRE-OPERATIONAL", "OPERATIONAL"):
        remote.nmt.state = state
        m.pass_time(11)
        assert remote.nmt.state == state
    remote.sdo[0x1017].raw = 50
    assert len([f for f in m.pass_time(200) if f[0] == 0x701]) == 4
    remote.sdo[0x1017].raw = 0
    assert m.pass_time(200) == []


@pytest.mark.parametrize(("command", "keeps"), [("RESET COMMUNICATION", True), ("RESET", False)])
def test_resets_boot_and_bring_the_pdos_back(command: str, keeps: bool) -> None:
    m = master("drive")
    remote = m.remote
    remap(remote, 3)
    remote.sdo[0x6083].raw, remote.sdo[0x1017].raw = 555, 100
    m.frames.clear()
    remote.nmt.state = command
    assert m.frames == [(0x701, b"\0")]
    assert [remote.sdo[0x1A00][i].raw for i in range(4)] == [3, 0x60410010, 0x60640020, 0x60770010]
    assert (remote.sdo[0x1800][2].raw, remote.sdo[0x1017].raw) == (1, 0)
    assert (remote.sdo[0x6083].raw == 555) == keeps


# Process data -------------------------------------------------------------------------------------


def remap(remote: canopen.RemoteNode, kind: int, **timers: int) -> None:
    """Statusword and velocity into TPDO1, by canopen's own procedure."""
    remote.tpdo.read()
    pdo = remote.tpdo[1]
    pdo.clear()
    pdo.add_variable(0x6041)
    pdo.add_variable(0x606C)
    pdo.trans_type, pdo.enabled = kind, True
    for timer, value in timers.items():
        setattr(pdo, timer, value)
    pdo.save()


@pytest.mark.parametrize(
    ("kind", "frames"), [(0, 1), (1, 480), (3, 160), (240, 2), (254, 1), (255, 1)]
)
def test_transmission_types_of_a_pdo_that_was_mapped_anew(kind: int, frames: int) -> None:
    m = master("drive")
    remap(m.remote, kind)
    m.remote.nmt.state = "OPERATIONAL"
    m.frames.clear()
    m.slave.value_changed(0x6041)
    for _ in range(480):
        m.sync_once()
    heard = [data for cob_id, data in m.frames if cob_id == 0x181]
    assert len(heard) == frames
    assert {len(data) for data in heard} == {6}
    assert m.remote.tpdo[1][0].raw & 0x6F == 0x40


def test_event_timer_and_inhibit_time() -> None:
    m = master("drive")
    remap(m.remote, 254, event_timer=20, inhibit_time=300)
    m.remote.nmt.state = "OPERATIONAL"
    assert len([f for f in m.pass_time(299) if f[0] == 0x181]) == 9  # 30 ms are the least, not 20
    m.remote.nmt.state = "PRE-OPERATIONAL"
    assert m.pass_time(100) == []


def test_a_pdo_that_exists_or_an_identifier_that_is_not_allowed_is_refused() -> None:
    sdo = master("drive").remote.sdo
    assert abort_of(lambda: sdo.download(0x1A00, 0, b"\0")) == NOT_NOW
    for word in (0x181, 0x60000181, 0x40000080, 0x40000601, 0x40000182):
        assert (
            abort_of(lambda word=word: sdo.download(0x1800, 1, struct.pack("<I", word)))
            == BAD_VALUE
        ), hex(word)
    for kind in (241, 251, 252, 253):
        assert abort_of(lambda kind=kind: sdo.download(0x1800, 2, bytes([kind]))) == BAD_VALUE


def test_a_sync_of_another_identifier_is_followed() -> None:
    bench = WireBench(GEAR, MOTOR, world=World.of(1))
    heard: list[int] = []
    bench.listen(object(), lambda cob_id, data, stamp: heard.append(cob_id))
    for node_id, identifier in ((1, 0x81), (2, 0x80), (3, 0x90)):
        bench.send(0x600 + node_id, struct.pack("<BHBI", 0x23, 0x1005, 0, identifier))
    bench.send(0x603, struct.pack("<BHBBxxx", 0x2F, 0x1801, 2, 1))
    bench.send(0x000, b"\1\0")
    heard.clear()
    for identifier, follows in ((0x81, 0x181), (0x80, 0x182), (0x90, 0x283)):
        bench.send(identifier, b"")
        assert heard
        assert {cob & 0x7F for cob in heard if cob > 0x100} == {follows & 0x7F}
        heard.clear()


# Emergencies and the drive ------------------------------------------------------------------------


def test_emergencies_their_history_and_the_error_register() -> None:
    m = master("drive")
    remote = m.remote
    m.slave.fault(0x4310)  # type: ignore[attr-defined]
    m.hand_on()
    (active,) = remote.emcy.active
    assert (active.code, active.register) == (0x4310, remote.sdo[0x1001].raw)
    assert (remote.sdo[0x1003][0].raw, remote.sdo[0x1003][1].raw & 0xFFFF) == (1, 0x4310)
    assert abort_of(lambda: remote.sdo.upload(0x1003, 2)) == NO_DATA
    assert abort_of(lambda: remote.sdo.download(0x1003, 0, b"\1")) == BAD_VALUE
    remote.sdo[0x1003][0].raw = 0
    assert abort_of(lambda: remote.sdo.upload(0x1003, 1)) == NO_DATA
    remote.sdo[0x6040].raw = 0x80
    m.hand_on()
    assert remote.emcy.active == []
    assert remote.sdo[0x1001].raw == 0


def test_the_drive_obeys_another_stacks_cia_402_profile_with_its_own_pdos() -> None:
    m = master("drive")
    dictionary = m.remote.object_dictionary
    del m[1]
    node = BaseNode402(1, dictionary)
    m.add_node(node)
    m.notify(0x701, bytearray(b"\0"), 0.0)
    node.setup_402_state_machine()
    node.nmt.state = "OPERATIONAL"
    seen = []
    for word in (0x06, 0x07, 0x0F, 0x02):
        node.controlword = word
        m.sync_once()
        seen.append(node.state)
    assert seen == ["READY TO SWITCH ON", "SWITCHED ON", "OPERATION ENABLED", "QUICK STOP ACTIVE"]
    m.slave.fault(0x2310)  # type: ignore[attr-defined]
    m.sync_once()
    assert node.is_faulted() or m.slave.drive_state is DriveState.FAULT_REACTION  # type: ignore[attr-defined]
