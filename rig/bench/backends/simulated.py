"""The simulated rigs: directly behind the port, or on the wire behind the real drivers, both in virtual time."""

from __future__ import annotations

import time
import zlib
from typing import TYPE_CHECKING, Any

from drivers import channel as names
from drivers.clock import VirtualClock
from model.motor import ServoMotor
from rig.bench.backends.assembly import AssembledRig, RigRequest

if TYPE_CHECKING:
    from drivers.cyclic import CanRig, CanRigConfig
    from sim_backend.wire.bench import WireBench

VOLTS_PER_INCREMENT = 0.3125e-3
"""Volts per increment of the simulated analogue input."""


def seeds_of(request: RigRequest) -> dict[str, Any]:
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


def simulated(request: RigRequest) -> AssembledRig:
    """The plant directly behind the port: the fastest rig there is."""
    from sim_backend.direct import SimulatedRig

    clock = VirtualClock(time.time_ns())
    return AssembledRig(
        name="sim", port=SimulatedRig(**seeds_of(request), clock=clock), clock=clock
    )


def on_the_wire(request: RigRequest) -> AssembledRig:
    """The plant behind simulated CANopen devices, on a pumped bus; the drivers are those of a rig of hardware."""
    from sim_backend.wire.bench import WireBench

    seeds = seeds_of(request)
    bench = WireBench(**seeds, clock=VirtualClock(time.time_ns()))
    return AssembledRig(name="wire", port=wire_port(bench, seeds["motor"]), clock=bench.clock)


def wire_port(bench: WireBench, motor: ServoMotor, config: CanRigConfig | None = None) -> CanRig:
    """The real drivers in front of a simulated bench, on its pumped bus in virtual time; `config`
    where it is not the usual.
    """
    from drivers.cyclic import CanRig

    return CanRig(
        config or wire_config(bench, motor),
        bench.clock,
        bench.bus,
        pump=bench.pump,
        time_base="hardware",
        origin="simulated",
        truth=bench.truth,
    )


def wire_config(bench: WireBench, motor: ServoMotor, *, has_guard: bool = False) -> CanRigConfig:
    """What the drivers are told of a simulated bench; `has_guard`: its guard's contact is watched in every cycle."""
    from drivers.cia301 import I16, I32, U8, U32, ObjectRef
    from drivers.cia401 import AnalogInput, AnalogModuleConfig, torque_input
    from drivers.cia402 import DriveConfig
    from drivers.cia406 import CounterConfig
    from drivers.cyclic import CanRigConfig
    from drivers.rig_nodes import GuardContact, MotorEncoder
    from sim_backend.wire.bench import ANALOG_INPUT_NODE, COUNTER_NODE, DRIVE_NODE
    from sim_backend.wire.drive import INTERLOCK

    by_name = {channel.name: channel for channel in bench.channels}
    inner, outer = by_name[names.INPUT_ANGLE], by_name[names.OUTPUT_ANGLE]
    thermometers = tuple(
        AnalogInput(
            channel=name,
            unit="degC",
            source=ObjectRef(0x6401, sub, I16, name.replace("_", " ")),
            volts_per_count=VOLTS_PER_INCREMENT,
            unit_per_volt=32.0,
        )
        for sub, name in ((3, names.HOUSING_TEMPERATURE), (4, names.AMBIENT_TEMPERATURE))
    )
    return CanRigConfig(
        cycle_ns=bench.cycle_ns,
        drive=DriveConfig(node_id=DRIVE_NODE),
        motor_encoder=MotorEncoder(
            lines=inner.lines,
            multiplication=inner.multiplication,
            largest_speed=1.5 * motor.maximum_speed,
        ),
        counters=(
            CounterConfig(
                node_id=COUNTER_NODE,
                lines=outer.lines,
                multiplication=outer.multiplication,
                position=ObjectRef(0x6004, 0, I32, "position value"),
                index_position=ObjectRef(0x2000, 1, U32, "index position"),
                index_status=ObjectRef(0x2000, 2, U8, "index marks seen"),
                largest_speed=0.1 * motor.maximum_speed,
            ),
        ),
        modules=(
            AnalogModuleConfig(
                ANALOG_INPUT_NODE, (torque_input(motor.rated_torque), *thermometers)
            ),
        ),
        guard=GuardContact(
            node_id=DRIVE_NODE,
            entry=ObjectRef(0x60FD, 0, U32, "digital inputs"),
            mask=INTERLOCK,
            closed=INTERLOCK,
        )
        if has_guard
        else None,
        title=bench.title,
    )


def _mixed(seed: int, name: str) -> int:
    """One seed out of a seed and a name, the same on every computer."""
    return (seed << 32) ^ zlib.crc32(name.encode())
