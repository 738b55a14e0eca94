"""The inertia on the bare shaft: stated by a certificate, or weighed and measured.

A ring of mass m between the diameters D and d has J = m (D^2 + d^2)/8; disc and hub are two rings on one bore.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

_MILLI, _K = 1e-3, 2.0


@dataclass(frozen=True)
class Disc:
    """An inertia [kg m2] in words, with the standard uncertainty that somebody stated of it; 0 where nobody did."""

    inertia: float
    stated_uncertainty: float
    words: str


def ring(mass: float, outer: float, inner: float) -> float:
    """Inertia [kg m2] of a ring of this mass [kg] between two diameters [m]."""
    return mass * (outer**2 + inner**2) / 8.0


def disc_of(parameters: Mapping[str, Any]) -> Disc:
    """The disc of a run by its parameters; none of all is the bare rotor."""

    def told(name: str) -> float:
        return float(parameters.get(name) or 0.0)

    bore = _MILLI * told("bore_mm")
    measured = ring(told("mass"), _MILLI * told("diameter_mm"), bore)
    measured += ring(told("hub_mass"), _MILLI * told("hub_diameter_mm"), bore)
    inertia = told("inertia") or measured
    if not inertia:
        return Disc(0.0, 0.0, "nothing but the rotor")
    certificate = str(parameters.get("certificate") or "")
    words = f"a disc of {inertia:.4g} kg m2" + (f" ({certificate})" if certificate else "")
    return Disc(inertia, told("inertia_uncertainty") / _K, words)


def is_told_twice(parameters: Mapping[str, Any]) -> bool:
    """Whether an inertia is stated beside a mass that gives another one."""
    return bool(parameters.get("inertia")) and bool(
        parameters.get("mass") or parameters.get("hub_mass")
    )
