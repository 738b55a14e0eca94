"""The sections of a parameter set: every number with its unit and its allowed range, and what cannot be one gear.

A section holds plain floats, so that physics reads `bearing.ball_diameter`; what is declared of each stands in the
metadata of its field. Symbols are those of Zou et al. 2015.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from model.errors import ParameterError, path_of


def quantity(
    unit: str,
    description: str,
    *,
    symbol: str = "",
    above: float = -math.inf,
    low: float = -math.inf,
    high: float = math.inf,
    may_be_unknown: bool = False,
) -> Any:
    """Declare a physical quantity: `above` is an exclusive lower bound, `low` and `high` are inclusive.

    What `may_be_unknown` is None where nobody stated it, and then left away from files and tables.
    """
    meta = {
        "unit": unit,
        "description": description,
        "symbol": symbol,
        "above": above,
        "low": low,
        "high": high,
    }
    if may_be_unknown:
        return field(default=None, metadata=meta)
    return field(metadata=meta)


def is_unknown(f: dataclasses.Field[Any], value: object) -> bool:
    """Whether this declared quantity is one that nobody stated, and need not."""
    return value is None and f.default is None


def allowed_range(meta: Mapping[str, Any]) -> str:
    """The allowed range of a declared quantity in words, for messages and tables."""
    unit = f" {meta['unit']}" if meta["unit"] not in ("", "1") else ""
    sign, lower = ">=", meta["low"]
    if meta["above"] > -math.inf:
        sign, lower = ">", meta["above"]
    if lower == -math.inf and meta["high"] == math.inf:
        return "any finite number"
    if meta["high"] == math.inf:
        return f"{sign} {lower:g}{unit}"
    if lower == -math.inf:
        return f"<= {meta['high']:g}{unit}"
    return f"{sign} {lower:g} and <= {meta['high']:g}{unit}"


def _is_finite_number(value: object) -> bool:
    """Whether this is a number that a float can hold: no text, no truth value, not NaN, not infinite."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


@dataclass(frozen=True)
class Section:
    """Base of every section: checks each declared quantity on construction and names the path on refusal."""

    section: ClassVar[str] = ""

    def __post_init__(self) -> None:
        for f in dataclasses.fields(self):
            if "unit" not in f.metadata:
                continue
            value = getattr(self, f.name)
            if is_unknown(f, value):
                continue
            meta = f.metadata
            if not _is_finite_number(value):
                self._refuse(f.name, allowed_range(meta), "is not a finite number")
            if f.type in ("int", int):
                if int(value) != value:
                    self._refuse(
                        f.name, f"a whole number {allowed_range(meta)}", "is not a whole number"
                    )
                # What counts things stays a whole number, whoever computed it.
                object.__setattr__(self, f.name, int(value))
            if value <= meta["above"] or value < meta["low"] or value > meta["high"]:
                self._refuse(f.name, allowed_range(meta), "is out of range")

    def _refuse(self, name: str, limit: str, what: str) -> None:
        """Refuse one of the numbers by its path."""
        refuse(self.section, name, getattr(self, name), limit, what)


def refuse(section: str, name: str, value: object, limit: str, what: str) -> None:
    """Raise the one `ParameterError` wording for a refused value."""
    raise ParameterError(
        what,
        where=path_of(section, name),
        value=value,
        limit=limit,
        remedy="Correct the value in the parameter file.",
    )


@dataclass(frozen=True)
class Teeth(Section):
    """Tooth numbers and the kinematic ratio N = Z_f/(Z_c - Z_f) of the unit with the circular spline fixed."""

    section = "teeth"
    flexspline: int = quantity("1", "teeth of the flexspline", symbol="Z_f", low=20)
    circular_spline: int = quantity("1", "teeth of the circular spline", symbol="Z_c", low=22)

    def __post_init__(self) -> None:
        Section.__post_init__(self)
        if self.circular_spline - self.flexspline <= 0:
            self._refuse("circular_spline", f"> {self.flexspline}", "is too small")


