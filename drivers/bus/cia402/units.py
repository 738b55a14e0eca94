"""What a CiA 402 drive's numbers are in SI: rated torque, counts per revolution, units of velocity and acceleration.

The configuration holds; the drive is asked for what it leaves open, and contradictions are events.
What neither says is NaN and stands among the missing objects; using it is an error that names the
entry of the configuration.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from drivers.bus.cia402 import tables as obj
from drivers.bus.device import RemoteDevice

_NUMERATORS: Final[Mapping[int, float]] = {
    0x10: 1.0,
    0x41: math.pi / 180.0,
    0xB4: 2.0 * math.pi,
    0xC0: math.pi / 30.0,
}
"""Radian, degree, revolution; 0xC0 is the revolution per minute, as drives write it over a second for accelerations."""
_DENOMINATORS: Final[Mapping[int, float]] = {0x03: 1.0, 0x47: 60.0, 0x48: 3600.0, 0x57: 1.0}
"""Second, minute, hour, square second."""
_INCREMENTS: Final = 0xB5


def unit_si(word: int, counts: float) -> float | None:
    """The SI value of one count by a unit word as 0x60A9 and 0x60AA have it (prefix, numerator,
    denominator), or None.
    """
    prefix = int.from_bytes(bytes([word >> 24 & 0xFF]), "little", signed=True)
    numerator, denominator = word >> 16 & 0xFF, word >> 8 & 0xFF
    angle = _NUMERATORS.get(numerator)
    if numerator == _INCREMENTS and counts > 0:
        angle = 2.0 * math.pi / counts
    duration = _DENOMINATORS.get(denominator)
    if angle is None or duration is None or not -24 <= prefix <= 24:
        return None
    return 10.0**prefix * angle / duration


def rated_torque(device: RemoteDevice, configured: float | None) -> float:
    """Rated torque [N m]: the configuration's, else 0x6076, which is in mN m, else NaN."""
    reported = device.read_optional(
        obj.RATED_TORQUE, "the rated torque must stand in the configuration"
    )
    if reported and configured and abs(reported * 1e-3 - configured) > 0.02 * configured:
        device.bus.emit(
            "warning",
            "rated-torque",
            device.where,
            f"0x6076 says {reported * 1e-3:g} N m, the configuration {configured:g} N m; torque is read by the "
            "configuration, and the torque limit is written so that it holds by either",
        )
    if configured:
        return configured
    if reported:
        return float(reported) * 1e-3
    device.note_missing(
        obj.RATED_TORQUE,
        "torque is not known in N m: give `rated_torque` from the motor's nameplate",
    )
    return math.nan


def torque_limit_unit(device: RemoteDevice, rated: float) -> float:
    """N m per count of 0x6072: of the rated torque and of 0x6076 the larger, so that the limit
    holds whichever is right.
    """
    reported = (
        float(
            device.read_optional(
                obj.RATED_TORQUE, "the rated torque must stand in the configuration"
            )
            or 0
        )
        * 1e-3
    )
    return max(rated, reported) / 1000.0 if rated > 0.0 else rated


def counts_per_revolution(device: RemoteDevice, configured: float) -> float:
    """Counts of 0x6064 per motor revolution: the configuration's, else 0x6092 over the gear 0x6091,
    else 0x608F; 0: unknown.
    """
    read, why = device.read_optional, "counts per revolution must stand in the configuration"
    feed, shaft = read(obj.FEED, why), read(obj.FEED_REVOLUTIONS, why)
    motor, driven = (
        read(obj.GEAR_MOTOR, "no electronic gear"),
        read(obj.GEAR_SHAFT, "no electronic gear"),
    )
    increments, turns = read(obj.ENCODER_INCREMENTS, why), read(obj.ENCODER_REVOLUTIONS, why)
    reported = 0.0
    if feed and shaft:
        reported = feed / shaft * ((driven / motor) if motor and driven else 1.0)
    if reported <= 1.0 and increments:
        # A feed constant that nobody has set is one unit per revolution: the drive counts increments.
        reported = increments / (turns or 1)
    if configured and reported > 1.0 and abs(reported - configured) > 1e-9 * configured:
        device.bus.emit(
            "warning",
            "counts-per-revolution",
            device.where,
            f"the drive says {reported:g} counts per revolution, the configuration {configured:g}; "
            "the configuration holds",
        )
    return configured or reported


def velocity_unit(device: RemoteDevice, configured: float | None, counts: float) -> float:
    """rad/s per count of 0x60FF: the configuration's, else 0x60A9, else 0x6094 (counts per second
    and unit), else NaN.
    """
    if configured:
        return configured
    read, why = device.read_optional, "the velocity unit must stand in the configuration"
    word = read(obj.VELOCITY_UNIT, why)
    if word is not None and (unit := unit_si(int(word), counts)) is not None:
        return unit
    factor, divisor = (
        read(obj.VELOCITY_ENCODER_FACTOR, why),
        read(obj.VELOCITY_ENCODER_DIVISOR, why),
    )
    if factor and divisor and counts > 0:
        return factor / divisor * 2.0 * math.pi / counts
    return math.nan


def acceleration_unit(
    device: RemoteDevice, configured: float | None, velocity: float, counts: float = 0.0
) -> float:
    """rad/s2 per count of 0x6083: the configuration's, else 0x60AA, else the velocity unit per
    second, with a warning.
    """
    if configured:
        return configured
    word = device.read_optional(
        obj.ACCELERATION_UNIT, "ramps are taken in velocity units per second"
    )
    if word is not None and (unit := unit_si(int(word), counts)) is not None:
        return unit
    device.bus.emit(
        "warning",
        "acceleration-unit",
        device.where,
        f"the drive does not tell the unit of its ramps; {velocity:g} rad/s2 per count is taken: "
        "check against its manual and give `acceleration_unit`",
    )
    return velocity
