"""Normal equations of a motion, block by block of its time: sums of products, from which every fit is solved.

For samples w_t (regressors, instruments and effort in one row) the sums of w_t' w_t over each block
are all that a linear fit needs: its solution, its residual, its covariance from the scores of the
blocks, and its error on blocks that it has not seen. So a recording is read once and any number of
models are compared, in memory that does not grow with its length.

Noise of the position makes regressors larger than they are, and inertia too small. With an
instrument Z, which is the same motion with another noise or none,

    Z' X b = Z' y

has no such bias. Where there is no other channel the even samples of the position are the
instrument of the odd ones, and the other way round; with X their mean and D half their difference

    (X' X - D' D) b = X' y

The covariance is A^-1 S A'^-1, with S the sum of the scores over lags (Newey and West 1987), or, where that
is more, the scatter of the solutions without each of some parts of the time (jackknife): a few
moves say more than their number of samples, and the sum over lags is short by what they miss.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model.arrays import BoolArray, quotient
from model.errors import IdentificationError
from model.identify.checks import Array
from model.identify.least_squares import (
    CONDITION_LIMIT,
    bartlett_sum,
    inverse_of,
    solution_of,
    student_quantile,
)
from model.identify.motion_columns import Samples

_MOST_BLOCKS = 2000
FOLDS = 10
"""Parts of the time that are left out in turn for the error on data that a fit has not seen."""
PARTS = 32
"""Parts of the time that the jackknife leaves out in turn."""
_LEAST_PARTS = 8
SHOWN = 20_000
"""Samples that are kept for plots."""
_NOISE_OF = {"acceleration": "noise_acceleration", "speed": "noise_speed"}
_INSTRUMENT_OF = {"acceleration": "instrument_acceleration", "speed": "instrument_speed"}


@dataclass(frozen=True)
class Moments:
    """Sums of products (blocks, p, p) of the columns `names`, in the order of time; kept and left-out samples.

    `shown_time` (m,) and `shown` (m, p) are some of the samples, evenly spread, for plots.
    """

    names: tuple[str, ...]
    sums: Array
    kept: int
    left_out: int
    shown_time: Array
    shown: Array

    @property
    def standing_share(self) -> float:
        """Share of the samples at standstill."""
        return self.left_out / max(self.kept + self.left_out, 1)

    def places(self, names: Sequence[str]) -> list[int]:
        """Where columns stand."""
        return [self.names.index(name) for name in names]

    def halves(self) -> tuple[Moments, Moments]:
        """The first and the second half of the time; the counts stay those of the whole."""
        first = 2 * _folds(len(self.sums)) < FOLDS
        return replace(self, sums=self.sums[first]), replace(self, sums=self.sums[~first])


def _folds(blocks: int) -> NDArray[np.int_]:
    """Which tenth of the time each of so many blocks is in."""
    return np.arange(blocks) * FOLDS // blocks


def gather(samples: Iterable[Samples], names: tuple[str, ...], expected: int) -> Moments:
    """The moments of samples that come in order; `expected` is about how many there will be."""
    size = max(1, -(-expected // _MOST_BLOCKS))
    stride = max(1, expected // SHOWN)
    sums: list[Array] = []
    shown: list[Array] = []
    times: list[Array] = []
    kept = left_out = 0
    for part in samples:
        moving = ~part.standing
        columns = part.columns * moving[:, None]
        for start in range(0, len(columns), size):
            block = columns[start : start + size]
            sums.append(block.T @ block)
        kept += int(moving.sum())
        left_out += int(part.standing.sum())
        shown.append(part.columns[moving][::stride])
        times.append(part.time[moving][::stride])
    if not sums:
        shown, times = [np.empty((0, len(names)))], [np.empty(0)]
        sums = [np.zeros((len(names), len(names)))]
    return Moments(
        names, np.array(sums), kept, left_out, np.concatenate(times), np.concatenate(shown)
    )


@dataclass(frozen=True, kw_only=True)
class MomentFit:
    """A linear fit of the effort from moments: `names` of the regressors, values (p,), covariance (p, p).

    condition of the columns scaled to unit length, condition_raw of the columns as they are;
    freedom of the variance; residual_norm |r|, effort_norm |y|; hold_out_norm, the norm of the
    errors on the tenths of the time that were left out in turn, `fold_errors` (10,) their squares.
    """

    names: tuple[str, ...]
    values: Array
    covariance: Array
    condition: float
    condition_raw: float
    freedom: float
    samples: int
    residual_norm: float
    effort_norm: float
    fold_errors: Array

    @property
    def relative_error(self) -> float:
        return quotient(self.residual_norm, self.effort_norm)

    @property
    def hold_out_error(self) -> float:
        """Relative error on data that the fit has not seen."""
        total = math.sqrt(float(self.fold_errors.sum()))
        return quotient(total, self.effort_norm)

    @property
    def half_errors(self) -> Array:
        """The norm of the errors on unseen data (2,) in each of the two halves of `Moments.halves`."""
        return np.sqrt(self.fold_errors.reshape(2, -1).sum(axis=1))

    def value(self, name: str) -> float:
        return float(self.values[self.names.index(name)])

    def standard_error(self, name: str) -> float:
        place = self.names.index(name)
        return math.sqrt(max(float(self.covariance[place, place]), 0.0))

    def is_significant(self, name: str) -> bool:
        """Whether a parameter differs from zero at 95 %."""
        return abs(self.value(name)) > student_quantile(self.freedom) * self.standard_error(name)

    def bic(self) -> float:
        """Bayes' information criterion of independent samples; smaller is better."""
        mean = self.residual_norm**2 / self.samples
        return self.samples * math.log(max(mean, 1e-300)) + len(self.names) * math.log(self.samples)


