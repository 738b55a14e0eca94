"""Any bytes at all from the bus: never an exception that is not a `DriverError`, never a wrong
count that is not marked.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.bus.cia301 import I16, I32, U16, U32, ObjectRef, error_code_text, error_register_text
from drivers.bus.cia401 import torque_input
from drivers.bus.columns import Column, ColumnDecoder
from drivers.bus.device import RemoteDevice
from drivers.bus.frames import CycleStore, Field, FrameLayout
from drivers.bus.network import PumpedBus
from drivers.bus.pdo import MappedPdo, map_objects, read_pdo
from drivers.bus.sync_time import SyncTime
from drivers.channel import Channel
from drivers.clock import VirtualClock
from drivers.counting import index_intervals, lost_counts
from drivers.errors import DriverError
from drivers.samples import CycleFlag, is_stale
from tests.drivers.scripted_bus import ScriptedBus

SDO_DATA = st.binary(min_size=8, max_size=8)


class Babbler(ScriptedBus):
    """A slave that answers every SDO request with the next of the given bytes, addressed to what was asked or not."""

    def __init__(self, answers: list[tuple[bytes, bool]]) -> None:
        super().__init__()
        self.answers = answers
        self.asked = 0

    def send(self, msg: Any) -> None:
        super().send(msg)
        if msg.arbitration_id == 0x602 and self.answers:
            data, is_ours = self.answers[self.asked % len(self.answers)]
            self.asked += 1
            self.feed(0x582, data[:1] + bytes(msg.data)[1:4] + data[4:] if is_ours else data)


@given(st.lists(st.tuples(SDO_DATA, st.booleans()), max_size=12))
@settings(max_examples=150)
def test_any_answers_are_a_pdo_or_a_driver_error(answers: list[tuple[bytes, bool]]) -> None:
    device = RemoteDevice(PumpedBus(Babbler(answers), VirtualClock()), 2, sdo_timeout_ns=1_000_000)
    for action in (
        lambda: read_pdo(device, 1, is_transmit=True),
        lambda: map_objects(device, [ObjectRef(0x6004, 0, U32)], is_transmit=True),
        device.identity,
        lambda: device.produce_heartbeat(100),
        lambda: device.consume_heartbeat(250),
        lambda: device.follow_sync(),
        device.listen_to_emergencies,
    ):
        try:
            found = action()
        except DriverError:
            continue
        for pdo in (
            found if isinstance(found, list) else [found] if isinstance(found, MappedPdo) else []
        ):
            offsets = [pdo.offset_of(e.key) for e in pdo.entries if e.key != (0, 0)]
            assert all(offset is not None and 0 <= offset < pdo.length for offset in offsets)


MAPPED = st.builds(
    lambda key, bits: key << 8 | bits,
    st.integers(1, 2**24 - 1),
    st.sampled_from([0, 1, 3, 7, 8, 8, 16, 16, 24, 32, 200]),
)


@given(st.lists(MAPPED, min_size=1, max_size=8))
def test_any_mapping_words_lie_where_their_bits_lie(words: list[int]) -> None:
    class Mapped(ScriptedBus):
        def send(self, msg: Any) -> None:
            super().send(msg)
            data = bytes(msg.data)
            index, sub = int.from_bytes(data[1:3], "little"), data[3]
            value = {(0x1800, 1): 0x182, (0x1800, 2): 1, (0x1A00, 0): len(words)}.get((index, sub))
            value = words[sub - 1] if index == 0x1A00 and sub else value
            assert value is not None
            self.feed(0x582, b"\x43" + data[1:4] + value.to_bytes(4, "little"))

    pdo = read_pdo(RemoteDevice(PumpedBus(Mapped(), VirtualClock()), 2), 1, is_transmit=True)
    if pdo is None:
        return
    assert pdo.length == sum(word & 0xFF for word in words) // 8
    assert pdo.length <= 8
    at = 0
    places: dict[tuple[int, int], int] = {}
    for word in words:
        if at % 8 == 0 and word & 0xFF and not word & 7:
            places.setdefault((word >> 16, word >> 8 & 0xFF), at // 8)
        at += word & 0xFF
    for entry in pdo.entries:
        if entry.key in places:
            assert pdo.offset_of(entry.key) == places[entry.key]


@given(st.integers(0, 0xFFFF), st.integers(0, 0xFF))
def test_every_error_has_words(code: int, register: int) -> None:
    assert error_code_text(code)
    assert error_register_text(register)


@given(
    st.lists(
        st.tuples(st.sampled_from([0x701, 0x702, 0x081, 0x082, 0x77F]), st.binary(max_size=8)),
        max_size=20,
    )
)
def test_any_heartbeats_and_emergencies_are_events(frames: list[tuple[int, bytes]]) -> None:
    raw = ScriptedBus()
    bus = PumpedBus(raw, VirtualClock())
    bus.watch(1, 10)
    for cob_id, data in frames:
        raw.feed(cob_id, data)
    bus.drain()
    bus.check_heartbeats()
    emergencies = [data for cob_id, data in frames if cob_id in (0x081, 0x082)]
    told = [event for event in bus.events() if event.code == "emcy"]
    assert len(told) == len(emergencies)
    for event, data in zip(told, emergencies, strict=True):
        is_reset = len(data) >= 3 and data[1] == 0
        assert (event.level == "info") == is_reset


# Two frames: position, latch and probe status; counter and its latch, which has no status.
PDOS = [
    MappedPdo(1, True, 1, 0x181, 1, (ObjectRef(0x6064, 0, I32),)),
    MappedPdo(1, True, 2, 0x281, 1, (ObjectRef(0x60BA, 0, I32), ObjectRef(0x60B9, 0, U16))),
    MappedPdo(2, True, 1, 0x182, 1, (ObjectRef(0x6004, 0, U32), ObjectRef(0x2000, 0, U32))),
    MappedPdo(3, True, 2, 0x283, 1, (ObjectRef(0x6401, 1, I16),)),
]
FIELDS = [
    Field("position", 0, 0, I32),
    Field("latch", 1, 0, I32),
    Field("probe", 1, 4, U16),
    Field("count", 2, 0, U32),
    Field("count latch", 2, 4, U32),
    Field("volts", 3, 0, I16),
]
MODULUS = 720_000


def decoder() -> ColumnDecoder:
    return ColumnDecoder(
        FrameLayout(PDOS, FIELDS),
        [
            Column(
                channel=Channel(name="input_angle", unit="rad", scale=1e-3, modulus=1 << 32),
                kind="count",
                field=0,
                largest_step=1000,
            ),
            Column(
                channel=Channel(name="output_angle", unit="rad", scale=1e-3, modulus=MODULUS),
                kind="count",
                field=3,
                largest_step=100,
            ),
            Column(
                channel=Channel(name="torque", unit="N m", scale=1e-3),
                kind="plain",
                field=5,
                analog=torque_input(0.637),
            ),
            Column(
                channel=Channel(name="input_index", unit="rad", scale=1e-3, modulus=1 << 32),
                kind="latch",
                field=1,
                of=0,
                seen_fields=((2, 2),),
            ),
            Column(
                channel=Channel(name="output_index", unit="rad", scale=1e-3, modulus=MODULUS),
                kind="latch",
                field=4,
                of=1,
            ),
            Column(
                channel=Channel(name="index_seen", unit="1", scale=1.0),
                kind="seen",
                field=-1,
                seen_fields=((2, 2), (0, 0)),
            ),
        ],
    )


@given(
    st.lists(
        st.lists(st.tuples(st.integers(0, 3), st.binary(max_size=9)), max_size=6),
        min_size=1,
        max_size=15,
    ),
    st.integers(1, 6),
    st.booleans(),
)
def test_any_frames_give_latches_beside_their_counter_and_what_is_old_says_so(
    cycles: list[list[tuple[int, bytes]]], length: int, echo: bool
) -> None:
    store, in_block, by_row = CycleStore(FrameLayout(PDOS, FIELDS)), decoder(), decoder()
    got: list[list[set[int]]] = []
    for start in range(0, len(cycles), length):
        part = cycles[start : start + length]
        store.begin_block(len(part))
        rows, arrived = [], []
        for frames in part:
            store.begin_cycle(echo)
            if echo:
                store.echo()
            for slot, data in frames:
                store.put(slot, data, 0)
            flags = store.end_cycle()
            rows.append(by_row.row(store.last_record, 0, 0, flags))
            arrived.append({slot for slot, data in frames if len(data) >= PDOS[slot].length})
        raw, bad = store.decoded()
        flags, none = store.flags(), np.zeros(len(part), dtype=np.int64)
        counts = in_block.block(raw, bad, flags, none, none, store.absent())
        assert counts.tolist() == rows
        got.append(arrived)
        for row, here in enumerate(arrived):
            every = set(range(4))
            assert bool(flags[row] & CycleFlag.INCOMPLETE) >= (here != every)
            for channel, slot in (("input_angle", 0), ("output_angle", 2), ("torque", 3)):
                assert bool(is_stale(flags, channel)[row]) >= (slot not in here)
                if flags[row] & CycleFlag.INCOMPLETE == 0:
                    assert not is_stale(flags, channel)[row]
        seen = (raw[:, 2] & 2) != 0
        assert (counts[:, 5] == seen).all()
        assert (counts[~seen, 3] == 0).all()
        assert (np.abs(counts[seen, 3] - counts[seen, 0]) <= 1 << 31).all()
        latched = raw[:, 4] != 0
        assert (np.abs(counts[latched, 4] - counts[latched, 1]) <= MODULUS // 2).all()
        torque = raw[:, 5]
        assert ((flags & CycleFlag.SATURATED != 0) == torque_input(0.637).saturated(torque)).all()


@given(
    st.lists(st.integers(-32768, 32767), min_size=1, max_size=50),
    st.sampled_from([None, -5.0, 0.0, 10.0]),
)
def test_any_count_of_an_analogue_input_is_a_torque_and_its_end_is_marked(
    counts: list[int], level: float | None
) -> None:
    analog = torque_input(0.637, open_level=level)
    found = np.array(counts)
    assert np.isfinite(analog.as_channel().to_si(found)).all()
    ends = np.abs(found) >= 32767
    assert (analog.saturated(found) | ~ends).all()


@given(
    st.lists(
        st.tuples(st.integers(0, 2**40), st.lists(st.integers(0, 2**40), max_size=3)),
        min_size=2,
        max_size=30,
    ),
    st.sampled_from([0, 2**32]),
    st.sampled_from(["hardware", "device", "host"]),
)
def test_time_never_runs_backwards_whatever_the_stamps(
    stamps: list[tuple[int, list[int]]], wrap: int, base: Any
) -> None:
    time = SyncTime(base, wrap)
    last = -1
    for k, (echo, frames) in enumerate(stamps):
        found, is_host = time.of_cycle(echo, frames, k * 1_000_000, 7_000_000_000 + k * 1_000_000)
        assert found > last
        assert is_host or base != "host"
        last = found


@given(
    st.lists(st.integers(-(2**62), 2**62), max_size=20), st.integers(1, 2**31), st.integers(0, 1000)
)
def test_any_latched_positions_are_whole_revolutions_and_a_rest(
    latched: list[int], revolution: int, tolerance: int
) -> None:
    found = index_intervals(np.array(latched, dtype=np.int64) // 4, revolution)
    for interval in found:
        assert interval.counts == interval.revolutions * revolution + interval.excess
        assert 2 * abs(interval.excess) <= revolution
    assert all(abs(i.excess) > tolerance for i in lost_counts(found, tolerance))
    with pytest.raises(DriverError):
        index_intervals(np.zeros(2, dtype=np.int64), 0)
