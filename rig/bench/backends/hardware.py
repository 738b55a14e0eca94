"""The rig of hardware: what its configuration describes becomes drivers on a CAN bus, in real time.

A bench whose devices call themselves simulated is marked SIMULATED however it is reached: nothing
that came out of a simulator can be taken for a measurement.
"""

from __future__ import annotations

import math
from pathlib import Path

from drivers.bus import BusConfig, open_raw_bus
from drivers.channel import Calibration
from drivers.cia301 import ObjectRef
from drivers.cia401 import AnalogInput, AnalogModuleConfig, torque_input
from drivers.cia402 import DriveConfig
from drivers.cia402_tables import OperationMode
from drivers.cia406 import CounterConfig
from drivers.clock import WallClock
from drivers.cyclic import CanRig, CanRigConfig
from drivers.eds import DeviceDescription, load_eds
from drivers.errors import DriverError
from drivers.nd287 import ReadoutConfig
from drivers.rig_nodes import GuardContact, MotorEncoder
from model.motor import ServoMotor
from model.units import RPM
from rig.bench.backends.assembly import AssembledRig, RigRequest
from rig.bench.config import schema as described
from rig.bench.config.load import DEFAULT_PATH, load_configuration
from rig.bench.config.objects import read_object
from rig.bench.config.schema import RigConfiguration
from rig.errors import ConfigurationError

_MODES = {
    "cyclic velocity": OperationMode.CYCLIC_VELOCITY,
    "profile velocity": OperationMode.PROFILE_VELOCITY,
    "cyclic torque": OperationMode.CYCLIC_TORQUE,
    "profile torque": OperationMode.PROFILE_TORQUE,
}


def hardware(request: RigRequest) -> AssembledRig:
    """The rig that the request's configuration describes. Raises `ConfigurationError`; nothing is connected yet."""
    path = request.configuration or DEFAULT_PATH
    configuration = load_configuration(path)
    config = can_rig_config(
        configuration, request.motor, path.parent, round(1e9 / request.sample_rate)
    )
    bus, clock = bus_config(configuration), WallClock()
    port = CanRig(config, clock, lambda: open_raw_bus(bus), time_base=bus.time_base)
    real_time, guard = configuration.real_time, configuration.guard
    return AssembledRig(
        name="hardware",
        port=port,
        clock=clock,
        real_time=True,
        second_bus=lambda: open_raw_bus(bus),
        guard=None if guard is None else lambda: _read_guard(port, guard),
        reaction=real_time.reaction_ms * 1e-3,
        priority=real_time.scheduler_priority,
        lock_memory=real_time.lock_memory,
    )


def _read_guard(port: CanRig, guard: described.GuardInput) -> tuple[int, bool]:
    value = port.read_integer(guard.node_id, read_object(guard.object, "guard input"))
    return value, value & guard.mask == guard.closed


def bus_config(configuration: RigConfiguration) -> BusConfig:
    """How python-can reaches the bus."""
    bus = configuration.bus
    stamps = None if bus.time_stamps == "automatic" else bus.time_stamps
    return BusConfig(
        bus.interface, bus.channel, bus.bit_rate, bus.arguments, stamps, bus.own_node_id
    )


def can_rig_config(
    configuration: RigConfiguration, motor: ServoMotor, folder: Path, cycle_ns: int
) -> CanRigConfig:
    """Drive, counters and modules as the drivers take them; EDS files are looked for in `folder`."""
    real_time = configuration.real_time
    return CanRigConfig(
        cycle_ns=cycle_ns,
        drive=_drive(configuration.drive, folder),
        motor_encoder=_motor_encoder(configuration.motor_encoder, motor),
        counters=tuple(_counter(counter, folder) for counter in configuration.counters),
        modules=tuple(
            _module(module, configuration, motor, folder) for module in configuration.analog_modules
        ),
        guard=_guard(configuration.guard),
        patience_cycles=real_time.patience_cycles,
        stale_cycles=real_time.stale_cycles,
        stamp_wrap_ns=round(configuration.bus.stamp_wrap_s * 1e9),
        own_node_id=configuration.bus.own_node_id,
        title=configuration.rig.name
        + (f", {configuration.rig.location}" if configuration.rig.location else ""),
    )


def readout_config(configuration: RigConfiguration) -> ReadoutConfig | None:
    """The serial line of the readout, where there is one."""
    found = configuration.readout
    if found is None:
        return None
    return ReadoutConfig(
        url=found.url,
        baud=found.baud_rate,
        data_bits=found.data_bits,
        parity=found.parity,
        stop_bits=found.stop_bits,
        xon_xoff=found.xon_xoff,
        storage_delay_ms=found.storage_delay_ms,
        answer_ms=found.answer_ms,
    )


def _description(name: str, folder: Path, node_id: int) -> DeviceDescription | None:
    if not name:
        return None
    try:
        return load_eds(folder / name, node_id)
    except DriverError as error:
        raise ConfigurationError(
            f"the EDS cannot be used: {error}", where=f"node {node_id}", value=name
        ) from error


