"""The harmonic drive as a frozen parameter set: every number of the model, in SI, with its unit and its allowed range.

`HarmonicDrive` holds plain floats in named sections (`model.sections`), so that physics reads
`gear.bearing.ball_diameter`. Where a number comes from stands beside it in
`gear.origins["bearing.ball_diameter"]` (an `Origin`), and `gear.value(path)` returns both together
as a `Value`. The numbers themselves live only in parameter files (`model.gear_file`,
`model/gears/*.toml`).

Symbols are those of Zou et al. 2015. Coordinates: input angle theta_i (wave generator), output angle theta_o counted
positive opposite to theta_i when the circular spline is fixed.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal

from model.errors import ParameterError
from model.sections import (
    Bearing,
    Cup,
    Damping,
    Geometry,
    Inertia,
    Material,
    MeshFriction,
    Ratings,
    Section,
    Teeth,
    Tooth,
    is_unknown,
    refuse,
)

Provenance = Literal[
    "catalogue", "published", "computed", "identified", "measured", "assumed", "recalled"
]
Mounting = Literal["circular-spline-fixed", "flexspline-fixed"]


def as_mounted(ratio: float, mounting: Mounting) -> float:
    """Input revolutions per output revolution of a ratio N: N (circular spline fixed) or N + 1 (flexspline fixed)."""
    return ratio if mounting == "circular-spline-fixed" else ratio + 1.0


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
        return as_mounted(self.ratio, mounting)

    def values(self) -> Iterator[Value]:
        """Every number of the set with unit, symbol and origin, in the order of the sections."""
        for f in dataclasses.fields(self):
            part = getattr(self, f.name)
            if isinstance(part, Section):
                for q in dataclasses.fields(part):
                    path = f"{f.name}.{q.name}"
                    meta = q.metadata
                    number = getattr(part, q.name)
                    if is_unknown(q, number):
                        continue
                    origin = self.origins.get(path, Origin("assumed"))
                    yield Value(
                        path,
                        meta["symbol"],
                        number,
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
                q.name for q in dataclasses.fields(part)
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
