"""The bus opened, its bit rate found where that can be, and everybody on it asked, with the bench locked meanwhile."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from drivers.bus.discover import BIT_RATES, FoundNode, discover, find_bit_rate
from drivers.bus.load import load_of
from drivers.bus.network import BusConfig, open_raw_bus
from drivers.clock import WallClock
from rig.bench.identity import bench_on_bus
from rig.run.bench_lock import bench_lock
from rig.trial.doctor.discover.proposal import Bus

Tell = Callable[[str, int, int], None]
"""Is told what is being done, how much of it is done, and of how much."""
_OWN_RATE: Final = ("socketcan", "socketcand", "virtual", "udp_multicast")
"""Interfaces whose bit rate is set elsewhere, or that have none."""
RATES_SHOWN: Final = (125_000, 250_000, 500_000, 1_000_000)


def ask_bus(
    interface: str, channel: str, arguments: Mapping[str, str | int], bit_rate: int, tell: Tell
) -> tuple[Bus, Sequence[FoundNode]]:
    """How the bus was reached, and who is on it. `bit_rate` [bit/s] 0: found by listening.

    Raises `BenchInUseError`, `OtherMasterError`, and `DriverError` where the bit rate cannot be found.
    """
    clock = WallClock()
    with bench_lock(bench_on_bus(interface, channel, arguments), "rig config discover"):
        rate = bit_rate or _rate_of(interface, channel, arguments, clock, tell)
        raw = open_raw_bus(BusConfig(interface, channel, rate, arguments))
        try:
            nodes = discover(raw, clock, on_stage=tell)
        finally:
            raw.shutdown()
    return Bus(interface, channel, rate, tuple(arguments.items())), nodes


def _rate_of(
    interface: str, channel: str, arguments: Mapping[str, str | int], clock: WallClock, tell: Tell
) -> int:
    """The bit rate: the interface's own, or found by listening."""
    if interface in _OWN_RATE:
        return 1_000_000
    return find_bit_rate(
        lambda rate, passive: open_raw_bus(
            BusConfig(interface, channel, rate, {**arguments, **passive})
        ),
        interface,
        clock,
        on_rate=lambda rate: tell("bit rates tried", BIT_RATES.index(rate) + 1, len(BIT_RATES)),
    )


def rates_of(nodes: int) -> dict[int, float]:
    """The SYNC rate [Hz] that a bus with so many nodes carries, by its bit rate [bit/s]; 0 where it carries none."""
    load = load_of(nodes)
    return {rate: load.largest_rate(rate) for rate in RATES_SHOWN}
