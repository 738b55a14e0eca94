"""Whether a drive can lead a shaft that turns on and on by target positions: what is asked before it is chosen.

Positions are whole numbers of 32 bits that begin anew at their end (`positions.wrapped`). A drive whose position counts
to another end, or stops at one, would take the first target behind it for a step of a whole range.
"""

from __future__ import annotations

from typing import Final

from drivers.bus.cia301 import ObjectRef
from drivers.bus.cia402 import tables as obj
from drivers.bus.cia402.config import DriveReadings
from drivers.bus.device import RemoteDevice
from drivers.errors import DriverError

_WHOLE: Final = 2**32 - 1
"""From the lowest to the highest position of 32 bits."""
_WATCH_OFF: Final = (1 << 32) - 1
"""0x6065 of a drive that does not watch how far the shaft is behind."""


def require_endless(
    device: RemoteDevice, readings: DriveReadings, cycle_ns: int
) -> tuple[ObjectRef, ...]:
    """The offsets that the drive has, zeroed. Raises `DriverError` where it cannot be led: without the SYNC period as
    its interpolation time, with software limits, or with a position that begins anew elsewhere than 32 bits do.
    """
    if not readings.is_interpolating:
        raise DriverError(
            "cyclic position needs the SYNC period as the drive's interpolation time",
            where=f"{device.where}, {obj.INTERPOLATION_TIME}",
            value=f"{cycle_ns * 1e-6:g} ms not taken",
            remedy="Choose a SYNC rate whose period it takes, or another of `speed_modes`.",
        )
    _require_no_end(
        device,
        obj.POSITION_LIMITS,
        "software position limits would stop a shaft that turns on and on",
    )
    _require_no_end(
        device, obj.POSITION_RANGE, "the drive's position begins anew elsewhere than 32 bits do"
    )
    _look_at_following(device, readings)
    return tuple(
        entry
        for entry in obj.OFFSETS
        if device.write_wished(entry, 0, "nothing is added to the targets")
    )


def _require_no_end(device: RemoteDevice, ends: tuple[ObjectRef, ObjectRef], words: str) -> None:
    """Neither end, or both at the ends of 32 bits."""
    low, high = (int(device.read_optional(end, "no such end is known") or 0) for end in ends)
    if (low, high) != (0, 0) and high - low != _WHOLE:
        raise DriverError(
            words,
            where=f"{device.where}, {ends[0]}",
            value=f"{low} to {high} counts",
            limit="0 and 0, or the whole range of 32 bits",
            remedy="Switch them off by the drive's own tool, or choose another of `speed_modes`.",
        )


def _look_at_following(device: RemoteDevice, readings: DriveReadings) -> None:
    """The drive's own watch over a shaft that stays behind: what it is set to, and that there is none, is told."""
    consequence = "the drive does not say that its shaft stays behind the target"
    window = device.read_optional(obj.FOLLOWING_WINDOW, consequence)
    timeout = device.read_optional(obj.FOLLOWING_TIMEOUT, "the drive's own time")
    for entry, value in ((obj.FOLLOWING_WINDOW, window), (obj.FOLLOWING_TIMEOUT, timeout)):
        if value is not None:
            readings.settings[f"{entry}"] = float(value)
    if window == _WATCH_OFF:
        device.bus.emit(
            "warning",
            "following-window",
            device.where,
            f"its watch over the following error is off (0x6065): {consequence}",
        )
