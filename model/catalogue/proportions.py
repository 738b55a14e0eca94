"""A complete parameter set of a gear that is known by its part number: the tables' values, and rules for the rest.

For each number the first of these that there is:

1. what somebody read from the nameplate or the maker's papers (`stated`);
2. the table's value of this very product (provenance catalogue, or computed where a rule derived it);
3. the table's value of the nearest relative, scaled by size (provenance assumed): see `RATINGS`;
4. for what no such table has, a law of size or a proportion of the diameter or the module (assumed).

Laws of size are least squares over the tables, in log-log; they are used between neighbours of the
table, where the exponent matters little, and never beyond the sizes of the table. Geometry is
design practice, no maker's figure: with d = 2.54 mm x size and the module m = d/Z_f, Z_f = 2 N,

    radial deformation 1.2 m      tooth 1.6 m high, 2.34 m at its root, 30 degrees, 0.157 d wide
    cup wall 0.0071 d             length 0.315 d, bottom 0.0094 d, its hole 0.31 d
    bearing's pitch 0.835 d       ball 0.075 d, 23 balls, groove 0.52
    inertia of the cup ~ d^5      damping of the bearing ~ d, mesh friction ~ d^1.02

which are those of the shipped CSF-25-120. Ranges from the literature: deformation 1.0-1.5 m, tooth
angle 10-30 degrees, wall 0.007-0.010 d, width 0.16-0.25 d, and a factor of five for the bottom.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from model.catalogue.table import Found, Product, of_product, of_relatives, rows
from model.errors import ParameterError
from model.gear import Harmonic, HarmonicDrive, Origin
from model.gear_file import harmonic_path, shipped_gear
from model.units import ARCMIN

PATTERN = "csf-25-120"
"""The shipped set whose proportions are taken."""
DIAMETER_PER_SIZE = 2.54e-3
"""m of reference diameter per unit of size: sizes are tenths of an inch."""

_CUPS = ("CSF", "CSG", "HFUC")
HOLLOW = ("SHG", "HFUS")


@dataclass(frozen=True)
class Rule:
    """How a rating is found: its name in the table, its power of size, and the series whose values may stand for it."""

    quantity: str
    power: float
    relatives: tuple[str, ...]


RATINGS: Mapping[str, Rule] = {
    "rated_torque": Rule("rated_torque", 2.94, _CUPS),
    "repeated_peak_torque": Rule("repeated_peak_torque", 2.80, _CUPS),
    "momentary_peak_torque": Rule("momentary_peak_torque", 2.98, _CUPS),
    "average_torque_limit": Rule("average_torque_limit", 2.94, _CUPS),
    "maximum_input_speed": Rule("maximum_input_speed", -0.71, ("CSG", "HFUC")),
    "average_input_speed": Rule("average_input_speed_limit", -0.71, ("CSG", "HFUC")),
    "transmission_accuracy": Rule("transmission_accuracy", 0.0, ("CSF", "CSG", "CHA")),
    "hysteresis_loss": Rule("hysteresis_loss", 0.0, ("CHA",)),
    "torque_1": Rule("T1", 3.13, ("CSF", "CSG", "HFUC", "CHA")),
    "torque_2": Rule("T2", 3.25, ("CSF", "CSG", "HFUC", "CHA")),
    "stiffness_1": Rule("K1", 3.03, ("CSF", "CSG", "HFUC", "CHA")),
    "stiffness_2": Rule("K2", 3.10, ("CSF", "CSG", "HFUC", "CHA")),
    "stiffness_3": Rule("K3", 3.10, ("CSF", "CSG", "HFUC", "CHA")),
    "ratcheting_torque": Rule("ratcheting_torque", 3.04, ("CSF", "CSG")),
    "buckling_torque": Rule("buckling_torque", 2.94, ("CSF", "CSG")),
}
"""Ratings that the table has. Where the product has no row of its own, the nearest relative's is scaled by
(size/its size)^power; the product's own series in
another unit type comes first, then cup gears, whose torques are the smaller ones."""

_STARTING = "RT1-H-CS, ratio 100, 20 degC [S6, B]: 9.6e-5 size^2.02 N m, times 100/ratio"
RUNNING = (
    "RT1-H-CS at 2000 r/min, 20 degC, ratio 100 [S6, B]: 9.7e-6 size^3.08 N m; "
    "the correction for the ratio is not known"
)

NAMEPLATE = (
    "ratings.rated_torque",
    "ratings.repeated_peak_torque",
    "ratings.average_torque_limit",
    "ratings.momentary_peak_torque",
    "ratings.maximum_input_speed",
    "ratings.average_input_speed",
    "ratings.transmission_accuracy",
    "inertia.wave_generator",
    "inertia.output",
)
"""What is asked of whoever has the gear and its papers before him."""


def gear_of_product(product: Product, stated: Mapping[str, tuple[float, Origin]]) -> HarmonicDrive:
    """The parameter set of a product; `stated` by path, in SI, stands before table and rules.

    Raises `ParameterError` for a size beyond those of the tables, and for values that cannot be one gear.
    """
    _check_size(product)
    pattern = shipped_gear(PATTERN)
    found: dict[str, tuple[float, Origin]] = {
        f"ratings.{name}": _rating(rule, product) for name, rule in RATINGS.items()
    }
    found |= _friction_ratings(product)
    found["inertia.wave_generator"] = _rating(inertia_rule(product), product)
    found |= _geometry(product, pattern)
    found |= stated
    gear = _with_series(_built(pattern, product, found), pattern)
    if "bearing.radial_load" in stated:
        return gear
    geometry = gear.geometry
    load = gear.ratings.torque_1 * math.tan(geometry.tooth_angle) / geometry.neutral_radius
    origin = Origin("computed", "at T1 at the output: F_b = T_o tan(alpha_t)/r_g")
    return gear.with_values({"bearing.radial_load": _short(load)}, origin)


def open_questions(gear: HarmonicDrive) -> tuple[str, ...]:
    """Of the nameplate's values those that are only assumed or recalled: somebody should look."""
    origins = gear.origins
    return tuple(path for path in NAMEPLATE if origins[path].provenance in ("assumed", "recalled"))


