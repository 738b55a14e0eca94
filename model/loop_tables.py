"""What the closed loop looks up: the exact step of its linear part, and tables of error, friction and cogging.

Built once per gear in plain numpy; `model.kernels.closed_loop` reads them. The linear part is that of equation 2
(`model.linear`) with the rotor as a fourth mass, in displacements relative to the rigid gear:

    r = q - (1, t, t) lambda theta_i ,   M q'' = -K r - C q' + (K_b e + C_b (lambda theta_i' + e')) u_1 + (T_o/r_g) u_3
    J theta_i'' = T - lambda F_b ,       F_b = K_b (e - r_1) + C_b (lambda theta_i' + e' - x2')
"""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import scipy  # pyright: ignore[reportMissingTypeStubs]

from model import friction
from model.arrays import FloatArray
from model.errors import ModelError
from model.gear import Harmonic, HarmonicDrive
from model.kinematic_error import series_slope, series_value
from model.linear import DynamicParameters, damping_matrix, mass_matrix, stiffness_matrix

FRICTION_POINTS = 4096
COGGING_POINTS = 2048
_LONGEST_PERIOD = 2000
"""Input revolutions after which the orders of a simulated gear must repeat."""


def linear_system(
    p: DynamicParameters, rotor_inertia: float, *, coupled: bool = True
) -> FloatArray:
    """d/dt of [w, r1, x2', r2, y1', r3, y2', dtheta, T, e, e', T_o] (12, 12), the inputs as constant states.

    `coupled` False takes the wedge away: the rotor turns alone.
    """
    lift = p.radial_lever / p.ratio if coupled else 0.0
    tangent = math.tan(p.tooth_angle)
    inverse = 1.0 / np.diag(mass_matrix(p))
    a = np.zeros((12, 12))
    place, speed = np.array([1, 3, 5]), np.array([2, 4, 6])
    a[np.ix_(speed, place)] = -inverse[:, None] * stiffness_matrix(p)
    a[np.ix_(speed, speed)] = -inverse[:, None] * damping_matrix(p)
    a[2, [0, 9, 10]] += inverse[0] * np.array(
        [p.bearing_damping * lift, p.bearing_stiffness, p.bearing_damping]
    )
    a[6, 11] = inverse[2] / p.neutral_radius
    a[place, speed] = 1.0
    a[place, 0] = -lift * np.array([1.0, tangent, tangent])
    force = np.zeros(12)
    force[[0, 1, 2]] = p.bearing_damping * lift, -p.bearing_stiffness, -p.bearing_damping
    force[[9, 10]] = p.bearing_stiffness, p.bearing_damping
    a[0] = -lift / rotor_inertia * force
    a[0, 8] = 1.0 / rotor_inertia
    a[7, 0] = a[9, 10] = 1.0
    return a


def step_matrix(system: FloatArray, step: float) -> FloatArray:
    """The exact step, flat (88,), eight numbers per cause: seven states, T, e at the start and end of the step, T_o.

    The error is linear in between (first-order hold), the torques are constant.
    """
    exact = scipy.linalg.expm(system * step)[:8]
    ramp = exact[:, 10] / step
    columns = [
        *(exact[:, i] for i in range(7)),
        exact[:, 8],
        exact[:, 9] - ramp,
        ramp,
        exact[:, 11],
    ]
    return np.concatenate(columns)


def error_table(series: tuple[Harmonic, ...], ratio: float, lever: float) -> tuple[FloatArray, int]:
    """Cubic pieces of e = lever ke(theta_i) over one period (points + 1, 4), and the period in input revolutions."""
    turns = common_period(tuple(h.order for h in series), ratio)
    highest = max((h.order for h in series), default=1.0)
    points = turns * max(128, math.ceil(24.0 * highest))
    spacing = 2.0 * math.pi * turns / points
    angle = np.arange(points) * spacing
    here, slope = lever * series_value(series, angle), lever * spacing * series_slope(series, angle)
    ahead, slope_ahead = np.roll(here, -1), np.roll(slope, -1)
    table = np.empty((points + 1, 4))
    table[:-1, 0], table[:-1, 1] = here, slope
    table[:-1, 2] = 3.0 * (ahead - here) - 2.0 * slope - slope_ahead
    table[:-1, 3] = 2.0 * (here - ahead) + slope + slope_ahead
    table[-1] = table[0]
    return table, turns


