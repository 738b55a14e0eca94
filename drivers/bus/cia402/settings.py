"""What a CiA 402 drive is set to beside its units: electronic gear, factors, servo gains, interpolation period."""

from __future__ import annotations

from drivers.bus.cia301 import U8, ObjectRef
from drivers.bus.cia402 import tables as obj
from drivers.bus.device import RemoteDevice
from drivers.bus.sdo import SdoAbortError


def read_settings(device: RemoteDevice, gains: tuple[ObjectRef, ...]) -> dict[str, float]:
    """Electronic gear, factors and servo gains, as they stand; `gains` further objects of the manufacturer."""
    settings: dict[str, float] = {}
    for entry in (
        obj.GEAR_MOTOR,
        obj.GEAR_SHAFT,
        obj.POSITION_FACTOR,
        obj.POSITION_DIVISOR,
        obj.VELOCITY_FACTOR,
        obj.VELOCITY_DIVISOR,
        obj.FEED,
        obj.FEED_REVOLUTIONS,
        *gains,
    ):
        value = device.read_optional(entry, "not in the run file")
        if value is not None:
            settings[f"{entry}"] = float(value)
    for index, name in obj.GAINS:
        settings |= _read_record(device, index, name)
    return settings


def _read_record(device: RemoteDevice, index: int, name: str) -> dict[str, float]:
    """All numbers of a record, their width taken from the answer where no EDS tells it."""
    count = device.read_optional(
        ObjectRef(index, 0, U8, name), "servo gains are not in the run file"
    )
    values: dict[str, float] = {}
    for subindex in range(1, min(int(count or 0), 16) + 1):
        try:
            data = device.sdo.upload(index, subindex)
        except SdoAbortError:
            continue
        described = device.description.entry(index, subindex) if device.description else None
        if (
            described is not None
            and described.data_type.is_number
            and len(data) >= described.data_type.size
        ):
            values[f"0x{index:04X}:{subindex} {described.name or name}"] = float(
                described.data_type.decode(data)
            )
        elif 0 < len(data) <= 8:
            values[f"0x{index:04X}:{subindex} {name}"] = float(int.from_bytes(data, "little"))
    return values


def write_interpolation_time(device: RemoteDevice, cycle_ns: int) -> bool:
    """Tell the drive the SYNC period (0x60C2) as value times 10^exponent seconds, where it fits a byte; whether it
    reads back so.

    The exponent that stands there is tried first: some drives keep it. One that was changed in vain is put back.
    """
    consequence = "cyclic modes interpolate with the drive's own period"
    present = device.read_optional(obj.INTERPOLATION_EXPONENT, consequence)
    if present is None:
        return False
    for exponent in (int(present), -3, -4, -5, -6):
        value = cycle_ns / 10.0 ** (9 + exponent) if -9 <= exponent <= 0 else 0.0
        if value != int(value) or not 0 < value <= 255:
            continue
        if exponent != present and not device.write_wished(
            obj.INTERPOLATION_EXPONENT, exponent, consequence
        ):
            return False
        is_taken = device.write_wished(obj.INTERPOLATION_TIME, int(value), consequence)
        if not is_taken and exponent != present:
            device.write_wished(obj.INTERPOLATION_EXPONENT, present, consequence)
        return is_taken
    return False