def _check_size(product: Product) -> None:
    sizes = {row.size for row in rows()}
    if not min(sizes) <= product.size <= max(sizes):
        raise ParameterError(
            "is beyond the sizes of the tables, and nothing is scaled so far",
            where="product",
            value=str(product),
            limit=f"size {min(sizes)} to {max(sizes)}",
            remedy="Copy the nearest parameter set and fill it in from the maker's papers.",
        )


def inertia_rule(product: Product) -> Rule:
    """How the wave generator's inertia is found: hollow shafts have a law of their own."""
    if product.series in HOLLOW:
        return Rule("wave_generator_inertia", 4.50, HOLLOW)
    return Rule("wave_generator_inertia", 4.73, _CUPS)


def _rating(rule: Rule, product: Product) -> tuple[float, Origin]:
    """The value of a rating for this product with its origin."""
    own = of_product(product, rule.quantity)
    if own is not None:
        provenance = "computed" if own.row.rank == "D" else "catalogue"
        return own.row.value, Origin(provenance, own.row.words + _conflicts(own))
    near = of_relatives((product.series, *rule.relatives), product, rule.quantity)
    if near is None:
        raise ParameterError("no table has this quantity", where=rule.quantity, value=str(product))
    row = near.row
    factor = (product.size / row.size) ** rule.power
    value, words = row.value, f"no table has it of {product}; that of {row.words}"
    if factor != 1.0:
        value = _short(row.value * factor)
        words += f", times ({product.size}/{row.size})^{rule.power:g}"
    return value, Origin("assumed", words)


def _conflicts(found: Found) -> str:
    """Who says something else, in words."""
    return "".join(
        f"; CONTRADICTED by {row.source} ({row.rank}): {row.value / found.row.value:.2f} times as much"
        for row in found.conflicts
    )


