"""The only place where concrete rigs are put together: a name becomes a `RigPort` with the clock it lives in."""

from __future__ import annotations

import time
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
    """What a rig is asked for. `gear` and `motor` are what stands on a simulated rig (before its own spread by `seed`)."""

    gear: HarmonicDrive
    motor: ServoMotor
    mounting: Mounting = "circular-spline-fixed"
    gear_mounted: bool = True
    seed: int = 0
    sample_rate: float = 1000.0


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
    from sim_backend.imperfections import Imperfections

    port = SimulatedRig(
        request.gear,
        request.motor,
        Imperfections(),
        seed=request.seed,
        cycle_ns=round(1e9 / request.sample_rate),
        mounting=request.mounting,
        gear_mounted=request.gear_mounted,
    )
    return Bench("sim", port, VirtualClock(time.time_ns()))


BACKENDS: dict[str, Callable[[BenchRequest], Bench]] = {"sim": _simulated}
"""Every rig there is, by the name given to --backend."""
