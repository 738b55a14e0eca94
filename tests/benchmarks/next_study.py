"""Whether U becomes what `rig next` says: pairs of runs, the second made as the first one's advice asks.

    python -m tests.benchmarks.next_study --first-seed 33700 --pairs 40

Simulated gears, a friction run of sixteen speeds each. Wanted is 0.7 of U.
Where the advice is visits, a second run is made with so many repeats, and U is held against what was said: realised
over predicted within the 95 % quantiles of F by the degrees of freedom of both runs' scatter. Where it is a
calibration, the line is set to the size that was named, and U computed anew. The named line must be the largest in all.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections import Counter
from dataclasses import replace
from pathlib import Path

from scipy.stats import f as fisher

from experiments.result import Result
from model.identify.estimate import (
    BudgetLine,
    Estimate,
    coverage_factor_of,
    effective_degrees_of_freedom,
)
from rig.analysis.next_run import Advice, Of, advice, merged

CREATED = "2026-01-01T00:00:00+00:00"
POINTS = 16
SHARE = 0.7
"""Of U that is wanted."""
QUANTITIES = ("stribeck_velocity", "running_torque_1000_rpm", "coulomb")


def fitted(seed: int, number: int, repeats: int) -> Result:
    """A short friction run of a simulated gear."""
    from rig.analysis.fit.digest import digest
    from rig.api.executing import execute

    with tempfile.TemporaryDirectory() as folder:
        made = execute(
            "friction",
            serial=f"G{seed}",
            folder=folder,
            seed=seed,
            world={"gear_seed": seed, "bench_seed": seed + 10_000, "number": number},
            points=POINTS,
            repeats=repeats,
        )
        found = digest(Path(str(made.path)), CREATED)
        assert found.fit is not None, found.because
        return found.fit.result


def scatter_freedom(estimate: Estimate) -> float:
    """Degrees of freedom of the lines of scatter; 1 where there is none."""
    lines = [line for line in estimate.budget if line.kind == "A"]
    freedom = effective_degrees_of_freedom(lines)
    return max(freedom, 1.0) if math.isfinite(freedom) else 1e6


def ratio_in_bounds(first: Estimate, second: Estimate, said: Advice) -> tuple[float, bool]:
    """Realised over predicted U, and whether it lies within what the degrees of freedom allow."""
    assert said.becomes is not None
    ratio = second.expanded_uncertainty / said.becomes
    low, high = fisher.ppf((0.025, 0.975), scatter_freedom(second), scatter_freedom(first))
    return ratio, math.sqrt(low) <= ratio <= math.sqrt(high)


def with_needed(estimate: Estimate, said: Advice) -> float:
    """U with the largest line at the size that the advice names."""
    first, *rest = merged(estimate)
    lines: list[BudgetLine] = [replace(first, standard_uncertainty=said.needed or 0.0), *rest]
    return coverage_factor_of(lines) * math.sqrt(sum(x.standard_uncertainty**2 for x in lines))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first-seed", type=int, required=True)
    parser.add_argument("--pairs", type=int, default=40)
    said = parser.parse_args()
    counted: Counter[str] = Counter()
    for seed in range(said.first_seed, said.first_seed + said.pairs):
        first = fitted(seed, 1, 1)
        words = []
        for name in QUANTITIES:
            estimate = first.estimates.get(name)
            if estimate is None or not math.isfinite(estimate.expanded_uncertainty):
                continue
            of = Of(first.kind, first.run, {"repeats": 1})
            wanted = SHARE * estimate.expanded_uncertainty
            one = advice(estimate, first.quantity(name), of, wanted)
            is_largest = (
                one.line == max(estimate.budget, key=lambda line: line.standard_uncertainty).source
            )
            counted["named line the largest" if is_largest else "named line not the largest"] += 1
            if one.helps == "visits" and one.parameters:
                second = fitted(seed, 2, one.parameters["repeats"])
                ratio, holds = ratio_in_bounds(estimate, second.estimates[name], one)
                counted["visits held" if holds else "visits missed"] += 1
                words.append(
                    f"{name} x{one.times} realised/predicted {ratio:.2f}{'' if holds else ' MISSED'}"
                )
            elif one.helps == "calibration" and one.becomes is not None:
                ratio = with_needed(estimate, one) / one.becomes
                counted[
                    "calibration held" if abs(ratio - 1.0) <= 0.15 else "calibration missed"
                ] += 1
                words.append(f"{name}: {one.line}, U as said {ratio:.2f}")
            else:
                counted[one.helps] += 1
                words.append(f"{name}: {one.helps} ({one.line})")
        print(f"{seed}: {'; '.join(words)}", flush=True)
    print(dict(counted))


if __name__ == "__main__":
    main()
