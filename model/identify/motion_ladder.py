"""The rungs of the friction of a motion: symmetric, asymmetric, Stribeck; each fitted, and one chosen by the data.

    symmetric     F = M a + F_v v + F_c sgn v + F_0
    asymmetric    F = M a + F_v+ v + F_c+  (v > 0),   F = M a + F_v- v - F_c-  (v < 0)
    stribeck      F = M a + F_v v + {F_c + (F_s - F_c) exp[-(v/v_s)^2]} sgn v + F_0

The Stribeck rung is taken by itself only where it predicts tenths of the time that it has not seen
better than the symmetric one: by twice the standard error of that gain over the tenths, by a tenth
at least, with a friction that falls with speed (F_s > F_c), a positive Coulomb and viscous part,
and a v_s inside the range that was searched. Forward and reverse are told apart where somebody asks
for it: that changes the names of the parameters. A motion in one direction has no F_0: it is in F_c, and stays there.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from model.errors import IdentificationError
from model.identify.checks import Array
from model.identify.motion_columns import LEAST_SAMPLES, Basis, MotionFilter, samples
from model.identify.motion_moments import FOLDS, MomentFit, Moments, gather, solve_moments
from model.identify.motion_source import MotionSource

STRIBECK_SPEEDS = 8
STRIBECK_RANGE = (0.02, 0.25)
"""Of the top speed: where v_s is searched, and never under twice the dead zone."""
LEAST_GAIN = 0.1
"""By which a richer rung's error out of sample must be smaller."""
_NEWTON_STEPS = 2
BASE = ("acceleration", "speed", "sign", "one")
_ADDED: Mapping[str, tuple[str, ...]] = {
    "symmetric": (),
    "asymmetric": ("speed_size",),
    "stribeck": ("stribeck_0", "stribeck_0_slope"),
}


@dataclass(frozen=True)
class Rung:
    """One model of the ladder on these data: errors in and out of sample, BIC, and its parameters by name."""

    name: str
    relative_error: float
    hold_out_error: float
    bic: float
    values: Mapping[str, float]


@dataclass(frozen=True)
class Fitted:
    """A rung that was fitted: its linear fit, and what it was fitted to."""

    rung: str
    fit: MomentFit
    moments: Moments
    recipe: MotionFilter
    basis: Basis

    @functools.cached_property
    def transform(self) -> tuple[tuple[str, ...], Array]:
        """Names of the parameters (q,), and the matrix (q, p) that makes them of the coefficients."""
        rows: dict[str, dict[str, float]] = {"inertia": {"acceleration": 1.0}}
        if self.rung == "asymmetric":
            for way, sign in (("forward", 1.0), ("reverse", -1.0)):
                rows[f"viscous_{way}"] = {"speed": 1.0, "speed_size": sign}
                rows[f"coulomb_{way}"] = {"sign": 1.0, "one": sign}
        else:
            rows |= {"viscous": {"speed": 1.0}, "coulomb": {"sign": 1.0}}
            if self.rung == "stribeck":
                drop = self.fit.value("stribeck_0")
                rows["static"] = {"sign": 1.0, "stribeck_0": 1.0}
                rows["stribeck_velocity"] = {"stribeck_0_slope": 1.0 / drop if drop else math.nan}
            if "one" in self.fit.names:
                rows["offset"] = {"one": 1.0}
        rows |= {name: {name: 1.0} for name in self.basis.load_names}
        matrix = np.array(
            [[row.get(name, 0.0) for name in self.fit.names] for row in rows.values()]
        )
        return tuple(rows), matrix

    @property
    def values(self) -> Array:
        """The parameters in the order of `transform`."""
        names, matrix = self.transform
        values = matrix @ self.fit.values
        if "stribeck_velocity" in names:
            values[names.index("stribeck_velocity")] += self.basis.stribeck[0]
        return values

    @property
    def covariance(self) -> Array:
        _, matrix = self.transform
        return np.asarray(matrix @ self.fit.covariance @ matrix.T, dtype=np.float64)

    def named(self) -> dict[str, float]:
        """The parameters by name."""
        return dict(zip(self.transform[0], self.values.tolist(), strict=True))

    def as_rung(self) -> Rung:
        fit = self.fit
        return Rung(self.rung, fit.relative_error, fit.hold_out_error, fit.bic(), self.named())


def gathered(source: MotionSource, recipe: MotionFilter, basis: Basis) -> Moments:
    """The moments of all samples of a motion."""
    first = source.stretches[0]
    with_instrument = source.read(first.start, first.start + 1).instrument is not None
    expected = sum(stretch.rows for stretch in source.stretches) // recipe.decimation
    return gather(samples(source, recipe, basis), basis.names(with_instrument), expected)


def base_of(moments: Moments) -> tuple[str, ...]:
    """What every rung is made of; in one direction the offset is one with the Coulomb friction, and stays there."""
    sign = moments.shown[:, moments.names.index("sign")]
    is_one_way = bool(sign.min() >= 0.0 or sign.max() <= 0.0)
    return tuple(name for name in BASE if name != "one" or not is_one_way)


def _check_motion(moments: Moments, rung: str) -> None:
    """Refuse too little motion, and to tell directions apart of which there is one."""
    if moments.kept < LEAST_SAMPLES:
        raise IdentificationError(
            "too little motion is left after filter, dead zone and decimation",
            where="motion",
            value=f"{moments.kept} samples",
            limit=f">= {LEAST_SAMPLES}",
            remedy="Record more motion, or lower least_speed or decimation.",
        )
    if rung == "asymmetric" and "one" not in base_of(moments):
        raise IdentificationError(
            "moves in one direction only: two directions cannot be told apart",
            where="position",
            limit="motion both ways",
            remedy="Use a recording that reverses.",
        )