def solve_moments(
    moments: Moments, regressors: Sequence[str], *, with_instrument: bool, where: str = "motion"
) -> MomentFit:
    """The fit of the effort by these regressors, with the instrument channel or with the two halves of the position.

    Raises `IdentificationError` where there are too few samples, a column is empty, or columns are combinations of
    others.
    """
    system = _System.of(moments, tuple(regressors), with_instrument)
    p = len(regressors)
    if moments.kept <= p + 1:
        raise IdentificationError(
            "too few samples with motion for this fit",
            where=where,
            value=moments.kept,
            limit=f"> {p + 1}",
            remedy="Record more motion, or lower least_speed.",
        )
    total = system.squares.sum(axis=0)
    condition = _condition(total, regressors, where)
    values = system.solution(np.ones(len(moments.sums), dtype=bool))
    scores = system.right - system.left @ values
    inverse = inverse_of(system.left.sum(axis=0))
    spread, effective = lagged_sum(scores[np.any(system.squares != 0.0, axis=(1, 2))])
    n = moments.kept
    covariance, freedom = _wider(
        inverse @ spread @ inverse.T * (n / (n - p)), max(effective, 2.0), system.jackknife()
    )
    return MomentFit(
        names=tuple(regressors),
        values=values,
        covariance=covariance,
        condition=condition,
        condition_raw=math.sqrt(float(np.linalg.cond(total))),
        freedom=freedom,
        samples=n,
        residual_norm=math.sqrt(system.error(values).sum()),
        effort_norm=math.sqrt(float(system.effort.sum())),
        fold_errors=system.fold_errors(),
    )


def _condition(squares: Array, regressors: Sequence[str], where: str) -> float:
    """The condition number of columns scaled to unit length, by X'X; refused where one is empty or a combination."""
    size = np.sqrt(np.diag(squares))
    if not np.all(size > 0.0):
        column = regressors[int(np.argmin(size))]
        raise IdentificationError(
            "has a regressor that is zero throughout", where=where, value=column
        )
    condition = math.sqrt(float(np.linalg.cond(squares / np.outer(size, size))))
    if not condition <= math.sqrt(CONDITION_LIMIT):
        raise IdentificationError(
            "the data cannot separate the parameters",
            where=where,
            value=f"condition number {condition:.3g}",
            limit=f"<= {math.sqrt(CONDITION_LIMIT):g}",
            remedy="Excite the motion more richly, or ask for fewer parameters.",
        )
    return condition


