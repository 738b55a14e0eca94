"""A device beside the bus, of another package: a `SourceKind` behind an entry point of `harmonic_rig.sources`.

What a source may not do stands at `Source`: it delays nobody, raises nothing, and turns nothing.
"""

from drivers.channel import Calibration, Channel, encoder_channel
from drivers.clock import Clock
from drivers.errors import DriverError
from drivers.event import Event
from drivers.samples import CycleFlag
from drivers.source import Reading, Source, taken_channel
from rig.bench.config.sources import Shafts, SourceDescription, SourceKind

__all__ = [
    "Calibration",
    "Channel",
    "Clock",
    "CycleFlag",
    "DriverError",
    "Event",
    "Reading",
    "Shafts",
    "Source",
    "SourceDescription",
    "SourceKind",
    "encoder_channel",
    "taken_channel",
]
