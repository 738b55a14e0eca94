"""Strangers on the bus: what is ours is never called foreign, what is foreign is named within its cycles."""

from __future__ import annotations

import pytest

from drivers.bus.cia301 import I16, U16, NmtState, ObjectRef
from drivers.bus.frames import CycleStore, Field, FrameLayout
from drivers.bus.network import PumpedBus
from drivers.bus.pdo import MappedPdo
from drivers.bus.strangers import (
    FOREIGN_COMMAND,
    FOREIGN_SYNC,
    FOREIGN_TPDO,
    RULES,
    SETTLED_CYCLES,
    WINDOW_NS,
    Strangers,
)
from drivers.channel import Channel
from drivers.clock import VirtualClock
from drivers.judge import CycleJudge
from drivers.port import Bound, Command, Guard, Mode
from drivers.python_can import can
from drivers.samples import CycleFlag
from tests.drivers.can_bench import Setup, close, setup
from tests.drivers.scripted_bus import ScriptedBus

STATUS, INPUT = ObjectRef(0x6041, 0, U16, "status"), ObjectRef(0x6401, 1, I16, "input")
SLOTS = (
    MappedPdo(1, True, 1, 0x181, 1, (STATUS,)),
    MappedPdo(3, True, 1, 0x183, 1, (INPUT,)),
)
LAYOUT = FrameLayout(SLOTS, [Field("status", 0, 0, U16), Field("input", 1, 0, I16)])
COMMAND = 0x201


class Line:
    """Cycles of two nodes, and the strangers among what is heard."""

    def __init__(self, *, echoes: bool = True) -> None:
        self.clock, self.told = VirtualClock(), list[tuple[str, str, str]]()
        self.store = CycleStore(LAYOUT)
        self.strangers = Strangers(self.store, self.clock, self.tell, [COMMAND], echoes=echoes)
        self.hears = self.strangers.listener(0)
        self.store.begin_block(4096)
        self.strangers.begin()

    def tell(self, level: str, code: str, source: str, text: str) -> None:
        self.told.append((level, code, text))

    @property
    def codes(self) -> list[tuple[str, str]]:
        """Level and code of what was told."""
        return [(level, code) for level, code, _ in self.told]

    def send(self, command: bytes = b"\x0f\x00\x01") -> None:
        self.strangers.sends([command])
        self.store.begin_cycle(False)

    def answer(self, *slots: int) -> None:
        for slot in slots or (0, 1):
            self.store.put(slot, b"\1\0", 1)

    def close(self) -> None:
        self.strangers.close_cycle(self.store.end_cycle())
        self.clock.advance_ns(1_000_000)

    def cycle(self, command: bytes = b"\x0f\x00\x01", *, echo: bool = True) -> None:
        """A cycle as it should be."""
        self.send(command)
        if echo:
            self.hears(command, 1)
            assert self.strangers.sync_heard()
        self.answer()
        self.close()


# SYNC -----------------------------------------------------------------------------------------------------------------


def test_as_many_syncs_as_were_sent_are_ours_and_the_next_is_not() -> None:
    line = Line()
    for _ in range(5):
        line.cycle()
    assert line.told == []
    assert not line.strangers.sync_heard()
    assert line.codes == [("warning", FOREIGN_SYNC)]


def test_syncs_that_come_back_late_are_ours() -> None:
    line = Line()
    for _ in range(3):
        line.cycle(echo=False)
    assert [line.strangers.sync_heard() for _ in range(4)] == [True, True, True, False]


def test_where_nothing_comes_back_every_sync_is_a_strangers() -> None:
    line = Line(echoes=False)
    line.cycle(echo=False)
    assert [line.strangers.sync_heard() for _ in range(4)] == [False] * 4
    assert line.codes == [("warning", FOREIGN_SYNC)] * 2 + [("error", FOREIGN_SYNC)]


def test_a_sync_that_never_came_back_hides_a_stranger_for_fifty_cycles_and_no_longer() -> None:
    line = Line()
    line.cycle(echo=False)
    for _ in range(SETTLED_CYCLES):
        line.cycle()
    assert not line.strangers.sync_heard()


