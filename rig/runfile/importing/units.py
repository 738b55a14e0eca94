"""Channel names of recordings from other rigs, what each measures, and the unit of a column."""

from __future__ import annotations

from collections.abc import Iterable

from model.errors import ParameterError
from model.unit_text import Unit, read, understood
from model.units import COUNT, SI
from rig.errors import misstated

TIME_CHANNEL = "time"
TRANSMISSION_ERROR = "transmission_error"
"""theta_o - theta_i/N as one column, of which the output angle is made."""

ISO_TIME, FILETIME = "iso", "filetime"
TEXT_TIMES = (ISO_TIME, FILETIME)
"""Times that are read as texts: dates in ISO 8601, ticks of 100 ns since 1601."""

DIMENSIONS: dict[str, tuple[str, ...]] = {
    TIME_CHANNEL: ("s",),
    "input_angle": ("rad",),
    "output_angle": ("rad",),
    "input_index": ("rad",),
    "output_index": ("rad",),
    TRANSMISSION_ERROR: ("rad",),
    "input_speed": ("rad/s",),
    "output_speed": ("rad/s",),
    "speed": ("rad/s", "m/s"),
    "torque": ("N m",),
    "output_torque": ("N m",),
    "drive_torque": ("N m",),
    "target_torque": ("N m",),
    "target_speed": ("rad/s",),
    "housing_temperature": ("degC",),
    "ambient_temperature": ("degC",),
    "statusword": ("1",),
    "index_seen": ("1",),
    "position": ("m", "rad"),
    "force": ("N",),
    "current": ("A",),
    "motor_current": ("A",),
    "voltage": ("V",),
}
"""What the channels with a standard name measure; every other name may have any unit."""

UNCERTAINTY = "_uncertainty"
"""Ending of the channel that holds the standard uncertainty of another one, in the same unit."""


def dimensions_of(name: str) -> tuple[str, ...] | None:
    """The SI units that a channel may have; None for a name that is free."""
    return DIMENSIONS.get(name) or DIMENSIONS.get(name.removesuffix(UNCERTAINTY))


def unit_of(text: str, where: str, allowed: Iterable[str] = ()) -> Unit:
    """The unit that a text means on a channel of these SI units; one that is not known is refused."""
    if text.strip() in TEXT_TIMES:
        return Unit(text.strip(), text.strip(), 1, SI["s"])
    try:
        return read(text, allowed, where)
    except ParameterError as error:
        raise misstated(error, where) from error


def units_of(*allowed: str) -> str:
    """The units that would be understood on a channel of these SI units, for a message."""
    return ", ".join(dict.fromkeys((*understood(allowed), COUNT)))
