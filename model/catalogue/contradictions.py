"""What cannot be true together in a gear's parameter set: each finding by name, with value, what is expected, and what to do.

A set that loads can still describe no gear: teeth of one size on the diameter of another, the ratings of
another ratio, an inertia in g cm2 read as kg cm2. Bounds are wide enough for every product of the tables and
for what design literature prints (`model.catalogue.proportions`), and narrow enough for a wrong unit or a
wrong line of a table.
"""  # noqa: E501

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass

from model.catalogue.proportions import DIAMETER_PER_SIZE, HOLLOW, RATINGS, inertia_rule
from model.catalogue.table import SERIES, Product, of_product, read_product
from model.errors import ParameterError
from model.gear import HarmonicDrive
from model.stiffness import drive_stiffness

_SAME_MODULE = 0.02
"""Share by which (d_c - d_f)/(Z_c - Z_f) and d_f/Z_f may differ, which are one module."""
_SAME_SIZE = 0.05
"""Share by which the diameter may differ from that of the size in the name: gears of size 25 have 62 to 65 mm."""
_SAME_RATING = 0.03
"""Share by which a rating may differ from the table: three printed digits, and those that were derived."""
_INERTIA_FACTOR = 4.0
"""A wave generator is within this factor of its size's law: HFUS-11 has three times as much."""
_CUP_FACTOR = 4.0
"""The cup's inertia within this factor of that of its cylinder and teeth."""
_STIFFNESS_FACTOR = 6.0
"""The computed stiffness within this factor of K1, which at ratio 30 is a quarter of it."""


@dataclass(frozen=True)
class Contradiction:
    """One thing that cannot be: its name, where it stands, what stands there, what is expected and why, what to do."""

    name: str
    where: str
    value: str
    expected: str
    remedy: str

    def as_json(self) -> dict[str, str]:
        """Name, place, value, expectation, remedy."""
        return dataclasses.asdict(self)


def contradictions(gear: HarmonicDrive) -> tuple[Contradiction, ...]:
    """Everything in a parameter set that contradicts something else, or the table of its series."""
    product = _product_of(gear)
    found = [*_teeth(gear), *_module(gear), *_cup(gear), *_ratings(gear), *_masses(gear)]
    if product is not None:
        found += [*_name(gear, product), *_table(gear, product)]
    return tuple(found)


def _product_of(gear: HarmonicDrive) -> Product | None:
    """The product that the set's name says it is; None where it is no part number."""
    try:
        return read_product(gear.name)
    except ParameterError:
        return None


def not_compared(gear: HarmonicDrive) -> str:
    """Why the set could not be held against a table; "" where it was."""
    product = _product_of(gear)
    if product is None:
        return (
            f"{gear.name!r} is no part number (SERIES-SIZE-RATIO-UNIT): not held against any table"
        )
    if product.series not in SERIES or of_product(product, "rated_torque") is None:
        return f"no table has {product}: its ratings were not held against any"
    return ""


def _between(value: float, low: float, high: float) -> bool:
    return low <= value <= high


def _teeth(gear: HarmonicDrive) -> Iterator[Contradiction]:
    teeth, geometry = gear.teeth, gear.geometry
    difference = teeth.circular_spline - teeth.flexspline
    if difference != 2:
        yield Contradiction(
            "tooth difference",
            "teeth.circular_spline",
            f"{teeth.circular_spline} - {teeth.flexspline} = {difference}",
            "2: the wave generator has two lobes",
            "Count the teeth, or take Z_f = 2 N and Z_c = 2 N + 2.",
        )
    module = geometry.flexspline_diameter / teeth.flexspline
    between = (geometry.circular_spline_diameter - geometry.flexspline_diameter) / difference
    if abs(between - module) > _SAME_MODULE * module:
        expected = geometry.flexspline_diameter + module * difference
        yield Contradiction(
            "teeth against diameters",
            "geometry.circular_spline_diameter",
            f"{geometry.circular_spline_diameter * 1e3:.7g} mm, module {between * 1e3:.4g} mm",
            f"{expected * 1e3:.7g} mm = d_f Z_c/Z_f, module {module * 1e3:.4g} mm",
            "Both splines have one module: correct teeth or diameters.",
        )


