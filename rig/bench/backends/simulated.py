"""The simulated rigs: directly behind the port, or on the wire behind the real drivers, both in virtual time."""

from __future__ import annotations

import math
import time
import zlib
from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any, Literal

from drivers import channel as names
from drivers.channel import Channel
from drivers.clock import Clock, VirtualClock
from drivers.port import DriveLimits, RigPort
from model.angle_certificate import AngleCertificate
from model.gear import HarmonicDrive
from model.gear_file import gear_to_mapping
from model.motor import ServoMotor
from model.units import RPM
from rig.bench.backends.assembly import AssembledRig
from rig.bench.backends.order import Order, Setup, StartState
from rig.bench.limits import derive_limits
from sim_backend.population import drawn
from sim_backend.world import ThermalState, World

if TYPE_CHECKING:
    from drivers.bus.analog.config import ReferenceConfig
    from drivers.bus.cia301 import ObjectRef
    from drivers.bus.cia402.tables import OperationMode
    from drivers.bus.cia406 import CounterConfig
    from drivers.bus.cyclic import CanRig, CanRigConfig
    from drivers.bus.motor_encoder import MotorEncoder
    from drivers.bus.rig_nodes import GuardContact
    from drivers.source import Source
    from sim_backend.direct import SimulatedRig
    from sim_backend.wire.analog_amplifier import ReferenceDevice
    from sim_backend.wire.bench import WireBench

_FASTEST_RAMP = 1e5
"""A ramp that is none [rad/s2]: a set-point by voltage may jump."""
ADJUSTED_VOLTS, ADJUSTED_SCALE = 2e-4, 2e-3
"""How well zero [V] and scale of a reference by voltage are known after it was adjusted: standard uncertainties."""
_VOLTS_PER_INCREMENT = 0.3125e-3
"""Volts per increment of the simulated analogue input."""


def world_of(order: Order) -> World:
    """The world of an order: a serial number is a gear, a seed is a bench; a gear that is mounted at an angle for this
    run is fitted anew.
    """
    world = order.world.world(zlib.crc32(order.serial.encode()), order.seed)
    turn = order.values.get("mounted_at_deg")
    if turn is None or world.mount_turn is not None:
        return world
    anew = world.mount + 1 + round(10.0 * (float(turn) % 360.0))
    return replace(world, mount=anew, mount_turn=math.radians(float(turn)))


def world_record(order: Order) -> dict[str, Any]:
    """The world of an order as its run file tells it, and as `WorldChoice` takes it again."""
    choice = order.world
    start = choice.start or StartState()
    record: dict[str, Any] = {
        **asdict(world_of(order)),
        "start": {"run": start.run, **start.temperatures},
    }
    if choice.repeats:
        record["repeats"] = choice.repeats
    if choice.population != "narrow":
        # The run's own gear is the nameplate of the one that was drawn; this is what it was drawn about.
        record["drawn_about"] = gear_to_mapping(order.gear)
    return record


def nameplates(order: Order) -> tuple[HarmonicDrive, ServoMotor]:
    """Gear and motor as plan and analysis get them."""
    made = drawn(order.gear, order.motor, world_of(order))
    return made.card, made.motor_card


def parts_of(order: Order, setup: Setup) -> dict[str, Any]:
    """Individual gear and motor, bench and world, as a simulated rig of either kind takes them."""
    from sim_backend.imperfections import Imperfections

    world, start = world_of(order), order.world.start or StartState()
    made = drawn(order.gear, order.motor, world)
    return {
        "gear": made.gear,
        "motor": made.motor,
        "imperfections": Imperfections(sizes=made.sizes),
        "world": world,
        "start": ThermalState(**start.temperatures) if start.temperatures else None,
        "cycle_ns": round(1e9 / order.sample_rate),
        "mounting": order.mounting,
        "gear_mounted": setup.gear_mounted,
        "disc_inertia": setup.disc_inertia,
    }


def _clock_of(order: Order) -> VirtualClock:
    """The clock of a simulated rig: it begins now, unless the order says when."""
    return VirtualClock(time.time_ns() if order.calendar_ns is None else order.calendar_ns)


def certificate_of(order: Order, which: Literal["input", "output"]) -> AngleCertificate:
    """The certificate of an encoder of the order's bench, as a laboratory would have written it."""
    from sim_backend.certificate import encoder_certificate

    parts = parts_of(order, Setup())
    return encoder_certificate(parts["imperfections"], which, parts["world"])