def common_period(orders: tuple[float, ...], ratio: float) -> int:
    """Input revolutions after which all orders repeat: 1 for whole orders, N where output orders k/N are among them."""
    period = 1
    for order in orders:
        scaled = order * ratio
        if float(ratio).is_integer() and abs(scaled - round(scaled)) < 1e-6:
            fraction = Fraction(round(scaled), round(ratio))
        else:
            fraction = Fraction(order).limit_denominator(_LONGEST_PERIOD)
        if abs(float(fraction) - order) > 1e-9 * max(1.0, order):
            raise ModelError(
                "an order of the kinematic error does not repeat within a simulable number of revolutions",
                where="kinematic_error.orders",
                value=order,
                limit=f"a fraction with a denominator up to {_LONGEST_PERIOD}",
                remedy="Use whole orders, output orders k/N and sidebands n(1 + 1/N) of the gear's ratio.",
            )
        period = math.lcm(period, fraction.denominator)
    if period > _LONGEST_PERIOD:
        raise ModelError(
            "the orders of the kinematic error have no common period that can be simulated",
            where="kinematic_error.orders",
            value=period,
            limit=f"<= {_LONGEST_PERIOD} input revolutions",
        )
    return period


def friction_table(
    gear: HarmonicDrive, p: DynamicParameters, highest_speed: float, *, windup: bool
) -> FloatArray:
    """Mesh dry, mesh viscous, bearing above its low-speed value [N m], wind-up [rad], over sqrt|w| (points + 1, 4).

    Linear interpolation over the root of the speed follows the Stribeck curve where it is steep;
    its error at the default gear is below 1e-7 N m. `highest_speed` [rad/s] is the last point;
    beyond it the last piece is extended.
    """
    speed = np.linspace(0.0, math.sqrt(highest_speed), FRICTION_POINTS + 1) ** 2
    mesh = gear.mesh_friction
    force, viscous = friction.stribeck_magnitude(mesh, speed), mesh.viscous * speed
    lever = friction.mesh_lever(gear) * gear.ratio / p.ratio
    drag = bearing_drag(gear, speed)
    table = np.zeros((FRICTION_POINTS + 1, 4))
    table[:, 0], table[:, 1] = lever * (force - viscous), lever * viscous
    table[:, 2] = friction.bearing_lever(gear) * (drag - drag[0])
    if windup:
        table[:, 3] = _friction_lag(p, drag / p.neutral_radius, force)
    return table


def bearing_drag(gear: HarmonicDrive, speed: FloatArray) -> FloatArray:
    """|M_0| of equation 18 in the gear's own branches [N m]."""
    return friction.bearing_magnitude(
        gear.bearing, speed, low_speed_branch=gear.options.low_speed_branch
    )


def _friction_lag(
    p: DynamicParameters, bearing_force: FloatArray, mesh_force: FloatArray
) -> FloatArray:
    """theta_f, the angle by which friction winds the gear up (reduced form of equation 2) [rad].

    theta_f = [(t^2/K_b + 1/(K_m c^2)) (F_fb + F_fm s) + s F_fm/K_b]/r_g
    """
    s, c, t = math.sin(p.tooth_angle), math.cos(p.tooth_angle), math.tan(p.tooth_angle)
    flexibility = t * t / p.bearing_stiffness + 1.0 / (p.mesh_stiffness * c * c)
    lag = flexibility * (bearing_force + s * mesh_force) + s * mesh_force / p.bearing_stiffness
    return lag / p.neutral_radius


def cogging_table(cogging: tuple[Harmonic, ...]) -> FloatArray:
    """Cogging torque over one input revolution [N m] (points + 2,)."""
    return series_value(cogging, np.arange(COGGING_POINTS + 2) * (2.0 * math.pi / COGGING_POINTS))
