"""What can go wrong with the serial line of a readout, from a given SYNC cycle on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim_backend.wire.bench import WireBench
from sim_backend.wire.line import WireFault


@dataclass(frozen=True)
class ReadoutGarbage(WireFault):
    """The readout's line brings garbage of the right length: wrong parity, another rate."""

    seed: int = 1

    def from_readout(self, answer: bytes) -> bytes:
        generator = np.random.default_rng(self.seed)
        return generator.integers(0x80, 0x100, len(answer), dtype=np.uint8).tobytes()


@dataclass(frozen=True)
class ReadoutHalfLine(WireFault):
    """The readout's answers stop after `characters`."""

    characters: int = 9

    def from_readout(self, answer: bytes) -> bytes:
        return answer[: self.characters]


@dataclass(frozen=True)
class ReadoutSilent(WireFault):
    """The readout does not answer."""

    def from_readout(self, answer: bytes) -> bytes:
        return b""


@dataclass(frozen=True)
class ReadoutEncoderFault(WireFault):
    """The readout shows an encoder fault: the unit character is "?"."""

    def act(self, bench: WireBench, cycle: int) -> None:
        bench.readout.has_fault = True

    def end_of(self, bench: WireBench) -> None:
        bench.readout.has_fault = False
