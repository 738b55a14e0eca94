"""The sources beside the bus: what a description says of each becomes its driver. One maker per kind."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from drivers.clock import Clock
from drivers.readout.counter_box import CounterBox, CounterBoxConfig, connect
from drivers.readout.nd287 import ReadoutConfig, open_port
from drivers.readout.polled import PolledReadout
from drivers.source import Source
from experiments.extensions import Extension
from rig.bench.config import sources as described
from rig.bench.config.schema import RigConfiguration
from rig.bench.config.sources import Shafts, SourceKind, brought


def sources_of(configuration: RigConfiguration, shafts: Shafts, clock: Clock) -> list[Source]:
    """The sources that a description names, not yet connected."""
    return [_maker(source.kind)(source, shafts, clock) for source in configuration.sources]


def extensions_of(configuration: RigConfiguration) -> tuple[Extension, ...]:
    """What other packages bring to a rig, as its description says."""
    found = (brought(source.kind) for source in configuration.sources)
    return tuple(dict.fromkeys(one for one in found if one is not None))


def _maker(kind: str) -> Callable[[Any, Shafts, Clock], Source]:
    """Ours, or that of another package, which was asked for when the description was read."""
    if kind in MAKERS:
        return MAKERS[kind]
    one = brought(kind)
    assert one is not None, kind
    loaded: SourceKind = one.loaded(SourceKind)
    return loaded.make


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
"""How a source of each of our kinds is made."""
