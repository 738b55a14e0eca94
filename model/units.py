"""Unit conversions used at the edges. Inside, everything is SI: rad, rad/s, N m, s.

Multiply by a constant to come in (`speed_rpm * RPM`), divide to go out (`speed / RPM`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping

RPM = 2.0 * math.pi / 60.0
"""rad/s per r/min."""
DEGREE = math.pi / 180.0
"""rad per degree."""
ARCMIN = DEGREE / 60.0
"""rad per minute of arc."""
ARCSEC = DEGREE / 3600.0
"""rad per second of arc."""
REVOLUTION = 2.0 * math.pi
"""rad per revolution."""
MICROMETRE = 1e-6
"""m per micrometre."""

LABORATORY_UNITS: Mapping[str, tuple[str, float]] = {
    "arcsec": ("rad", ARCSEC),
    "arcmin": ("rad", ARCMIN),
    "°": ("rad", DEGREE),
    "r/min": ("rad/s", RPM),
    "mN m": ("N m", 1e-3),
    "µN m s/rad": ("N m s/rad", 1e-6),
    "kg cm²": ("kg m2", 1e-4),
    "µm": ("m", MICROMETRE),
}
"""Units in which a laboratory reads numbers: the SI unit, and how much of it one of them is."""

SMALL: Mapping[str, tuple[float, str]] = {
    "rad": (0.02, "arcsec"),
    "N m": (1.0, "mN m"),
    "N m s/rad": (1e-3, "µN m s/rad"),
    "kg m2": (1e-3, "kg cm²"),
    "m": (1e-3, "µm"),
}
"""SI unit: below which magnitude numbers are read in which smaller unit."""


def by_size(unit: str, size: float) -> str:
    """The unit in which a quantity of this magnitude [unit] is read where nothing else is said of it."""
    limit, smaller = SMALL.get(unit, (0.0, unit))
    return smaller if abs(size) < limit else unit
