"""The motor's own temperature: nothing measures it, and it moves the torque that a run shows.

Magnets weaken: the same current gives less torque, so that the port (a reference, scaled by the constant at 20 degC)
reads too much. The motor's own friction falls. Both are brought from the housing's temperature, the best that a run
knows of the motor's.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

from experiments.recording import Recording
from model.identify.running_torque import Tare

REFERENCE = 20.0
"""degC at which torque constants are stated."""
MAGNETS, MAGNETS_UNCERTAINTY = -1e-3, 0.3e-3
"""Relative change of the torque constant per kelvin, assumed of servo motors, and its standard uncertainty."""
FRICTION, FRICTION_UNCERTAINTY = -4e-3, 1.2e-3
"""Relative change of the motor's own friction per kelvin, assumed, and its standard uncertainty."""
WARMER = 1.5
"""K, standard uncertainty of the motor's temperature behind the housing's: its own losses warm it by some kelvin."""
UNKNOWN = 5.0
"""K, standard uncertainty of the motor's temperature where no temperature was recorded."""


@dataclass(frozen=True, kw_only=True)
class MotorHeat:
    """`constant`: true torque over torque shown; relative standard uncertainties of it and of a tare as a whole.

    `temperature` [degC] of the motor as far as it is known, NaN where it is not.
    """

    constant: float
    constant_uncertainty: float
    tare_uncertainty: float
    temperature: float

    @property
    def kelvin(self) -> float:
        """Standard uncertainty of the motor's temperature [K]."""
        return WARMER if math.isfinite(self.temperature) else UNKNOWN

    @property
    def words(self) -> str:
        """What the correction rests on."""
        return f"motor within {self.kelvin:g} K, torque constant {100.0 * MAGNETS:g} % per kelvin"

    def friction_factor(self) -> tuple[float, float]:
        """The motor's friction at 20 degC over that of the run, and its relative standard uncertainty."""
        if not math.isfinite(self.temperature):
            return 1.0, abs(FRICTION) * UNKNOWN
        warmer = self.temperature - REFERENCE
        return 1.0 / (1.0 + FRICTION * warmer), _relative(FRICTION, FRICTION_UNCERTAINTY, warmer)

    def brought(self, tare: Tare, temperature: float) -> tuple[Tare, MotorHeat]:
        """A tare made at another housing temperature [degC] as it is in this run, and what that leaves open."""
        away = self.temperature - temperature
        if not math.isfinite(away):
            return tare, self
        factor = 1.0 + FRICTION * away
        relative = _relative(FRICTION, FRICTION_UNCERTAINTY, away)
        return (
            dataclasses.replace(
                tare, torque=factor * tare.torque, standard_error=factor * tare.standard_error
            ),
            dataclasses.replace(self, tare_uncertainty=relative),
        )


def motor_heat(recording: Recording, housing: float) -> MotorHeat:
    """What the housing's mean temperature [degC] says of the motor; an imported torque is taken as it stands."""
    if recording.metadata.origin == "imported" or not math.isfinite(housing):
        return MotorHeat(
            constant=1.0,
            constant_uncertainty=abs(MAGNETS) * UNKNOWN,
            tare_uncertainty=abs(FRICTION) * UNKNOWN,
            temperature=math.nan,
        )
    warmer = housing - REFERENCE
    return MotorHeat(
        constant=1.0 + MAGNETS * warmer,
        constant_uncertainty=_relative(MAGNETS, MAGNETS_UNCERTAINTY, warmer),
        tare_uncertainty=abs(FRICTION) * WARMER,
        temperature=housing,
    )


def _relative(per_kelvin: float, uncertainty: float, warmer: float) -> float:
    """Relative standard uncertainty of what is brought over so many kelvin."""
    return math.hypot(per_kelvin * WARMER, uncertainty * warmer)
