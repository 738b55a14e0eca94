"""What can go wrong between a coupler and an amplifier by analog reference, each from a given SYNC cycle on."""

from __future__ import annotations

from dataclasses import dataclass

from sim_backend.wire.analog_amplifier import POWER, AnalogAmplifier
from sim_backend.wire.bench import WireBench
from sim_backend.wire.line import WireFault


def _amplifier(bench: WireBench) -> AnalogAmplifier:
    assert isinstance(bench.drive, AnalogAmplifier)
    return bench.drive


@dataclass(frozen=True)
class ReferenceOffset(WireFault):
    """Volts are added to the reference on its way: a bad contact, or the screen of its cable is open."""

    volts: float = 0.06

    def act(self, bench: WireBench, cycle: int) -> None:
        _amplifier(bench).added_volts = self.volts

    def end_of(self, bench: WireBench) -> None:
        _amplifier(bench).added_volts = 0.0


@dataclass(frozen=True)
class ContactStuck(WireFault):
    """A contact of the amplifier says the same for ever: its bit, and what it says."""

    bit: int = POWER
    says: bool = True

    def act(self, bench: WireBench, cycle: int) -> None:
        _amplifier(bench).stick(self.bit, self.says)

    def end_of(self, bench: WireBench) -> None:
        _amplifier(bench).stick(self.bit, None)


@dataclass(frozen=True)
class ReferenceBroken(WireFault):
    """The wire of the reference breaks: the amplifier sees no voltage."""

    def act(self, bench: WireBench, cycle: int) -> None:
        _amplifier(bench).is_cut = True

    def end_of(self, bench: WireBench) -> None:
        _amplifier(bench).is_cut = False
