"""What a CiA 402 drive states of its numbers, judged: a value in SI, or the question that a person must answer.

Drives keep to the standard's objects and not always to its units. What cannot be right is not used and
not rescaled: it becomes a `Question`, which names the word of the rig's description that answers it.

Rated torque: T = (0x6076) * 1 mN m. A motor's counter-voltage bounds it: T * omega / I = U, with
omega from 0x6080 and the rated current I from 0x6075 [mA]; without one of them T / I or T * omega.
Counts per revolution: (0x6092 over the gear 0x6091), else 0x608F. Units of speed and acceleration:
0x60A9, 0x6094, 0x60AA.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from drivers.bus.cia301 import ObjectRef
from drivers.bus.cia402 import tables as obj

MAXON: Final = 0x0000_00FB
"""Vendor-ID of a maker whose drives are known to count 0x6076 in uN m (public driver code of the EPOS4)."""
_LARGEST_VOLTAGE: Final = 3000.0
"""V of T * omega / I: three times what a servo amplifier at 575 V of mains can feed, as 0x6080 may lie above
the motor's own speed.
"""
_LARGEST_TORQUE_CONSTANT: Final = 20.0
"""N m/A, where the drive tells no speed: beyond most direct-drive motors."""
_LARGEST_POWER: Final = 1e5
"""W, where the drive tells no current."""
_LARGEST_TORQUE: Final = 100.0
"""N m at a motor, where the drive tells neither current nor speed."""
LARGEST_RATIO: Final = 30.0
"""By how much the drive's rated torque may differ from that of the motor that the description names."""
_LARGEST_SPEED: Final = 100_000.0
"""r/min in 0x6080 from which on nobody has set it."""
_RPM: Final = 2.0 * math.pi / 60.0
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


@dataclass(frozen=True, slots=True)
class Question:
    """What must be said in `[drive]` of the rig's description, because the drive's own word cannot be used.

    `entry` is the word of the description, `why` what the drive says and why that is no answer,
    `hint` where the answer stands.
    """

    entry: str
    why: str
    hint: str

    def __str__(self) -> str:
        return f"{self.why}: give `{self.entry}` in [drive] of the rig's description. {self.hint}"


@dataclass(frozen=True, kw_only=True, slots=True)
class Statement:
    """What a drive states of its numbers, as its objects have them; None: it has no such object."""

    vendor_id: int = 0
    rated_torque: int | None = None
    """0x6076 [mN m]."""
    rated_current: int | None = None
    """0x6075 [mA]."""
    largest_speed: int | None = None
    """0x6080 [r/min]."""
    encoder: tuple[int, int] | None = None
    """0x608F: increments, motor revolutions."""
    gear: tuple[int, int] | None = None
    """0x6091: motor and shaft revolutions."""
    feed: tuple[int, int] | None = None
    """0x6092: feed, shaft revolutions."""
    velocity_unit: int | None = None
    """0x60A9."""
    velocity_factor: tuple[int, int] | None = None
    """0x6094: numerator, divisor."""
    acceleration_unit: int | None = None
    """0x60AA."""


def read_statement(read: Callable[[ObjectRef], float | None], *, vendor_id: int = 0) -> Statement:
    """What a drive states, by `read`: the number of an entry, None where the drive does not have it."""

    def one(entry: ObjectRef) -> int | None:
        value = read(entry)
        return None if value is None else int(value)

    def pair(above: ObjectRef, below: ObjectRef) -> tuple[int, int] | None:
        first, second = one(above), one(below)
        # A drive without the second entry counts by one revolution.
        if first is None:
            return None
        return first, 1 if second is None else second

    return Statement(
        vendor_id=vendor_id,
        rated_torque=one(obj.RATED_TORQUE),
        rated_current=one(obj.RATED_CURRENT),
        largest_speed=one(obj.MAX_MOTOR_SPEED),
        encoder=pair(obj.ENCODER_INCREMENTS, obj.ENCODER_REVOLUTIONS),
        gear=pair(obj.GEAR_MOTOR, obj.GEAR_SHAFT),
        feed=pair(obj.FEED, obj.FEED_REVOLUTIONS),
        velocity_unit=one(obj.VELOCITY_UNIT),
        velocity_factor=pair(obj.VELOCITY_ENCODER_FACTOR, obj.VELOCITY_ENCODER_DIVISOR),
        acceleration_unit=one(obj.ACCELERATION_UNIT),
    )


# --- torque


def rated_torque(stated: Statement, motor: float | None = None) -> float | Question:
    """Rated torque [N m] by 0x6076, or why it cannot be that; `motor` [N m] is that of the motor that the
    description names, where it names one.
    """
    raw = stated.rated_torque
    if not raw:
        told = "the drive has no 0x6076" if raw is None else "0x6076 is 0: nobody has set it"
        return Question("rated_torque_n_m", told, "It stands on the motor's nameplate.")
    torque = raw * 1e-3
    doubt = _doubt(torque, stated, motor)
    if not doubt:
        return torque
    hint = "It stands on the motor's nameplate."
    if torque > 1.0 or stated.vendor_id == MAXON:
        hint += (
            f" Some drives count 0x6076 in uN m, a thousandth of the standard's unit: it would be {torque * 1e-3:g} N m"
            " then. Nothing is rescaled by itself."
        )
    return Question("rated_torque_n_m", f"0x6076 says {raw} mN m = {torque:g} N m; {doubt}", hint)


