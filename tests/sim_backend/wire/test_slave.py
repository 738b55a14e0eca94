"""NMT, boot-up, heartbeats, emergencies and process data of a slave, in frames (CiA 301)."""

from __future__ import annotations

import struct

import pytest

from sim_backend.wire.counter import Counter
from sim_backend.wire.slave import NmtState, Slave
from tests.sim_backend.wire.slaves import MS, Sent, analog, ask, counter, drive, start, sync, write

INVALID, NO_RTR = 0x80000000, 0x40000000


def nmt(slave, command: int, node_id: int | None = None, now: int = 0) -> None:
    slave.receive(0x000, bytes([command, slave.node_id if node_id is None else node_id]), now)


def test_boot_up_then_pre_operational() -> None:
    sent = Sent()
    slave = Counter(2, 72000, sent)
    slave.boot(0)
    assert sent == [(0x702, b"\0")]
    assert slave.state is NmtState.PRE_OPERATIONAL


@pytest.mark.parametrize(("command", "state"), [(1, 0x05), (2, 0x04), (0x80, 0x7F)])
def test_nmt_commands_show_in_the_heartbeat(command: int, state: int) -> None:
    slave, sent = counter()
    write(slave, sent, 0x1017, 0, 100, 2)
    nmt(slave, command, 0)
    sent.clear()
    slave.tick(slave.next_due_ns())
    assert (0x702, bytes([state])) in sent


def test_commands_for_others_are_not_obeyed() -> None:
    slave, _ = counter()
    nmt(slave, 1, 5)
    assert slave.state is NmtState.PRE_OPERATIONAL


def test_stopped_answers_no_sdo_and_sends_no_process_data() -> None:
    slave, sent = counter()
    start(slave)
    nmt(slave, 2)
    sent.clear()
    slave.receive(0x602, b"\x40\x00\x10\x00\0\0\0\0", 0)
    sync(slave)
    slave.emergency(0x7300)
    assert not sent


@pytest.mark.parametrize(("command", "stays"), [(0x81, False), (0x82, True)])
def test_resets_boot_again_with_defaults(command: int, stays: bool) -> None:
    slave, sent = drive()
    write(slave, sent, 0x1017, 0, 100, 2)
    write(slave, sent, 0x6083, 0, 77, 4)
    default = slave.dictionary.entry(0x6083, 0).default
    nmt(slave, command)
    assert sent.taken() == [(0x701, b"\0")]
    assert slave.dictionary.number(0x1017) == 0
    assert slave.dictionary.number(0x6083) == (77 if stays else default)


