"""The rig of hardware: what its configuration describes becomes drivers on a CAN bus, in real time.

A bench whose devices call themselves simulated is marked SIMULATED however it is reached: nothing
that came out of a simulator can be taken for a measurement.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from drivers.bus.analog.config import ReferenceConfig
from drivers.bus.cia401 import AnalogInput, AnalogModuleConfig
from drivers.bus.cia402.config import DriveConfig
from drivers.bus.cia402.tables import OperationMode
from drivers.bus.cia406 import CounterConfig
from drivers.bus.cyclic import CanRig, CanRigConfig
from drivers.bus.dictionary.device_file import load_device_file
from drivers.bus.listening import ListeningBus
from drivers.bus.motor_encoder import MotorEncoder
from drivers.bus.network import BusConfig, open_raw_bus, second_handle_words
from drivers.bus.rig_nodes import GuardContact
from drivers.bus.status_lines import Line, StatusLines
from drivers.channel import OUTPUT_ANGLE
from drivers.clock import WallClock
from drivers.errors import DriverError
from drivers.readout.nd287 import ReadoutConfig
from model.motor import ServoMotor
from rig.bench.backends.assembly import AssembledRig
from rig.bench.backends.order import Order, Setup
from rig.bench.backends.sources import Shafts, extensions_of, sources_of
from rig.bench.config import schema as described
from rig.bench.config.drives import Drive, ReferenceDrive
from rig.bench.config.load import load_configuration
from rig.bench.config.parts import Part
from rig.bench.config.place import DEFAULT_PATH
from rig.bench.config.schema import RigConfiguration
from rig.content.phrase import phrase
from rig.errors import ConfigurationError

_Config = TypeVar("_Config")

SPEED_ROOM = 1.5
"""Times the motor's greatest speed that a count must move within a cycle to have jumped."""
_MODES = {
    "cyclic velocity": OperationMode.CYCLIC_VELOCITY,
    "cyclic position": OperationMode.CYCLIC_POSITION,
    "profile velocity": OperationMode.PROFILE_VELOCITY,
    "cyclic torque": OperationMode.CYCLIC_TORQUE,
    "profile torque": OperationMode.PROFILE_TORQUE,
}


def hardware(order: Order, setup: Setup) -> AssembledRig:
    """The rig that an order's configuration describes. Raises `ConfigurationError`; nothing is connected yet."""
    path = order.config or DEFAULT_PATH
    configuration = load_configuration(path)
    ratio = order.gear.mounted_ratio(order.mounting) if setup.gear_mounted else 1.0
    cycle_ns = round(1e9 / order.sample_rate)
    config = can_rig_config(configuration, order.motor, path.parent, cycle_ns, ratio)
    bus, clock = bus_config(configuration), WallClock()
    fastest = SPEED_ROOM * order.motor.maximum_speed
    port = CanRig(
        config,
        clock,
        lambda: open_raw_bus(bus),
        sources=sources_of(configuration, Shafts(fastest, fastest / ratio), clock),
        time_base=bus.time_base,
    )
    real_time, guard = configuration.real_time, configuration.guard
    return AssembledRig(
        name="hardware",
        port=port,
        clock=clock,
        real_time=True,
        nodes=lambda: port.nodes,
        second_bus=lambda: open_raw_bus(bus),
        second_handle=second_handle_words(bus.interface),
        guard=None if guard is None else lambda: read_guard(port, guard),
        loss_covered_by=configuration.drive.computer_loss_covered_by,
        reaction=real_time.reaction_ms * 1e-3,
        priority=real_time.scheduler_priority,
        lock_memory=real_time.lock_memory,
        extensions=extensions_of(configuration),
        described=config,
        quiet_bus=lambda: ListeningBus(open_raw_bus(bus), clock, None),
    )


def read_guard(port: CanRig, guard: described.GuardInput) -> tuple[int, bool]:
    """The input of the guard's contact, and whether that means closed. Raises `DriverError`."""
    value = port.read_integer(guard.node_id, guard.settings()["entry"])
    return value, value & guard.mask == guard.closed