def assembled(
    name: str,
    port: RigPort,
    clock: Clock,
    plant: SimulatedRig | WireBench,
    order: Order,
    **on_the_bus: Any,
) -> AssembledRig:
    """A simulated rig as a run takes it; `plant` is what is behind the port, `on_the_bus` what one on the wire has."""
    return AssembledRig(
        name=name,
        port=port,
        clock=clock,
        **on_the_bus,
        world=world_record(order),
        thermal_state=lambda: {
            "end": asdict(plant.thermal_state),
            "mean": asdict(plant.mean_temperatures),
        },
    )


def of_bus(bench: WireBench, port: CanRig) -> dict[str, Any]:
    """What an assembled rig has more because it is on a bus: its nodes, its description, a way to listen, a person."""
    from drivers.bus.listening import ListeningBus
    from sim_backend.wire.person import Person

    return {
        "nodes": lambda: port.nodes,
        "described": port.config,
        "quiet_bus": lambda: ListeningBus(bench.bus(), bench.clock, bench.pump),
        "person": Person(bench).act,
    }


def simulated(order: Order, setup: Setup) -> AssembledRig:
    """The plant directly behind the port: the fastest rig there is."""
    from sim_backend.direct import SimulatedRig

    clock = _clock_of(order)
    port = SimulatedRig(**parts_of(order, setup), clock=clock)
    return assembled("sim", port, clock, port, order)


def on_the_wire(order: Order, setup: Setup) -> AssembledRig:
    """The plant behind simulated CANopen devices, on a pumped bus; the drivers are those of a rig of hardware."""
    from sim_backend.wire.bench import WireBench

    parts = parts_of(order, setup)
    bench = WireBench(**parts, clock=_clock_of(order))
    port = wire_port(
        bench, parts["motor"], wire_config(bench, parts["motor"], has_guard=setup.watches_contact)
    )
    return assembled("wire", port, bench.clock, bench, order, **of_bus(bench, port))


def on_the_wire_by_position(order: Order, setup: Setup) -> AssembledRig:
    """The same bench whose drive is led by target positions (cyclic synchronous position)."""
    from sim_backend.wire.bench import WireBench

    parts = parts_of(order, setup)
    bench = WireBench(**parts, clock=_clock_of(order))
    config = position_config(bench, parts["motor"], has_guard=setup.watches_contact)
    port = wire_port(bench, parts["motor"], config)
    return assembled("wire-csp", port, bench.clock, bench, order, **of_bus(bench, port))


def position_config(
    bench: WireBench, motor: ServoMotor, *, has_guard: bool = False
) -> CanRigConfig:
    """What the drivers are told of a simulated bench whose drive is to be led by target positions."""
    from drivers.bus.cia402.tables import OperationMode

    return _in_mode(OperationMode.CYCLIC_POSITION, bench, motor, has_guard=has_guard)


def profile_config(bench: WireBench, motor: ServoMotor, *, has_guard: bool = False) -> CanRigConfig:
    """What the drivers are told of a simulated bench whose drive has profile velocity and no cyclic velocity."""
    from drivers.bus.cia402.tables import OperationMode

    return _in_mode(OperationMode.PROFILE_VELOCITY, bench, motor, has_guard=has_guard)


def _in_mode(
    mode: OperationMode, bench: WireBench, motor: ServoMotor, *, has_guard: bool
) -> CanRigConfig:
    from drivers.bus.cia402.config import DriveConfig
    from sim_backend.wire.bench import DRIVE_NODE

    drive = DriveConfig(node_id=DRIVE_NODE, speed_modes=(mode,))
    return replace(wire_config(bench, motor, has_guard=has_guard), drive=drive)


def on_the_wire_with_box(order: Order, setup: Setup) -> AssembledRig:
    """The same bench with the output encoder's counter on TCP instead of on the bus."""
    from sim_backend.wire.bench import WireBench

    parts = parts_of(order, setup)
    bench = WireBench(**parts, clock=_clock_of(order))
    port = box_port(bench, parts["motor"], has_guard=setup.watches_contact)
    return assembled("wire-box", port, bench.clock, bench, order, **of_bus(bench, port))


