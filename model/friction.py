"""Friction of the wave-generator bearing and of the tooth mesh, and the torque that both make at the input.

(18)  M_0 = 0.1 f_0 (nu n)^(2/3) d_m^3 sgn(theta_i')  [N m]     nu in mm^2/s, n in r/min (not rad/s), d_m in m
            0.1 2000^(2/3) f_0 d_m^3 sgn(theta_i')              where nu n < 2000 (`low_speed_branch`)
      F_fb = M_0/r_g
(19)  F_fm = {F_c + (F_s - F_c) exp[-(|theta_i'|/v_s)^sigma] + c_v |theta_i'|} sgn(theta_i')   [N]
(20)  T_f = F_fb r_g + F_fm d_f sin(alpha_t)/(2 N)              `published`
      T_f = M_0 (1 + 1/N) + F_fm r_g/(N sin(alpha_t))           `energy`: virtual work of equation 2

Equation 20 does not conserve energy in equation 2: it keeps only the tangential part of the mesh
friction. At 30 degrees the two balances differ by a factor of 3.9 in the mesh, so the numbers F_c,
F_s, c_v mean nothing without the balance they belong to (`ModelOptions.torque_balance`);
`conversion_factor` is between them. Equations 18-20 as printed in Zou et al. 2015 with the
absolute values restored; units and the low-speed branch after Palmgren (Harris and Kotzalas).

F_s may lie below F_c: friction then rises from rest, and equation 19 has no dip (no Stribeck effect).
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from model.arrays import FloatArray
from model.gear import HarmonicDrive
from model.sections import Bearing, MeshFriction
from model.units import RPM

TorqueBalance = Literal["energy", "published"]

BRANCH_LIMIT = 2000.0
"""nu n [mm2/s x r/min] below which the no-load torque of a bearing no longer falls with speed."""


def speed_sign(speed: ArrayLike, smoothing: float = 0.0) -> FloatArray:
    """sgn(theta_i'), or tanh(theta_i'/smoothing) where a smoothing speed [rad/s] is given; odd in the speed."""
    omega = np.asarray(speed, dtype=np.float64)
    return np.tanh(omega / smoothing) if smoothing > 0.0 else np.sign(omega)


def bearing_magnitude(
    bearing: Bearing, speed: ArrayLike, *, low_speed_branch: bool = True
) -> FloatArray:
    """|M_0| of equation 18 at input speeds [rad/s] of either sign [N m]; continuous where the branches meet."""
    product = bearing.viscosity * 1e6 * np.abs(np.asarray(speed, dtype=np.float64)) / RPM
    if low_speed_branch:
        product = np.maximum(product, BRANCH_LIMIT)
    return 0.1 * bearing.friction_factor * bearing.pitch_diameter**3 * np.cbrt(product) ** 2


def bearing_friction_torque(
    gear: HarmonicDrive, speed: ArrayLike, smoothing: float = 0.0
) -> FloatArray:
    """M_0, signed friction torque of the bearing on the wave generator (equation 18) [N m]; F_fb = M_0/r_g."""
    magnitude = bearing_magnitude(
        gear.bearing, speed, low_speed_branch=gear.options.low_speed_branch
    )
    return magnitude * speed_sign(speed, smoothing)


def stribeck_magnitude(mesh: MeshFriction, speed: ArrayLike) -> FloatArray:
    """|F_fm| of equation 19 at input speeds [rad/s] of either sign [N]."""
    omega = np.abs(np.asarray(speed, dtype=np.float64))
    decay = np.exp(-((omega / mesh.stribeck_velocity) ** mesh.shape))
    return mesh.coulomb + (mesh.static - mesh.coulomb) * decay + mesh.viscous * omega


def mesh_friction_force(
    gear: HarmonicDrive, speed: ArrayLike, smoothing: float = 0.0
) -> FloatArray:
    """F_fm, signed friction along the flank (equation 19) [N]."""
    return stribeck_magnitude(gear.mesh_friction, speed) * speed_sign(speed, smoothing)


def mesh_lever(gear: HarmonicDrive, balance: TorqueBalance | None = None) -> float:
    """Input torque per mesh friction force [m]: r_g/(N sin alpha_t) by energy, d_f sin alpha_t/(2 N) as published."""
    sine = math.sin(gear.geometry.tooth_angle)
    if (balance or gear.options.torque_balance) == "published":
        return 0.5 * gear.geometry.flexspline_diameter * sine / gear.ratio
    return gear.geometry.neutral_radius / (gear.ratio * sine)


def bearing_lever(gear: HarmonicDrive, balance: TorqueBalance | None = None) -> float:
    """Input torque per M_0: 1 + 1/N by energy (drag on the wave generator, and reaction through the
    mesh), 1 as published.
    """
    return (
        1.0 if (balance or gear.options.torque_balance) == "published" else 1.0 + 1.0 / gear.ratio
    )


def friction_torque(
    gear: HarmonicDrive, speed: ArrayLike, balance: TorqueBalance | None = None
) -> FloatArray:
    """T_f, the no-load running torque at the input in the gear's own balance, or in the one named (equation 20) [N m].

    Odd in the speed [rad/s]. The parameters are taken as they stand: naming another balance than the one that they were
    identified with gives another torque (see `conversion_factor`).
    """
    drag = bearing_lever(gear, balance) * bearing_friction_torque(gear, speed)
    return drag + mesh_lever(gear, balance) * mesh_friction_force(gear, speed)


def conversion_factor(gear: HarmonicDrive) -> float:
    """Mesh friction in the published balance over that in the energy balance for the same torque: 2 r_g/(d_f sin^2)."""
    return mesh_lever(gear, "energy") / mesh_lever(gear, "published")