def test_heartbeats_keep_their_grid() -> None:
    slave, sent = counter()
    write(slave, sent, 0x1017, 0, 10, 2)
    beats = []
    for now in range(0, 100 * MS, MS):
        sent.clear()
        slave.tick(now)
        beats += [now // MS] * len(sent)
    assert beats == list(range(10, 100, 10))


def test_a_heartbeat_that_stays_away_is_an_emergency_once_and_recovers() -> None:
    slave, sent = counter()
    assert write(slave, sent, 0x1016, 1, 0x7F << 16 | 50, 4) == 0
    start(slave)
    slave.tick(500 * MS)
    assert not sent.taken()[1:], "monitoring begins with the first heartbeat"
    slave.receive(0x77F, b"\x05", 500 * MS)
    slave.tick(550 * MS)
    assert not sent.taken()
    assert slave.next_due_ns() == 550 * MS + 1
    slave.tick(551 * MS)
    slave.tick(600 * MS)
    assert sent.taken() == [(0x082, bytes.fromhex("30 81 11 7F 00 00 00 00"))]
    assert slave.state is NmtState.PRE_OPERATIONAL
    slave.receive(0x77F, b"\x05", 610 * MS)
    assert sent.taken() == [(0x082, bytes(8))]


def test_one_producer_is_watched_by_one_entry() -> None:
    slave, sent = counter()
    assert write(slave, sent, 0x1016, 1, 0x7F << 16 | 50, 4) == 0
    assert write(slave, sent, 0x1016, 2, 0x7F << 16 | 80, 4) == 0x06040043
    assert write(slave, sent, 0x1016, 1, 0x7F << 16 | 80, 4) == 0


@pytest.mark.parametrize(("behaviour", "state"), [(0, 0x7F), (1, 0x05), (2, 0x04)])
def test_error_behaviour(behaviour: int, state: int) -> None:
    slave, sent = counter()
    write(slave, sent, 0x1016, 1, 0x7F << 16 | 50, 4)
    write(slave, sent, 0x1029, 1, behaviour, 1)
    start(slave)
    slave.receive(0x77F, b"\x05", 0)
    slave.tick(60 * MS)
    assert slave.state == state


def test_emergencies_are_kept_latest_first_and_cleared_by_zero() -> None:
    slave, sent = drive()
    for code in range(0x1001, 0x100B):
        slave.emergency(code, 0x20, b"ab")
    assert sent.taken()[0] == (0x081, struct.pack("<HB", 0x1001, 0x21) + b"ab\0\0\0")
    assert ask(slave, sent, b"\x40\x03\x10\x00")[4] == 8
    assert ask(slave, sent, b"\x40\x03\x10\x01")[4:] == struct.pack("<I", 0x100A)
    assert ask(slave, sent, b"\x40\x03\x10\x08")[4:] == struct.pack("<I", 0x1003)
    assert write(slave, sent, 0x1003, 0, 0, 1) == 0
    assert ask(slave, sent, b"\x40\x03\x10\x01") == bytes.fromhex("80 03 10 01 24 00 00 08")
    slave.recover(0x1001)
    assert sent.taken()[-1] == (0x081, struct.pack("<HB5x", 0, 0x21)), (
        "other errors remain in the register"
    )
    slave.recover()
    assert sent.taken() == [(0x081, bytes(8))]


def test_an_emergency_message_can_be_switched_off_and_moved() -> None:
    slave, sent = drive()
    assert write(slave, sent, 0x1014, 0, 0x91, 4) == 0x06090030, "not while it exists"
    assert write(slave, sent, 0x1014, 0, INVALID | 0x91, 4) == 0
    sent.clear()
    slave.emergency(0x4310)
    assert not sent
    write(slave, sent, 0x1014, 0, 0x91, 4)
    sent.clear()
    slave.emergency(0x2310)
    assert sent[0][0] == 0x091


# Process data -------------------------------------------------------------------------------------------------------


def remap(slave, sent: Sent, words: list[int], number: int = 1, kind: int = 1) -> list[int]:
    """The standard's procedure; the abort codes of its steps."""
    comm, mapping, cob_id = (
        0x1800 + number - 1,
        0x1A00 + number - 1,
        slave.dictionary.number(0x1800 + number - 1, 1),
    )
    codes = [write(slave, sent, comm, 1, cob_id | INVALID, 4), write(slave, sent, mapping, 0, 0, 1)]
    codes += [write(slave, sent, mapping, i, word, 4) for i, word in enumerate(words, 1)]
    codes += [write(slave, sent, mapping, 0, len(words), 1), write(slave, sent, comm, 2, kind, 1)]
    return [*codes, write(slave, sent, comm, 1, cob_id & ~INVALID, 4)]


def test_the_mapping_changes_by_the_standards_procedure() -> None:
    slave, sent = counter()
    assert not any(remap(slave, sent, [0x65030010, 0x60040020]))
    slave.take(0x01020304, 0, 0)
    start(slave)
    sent.clear()
    sync(slave)
    assert sent[0] == (0x182, bytes.fromhex("00 00 04 03 02 01"))


OFF = ((0x1800, 1, INVALID | NO_RTR | 0x182, 4), (0x1A00, 0, 0, 1))
REFUSED = (
    ("while it exists", [(0x1A00, 0, 0, 1)], 0x08000022),
    ("slots while the count is not zero", [(0x1800, 1, INVALID | NO_RTR | 0x182, 4), (0x1A00, 1, 0x60040020, 4)], 0x08000022),  # noqa: E501
    ("an object that is not there", [*OFF, (0x1A00, 1, 0x70000008, 4)], 0x06020000),
    ("an object that may not be mapped", [*OFF, (0x1A00, 1, 0x60010020, 4)], 0x06040041),
    ("another length", [*OFF, (0x1A00, 1, 0x60040010, 4)], 0x06040041),
    ("another COB-ID while it exists", [(0x1800, 1, NO_RTR | 0x1A2, 4)], 0x06090030),
    ("a restricted COB-ID", [(0x1800, 1, INVALID | NO_RTR | 0x182, 4), (0x1800, 1, NO_RTR | 0x602, 4)], 0x06090030),
    ("remote frames", [(0x1800, 1, 0x182, 4)], 0x06090030),
    ("29-bit identifiers", [(0x1800, 1, INVALID | NO_RTR | 0x20000182, 4)], 0x06090030),
    ("reserved transmission types", [(0x1800, 2, 241, 1)], 0x06090030),
    ("transmission on remote frames", [(0x1800, 2, 253, 1)], 0x06090030),
    ("the inhibit time while it exists", [(0x1800, 3, 10, 2)], 0x08000022),
    ("sub-index 4", [(0x1800, 4, 0, 1)], 0x06090011),
    ("more than eight objects", [(0x1800, 1, INVALID | NO_RTR | 0x182, 4), (0x1A00, 0, 9, 1)], 0x06090031),
)  # fmt: skip


@pytest.mark.parametrize(("what", "writes", "code"), REFUSED, ids=[r[0] for r in REFUSED])
def test_refusals_of_the_mapping(
    what: str, writes: list[tuple[int, int, int, int]], code: int
) -> None:
    slave, sent = counter()
    codes = [write(slave, sent, *step) for step in writes]
    assert codes == [0] * (len(writes) - 1) + [code]


def test_more_than_eight_bytes_are_refused() -> None:
    slave, sent = counter()
    codes = remap(slave, sent, [0x60040020, 0x60040020, 0x65030010])
    assert codes[-3] == 0x06040042


@pytest.mark.parametrize("every", [1, 2, 3, 10, 240])
def test_transmission_types_1_to_240(every: int) -> None:
    slave, sent = counter()
    write(slave, sent, 0x1800, 2, every, 1)
    write(slave, sent, 0x1801, 1, INVALID | NO_RTR | 0x282, 4)
    start(slave)
    at = []
    for k in range(1, 500):
        sent.clear()
        sync(slave)
        at += [k] * len(sent)
    assert at == list(range(every, 500, every))


def test_type_0_is_sent_with_the_sync_after_an_event() -> None:
    slave, sent = drive()
    write(slave, sent, 0x1800, 2, 0, 1)
    start(slave)
    sent.clear()
    sync(slave)
    assert not sent
    write(slave, sent, 0x6040, 0, 0x06, 2)
    sent.clear()
    sync(slave)
    sync(slave)
    assert [cob for cob, _ in sent] == [0x181]


def test_the_event_timer_and_the_inhibit_time() -> None:
    slave, sent = drive()
    write(slave, sent, 0x1800, 1, INVALID | NO_RTR | 0x181, 4)
    for sub, value, size in ((2, 255, 1), (3, 50, 2), (5, 20, 2), (1, NO_RTR | 0x181, 4)):
        assert write(slave, sent, 0x1800, sub, value, size) == 0
    start(slave, 0)
    assert [cob for cob, _ in sent.taken() if cob == 0x181] == [0x181], (
        "once when it becomes operational"
    )
    at = []
    for now in range(0, 100 * MS, MS):
        slave.tick(now)
        at += [now // MS] * len(sent.taken())
    assert at == [20, 40, 60, 80]
    # Two events within the inhibit time of 5 ms: one frame at once, one when the time is over.
    for word, now in ((0x06, 90), (0x07, 91)):
        slave.receive(0x601, struct.pack("<BHBHH", 0x2B, 0x6040, 0, word, 0), now * MS)
    assert [cob for cob, _ in sent.taken() if cob == 0x181] == [0x181]
    assert slave.next_due_ns() == 95 * MS
    slave.tick(95 * MS)
    assert [cob for cob, _ in sent.taken()] == [0x181]


def test_rpdos_act_at_the_sync_or_at_once() -> None:
    slave, sent = drive()
    write(slave, sent, 0x1400, 2, 1, 1)
    start(slave)
    slave.receive(0x201, struct.pack("<Hib", 6, 1234, 9), 0)
    assert slave.dictionary.number(0x60FF) == 0
    sync(slave)
    assert (slave.dictionary.number(0x60FF), slave.dictionary.number(0x6060)) == (1234, 9)
    write(slave, sent, 0x1400, 2, 255, 1)
    slave.receive(0x201, struct.pack("<Hib", 6, 4321, 9), 0)
    assert slave.dictionary.number(0x60FF) == 4321


def test_rpdos_of_a_wrong_length() -> None:
    slave, sent = drive()
    start(slave)
    sent.clear()
    slave.receive(0x201, bytes(6), 0)
    slave.receive(0x201, bytes(6), 0)
    assert sent.taken() == [(0x081, bytes.fromhex("10 82 11 00 00 00 00 00"))], "told once"
    slave.receive(0x201, struct.pack("<Hib", 0, 5, 0) + b"x", 0)
    assert sent.taken() == [(0x081, bytes.fromhex("20 82 11 00 00 00 00 00"))]
    sync(slave)
    assert slave.dictionary.number(0x60FF) == 5, "a longer one is taken"
    sent.clear()
    slave.receive(0x201, struct.pack("<Hib", 0, 6, 0), 0)
    assert sent.taken() == [(0x081, bytes(8))]


def test_dummy_objects_fill_gaps_of_an_rpdo() -> None:
    slave, sent = drive()
    write(slave, sent, 0x1401, 1, INVALID | 0x301, 4)
    write(slave, sent, 0x1601, 0, 0, 1)
    assert write(slave, sent, 0x1601, 1, 0x00050010, 4) == 0x06040041, "UNSIGNED8 has 8 bits"
    for step in (
        (0x1601, 1, 0x00050008, 4),
        (0x1601, 2, 0x60710010, 4),
        (0x1601, 0, 2, 1),
        (0x1401, 1, 0x301, 4),
    ):
        assert write(slave, sent, *step) == 0
    start(slave)
    slave.receive(0x301, b"\xee" + struct.pack("<h", -55), 0)
    sync(slave)
    assert slave.dictionary.number(0x6071) == -55


def test_process_data_only_when_operational() -> None:
    for make in (drive, counter, analog):
        slave, sent = make()
        sync(slave)
        assert not sent


def test_the_sync_counter_overflow_changes_only_without_a_cycle_period() -> None:
    slave, sent = counter()
    assert write(slave, sent, 0x1006, 0, 1000, 4) == 0
    assert write(slave, sent, 0x1019, 0, 10, 1) == 0x08000022
    assert write(slave, sent, 0x1006, 0, 0, 4) == 0
    assert write(slave, sent, 0x1019, 0, 10, 1) == 0


LATE = bytes.fromhex("00 81 11 00 00 00 00 00")
GONE_BY = bytes(8)


def supervised(behaviour: int = 0) -> tuple[Slave, Sent]:
    """A counter that is OPERATIONAL and supervises a SYNC of 1 ms, none of which it has heard yet."""
    slave, sent = counter()
    write(slave, sent, 0x1006, 0, 1000, 4)
    write(slave, sent, 0x1029, 1, behaviour, 1)
    start(slave)
    sent.clear()
    return slave, sent


@pytest.mark.parametrize(
    ("behaviour", "state"),
    [(0, NmtState.PRE_OPERATIONAL), (1, NmtState.OPERATIONAL), (2, NmtState.STOPPED)],
)
def test_a_supervised_sync_that_stays_away_is_an_error_of_the_communication(
    behaviour: int, state: NmtState
) -> None:
    slave, sent = supervised(behaviour)
    slave.tick(1000 * MS)
    assert not sent, "no SYNC has been heard yet"
    sync(slave, 1000 * MS)
    assert slave.next_due_ns() == 1001 * MS + MS // 2
    sent.clear()
    slave.tick(1001 * MS)
    assert not sent
    slave.tick(1002 * MS)
    assert sent.taken() == [(0x082, LATE)]
    assert slave.state is state
    slave.tick(2000 * MS)
    assert not sent, "told once"


def test_a_sync_that_comes_late_is_noticed_when_it_comes_and_ends_the_error() -> None:
    slave, sent = supervised(behaviour=1)
    sync(slave, 0)
    sent.clear()
    sync(slave, 2 * MS)
    assert sent.taken()[:2] == [(0x082, LATE), (0x082, GONE_BY)]


def test_without_a_period_no_sync_is_supervised() -> None:
    slave, sent = supervised()
    sync(slave, 0)
    write(slave, sent, 0x1006, 0, 0, 4)
    slave.tick(1000 * MS)
    assert not sent.taken()
    assert slave.state is NmtState.OPERATIONAL