def on_the_wire_by_reference(order: Order, setup: Setup) -> AssembledRig:
    """The same bench turned by an amplifier by analog reference, with the motor's pulses on a counter."""
    from sim_backend.wire.bench import WireBench

    parts = parts_of(order, setup)
    bench = WireBench(
        **parts, clock=_clock_of(order), reference=reference_device(order, parts["motor"], setup)
    )
    config = reference_config(bench, parts["motor"], has_guard=setup.watches_contact)
    port = wire_port(bench, parts["motor"], config)
    return assembled("wire-analog", port, bench.clock, bench, order, **of_bus(bench, port))


def reference_device(order: Order, motor: ServoMotor, setup: Setup = Setup()) -> ReferenceDevice:
    """The simulated amplifier as somebody has set it by its tool for this gear: torque in whole per cent of the rated,
    speed in whole r/min, both rounded down.
    """
    from sim_backend.wire.analog_amplifier import ReferenceDevice

    allowed = derive_limits(
        order.gear,
        motor,
        order.mounting,
        gear_mounted=setup.gear_mounted,
        disc_inertia=setup.disc_inertia,
    ).drive_limits()
    per_cent = 0.01 * motor.rated_torque
    held = DriveLimits(
        torque=per_cent * math.floor(allowed.torque / per_cent),
        speed=RPM * math.floor(allowed.speed / RPM),
        acceleration=_FASTEST_RAMP,
        deceleration=_FASTEST_RAMP,
        quick_stop_deceleration=_FASTEST_RAMP,
    )
    return ReferenceDevice(limits=held)


def reference_config(
    bench: WireBench, motor: ServoMotor, *, has_guard: bool = False
) -> CanRigConfig:
    """What the drivers are told of a simulated bench that is turned by analog reference."""
    from drivers.bus.cia301 import U8, ObjectRef
    from sim_backend.wire import analog_amplifier as simulated
    from sim_backend.wire.bench import MOTOR_COUNTER_NODE

    amplifier = bench.drive
    assert isinstance(amplifier, simulated.AnalogAmplifier)
    usual = wire_config(bench, motor)
    encoder = usual.motor_encoder
    pulses = replace(
        _counter(MOTOR_COUNTER_NODE, encoder, encoder.largest_speed),
        channel=names.INPUT_ANGLE,
        index_channel=names.INPUT_INDEX,
    )
    inputs = ObjectRef(0x6000, 1, U8, "digital inputs")
    return replace(
        usual,
        drive=_reference(amplifier.device),
        counters=(pulses, *usual.counters),
        guard=_guard(inputs, simulated.GUARD, has_guard),
    )


def _reference(device: ReferenceDevice) -> ReferenceConfig:
    """What the drivers are told of an amplifier that takes its set-point as a voltage."""
    from drivers.bus.analog.config import ReferenceConfig
    from drivers.bus.status_lines import Line, StatusLines
    from sim_backend.wire import analog_amplifier as simulated
    from sim_backend.wire.bench import DRIVE_NODE

    return ReferenceConfig(
        node_id=DRIVE_NODE,
        speed_per_volt=device.speed_per_volt,
        volts_per_count=simulated.VOLTS_PER_COUNT,
        zero_uncertainty_volts=ADJUSTED_VOLTS,
        scale_relative_uncertainty=ADJUSTED_SCALE,
        servo_on=Line(simulated.SERVO_ON),
        alarm_reset=Line(simulated.ALARM_RESET),
        turning=Line(simulated.ROTATION),
        lines=StatusLines(
            alarm=Line(simulated.NO_ALARM, active_high=False),
            power=Line(simulated.POWER),
            ready=Line(simulated.READY),
            reached=Line(simulated.COINCIDENCE),
        ),
        limits_by_hand=replace(
            device.limits,
            acceleration=math.inf,
            deceleration=math.inf,
            quick_stop_deceleration=math.inf,
        ),
    )


def _counter(node_id: int, encoder: Channel | MotorEncoder, largest_speed: float) -> CounterConfig:
    """A node that counts the lines of an encoder and latches its index mark."""
    from drivers.bus.cia301 import I32, U8, U32, ObjectRef
    from drivers.bus.cia406 import CounterConfig

    return CounterConfig(
        node_id=node_id,
        lines=encoder.lines,
        multiplication=encoder.multiplication,
        position=ObjectRef(0x6004, 0, I32, "position value"),
        index_position=ObjectRef(0x2000, 1, U32, "index position"),
        index_status=ObjectRef(0x2000, 2, U8, "index marks seen"),
        largest_speed=largest_speed,
        calibration=encoder.calibration,
    )


