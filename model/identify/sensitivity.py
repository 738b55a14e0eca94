"""What velocity steps can and cannot identify: singular values of the sensitivity of equation 2 to its parameters.

Each parameter of equation 2 (K_m, K_b, K_t, J_o, C_b, C_t) is changed by a small share, the
simulated output (and input torque) is compared, and the singular value decomposition of the result,
scaled by the noise, gives directions in parameter space with the relative standard deviation to
which each is determined. With the output alone only K/J_o and a damping come out; K_m and C_b never
do, so they are never reported.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from model.dynamics import simulate_prescribed
from model.errors import IdentificationError
from model.gear import HarmonicDrive
from model.identify.checks import Array, channels, positive
from model.identify.estimate import Identifiable
from model.linear import dynamic_parameters

PARAMETERS = {
    "mesh_stiffness": "K_m",
    "bearing_stiffness": "K_b",
    "cup_stiffness": "K_t",
    "output_inertia": "J_o",
    "bearing_damping": "C_b",
    "structural_damping": "C_t",
}
STEP = 1e-3
IDENTIFIABLE, WEAK = 0.05, 0.5
"""Relative standard deviation up to which a direction is called identifiable, and weakly identifiable."""


@dataclass(frozen=True)
class Direction:
    """One direction in the space of relative parameter changes: its relative standard deviation and its components."""

    relative_deviation: float
    components: dict[str, float]

    def sentence(self) -> str:
        """The direction in words, largest components first."""
        ordered = sorted(self.components.items(), key=lambda item: -abs(item[1]))
        terms = [f"{value:+.2f} {PARAMETERS[name]}" for name, value in ordered if abs(value) > 0.15]
        percent = 100.0 * self.relative_deviation
        known = f"known to {percent:.2g} %" if percent < 1000.0 else "not determined"
        return f"{' '.join(terms)}: {known}"


@dataclass(frozen=True)
class Identifiability:
    """Directions from best to worst determined; marginal: relative deviation of each parameter with the others free."""

    with_torque: bool
    directions: tuple[Direction, ...]
    marginal: dict[str, float]
    condition: float
    verdicts: dict[str, str]

    @classmethod
    def of(cls, columns: dict[str, Array], *, with_torque: bool) -> Identifiability:
        """By the sensitivity to each parameter (n,), in units of the noise."""
        names = list(columns)
        _, singular, right = np.linalg.svd(
            np.column_stack(list(columns.values())), full_matrices=False
        )
        deviations = 1.0 / np.maximum(singular, 1e-12)
        directions = tuple(
            Direction(float(d), dict(zip(names, (float(x) for x in row), strict=True)))
            for d, row in zip(deviations, right, strict=True)
        )
        marginal = np.sqrt(((right / np.maximum(singular, 1e-12)[:, None]) ** 2).sum(axis=0))
        verdicts: dict[str, str] = {
            name: _identifiable(float(error)) for name, error in zip(names, marginal, strict=True)
        }
        verdicts |= {n: "no" for n in ("mesh_stiffness", "bearing_damping") if n in verdicts}
        return cls(
            with_torque=with_torque,
            directions=directions,
            marginal=dict(zip(names, (float(m) for m in marginal), strict=True)),
            condition=float(singular[0] / max(singular[-1], 1e-12)),
            verdicts=verdicts,
        )

    @property
    def count(self) -> int:
        """How many independent numbers the data determine to better than 5 %."""
        return sum(d.relative_deviation < IDENTIFIABLE for d in self.directions)

    def sentence(self) -> str:
        """What the data can give, in one sentence."""
        poor = [PARAMETERS[name] for name, verdict in self.verdicts.items() if verdict == "no"]
        source = "output and input torque" if self.with_torque else "the output alone"
        text = (
            f"From {source}, {self.count} independent combinations are determined to better "
            f"than {100 * IDENTIFIABLE:g} %"
        )
        return text + (f"; {', '.join(poor)} cannot be identified one by one." if poor else ".")


def _identifiable(error: float) -> Identifiable:
    """Whether a parameter of this relative standard error is identified."""
    if error < IDENTIFIABLE:
        return "yes"
    return "weakly" if error < WEAK else "no"


def step_identifiability(
    gear: HarmonicDrive,
    input_angle: ArrayLike,
    sample_interval: float,
    *,
    output_quantum: float,
    torque_noise: float | None = None,
    input_speed: ArrayLike | None = None,
) -> Identifiability:
    """Singular value decomposition of the sensitivity of a step (n,) of the input angle [rad], evenly sampled.

    Noise: output counting, quantum/sqrt(12) [rad]; `torque_noise` [N m] of one sample includes the
    input torque. Friction and kinematic error count as known, so the figures are the best case.
    """
    (angle,) = channels(64, input_angle=input_angle)
    positive("sample_interval", sample_interval)
    noise = positive("output_quantum", output_quantum) / math.sqrt(12.0)
    base = dynamic_parameters(gear)

    def outputs(changes: dict[str, float]) -> Array:
        simulated = simulate_prescribed(
            gear,
            angle,
            sample_interval,
            input_speed=input_speed,
            parameters=base.replaced(**changes),
            smoothing_speed=0.5,
        )
        parts = [simulated.output_angle / noise]
        if torque_noise is not None:
            parts.append(simulated.wave_generator_torque / positive("torque_noise", torque_noise))
        return np.concatenate(parts)

    columns: dict[str, Array] = {}
    for name in PARAMETERS:
        value = float(getattr(base, name))
        if value == 0.0:
            continue
        change = outputs({name: value * (1 + STEP)}) - outputs({name: value * (1 - STEP)})
        columns[name] = change / (2.0 * STEP)
    if not columns:
        raise IdentificationError("has no parameter to vary", where="gear")
    return Identifiability.of(columns, with_torque=torque_noise is not None)
