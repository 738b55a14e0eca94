"""The torque port: the servo amplifier's analog monitor, read by a CiA 401 analog input module.

T = (V - V0) / (volts per rated torque) * T_rated, V = counts * volts per count. V0 is taken with
the servo off, before and after each run. The port shows the torque reference: motor and gear
together, with the motor's own friction and inertia.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from drivers.bus.cia301 import I16, REAL32, U8, U32, DataType, ObjectRef
from drivers.bus.device import Identity, RemoteDevice
from drivers.bus.dictionary.eds import DeviceDescription
from drivers.bus.network import PumpedBus
from drivers.bus.sdo import SdoAbortError
from drivers.channel import Calibration, Channel
from drivers.errors import DriverError

_TRIGGER: Final = 0x6421
_GLOBAL_INTERRUPT: Final = ObjectRef(0x6423, 0, U8, "analogue input global interrupt enable")
DELTA: Final = 0x6426
_MS: Final = 1_000_000


@dataclass(frozen=True, kw_only=True)
class AnalogInput:
    """One input of the module: the object that carries it, its scale, its range, and what it measures.

    `volts_per_count` of an integer object; for a REAL32 object (0x6403) the size of the count that is recorded [V].
    `full_scale` [V] is where the converter ends; an open line floats to `open_level` [V] where the module pulls it.
    `status_bits`: so many of the word's lowest bits are no part of the value but tell that it is none (over or under
    range). They are taken out of the count, and any of them marks the cycle as saturated.
    """

    channel: str
    unit: str
    source: ObjectRef
    volts_per_count: float
    unit_per_volt: float
    zero_volts: float = 0.0
    full_scale: float = 10.24
    open_level: float | None = None
    status_bits: int = 0
    direction: int = 1
    long_name: str = ""
    model: str = ""
    serial_number: str = ""
    calibration: Calibration = field(default_factory=Calibration)

    def __post_init__(self) -> None:
        for name, value in (
            ("volts_per_count", self.volts_per_count),
            ("unit_per_volt", self.unit_per_volt),
        ):
            if not (math.isfinite(value) and value > 0.0):
                raise DriverError(
                    f"{name} must be positive", where=self.channel, value=value, limit="> 0"
                )
        kind = self.source.value_type
        most = 0 if kind.is_float else 8 * kind.size - 1
        if not 0 <= self.status_bits <= most:
            raise DriverError(
                "so many bits of the value cannot be status",
                where=f"{self.channel}, {self.source}",
                value=self.status_bits,
                limit=f"0 to {most} of {kind.name}",
            )

    def as_channel(self) -> Channel:
        """The input as a channel in its SI unit; its offset is the negative zero."""
        scale = self.volts_per_count * self.unit_per_volt
        return Channel(
            name=self.channel,
            unit=self.unit,
            scale=scale,
            offset=-self.direction * self.zero_volts * self.unit_per_volt,
            direction=self.direction,
            long_name=self.long_name,
            model=self.model,
            serial_number=self.serial_number,
            calibration=self.calibration,
        )

    @property
    def quantum(self) -> float:
        """The size of one count of a floating-point object, 0 for an integer."""
        return self.volts_per_count if self.source.value_type.is_float else 0.0

    @property
    def value_mask(self) -> int:
        """The bits of the word that are the value; -1: all of them."""
        return -(1 << self.status_bits)

    def saturated(self, counts: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which words (n,) are at the end of the range, at the level of an open line, or say by their status bits
        that they are no value.
        """
        # One per cent below full scale: converters stop a little before or exactly at their code's end.
        end = math.floor(0.99 * self.full_scale / self.volts_per_count)
        status = (counts & ~self.value_mask) != 0
        counts = counts & self.value_mask
        saturated = (np.abs(counts) >= end) | status
        kind = self.source.value_type
        if kind.size and not kind.is_float:
            top = (1 << (kind.size * 8 - kind.signed)) - 1
            saturated |= (counts >= top & self.value_mask) | (
                counts <= -top - 1 if kind.signed else False
            )
        if self.open_level is not None:
            saturated |= (
                np.abs(counts * self.volts_per_count - self.open_level) <= 0.01 * self.full_scale
            )
        return saturated


