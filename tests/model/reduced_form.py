"""The reduced one-degree form of equation 2 (massless flexspline), an independent check of the full model."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from model.friction import bearing_friction_torque, mesh_friction_force
from model.gear import HarmonicDrive
from model.kinematic_error import series_slope, series_value
from model.linear import DynamicParameters

Array = NDArray[np.float64]


def reduced_damping(p: DynamicParameters) -> float:
    """Damping at the output of the reduced one-degree form, to first order in C_b and C_t [N m s/rad]."""
    bearing = p.bearing_damping / (p.bearing_stiffness * p.radial_lever) ** 2
    return p.combined_stiffness**2 * (bearing + p.structural_damping / p.cup_stiffness**2)


def reduced_response(
    gear: HarmonicDrive, p: DynamicParameters, angle: Array, speed: Array, interval: float
) -> tuple[Array, Array]:
    """theta_o and theta_o' (n,) without a load, started at rest:

        J_o theta_o'' = K_HDf (theta_i/N + ke - theta_f - theta_o) + D (its rate)
        theta_f = (1/r_g) [(tan^2/K_b + 1/(K_m cos^2)) (F_fb + F_fm sin) + sin F_fm/K_b]

    The forcing is linear between the samples given (no refinement).
    """
    s, c, t = math.sin(p.tooth_angle), math.cos(p.tooth_angle), math.tan(p.tooth_angle)
    mesh, ring = (
        mesh_friction_force(gear, speed),
        bearing_friction_torque(gear, speed) / p.neutral_radius,
    )
    flexibility = t * t / p.bearing_stiffness + 1.0 / (p.mesh_stiffness * c * c)
    wind_up = (flexibility * (ring + mesh * s) + s * mesh / p.bearing_stiffness) / p.neutral_radius
    stiffness, damping = p.combined_stiffness, reduced_damping(p)
    ideal = angle / p.ratio + series_value(gear.kinematic_error, angle)
    rate = speed * (1.0 / p.ratio + series_slope(gear.kinematic_error, angle))
    force = stiffness * (ideal - wind_up) + damping * rate
    pole = complex(-0.5 * damping / p.output_inertia, 0.0)
    pole += 1j * np.sqrt(
        complex(stiffness / p.output_inertia - (0.5 * damping / p.output_inertia) ** 2)
    )
    return _one_degree(force / p.output_inertia, pole, interval, ideal[0])


def _one_degree(
    acceleration: Array, pole: complex, interval: float, start: float
) -> tuple[Array, Array]:
    """Angle and speed of theta'' - 2 Re(pole) theta' + |pole|^2 theta = a(t), a linear between samples, from rest."""
    z = pole * interval
    decay = np.exp(z)
    whole, late = (decay - 1.0) / pole, (decay - 1.0 - z) / (pole * z)
    forced = (whole - late) * acceleration[:-1] + late * acceleration[1:]
    state = np.empty(acceleration.size, dtype=np.complex128)
    state[0] = -np.conj(pole) * start
    for k in range(forced.size):
        state[k + 1] = decay * state[k] + forced[k]
    angle = state.imag / pole.imag
    return angle, np.real(state) + pole.real * angle
