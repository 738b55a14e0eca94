"""The rig on a bus in trouble: faults, silence, lost and stray frames, an unplugged adapter;
nothing wrong goes unmarked.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.channel import (
    INPUT_ANGLE,
    OUTPUT_ANGLE,
    STATUSWORD,
)
from drivers.errors import BusLostError, DriverError, StaleDataError
from drivers.port import Ask, Bound, Command, Guard, Mode, Reach, Request
from drivers.python_can import can
from drivers.samples import CycleFlag
from tests.drivers.can_bench import Setup, close, setup


def test_the_guard_ends_the_block_at_the_first_cycle_that_breaks_it(bench: Setup) -> None:
    guard = Guard((Bound(cause="travel", weights={INPUT_ANGLE: 1.0}, high=1000.0),))
    block = bench.speed(300, 50, guard)
    assert len(block) == 4
    assert block.broken is not None
    assert (block.broken.row, block.broken.cause, block.broken.value) == (3, "travel", 1200.0)
    assert bench.drive.syncs == 4  # not one set-point more was sent
    assert bench.speed(0, 2).first_cycle == 4


def test_a_fault_ends_the_block_and_there_is_no_automatic_restart(bench: Setup) -> None:
    bench.speed(300, 5)
    bench.drive.fail(0x8611)
    block = bench.speed(300, 50)
    assert len(block) == 1
    assert block.broken is not None
    assert block.broken.is_trip
    assert "following error" in next(e.text for e in bench.rig.events() if e.code == "emcy")
    again = bench.speed(300, 50)
    assert again.broken is not None
    assert again.broken.cause == "drive_state"
    with pytest.raises(DriverError, match="no longer enabled: 0x8611 following error"):
        bench.speed(300, 50)
    assert len(bench.rig.exchange(Command(Mode.QUICK_STOP), 5, Guard())) == 5
    bench.rig.exchange(Command(Mode.OFF), 5, Guard())
    with pytest.raises(DriverError, match="in fault"):
        bench.speed(300, 5)
    bench.rig.reset_fault()
    assert bench.drive.state == "SOD"
    assert bench.speed(300, 5).counts[-1, bench.column(STATUSWORD)] == 0x0237


def test_a_fault_whose_cause_persists_is_not_reset(bench: Setup) -> None:
    bench.drive.fail(0x2310)
    bench.drive.cause_persists = True
    with pytest.raises(DriverError, match="cannot be reset: 0x2310"):
        bench.rig.reset_fault()
    made = setup(state="FAULT")
    made.drive.cause_persists = True
    made.drive.put(0x603F, 0x3220, 2)
    made.rig.open()
    assert any("under-voltage" in e.text for e in made.rig.events() if e.level == "error")
    close(made)


def test_a_node_that_falls_silent_is_stale_then_lost(bench: Setup) -> None:
    bench.speed(300, 20)
    bench.counter.answers = False
    block = bench.speed(300, 500, Guard((), stale_cycles=5))
    assert block.broken is not None
    assert (block.broken.cause, len(block)) == ("stale_data", 5)
    assert all(f & CycleFlag.INCOMPLETE for f in block.flags)
    causes = set()
    for _ in range(10):
        block = bench.rig.exchange(Command(Mode.QUICK_STOP), 200, Guard())
        causes |= {block.broken.cause} if block.broken else set()
    assert causes == {"heartbeat_lost"}
    assert "heartbeat-lost" in bench.codes()
    with pytest.raises(StaleDataError, match="node 2"):
        bench.speed(300, 5)


def test_a_device_whose_process_data_stay_away_is_asked_by_sdo(bench: Setup) -> None:
    bench.speed(100, 10)
    line = bench.rig.line
    assert line is not None
    assert line.reach(STATUSWORD) is Reach.PROCESS_DATA
    bench.drive.node.nmt.state = "PRE-OPERATIONAL"
    block = bench.rig.exchange(Command(Mode.OFF), 5, Guard())
    assert block.counts[-1, bench.column(STATUSWORD)] == 0x0237
    assert line.reach(STATUSWORD) is Reach.SDO
    asked = [Request(Ask.READ, name) for name in (STATUSWORD, INPUT_ANGLE, OUTPUT_ANGLE)]
    line.hand([Request(Ask.SERVO_OFF, STATUSWORD), *asked])
    bench.rig.exchange(Command(Mode.OFF), 6, Guard())
    found = {a.request: a.count for a in line.answers()}
    assert (found[asked[0]], found[asked[1]]) == (0x0250, 1000)
    assert not line.is_busy


def test_a_silent_node_costs_the_others_nothing(bench: Setup) -> None:
    bench.speed(100, 10)
    line, drive, counter = (
        bench.rig.line,
        *(Request(Ask.READ, n) for n in (STATUSWORD, OUTPUT_ANGLE)),
    )
    assert line is not None
    bench.counter.answers = False
    line.hand([counter, counter, drive])
    before = bench.clock.monotonic_ns()
    block = bench.rig.exchange(Command(Mode.OFF), 5, Guard())
    assert [(a.request, a.count) for a in line.answers()] == [
        (drive, block.counts[0, bench.column(STATUSWORD)])
    ]
    assert not (block.flags & CycleFlag.STALE_STATUSWORD).any()
    assert (line.is_idle(STATUSWORD), line.is_idle(OUTPUT_ANGLE)) == (True, False)
    rows = 0
    while rows < 350:
        rows += len(bench.rig.exchange(Command(Mode.OFF), 350 - rows, Guard()))
    assert [a.count for a in line.answers()] == [None, None]  # it is asked once, and given up
    assert line.is_idle(OUTPUT_ANGLE)
    assert line.reach(OUTPUT_ANGLE) is Reach.NMT_FIRST
    assert bench.clock.monotonic_ns() - before < 420_000_000


def test_a_node_reset_in_motion_is_seen(bench: Setup) -> None:
    bench.speed(300, 200)
    bench.counter.bus.send(can.Message(arbitration_id=0x702, data=[0], is_extended_id=False))
    block = bench.speed(300, 50)
    assert block.broken is not None
    assert block.broken.cause == "boot_up"


def test_a_bus_that_is_unplugged_keeps_what_was_measured(bench: Setup) -> None:
    bench.speed(300, 3)
    step = bench.drive.step

    def unplug() -> None:
        step()
        bench.raw.is_gone = bench.drive.syncs >= 9

    bench.drive.step = unplug  # type: ignore[method-assign]
    block = bench.speed(300, 50)
    assert block.broken is not None
    assert (block.broken.cause, len(block)) == ("bus_lost", 6)
    assert not block.flags.any()
    with pytest.raises(BusLostError):
        bench.speed(300, 5)
    bench.rig.close()  # never raises


def test_the_report_counts_what_happened() -> None:
    made = setup()
    made.drive.silent_at, made.drive.double_at = {50}, {60, 70}
    made.rig.open()
    made.speed(100, 200)
    report = made.rig.acquisition()
    assert (report.cycles, report.incomplete, report.doubled) == (200, 1, 2)
    assert report.missed_share == pytest.approx((1 + report.late + 2) / 200)
    assert report.achieved_rate < 1000.0
    assert report.overruns >= 1
    close(made)


def test_lost_frames_cost_time_but_never_shift_a_sample() -> None:
    made = setup()
    made.counter.silent_at = {30, 31, 32, 80}
    made.counter.late_at = {50, 51}
    made.rig.open()
    block = made.speed(100, 120)
    close(made)
    true = 719990 + 7 * np.arange(1, 121)
    good = block.flags == 0
    assert good.sum() >= 105
    assert np.array_equal(block.counts[good, 1], true[good])
    assert block.counts[-1, 1] == true[-1]


def test_nobody_there_is_one_clear_error() -> None:
    made = setup()
    made.drive.answers = False
    with pytest.raises(DriverError, match="no SDO answer"):
        made.rig.open()
    close(made)


STRAY = st.tuples(
    st.sampled_from([0x080, 0x081, 0x181, 0x182, 0x183, 0x281, 0x581, 0x702, 0x7FF]),
    st.binary(max_size=8),
)


@given(st.dictionaries(st.integers(0, 29), STRAY, max_size=6))
@settings(max_examples=10)
def test_stray_frames_never_give_a_wrong_count_that_is_not_marked(
    strays: dict[int, tuple[int, bytes]],
) -> None:
    made = setup()
    made.rig.open()
    step = made.counter.step
    cycle = itertools.count()

    def disturbed() -> None:
        step()
        stray = strays.get(next(cycle))
        if stray is not None:
            made.counter.bus.send(
                can.Message(arbitration_id=stray[0], data=stray[1], is_extended_id=False)
            )

    made.counter.step = disturbed  # type: ignore[method-assign]
    counts: list[list[int]] = []
    flags: list[int] = []
    try:
        while len(counts) < 30:
            block = made.rig.exchange(Command(Mode.OFF), 30 - len(counts), Guard())
            counts += block.counts.tolist()
            flags += block.flags.tolist()
    except DriverError:
        return
    finally:
        close(made)
    good = [(k, row) for k, (row, flag) in enumerate(zip(counts, flags, strict=True)) if not flag]
    assert len(good) >= 30 - 3 * len(strays)
    assert all(row[0] == 0 and row[2] == 100 for _, row in good)
    # The counter wraps at the second cycle: its origin is that of the first cycle that can be trusted.
    assert len({row[1] - 7 * k for k, row in good}) == 1