def bus_config(configuration: RigConfiguration) -> BusConfig:
    """How python-can reaches the bus."""
    values = configuration.bus.settings()
    stamps = values.pop("time_stamps")
    # The wrap of an adapter's clock is undone where the stamps are paired, not where frames are read.
    del values["stamp_wrap_s"]
    return BusConfig(**values, stamps=None if stamps == "automatic" else stamps)


def can_rig_config(
    configuration: RigConfiguration,
    motor: ServoMotor,
    folder: Path,
    cycle_ns: int,
    ratio: float = 1.0,
) -> CanRigConfig:
    """Drive, counters and modules as the drivers take them; EDS files are looked for in `folder`.

    A counter of the output angle that is given no largest speed turns at most as fast as the motor over `ratio`.
    """
    real_time, about = configuration.real_time, configuration.rig
    encoder, guard = configuration.motor_encoder, configuration.guard
    fastest = SPEED_ROOM * motor.maximum_speed
    rated_torque = configuration.drive.rated_torque or motor.rated_torque
    return CanRigConfig(
        cycle_ns=cycle_ns,
        drive=_drive(configuration.drive, motor, folder),
        motor_encoder=MotorEncoder(
            **encoder.settings(),
            largest_speed=fastest,
            long_name="motor encoder",
        ),
        counters=tuple(_counter(c, folder, fastest, ratio) for c in configuration.counters),
        modules=tuple(_module(m, rated_torque, folder) for m in configuration.analog_modules),
        guard=_configured(GuardContact, guard),
        patience_cycles=real_time.patience_cycles,
        stale_cycles=real_time.stale_cycles,
        stamp_wrap_ns=round(configuration.bus.stamp_wrap_s * 1e9),
        own_node_id=configuration.bus.own_node_id,
        title=about.name + phrase(", {}", about.location),
    )


def readout_config(configuration: RigConfiguration) -> ReadoutConfig | None:
    """The serial line of the readout, where there is one."""
    return _configured(ReadoutConfig, configuration.readout)


def _configured(kind: Callable[..., _Config], table: Part | None) -> _Config | None:
    """What the drivers make of the settings of a table; None where it was left away."""
    return None if table is None else kind(**table.settings())


def _node(
    node: Drive | ReferenceDrive | described.Counter | described.AnalogModule, folder: Path
) -> dict[str, Any]:
    """The settings of a node with the description of its EDS, where it has one, in place of the file's name."""
    values = node.settings()
    name = values.pop("eds")
    try:
        values["description"] = load_device_file(folder / name, node.node_id) if name else None
    except DriverError as error:
        raise ConfigurationError(
            f"the EDS cannot be used: {error}", where=f"node {node.node_id}", value=name
        ) from error
    return values


def _counter(
    counter: described.Counter, folder: Path, fastest: float, ratio: float
) -> CounterConfig:
    values = _node(counter, folder)
    if not values["largest_speed"]:
        values["largest_speed"] = fastest / ratio if counter.channel == OUTPUT_ANGLE else fastest
    return CounterConfig(**values)


def _drive(
    drive: Drive | ReferenceDrive, motor: ServoMotor, folder: Path
) -> DriveConfig | ReferenceConfig:
    values = _node(drive, folder)
    if isinstance(drive, ReferenceDrive):
        bits: dict[str, Any] = values.pop("lines").settings()
        lines: dict[str, Any] = {name: _configured(Line, bit) for name, bit in bits.items()}
        own = {name: lines.pop(name) for name in ("servo_on", "alarm_reset", "turning")}
        return ReferenceConfig(**values, **own, lines=StatusLines(**lines))
    for name in ("speed_modes", "torque_modes"):
        values[name] = tuple(_MODES[mode] for mode in values[name])
    return DriveConfig(**values, motor_torque=motor.rated_torque)


def _module(
    module: described.AnalogModule, rated_torque: float, folder: Path
) -> AnalogModuleConfig:
    inputs = tuple(AnalogInput(**analog.input_settings(rated_torque)) for analog in module.inputs)
    values = _node(module, folder)
    values["inputs"] = inputs
    return AnalogModuleConfig(**values)
