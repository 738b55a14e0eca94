"""Gears drawn from what is known of one: for simulations over a range of gears (domain randomisation).

Numbers that are positive by nature are log-normal, the others (cosines and sines of the kinematic error) normal, all of
them together by one covariance. The moments are matched: with mean m and covariance C of the numbers themselves, the
normal variables behind them have

    S_ij = ln(1 + C_ij/(m_i m_j))     both log-normal          mean ln m_i - S_ii/2
    S_ij = C_ij/m_i                   i log-normal, j normal

so that mean and covariance of what is drawn are m and C. Numbers whose doubt nobody stated stay as they are.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.arrays import FloatArray
from rig.errors import ConfigurationError
from rig.exchange.identified import IdentifiedGear

_NEGATIVE = 1e-9
"""Share of the largest eigenvalue below nothing that rounding makes."""
_ROUNDS = 4
"""How often as many are drawn as are wanted: what lies outside the range of a number is drawn again."""


@dataclass(frozen=True)
class Samples:
    """Drawn numbers (n, p) in SI by their names; `seed` draws them again."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: FloatArray
    seed: int


def drawn(identified: IdentifiedGear, count: int, seed: int) -> Samples:
    """`count` draws. Raises `ConfigurationError` where nothing is uncertain, or where no such distribution exists."""
    if count < 1:
        raise ConfigurationError(
            "no draws", where="--samples", value=count, limit=">= 1", remedy="Ask for one or more."
        )
    if not identified.uncertain:
        raise ConfigurationError(
            "no number of this gear has a stated uncertainty, so that there is nothing to draw",
            where="--samples",
            value=identified.gear.name,
            limit="one number with an uncertainty",
            remedy="Name a gear that runs identified, or state standard_uncertainty in its file.",
        )
    known = {one.name: one for one in identified.parameters}
    mean = np.array([known[name].value for name in identified.uncertain])
    is_log = np.array([known[name].is_positive for name in identified.uncertain])
    centre, spread = _behind(identified, mean, is_log)
    root = _root(identified, spread)
    bounds = np.array([(known[name].low, known[name].high) for name in identified.uncertain])
    random = np.random.default_rng(seed)
    values = np.empty((0, len(mean)))
    for _ in range(_ROUNDS):
        normal = random.standard_normal((count, len(mean))) @ root.T + centre
        tried = np.where(is_log, np.exp(np.where(is_log, normal, 0.0)), normal)
        inside = np.all((tried >= bounds[:, 0]) & (tried <= bounds[:, 1]), axis=1)
        values = np.concatenate([values, tried[inside]])[:count]
        if len(values) == count:
            break
    else:
        raise _outside(identified)
    units = tuple(known[name].unit for name in identified.uncertain)
    return Samples(identified.uncertain, units, values, seed)


def _outside(identified: IdentifiedGear) -> ConfigurationError:
    return ConfigurationError(
        "most draws lie outside what a parameter set may hold",
        where="--samples",
        value=identified.gear.name,
        limit="the ranges of `rig model`",
        remedy="Identify the gear again: a number is uncertain by more than its range.",
    )


def _behind(
    identified: IdentifiedGear, mean: FloatArray, is_log: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray]:
    """Mean (p,) and covariance (p, p) of the normal variables behind the numbers."""
    scale = np.where(is_log, mean, 1.0)
    relative = identified.covariance / np.outer(scale, scale)
    both = np.logical_and.outer(is_log, is_log)
    if np.any(relative[both] <= -1.0) or np.any(mean[is_log] <= 0.0):
        raise ConfigurationError(
            "numbers that are positive by nature have no such mean and covariance",
            where=identified.gear.name,
            value="; ".join(identified.uncertain),
            limit="means above nothing, C_ij > -m_i m_j",
            remedy="Identify the gear again: a number is uncertain by more than itself.",
        )
    spread = np.where(both, np.log1p(np.where(both, relative, 0.0)), relative)
    with np.errstate(divide="ignore", invalid="ignore"):
        centre = np.where(is_log, np.log(np.where(is_log, mean, 1.0)) - 0.5 * np.diag(spread), mean)
    return np.asarray(centre, dtype=np.float64), np.asarray(spread, dtype=np.float64)


def _root(identified: IdentifiedGear, spread: FloatArray) -> FloatArray:
    """A matrix R with R R' = spread. Raises `ConfigurationError` where there is none."""
    size = np.sqrt(np.diag(spread))
    values, vectors = np.linalg.eigh(spread / np.outer(size, size))
    if values[0] < -_NEGATIVE * values[-1]:
        raise ConfigurationError(
            "no distribution has this mean and covariance where its numbers are positive",
            where=identified.gear.name,
            value=f"least eigenvalue {values[0]:.2g}",
            limit=">= 0",
            remedy="Identify the gear again: two numbers err together by more than either.",
        )
    return np.asarray(size[:, np.newaxis] * vectors * np.sqrt(np.maximum(values, 0.0)))


def table_text(samples: Samples) -> str:
    """The draws as CSV: names with units, then a row each; a first line that begins with # says what it is."""
    text = io.StringIO()
    text.write(
        f"# {len(samples.values)} draws, seed {samples.seed}, SI; moments of the joint posterior\n"
    )
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(
        [f"{name} [{unit}]" for name, unit in zip(samples.names, samples.units, strict=True)]
    )
    rows.writerows([[repr(value) for value in row] for row in samples.values.tolist()])
    return text.getvalue()