@dataclass(frozen=True)
class Geometry(Section):
    """The engaged zone and the wedge (equations 1, 3-5)."""

    section = "geometry"
    flexspline_diameter: float = quantity(
        "m", "reference diameter of the flexspline", symbol="d_f", above=0.0, high=1.0
    )
    circular_spline_diameter: float = quantity(
        "m", "reference diameter of the circular spline", symbol="d_c", above=0.0, high=1.0
    )
    radial_deformation: float = quantity(
        "m",
        "largest radial deformation of the flexspline; must exceed the module",
        symbol="omega",
        above=0.0,
    )
    tooth_angle: float = quantity(
        "rad",
        "flank angle of the tooth from the radial direction",
        symbol="alpha_t",
        low=math.radians(5),
        high=math.radians(60),
    )
    neutral_radius: float = quantity(
        "m", "radius of the neutral layer of the flexspline", symbol="r_g", above=0.0, high=0.5
    )

    @property
    def module(self) -> float:
        """m = (d_c - d_f)/2 for a tooth difference of two [m]."""
        return 0.5 * (self.circular_spline_diameter - self.flexspline_diameter)

    def __post_init__(self) -> None:
        Section.__post_init__(self)
        if self.circular_spline_diameter <= self.flexspline_diameter:
            limit = f"> {self.flexspline_diameter:g} m"
            self._refuse("circular_spline_diameter", limit, "is too small")
        if self.radial_deformation <= self.module:
            raise ParameterError(
                "equation 4 has no real solution unless the radial deformation exceeds the module (d_c - d_f)/2",
                where="geometry.radial_deformation",
                value=f"{self.radial_deformation:g} m",
                limit=f"> {self.module:.6g} m",
                remedy="Typical full deflection for this model is 1.02 to 1.7 modules.",
            )
        if self.radial_deformation >= 0.5 * self.flexspline_diameter:
            limit = f"< {0.5 * self.flexspline_diameter:g} m"
            self._refuse("radial_deformation", limit, "is out of range")
        low, high = 0.4 * self.flexspline_diameter, 0.6 * self.flexspline_diameter
        if not low <= self.neutral_radius <= high:
            limit = f">= {low:g} and <= {high:g} m (0.4 to 0.6 flexspline diameters)"
            self._refuse("neutral_radius", limit, "does not fit the flexspline diameter")


@dataclass(frozen=True)
class Material(Section):
    """The steel of flexspline, circular spline and bearing."""

    section = "material"
    youngs_modulus: float = quantity("Pa", "Young's modulus", symbol="E", above=0.0, high=1e12)
    poisson_ratio: float = quantity("1", "Poisson's ratio", symbol="nu", low=0.0, high=0.49)
    density: float = quantity("kg/m3", "density", symbol="rho", above=0.0, high=3e4)

    @property
    def shear_modulus(self) -> float:
        """G = E/(2 (1 + nu)) [Pa]."""
        return self.youngs_modulus / (2.0 * (1.0 + self.poisson_ratio))


@dataclass(frozen=True)
class Tooth(Section):
    """The trapezoidal tooth (equations 6-12)."""

    section = "tooth"
    width: float = quantity("m", "tooth width", symbol="B", above=0.0, high=0.2)
    height: float = quantity("m", "tooth height", symbol="H_t", above=0.0, high=0.02)
    root_width: float = quantity(
        "m", "width of the tooth at its root", symbol="L_b", above=0.0, high=0.02
    )
    force_depth: float = quantity(
        "m", "distance from the tip to the force point", symbol="L_m", low=0.0, high=0.02
    )
    slices: int = quantity("1", "number of slices along the tooth", symbol="n", low=1, high=100000)
    pair_load: float = quantity(
        "N", "normal force on one tooth pair at which it is evaluated", symbol="F_j", above=0.0
    )

    def __post_init__(self) -> None:
        Section.__post_init__(self)
        if self.force_depth >= self.height:
            self._refuse("force_depth", f"< tooth.height = {self.height:g} m", "is too large")