def _module(gear: HarmonicDrive) -> Iterator[Contradiction]:
    module = gear.geometry.flexspline_diameter / gear.teeth.flexspline
    for path, name, low, high in (
        ("geometry.radial_deformation", "deformation against module", 1.0, 1.7),
        ("tooth.height", "tooth height against module", 1.2, 2.5),
        ("tooth.root_width", "tooth root against module", 1.5, math.pi),
    ):
        value = gear.value(path).value
        if not _between(value / module, low, high):
            yield Contradiction(
                name,
                path,
                f"{value * 1e3:.4g} mm = {value / module:.3g} modules",
                f"{low:g} to {high:.3g} modules of {module * 1e3:.4g} mm = d_f/Z_f",
                "It changes with the module: correct it, or diameter and teeth.",
            )


def _cup(gear: HarmonicDrive) -> Iterator[Contradiction]:
    diameter, cup, bearing = gear.geometry.flexspline_diameter, gear.cup, gear.bearing
    wall = 0.5 * (cup.outer_diameter - cup.inner_diameter)
    around = bearing.pitch_diameter + bearing.ball_diameter
    for name, path, share, low, high, of in (
        ("cup against diameter", "cup.outer_diameter", cup.outer_diameter, 0.85, 1.02, diameter),
        ("wall against diameter", "cup.outer_diameter", wall, 0.004, 0.02, diameter),
        ("tooth width against diameter", "tooth.width", gear.tooth.width, 0.1, 0.4, diameter),
        ("bearing against cup", "bearing.pitch_diameter", around, 0.7, 1.0, cup.inner_diameter),
        (
            "balls against bearing",
            "bearing.balls",
            bearing.balls * bearing.ball_diameter,
            0.3,
            1.0,
            math.pi * bearing.pitch_diameter,
        ),
    ):
        if not _between(share / of, low, high):
            yield Contradiction(
                name,
                path,
                f"{share * 1e3:.4g} mm = {share / of:.3g} of {of * 1e3:.4g} mm",
                f"{low:g} to {high:g} of it",
                "One of the two is of another size: correct it.",
            )


def _ratings(gear: HarmonicDrive) -> Iterator[Contradiction]:
    ratings = gear.ratings
    for smaller, larger in (
        ("rated_torque", "average_torque_limit"),
        ("average_torque_limit", "momentary_peak_torque"),
        ("momentary_peak_torque", "ratcheting_torque"),
        ("momentary_peak_torque", "buckling_torque"),
        ("average_input_speed", "maximum_input_speed"),
        ("torque_1", "repeated_peak_torque"),
        ("stiffness_1", "stiffness_2"),
        ("stiffness_2", "stiffness_3"),
    ):
        low, high = getattr(ratings, smaller), getattr(ratings, larger)
        if low is not None and high is not None and low > high:
            unit = gear.value(f"ratings.{smaller}").unit
            yield Contradiction(
                f"{smaller} against {larger}",
                f"ratings.{smaller}",
                f"{low:.5g} {unit}",
                f"<= {larger} = {high:.5g} {unit}",
                "Look both up again: they may stand in each other's column.",
            )
    computed = drive_stiffness(gear).combined_output
    if not _between(computed / ratings.stiffness_1, 1.0 / _STIFFNESS_FACTOR, _STIFFNESS_FACTOR):
        yield Contradiction(
            "computed stiffness against K1",
            "ratings.stiffness_1",
            f"{ratings.stiffness_1:.4g} N m/rad; computed from the geometry {computed:.4g} N m/rad",
            f"within a factor of {_STIFFNESS_FACTOR:g}",
            "Check the cup's thicknesses and diameters, then K1 and its unit.",
        )


