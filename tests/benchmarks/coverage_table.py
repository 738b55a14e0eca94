"""The table of the study of coverage: shares, widths, bars, and what is pooled, resampled bench by bench.

What its columns mean: docs/explanation/coverage.md.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tests.benchmarks.rows_file import Line

SAMPLING_CHECKS = ("sampling of the resonance", "count lattice")
"""Checks that refuse what the sampling cannot tell (orders and resonances above 0.4 of the rate):
no missing answer."""
FULL_TURN = 2.0 * math.pi


@dataclass(frozen=True)
class Errors:
    """Errors and widths of one quantity (n,), as shares of the truth where its target is one."""

    seen: np.ndarray
    true: np.ndarray
    width: np.ndarray
    expanded: np.ndarray

    @classmethod
    def of(cls, numbers: Sequence[Line]) -> Errors:
        def away(number: Line, name: str) -> float:
            error = number["value"] - number[name]
            return math.remainder(error, FULL_TURN) if number["is_circular"] else error

        size = np.array([abs(n["true"]) if n["is_share"] else 1.0 for n in numbers])
        return cls(
            np.array([away(n, "seen") for n in numbers]) / size,
            np.array([away(n, "true") for n in numbers]) / size,
            np.array([n["high"] - n["low"] for n in numbers]) / size,
            np.array([n["expanded"] for n in numbers]) / size,
        )


def table(lines: Iterable[Line]) -> list[Line]:
    """One row per kind and quantity. Shares are of the numbers that were called identified."""
    runs: dict[str, list[Line]] = defaultdict(list)
    numbers: dict[tuple[str, str], list[Line]] = defaultdict(list)
    for line in lines:
        if line["what"] == "run":
            runs[line["kind"]].append(line)
        else:
            numbers[line["kind"], line["quantity"]].append(line)
    return [
        _row(kind, quantity, group, runs[kind])
        for (kind, quantity), group in sorted(numbers.items())
    ]


def _row(kind: str, quantity: str, group: Sequence[Line], runs: Sequence[Line]) -> Line:
    yes = [n for n in group if n["called"] == "yes"]
    row: Line = {"kind": kind, "quantity": quantity, "seeds": len(group), "called_yes": len(yes)}
    row |= _answers(quantity, group, runs)
    if not yes:
        empty = ("statistical", "expanded")
        row |= {f"covered_{name}": None for name in empty} | dict.fromkeys(_RATIOS)
        return row | {"misses": ""}
    errors = Errors.of(yes)
    held = [
        n["low"] <= n["value"] - e <= n["high"] for n, e in zip(yes, _absolute(yes), strict=True)
    ]
    within = np.abs(errors.true) <= errors.expanded
    scatter = float(errors.seen.std(ddof=1)) if len(yes) > 1 else math.nan
    needed = float(np.quantile(np.abs(errors.true), 0.95))
    u = float(np.median(errors.expanded))
    ratios = (
        float(np.median(errors.width)) / (3.92 * scatter) if scatter else math.nan,
        u / needed if needed else math.nan,
        float(errors.true.mean()) / u if u else math.nan,
    )
    finite = (round(r, 3) if math.isfinite(r) else None for r in ratios)
    row |= {
        "covered_statistical": round(float(np.mean(held)), 4),
        "covered_expanded": round(float(np.mean(within)), 4),
        **dict(zip(_RATIOS, finite, strict=True)),
    }
    return row | {"misses": ", ".join(misses(row))}


_RATIOS = ("width_ratio", "expanded_ratio", "bias_over_u")
BARS: Mapping[str, tuple[str, float, float]] = {
    "A": ("covered_statistical", 0.90, 0.99),
    "U": ("covered_expanded", 0.91, 1.0),
    "width": ("width_ratio", 0.0, 1.35),
    "U ratio": ("expanded_ratio", 0.0, 1.5),
}
"""What each quantity must keep: the column, the least and the largest that is allowed."""
FEWEST = 20
"""Numbers called identified below which a share says too little to miss a bar."""
RESAMPLED = 2000


def misses(row: Line) -> list[str]:
    """Which bars a row of the table does not keep."""
    if row["called_yes"] < FEWEST:
        return []
    return [
        name
        for name, (column, least, largest) in BARS.items()
        if row[column] is not None and not least <= row[column] <= largest
    ]


def pooled(lines: Iterable[Line]) -> Line:
    """Shares over all quantities, those at 20 degC apart, with their 95 % intervals: benches are drawn, not numbers.

    The numbers of one bench share its errors: they are one chance.
    """
    groups: dict[str, list[tuple[int, bool, bool]]] = {"all": [], "at 20 degC": []}
    for n in lines:
        if n["what"] != "number" or n["called"] != "yes":
            continue
        (seen,), true = _absolute([n]), Errors.of([{**n, "is_share": False}]).true[0]
        held = n["low"] <= n["value"] - seen <= n["high"]
        case = (n["seed"], held, abs(true) <= n["expanded"])
        groups["all"].append(case)
        if n["quantity"].endswith("_at_20_degrees"):
            groups["at 20 degC"].append(case)
    return {name: _resampled(cases) for name, cases in groups.items() if cases}


def _resampled(cases: Sequence[tuple[int, bool, bool]]) -> Line:
    seeds = sorted({seed for seed, _, _ in cases})
    place = {seed: k for k, seed in enumerate(seeds)}
    sums = np.zeros((len(seeds), 3))
    for seed, held, within in cases:
        sums[place[seed]] += (1.0, held, within)
    drawn = np.random.default_rng(len(seeds)).integers(0, len(seeds), (RESAMPLED, len(seeds)))
    totals = sums[drawn].sum(axis=1)
    answer: Line = {"benches": len(seeds), "numbers": len(cases)}
    for column, name in ((1, "A"), (2, "U")):
        shares = totals[:, column] / totals[:, 0]
        low, high = np.quantile(shares, (0.025, 0.975))
        whole = sums[:, column].sum() / len(cases)
        answer[name] = [round(float(v), 4) for v in (whole, low, high)]
    return answer


def _absolute(numbers: Sequence[Line]) -> list[float]:
    """Found minus what the bench sees, in the quantity's own unit."""
    plain = [{**n, "is_share": False} for n in numbers]
    return [float(e) for e in Errors.of(plain).seen]


