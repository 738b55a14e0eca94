"""Geometry of the gearing: the wedge that stands for the wave generator, and how many teeth engage.

(1)  alpha_n = arctan(1/(N tan alpha_t))
(3)  K_m = Z_R K_ms                                    (see `model.stiffness`)
(4)  x_c^2/(d_f/2 - omega)^2 + y_c^2/(d_f/2 + omega)^2 = 1 ,   x_c^2 + y_c^2 = d_c^2/4
(5)  Z_R = Z_c phi_c/pi ,   phi_c = arctan(x_c/y_c)    both lobes, the leading half of each

Equations 1 and 4 as printed in Zou et al. 2015; 3 and 5 reconstructed from its notation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from model.gear import HarmonicDrive
from model.sections import Geometry

_ZONE = {"leading-both-lobes": 1.0, "leading-one-lobe": 0.5, "both-halves": 2.0}


@dataclass(frozen=True, slots=True)
class EngagedZone:
    """Where the flexspline ellipse leaves the reference circle of the circular spline (equation 4), major axis = y.

    `x`, `y` [m] of the boundary point, `angle` phi_c from the major axis [rad], `teeth` Z_R (a real number).
    """

    x: float
    y: float
    angle: float
    teeth: float


def wedge_angle(gear: HarmonicDrive) -> float:
    """alpha_n, the angle of the wedge that stands for the elliptical cam (equation 1) [rad]."""
    return math.atan(1.0 / (gear.ratio * math.tan(gear.geometry.tooth_angle)))


def wedge_lift(gear: HarmonicDrive) -> float:
    """lambda = r_g tan(alpha_n), radial lift of the wedge per input angle [m/rad]."""
    return gear.geometry.neutral_radius / (gear.ratio * math.tan(gear.geometry.tooth_angle))


def radial_lever(geometry: Geometry) -> float:
    """r_g/tan(alpha_t), radial displacement of the wedge per angle at the output (equation 17) [m/rad]."""
    return geometry.neutral_radius / math.tan(geometry.tooth_angle)


def engaged_zone(gear: HarmonicDrive) -> EngagedZone:
    """The boundary of the engaged zone and Z_R (equations 4, 5).

    Closed form: with a = d_f/2 - omega, b = d_f/2 + omega, R = d_c/2,
    x_c = a sqrt((b^2 - R^2)/(b^2 - a^2)) and y_c = sqrt(R^2 - x_c^2). A solution exists because `Geometry` refuses
    omega <= (d_c - d_f)/2. `gear.options.engaged_zone` chooses which halves of the lobes count.
    """
    geometry = gear.geometry
    half = 0.5 * geometry.flexspline_diameter
    minor, major = half - geometry.radial_deformation, half + geometry.radial_deformation
    radius = 0.5 * geometry.circular_spline_diameter
    x = minor * math.sqrt((major - radius) * (major + radius) / ((major - minor) * (major + minor)))
    y = math.sqrt((radius - x) * (radius + x))
    angle = math.atan2(x, y)
    teeth = gear.teeth.circular_spline * angle / math.pi * _ZONE[gear.options.engaged_zone]
    return EngagedZone(x, y, angle, teeth)
