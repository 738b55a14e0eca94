"""Stiffness of the parts and of the whole drive: mesh, cup, wave-generator bearing, and their sum at the output.

(3)   mesh      K_m = Z_R K_ms, along the flank normal
(13)  cup       1/K_t = 1/K_cyl + 1/K_bot ,   K_cyl = pi G (d_WR^4 - d_RB^4)/(32 l)
                K_bot = pi G l_b d_BD^2 d_RB^2/(d_RB^2 - d_BD^2)        the disc in in-plane shear
(14)  bearing   K_b = 1.5 F_r/delta_r with delta_r = (Q_max/K_n)^(2/3), Q_max = 4.37 F_r/Z, K_n from both Hertzian contacts
(15)  damping   C_b = (0.25 .. 2.5) 1e-5 s x K_b  (Kraemer 1993), beside the C_b that the parameter set states
(21)  drive     1/K_HDf = 1/K_t + (1/r_g^2) [tan^2(alpha_t)/K_b + 1/(K_m cos^2(alpha_t))] ,   K_HDw = K_HDf/N^2

The last follows from the statics of equation 2 with the wave generator (f) or the output (w) locked. Numbers of the
equations 13-15 and 21 are inferred: they are missing from the text that survives. Bearing after Harris and Kotzalas,
"Essential Concepts of Bearing Technology", 5th ed.
"""  # noqa: E501

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

from model.errors import ParameterError
from model.gear import HarmonicDrive
from model.geometry import engaged_zone
from model.sections import Bearing, Cup, Material
from model.tooth import pair_compliance

_KRAEMER_RULE = (0.25e-5, 2.5e-5)
"""Bounds of C_b/K_b [s] for rolling bearings (Kraemer 1993)."""


@dataclass(frozen=True, slots=True)
class CupStiffness:
    """Torsional stiffness of the flexspline cup and its two parts [N m/rad]."""

    cylinder: float
    bottom: float

    @property
    def total(self) -> float:
        """K_t [N m/rad]."""
        return 1.0 / (1.0 / self.cylinder + 1.0 / self.bottom)


@dataclass(frozen=True, slots=True)
class HertzContact:
    """One ball on one groove: sum of curvatures [1/m], ellipse ratio kappa, and delta* of Harris' approach formula."""

    curvature: float
    ellipse_ratio: float
    reduced_approach: float

    def approach(self, load: float, material: Material) -> float:
        """delta [m] at a ball load Q [N]."""
        reduced = (
            3.0
            * load
            / (2.0 * self.curvature)
            * 2.0
            * (1.0 - material.poisson_ratio**2)
            / material.youngs_modulus
        )
        return self.reduced_approach * reduced ** (2.0 / 3.0) * 0.5 * self.curvature


@dataclass(frozen=True, slots=True)
class BearingStiffness:
    """Radial stiffness of the wave-generator bearing at one load; includes the softening by its thin rings.

    `load_deflection` K_n [N/m^1.5] of one ball between both grooves, `peak_ball_load` Q_max [N],
    `deflection` delta_r [m] of rigid rings, `total` K_b [N/m].
    """

    radial_load: float
    load_deflection: float
    peak_ball_load: float
    deflection: float
    total: float


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveStiffness:
    """Everything elastic between wave generator and output, and their sum by the statics of equation 2.

    `engaged_teeth` Z_R, `tooth_pair` K_ms [N/m], `mesh` K_m [N/m], `cup` K_t with its parts [N m/rad], `bearing` K_b
    [N/m], `combined_output` K_HDf and `combined_input` K_HDw [N m/rad], `mesh_at_output` and `bearing_at_output` the
    equivalents K_m r_g^2 cos^2(alpha_t) and K_b r_g^2/tan^2(alpha_t) [N m/rad].
    """

    engaged_teeth: float
    tooth_pair: float
    mesh: float
    cup: CupStiffness
    bearing: BearingStiffness
    mesh_at_output: float
    bearing_at_output: float
    combined_output: float
    combined_input: float

    def shares(self) -> dict[str, float]:
        """The share of each part in the compliance at the output; they add up to 1."""
        parts = {
            "cylinder": self.cup.cylinder,
            "bottom": self.cup.bottom,
            "bearing": self.bearing_at_output,
            "mesh": self.mesh_at_output,
        }
        return {name: self.combined_output / part for name, part in parts.items()}


def cup_stiffness(cup: Cup, material: Material) -> CupStiffness:
    """K_cyl and K_bot (equation 13): a thin shaft, and an annular disc sheared in its plane between hole and wall.

    The disc is not a short shaft: its shear stress T/(2 pi r^2 l_b) makes it the softer part of a shallow cup.
    """
    shear = material.shear_modulus
    cylinder = (
        math.pi * shear * (cup.outer_diameter**4 - cup.inner_diameter**4) / (32.0 * cup.length)
    )
    hole, wall = cup.bottom_hole_diameter, cup.inner_diameter
    bottom = math.pi * shear * cup.bottom_thickness * hole**2 * wall**2 / (wall**2 - hole**2)
    return CupStiffness(cylinder, bottom)