def _friction_ratings(product: Product) -> dict[str, tuple[float, Origin]]:
    """Starting and running torque, which the tables of these series do not have, by laws of another maker's size."""
    by_law = _short(9.6e-5 * product.size**2.02 * 100.0 / product.ratio)
    starting = by_law, Origin("assumed", _STARTING)
    own = of_product(product, "starting_torque")
    if own is not None:
        starting = own.row.value, Origin("catalogue", own.row.words)
    running = _short(9.7e-6 * product.size**3.08), Origin("assumed", RUNNING)
    return {"ratings.starting_torque": starting, "ratings.running_torque": running}


def _geometry(product: Product, pattern: HarmonicDrive) -> dict[str, tuple[float, Origin]]:
    """Teeth, and all that follows from diameter and module, in the proportions of the pattern."""
    teeth = 2 * product.ratio
    diameter = DIAMETER_PER_SIZE * product.size
    module = diameter / teeth
    size = diameter / pattern.geometry.flexspline_diameter
    finer = module / pattern.geometry.module
    whole = Origin("computed", "two-tooth difference: Z_f = 2 N, Z_c = 2 N + 2")
    values: dict[str, tuple[float, Origin]] = {
        "teeth.flexspline": (teeth, whole),
        "teeth.circular_spline": (teeth + 2, whole),
        "geometry.flexspline_diameter": (
            diameter,
            Origin("assumed", "2.54 mm x size, nominal: no catalogue prints it"),
        ),
        "geometry.circular_spline_diameter": (
            diameter + 2.0 * module,
            Origin("computed", "d_f + 2 m, m = d_f/Z_f"),
        ),
    }
    for power, words, paths in (
        (1.0, "in proportion to the module", _BY_MODULE),
        (1.0, "in proportion to the diameter", _BY_DIAMETER),
        (1.02, "starting torque ~ size^2.02/ratio, so F ~ size^1.02", _BY_FRICTION),
        (5.0, "geometric similarity: size^5", ("inertia.flexspline",)),
        (3.03, "a load whose first mode stays where it is: size^3.03", ("inertia.output",)),
    ):
        factor = (finer if paths is _BY_MODULE else size) ** power
        origin = Origin("assumed", f"{words}, as of {pattern.name}")
        values |= {path: (_short(pattern.value(path).value * factor), origin) for path in paths}
    return values


def _short(value: float) -> float:
    """A rule's value with the digits that it deserves, and no more."""
    return float(f"{value:.5g}")


_BY_MODULE = (
    "geometry.radial_deformation",
    "tooth.height",
    "tooth.root_width",
    "tooth.force_depth",
)
_BY_DIAMETER = (
    "geometry.neutral_radius",
    "tooth.width",
    "cup.length",
    "cup.inner_diameter",
    "cup.outer_diameter",
    "cup.bottom_thickness",
    "cup.bottom_hole_diameter",
    "bearing.ball_diameter",
    "bearing.pitch_diameter",
    "bearing.damping",
)
_BY_FRICTION = ("mesh_friction.coulomb", "mesh_friction.static", "mesh_friction.viscous")
"""Which numbers grow with what."""


def _built(
    pattern: HarmonicDrive, product: Product, found: Mapping[str, tuple[float, Origin]]
) -> HarmonicDrive:
    """The pattern with every number that was found; what is left of it is said to be taken from there."""
    taken = Origin("assumed", f"as of {pattern.name}, independent of the size")
    origins = {value.path: taken for value in pattern.values()}
    origins |= {path: origin for path, (_, origin) in found.items()}
    built = pattern.with_values({path: value for path, (value, _) in found.items()})
    return dataclasses.replace(built, name=str(product), origins=MappingProxyType(origins))


def _with_series(gear: HarmonicDrive, pattern: HarmonicDrive) -> HarmonicDrive:
    """The pattern's kinematic error in proportion to the transmission accuracy, until a run identifies it."""
    share = gear.ratings.transmission_accuracy / ARCMIN
    origin = Origin(
        "assumed", f"orders of {pattern.name} in proportion to the transmission accuracy"
    )
    series = tuple(
        Harmonic(h.order, h.cosine * share, h.sine * share) for h in pattern.kinematic_error
    )
    origins = dict(gear.origins) | {harmonic_path(h.order): origin for h in series}
    return dataclasses.replace(gear, kinematic_error=series, origins=MappingProxyType(origins))