def _guard(entry: ObjectRef, bit: int, has_guard: bool) -> GuardContact | None:
    """The guard's contact at a digital input of the drive, closed where its bit is set; None of a bench without it."""
    from drivers.bus.rig_nodes import GuardContact
    from sim_backend.wire.bench import DRIVE_NODE

    if not has_guard:
        return None
    return GuardContact(node_id=DRIVE_NODE, entry=entry, mask=bit, closed=bit)


def box_port(
    bench: WireBench,
    motor: ServoMotor,
    *,
    latched_by: Literal["trigger", "request"] = "trigger",
    has_guard: bool = False,
) -> CanRig:
    """The drivers in front of a bench whose output encoder is counted by a box on TCP."""
    from drivers.readout.counter_box import CounterBox, CounterBoxConfig

    outer = {channel.name: channel for channel in bench.channels}[names.OUTPUT_ANGLE]
    box = CounterBoxConfig(
        channel=names.OUTPUT_ANGLE,
        lines=outer.lines,
        multiplication=outer.multiplication,
        latched_by=latched_by,
        largest_speed=0.1 * motor.maximum_speed,
        calibration=outer.calibration,
    )
    config = replace(wire_config(bench, motor, has_guard=has_guard), counters=())
    return wire_port(bench, motor, config, [CounterBox(box, bench.clock, bench.box_line)])


def wire_port(
    bench: WireBench,
    motor: ServoMotor,
    config: CanRigConfig | None = None,
    sources: Sequence[Source] = (),
) -> CanRig:
    """The real drivers in front of a simulated bench, on its pumped bus in virtual time; `config`
    where it is not the usual, `sources` beside the bus.
    """
    from drivers.bus.cyclic import CanRig

    return CanRig(
        config or wire_config(bench, motor),
        bench.clock,
        bench.bus,
        sources=sources,
        pump=bench.pump,
        time_base="hardware",
        origin="simulated",
        truth=bench.truth,
    )


def wire_config(bench: WireBench, motor: ServoMotor, *, has_guard: bool = False) -> CanRigConfig:
    """What the drivers are told of a simulated bench; `has_guard`: its guard's contact is watched in every cycle."""
    from drivers.bus.cia301 import I16, U32, ObjectRef
    from drivers.bus.cia401 import AnalogInput, AnalogModuleConfig, torque_input
    from drivers.bus.cia402.config import DriveConfig
    from drivers.bus.cyclic import CanRigConfig
    from drivers.bus.motor_encoder import MotorEncoder
    from sim_backend.wire.bench import ANALOG_INPUT_NODE, COUNTER_NODE, DRIVE_NODE
    from sim_backend.wire.drive import INTERLOCK

    by_name = {channel.name: channel for channel in bench.channels}
    inner, outer = by_name[names.INPUT_ANGLE], by_name[names.OUTPUT_ANGLE]
    thermometers = tuple(
        AnalogInput(
            channel=name,
            unit="degC",
            source=ObjectRef(0x6401, sub, I16, name.replace("_", " ")),
            volts_per_count=_VOLTS_PER_INCREMENT,
            unit_per_volt=32.0,
            calibration=by_name[name].calibration,
        )
        for sub, name in ((3, names.HOUSING_TEMPERATURE), (4, names.AMBIENT_TEMPERATURE))
    )
    # The instruments are the same as without a wire, and as well known.
    torque = torque_input(motor.rated_torque, calibration=by_name[names.TORQUE].calibration)
    inputs = ObjectRef(0x60FD, 0, U32, "digital inputs")
    return CanRigConfig(
        cycle_ns=bench.cycle_ns,
        drive=DriveConfig(node_id=DRIVE_NODE),
        motor_encoder=MotorEncoder(
            lines=inner.lines,
            multiplication=inner.multiplication,
            largest_speed=1.5 * motor.maximum_speed,
            calibration=inner.calibration,
        ),
        counters=(_counter(COUNTER_NODE, outer, 0.1 * motor.maximum_speed),),
        modules=(AnalogModuleConfig(ANALOG_INPUT_NODE, (torque, *thermometers)),),
        guard=_guard(inputs, INTERLOCK, has_guard),
        title=bench.title,
    )