def _doubt(torque: float, stated: Statement, motor: float | None) -> str:
    """Why no motor with what else the drive states has this rated torque [N m]; "" where one may have."""
    if motor and not 1.0 / LARGEST_RATIO <= torque / motor <= LARGEST_RATIO:
        return f"the motor that the description names has {motor:g} N m"
    rpm = stated.largest_speed or 0
    speed = rpm * _RPM if rpm < _LARGEST_SPEED else 0.0
    current = (stated.rated_current or 0) * 1e-3
    if current and speed and torque * speed / current > _LARGEST_VOLTAGE:
        volts = torque * speed / current
        return f"with {current:g} A and {rpm} r/min that would be a motor of {volts * 1e-3:.3g} kV"
    if current and not speed and torque / current > _LARGEST_TORQUE_CONSTANT:
        return f"with {current:g} A that would be {torque / current:.3g} N m/A, which no motor has"
    if speed and not current and torque * speed > _LARGEST_POWER:
        return f"with {rpm} r/min that would be a motor of {torque * speed * 1e-3:.3g} kW"
    if torque > _LARGEST_TORQUE and not (current and speed):
        return f"no motor before a gear has more than {_LARGEST_TORQUE:g} N m"
    if stated.vendor_id == MAXON:
        return "this maker's drives are known to count it in uN m, where the standard has mN m"
    return ""


# --- position


def counts_per_revolution(stated: Statement) -> float | Question:
    """Counts of 0x6064 per motor revolution: the feed 0x6092 over the gear 0x6091, else 0x608F.

    Factors that are all 1 are those of the factory: "no unit, encoder counts", never one count per revolution.
    """
    found = 0.0
    if stated.feed is not None and all(stated.feed):
        above, below = stated.gear or (1, 1)
        found = stated.feed[0] / stated.feed[1] * (below / above if above and below else 1.0)
    if found <= 1.0 and stated.encoder is not None and stated.encoder[0]:
        # A feed constant that nobody has set is one unit per revolution: the drive counts increments.
        found = stated.encoder[0] / (stated.encoder[1] or 1)
    if found > 1.0:
        return found
    told = "the drive has neither 0x608F nor 0x6092"
    if stated.feed is not None or stated.encoder is not None:
        told = "0x608F, 0x6091 and 0x6092 are as the factory left them, which is no unit"
    return Question(
        "counts_per_revolution",
        f"counts per revolution are not stated: {told}",
        "It is lines times multiplication of the motor's encoder, if the drive counts those.",
    )


# --- speed and acceleration


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


def velocity_unit(stated: Statement, counts: float) -> float | Question:
    """rad/s per count of 0x60FF by 0x60A9, else by 0x6094 (counts per second and unit); `counts` of
    0x6064 per motor revolution, 0 where they are not known.
    """
    word = stated.velocity_unit
    if word is not None and (unit := unit_si(word, counts)) is not None:
        return unit
    if stated.velocity_factor is not None and all(stated.velocity_factor) and counts > 0:
        above, below = stated.velocity_factor
        return above / below * 2.0 * math.pi / counts
    told = "it has neither 0x60A9 nor 0x6094"
    if word is not None:
        told = _unreadable("0x60A9", word)
    elif stated.velocity_factor is not None:
        told = "0x6094 is in increments, whose number per revolution is not known"
    return Question(
        "velocity_unit_rad_s",
        f"the drive does not state the unit of its speeds: {told}",
        "Its manual has the unit of 0x60FF; makers use r/min, counts/s, 0.1 counts/s and fixed-point counts "
        "per sample.",
    )


def acceleration_unit(stated: Statement, counts: float) -> float | Question:
    """rad/s2 per count of 0x6083 by 0x60AA. It does not follow from the unit of speed: drives have 0.1
    counts/s beside 10 counts/s2, and 0.001 r/min beside r/min per second.
    """
    word = stated.acceleration_unit
    if word is not None and (unit := unit_si(word, counts)) is not None:
        return unit
    told = "it has no 0x60AA" if word is None else _unreadable("0x60AA", word)
    return Question(
        "acceleration_unit_rad_s2",
        f"the drive does not state the unit of its ramps: {told}",
        "Its manual has the unit of 0x6083; it does not follow from that of the speed.",
    )


def _unreadable(name: str, word: int) -> str:
    """Why a unit word tells no unit."""
    if word >> 16 & 0xFF == _INCREMENTS:
        return f"{name} says increments, whose number per revolution is not known"
    return f"{name} is 0x{word:08X}, which is no unit that is known here"
