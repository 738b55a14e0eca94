"""One individual of a gear and of a motor: its own values beside the catalogue's, drawn by its seed."""

from __future__ import annotations

import dataclasses
import math

from model.gear import Harmonic, HarmonicDrive
from model.motor import ServoMotor
from model.units import DEGREE
from sim_backend.condition import harmonic_of
from sim_backend.streams import bounded, stream


def individual_gear(nominal: HarmonicDrive, seed: int) -> HarmonicDrive:
    """One gear of a series: parameters drawn about the nominal ones, as one delivered part differs from the next.

    Mesh friction +-10 % (static stays above Coulomb), Stribeck velocity +-15 %, bearing and
    lubrication factor +-10 %, damping +-15 %, thickness of the cup's bottom +-3 % (the stiffness
    follows), amplitudes of the kinematic error +-20 % with phases turned by up to 20 degrees;
    standard deviations, each parameter from its own stream.
    """
    spread = {
        "mesh_friction.coulomb": 0.10,
        "mesh_friction.stribeck_velocity": 0.15,
        "mesh_friction.viscous": 0.10,
        "bearing.friction_factor": 0.10,
        "bearing.damping": 0.15,
        "cup.bottom_thickness": 0.03,
    }
    changes = {
        path: nominal.value(path).value * math.exp(size * bounded(stream(seed, path)))
        for path, size in spread.items()
    }
    mesh = nominal.mesh_friction
    rise = (mesh.static - mesh.coulomb) * math.exp(
        0.15 * bounded(stream(seed, "mesh_friction.static"))
    )
    changes["mesh_friction.static"] = changes["mesh_friction.coulomb"] + rise
    series: list[Harmonic] = []
    for h in nominal.kinematic_error:
        random = stream(seed, f"kinematic error {h.order:.12g}")
        phase = math.atan2(h.sine, h.cosine) + random.uniform(-20.0, 20.0) * DEGREE
        series.append(harmonic_of(h.order, h.amplitude * math.exp(0.2 * bounded(random)), phase))
    return dataclasses.replace(nominal.with_values(changes), kinematic_error=tuple(series))


def individual_motor(nominal: ServoMotor, seed: int) -> ServoMotor:
    """One motor of a series: its own friction drawn +-10 % about the nominal one."""
    coulomb = nominal.coulomb_friction * math.exp(0.1 * bounded(stream(seed, "motor coulomb")))
    viscous = nominal.viscous_friction * math.exp(0.1 * bounded(stream(seed, "motor viscous")))
    return dataclasses.replace(nominal, coulomb_friction=coulomb, viscous_friction=viscous)
