"""Strangers on the bus before a drive on CANopenNode: a second producer of the SYNC, of process data, a second node of
the same number, another master's set-points.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

from sim_backend.wire.bench import DRIVE_NODE, SYNC
from sim_backend.wire.line import Frame, WireFault
from tests.benchmarks.canopennode.drive import CanopennodeBench, CanopennodeDrive
from tests.drivers.durand_node import NEVER

SPEED_TARGET, POSITION_TARGET, CONTROLWORD = 0x60FF, 0x607A, 0x6040
Act = Callable[[CanopennodeBench], None]


class Stranger:
    """Somebody on the bus who does a thing again and again, `phase_ns` after he came and every `period_ns` from then
    on, whatever anybody else does.
    """

    sync_cob_id, node_id = -1, 0
    rpdos, tpdos = (), ()

    def __init__(
        self, bench: CanopennodeBench, act: Act, phase_ns: int, period_ns: int, times: int
    ) -> None:
        self.dictionary = SimpleNamespace(number=lambda index: 0)
        self._bench, self._act, self._period_ns, self._left = bench, act, period_ns, times
        self._due_ns = bench.clock.monotonic_ns() + phase_ns

    def receive(self, cob_id: int, data: bytes, now_ns: int) -> None:
        """It listens to nobody."""

    def next_due_ns(self) -> int:
        return self._due_ns if self._left else NEVER

    def tick(self, now_ns: int) -> None:
        self._left -= 1
        self._due_ns += self._period_ns
        self._act(self._bench)


@dataclass(frozen=True)
class Comes(WireFault):
    """From `at_cycle` on a stranger acts `times` times, half a cycle after the SYNC at first."""

    does: Act = field(kw_only=True)
    period_us: int = field(default=1000, kw_only=True)
    times: int = field(default=1 << 40, kw_only=True)

    def act(self, bench: Any, cycle: int) -> None:
        if cycle == self.at_cycle:
            stranger = Stranger(bench, self.does, 500_000, self.period_us * 1000, self.times)
            bench.slaves = (*bench.slaves, stranger)


def sends_sync(bench: CanopennodeBench) -> None:
    """A SYNC: every device takes it for ours."""
    bench.answer(SYNC, b"")
    for slave in bench.slaves:
        if slave.sync_cob_id == SYNC:
            slave.hear_sync(bench.clock.monotonic_ns())
            slave.latch()
            slave.apply_synchronous()
            slave.send_synchronous()


def sends_process_data(bench: CanopennodeBench) -> None:
    """Process data under the drive's COB-ID: those of a drive that stands, at its count 0."""
    bench.answer(0x180 + DRIVE_NODE, _packed(bench, 0x1A00, {0x6041: 0x0250}))


@dataclass(frozen=True)
class AnotherMaster(WireFault):
    """Right after each of our set-point frames another master's comes, so that his are in force at the SYNC: `speeds`,
    twice the speed or a target a tenth of a revolution further on; `controls`, the drive switched off.
    """

    speeds: bool = field(default=False, kw_only=True)
    controls: bool = field(default=False, kw_only=True)

    def to_devices(self, frame: Frame, bench: Any) -> Sequence[Frame]:
        cob_id, data = frame
        cob_of, mapping = bench.amplifier.od.read(0x1400, 1) & 0x7FF, 0x1600
        if cob_id not in (cob_of, cob_of + DRIVE_NODE) or len(data) < 3:
            return (frame,)
        ours = _unpacked(bench, mapping, data)
        his = dict(ours)
        if self.speeds and SPEED_TARGET in ours:
            his[SPEED_TARGET] = 2 * ours[SPEED_TARGET]
        if self.speeds and POSITION_TARGET in ours:
            further = bench.amplifier.device.counts_per_revolution // 10
            his[POSITION_TARGET] = ours[POSITION_TARGET] + further
        if self.controls:
            his[CONTROLWORD] = 0x0006
        foreign = (cob_id, _packed(bench, mapping, his))
        bench.answer(*foreign)
        return (frame, foreign)


def _unpacked(bench: CanopennodeBench, mapping: int, data: bytes) -> dict[int, int]:
    """What a frame of this mapping says, by the objects' indices."""
    read, found, at = bench.amplifier.od.read, {}, 0
    for sub in range(1, read(mapping, 0) + 1):
        word = read(mapping, sub)
        size = (word & 0xFF) // 8
        found[word >> 16] = int.from_bytes(data[at : at + size], "little", signed=size == 4)
        at += size
    return found


def _packed(bench: CanopennodeBench, mapping: int, values: dict[int, int]) -> bytes:
    """A frame of this mapping, in which these objects have these values and the others what they have."""
    read, frame = bench.amplifier.od.read, b""
    for sub in range(1, read(mapping, 0) + 1):
        word = read(mapping, sub)
        index, size = word >> 16, (word & 0xFF) // 8
        value = values.get(index, read(index, word >> 8 & 0xFF))
        frame += (value % (1 << 8 * size)).to_bytes(size, "little")
    return frame


@dataclass(frozen=True)
class NodeDoubled(WireFault):
    """A second drive of the same number is switched on: same stack, same amplifier, its motor on no rig."""

    def act(self, bench: Any, cycle: int) -> None:
        if cycle == self.at_cycle:
            twin = CanopennodeDrive(DRIVE_NODE, bench.amplifier.device, bench._from_device)
            bench.slaves = (*bench.slaves, twin)
            twin.boot(bench.clock.monotonic_ns())
