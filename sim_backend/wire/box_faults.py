"""What can go wrong with a counter box on TCP and its two lines, each from a given SYNC cycle on."""

from __future__ import annotations

from dataclasses import dataclass

from sim_backend.wire.bench import WireBench
from sim_backend.wire.counter_box import ANSWER_NS
from sim_backend.wire.line import WireFault


@dataclass(frozen=True)
class BoxUnplugged(WireFault):
    """The network cable of the box is pulled."""

    def cuts_box(self) -> bool:
        """Nothing goes through; counted."""
        self.effects.refusals += 1
        return True


@dataclass(frozen=True)
class BoxSilent(WireFault):
    """The box answers nothing."""

    def from_box(self, answer: bytes) -> bytes:
        """Nothing."""
        return b""


@dataclass(frozen=True)
class BoxGarbled(WireFault):
    """The box answers what nobody understands."""

    def from_box(self, answer: bytes) -> bytes:
        """Something else."""
        return b"\xff?" + answer


@dataclass(frozen=True)
class BoxDeaf(WireFault):
    """The trigger line is broken: the box goes on to show what it latched last."""

    def act(self, bench: WireBench, cycle: int) -> None:
        """No edge arrives."""
        bench.counter_box.hears_trigger = False

    def end_of(self, bench: WireBench) -> None:
        """The line is whole again."""
        bench.counter_box.hears_trigger = True


@dataclass(frozen=True)
class BoxSlow(WireFault):
    """The box answers after the next SYNC."""

    def act(self, bench: WireBench, cycle: int) -> None:
        """Its answers take more than a period."""
        bench.counter_box.answer_ns = bench.cycle_ns * 3 // 2

    def end_of(self, bench: WireBench) -> None:
        """It is as quick as before."""
        bench.counter_box.answer_ns = ANSWER_NS


@dataclass(frozen=True)
class BoxInvalid(WireFault):
    """The encoder's signal at the box is not valid, and the box says so."""

    def act(self, bench: WireBench, cycle: int) -> None:
        """The signal is gone."""
        bench.counter_box.is_valid = False

    def end_of(self, bench: WireBench) -> None:
        """It is there again."""
        bench.counter_box.is_valid = True