@dataclass(frozen=True)
class Cup(Section):
    """The flexspline cup: a thin cylinder and its bottom disc (equation 13)."""

    section = "cup"
    length: float = quantity("m", "length of the cylinder", symbol="l", above=0.0, high=1.0)
    inner_diameter: float = quantity(
        "m", "inner diameter of the cylinder", symbol="d_RB", above=0.0, high=1.0
    )
    outer_diameter: float = quantity(
        "m", "outer diameter of the cylinder", symbol="d_WR", above=0.0, high=1.0
    )
    bottom_thickness: float = quantity(
        "m", "thickness of the bottom disc", symbol="l_b", above=0.0, high=0.05
    )
    bottom_hole_diameter: float = quantity(
        "m",
        "diameter of the location hole (or of the clamping boss) in the bottom",
        symbol="d_BD",
        above=0.0,
        high=1.0,
    )

    def __post_init__(self) -> None:
        Section.__post_init__(self)
        if self.outer_diameter <= self.inner_diameter:
            limit = f"> cup.inner_diameter = {self.inner_diameter:g} m"
            self._refuse("outer_diameter", limit, "is too small")
        if self.bottom_hole_diameter >= self.inner_diameter:
            limit = f"< cup.inner_diameter = {self.inner_diameter:g} m"
            self._refuse("bottom_hole_diameter", limit, "is too large")


@dataclass(frozen=True, kw_only=True)
class Bearing(Section):
    """The thin-walled ball bearing of the wave generator (equations 14, 15, 18)."""

    section = "bearing"
    balls: int = quantity("1", "number of balls", symbol="Z", low=3, high=500)
    ball_diameter: float = quantity("m", "ball diameter", symbol="D_w", above=0.0, high=0.1)
    pitch_diameter: float = quantity("m", "pitch diameter", symbol="d_m", above=0.0, high=1.0)
    groove_ratio: float = quantity(
        "1", "groove radius over ball diameter", symbol="f", low=0.501, high=0.7
    )
    ring_factor: float = quantity(
        "1", "softening by the thin flexible rings", symbol="ring_factor", above=0.0, high=2.0
    )
    radial_load: float = quantity(
        "N", "radial load at which the stiffness is evaluated", symbol="F_r", above=0.0, high=1e6
    )
    damping: float = quantity("N s/m", "radial damping", symbol="C_b", low=0.0, high=1e7)
    friction_factor: float = quantity(
        "1", "bearing and lubrication factor", symbol="f_0", low=0.0, high=20.0
    )
    viscosity: float = quantity(
        "m2/s", "kinematic viscosity of the lubricant", symbol="nu_0", low=0.0, high=1e-2
    )

    def __post_init__(self) -> None:
        Section.__post_init__(self)
        if self.ball_diameter >= self.pitch_diameter:
            limit = f"< bearing.pitch_diameter = {self.pitch_diameter:g} m"
            self._refuse("ball_diameter", limit, "is too large")


@dataclass(frozen=True)
class Inertia(Section):
    """The moving masses."""

    section = "inertia"
    flexspline: float = quantity(
        "kg m2", "inertia of the flexspline", symbol="J_g", above=0.0, high=1.0
    )
    output: float = quantity(
        "kg m2",
        "equivalent inertia of the output axis with its load",
        symbol="J_o",
        above=0.0,
        high=1e3,
    )
    wave_generator: float = quantity(
        "kg m2", "inertia of the wave generator", symbol="J_wg", low=0.0, high=1.0
    )


