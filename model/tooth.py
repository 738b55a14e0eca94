"""Compliance of one tooth pair (equations 6-12): cantilever slices of a trapezoid, root, and contact.

The tooth is a trapezoid of height H_t and root width L_b; the normal force acts L_m below the tip,
on a flank inclined by beta_j = alpha_t. The part between root and force point, z_j = H_t - L_m, is
cut into n slices.

(6)   bending      delta_B = (F/E) { cos^2 beta (T^3 + 3 T^2 L + 3 T L^2)/(3 I)
                                     - cos beta sin beta (T^2 y_j + 2 T y_j L)/(2 I) }          as published
      by strain energy the cross term is doubled and sin^2 beta y_j^2 T/I is added, which makes it reciprocal
(7)   shear        delta_S = 1.2 F T cos^2 beta/(G A)
(8)   compression  delta_C = F T sin^2 beta/(E A)
(9)   one tooth    delta = sum over the slices (+ the root, where it is switched on)
(10)  both teeth   delta_m = delta_f + delta_c
(11)  contact      one of three laws
(12)  pair         K_ms = F/(delta_m + delta_contact)

Equations 6 and 10 as printed in Zou et al. 2015 (6 with its minus sign restored); 7-9 and 12 after
Cornell 1981 (ASME J. Mech. Des. 103, 447); 11 is not in the text that survives: Palmgren as used by
Cornell, Lundberg, or Yang and Sun.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from model.errors import ParameterError
from model.gear import HarmonicDrive


@dataclass(frozen=True, slots=True)
class ToothCompliance:
    """Displacement of one tooth along the normal force, per force, by cause [m/N]."""

    bending: float
    shear: float
    compression: float
    root: float

    @property
    def total(self) -> float:
        """delta_j/F_j of equation 9 [m/N]."""
        return self.bending + self.shear + self.compression + self.root


@dataclass(frozen=True, slots=True)
class PairCompliance:
    """One tooth of the flexspline against one of the circular spline (equations 10-12) [m/N] at `load` [N]."""

    tooth: ToothCompliance
    contact: float
    load: float

    @property
    def total(self) -> float:
        """(delta_m + delta_c)/F with two equal teeth [m/N]."""
        return 2.0 * self.tooth.total + self.contact

    @property
    def stiffness(self) -> float:
        """K_ms of equation 12 [N/m]."""
        return 1.0 / self.total

    def shares(self) -> dict[str, float]:
        """The share of each cause in the compliance of the pair."""
        parts = {
            "bending": 2.0 * self.tooth.bending,
            "shear": 2.0 * self.tooth.shear,
            "compression": 2.0 * self.tooth.compression,
            "root": 2.0 * self.tooth.root,
            "contact": self.contact,
        }
        return {name: part / self.total for name, part in parts.items()}


def tooth_compliance(gear: HarmonicDrive) -> ToothCompliance:
    """Compliance of one tooth (equations 6-9), as `gear.options.bending` and `root_flexibility` choose."""
    tooth, material = gear.tooth, gear.material
    beta = gear.geometry.tooth_angle
    cosine, sine, slope = math.cos(beta), math.sin(beta), math.tan(beta)
    reach = tooth.height - tooth.force_depth
    half_at_force = 0.5 * tooth.root_width - reach * slope
    thickness = reach / tooth.slices
    by_energy = gear.options.bending == "energy"
    bending = shear = compression = 0.0
    for index in range(tooth.slices):
        half = 0.5 * tooth.root_width - (index + 0.5) * thickness * slope
        area = 2.0 * half * tooth.width
        second_moment = tooth.width * (2.0 * half) ** 3 / 12.0
        arm = reach - (index + 1) * thickness
        direct = (thickness**3 + 3.0 * thickness**2 * arm + 3.0 * thickness * arm**2) / (
            3.0 * second_moment
        )
        cross = half_at_force * (thickness**2 + 2.0 * thickness * arm) / (2.0 * second_moment)
        bending += cosine**2 * direct - cosine * sine * cross * (2.0 if by_energy else 1.0)
        if by_energy:
            bending += sine**2 * half_at_force**2 * thickness / second_moment
        shear += 1.2 * thickness * cosine**2 / (material.shear_modulus * area)
        compression += thickness * sine**2 / (material.youngs_modulus * area)
    root = _root(gear, reach) if gear.options.root_flexibility else 0.0
    return ToothCompliance(bending / material.youngs_modulus, shear, compression, root)


def _root(gear: HarmonicDrive, reach: float) -> float:
    """Foundation compliance of the tooth root, plane strain (Cornell 1981) [m/N]."""
    beta, nu = gear.geometry.tooth_angle, gear.material.poisson_ratio
    ratio = reach / gear.tooth.root_width
    bracket = 5.306 * ratio**2 + 2.0 * (1.0 - nu - 2.0 * nu**2) / (1.0 - nu**2) * ratio
    bracket += 1.534 * (1.0 + 0.4167 * math.tan(beta) ** 2 / (1.0 + nu))
    return (
        math.cos(beta) ** 2
        * (1.0 - nu**2)
        * bracket
        / (gear.material.youngs_modulus * gear.tooth.width)
    )


def contact_compliance(gear: HarmonicDrive, load: float) -> float:
    """Secant compliance of the flank contact, delta_c/F (equation 11), at a normal load [N] on the pair; [m/N].

    "palmgren"  1.37 F^0.9/(E12^0.9 B^0.8), E12 = E for equal steels (Cornell; Palmgren)
    "lundberg"  1.36 [2 (1 - nu^2)/E]^0.9 F^0.9/B^0.8
    "yang-sun"  4 (1 - nu^2) F/(pi E B), independent of load
    """
    if load <= 0.0 or not math.isfinite(load):
        raise ParameterError(
            "needs a load on the tooth pair", where="tooth.pair_load", value=load, limit="> 0 N"
        )
    modulus, nu, width = gear.material.youngs_modulus, gear.material.poisson_ratio, gear.tooth.width
    if gear.options.contact == "yang-sun":
        return 4.0 * (1.0 - nu**2) / (math.pi * modulus * width)
    if gear.options.contact == "lundberg":
        return 1.36 * (2.0 * (1.0 - nu**2) / modulus) ** 0.9 * load**-0.1 / width**0.8
    return 1.37 * load**-0.1 / (modulus**0.9 * width**0.8)


def pair_compliance(gear: HarmonicDrive, load: float | None = None) -> PairCompliance:
    """One practical tooth pair at `load` [N], by default `gear.tooth.pair_load`; both teeth of the same section.

    Raises `ParameterError` where the published bending goes so far negative (squat teeth, large flank angle) that no
    stiffness is left; `bending = "energy"` has no such limit.
    """
    force = gear.tooth.pair_load if load is None else load
    pair = PairCompliance(tooth_compliance(gear), contact_compliance(gear, force), force)
    if pair.total <= 0.0:
        raise ParameterError(
            "the published bending term (equation 6) makes the compliance of the tooth pair negative",
            where="tooth.height",
            value=f"{gear.tooth.height:g} m",
            limit="a positive compliance",
            remedy='Choose options.bending = "energy".',
        )
    return pair