@dataclass(frozen=True)
class Ladder:
    """The rungs over the moments of one motion, `speeds` the v_s for which it has columns."""

    source: MotionSource
    recipe: MotionFilter
    basis: Basis
    with_instrument: bool
    speeds: tuple[float, ...]

    @functools.cached_property
    def moments(self) -> Moments:
        return gathered(self.source, self.recipe, replace(self.basis, stribeck=self.speeds))

    @functools.cached_property
    def symmetric(self) -> Fitted:
        return self._fitted("symmetric", self.moments, self.basis)

    @functools.cached_property
    def asymmetric(self) -> Fitted | None:
        """None where the data cannot carry it."""
        try:
            return self._fitted("asymmetric", self.moments, self.basis)
        except IdentificationError:
            return None

    @functools.cached_property
    def stribeck(self) -> Fitted | None:
        """With the v_s that fits best; None where no speed of the range can carry it."""
        errors: dict[float, float] = {}
        for k, speed in enumerate(self.speeds):
            names = (*base_of(self.moments), f"stribeck_{k}", *self.basis.load_names)
            try:
                fit = self._solve(self.moments, names)
            except IdentificationError:
                continue
            errors[speed] = fit.residual_norm
        if not errors:
            return None
        critical = min(errors, key=lambda speed: errors[speed])
        try:
            for _ in range(_NEWTON_STEPS):
                found = self._at(critical)
                step = found.values[found.transform[0].index("stribeck_velocity")]
                critical = float(np.clip(step, 0.5 * critical, 2.0 * critical))
            return self._at(critical)
        except IdentificationError:
            return None

    def chosen(self, variant: str) -> Fitted:
        """The rung that was asked for, or by the data with "auto"."""
        if variant == "symmetric":
            return self.symmetric
        wanted = self.asymmetric if variant == "asymmetric" else self.stribeck
        if variant == "auto":
            return wanted if wanted is not None and self._reaches(wanted) else self.symmetric
        if wanted is None:
            raise IdentificationError(
                f"cannot carry the {variant} friction",
                where="motion.variant",
                value=repr(variant),
                remedy="Record slower and faster motion both ways, or take variant=symmetric.",
            )
        return wanted

    def refitted(self, other: Fitted) -> Fitted:
        """The rung of another fit on this ladder's filter, with the same v_s."""
        if other.rung == "stribeck":
            return self._at(other.basis.stribeck[0])
        return self._fitted(other.rung, self.moments, self.basis)

    def rungs(self) -> tuple[Rung, ...]:
        """All that the data can carry."""
        fitted = (self.symmetric, self.asymmetric, self.stribeck)
        return tuple(rung.as_rung() for rung in fitted if rung is not None)

    def next_rung(self, chosen: Fitted) -> dict[str, float]:
        """By how much each parameter is another one on the next richer rung that the data call for.

        They call for the Stribeck rung where its coefficient differs from zero, its v_s lies inside the range, and it
        predicts what it has not seen better; else there is no such difference.
        """
        richer = self.stribeck
        if chosen.rung != "symmetric" or richer is None:
            return {}
        called_for = richer.fit.is_significant("stribeck_0") and self._inside(richer)
        if not called_for or not richer.fit.hold_out_error < chosen.fit.hold_out_error:
            return {}
        values = richer.named()
        return {name: abs(values[name] - value) for name, value in chosen.named().items()}

    def _inside(self, wanted: Fitted) -> bool:
        """Whether the interval of v_s lies inside the range that was searched."""
        place = wanted.transform[0].index("stribeck_velocity")
        critical = float(wanted.values[place])
        doubt = 2.0 * math.sqrt(max(float(wanted.covariance[place, place]), 0.0))
        return min(self.speeds) < critical - doubt and critical + doubt < 2.0 * max(self.speeds)

    def _reaches(self, wanted: Fitted) -> bool:
        values = wanted.named()
        falls = values["static"] - values["coulomb"] > 2.0 * wanted.fit.standard_error("stribeck_0")
        gain = self.symmetric.fit.fold_errors - wanted.fit.fold_errors
        if not (self._inside(wanted) and falls and min(values["coulomb"], values["viscous"]) > 0.0):
            return False
        if not np.all(np.isfinite(gain)):
            return False
        error = float(gain.std(ddof=1)) / math.sqrt(FOLDS)
        is_clear = float(gain.mean()) > 2.0 * error
        least = (1.0 - LEAST_GAIN) * self.symmetric.fit.hold_out_error
        return is_clear and wanted.fit.hold_out_error < least

    def _at(self, critical: float) -> Fitted:
        basis = replace(self.basis, stribeck=(critical,))
        return self._fitted("stribeck", gathered(self.source, self.recipe, basis), basis)

    def _fitted(self, rung: str, moments: Moments, basis: Basis) -> Fitted:
        _check_motion(moments, rung)
        names = (*base_of(moments), *_ADDED[rung], *self.basis.load_names)
        return Fitted(rung, self._solve(moments, names), moments, self.recipe, basis)

    def _solve(self, moments: Moments, names: tuple[str, ...]) -> MomentFit:
        return solve_moments(moments, names, with_instrument=self.with_instrument)
