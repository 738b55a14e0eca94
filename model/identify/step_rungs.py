"""The rungs of the ladder of velocity steps: what a gear's card lets one expect, and which numbers each rung has."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from model.identify.step_problem import Shape
from model.identify.torsional_mode import TorsionModel
from model.units import REVOLUTION

FITTED = ("linear", "hardening", "hysteresis")
"""Rungs with numbers that are fitted, above the rigid gear and the paper's equation 2."""
BEARING_TORQUE = 1.0
"""N m; how large the friction of the output's bearing is believed to be."""
LEAST_RELAXATION = 1e-6
"""s; stands for a wave-generator bearing without damping."""


@dataclass(frozen=True, kw_only=True)
class Expected:
    """What is known before the fit, of the gear's card: where the search begins and what a run can't tell.

    `stiffness` K/J_o [1/s2], `share` of the wave-generator bearing in the compliance and its `relaxation` C_b/K_b [s],
    `inertia` J_o [kg m2] (turns
    torques into accelerations), `torques` T1 and T2 [N m], `hardening` K2/K1 and K3/K1, `loss` hysteresis [rad],
    `amplitude` [N m] at which the secant stiffness is stated. `is_known`: whether it is this gear's.
    """

    stiffness: float
    share: float
    relaxation: float
    inertia: float
    torques: tuple[float, float]
    hardening: tuple[float, float]
    loss: float
    amplitude: float
    is_known: bool = True

    @property
    def frequency(self) -> float:
        """sqrt(K/J_o) [Hz]."""
        return math.sqrt(self.stiffness) / REVOLUTION


def models_of(expected: Expected) -> Callable[[Mapping[str, float]], TorsionModel]:
    first, second = (torque / expected.inertia for torque in expected.torques)

    def model(values: Mapping[str, float]) -> TorsionModel:
        hardens = "second" in values
        later = math.exp(values.get("kink", 0.0))
        stiffer = math.exp(values.get("second", 0.0))
        frequency, damping = math.exp(0.5 * values["stiffness"]), math.exp(values["damping"])
        # A gear that is softer than its card by its share of the compliance has a softer bearing: C_b/K_b goes as 1/K.
        relaxation = expected.relaxation * expected.stiffness / frequency**2
        # The bearing damps by no more than its card says; the rest is lost beside the springs and stiffens nothing.
        bearing = 0.5 * expected.share * max(relaxation, LEAST_RELAXATION) * frequency
        soft = (0.0, 0.0)
        if "soft" in values:
            soft = (math.exp(values["soft"]), math.exp(values["limit"]))
        return TorsionModel(
            stiffness=math.exp(values["stiffness"]),
            relaxation=2.0 * min(damping, bearing) / (expected.share * frequency),
            loss=2.0 * max(damping - bearing, 0.0) * frequency,
            share=expected.share,
            second=stiffer,
            third=stiffer * math.exp(values.get("third", 0.0)),
            torques=(first * later, second * later) if hardens else (math.inf, math.inf),
            hysteresis=soft,
        )

    return model


def shapes_of(
    expected: Expected, frequency: float
) -> tuple[dict[str, Shape], dict[str, dict[str, float]]]:
    """The numbers of each rung, and where those begin that it adds."""
    damped = math.log(0.02)
    second, third = expected.hardening
    slides = expected.stiffness * 0.5 * expected.loss
    added = {
        "linear": {
            "stiffness": 2.0 * math.log(REVOLUTION * frequency),
            "damping": damped,
            "bearing": 0.1 * BEARING_TORQUE / expected.inertia,
            "skew": 0.0,
        },
        "hardening": {"second": math.log(second), "third": math.log(third / second), "kink": 0.0},
        "hysteresis": {"soft": math.log(0.05 * expected.stiffness), "limit": math.log(slides)},
    }
    prior = {
        "damping": (damped, 1.5),
        "bearing": (0.0, BEARING_TORQUE / expected.inertia),
        "skew": (0.0, 2e-3),
        "second": (math.log(second), 0.3),
        "third": (math.log(third / second), 0.15),
        "kink": (0.05, 0.15),
        "soft": (math.log(0.05 * expected.stiffness), 1.5),
        "limit": (math.log(slides), 1.0),
    }
    names: tuple[str, ...] = ()
    shapes: dict[str, Shape] = {}
    for rung, more in added.items():
        names = (*names, *more)
        shapes[rung] = Shape(names=names, prior=prior)
    return shapes, added
