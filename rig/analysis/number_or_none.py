"""A number, or None where there is none: in JSON, and in the columns of a table."""

from __future__ import annotations

import math


def finite(value: float) -> float | None:
    """A number; None for NaN and infinity, which JSON cannot hold."""
    return value if math.isfinite(value) else None


def known(value: float) -> float | None:
    """A number; None for NaN, of which nothing is known. Infinity stays: it is an answer."""
    return None if math.isnan(value) else float(value)