def elliptic_integrals(modulus_squared: float) -> tuple[float, float]:
    """Complete elliptic integrals of the first and second kind, K and E, by the arithmetic-geometric mean."""
    a, b, total, weight = 1.0, math.sqrt(1.0 - modulus_squared), 0.5 * modulus_squared, 0.5
    while abs(a - b) > 1e-15 * a:
        a, b, half = 0.5 * (a + b), math.sqrt(a * b), 0.5 * (a - b)
        weight *= 2.0
        total += weight * half**2
    first = math.pi / (a + b)
    return first, first * (1.0 - total)


@functools.lru_cache(maxsize=64)
def hertz_contact(bearing: Bearing, ring: str) -> HertzContact:
    """The contact of a ball with the groove of the "inner" or the "outer" ring.

    Curvature sum (4 - 1/f +- 2 gamma/(1 -+ gamma))/D_w with gamma = D_w/d_m; the ellipse ratio solves
    F(rho) = [(kappa^2 + 1) E - 2 K]/[(kappa^2 - 1) E] with complete elliptic integrals of modulus^2 = 1 - 1/kappa^2.
    """
    gamma = bearing.ball_diameter / bearing.pitch_diameter
    rolling = 2.0 * gamma / (1.0 - gamma) if ring == "inner" else -2.0 * gamma / (1.0 + gamma)
    total = 4.0 - 1.0 / bearing.groove_ratio + rolling
    difference = (1.0 / bearing.groove_ratio + rolling) / total
    if not 0.0 < difference < 1.0:
        limit = "groove and ball diameters with an elliptical contact"
        raise ParameterError(
            "has no elliptical contact",
            where="bearing.groove_ratio",
            value=bearing.groove_ratio,
            limit=limit,
        )
    kappa = _ellipse_ratio(difference)
    first, second = elliptic_integrals(1.0 - 1.0 / kappa**2)
    reduced = 2.0 * first / math.pi * (math.pi / (2.0 * kappa**2 * second)) ** (1.0 / 3.0)
    return HertzContact(total / bearing.ball_diameter, kappa, reduced)


@functools.lru_cache(maxsize=64)
def _ellipse_ratio(difference: float) -> float:
    """kappa > 1 of a contact whose curvature difference is F(rho), by bisection of its logarithm.

    Kept by itself: a fit that moves the bearing's damping asks for the same contact hundreds of times.
    """
    low, high = 1e-6, 20.0
    while high - low > 1e-14 * high:
        middle = 0.5 * (low + high)
        squared = math.exp(2.0 * middle)
        first, second = elliptic_integrals(1.0 - 1.0 / squared)
        if ((squared + 1.0) * second - 2.0 * first) / ((squared - 1.0) * second) < difference:
            low = middle
        else:
            high = middle
    return math.exp(0.5 * (low + high))


def bearing_stiffness(
    bearing: Bearing, material: Material, radial_load: float | None = None
) -> BearingStiffness:
    """K_b (equation 14) at a radial load [N], by default the one that the parameter set states.

    K_b grows with the cube root of the load; the model of equation 2 holds it constant. Zero clearance.
    """
    load = bearing.radial_load if radial_load is None else radial_load
    if load <= 0.0 or not math.isfinite(load):
        raise ParameterError(
            "needs a radial load", where="bearing.radial_load", value=load, limit="> 0 N"
        )
    unit = sum(hertz_contact(bearing, ring).approach(1.0, material) for ring in ("inner", "outer"))
    load_deflection = unit**-1.5
    peak = 4.37 * load / bearing.balls
    deflection = (peak / load_deflection) ** (2.0 / 3.0)
    return BearingStiffness(
        load, load_deflection, peak, deflection, bearing.ring_factor * 1.5 * load / deflection
    )


def bearing_load(gear: HarmonicDrive, output_torque: float) -> float:
    """F_b = T_o tan(alpha_t)/r_g, radial load on the bearing at a torque [N m] on the output [N]."""
    return output_torque * math.tan(gear.geometry.tooth_angle) / gear.geometry.neutral_radius


def kraemer_damping(bearing_stiffness_: float) -> tuple[float, float]:
    """Lower and upper C_b [N s/m] that rolling bearings show by the rule of Kraemer 1993 (equation 15)."""
    return _KRAEMER_RULE[0] * bearing_stiffness_, _KRAEMER_RULE[1] * bearing_stiffness_


def drive_stiffness(gear: HarmonicDrive) -> DriveStiffness:
    """All stiffnesses of the gear from its geometry, and K_HDf, K_HDw (equation 21)."""
    zone, pair = engaged_zone(gear), pair_compliance(gear)
    cup = cup_stiffness(gear.cup, gear.material)
    bearing = bearing_stiffness(gear.bearing, gear.material)
    mesh = zone.teeth * pair.stiffness
    radius, angle = gear.geometry.neutral_radius, gear.geometry.tooth_angle
    mesh_at_output = mesh * (radius * math.cos(angle)) ** 2
    bearing_at_output = bearing.total * (radius / math.tan(angle)) ** 2
    combined = 1.0 / (1.0 / cup.total + 1.0 / mesh_at_output + 1.0 / bearing_at_output)
    return DriveStiffness(
        engaged_teeth=zone.teeth,
        tooth_pair=pair.stiffness,
        mesh=mesh,
        cup=cup,
        bearing=bearing,
        mesh_at_output=mesh_at_output,
        bearing_at_output=bearing_at_output,
        combined_output=combined,
        combined_input=combined / gear.ratio**2,
    )
