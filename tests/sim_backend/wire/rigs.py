"""A rig of the real drivers over the wire bench, in one process and in virtual time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from drivers import channel as names
from drivers.bus.cia301 import I16, I32, U8, ObjectRef
from drivers.bus.cia401 import AnalogInput, AnalogModuleConfig, torque_input
from drivers.bus.cia402.config import DriveConfig
from drivers.bus.cia406 import CounterConfig
from drivers.bus.cyclic import CanRig, CanRigConfig
from drivers.bus.motor_encoder import MotorEncoder
from drivers.clock import VirtualClock
from drivers.port import Command, Guard, Mode
from drivers.samples import SampleBlock
from model.units import RPM
from sim_backend.faults import Fault
from sim_backend.imperfections import Imperfections
from sim_backend.individuals import individual_gear
from sim_backend.servo_drive import SPEED_COUNT
from sim_backend.wire.bench import WireBench
from sim_backend.wire.line import BenchBus
from sim_backend.world import World
from tests.sim_backend.rigs import GEAR, MOTOR

VOLTS = 0.3125e-3
KELVIN_PER_VOLT = 32.0


def wire_config(cycle_ns: int = 1_000_000) -> CanRigConfig:
    """The configuration that gives the channels of the direct rig."""
    largest = 1.5 * MOTOR.maximum_speed
    thermometers = tuple(
        AnalogInput(
            channel=name,
            unit="degC",
            source=ObjectRef(0x6401, sub, I16, name),
            volts_per_count=VOLTS,
            unit_per_volt=KELVIN_PER_VOLT,
        )
        for name, sub in ((names.HOUSING_TEMPERATURE, 3), (names.AMBIENT_TEMPERATURE, 4))
    )
    counter = CounterConfig(
        node_id=2,
        position=ObjectRef(0x6004, 0, I32, "position"),
        index_position=ObjectRef(0x2000, 1, I32, "index position"),
        index_status=ObjectRef(0x2000, 2, U8, "index seen"),
        largest_speed=largest / 20.0,
    )
    return CanRigConfig(
        cycle_ns=cycle_ns,
        drive=DriveConfig(
            node_id=1,
            rated_torque=MOTOR.rated_torque,
            velocity_unit=SPEED_COUNT,
            quick_stop_option=6,
        ),
        motor_encoder=MotorEncoder(lines=8192, multiplication=4, largest_speed=largest),
        counters=(counter,),
        modules=(AnalogModuleConfig(3, (torque_input(MOTOR.rated_torque), *thermometers)),),
    )


@dataclass
class WireRig:
    """The bench, the bus of the client, and the drivers' rig in front of it."""

    bench: WireBench
    bus: BenchBus
    port: CanRig
    clock: VirtualClock


@contextmanager
def wire_rig(
    imperfections: Imperfections | None = None,
    seed: int = 7,
    faults: tuple[Fault, ...] = (),
    *,
    is_open: bool = True,
    tap: Callable[[BenchBus], None] | None = None,
) -> Iterator[WireRig]:
    """An opened rig on the wire with the gear of `tests.sim_backend.rigs`; closed in the end."""
    clock = VirtualClock()
    bench = WireBench(
        individual_gear(GEAR, 3), MOTOR, imperfections, World.of(seed), clock=clock, faults=faults
    )
    bus = bench.bus()
    if tap is not None:
        tap(bus)
    port = CanRig(
        wire_config(),
        clock,
        lambda: bus,
        pump=bench.pump,
        time_base="hardware",
        origin="simulated",
        truth=bench.truth,
    )
    try:
        if is_open:
            port.open()
        yield WireRig(bench, bus, port, clock)
    finally:
        port.close()
        bus.shutdown()


def turn(port: CanRig, speed_rpm: float, cycles: int, guard: Guard | None = None) -> SampleBlock:
    """A block at one speed set-point."""
    return port.exchange(
        Command(Mode.SPEED, np.full(cycles, speed_rpm * RPM)), cycles, guard or Guard()
    )


def off(port: CanRig, cycles: int) -> SampleBlock:
    """A block with the servo off."""
    return port.exchange(Command(Mode.OFF), cycles, Guard())
