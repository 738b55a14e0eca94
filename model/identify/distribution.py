"""Shapes of the errors in a budget."""

from __future__ import annotations

from enum import StrEnum


class Distribution(StrEnum):
    """How an error is distributed; a normal one whose u has degrees of freedom is Student's t."""

    NORMAL = "normal"
    RECTANGULAR = "rectangular"
    ARCSINE = "arcsine"