def _wider(lagged: Array, effective: float, parts: Array) -> tuple[Array, float]:
    """The covariance by lags (p, p), with the errors of the solutions without each part (k, p) where these are more."""
    if len(parts) < _LEAST_PARTS:
        return lagged, effective
    off = parts - parts.mean(axis=0)
    ratio = np.diag(off.T @ off * ((len(parts) - 1.0) / len(parts))) / np.diag(lagged)
    scale = np.sqrt(np.maximum(ratio, 1.0))
    return lagged * np.outer(scale, scale), min(effective, len(parts) - 1.0)


def noise_sums(moments: Moments, names: tuple[str, ...]) -> Array:
    """What the noise of the position adds to the squares of these regressors, D' D (blocks, p, p)."""
    noise = np.zeros((len(moments.sums), len(names), len(names)))
    noisy = [k for k, name in enumerate(names) if name in _NOISE_OF]
    d = moments.places([_NOISE_OF[names[k]] for k in noisy])
    noise[:, np.array(noisy)[:, None], np.array(noisy)[None, :]] = moments.sums[:, d][:, :, d]
    return noise


@dataclass(frozen=True)
class _System:
    """left b = right per block; squares X'X, cross X'y and effort y'y per block for the error."""

    left: Array
    right: Array
    squares: Array
    cross: Array
    effort: Array

    @classmethod
    def of(cls, moments: Moments, names: tuple[str, ...], with_instrument: bool) -> _System:
        sums = moments.sums
        x, y = moments.places(names), moments.names.index("effort")
        squares, cross = sums[:, x][:, :, x], sums[:, x, y]
        if with_instrument:
            z = moments.places([_INSTRUMENT_OF.get(name, name) for name in names])
            return cls(sums[:, z][:, :, x], sums[:, z, y], squares, cross, sums[:, y, y])
        return cls(squares - noise_sums(moments, names), cross, squares, cross, sums[:, y, y])

    def solution(self, blocks: BoolArray) -> Array:
        left, right = self.left[blocks].sum(axis=0), self.right[blocks].sum(axis=0)
        return solution_of(left, right)

    def error(self, values: Array) -> Array:
        """Squared residual of each block."""
        linear = self.cross @ values
        squared = np.einsum("i,bij,j->b", values, self.squares, values)
        return np.maximum(self.effort - 2.0 * linear + squared, 0.0)

    def jackknife(self) -> Array:
        """The solutions without each of some parts of the time with motion (parts, p), as far as there are any."""
        there = np.any(self.squares != 0.0, axis=(1, 2))
        count = int(there.sum())
        part = np.where(there, (np.cumsum(there) - 1) * PARTS // max(count, 1), -1)
        found: list[Array] = []
        for k in range(PARTS if count >= 2 * PARTS else 0):
            try:
                found.append(self.solution(part != k))
            except np.linalg.LinAlgError:
                continue
        return np.array(found)

    def fold_errors(self) -> Array:
        fold = _folds(len(self.left))
        errors = np.full(FOLDS, math.nan)
        for k in range(FOLDS):
            try:
                values = self.solution(fold != k)
            except np.linalg.LinAlgError:
                # Nine tenths without motion one way cannot carry the fit: it has no error out of sample.
                continue
            errors[k] = float(self.error(values)[fold == k].sum())
        return errors


def lagged_sum(scores: Array) -> tuple[Array, float]:
    """S (p, p) of scores (n, p) by Bartlett weights over lags, and how many independent ones they are worth.

    The lag is Andrews' automatic one of the most persistent score (AR(1) approximation).
    """
    persistence = 0.0
    for score in scores.T:
        power = float(score @ score)
        if power > 0.0 and len(scores) > 2:
            persistence = max(persistence, float(score[1:] @ score[:-1]) / power)
    return bartlett_sum(scores, min(persistence, 0.97))
