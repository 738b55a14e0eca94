"""A gear with a joint covariance, made by hand: what runs would say, without a run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from model.gear import HarmonicDrive, Origin
from model.gear_file import harmonic_path, shipped_gear
from rig.exchange.identified import IdentifiedGear, of_set

UNCERTAIN = {
    "mesh_friction.coulomb": 0.03,
    "mesh_friction.static": 0.03,
    "mesh_friction.stribeck_velocity": 0.05,
    "mesh_friction.shape": 0.02,
    "mesh_friction.viscous": 0.06,
    "inertia.output": 0.03,
    "bearing.damping": 0.25,
}
"""Relative standard uncertainty of each."""
TOGETHER = 0.8
"""Correlation of Coulomb and static friction, which a wrong torque scale moves alike; of the viscous the opposite."""


def doubted() -> HarmonicDrive:
    """The gear that ships, its numbers with doubt."""
    gear = shipped_gear()
    origins = dict(gear.origins)
    values = {one.path: one.value for one in gear.values()}
    for path, share in UNCERTAIN.items():
        origins[path] = Origin("identified", "by hand", share * values[path])
    for one in gear.kinematic_error:
        origins[harmonic_path(one.order)] = Origin("identified", "by hand", 3e-6)
    return replace(gear, origins=origins)


def known_gear() -> IdentifiedGear:
    """The same with a covariance, and where it holds."""
    gear = of_set(doubted())
    covariance = gear.covariance.copy()
    error = np.sqrt(np.diag(covariance))
    i, j, k = (
        gear.uncertain.index(f"mesh_friction.{name}") for name in ("coulomb", "static", "viscous")
    )
    for p, q, r in ((i, j, TOGETHER), (i, k, -0.6), (j, k, -0.5)):
        covariance[p, q] = covariance[q, p] = r * error[p] * error[q]
    return replace(gear, covariance=covariance, serial="A1", remarks=())
