"""Unit conversions used at the edges. Inside, everything is SI: rad, rad/s, N m, s.

Multiply by a constant to come in (`speed_rpm * RPM`), divide to go out (`speed / RPM`).
"""

from __future__ import annotations

import math

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
