"""The harmonic drive as a frozen parameter set: every number of the model, in SI, with its unit and its allowed range.

`HarmonicDrive` holds plain floats in named sections, so that physics reads
`gear.bearing.ball_diameter`. Where a number comes from stands beside it in
`gear.origins["bearing.ball_diameter"]` (an `Origin`), and `gear.value(path)` returns both together
as a `Value`. The numbers themselves live only in parameter files (`model.gear_file`,
`model/gears/*.toml`).

Symbols are those of Zou et al. 2015. Coordinates: input angle theta_i (wave generator), output angle theta_o counted
positive opposite to theta_i when the circular spline is fixed.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal, cast

from model.errors import ParameterError

Provenance = Literal[
    "catalogue", "published", "computed", "identified", "measured", "assumed", "recalled"
]
Mounting = Literal["circular-spline-fixed", "flexspline-fixed"]


@dataclass(frozen=True, slots=True)
class Origin:
    """Where a number comes from: its kind of source, the source in words, and its standard uncertainty (same unit)."""

    provenance: Provenance
    source: str = ""
    standard_uncertainty: float | None = None


@dataclass(frozen=True, slots=True)
class Value:
    """One number of a parameter set with its unit and origin, as files and reports show it."""

    path: str
    symbol: str
    value: float
    unit: str
    description: str
    origin: Origin


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
    return field(default=None, metadata=meta) if may_be_unknown else field(metadata=meta)


def is_unknown(f: dataclasses.Field[Any], value: object) -> bool:
    """Whether this declared quantity is one that nobody stated, and need not."""
    return value is None and f.default is None


def allowed_range(meta: Mapping[str, Any]) -> str:
    """The allowed range of a declared quantity in words, for messages and tables."""
    unit = f" {meta['unit']}" if meta["unit"] not in ("", "1") else ""
    lower = meta["above"] if meta["above"] > -math.inf else meta["low"]
    sign = ">" if meta["above"] > -math.inf else ">="
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


class Section:
    """Base of every section: checks each declared quantity on construction and names the path on refusal."""

    section: str = ""

    def __post_init__(self) -> None:
        for f in dataclasses.fields(self):  # type: ignore[arg-type]
            if "unit" not in f.metadata:
                continue
            value = getattr(self, f.name)
            if is_unknown(f, value):
                continue
            meta = f.metadata
            if not _is_finite_number(value):
                refuse(self.section, f.name, value, allowed_range(meta), "is not a finite number")
            if f.type in ("int", int) and int(value) != value:
                refuse(
                    self.section,
                    f.name,
                    value,
                    f"a whole number {allowed_range(meta)}",
                    "is not a whole number",
                )
            if value <= meta["above"] or value < meta["low"] or value > meta["high"]:
                refuse(self.section, f.name, value, allowed_range(meta), "is out of range")


def refuse(section: str, name: str, value: object, limit: str, what: str) -> None:
    """Raise the one `ParameterError` wording for a refused value."""
    where = f"{section}.{name}" if section else name
    raise ParameterError(
        what,
        where=where,
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
            refuse(
                self.section,
                "circular_spline",
                self.circular_spline,
                f"> {self.flexspline}",
                "is too small",
            )


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
            refuse(
                self.section,
                "circular_spline_diameter",
                self.circular_spline_diameter,
                limit,
                "is too small",
            )
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
            refuse(
                self.section,
                "radial_deformation",
                self.radial_deformation,
                limit,
                "is out of range",
            )
        low, high = 0.4 * self.flexspline_diameter, 0.6 * self.flexspline_diameter
        if not low <= self.neutral_radius <= high:
            limit = f">= {low:g} and <= {high:g} m (0.4 to 0.6 flexspline diameters)"
            refuse(
                self.section,
                "neutral_radius",
                self.neutral_radius,
                limit,
                "does not fit the flexspline diameter",
            )


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
            refuse(
                self.section,
                "force_depth",
                self.force_depth,
                f"< tooth.height = {self.height:g} m",
                "is too large",
            )


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
            refuse(self.section, "outer_diameter", self.outer_diameter, limit, "is too small")
        if self.bottom_hole_diameter >= self.inner_diameter:
            limit = f"< cup.inner_diameter = {self.inner_diameter:g} m"
            refuse(
                self.section,
                "bottom_hole_diameter",
                self.bottom_hole_diameter,
                limit,
                "is too large",
            )


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
            refuse(self.section, "ball_diameter", self.ball_diameter, limit, "is too large")


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


@dataclass(frozen=True, slots=True)
class Harmonic:
    """One order of a Fourier series over an angle: a cos(n theta) + b sin(n theta), amplitudes in rad."""

    order: float
    cosine: float
    sine: float

    def __post_init__(self) -> None:
        for name in ("order", "cosine", "sine"):
            if not math.isfinite(getattr(self, name)):
                refuse(
                    "kinematic_error",
                    name,
                    getattr(self, name),
                    "a finite number",
                    "is not a finite number",
                )
        if self.order <= 0:
            refuse(
                "kinematic_error",
                "order",
                self.order,
                "> 0 cycles per input revolution",
                "is out of range",
            )

    @property
    def amplitude(self) -> float:
        """sqrt(a^2 + b^2) [rad]."""
        return math.hypot(self.cosine, self.sine)


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
                refuse(self.section, larger, getattr(self, larger), limit, "is too small")


@dataclass(frozen=True)
class ModelOptions:
    """The choices where the paper is silent or contradicts itself; every stored result names them.

    torque_balance      "energy" (virtual work, default) or "published" (equation 20 verbatim)
    low_speed_branch    the nu n < 2000 branch of the bearing friction (equation 18)
    bending             "published" (equation 6) or "energy" (reciprocal)
    contact             "palmgren" (Cornell/Palmgren), "lundberg" or "yang-sun" (equation 11)
    root_flexibility    add the foundation compliance of the tooth root
    engaged_zone        "leading-both-lobes" (equation 5), "leading-one-lobe", "both-halves"
    """

    torque_balance: Literal["energy", "published"] = "energy"
    low_speed_branch: bool = True
    bending: Literal["published", "energy"] = "published"
    contact: Literal["palmgren", "lundberg", "yang-sun"] = "palmgren"
    root_flexibility: bool = False
    engaged_zone: Literal["leading-both-lobes", "leading-one-lobe", "both-halves"] = (
        "leading-both-lobes"
    )


@dataclass(frozen=True, kw_only=True)
class HarmonicDrive:
    """One harmonic drive: all parameters of the model in SI, validated, with the origin of each number.

    `name` is the part ("CSF-25-120-2UH"). `kinematic_error` is the series of equation 16 over the
    input angle; orders need not be whole (sidebands n(1 + 1/N), output orders k/N). `origins` maps
    "section.field" to an `Origin`.
    """

    name: str
    teeth: Teeth
    geometry: Geometry
    material: Material
    tooth: Tooth
    cup: Cup
    bearing: Bearing
    inertia: Inertia
    damping: Damping
    mesh_friction: MeshFriction
    ratings: Ratings
    kinematic_error: tuple[Harmonic, ...] = ()
    options: ModelOptions = ModelOptions()
    origins: Mapping[str, Origin] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        reach = self.tooth.height - self.tooth.force_depth
        half = 0.5 * self.tooth.root_width - reach * math.tan(self.geometry.tooth_angle)
        if half <= 0.0:
            raise ParameterError(
                "the tooth has no thickness left at the force point: L_b/2 - (H_t - L_m) tan(alpha_t) is not positive",
                where="tooth.root_width",
                value=f"{self.tooth.root_width:g} m",
                limit=f"> {2.0 * reach * math.tan(self.geometry.tooth_angle):.6g} m",
                remedy="Check tooth height, force depth and tooth angle.",
            )

    def __repr__(self) -> str:
        """One line: what it is, and where its numbers come from; `values()` has them all."""
        provenances = Counter(value.origin.provenance for value in self.values())
        told = ", ".join(f"{count} {word}" for word, count in provenances.most_common())
        return f"HarmonicDrive({self.name}, N = {self.ratio:g}; values: {told})"

    @property
    def ratio(self) -> float:
        """N = Z_f/(Z_c - Z_f), circular spline fixed."""
        return self.teeth.flexspline / (self.teeth.circular_spline - self.teeth.flexspline)

    def mounted_ratio(self, mounting: Mounting) -> float:
        """Input revolutions per output revolution: N (circular spline fixed) or N + 1 (flexspline fixed)."""
        return self.ratio if mounting == "circular-spline-fixed" else self.ratio + 1.0

    def values(self) -> Iterator[Value]:
        """Every number of the set with unit, symbol and origin, in the order of the sections."""
        for f in dataclasses.fields(self):
            part = getattr(self, f.name)
            if isinstance(part, Section):
                for q in dataclasses.fields(part):  # type: ignore[arg-type]
                    path = f"{f.name}.{q.name}"
                    meta = q.metadata
                    if is_unknown(q, getattr(part, q.name)):
                        continue
                    origin = self.origins.get(path, Origin("assumed"))
                    yield Value(
                        path,
                        meta["symbol"],
                        getattr(part, q.name),
                        meta["unit"],
                        meta["description"],
                        origin,
                    )

    def value(self, path: str) -> Value:
        """The number at "section.field" with its unit and origin."""
        for entry in self.values():
            if entry.path == path:
                return entry
        raise ParameterError(
            "no such parameter", where=path, remedy="See `rig model` for the names."
        )

    def with_values(
        self, changes: Mapping[str, float], origin: Origin | None = None
    ) -> HarmonicDrive:
        """A copy with some numbers replaced by path; their origins become `origin` where one is given."""
        changed: dict[str, dict[str, float]] = {}
        for path, number in changes.items():
            section, _, name = path.partition(".")
            part = getattr(self, section, None)
            if not isinstance(part, Section) or name not in {
                q.name for q in dataclasses.fields(cast("Any", part))
            }:
                raise ParameterError(
                    "no such parameter", where=path, remedy="See `rig model` for the names."
                )
            changed.setdefault(section, {})[name] = number
        origins = dict(self.origins)
        if origin is not None:
            origins.update(dict.fromkeys(changes, origin))
        built: dict[str, Any] = {
            s: dataclasses.replace(getattr(self, s), **names) for s, names in changed.items()
        }
        return dataclasses.replace(self, **built, origins=MappingProxyType(origins))