@dataclass(frozen=True)
class Damping(Section):
    """Structural damping of the flexspline cylinder, parallel to K_t; 0 is the published model."""

    section = "damping"
    structural: float = quantity(
        "N m s/rad", "structural damping parallel to K_t", symbol="C_t", low=0.0, high=1e4
    )


@dataclass(frozen=True)
class MeshFriction(Section):
    """The Stribeck curve of the tooth mesh (equation 19), in the torque balance that `ModelOptions` names.

    F_s may be smaller than F_c: then friction rises from rest, and there is no Stribeck dip.
    """

    section = "mesh_friction"
    coulomb: float = quantity("N", "Coulomb friction", symbol="F_c", low=0.0, high=1e5)
    static: float = quantity("N", "static friction", symbol="F_s", low=0.0, high=1e5)
    stribeck_velocity: float = quantity(
        "rad/s", "Stribeck velocity at the input", symbol="v_s", above=0.0, high=1e3
    )
    shape: float = quantity(
        "1", "shape coefficient of the Stribeck curve", symbol="sigma", low=0.1, high=10.0
    )
    viscous: float = quantity(
        "N s/rad", "viscous coefficient at the input", symbol="c_v", low=0.0, high=1e3
    )


@dataclass(frozen=True, kw_only=True)
class Ratings(Section):
    """What the catalogue promises of the unit and what must never be exceeded on the rig."""

    section = "ratings"
    rated_torque: float = quantity("N m", "rated torque at the output", symbol="T_r", above=0.0)
    repeated_peak_torque: float = quantity(
        "N m", "limit for repeated peak torque at the output", above=0.0
    )
    momentary_peak_torque: float = quantity(
        "N m", "limit for momentary peak torque at the output", above=0.0
    )
    maximum_input_speed: float = quantity(
        "rad/s", "maximum input speed with this lubricant", above=0.0
    )
    average_input_speed: float = quantity("rad/s", "limit for average input speed", above=0.0)
    transmission_accuracy: float = quantity(
        "rad", "transmission accuracy by the catalogue definition", above=0.0
    )
    starting_torque: float = quantity("N m", "no-load starting torque at the input", above=0.0)
    running_torque: float = quantity(
        "N m", "no-load running torque at the input at its reference condition", above=0.0
    )
    hysteresis_loss: float = quantity("rad", "hysteresis loss", above=0.0)
    torque_1: float = quantity(
        "N m", "first breakpoint of the stiffness curve", symbol="T1", above=0.0
    )
    torque_2: float = quantity(
        "N m", "second breakpoint of the stiffness curve", symbol="T2", above=0.0
    )
    stiffness_1: float = quantity("N m/rad", "catalogue stiffness below T1", symbol="K1", above=0.0)
    stiffness_2: float = quantity(
        "N m/rad", "catalogue stiffness between T1 and T2", symbol="K2", above=0.0
    )
    stiffness_3: float = quantity("N m/rad", "catalogue stiffness above T2", symbol="K3", above=0.0)
    average_torque_limit: float | None = quantity(
        "N m",
        "limit for the cubic mean of the load torque at the output",
        above=0.0,
        may_be_unknown=True,
    )
    ratcheting_torque: float | None = quantity(
        "N m",
        "torque at the output at which teeth jump; never reach it",
        above=0.0,
        may_be_unknown=True,
    )
    buckling_torque: float | None = quantity(
        "N m",
        "torque at the output at which the flexspline buckles; never reach it",
        above=0.0,
        may_be_unknown=True,
    )

    def __post_init__(self) -> None:
        Section.__post_init__(self)
        ascending = (
            ("rated_torque", "repeated_peak_torque", "momentary_peak_torque"),
            ("torque_1", "torque_2"),
        )
        for smaller, larger in (pair for chain in ascending for pair in itertools.pairwise(chain)):
            if getattr(self, larger) <= getattr(self, smaller):
                limit = f"> ratings.{smaller} = {getattr(self, smaller):g} N m"
                self._refuse(larger, limit, "is too small")
