"""An encoder or counter on the bus by CiA 406, or any counter whose object, type and range are configured.

0x6004 is unsigned and wraps at the total measuring range 0x6002, which need not be a power of two.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from drivers.bus.cia301 import U16, U32, ObjectRef
from drivers.bus.device import Identity, RemoteDevice
from drivers.bus.dictionary.eds import DeviceDescription
from drivers.bus.network import PumpedBus
from drivers.bus.sdo import SdoAbortError
from drivers.channel import OUTPUT_ANGLE, OUTPUT_INDEX, Calibration, Channel, encoder_channel
from drivers.errors import DriverError

_OPERATING_PARAMETERS: Final = ObjectRef(0x6000, 0, U16, "operating parameters")
UNITS_PER_REVOLUTION: Final = ObjectRef(0x6001, 0, U32, "measuring units per revolution")
TOTAL_RANGE: Final = ObjectRef(0x6002, 0, U32, "total measuring range")
POSITION: Final = ObjectRef(0x6004, 0, U32, "position value")
_CYCLIC_TIMER: Final = ObjectRef(0x6200, 0, U16, "cyclic timer")
_STEPS_PER_REVOLUTION: Final = ObjectRef(0x6501, 0, U32, "single-turn resolution")
_REVOLUTIONS: Final = ObjectRef(0x6502, 0, U16, "number of distinguishable revolutions")
_ALARMS: Final = ObjectRef(0x6503, 0, U16, "alarms")
_MS: Final = 1_000_000


@dataclass(frozen=True, kw_only=True)
class CounterConfig:
    """A counter: node-ID, lines and multiplication of its encoder, the object that carries the count, and its range.

    `modulus` 0: from 0x6002, else the range of the object's type. `direction` +1 or -1 turns the
    sense on the computer's side; `operating_parameters` is written to 0x6000 where given. `alarms`
    is mapped beside the position, and a value with any bit of `alarm_mask` marks the cycle as a
    signal error. `index_position` is the object that holds the count latched at the index mark,
    `index_status` and `index_mask` tell that a mark has been seen; CiA 406 knows none of them.
    `largest_speed` [rad/s] of the shaft bounds a count's step per cycle; 0: that of the motor.
    """

    node_id: int = 2
    lines: int = 18000
    multiplication: int = 4
    direction: int = 1
    channel: str = OUTPUT_ANGLE
    index_channel: str = OUTPUT_INDEX
    position: ObjectRef = POSITION
    modulus: int = 0
    operating_parameters: int | None = None
    alarms: ObjectRef | None = _ALARMS
    alarm_mask: int = 0xFFFF
    index_position: ObjectRef | None = None
    index_status: ObjectRef | None = None
    index_mask: int = 0x0001
    largest_speed: float = 0.0
    description: DeviceDescription | None = None
    heartbeat_ms: int = 100
    sdo_timeout_ms: int = 300
    long_name: str = ""
    model: str = ""
    serial_number: str = ""
    calibration: Calibration = field(default_factory=Calibration)

    def as_channel(self, modulus: int) -> Channel:
        """The count as an angle channel."""
        return encoder_channel(
            self.channel,
            lines=self.lines,
            multiplication=self.multiplication,
            direction=self.direction,
            modulus=modulus,
            long_name=self.long_name,
            model=self.model,
            serial_number=self.serial_number,
            calibration=self.calibration,
        )


class Counter:
    """The counter on the bus; brought up and checked by SDO, read by PDO."""

    def __init__(
        self, bus: PumpedBus, config: CounterConfig, device: RemoteDevice | None = None
    ) -> None:
        self.config = config
        self.device = device or RemoteDevice(
            bus, config.node_id, config.description, config.sdo_timeout_ms * _MS
        )
        self.modulus = config.modulus
        self.has_alarms = False

    def bring_up(self) -> Identity:
        """From any NMT state to PRE-OPERATIONAL, operating parameters written, range and resolution checked."""
        device, config = self.device, self.config
        device.to_pre_operational()
        identity = device.identity()
        if identity.profile != 406 and config.position.key == POSITION.key:
            device.bus.emit(
                "warning",
                "profile",
                device.where,
                f"device type says profile {identity.profile}, expected 406",
            )
        device.listen_to_emergencies()
        device.follow_sync()
        device.produce_heartbeat(config.heartbeat_ms)
        self.check()
        return identity

    def check(self) -> None:
        """See that the count is there, and how far it reaches; write operating parameters. Raises `DriverError`."""
        device, config = self.device, self.config
        try:
            device.read(config.position)
        except SdoAbortError as error:
            raise DriverError(
                f"the counter's position object does not exist: {error.what}",
                where=f"{device.where}, {config.position}",
                remedy="Correct index, sub-index and type of the counter in the rig's configuration.",
            ) from error
        if config.operating_parameters is not None:
            device.write_checked(
                _OPERATING_PARAMETERS,
                config.operating_parameters,
                "its sense and scaling are its own",
            )
        device.write_wished(_CYCLIC_TIMER, 0, "transmission is by SYNC all the same")
        self._check_resolution()
        self.modulus = self._range()
        self._check_alarms()

    def _check_resolution(self) -> None:
        """Hold lines times multiplication against what the device says; contradictions are events,
        the configuration holds.
        """
        counts = self.config.lines * self.config.multiplication
        for entry in (UNITS_PER_REVOLUTION, _STEPS_PER_REVOLUTION):
            reported = self.device.read_optional(
                entry, "the configured resolution cannot be checked against the device"
            )
            if reported is None or int(reported) == counts:
                continue
            operating = self.device.read_optional(
                _OPERATING_PARAMETERS, "sense and scaling are not known"
            )
            if (
                entry is UNITS_PER_REVOLUTION
                and operating is not None
                and not int(operating) & 0x04
            ):
                # Bit 2 clear: the scaling objects are not in force.
                continue
            if entry is _STEPS_PER_REVOLUTION and operating is not None and int(operating) & 0x04:
                continue
            self.device.bus.emit(
                "warning",
                "resolution",
                self.device.where,
                f"{entry} says {int(reported)} counts per revolution, the configuration {self.config.lines} lines x "
                f"{self.config.multiplication} = {counts}; the configuration holds",
            )

    def _range(self) -> int:
        """The count's range: configured, else 0x6002, else that of the object's type."""
        position = self.device.typed(self.config.position)
        whole = 1 << position.value_type.size * 8
        if self.config.modulus:
            return self.config.modulus
        if position.key != POSITION.key:
            return whole
        reported = self.device.read_optional(
            TOTAL_RANGE, "the count is taken to wrap at the end of its type"
        )
        self._check_range(int(reported or 0))
        return int(reported) if reported is not None and 2 <= int(reported) <= whole else whole

    def _check_range(self, reported: int) -> None:
        """Say where 0x6002 may not be in force: it belongs to the scaling, without which the physical range holds."""
        why = "whether the count wraps at 0x6002 cannot be checked"
        operating, steps, turns = (
            self.device.read_optional(entry, why)
            for entry in (_OPERATING_PARAMETERS, _STEPS_PER_REVOLUTION, _REVOLUTIONS)
        )
        if (
            reported
            and operating is not None
            and not int(operating) & 0x04
            and steps
            and turns
            and reported != int(steps) * int(turns)
        ):
            self.device.bus.emit(
                "warning",
                "range",
                self.device.where,
                f"scaling is off, yet 0x6002 says {reported} and 0x6501 times 0x6502 "
                f"{int(steps) * int(turns)}: the count is taken "
                "to wrap at 0x6002; give `modulus` if it does not",
            )

    def _check_alarms(self) -> None:
        if self.config.alarms is None:
            return
        value = self.device.read_optional(
            self.config.alarms, "a signal error shows only by emergency messages and jumps"
        )
        self.has_alarms = value is not None
        if value is not None and int(value) & self.config.alarm_mask:
            self.device.bus.emit(
                "error",
                "signal-error",
                self.device.where,
                f"{self.config.alarms} is 0x{int(value):04X}",
            )

    @property
    def objects(self) -> list[ObjectRef]:
        """What is to be mapped: the position, then alarms and index objects where there are any."""
        config = self.config
        objects = [config.position]
        objects += [config.alarms] if config.alarms is not None and self.has_alarms else []
        objects += [
            entry for entry in (config.index_position, config.index_status) if entry is not None
        ]
        # Several numbers may lie in one object, which is mapped once.
        return list({entry.key: entry for entry in reversed(objects)}.values())[::-1]

    @property
    def optional(self) -> frozenset[tuple[int, int]]:
        """Those of them that the rig can do without."""
        return frozenset(entry.key for entry in self.objects[1:])
