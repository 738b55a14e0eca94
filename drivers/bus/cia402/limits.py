"""The limits that a CiA 402 drive holds itself: torque, speed and ramps, in its units, on the safe side, read back."""

from __future__ import annotations

import math
from typing import Final

from drivers.bus.cia301 import ObjectRef
from drivers.bus.cia402 import tables as obj
from drivers.bus.device import RemoteDevice
from drivers.errors import DriverError
from drivers.port import DriveLimits

_RPM: Final = 2.0 * math.pi / 60.0
"""rad/s per count of 0x6080, which is in revolutions per minute whatever the velocity unit."""


def write_limits(
    device: RemoteDevice,
    limits: DriveLimits,
    *,
    torque_unit: float,
    torque_entry: ObjectRef = obj.MAX_TORQUE,
    velocity_unit: float,
    acceleration_unit: float,
) -> tuple[DriveLimits, float]:
    """Write `limits` [SI] in the drive's units [N m, rad/s, rad/s2 per count]; what it holds, and
    its profile velocity's limit.

    `torque_entry` is the object that limits torque, where it is another than 0x6072. A drive without
    0x6084 slows down by 0x6083 (CiA 402), which holds both ramps if they are to be the same. The speed
    is that of 0x6080, which holds in every mode; 0x607F, the second value, holds for profiles. inf: not held.
    Raises `DriverError` for a limit that cannot be expressed, `ReadbackError` for one that reads back differently.
    """
    written = (limits.torque, torque_unit, "the drive does not limit torque")
    torque = _limit(device, torque_entry, *written)
    if not math.isfinite(torque) and torque_entry.key == obj.MAX_TORQUE.key:
        either = (obj.POSITIVE_TORQUE_LIMIT, obj.NEGATIVE_TORQUE_LIMIT)
        torque = max(_limit(device, entry, *written) for entry in either)
    speed = _limit(
        device,
        obj.MAX_MOTOR_SPEED,
        limits.speed,
        _RPM,
        "the drive does not limit the motor's speed",
    )
    profile = _limit(
        device,
        obj.MAX_PROFILE_VELOCITY,
        limits.speed,
        velocity_unit,
        "the drive does not limit profile velocities",
    )
    values = (
        (obj.ACCELERATION, limits.acceleration),
        (obj.DECELERATION, limits.deceleration),
        (obj.QUICK_STOP_DECELERATION, limits.quick_stop_deceleration),
    )
    unshaped = "the drive does not shape its "
    ramps = [
        _limit(device, entry, value, acceleration_unit, unshaped + entry.name)
        for entry, value in values
    ]
    if math.isinf(ramps[1]) and limits.deceleration == limits.acceleration:
        ramps[1] = ramps[0]
    return DriveLimits(torque, speed, *ramps), profile


def _limit(
    device: RemoteDevice, entry: ObjectRef, value: float, unit: float, consequence: str
) -> float:
    """Write one limit in the drive's unit; what it means in SI, inf when the drive has no such limit."""
    typed = device.typed(entry)
    if not unit > 0.0:
        device.note_missing(entry, consequence + ", because its unit is not known")
        return math.inf
    counts = math.floor(value / unit * (1.0 + 1e-12)) if math.isfinite(value) else -1
    most = (1 << (typed.data_type.size * 8 - typed.data_type.signed)) - 1
    if not 1 <= counts <= most:
        raise DriverError(
            f"{entry.name} cannot be expressed in the drive's unit",
            where=f"{device.where}, {entry}",
            value=value,
            limit=f"{unit:g} to {most * unit:g}",
        )
    return counts * unit if device.write_checked(typed, counts, consequence) else math.inf
