"""A study with gaps: the same components by restricted maximum likelihood.

    -2 l_R = log|V| + log|1' V^-1 1| + y' P y        V = sum over terms of s_i^2 Z_i Z_i'
    P = V^-1 - V^-1 1 (1' V^-1 1)^-1 1' V^-1
    d(-2 l_R)/d s_i^2 = tr(P V_i) - y' P V_i P y        I_ij = 1/2 tr(P V_i P V_j)

S. R. Searle, G. Casella and C. E. McCulloch, "Variance Components" (1992), section 6.6. On a balanced study without a
negative estimate it gives what the analysis of variance gives, without pooling. Intervals by Satterthwaite: each
variance as a chi-square whose degrees of freedom follow from the information; they are approximate.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

from rig.fleet.gauge.anova import DRAWS
from rig.fleet.gauge.components import FloatArray, Gauge, GaugeError, Term, Values

_SEED = 20_260_102
_MOST_VALUES = 400
"""Values of a study with gaps: its matrices have so many rows and columns."""
_NOTHING = 1e-8
"""Share of the whole variance below which a component is none."""


def by_reml(values: Values) -> Gauge:
    """The gauge of a study with gaps. Raises `GaugeError` for values that tell no gauge."""
    _check(values)
    y = np.asarray(values.value, dtype=np.float64)
    scale = float(y.std())
    if not scale > 0.0:
        raise GaugeError("all values are the same")
    kernels = _kernels(values)
    if len(kernels) < 2:
        raise GaugeError(
            "a study has at least two gears, and each on two benches, mounted or measured twice"
        )
    y = (y - y.mean()) / scale
    found = _fitted(y, kernels)
    variances = {t: float(v) * scale**2 for t, v in zip(kernels, found, strict=True)}
    return Gauge(
        method="reml",
        variances={t: v if v > _NOTHING * scale**2 else 0.0 for t, v in variances.items()},
        draws=_draws(y, kernels, found, scale),
        negative=tuple(t for t, v in variances.items() if v <= _NOTHING * scale**2),
    )


def _check(values: Values) -> None:
    """Refuse what tells no gauge: a gauge is what one gear shows differently when it is measured again."""
    gears, benches = values.counted
    count = len(values.value)
    if gears < 2:
        raise GaugeError("a study has at least two gears")
    if count == gears:
        raise GaugeError("no gear was measured twice")
    if benches > 1 and len(values.cells()) == gears:
        raise GaugeError("no gear was on two benches, so that gears and benches are not told apart")
    if count > _MOST_VALUES:
        raise GaugeError(
            f"{count} values with gaps; at most {_MOST_VALUES}, or a study without gaps"
        )


def _kernels(values: Values) -> dict[Term, FloatArray]:
    """Z_i Z_i' (n, n) of every term that the study tells apart, from the gear to the lowest one."""
    levels: dict[Term, list[object]] = {
        "gear": list(values.gear),
        "bench": list(values.bench),
        "interaction": list(zip(values.gear, values.bench, strict=True)),
        "mounting": list(zip(values.gear, values.bench, values.mounting, strict=True)),
        "repeat": list(range(len(values.value))),
    }
    kernels: dict[Term, FloatArray] = {}
    partitions: set[tuple[int, ...]] = {(0,) * len(values.value)}
    # From the lowest level up: of two that part the values in the same way nothing tells one from the other.
    for term in ("gear", "bench", "interaction", "mounting", "repeat"):
        first: dict[object, int] = {}
        codes = tuple(first.setdefault(level, len(first)) for level in levels[term])
        if codes in partitions:
            continue
        partitions.add(codes)
        at = np.asarray(codes)
        kernels[term] = (at[:, None] == at[None, :]).astype(np.float64)
    return kernels


def _projection(
    kernels: Mapping[Term, FloatArray], variances: FloatArray
) -> tuple[FloatArray, float]:
    """P (n, n), and log|V| + log|1' V^-1 1|."""
    whole = sum((v * k for v, k in zip(variances, kernels.values(), strict=True)), 0.0)
    count = len(np.asarray(whole))
    factor = cho_factor(np.asarray(whole) + 1e-12 * np.eye(count))
    inverse = cho_solve(factor, np.eye(count))
    ones = inverse.sum(axis=1)
    weight = float(ones.sum())
    logarithm = 2.0 * float(np.log(np.diag(factor[0])).sum()) + float(np.log(weight))
    return np.asarray(inverse - np.outer(ones, ones) / weight), logarithm


def _fitted(y: FloatArray, kernels: Mapping[Term, FloatArray]) -> FloatArray:
    """The variances (terms,) of the largest restricted likelihood, in the variance of the values."""

    def criterion(variances: FloatArray) -> tuple[float, FloatArray]:
        projection, logarithm = _projection(kernels, variances)
        weighed = projection @ y
        slope = [float((projection * k).sum() - weighed @ k @ weighed) for k in kernels.values()]
        return logarithm + float(y @ weighed), np.asarray(slope)

    count = len(kernels)
    # The lowest term is that of every single value: it is never nothing, or V could not be inverted.
    bounds = [(0.0, None)] * (count - 1) + [(1e-6, None)]
    starts = (np.full(count, 1.0 / count), np.array([1.0, *[0.05] * (count - 1)]))
    fits = [minimize(criterion, s, jac=True, method="L-BFGS-B", bounds=bounds) for s in starts]
    return np.asarray(min(fits, key=lambda one: float(one.fun)).x, dtype=np.float64)


def _draws(
    y: FloatArray, kernels: Mapping[Term, FloatArray], found: FloatArray, scale: float
) -> dict[Term, FloatArray]:
    """Variances as likely as those found: chi-square by Satterthwaite, half a normal one of those that are nothing."""
    projection, _ = _projection(kernels, np.maximum(found, 1e-6))
    parts = [projection @ kernel for kernel in kernels.values()]
    information = np.array([[0.5 * float((a * b.T).sum()) for b in parts] for a in parts])
    spread = np.sqrt(np.maximum(np.diag(np.linalg.pinv(information)), 0.0))
    random = np.random.default_rng(_SEED)
    draws: dict[Term, FloatArray] = {}
    for term, value, own in zip(kernels, found, spread, strict=True):
        if value <= _NOTHING:
            draws[term] = scale**2 * np.abs(own * random.standard_normal(DRAWS))
        else:
            freedom = max(2.0 * value**2 / own**2, 1.0) if own > 0.0 else 1e6
            draws[term] = scale**2 * value * freedom / random.chisquare(freedom, DRAWS)
    return draws
