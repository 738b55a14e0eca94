"""How the friction of one gear changes with temperature, from its runs at different temperatures.

    dry   F = F(20) (1 + a_d (T - 20))          viscous   c = c(20) exp(a_v (T - 20))

F and log c are straight lines over the housing's temperature; each run counts by what it doesn't share with the others:
its interval, and what changes from run to run. A torque scale that is wrong is wrong in all of them and leaves the
relative change alone. Warm magnets make the port read too much by as many parts per kelvin in each run: that is taken
off. What is assumed of greases and steel is one more observation: runs at nearly one temperature change nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.protocols.friction.influences import RUN_TO_RUN
from experiments.protocols.friction.temperature import ASSUMED, REFERENCE, Coefficient
from experiments.result import Result
from experiments.tares.motor_heat import MAGNETS, MAGNETS_UNCERTAINTY
from model.arrays import FloatArray
from model.identify.estimate import NORMAL_COVERAGE_FACTOR, Estimate

_LEAST_SPAN = 1.0
"""K between the coldest and the warmest run below which nothing is learnt."""
_TOLD_BY = {"dry": "coulomb", "viscous": "viscous"}
"""The estimate whose change tells a coefficient."""


@dataclass(frozen=True)
class _Line:
    """A straight line through the runs: value at 20 degC, slope [1/K], and their covariance (2, 2)."""

    value: float
    slope: float
    covariance: FloatArray


def per_kelvin(results: Sequence[Result]) -> dict[str, Any]:
    """The settings `dry_per_kelvin`, `viscous_per_kelvin` (value and U, k = 2) and `per_kelvin_source` that the
    friction of one gear in other runs gives; nothing where they tell nothing.
    """
    runs = [result for result in results if _is_told(result)]
    warmth = [result.metrics["housing_temperature"] for result in runs]
    if len(runs) < 2 or max(warmth) - min(warmth) < _LEAST_SPAN:
        return {}
    learnt: dict[str, Any] = {}
    for part, name in _TOLD_BY.items():
        both = _with_assumed(_coefficient(runs, part, name), ASSUMED[part])
        learnt[f"{part}_per_kelvin"] = (both.value, 2.0 * both.standard_uncertainty)
    names = ", ".join(sorted(result.run for result in runs))
    learnt["per_kelvin_source"] = (
        f"of this gear's runs {names} from {min(warmth):.1f} to {max(warmth):.1f} °C, "
        "and what is assumed of greases and steel"
    )
    return learnt


def _is_told(result: Result) -> bool:
    estimates = [result.estimates.get(name) for name in _TOLD_BY.values()]
    return (
        result.options.get("torque_is_of") == "gear"
        and math.isfinite(result.metrics.get("housing_temperature", math.nan))
        and all(e is not None and e.identifiable != "no" and e.value > 0.0 for e in estimates)
    )


def _coefficient(runs: Sequence[Result], part: str, name: str) -> Coefficient:
    """What the runs alone say."""
    warmer = np.array([result.metrics["housing_temperature"] for result in runs]) - REFERENCE
    estimates = [result.estimates[name] for result in runs]
    values = np.array([e.value for e in estimates]) * (1.0 + MAGNETS * warmer)
    own = np.array([_own_uncertainty(e) for e in estimates])
    if part == "dry":
        line = _line(warmer, values, own)
        value = line.slope / line.value
        by = np.array([-value, 1.0]) / line.value
    else:
        line = _line(warmer, np.log(values), own / values)
        value, by = line.slope, np.array([0.0, 1.0])
    variance = float(by @ line.covariance @ by)
    return Coefficient(
        value=value,
        standard_uncertainty=math.hypot(math.sqrt(variance), MAGNETS_UNCERTAINTY),
        source="",
    )


def _own_uncertainty(estimate: Estimate) -> float:
    """The standard uncertainty of a run's friction that another run doesn't share."""
    between = [line.standard_uncertainty for line in estimate.budget if line.source == RUN_TO_RUN]
    return math.hypot(0.5 * (estimate.high - estimate.low) / NORMAL_COVERAGE_FACTOR, *between)


def _line(warmer: FloatArray, values: FloatArray, errors: FloatArray) -> _Line:
    """Weighted least squares; errors that are too small for the scatter grow with it (Birge's ratio)."""
    design = np.column_stack([np.ones_like(warmer), warmer]) / errors[:, np.newaxis]
    covariance: FloatArray = np.asarray(np.linalg.inv(design.T @ design), dtype=np.float64)
    found = covariance @ design.T @ (values / errors)
    left = values / errors - design @ found
    freedom = len(values) - 2
    ratio = max(1.0, float(left @ left) / freedom) if freedom else 1.0
    return _Line(float(found[0]), float(found[1]), ratio * covariance)


def _with_assumed(told: Coefficient, assumed: Coefficient) -> Coefficient:
    """The mean of both, each by its uncertainty."""
    weights = np.array([one.standard_uncertainty**-2.0 for one in (told, assumed)])
    mean = float(weights @ [told.value, assumed.value] / weights.sum())
    return Coefficient(
        value=mean, standard_uncertainty=float(weights.sum() ** -0.5), source=told.source
    )
