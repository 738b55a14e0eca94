"""Whether two plans of one gear agree: E_n of every quantity of two friction runs, errors that both share taken out.

    python -m tests.benchmarks.agreement_study --first-seed 1000 --seeds 40 --population wide

E_n = (a - b)/sqrt(U_a^2 + U_b^2), from what the two results do not share (torque scale, tare, the
parameter set's bearing, the bench's output bearing); at most 1 in 95 of 100 pairs where U is honest.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from model.identify.estimate import (
    BudgetLine,
    Estimate,
    coverage_factor,
    effective_degrees_of_freedom,
)

SHARED = frozenset({"output bearing", "output bearing, viscous", "warmth of the motor"})
"""Budget lines of one bench and day beside those that name a cause."""
PLANS: tuple[dict[str, Any], ...] = (
    {"points": 12},
    {"points": 15, "lowest_rpm": 2.0, "highest_rpm": 2500.0, "bracket_rpm": 450.0},
)
QUANTITIES = (
    "coulomb",
    "static",
    "viscous",
    "running_torque_500_rpm",
    "running_torque_1000_rpm",
    "running_torque_2000_rpm",
)


def own_uncertainty(estimate: Estimate) -> float:
    """U of what is not shared with another run of the same gear on the same bench."""
    lines: list[BudgetLine] = [
        line for line in estimate.budget if line.cause is None and line.source not in SHARED
    ]
    u = math.sqrt(sum(line.standard_uncertainty**2 for line in lines))
    return coverage_factor(effective_degrees_of_freedom(lines)) * u


def normalised_error(a: Estimate, b: Estimate) -> float:
    """E_n of two results of the same quantity."""
    return (a.value - b.value) / math.hypot(own_uncertainty(a), own_uncertainty(b))


def agreement(pairs: Iterable[tuple[Estimate, Estimate]]) -> dict[str, tuple[int, float]]:
    """By quantity: pairs that tell it, and the share of them with |E_n| <= 1."""
    found: dict[str, list[bool]] = defaultdict(list)
    for a, b in pairs:
        if a.identifiable == b.identifiable == "yes":
            found[a.name].append(abs(normalised_error(a, b)) <= 1.0)
    return {name: (len(hits), sum(hits) / len(hits)) for name, hits in found.items()}


def pairs_of(seed: int, population: Any) -> list[tuple[Estimate, Estimate]]:
    """The quantities of both plans, run on one simulated gear and bench."""
    from model.gear_file import shipped_gear
    from model.motor import shipped_motor
    from rig.analysis.fit_run import fit_files
    from rig.bench.backends.assembly import WorldChoice
    from rig.run.start import RunRequest, run_request

    wanted = [("motor-tare", {"points": 12}), *(("friction", plan) for plan in PLANS)]
    with tempfile.TemporaryDirectory() as folder:
        paths = [
            run_request(
                RunRequest(
                    protocol=protocol,
                    gear=shipped_gear(),
                    motor=shipped_motor(),
                    output=Path(folder),
                    values=values,
                    gear_serial=f"S{seed}",
                    seed=seed,
                    world=WorldChoice(
                        gear_seed=seed,
                        bench_seed=seed,
                        number=number,
                        population=population,
                        start_state="ambient",
                    ),
                ),
            ).path
            for number, (protocol, values) in enumerate(wanted, start=1)
        ]
        first, second = (
            fit.result.estimates
            for fit in fit_files(paths[1:], tare=paths[0], settings={"genetic": False})
        )
    return [(first[q], second[q]) for q in QUANTITIES if q in first and q in second]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first-seed", type=int, default=1000)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--population", choices=("narrow", "wide"), default="wide")
    options = parser.parse_args()
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    pairs = [pair for seed in seeds for pair in pairs_of(seed, options.population)]
    print("| quantity | pairs | E_n <= 1 |\n|---|---|---|")
    for name, (count, share) in agreement(pairs).items():
        print(f"| {name} | {count} | {100.0 * share:.0f} % |")


if __name__ == "__main__":
    main()
