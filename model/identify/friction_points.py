"""The points of a table of friction over speed, and the laws that they can carry.

    coulomb            F = F_c sgn v + F_0
    coulomb-viscous    F = (F_c + c_v |v|) sgn v + F_0
    stribeck           F = {F_c + (F_s - F_c) exp[-(|v|/v_s)^sigma] + c_v |v|} sgn v + F_0

F_0 belongs to tables with both directions only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from model.arrays import BoolArray
from model.errors import IdentificationError
from model.identify.checks import Array, channels

Law = Literal["auto", "coulomb", "coulomb-viscous", "stribeck"]
LAWS: tuple[Law, ...] = ("auto", "coulomb", "coulomb-viscous", "stribeck")
PARAMETERS = {
    "coulomb": ("coulomb",),
    "coulomb-viscous": ("coulomb", "viscous"),
    "stribeck": ("coulomb", "static", "stribeck_velocity", "shape", "viscous"),
}
_LEAST_POINTS = 4
STRIBECK_POINTS, STRIBECK_SPEEDS = 8, 6
"""Points and different speeds that five parameters need."""
MOST_POINTS = 500
"""More are averaged in groups of neighbouring speeds."""


@dataclass(frozen=True)
class CurvePoints:
    """Points of a table: |v| > 0, friction along the motion, its standard error, the direction (+1, -1), all (n,)."""

    speed: Array
    friction: Array
    error: Array
    way: Array

    def __getitem__(self, rows: BoolArray) -> CurvePoints:
        return CurvePoints(self.speed[rows], self.friction[rows], self.error[rows], self.way[rows])

    def __len__(self) -> int:
        return len(self.speed)

    @property
    def both_ways(self) -> bool:
        """Whether an offset can be told."""
        return bool(self.way.min() < 0.0 < self.way.max())

    @property
    def speeds(self) -> int:
        """How many different speeds there are."""
        relative = np.round(self.speed / float(self.speed.max()), 9)
        return len(set(relative.tolist()))


def curve_points(
    speed: ArrayLike, effort: ArrayLike, error: ArrayLike | None = None, least_speed: float = 0.0
) -> tuple[CurvePoints, int]:
    """The points of a table with signed speeds and efforts (n,), those at rest taken out and counted.

    Without `error` all points have the same unknown one. Raises `IdentificationError` for efforts
    that drive where friction brakes.
    """
    v, f = channels(_LEAST_POINTS, speed=speed, effort=effort)
    u = np.ones_like(f)
    if error is not None:
        v, f, u = channels(_LEAST_POINTS, speed=v, effort=f, uncertainty=error)
        if u.min() <= 0.0:
            raise IdentificationError(
                "must be above zero", where="uncertainty", value=float(u.min()), limit="> 0"
            )
    moves = (v != 0.0) & (np.abs(v) >= least_speed)
    if moves.sum() < _LEAST_POINTS:
        raise IdentificationError(
            "has too few points with motion",
            where="speed",
            value=int(moves.sum()),
            limit=f">= {_LEAST_POINTS}",
            remedy="Measure more points, or lower least_speed.",
        )
    v, f, u = v[moves], f[moves], u[moves]
    way = np.sign(v)
    for sign, word in ((1.0, "forward"), (-1.0, "reverse")):
        along = sign * f[way == sign]
        if len(along) and np.median(along) < 0.0:
            raise IdentificationError(
                f"drives where friction brakes: the {word} points lie on the other side of zero",
                where="effort",
                value=float(np.median(along)),
                limit=">= 0 along the motion",
                remedy="Give effort the sign of its speed (magnitudes with magnitudes of the speed), or correct its "
                "sign at the import.",
            )
    points = CurvePoints(np.abs(v), way * f, u, way)
    return _grouped(points), int((~moves).sum())


def _grouped(points: CurvePoints) -> CurvePoints:
    """At most `MOST_POINTS` points: means over neighbouring speeds of one direction where there are more."""
    size = -(-len(points) // MOST_POINTS)
    if size == 1:
        return points
    order = np.lexsort((points.speed, points.way))
    groups = [
        part
        for way in (-1.0, 1.0)
        if len(one := order[points.way[order] == way])
        for part in np.array_split(one, -(-len(one) // size))
    ]
    means = [[float(c[g].mean()) for g in groups] for c in (points.speed, points.friction)]
    error = [math.sqrt(float((points.error[g] ** 2).sum())) / len(g) for g in groups]
    way = [float(points.way[g[0]]) for g in groups]
    return CurvePoints(*(np.array(c) for c in (*means, error, way)))


def carries(points: CurvePoints, law: str) -> bool:
    """Whether there are points and speeds enough for a law."""
    if law == "stribeck":
        return len(points) >= STRIBECK_POINTS and points.speeds >= STRIBECK_SPEEDS
    return law == "coulomb" or points.speeds >= 2


def possible_laws(points: CurvePoints, law: Law) -> tuple[str, ...]:
    """The laws to fit, the poorest first."""
    if law != "auto":
        if not carries(points, law):
            raise IdentificationError(
                f"has too few points for the law {law}",
                where="friction-curve",
                value=f"{len(points)} points at {points.speeds} speeds",
                limit=f">= {STRIBECK_POINTS} points at {STRIBECK_SPEEDS} speeds",
                remedy="Measure at more speeds, or take a poorer law.",
            )
        return (law,)
    return tuple(name for name in PARAMETERS if carries(points, name))


def law_design(points: CurvePoints, law: str, velocity: float, shape: float) -> Array:
    """The linear columns (n, p) of a law, for given v_s and sigma."""
    columns = [np.ones(len(points))]
    if law != "coulomb":
        columns.append(points.speed)
    if law == "stribeck":
        columns.append(np.exp(-((points.speed / velocity) ** shape)))
    if points.both_ways:
        columns.append(points.way)
    return np.stack(columns, axis=1)
