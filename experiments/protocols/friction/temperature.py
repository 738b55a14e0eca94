"""What temperature does to friction: the run's own mean temperature, and 20 degC beside it.

One run cannot tell the coefficients: a span of 0.2 K leaves 0.45 %/K. They come from this gear's runs
at different temperatures (settings, by hand or by `coefficients`), or are assumed of grease and steel;
a run's own are taken where they are known better than those (`estimates.coefficients_of`).
With dT from the reference

    dry friction      F(T) = F(20) (1 + a_d dT)           viscous   c(T) = c(20) exp(a_v dT)
    bearing (18)      at rest like dry friction; what grows with speed like nu^(2/3), exp(2/3 a_v dT)

The parameter set's M_0 holds at 20 degC.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

from experiments.errors import AnalysisError, SettingError
from model.identify.estimate import Distribution

REFERENCE = 20.0
"""degC at which catalogues state friction."""
DRY, VISCOUS = "temperature of dry friction", "temperature of viscous friction"
"""Names of the two coefficients in budgets."""
THERMOMETRY = "thermometer"
"""Name of the thermometer's error in budgets: what is said of the run itself does not depend on it, only what is
brought to another temperature."""
_SPAN = math.sqrt(12.0)


@dataclass(frozen=True, kw_only=True)
class Coefficient:
    """A relative change per kelvin [1/K], its standard uncertainty, and where it comes from."""

    value: float
    standard_uncertainty: float
    source: str
    distribution: Distribution = Distribution.NORMAL

    def at(self, uncertainties: float) -> float:
        """The coefficient moved by so many standard uncertainties."""
        return self.value + uncertainties * self.standard_uncertainty


ASSUMED = {
    "dry": Coefficient(
        value=-0.005,
        standard_uncertainty=0.01 / _SPAN,
        source="assumed: 0 to -1 % per kelvin",
        distribution=Distribution.RECTANGULAR,
    ),
    "viscous": Coefficient(
        value=-0.0225,
        standard_uncertainty=0.035 / _SPAN,
        source="assumed of greases: -0.5 to -4 % per kelvin",
        distribution=Distribution.RECTANGULAR,
    ),
}


@dataclass(frozen=True, kw_only=True)
class TemperatureLaw:
    """Both coefficients, the mean housing temperature of the points [degC], NaN where it was not recorded, and the
    thermometer's standard uncertainty [K].
    """

    dry: Coefficient
    viscous: Coefficient
    mean: float
    kelvin: float = 0.0

    @property
    def is_known(self) -> bool:
        """Whether the run's temperature was recorded."""
        return math.isfinite(self.mean)

    @property
    def warmer(self) -> float:
        """K by which the run was warmer than the reference; 0 where nobody looked."""
        return self.mean - REFERENCE if self.is_known else 0.0

    def dry_factor(self, shared: Mapping[str, float]) -> float:
        """Dry friction at the run's temperature over that at 20 degC."""
        return max(1.0 + self.dry.at(shared.get(DRY, 0.0)) * self._warmer(shared), 0.1)

    def viscous_factor(self, shared: Mapping[str, float]) -> float:
        """Viscous friction at the run's temperature over that at 20 degC."""
        return math.exp(self.viscous.at(shared.get(VISCOUS, 0.0)) * self._warmer(shared))

    def _warmer(self, shared: Mapping[str, float]) -> float:
        """K by which the run was warmer than the reference, with a thermometer that is off."""
        return self.warmer + self.kelvin * shared.get(THERMOMETRY, 0.0)


def temperature_law(
    settings: Mapping[str, Any], mean: float, kelvin: float = 0.0
) -> TemperatureLaw:
    """The law of a run from its settings: `dry_per_kelvin` and `viscous_per_kelvin`, each value and U [1/K], with
    `per_kelvin_source`; `mean` [degC] and its standard uncertainty [K].
    """
    return TemperatureLaw(
        dry=_coefficient(settings, "dry"),
        viscous=_coefficient(settings, "viscous"),
        mean=mean,
        kelvin=kelvin if math.isfinite(mean) else 0.0,
    )


def _coefficient(settings: Mapping[str, Any], part: str) -> Coefficient:
    name = f"{part}_per_kelvin"
    if settings.get(name) is None:
        return ASSUMED[part]
    value, expanded = value_and_u(name, settings[name])
    source = stated(settings, name, "per_kelvin_source")
    return Coefficient(value=value, standard_uncertainty=0.5 * expanded, source=source)


def value_and_u(name: str, given: Any) -> tuple[float, float]:
    """A setting that is a value and its expanded uncertainty (k = 2), "0.48,0.02"."""
    parts = cast("tuple[Any, ...]", given if isinstance(given, tuple) else ())
    numbers = [float(p) for p in parts if isinstance(p, (int, float)) and math.isfinite(p)]
    if len(numbers) != 2 or len(parts) != 2 or numbers[1] < 0.0:
        raise SettingError(
            "needs a value and its expanded uncertainty",
            where=f"--set {name}",
            value=str(cast("object", given)),
            limit="two numbers, the second not negative",
            remedy=f"For instance --set {name}={'-0.004,0.002' if 'kelvin' in name else '0.48,0.02'}.",
        )
    return numbers[0], numbers[1]


def stated(settings: Mapping[str, Any], name: str, companion: str) -> str:
    """The words of a setting without which another is not taken: a number needs its source."""
    words = str(settings.get(companion, "")).strip()
    if not words:
        raise AnalysisError(
            f"{name} was given without {companion}",
            where=f"--set {name}",
            limit="a value with its uncertainty and where both come from",
            remedy=f"Add --set {companion}=...",
        )
    return words
