"""Strangers on the simulated bus, for drills and tests: a second SYNC producer, a doubled node, a second commander."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sim_backend.wire.bench import COUNTER_NODE, SYNC, WireBench, synchronise
from sim_backend.wire.line import Frame, WireFault


@dataclass(frozen=True)
class SecondSync(WireFault):
    """Somebody else sends SYNC as well: `in_cycle` of them in every `every`-th cycle, each answered by all nodes."""

    every: int = 1
    in_cycle: int = 1

    def act(self, bench: WireBench, cycle: int) -> None:
        if (cycle - self.at_cycle) % self.every:
            return
        for _ in range(self.in_cycle):
            bench.answer(SYNC, b"")
            synchronise(bench.slaves, bench.clock.monotonic_ns())


@dataclass(frozen=True)
class AlienTpdo(WireFault):
    """Somebody else sends process data with a node's COB-ID: a device at rest whose node-ID is taken, all bytes `byte`.

    It comes before the node's own frame in every `every`-th cycle.
    """

    node_id: int = COUNTER_NODE
    every: int = 1
    byte: int = 0

    def act(self, bench: WireBench, cycle: int) -> None:
        if (cycle - self.at_cycle) % self.every:
            return
        pdo = next(pdo for pdo in bench.slave(self.node_id).tpdos if pdo.exists)
        bench.answer(pdo.cob_id & 0x7FF, bytes([self.byte]) * 8)


@dataclass(frozen=True)
class AlienCommand(WireFault):
    """Somebody else sends the drive a command right after ours: the same frame with the bits `flip` of one byte turned.

    Byte 0 is the controlword's; 2 is the first of the set-point of a CiA 402 drive.
    """

    flip: int = 0x40
    byte: int = 2

    def to_devices(self, frame: Frame, bench: WireBench) -> Sequence[Frame]:
        cob_id, data = frame
        pdo = next(pdo for pdo in bench.drive.rpdos if pdo.exists)
        if cob_id != pdo.cob_id & 0x7FF or len(data) <= self.byte:
            return (frame,)
        altered = bytearray(data)
        altered[self.byte] ^= self.flip
        alien = (cob_id, bytes(altered))
        bench.answer(*alien)
        return (frame, alien)
