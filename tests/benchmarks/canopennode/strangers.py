"""Strangers on the bus before a drive on CANopenNode: a second producer of the SYNC, of process data, a second node of
the same number, another master's set-points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

from sim_backend.wire.bench import DRIVE_NODE, SYNC
from sim_backend.wire.line import WireFault
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


def sends_set_point(bench: CanopennodeBench) -> None:
    """Another master's set-points: twice the speed, or a target a tenth of a revolution further on."""
    read = bench.amplifier.od.read
    further = read(POSITION_TARGET, 0) + bench.amplifier.device.counts_per_revolution // 10
    values = {SPEED_TARGET: 2 * read(SPEED_TARGET, 0), POSITION_TARGET: further}
    _write_process_data(bench, values)


def sends_controlword(bench: CanopennodeBench) -> None:
    """Another master switches the drive off by process data."""
    _write_process_data(bench, {CONTROLWORD: 0x0006})


def _write_process_data(bench: CanopennodeBench, values: dict[int, int]) -> None:
    frame = _packed(bench, 0x1600, values)
    cob_id = bench.amplifier.od.read(0x1400, 1) & 0x7FF or 0x200
    bench.send(cob_id if cob_id & 0x7F else cob_id + DRIVE_NODE, frame, bench)


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