def torque_input(
    rated_torque: float,
    *,
    volts_per_rated_torque: float = 1.0,
    subindex: int = 1,
    index: int = 0x6401,
    data_type: DataType = I16,
    volts_per_count: float = 0.3125e-3,
    **details: object,
) -> AnalogInput:
    """The torque monitor on one analog input: `rated_torque` [N m] appears as `volts_per_rated_torque` [V]."""
    if not (volts_per_rated_torque > 0.0 and rated_torque > 0.0):
        raise DriverError(
            "the torque monitor's scale must be positive",
            where="torque port",
            value=f"{rated_torque} N m, {volts_per_rated_torque} V",
            limit="> 0",
        )
    return AnalogInput(
        channel="torque",
        unit="N m",
        source=ObjectRef(index, subindex, data_type, "torque monitor"),
        volts_per_count=volts_per_count,
        unit_per_volt=rated_torque / volts_per_rated_torque,
        **details,  # type: ignore[arg-type]
    )


@dataclass(frozen=True)
class AnalogModuleConfig:
    """A CiA 401 module: node-ID, its inputs, heartbeat period, and its EDS where there is one."""

    node_id: int
    inputs: tuple[AnalogInput, ...]
    description: DeviceDescription | None = None
    heartbeat_ms: int = 100
    sdo_timeout_ms: int = 300


class AnalogModule:
    """The module on the bus; brought up with its inputs enabled, read by PDO."""

    def __init__(
        self, bus: PumpedBus, config: AnalogModuleConfig, device: RemoteDevice | None = None
    ) -> None:
        self.config = config
        self.device = device or RemoteDevice(
            bus, config.node_id, config.description, config.sdo_timeout_ms * _MS
        )

    @property
    def objects(self) -> list[ObjectRef]:
        """What is to be mapped: the inputs' objects, each of them once."""
        sources = {analog.source.key: analog.source for analog in self.config.inputs}
        return list(sources.values())

    def bring_up(self) -> Identity:
        """From any NMT state to PRE-OPERATIONAL with every input configured and checked to be there."""
        device = self.device
        device.to_pre_operational()
        identity = device.identity()
        if identity.profile != 401:
            device.bus.emit(
                "warning",
                "profile",
                device.where,
                f"device type says profile {identity.profile}, expected 401",
            )
        device.listen_to_emergencies()
        device.follow_sync()
        device.produce_heartbeat(self.config.heartbeat_ms)
        self.check()
        return identity

    def check(self) -> None:
        """See that every input is there, and let it be transmitted. Raises `DriverError`."""
        for analog in self.config.inputs:
            self._enable(analog)
        self.device.write_wished(
            _GLOBAL_INTERRUPT, 1, "inputs are transmitted by SYNC all the same"
        )

    def _enable(self, analog: AnalogInput) -> None:
        """Check that the input exists; allow its transmission on any change (0x6421 = 7, 0x6426 = 0)."""
        try:
            self.device.read(analog.source)
        except SdoAbortError as error:
            raise DriverError(
                f"the analog input does not exist: {error.what}",
                where=f"{self.device.where}, {analog.source}",
                remedy="Correct index and sub-index of the input in the rig's configuration.",
            ) from error
        subindex = analog.source.subindex
        trigger = ObjectRef(_TRIGGER, subindex, U8, "interrupt trigger selection")
        self.device.write_wished(trigger, 7, "SYNC triggers all the same")
        delta = REAL32 if analog.source.value_type.is_float else U32
        self.device.write_wished(
            ObjectRef(DELTA, subindex, delta, "interrupt delta"), 0, "SYNC triggers all the same"
        )
