"""Units and channel names of recordings from other rigs: what is known, and what it is in SI."""

from __future__ import annotations

import difflib

from model.units import ARCMIN, ARCSEC, DEGREE, REVOLUTION, RPM
from rig.errors import ConfigurationError

TIME_CHANNEL = "time"
COUNT = "count"

_PLAIN: dict[str, tuple[str, float]] = {
    "deg": ("rad", DEGREE), "arcmin": ("rad", ARCMIN), "arcsec": ("rad", ARCSEC), "rev": ("rad", REVOLUTION),
    "min": ("s", 60.0), "h": ("s", 3600.0),
    "deg/s": ("rad/s", DEGREE), "rev/s": ("rad/s", REVOLUTION), "r/min": ("rad/s", RPM),
    "rad/s2": ("rad/s2", 1.0), "deg/s2": ("rad/s2", DEGREE), "m/s2": ("m/s2", 1.0),
    "N mm": ("N m", 1e-3), "N cm": ("N m", 1e-2),
    "degC": ("degC", 1.0), "K": ("degC", 1.0), "%": ("1", 1e-2), "1": ("1", 1.0),
}  # fmt: skip
_PREFIXED: dict[str, tuple[str, ...]] = {
    "rad": ("", "m", "u"), "m": ("", "m", "u", "n"), "s": ("", "m", "u", "n"),
    "rad/s": ("", "m", "u"), "m/s": ("", "m", "u"),
    "N m": ("k", "", "m", "u"), "N": ("k", "", "m", "u"),
    "A": ("", "m", "u"), "V": ("k", "", "d", "m", "u"), "W": ("k", "", "m"), "Hz": ("M", "k", ""),
}  # fmt: skip
_PREFIXES = {"M": 1e6, "k": 1e3, "": 1.0, "d": 1e-1, "m": 1e-3, "u": 1e-6, "n": 1e-9}
UNITS: dict[str, tuple[str, float]] = {
    **{p + unit: (unit, _PREFIXES[p]) for unit, prefixes in _PREFIXED.items() for p in prefixes},
    **_PLAIN,
}
"""Units that a column may have: the SI unit that it becomes and the factor to it."""

ISO_TIME, FILETIME = "iso", "filetime"
TEXT_TIMES = (ISO_TIME, FILETIME)
"""Times that are read as texts: dates in ISO 8601, ticks of 100 ns since 1601."""

_SPELLINGS = {
    "°": "deg",
    "degree": "deg",
    "degrees": "deg",
    "'": "arcmin",
    '"': "arcsec",
    "turn": "rev",
    "turns": "rev",
    "r": "rev",
    "revolution": "rev",
    "revolutions": "rev",
    "rpm": "r/min",
    "1/min": "r/min",
    "rev/min": "r/min",
    "nm": "N m",
    "n*m": "N m",
    "n.m": "N m",
    "n·m": "N m",
    "n-m": "N m",
    "mnm": "mN m",
    "nmm": "N mm",
    "ncm": "N cm",
    "newton": "N",
    "newtons": "N",
    "volts": "V",
    "amps": "A",
    "ampere": "A",
    "unm": "uN m",
    "knm": "kN m",
    "sec": "s",
    "seconds": "s",
    "second": "s",
    "°c": "degC",
    "celsius": "degC",
    "counts": COUNT,
    "cnt": COUNT,
    "inc": COUNT,
    "increments": COUNT,
    "amp": "A",
    "volt": "V",
    "-": "1",
    "ticks": COUNT,
    "tick": COUNT,
    "deg/s^2": "deg/s2",
    "rad/s²": "rad/s2",
    "m/s²": "m/s2",
    "rad/s^2": "rad/s2",
    "m/s^2": "m/s2",
}

DIMENSIONS: dict[str, tuple[str, ...]] = {
    TIME_CHANNEL: ("s",),
    "input_angle": ("rad",),
    "output_angle": ("rad",),
    "input_index": ("rad",),
    "output_index": ("rad",),
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


def unit_of(text: str, where: str) -> str:
    """The unit in the spelling of this program; a unit that is not known is refused with those that are."""
    # Both signs for micro (U+00B5 and U+03BC) are met in headings.
    stripped = text.strip().replace("\u00b5", "u").replace("\u03bc", "u")
    for candidate in (stripped, _SPELLINGS.get(stripped.lower(), "")):
        if candidate in UNITS or candidate == COUNT or candidate in TEXT_TIMES:
            return candidate
    near = difflib.get_close_matches(stripped, [*UNITS, COUNT], n=1)
    raise ConfigurationError(
        "has a unit that is not known",
        where=where,
        value=repr(text),
        limit=", ".join([*UNITS, COUNT]),
        remedy=f'Did you mean "{near[0]}"?'
        if near
        else "Convert the column, or give SI and a scale.",
    )
