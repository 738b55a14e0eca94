"""The sources beside the bus: what a description says of each becomes its driver. One maker per kind."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from drivers.channel import OUTPUT_ANGLE
from drivers.clock import Clock
from drivers.readout.counter_box import CounterBox, CounterBoxConfig, connect
from drivers.readout.nd287 import ReadoutConfig, open_port
from drivers.readout.polled import PolledReadout
from drivers.source import Source
from rig.bench.config import sources as described
from rig.bench.config.schema import RigConfiguration


@dataclass(frozen=True)
class Shafts:
    """The greatest speeds [rad/s] of the shafts, with room: of the motor and, over the ratio, of the output."""

    motor: float
    output: float

    def of(self, channel: str) -> float:
        """That of the shaft on which a channel is measured."""
        return self.output if channel == OUTPUT_ANGLE else self.motor


def sources_of(configuration: RigConfiguration, shafts: Shafts, clock: Clock) -> list[Source]:
    """The sources that a description names, not yet connected."""
    return [MAKERS[source.kind](source, shafts, clock) for source in configuration.sources]


def _counter_box(box: described.CounterBox, shafts: Shafts, clock: Clock) -> Source:
    values = box.settings()
    values["largest_speed"] = values["largest_speed"] or shafts.of(box.channel)
    host, port = box.host, box.port
    return CounterBox(CounterBoxConfig(**values), clock, lambda: connect(host, port, clock))


def _readout(readout: described.PolledReadout, shafts: Shafts, clock: Clock) -> Source:
    config = ReadoutConfig(**readout.settings())
    return PolledReadout(config, clock, lambda: open_port(config, waits=False))


MAKERS: Final[Mapping[str, Callable[[Any, Shafts, Clock], Source]]] = {
    "counter-box": _counter_box,
    "nd-287": _readout,
}
"""How a source of each kind is made."""