def _object(text: str | None, name: str) -> ObjectRef | None:
    return None if text is None else read_object(text, name)


def _calibration(found: described.Calibration) -> Calibration:
    return Calibration(
        found.certificate,
        str(found.date or ""),
        str(found.due or ""),
        found.scale_relative_uncertainty,
        found.offset_uncertainty,
        found.accuracy,
    )


def _guard(guard: described.GuardInput | None) -> GuardContact | None:
    if guard is None:
        return None
    return GuardContact(
        guard.node_id, read_object(guard.object, "guard input"), guard.mask, guard.closed
    )


def _drive(drive: described.Drive, folder: Path) -> DriveConfig:
    return DriveConfig(
        node_id=drive.node_id,
        description=_description(drive.eds, folder, drive.node_id),
        counts_per_revolution=drive.counts_per_revolution,
        velocity_unit=drive.velocity_unit_rad_s,
        acceleration_unit=drive.acceleration_unit_rad_s2,
        rated_torque=drive.rated_torque_n_m,
        speed_modes=tuple(_MODES[mode] for mode in drive.speed_modes),
        torque_modes=tuple(_MODES[mode] for mode in drive.torque_modes),
        heartbeat_ms=drive.heartbeat_ms,
        computer_heartbeat_ms=drive.computer_heartbeat_ms,
        computer_lost_ms=drive.computer_lost_ms,
        abort_connection_option=drive.abort_connection_option,
        quick_stop_option=drive.quick_stop_option,
        fault_reaction_option=drive.fault_reaction_option,
        state_timeout_ms=drive.state_timeout_ms,
        sdo_timeout_ms=drive.sdo_timeout_ms,
        gains=tuple(read_object(text, "servo gain") for text in drive.gains),
        latch_index=drive.latch_index,
        actual_torque=read_object(drive.actual_torque, "torque actual value"),
        torque_unit=drive.torque_unit_n_m,
    )


def _motor_encoder(encoder: described.MotorEncoder, motor: ServoMotor) -> MotorEncoder:
    return MotorEncoder(
        lines=encoder.lines,
        multiplication=encoder.multiplication,
        direction=encoder.direction,
        largest_speed=1.5 * motor.maximum_speed,
        modulus=encoder.modulus,
        index_position=_object(encoder.index_position, "index position"),
        index_status=_object(encoder.index_status, "index status"),
        index_mask=encoder.index_mask,
        long_name="motor encoder",
        model=encoder.model,
        serial_number=encoder.serial_number,
        calibration=_calibration(encoder.calibration),
    )


def _counter(counter: described.Counter, folder: Path) -> CounterConfig:
    position = read_object(counter.position, "position value")
    return CounterConfig(
        node_id=counter.node_id,
        lines=counter.lines,
        multiplication=counter.multiplication,
        direction=counter.direction,
        channel=counter.channel,
        index_channel=counter.index_channel,
        position=position,
        modulus=counter.modulus,
        operating_parameters=counter.operating_parameters,
        alarms=_object(counter.alarms, "alarms"),
        alarm_mask=counter.alarm_mask,
        index_position=_object(counter.index_position, "index position"),
        index_status=_object(counter.index_status, "index marks seen"),
        index_mask=counter.index_mask,
        largest_speed=counter.largest_speed_rpm * RPM,
        description=_description(counter.eds, folder, counter.node_id),
        heartbeat_ms=counter.heartbeat_ms,
        sdo_timeout_ms=counter.sdo_timeout_ms,
        model=counter.model,
        serial_number=counter.serial_number,
        calibration=_calibration(counter.calibration),
    )


def _module(
    module: described.AnalogModule, configuration: RigConfiguration, motor: ServoMotor, folder: Path
) -> AnalogModuleConfig:
    rated = configuration.drive.rated_torque_n_m or motor.rated_torque
    return AnalogModuleConfig(
        module.node_id,
        tuple(_analog_input(found, rated) for found in module.inputs),
        _description(module.eds, folder, module.node_id),
        module.heartbeat_ms,
        module.sdo_timeout_ms,
    )


def _analog_input(found: described.AnalogInput, rated_torque: float) -> AnalogInput:
    source = read_object(found.object, f"analogue input of {found.channel}")
    details = {
        "zero_volts": found.zero_volts,
        "full_scale": found.full_scale_volts,
        "open_level": found.open_level_volts,
        "direction": found.direction,
        "model": found.model,
        "serial_number": found.serial_number,
        "calibration": _calibration(found.calibration),
    }
    if found.volts_per_rated_torque is not None:
        return torque_input(
            rated_torque,
            volts_per_rated_torque=found.volts_per_rated_torque,
            index=source.index,
            subindex=source.subindex,
            data_type=source.data_type,
            volts_per_count=found.volts_per_count,
            **details,
        )
    per_volt = found.unit_per_volt if found.unit_per_volt is not None else math.nan
    return AnalogInput(
        channel=found.channel,
        unit=found.unit,
        source=source,
        volts_per_count=found.volts_per_count,
        unit_per_volt=per_volt,
        **details,
    )  # type: ignore[arg-type]
