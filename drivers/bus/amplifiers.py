"""Which amplifiers a segment can have: the description of each kind, and what is made of it."""

from __future__ import annotations

from drivers.bus.amplifier import Amplifier
from drivers.bus.analog.amplifier import ReferenceAmplifier
from drivers.bus.analog.config import ReferenceConfig
from drivers.bus.cia402.config import DriveConfig
from drivers.bus.cia402.cyclic import CyclicDrive
from drivers.bus.network import PumpedBus

AmplifierConfig = DriveConfig | ReferenceConfig


def amplifier_of(bus: PumpedBus, config: AmplifierConfig) -> Amplifier:
    """The amplifier that a description is of."""
    if isinstance(config, ReferenceConfig):
        return ReferenceAmplifier(bus, config)
    return CyclicDrive(bus, config)
