"""The only place where concrete rigs are put together: a name becomes a `RigPort` with the clock it lives in."""

from __future__ import annotations

import time
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers import channel as names
from drivers.clock import Clock, VirtualClock
from drivers.port import RigPort
from model.gear import HarmonicDrive, Mounting
from model.motor import ServoMotor
from rig.errors import ConfigurationError

if TYPE_CHECKING:
    from sim_backend.wire.bench import WireBench


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
    if name.startswith(REPLAY):
        return _replayed(Path(name.removeprefix(REPLAY)))
    maker = BACKENDS.get(name)
    if maker is None:
        raise ConfigurationError(
            "no such rig", where="--backend", value=repr(name), limit=", ".join((*BACKENDS, f"{REPLAY}RUN.h5")),
            remedy="Choose one of these.",
        )  # fmt: skip
    return maker(request)


def _seeds(request: BenchRequest) -> dict[str, Any]:
    """Individual gear and motor, and every seed, as a simulated rig of either kind takes them."""
    from sim_backend.imperfections import individual_gear, individual_motor

    gear_seed = _mixed(request.seed, f"gear {request.serial}")
    return {
        "gear": individual_gear(request.gear, gear_seed),
        "motor": individual_motor(request.motor, request.seed),
        "seed": _mixed(request.seed, f"run {request.protocol}"),
        "cycle_ns": round(1e9 / request.sample_rate),
        "mounting": request.mounting,
        "gear_mounted": request.gear_mounted,
        "disc_inertia": request.disc_inertia,
        "bench_seed": request.seed,
        "gear_seed": gear_seed,
    }


def _simulated(request: BenchRequest) -> Bench:
    from sim_backend.direct import SimulatedRig

    clock = VirtualClock(time.time_ns())
    return Bench("sim", SimulatedRig(**_seeds(request), clock=clock), clock)


def _on_the_wire(request: BenchRequest) -> Bench:
    from sim_backend.wire.bench import WireBench

    made = _seeds(request)
    bench = WireBench(**made, clock=VirtualClock(time.time_ns()))
    return Bench("wire", wire_port(bench, made["motor"]), bench.clock)


def _replayed(path: Path) -> Bench:
    from rig.runfile.read import FileSource, open_run
    from sim_backend.replay import ReplayRig

    recording = open_run(path)
    source = recording.source
    if not isinstance(source, FileSource) or any(column.dtype == "float64" for column in source.columns):
        raise ConfigurationError(
            "only a run recorded in counts can be replayed", where=str(path), remedy="Analyse an imported run with `rig fit`."
        )
    channels = tuple(column.channel() for column in source.columns)
    counts = np.column_stack([source.stored(channel.name, 0, source.rows) for channel in channels])
    clock = VirtualClock(time.time_ns())
    port = ReplayRig(
        channels, source.time_ns(0, source.rows), counts, source.flags(0, source.rows),
        cycle_ns=round(1e9 / recording.metadata.sample_rate), title=f"replay of {recording.metadata.run_id}",
        truth=recording.metadata.process.get("truth"), clock=clock,
    )  # fmt: skip
    return Bench("replay", port, clock)


def wire_port(bench: WireBench, motor: ServoMotor) -> RigPort:
    """The real drivers in front of a simulated bench, on its pumped bus in virtual time."""
    from drivers.cia301 import I16, I32, U8, U32, ObjectRef
    from drivers.cia401 import AnalogInput, AnalogModuleConfig, torque_input
    from drivers.cia402 import DriveConfig
    from drivers.cia406 import CounterConfig
    from drivers.cyclic import CanRig, CanRigConfig
    from drivers.rig_nodes import MotorEncoder
    from sim_backend.wire.bench import ANALOG_INPUT_NODE, COUNTER_NODE, DRIVE_NODE

    by_name = {channel.name: channel for channel in bench.channels}
    inner, outer = by_name[names.INPUT_ANGLE], by_name[names.OUTPUT_ANGLE]
    thermometers = tuple(
        AnalogInput(name, "degC", ObjectRef(0x6401, sub, I16, name.replace("_", " ")), VOLTS_PER_INCREMENT, 32.0)
        for sub, name in ((3, names.HOUSING_TEMPERATURE), (4, names.AMBIENT_TEMPERATURE))
    )
    config = CanRigConfig(
        cycle_ns=bench.cycle_ns,
        drive=DriveConfig(DRIVE_NODE),
        motor_encoder=MotorEncoder(inner.lines, inner.multiplication, largest_speed=1.5 * motor.maximum_speed),
        counters=(
            CounterConfig(
                COUNTER_NODE, outer.lines, outer.multiplication, position=ObjectRef(0x6004, 0, I32, "position value"),
                index_position=ObjectRef(0x2000, 1, U32, "index position"),
                index_status=ObjectRef(0x2000, 2, U8, "index marks seen"), largest_speed=0.1 * motor.maximum_speed,
            ),
        ),
        modules=(AnalogModuleConfig(ANALOG_INPUT_NODE, (torque_input(motor.rated_torque), *thermometers)),),
        title=bench.title,
    )  # fmt: skip
    return CanRig(
        config, bench.clock, bench.bus, pump=bench.pump, time_base="hardware", origin="simulated", truth=bench.truth
    )


def _mixed(seed: int, name: str) -> int:
    """One seed out of a seed and a name, the same on every computer."""
    return (seed << 32) ^ zlib.crc32(name.encode())


REPLAY = "replay:"
"""What stands before the run file in the name of a replay."""
VOLTS_PER_INCREMENT = 0.3125e-3
"""Volts per increment of the simulated analogue input."""
BACKENDS: dict[str, Callable[[BenchRequest], Bench]] = {"sim": _simulated, "wire": _on_the_wire}
"""Every rig there is, by the name given to --backend; a replay is named by its file."""
