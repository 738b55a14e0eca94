"""Pairing by SYNC index and decoding: a value that is wrong is marked, whatever happens to the frames."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.bus.cia301 import I16, I32, REAL32, U16, U32, DataType, ObjectRef
from drivers.bus.columns import Column, ColumnDecoder, Validity
from drivers.bus.frames import CycleStore, Field, FrameLayout
from drivers.bus.pdo import MappedPdo, pack
from drivers.bus.sync_time import SyncTime
from drivers.channel import Channel
from drivers.counting import Unwrapper, index_intervals, lost_counts, wrapped_difference
from drivers.errors import DriverError
from drivers.judge import CycleJudge
from drivers.port import Bound, Guard, GuardWatch
from drivers.samples import CycleFlag

STATUS, POSITION, TORQUE = (
    ObjectRef(0x6041, 0, U16),
    ObjectRef(0x6064, 0, I32),
    ObjectRef(0x6077, 0, I16),
)
COUNT, ALARM = ObjectRef(0x6004, 0, U32), ObjectRef(0x6503, 0, U16)
DRIVE = MappedPdo(1, True, 1, 0x181, 1, (STATUS, POSITION, TORQUE))
COUNTER = MappedPdo(2, True, 1, 0x182, 1, (COUNT, ALARM))
FIELDS = [
    Field("status", 0, 0, U16),
    Field("position", 0, 2, I32),
    Field("torque", 0, 6, I16),
    Field("count", 1, 0, U32),
    Field("alarm", 1, 4, U16),
]


def layout() -> FrameLayout:
    return FrameLayout([DRIVE, COUNTER], FIELDS)


def number(k: int) -> bytes:
    return k.to_bytes(4, "little")


def count_store() -> CycleStore:
    """One TPDO of one U32."""
    return CycleStore(
        FrameLayout([MappedPdo(2, True, 1, 0x182, 1, (COUNT,))], [Field("count", 0, 0, U32)])
    )


def test_bytes_of_the_manual() -> None:
    store = CycleStore(layout())
    store.begin_block(2)
    store.begin_cycle(False)
    store.put(0, bytes.fromhex("3702 FEFFFFFF F6FF"), 5)
    store.put(1, bytes.fromhex("40190100 0000"), 6)
    assert store.has_all
    assert store.end_cycle() == 0
    counts, bad = store.decoded()
    assert counts.tolist() == [[0x0237, -2, -10, 72000, 0]]
    assert not bad.any()
    assert layout().decode_row(store.last_record) == counts[0].tolist()


def test_missing_short_doubled_and_late() -> None:
    store = count_store()
    store.begin_block(6)
    flags = []
    for k, frames in enumerate([[0], [], [1, 2], [3, 3], [4]]):
        store.begin_cycle(False)
        for value in frames:
            store.put(0, number(value), 0)
        flags.append(store.end_cycle())
        assert k == store.rows - 1
    store.begin_cycle(False)
    store.put(0, b"\x05\x00", 0)
    flags.append(store.end_cycle())
    assert flags == [
        0,
        CycleFlag.INCOMPLETE,
        CycleFlag.LATE,
        CycleFlag.DOUBLED,
        0,
        CycleFlag.SHORT | CycleFlag.INCOMPLETE,
    ]
    counts, _ = store.decoded()
    # The previous value stands where a frame is missing or short; after a late frame, the second one counts.
    assert counts[:, 0].tolist() == [0, 0, 2, 3, 4, 4]
    assert store.lost == [1]


def test_one_frame_where_two_were_due_is_marked() -> None:
    store = count_store()
    store.begin_block(3)
    flags = []
    for frames in ([], [1], [2]):
        store.begin_cycle(False)
        for value in frames:
            store.put(0, number(value), 0)
        if frames == [1]:
            assert store.has_all
            assert store.is_owed  # so that it is waited for the second one
            store.forgive()
        flags.append(store.end_cycle())
    assert flags == [CycleFlag.INCOMPLETE, CycleFlag.LATE, 0]


def test_what_was_on_the_bus_before_the_sync_belongs_to_the_cycle_before() -> None:
    store = count_store()
    store.begin_block(3)
    store.begin_cycle(True)
    store.echo()
    store.end_cycle()
    store.begin_cycle(True)
    store.put(0, number(0), 0)
    assert not store.has_all
    store.echo()
    store.put(0, number(1), 0)
    assert store.has_all
    assert not store.is_owed
    assert store.end_cycle() == CycleFlag.LATE
    store.put(0, number(1), 0)  # between two cycles, and nothing was owed
    store.begin_cycle(True)
    store.echo()
    store.put(0, number(2), 0)
    assert store.end_cycle() == CycleFlag.DOUBLED
    assert store.decoded()[0][:, 0].tolist() == [0, 1, 2]


EVENTS = st.lists(
    st.sampled_from(["good", "good", "good", "lost", "double", "short", "late"]),
    min_size=1,
    max_size=40,
)


@given(EVENTS, st.sampled_from([1, 3, 7, 40]))
def test_an_unmarked_cycle_holds_its_own_value(events: list[str], block: int) -> None:
    """Device value in cycle k is k; frames are lost, doubled, cut, or one cycle late: unmarked cycles are right."""
    store = count_store()
    values: list[int] = []
    flags: list[int] = []
    late: list[int] = []
    for k, event in enumerate(events):
        if k % block == 0:
            store.begin_block(block)
        store.begin_cycle(False)
        for value in late:
            store.put(0, number(value), 0)
        late = []
        if event == "late":
            late = [k]
        elif event != "lost":
            for _ in range(2 if event == "double" else 1):
                store.put(0, number(k)[: 2 if event == "short" else 4], 0)
        if store.has_all and not late:
            store.forgive()  # quiet: nothing more is on its way
        flags.append(store.end_cycle())
        values.append(layout_value(store))
    for k, (value, flag) in enumerate(zip(values, flags, strict=True)):
        assert flag or value == k
    for k, event in enumerate(events):
        if event in ("lost", "short"):
            assert flags[k] & (CycleFlag.INCOMPLETE | CycleFlag.LATE | CycleFlag.SHORT)


def layout_value(store: CycleStore) -> int:
    return int.from_bytes(store.last_record[:4], "little")


@given(st.lists(st.tuples(st.integers(0, 1), st.binary(max_size=8)), max_size=30), st.booleans())
def test_any_frames_decode_and_what_is_missing_is_marked(
    frames: list[tuple[int, bytes]], echo: bool
) -> None:
    store = CycleStore(layout())
    decoder = ColumnDecoder(store.layout, columns())
    store.begin_block(len(frames) + 1)
    previous = b""
    for slot, data in frames:
        store.begin_cycle(echo)
        store.put(slot, data, 0)
        assert store.end_cycle() & CycleFlag.INCOMPLETE
        other = 8 * (1 - slot)
        assert not previous or store.last_record[other : other + 8] == previous[other : other + 8]
        previous = store.last_record
    raw, bad = store.decoded()
    flags = store.flags()
    none = np.zeros(store.rows, dtype=np.int64)
    counts = decoder.block(raw, bad, flags, none, none)
    assert counts.shape == (len(frames), 4)


def columns(modulus: int = 720000) -> list[Column]:
    return [
        Column(
            channel=Channel(name="input_angle", unit="rad", scale=1e-3, modulus=1 << 32),
            kind="count",
            field=1,
            largest_step=1000,
        ),
        Column(
            channel=Channel(name="output_angle", unit="rad", scale=1e-3, modulus=modulus),
            kind="count",
            field=3,
            largest_step=100,
        ),
        Column(channel=Channel(name="drive_torque", unit="N m", scale=1e-3), kind="plain", field=2),
        Column(channel=Channel(name="statusword", unit="", scale=1.0), kind="plain", field=0),
    ]


@given(
    st.lists(
        st.tuples(
            st.integers(-(2**30), 2**30), st.integers(-359_999, 359_999), st.integers(-32768, 32767)
        ),
        min_size=1,
        max_size=60,
    ),
    st.integers(1, 9),
    st.integers(-(2**31), 2**31 - 1),
    st.integers(0, 719_999),
)
def test_counters_are_unwrapped_the_same_by_row_and_by_blocks_of_any_length(
    steps: list[tuple[int, int, int]], length: int, start: int, start_count: int
) -> None:
    in_block, by_row = ColumnDecoder(layout(), columns()), ColumnDecoder(layout(), columns())
    position, count = start, start_count
    records, truth = [], []
    for step, step_count, torque in [(0, 0, 0), *steps]:
        position, count = position + step, count + step_count
        wrapped = ((position + 2**31) % 2**32) - 2**31
        record = (
            (0x0237).to_bytes(2, "little")
            + wrapped.to_bytes(4, "little", signed=True)
            + torque.to_bytes(2, "little", signed=True)
        )
        records.append(record + (count % 720000).to_bytes(4, "little") + bytes(4))
        truth.append([position, count, torque, 0x0237])
    found = []
    for i in range(0, len(records), length):
        part = records[i : i + length]
        raw, bad = layout().decode(b"".join(part), len(part))
        none = np.zeros(len(part), dtype=np.int64)
        found += in_block.block(raw, bad, np.zeros(len(part), dtype=np.uint16), none, none).tolist()
    assert found == truth
    assert [by_row.row(r, 0, 0) for r in records] == truth


@given(
    st.lists(
        st.tuples(
            st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1), st.sampled_from([0, 0, 1, 2, 4])
        ),
        min_size=1,
        max_size=40,
    ),
    st.integers(1, 9),
)
def test_a_doubtful_value_never_costs_a_turn_and_rows_agree_with_blocks(
    rows: list[tuple[int, int, int]], length: int
) -> None:
    in_block, by_row = ColumnDecoder(layout(), columns()), ColumnDecoder(layout(), columns())
    records = [
        bytes(2) + p.to_bytes(4, "little") + bytes(2) + c.to_bytes(4, "little") + bytes(4)
        for p, c, _ in rows
    ]
    found: list[list[int]] = []
    for i in range(0, len(records), length):
        part = records[i : i + length]
        raw, bad = layout().decode(b"".join(part), len(part))
        none = np.zeros(len(part), dtype=np.int64)
        flags = np.array([r[2] for r in rows[i : i + length]], dtype=np.uint16)
        found += in_block.block(raw, bad, flags, none, none).tolist()
    assert [
        by_row.row(record, 0, 0, row[2]) for record, row in zip(records, rows, strict=True)
    ] == found
    trusted = [(counts[0], p) for counts, (p, _, flag) in zip(found, rows, strict=True) if not flag]
    for (count, p), (next_count, next_p) in itertools.pairwise(trusted):
        step = (next_p - p + 2**31) % 2**32 - 2**31
        assert next_count - count == step


def test_jumps_alarms_and_impossible_counts_are_marked() -> None:
    decoder = ColumnDecoder(layout(), columns(), [Validity(4, 0xFFFF)])
    raw = np.array(
        [
            [0, 0, 0, 10, 0],
            [0, 900, 0, 20, 0],
            [0, 2500, 0, 30, 0],
            [0, 2500, 0, 40, 1],
            [0, 2500, 0, 800_000, 0],
        ],
        dtype=np.int64,
    )
    flags = np.zeros(5, dtype=np.uint16)
    none = np.zeros(5, dtype=np.int64)
    decoder.block(raw, np.zeros(raw.shape, dtype=bool), flags, none, none)
    error, jump = CycleFlag.SIGNAL_ERROR, CycleFlag.JUMPED
    assert flags.tolist() == [0, 0, jump, error, error | jump]


def test_a_gap_allows_for_more_motion_but_not_for_a_wrap() -> None:
    decoder = ColumnDecoder(layout(), columns(modulus=500))
    raw = np.array(
        [
            [0, 0, 0, 10, 0],
            [0, 0, 0, 10, 0],
            [0, 0, 0, 190, 0],
            [0, 0, 0, 200, 0],
            [0, 0, 0, 200, 0],
            [0, 0, 0, 200, 0],
            [0, 0, 0, 260, 0],
        ],
        dtype=np.int64,
    )
    flags = np.array([0, 1, 0, 0, 1, 1, 0], dtype=np.uint16)
    none = np.zeros(7, dtype=np.int64)
    decoder.block(raw, np.zeros(raw.shape, dtype=bool), flags, none, none)
    # 180 counts in two cycles are possible; over three cycles the counter of 500 may have turned unseen.
    assert (flags & CycleFlag.JUMPED != 0).tolist() == [
        False,
        False,
        False,
        False,
        False,
        False,
        True,
    ]


def test_a_sync_that_came_late_allows_for_more_motion_and_a_pause_does_not() -> None:
    raw = np.array(
        [[0, 0, 0, 10, 0], [0, 0, 0, 20, 0], [0, 0, 0, 260, 0], [0, 0, 0, 270, 0]], dtype=np.int64
    )
    none, late = np.zeros(4, dtype=np.int64), np.array([0, 1_000_000, 4_100_000, 5_100_000])

    def jumped(sent: np.ndarray, *, paused: bool = False) -> list[bool]:
        decoder = ColumnDecoder(layout(), columns(), cycle_ns=1_000_000)
        flags = [np.zeros(n, dtype=np.uint16) for n in (2, 2)]
        for part, flag in zip((slice(0, 2), slice(2, 4)), flags, strict=True):
            decoder.block(
                raw[part],
                np.zeros((2, 5), dtype=bool),
                flag,
                none[part],
                none[part],
                sent=sent[part],
            )
            if paused:
                decoder.pause()
        return (np.concatenate(flags) & CycleFlag.JUMPED != 0).tolist()

    # 240 counts are possible in three periods, not in one; and nothing turns while the SYNC stands on purpose.
    assert jumped(late) == [False] * 4
    assert jumped(np.arange(4) * 1_000_000) == [False, False, True, False]
    assert jumped(late, paused=True) == [False, False, True, False]


@given(st.lists(st.floats(width=32), min_size=1, max_size=20))
def test_floating_point_inputs_never_give_a_silent_wrong_count(values: list[float]) -> None:
    pdo = MappedPdo(3, True, 1, 0x183, 1, (ObjectRef(0x6403, 1, REAL32),))
    one = FrameLayout([pdo], [Field("volts", 0, 0, REAL32, 1e-6)])
    data = b"".join(np.float32(v).tobytes() + bytes(4) for v in values)
    counts, bad = one.decode(data, len(values))
    for value, count, is_bad, row in zip(
        values, counts[:, 0], bad[:, 0], range(len(values)), strict=True
    ):
        assert one.decode_row(data[8 * row : 8 * row + 8]) == [int(count)]
        assert is_bad == (not abs(value / 1e-6) < 2.0**62)
        assert is_bad or int(count) == round(value / 1e-6)


def test_layouts_that_cannot_be() -> None:
    with pytest.raises(DriverError, match="size of one count"):
        FrameLayout([DRIVE], [Field("x", 0, 0, REAL32)])
    with pytest.raises(DriverError, match="cannot be acquired"):
        FrameLayout([DRIVE], [Field("x", 0, 0, DataType(0x10, "INTEGER24", 3, True))])
    with pytest.raises(DriverError, match="share bytes"):
        FrameLayout([DRIVE], [Field("x", 0, 0, I32), Field("y", 0, 2, I32)])


def test_packing_into_frames() -> None:
    assert pack([STATUS, POSITION, TORQUE, COUNT, ALARM]) == [
        [STATUS, POSITION, TORQUE],
        [COUNT, ALARM],
    ]


@given(st.integers(2, 2**32), st.lists(st.integers(-(2**40), 2**40), min_size=1, max_size=30))
def test_unwrapping_keeps_every_step_below_half_the_range(modulus: int, path: list[int]) -> None:
    half = (modulus - 1) // 2
    steps = [0, *(int(np.clip(b - a, -half, half)) for a, b in itertools.pairwise(path))]
    truth = path[0] % modulus + np.cumsum(steps)
    raw = truth % modulus
    assert Unwrapper(modulus).unwrap(raw).tolist() == truth.tolist()
    assert np.all(np.abs(wrapped_difference(raw[1:], raw[:-1], modulus)) <= half)


def test_index_marks_count_lost_counts() -> None:
    latched = np.array([100, 100, 32868, 32868, 65634, 65634 - 32768])
    intervals = index_intervals(latched, 32768)
    assert [(i.revolutions, i.excess) for i in intervals] == [(1, 0), (1, -2), (-1, 0)]
    assert [i.excess for i in lost_counts(intervals, 1)] == [-2]
    with pytest.raises(DriverError, match="multiple"):
        index_intervals(latched, 100, 3)


BOUNDS = st.builds(
    Bound,
    cause=st.just("limit"),
    weights=st.dictionaries(
        st.sampled_from(["a", "b"]), st.sampled_from([1.0, -0.5, 0.1]), min_size=1
    ),
    low=st.sampled_from([-5.0, -20.0]),
    high=st.sampled_from([5.0, 20.0]),
    lag=st.integers(0, 5),
    offset=st.sampled_from([0.0, 3.0]),
    is_trip=st.booleans(),
    consecutive=st.integers(1, 3),
    mask=st.sampled_from([0, 0, 0x0F]),
)


@given(
    st.lists(
        st.tuples(st.integers(-30, 30), st.integers(-30, 30), st.sampled_from([0, 0, 0, 1])),
        min_size=1,
        max_size=40,
    ),
    st.lists(BOUNDS, max_size=3),
    st.integers(0, 3),
    st.integers(1, 15),
)
def test_the_judge_of_single_cycles_agrees_with_the_watch_over_blocks(
    rows: list[tuple[int, int, int]], bounds: list[Bound], stale: int, length: int
) -> None:
    channels = [Channel(name="a", unit="", scale=1.0), Channel(name="b", unit="", scale=1.0)]
    guard, judge, watch = Guard(tuple(bounds), stale), CycleJudge(channels), GuardWatch(channels)
    judge.adopt(guard)
    counts = np.array([r[:2] for r in rows], dtype=np.int64)
    flags = np.array([r[2] for r in rows], dtype=np.uint16)
    for start in range(0, len(rows), length):
        part = slice(start, start + length)
        expected = watch.first_break(guard, counts[part], flags[part])
        found = None
        for row, (values, flag) in enumerate(
            zip(counts[part].tolist(), flags[part].tolist(), strict=True)
        ):
            hit = judge.judge(values, flag, row)
            found = found or hit
        if expected is None or found is None:
            assert expected == found
        else:
            assert found.row == expected.row
        watch.accept(counts[part], flags[part])


def test_time_runs_on_over_a_wrapping_adapter_clock_and_missing_stamps() -> None:
    wrap = 4_294_967_296_000
    time = SyncTime("hardware", wrap)
    sent = [0, 1_000_000, 2_000_000, 3_000_000, 4_000_000]
    stamps = [wrap - 1_500_000, wrap - 500_000, 500_000, 0, 2_500_000]
    found = [time.of_cycle(stamp, [], at, 7) for stamp, at in zip(stamps, sent, strict=True)]
    assert [t for t, _ in found] == [wrap + k * 1_000_000 - 1_500_000 for k in range(5)]
    assert [host for _, host in found] == [False, False, False, True, False]


def test_time_never_runs_backwards() -> None:
    time = SyncTime("hardware")
    assert time.of_cycle(1000, [], 0, 0) == (1000, False)
    assert time.of_cycle(900, [], 500, 0) == (1500, True)
    assert time.of_cycle(0, [1700, 1600], 700, 0) == (1600, False)
    assert SyncTime("host").of_cycle(5, [], 0, 9) == (5, True)
    assert SyncTime("virtual").of_cycle(0, [], 0, 9) == (9, False)
