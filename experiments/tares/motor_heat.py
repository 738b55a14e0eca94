"""The motor's own temperature: nothing measures it, and it moves the torque that a run shows.

Magnets weaken: the same current gives less torque, so that the port (a reference, scaled by the constant at 20 degC)
reads too much. A warm-up, which warms the motor by ten kelvin and more, takes that off; elsewhere it stays in the
reading and stands in the budget. The motor's own friction falls: a tare is brought to the run by the housing's
temperatures, the best that is known of the motor's.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

from experiments.assumed import TEMPERATURE as UNKNOWN
from experiments.assumed import Assumed
from experiments.recording import Recording
from model.identify.estimate import BudgetLine
from model.identify.running_torque import Tare

WARMTH = "warmth of the motor"
"""Its line in budgets."""
REFERENCE = 20.0
"""degC at which torque constants are stated, where no bench has measured its own at another."""
MAGNETS, MAGNETS_UNCERTAINTY = -1e-3, 0.3e-3
"""Relative change of the torque constant per kelvin, assumed of servo motors (half of it to one and a half times as
much), and its standard uncertainty."""
FRICTION, FRICTION_UNCERTAINTY = -4e-3, 1.2e-3
"""Relative change of the motor's own friction per kelvin, assumed, and its standard uncertainty."""
WARMER = 1.5
"""K, standard uncertainty of the motor's temperature behind the housing's: its own losses warm it by some kelvin."""


@dataclass(frozen=True, kw_only=True)
class MotorHeat:
    """Relative standard uncertainties of the torque shown (`constant`) and of a tare as a whole (`tare`).

    `temperature` [degC] of the motor as far as it is known, NaN where it is not; `reference` [degC], where the scale of
    the torque holds.
    """

    constant: float
    tare: float
    temperature: float
    reference: float = REFERENCE

    @property
    def kelvin(self) -> float:
        """Standard uncertainty of the motor's temperature [K]."""
        return WARMER if self.assumed is None else UNKNOWN.standard_uncertainty

    @property
    def assumed(self) -> Assumed | None:
        """What is assumed of the motor's temperature where nobody recorded one."""
        return None if math.isfinite(self.temperature) else UNKNOWN

    @property
    def words(self) -> str:
        """What the correction rests on."""
        return f"torque constant {100.0 * MAGNETS:g} % per kelvin from {self.reference:.3g} °C"

    def line(self, value: float) -> BudgetLine:
        """What the motor's warmth leaves open of a torque, or of anything proportional to one."""
        if self.assumed is not None:
            return self.assumed.line(WARMTH, self.constant * value)
        return BudgetLine(WARMTH, "B", self.constant * abs(value), self.words)

    def constant_factor(self) -> tuple[float, float]:
        """The torque constant of the motor as warm as it was over that at `reference`, and its relative standard
        uncertainty."""
        if not math.isfinite(self.temperature):
            return 1.0, self.constant
        warmer = self.temperature - self.reference
        return 1.0 + MAGNETS * warmer, _relative(MAGNETS, MAGNETS_UNCERTAINTY, warmer)

    def friction_factor(self) -> tuple[float, float]:
        """The motor's friction at 20 degC over that of the run, and its relative standard uncertainty."""
        if not math.isfinite(self.temperature):
            return 1.0, abs(FRICTION) * UNKNOWN.standard_uncertainty
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
            dataclasses.replace(self, tare=relative),
        )


def motor_heat(recording: Recording, housing: float) -> MotorHeat:
    """What the housing's mean temperature [degC] says of the motor; an import does not say whose torque it is."""
    reference = _reference(recording)
    temperature, kelvin = math.nan, UNKNOWN.standard_uncertainty
    away = kelvin
    if recording.metadata.origin != "imported" and math.isfinite(housing):
        temperature, kelvin = housing, WARMER
        away = math.hypot(kelvin, housing - reference)
    return MotorHeat(
        reference=reference,
        constant=abs(MAGNETS) * away,
        tare=abs(FRICTION) * kelvin,
        temperature=temperature,
    )


def _reference(recording: Recording) -> float:
    """degC at which the scale of the torque holds: 20, or as it was when the bench measured it."""
    channel = recording.signals.get("torque")
    if channel is None or channel.calibration.temperature is None:
        return REFERENCE
    return channel.calibration.temperature


def _relative(per_kelvin: float, uncertainty: float, warmer: float) -> float:
    """Relative standard uncertainty of what is brought over so many kelvin."""
    return math.hypot(per_kelvin * WARMER, uncertainty * warmer)
