"""The only place where concrete rigs are put together: a name becomes a `RigPort` with the clock it lives in."""

from __future__ import annotations

import time
import zlib
from collections.abc import Callable
from dataclasses import dataclass

from drivers.clock import Clock, VirtualClock
from drivers.port import RigPort
from model.gear import HarmonicDrive, Mounting
from model.motor import ServoMotor
from rig.errors import ConfigurationError


@dataclass(frozen=True)
class Bench:
    """A rig that can be run: its port, its clock, and whether its time is that of the wall."""

    name: str
    port: RigPort
    clock: Clock
    real_time: bool = False


@dataclass(frozen=True)
class BenchRequest:
    """What a rig is asked for.

    `gear` and `motor` are the nominal ones. On a simulated rig `seed` is the laboratory (its motor and instruments), seed
    and `serial` together are the individual gear, seed and `protocol` together are the run (start angle, drift, noise).
    """

    gear: HarmonicDrive
    motor: ServoMotor
    mounting: Mounting = "circular-spline-fixed"
    gear_mounted: bool = True
    serial: str = ""
    protocol: str = ""
    seed: int = 0
    sample_rate: float = 1000.0
    disc_inertia: float = 0.0


def make_port(name: str, request: BenchRequest) -> Bench:
    """The rig of this name. Raises `ConfigurationError` for one that does not exist, listing those that do."""
    maker = BACKENDS.get(name)
    if maker is None:
        raise ConfigurationError(
            "no such rig", where="--backend", value=repr(name), limit=", ".join(BACKENDS), remedy="Choose one of these."
        )
    return maker(request)


def _simulated(request: BenchRequest) -> Bench:
    from sim_backend.direct import SimulatedRig
    from sim_backend.imperfections import individual_gear, individual_motor

    gear_seed = _mixed(request.seed, f"gear {request.serial}")
    clock = VirtualClock(time.time_ns())
    port = SimulatedRig(
        individual_gear(request.gear, gear_seed),
        individual_motor(request.motor, request.seed),
        seed=_mixed(request.seed, f"run {request.protocol}"),
        cycle_ns=round(1e9 / request.sample_rate),
        mounting=request.mounting,
        gear_mounted=request.gear_mounted,
        disc_inertia=request.disc_inertia,
        clock=clock,
        bench_seed=request.seed,
        gear_seed=gear_seed,
    )
    return Bench("sim", port, clock)


def _mixed(seed: int, name: str) -> int:
    """One seed out of a seed and a name, the same on every computer."""
    return (seed << 32) ^ zlib.crc32(name.encode())


BACKENDS: dict[str, Callable[[BenchRequest], Bench]] = {"sim": _simulated}
"""Every rig there is, by the name given to --backend."""
