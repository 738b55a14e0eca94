"""What a friction fit says beyond its parameters: torques at catalogue speeds, everything at 20 degC, the paper's
search.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from experiments.protocols.friction.influences import (
    BEARING,
    RUN_TO_RUN_RELATIVE,
    FittedCurve,
    bearing_parts,
    bearing_relative,
)
from experiments.protocols.friction.quantities import CATALOGUE_SPEEDS_RPM, at_reference
from experiments.protocols.friction.temperature import DRY, VISCOUS
from experiments.torque.zero import TorqueZero
from model.arrays import FloatArray
from model.gear import HarmonicDrive
from model.identify.common_errors import Stated
from model.identify.estimate import Estimate
from model.identify.friction import UNITS
from model.identify.friction_result import FrictionFit
from model.identify.stribeck import NAMES, fit_stribeck_genetic, stribeck_curve
from model.units import RPM

Measurand = Callable[[FloatArray, Mapping[str, float]], float]
"""A quantity of the five parameters and of what is known of the common errors, each in its standard uncertainty."""


def genetic_metrics(fit: FrictionFit, gear: HarmonicDrive, seed: int) -> dict[str, float]:
    """The paper's genetic search on the same data: how far it stays behind variable projection."""
    search = fit_stribeck_genetic(
        fit.speed, fit.force, fit.force_error, common=fit.columns, seed=seed
    )
    best = max(fit.stribeck.chi_square, 1e-12)
    names = {f"genetic_{name}": float(v) for name, v in zip(NAMES, search.values, strict=True)}
    return {
        "genetic_chi_square_excess": search.chi_square / best - 1.0,
        "genetic_evaluations": float(search.evaluations),
        **names,
    }


def coefficients_of(fit: FrictionFit, curve: FittedCurve, span: float) -> dict[str, Stated]:
    """The temperature coefficients by which a run is brought to 20 degC: its own only where they are known better than
    those of the law (the card's, or those of several runs).

    What the points of one run say of a coefficient rests on a housing that was `span` [K] warmer at its end than at its
    beginning. Friction that changes from run to run changes as slowly within one, and passes for temperature: that is
    in the uncertainty of a run's own.
    """
    law, top = curve.law, fit.speed[[-1]]
    slow = RUN_TO_RUN_RELATIVE / max(span, 1e-9)
    over = slow * float(curve.dry(top)[0]) / max(float(curve.viscous(top)[0]), 1e-12)
    used: dict[str, Stated] = {}
    for source, one, wander in ((DRY, law.dry, slow), (VISCOUS, law.viscous, over)):
        told, before = fit.told(source), one.standard_uncertainty
        used[source] = Stated(source=one.source)
        if not (told > 0.0 and before > 0.0):
            continue
        alone = math.sqrt(fit.stribeck.scale * max(1.0 - told, 0.0) / told)
        u = math.hypot(alone, wander / before)
        if u < 1.0:
            own = f"of this run alone, over {span:.2g} K of its housing"
            used[source] = Stated(value=fit.shared[source] / told, uncertainty=u, source=own)
    return used


def running_torques(
    fit: FrictionFit, curve: FittedCurve, coefficients: Mapping[str, Stated]
) -> dict[str, Estimate]:
    """The no-load running torque at the catalogue's input speeds that lie within the run, and at 20 degC beside it."""
    estimates: dict[str, Estimate] = {}
    for rpm in CATALOGUE_SPEEDS_RPM:
        speed = np.array([rpm * RPM])
        if not fit.speed.min() <= speed[0] <= fit.speed.max() * 1.01:
            continue
        name = f"running_torque_{rpm:.0f}_rpm"
        for found, is_reference in ((name, False), (at_reference(name), True)):
            if is_reference and not curve.law.is_known:
                continue
            one = fit.derived(
                found,
                "N m",
                _torque(fit, curve, speed, is_reference=is_reference),
                coefficients if is_reference else None,
            )
            estimates[found] = replace(one, note=fit.subject)
    return estimates


def _torque(
    fit: FrictionFit, curve: FittedCurve, speed: FloatArray, *, is_reference: bool
) -> Measurand:
    """The friction torque of the gear at one speed [rad/s, (1,)], at the run's temperature or at 20 degC [N m]."""
    relative = bearing_relative(curve.gear, curve.law)

    def torque(values: FloatArray, shared: Mapping[str, float]) -> float:
        coulomb, static, velocity, shape, viscous = values
        dry = fit.lever * stribeck_curve(speed, (coulomb, static, velocity, shape, 0.0))
        thin = fit.lever * viscous * speed
        still, moving = bearing_parts(curve, speed, shared)
        if is_reference:
            cold, thick = curve.law.dry_factor(shared), curve.law.viscous_factor(shared)
            dry, thin = dry / cold, thin / thick
            still, moving = still / cold, moving / thick ** (2.0 / 3.0)
        factor = 1.0 + relative * shared.get(BEARING, 0.0)
        return float((dry + thin + factor * (still + moving))[0])

    return torque


def at_20_degrees(
    fit: FrictionFit, curve: FittedCurve, coefficients: Mapping[str, Stated]
) -> dict[str, Estimate]:
    """The forces and the viscous coefficient brought to 20 degC, with the uncertainty of the coefficients."""
    law = curve.law
    if not law.is_known:
        return {}
    estimates: dict[str, Estimate] = {}
    for name in ("coulomb", "static", "viscous"):
        factor = law.viscous_factor if name == "viscous" else law.dry_factor
        k = NAMES.index(name)

        def value(
            values: FloatArray,
            shared: Mapping[str, float],
            k: int = k,
            factor: Callable[[Mapping[str, float]], float] = factor,
        ) -> float:
            return float(values[k]) / factor(shared)

        found = at_reference(name)
        source = coefficients[VISCOUS if name == "viscous" else DRY].source
        one = fit.derived(found, UNITS[name], value, coefficients)
        own = fit.estimates[name]
        note = "; ".join(part for part in (own.note, f"temperature coefficient {source}") if part)
        estimates[found] = replace(one, identifiable=own.identifiable, note=note)
    return estimates


def offset_estimate(fit: FrictionFit, zero: TorqueZero) -> dict[str, Estimate]:
    """The half-sum of the directions with the torque zero in its budget."""
    if "offset" not in fit.estimates:
        return {}
    return {"offset": fit.estimates["offset"].with_budget((zero.budget(),))}
