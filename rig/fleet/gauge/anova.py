"""A balanced study by analysis of variance: every gear on every bench, as many mountings and repeats in each.

    E[MS_repeat]      = s_e^2
    E[MS_mounting]    = s_e^2 + r s_m^2                                        mounting within gear and bench
    E[MS_interaction] = s_e^2 + r s_m^2 + m r s_gb^2
    E[MS_bench]       = s_e^2 + r s_m^2 + m r s_gb^2 + p m r s_b^2             p gears, o benches
    E[MS_gear]        = s_e^2 + r s_m^2 + m r s_gb^2 + o m r s_g^2             m mountings, r repeats

Each variance is the difference of two mean squares over its factor, zero where that is negative. An interaction whose
p is above 0.25 goes into the line below it (AIAG). Where a level has one member only its variance cannot be told from
that of the level above and stands in it.

Intervals are generalised ones: a mean square's expectation is drawn as SS/chi^2, everything else follows from the draws
(M. Hamada and S. Weerahandi, "Measurement system assessment via generalized inference", Journal of Quality
Technology 32 (2000) 241-253).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import fdtrc

from rig.fleet.gauge.components import (
    FloatArray,
    Gauge,
    GaugeError,
    Row,
    Term,
    Values,
)

_POOLED_ABOVE = 0.25
DRAWS = 20_000
_SEED = 20_260_101


def shape_of(values: Values) -> tuple[int, int, int, int] | None:
    """Gears, benches, mountings in each, repeats in each; None where the study is not balanced."""
    cells = values.cells()
    gears, benches = values.counted
    mountings = {len(cell) for cell in cells.values()}
    repeats = {len(several) for cell in cells.values() for several in cell.values()}
    if len(cells) != gears * benches or len(mountings) != 1 or len(repeats) != 1:
        return None
    return gears, benches, mountings.pop(), repeats.pop()


def by_anova(values: Values, *, may_pool: bool = True) -> Gauge:
    """The gauge of a balanced study. Raises `GaugeError` for one that is not, or that tells nothing."""
    shape = shape_of(values)
    if shape is None:
        raise GaugeError("the study is not balanced")
    rows = _tested(_rows(_array(values, shape)))
    pooled = may_pool and _is_pooled(rows)
    return gauge_of_rows(_pool(rows) if pooled else rows, shape, shown=rows, pooled=pooled)


def _array(values: Values, shape: tuple[int, int, int, int]) -> FloatArray:
    """The values as (gears, benches, mountings, repeats)."""
    cells = values.cells()
    gears, benches = sorted(set(values.gear)), sorted(set(values.bench))
    flat = [list(cells[gear, bench].values()) for gear in gears for bench in benches]
    return np.array(flat, dtype=np.float64).reshape(shape)


def _rows(y: FloatArray) -> list[Row]:
    """Every line that has degrees of freedom, from the gear to the lowest one."""
    p, o, m, r = y.shape
    whole, gear, bench = y.mean(), y.mean(axis=(1, 2, 3)), y.mean(axis=(0, 2, 3))
    cell, mounting = y.mean(axis=(2, 3)), y.mean(axis=3)
    of_cell = gear[:, None] + bench[None, :] - whole
    lines: list[tuple[Term, float, int]] = [
        ("gear", o * m * r * float(((gear - whole) ** 2).sum()), p - 1),
        ("bench", p * m * r * float(((bench - whole) ** 2).sum()), o - 1),
        ("interaction", m * r * float(((cell - of_cell) ** 2).sum()), (p - 1) * (o - 1)),
        ("mounting", r * float(((mounting - cell[:, :, None]) ** 2).sum()), p * o * (m - 1)),
        ("repeat", float(((y - mounting[..., None]) ** 2).sum()), p * o * m * (r - 1)),
    ]
    rows = [Row(term=term, squares=squares, freedom=df) for term, squares, df in lines if df > 0]
    if p < 2 or len(rows) < 2:
        raise GaugeError(
            "a study has at least two gears, and each on two benches, mounted or measured twice"
        )
    return rows


def _below(rows: Sequence[Row], term: Term) -> Row | None:
    """The line against which a term is tested: the first of the chain interaction, mounting, repeat that lies below."""
    chain = [row for row in rows if row.term not in ("gear", "bench")]
    below = 0
    if term not in ("gear", "bench"):
        below = [row.term for row in chain].index(term) + 1
    return next(iter(chain[below:]), None)


def _tested(rows: Sequence[Row]) -> list[Row]:
    """The lines with F and p, each against the one below it."""
    tested = []
    for row in rows:
        below = _below(rows, row.term)
        if below is None or not below.mean_square > 0.0:
            tested.append(row)
            continue
        f = row.mean_square / below.mean_square
        p = float(fdtrc(row.freedom, below.freedom, f))
        tested.append(Row(term=row.term, squares=row.squares, freedom=row.freedom, f=f, p=p))
    return tested


def _is_pooled(rows: Sequence[Row]) -> bool:
    """Whether the interaction says nothing and there is a line that can take it."""
    row = next((one for one in rows if one.term == "interaction"), None)
    return row is not None and _below(rows, "interaction") is not None and row.p > _POOLED_ABOVE


def _pool(rows: Sequence[Row]) -> list[Row]:
    """The lines with the interaction in the one below it."""
    own = next(row for row in rows if row.term == "interaction")
    below = _below(rows, "interaction")
    assert below is not None
    both = Row(
        term=below.term, squares=own.squares + below.squares, freedom=own.freedom + below.freedom
    )
    kept = [row for row in rows if row.term != "interaction"]
    return _tested([both if row.term == below.term else row for row in kept])


def gauge_of_rows(
    rows: Sequence[Row],
    shape: tuple[int, int, int, int],
    *,
    shown: Sequence[Row] = (),
    pooled: bool = False,
    draws: int = DRAWS,
) -> Gauge:
    """The gauge of mean squares; `shown` are the lines before the interaction was pooled."""
    random = np.random.default_rng(_SEED)
    drawn = {row.term: row.squares / random.chisquare(row.freedom, draws) for row in rows}
    found = {row.term: np.array([row.mean_square]) for row in rows}
    variances = {term: float(v[0]) for term, v in _variances(rows, shape, found).items()}
    return Gauge(
        method="anova",
        variances={term: max(value, 0.0) for term, value in variances.items()},
        draws={t: np.maximum(v, 0.0) for t, v in _variances(rows, shape, drawn).items()},
        rows=tuple(shown or rows),
        pooled=pooled,
        negative=tuple(term for term, value in variances.items() if value < 0.0),
    )


def _variances(
    rows: Sequence[Row], shape: tuple[int, int, int, int], expected: Mapping[Term, FloatArray]
) -> dict[Term, FloatArray]:
    """The variance of each term from the expectations of the mean squares: its own less that below, over its factor."""
    p, o, m, r = shape
    factors: dict[Term, int] = {
        "gear": o * m * r,
        "bench": p * m * r,
        "interaction": m * r,
        "mounting": r,
        "repeat": 1,
    }
    variances: dict[Term, FloatArray] = {}
    for row in rows:
        below = _below(rows, row.term)
        rest = expected[below.term] if below is not None else 0.0
        variances[row.term] = (expected[row.term] - rest) / factors[row.term]
    return variances


def expected_rows(variances: Mapping[Term, float], shape: tuple[int, int, int, int]) -> list[Row]:
    """The lines of a study of this shape as they are in the mean where the variances are these."""
    p, o, m, r = shape
    of = {term: variances.get(term, 0.0) for term in ("gear", "bench", "interaction", "mounting")}
    repeat = variances.get("repeat", 0.0)
    mounting = repeat + r * of["mounting"]
    interaction = mounting + m * r * of["interaction"]
    lines: list[tuple[Term, float, int]] = [
        ("gear", interaction + o * m * r * of["gear"], p - 1),
        ("bench", interaction + p * m * r * of["bench"], o - 1),
        ("interaction", interaction, (p - 1) * (o - 1)),
        ("mounting", mounting, p * o * (m - 1)),
        ("repeat", repeat, p * o * m * (r - 1)),
    ]
    return [Row(term=term, squares=ms * df, freedom=df) for term, ms, df in lines if df > 0]