@pytest.mark.parametrize(("gap_ns", "level"), [(WINDOW_NS, "warning"), (WINDOW_NS // 2, "error")])
def test_three_within_the_window_end_the_run(gap_ns: int, level: str) -> None:
    line = Line()
    line.strangers.sync_heard()
    line.clock.advance_ns(1_000_000)
    line.strangers.sync_heard()
    line.clock.advance_ns(gap_ns)
    line.strangers.sync_heard()
    assert line.codes[-1][0] == level
    assert "3 end a run" in line.told[-1][2]


def test_what_goes_on_is_told_once_and_anew_after_a_quiet_window() -> None:
    line = Line()
    for _ in range(5000):
        line.strangers.sync_heard()
        line.clock.advance_ns(10_000_000)
    assert [level for level, _ in line.codes] == ["warning", "warning", "error"]
    line.clock.advance_ns(2 * WINDOW_NS)
    line.strangers.sync_heard()
    assert line.codes[-1] == ("warning", FOREIGN_SYNC)


# Process data ---------------------------------------------------------------------------------------------------------


def test_the_third_cycle_with_a_second_frame_ends_the_run() -> None:
    line = Line()
    for cycle in range(12):
        line.send()
        line.answer()
        if cycle % 4 == 0:
            line.answer(1)
        line.close()
    assert line.codes == [("warning", FOREIGN_TPDO)] * 2 + [("error", FOREIGN_TPDO)]
    assert "0x183" in line.told[-1][2]


def test_two_nodes_doubled_in_one_cycle_are_one() -> None:
    line = Line()
    line.send()
    line.answer(0, 1, 0, 1)
    line.close()
    assert line.codes == [("warning", FOREIGN_TPDO)]


@pytest.mark.parametrize("missing", [1, 5, 20])
def test_answers_that_come_too_late_are_nobody_elses(missing: int) -> None:
    line = Line()
    for _ in range(missing):
        line.send()
        line.answer(0)
        line.close()
    line.send()
    line.answer(*[1] * (missing + 1), 0)
    line.close()
    assert line.told == []
    line.send()
    line.answer(0, 1, 1)
    line.close()
    assert line.codes == [("warning", FOREIGN_TPDO)]


def test_answers_that_were_lost_hide_a_stranger_for_fifty_cycles_and_no_longer() -> None:
    line = Line()
    for _ in range(3):
        line.send()
        line.answer(0)
        line.close()
    for _ in range(SETTLED_CYCLES):
        line.cycle()
    line.send()
    line.answer(0, 1, 1)
    line.close()
    assert line.codes == [("warning", FOREIGN_TPDO)]


def test_what_the_nodes_answer_to_a_strangers_sync_is_the_syncs() -> None:
    line = Line()
    for _ in range(3):
        line.send()
        assert line.strangers.sync_heard()
        line.strangers.sync_heard()
        line.answer(0, 1, 0, 1)
        line.close()
    assert {code for _, code in line.codes} == {FOREIGN_SYNC}


def test_what_came_before_the_first_sync_is_nobodys() -> None:
    store = CycleStore(LAYOUT)
    for _ in range(5):
        store.put(0, b"\1\0", 1)
    told: list[str] = []
    strangers = Strangers(
        store, VirtualClock(), lambda *event: told.append(event[1]), [COMMAND], echoes=True
    )
    store.begin_block(1)
    strangers.begin()
    store.begin_cycle(False)
    store.put(0, b"\1\0", 1)
    store.put(1, b"\1\0", 1)
    strangers.close_cycle(store.end_cycle())
    assert told == []


def test_a_cycle_with_two_frames_of_one_node_breaks_no_bound() -> None:
    """Of two values nobody knows which one is true."""
    judge = CycleJudge([Channel(name="torque", unit="N m", scale=1.0)])
    judge.adopt(Guard((Bound(cause="over_torque", weights={"torque": 1.0}, high=5.0),)))
    assert judge.judge([9], CycleFlag.DOUBLED, 0) is None
    broken = judge.judge([9], CycleFlag.COMPLETE, 1)
    assert broken is not None
    assert broken.row == 1


# Commands -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("echoes", [True, False])
def test_a_command_that_is_not_in_force_ends_the_run_at_the_first(echoes: bool) -> None:
    line = Line(echoes=echoes)
    line.cycle(echo=echoes)
    line.hears(b"\x0f\x00\x01", 1)
    assert line.told == []
    line.hears(b"\x06\x00\x01", 1)
    assert line.codes == [("error", FOREIGN_COMMAND)]
    assert "06 00 01, in force is 0f 00 01" in line.told[0][2]
    line.hears(b"\x06\x00\x01", 1)
    assert len(line.told) == 1


def test_a_command_of_ours_that_comes_back_late_is_ours_and_an_old_one_is_not() -> None:
    line = Line()
    first, second = b"\x0f\x00\x01", b"\x0f\x00\x02"
    line.cycle(first, echo=False)
    line.send(second)
    line.hears(first, 1)
    line.strangers.sync_heard()
    line.hears(second, 1)
    line.strangers.sync_heard()
    line.answer()
    line.close()
    assert line.told == []
    # Everything has come back: who says the first one now is somebody else.
    line.hears(first, 1)
    assert line.codes == [("error", FOREIGN_COMMAND)]


def test_a_command_before_the_first_of_ours_is_a_strangers() -> None:
    line = Line()
    line.hears(b"\x0f\x00", 1)
    assert "in force is nothing" in line.told[0][2]


def test_the_watchdogs_quick_stop_is_ours_with_its_sync_and_what_the_nodes_answer() -> None:
    for echoes in (True, False):
        line = Line(echoes=echoes)
        line.cycle(echo=echoes)
        line.strangers.announce([(COMMAND, b"\x02\x00\x00")])
        line.hears(b"\x02\x00\x00", 1)
        assert line.strangers.sync_heard()
        line.answer()
        line.cycle(echo=echoes)
        assert line.told == []
        assert not line.strangers.sync_heard()


# On a bus -------------------------------------------------------------------------------------------------------------


def turned_with(at: set[int], frame: tuple[int, bytes], length: int) -> tuple[int, str, list[str]]:
    """Rows until the break, its cause and the events, when a frame of a stranger comes right before the SYNCs `at`."""
    made = setup()
    made.rig.open()
    step, cob_id, data = made.drive.step, *frame

    def with_stranger() -> None:
        step()
        if made.drive.syncs in at:
            made.counter.bus.send(
                can.Message(arbitration_id=cob_id, data=data, is_extended_id=False)
            )

    made.drive.step = with_stranger  # type: ignore[method-assign]
    rows, cause = 0, ""
    while rows < 120 and not cause:
        block = made.speed(300, min(length, 120 - rows))
        rows += len(block)
        cause = block.broken.cause if block.broken is not None else ""
    codes = [code for code in made.codes() if code.startswith("foreign")]
    close(made)
    return rows, cause, codes


@pytest.mark.parametrize(
    ("cob_id", "data", "at", "cause", "within"),
    [
        (0x080, b"", {30, 40, 50}, "foreign_sync", 52),
        (0x080, b"", {30, 40}, "", 120),
        (0x182, bytes(4), {30, 31, 50}, "foreign_tpdo", 52),
        (0x182, bytes(4), {30, 31}, "", 120),
        (0x201, b"\x06\x00\x00\x00\x00\x00", {30}, "foreign_command", 32),
    ],
)
def test_a_stranger_is_named_in_the_same_cycle_whatever_the_length_of_a_block(
    cob_id: int, data: bytes, at: set[int], cause: str, within: int
) -> None:
    rows, found, codes = turned_with(at, (cob_id, data), 100)
    assert found == cause
    assert len(codes) == len(at)
    assert rows <= within
    for length in (1, 7, 1000):
        assert turned_with(at, (cob_id, data), length) == (rows, found, codes)


def test_a_watchdog_on_a_handle_of_its_own_is_no_stranger(bench: Setup) -> None:
    bench.speed(300, 20)
    handle = bench.counter.bus
    for cob_id, data in bench.rig.quick_stop_frames():
        handle.send(can.Message(arbitration_id=cob_id, data=data, is_extended_id=False))
    block = bench.rig.exchange(Command(Mode.QUICK_STOP), 20, Guard())
    assert block.broken is None
    assert not [code for code in bench.codes() if code.startswith("foreign")]


def test_a_mode_that_was_changed_while_the_servo_was_off_is_given_again(bench: Setup) -> None:
    bench.speed(300, 5)
    bench.rig.exchange(Command(Mode.OFF), 5, Guard())
    given = bench.drive.get(0x6061)
    assert "mode" not in bench.codes()
    bench.drive.put(0x6060, 4, 1)
    bench.drive.put(0x6061, 4, 1)
    block = bench.speed(300, 20)
    assert block.broken is None
    assert bench.drive.get(0x6060) == given
    assert "mode" in bench.codes()


def test_whether_a_bus_hands_back_what_was_sent_shows_with_the_first_request() -> None:
    raw = ScriptedBus()
    bus = PumpedBus(raw, VirtualClock())
    request = bytes.fromhex("4041600000000000")
    bus.send(0x601, request)
    # A SYNC or a heartbeat that somebody else sends says nothing of it.
    raw.feed(0x080, b"")
    raw.feed(0x700 + bus.own_node_id, bytes([NmtState.OPERATIONAL.value]))
    bus.drain()
    assert not bus.echoes
    raw.feed(0x601, request)
    bus.drain()
    assert bus.echoes


def test_every_kind_of_stranger_has_a_rule() -> None:
    assert {code: rule.ends_at for code, rule in RULES.items()} == {
        FOREIGN_SYNC: 3,
        FOREIGN_TPDO: 3,
        FOREIGN_COMMAND: 1,
    }