def _answers(quantity: str, group: Sequence[Line], runs: Sequence[Line]) -> Line:
    """Of the runs that hold enough information for half the target, how many gave no number called identified.

    Runs that were refused because their sampling cannot tell are not counted, nor are quantities
    without a bound.
    """
    by_seed = {n["seed"]: n for n in group}
    family = quantity.partition("_")[0] + "_"
    targets = [n["target"] for n in group if n["target"] is not None]
    shared = [n["type_b"] for n in group]
    enough = missing = 0
    for run in runs:
        bounds = run.get("bounds", {})
        bound = bounds.get(quantity, bounds.get(family))
        if run["outcome"] not in ("analysed", "refused") or bound is None:
            continue
        if any(run["words"].startswith(name) for name in SAMPLING_CHECKS) or not targets:
            continue
        number = by_seed.get(run["seed"])
        # A refused run has no budget and no value: those of the others stand for it.
        target = number["target"] if number else float(np.median(targets))
        type_b = number["type_b"] if number else float(np.median(shared))
        if 1.96 * math.hypot(bound, type_b) < 0.5 * target:
            enough += 1
            missing += number is None or not _is_answer(number)
    return {"enough_information": enough, "not_answered": missing}


def _is_answer(number: Line) -> bool:
    """Whether a number says something: identified, or not distinguishable from zero within a useful U."""
    is_limit = abs(number["value"]) <= number["expanded"] <= number["target"]
    return number["called"] == "yes" or (is_limit and not number["is_circular"])