def _masses(gear: HarmonicDrive) -> Iterator[Contradiction]:
    size = round(gear.geometry.flexspline_diameter / DIAMETER_PER_SIZE)
    product = _product_of(gear)
    hollow = product is not None and product.series in HOLLOW
    law = 5.64e-11 * size**4.50 if hollow else 1.20e-11 * size**4.73
    inertia = gear.inertia.wave_generator
    if not _between(inertia / law, 1.0 / _INERTIA_FACTOR, _INERTIA_FACTOR):
        yield Contradiction(
            "wave generator's inertia against size",
            "inertia.wave_generator",
            f"{inertia:.3g} kg m2",
            f"{law:.3g} kg m2 within a factor of {_INERTIA_FACTOR:g}, {_kind_of_shaft(hollow)} of size {size}",
            "Check its unit: catalogues print 1e-4 kg m2 = kg cm2.",
        )
    cup = gear.cup
    radius = 0.25 * (cup.outer_diameter + cup.inner_diameter)
    wall = 0.5 * (cup.outer_diameter - cup.inner_diameter)
    rim = gear.tooth.width * gear.geometry.flexspline_diameter / gear.teeth.flexspline * 2.0
    mass = 2.0 * math.pi * radius * gear.material.density * (wall * cup.length + rim)
    shell = mass * radius**2
    if not _between(gear.inertia.flexspline / shell, 1.0 / _CUP_FACTOR, _CUP_FACTOR):
        yield Contradiction(
            "cup's inertia against its size",
            "inertia.flexspline",
            f"{gear.inertia.flexspline:.3g} kg m2",
            f"{shell:.3g} kg m2 of wall and toothed rim, within a factor of {_CUP_FACTOR:g}",
            "Compute it from the drawing, or scale it with the fifth power of the diameter.",
        )


def _kind_of_shaft(hollow: bool) -> str:
    return "hollow-shaft wave generators" if hollow else "wave generators"


def _name(gear: HarmonicDrive, product: Product) -> Iterator[Contradiction]:
    if gear.ratio != product.ratio:
        yield Contradiction(
            "ratio against name",
            "teeth.flexspline",
            f"Z_f/(Z_c - Z_f) = {gear.ratio:g}",
            f"{product.ratio}, as {gear.name} says",
            "Correct teeth or name; with the flexspline fixed the ratio is N + 1, and N stays.",
        )
    nominal = DIAMETER_PER_SIZE * product.size
    diameter = gear.geometry.flexspline_diameter
    if abs(diameter - nominal) > _SAME_SIZE * nominal:
        yield Contradiction(
            "diameter against name",
            "geometry.flexspline_diameter",
            f"{diameter * 1e3:.4g} mm",
            f"{nominal * 1e3:.4g} mm within {100 * _SAME_SIZE:g} %: size {product.size} in tenths of an inch",
            "Correct diameter or name.",
        )


def _table(gear: HarmonicDrive, product: Product) -> Iterator[Contradiction]:
    """What the table says otherwise of this very product."""
    named = {f"ratings.{name}": rule.quantity for name, rule in RATINGS.items()}
    named["inertia.wave_generator"] = inertia_rule(product).quantity
    for path, quantity in named.items():
        found = of_product(product, quantity)
        section, _, name = path.partition(".")
        value = getattr(getattr(gear, section), name)
        if found is None or value is None:
            continue
        if abs(value - found.row.value) > _SAME_RATING * found.row.value:
            unit = gear.value(path).unit
            yield Contradiction(
                f"{name} against the table of {product.series}",
                path,
                f"{value:.5g} {unit}",
                f"{found.row.value:.5g} {unit}: {found.row.words}",
                "Look it up for this size, ratio and unit type; the nameplate stands above the table.",
            )
