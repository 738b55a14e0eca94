"""Whether two plans of one gear agree: E_n of every quantity of two friction runs, errors that both share taken out.

    python -m tests.benchmarks.agreement_study --first-seed 1000 --seeds 40 --rows rows.jsonl --json

E_n = (a - b)/sqrt(U_a^2 + U_b^2), from what the two results do not share (torque scale, tare, the
parameter set's bearing, the bench's output bearing); at most 1 in 95 of 100 pairs where U is honest.
A pair of which a run trips, or whose analysis refuses, has no E_n: the study goes on and names it.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from model.identify.estimate import (
    BudgetLine,
    Estimate,
    coverage_factor_of,
)
from tests.benchmarks.coverage_study import FAILED, code_commit

Line = dict[str, Any]
"""One row: what came of a seed, with its quantities; or one line of the table."""

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
    return coverage_factor_of(lines) * u


def normalised_error(a: Estimate, b: Estimate) -> float:
    """E_n of two results of the same quantity."""
    return (a.value - b.value) / math.hypot(own_uncertainty(a), own_uncertainty(b))


def pair_line(a: Estimate, b: Estimate) -> Line:
    """One quantity of a pair: E_n where both results tell it, else None."""
    told = a.identifiable == b.identifiable == "yes"
    return {"quantity": a.name, "normalised_error": normalised_error(a, b) if told else None}


def table(lines: Iterable[Line]) -> list[Line]:
    """By quantity: pairs that tell it, how many of them have |E_n| <= 1, and the largest |E_n|."""
    found: dict[str, list[float]] = defaultdict(list)
    for line in lines:
        for number in line["numbers"]:
            if number["normalised_error"] is not None:
                found[number["quantity"]].append(abs(number["normalised_error"]))
    return [
        {
            "quantity": name,
            "pairs": len(errors),
            "within": sum(error <= 1.0 for error in errors),
            "worst": round(max(errors), 3),
        }
        for name, errors in found.items()
    ]


def answer(lines: Sequence[Line], commit: str, first_seed: int) -> Line:
    """The whole study: its table, and the pairs that gave no two results, each with what stood in the way."""
    without = [line for line in lines if line["outcome"] != "analysed"]
    return {
        "commit": commit,
        "first_seed": first_seed,
        "rows": table(lines),
        "without_result": [
            {name: line[name] for name in ("seed", "outcome", "words")} for line in without
        ],
    }


def seed_line(seed: int, population: str) -> Line:
    """Both plans on one simulated gear and bench: what came of them, and the quantities of the pair."""
    from experiments.errors import AnalysisError, PlanError
    from model.errors import ModelError
    from rig.errors import RigError

    line: Line = {"seed": seed, "population": population, "numbers": []}
    try:
        return line | {"outcome": "analysed", "words": ""} | pairs_of(seed, population)
    except (AnalysisError, ModelError, PlanError, RigError) as refusal:
        return line | {"outcome": "refused", "words": str(refusal)}
    except Exception as error:  # noqa: BLE001
        # A defect of the program is a row like another: the other seeds do not fall with it.
        return line | {"outcome": "crashed", "words": repr(error)}


def pairs_of(seed: int, population: Any) -> Line:
    """The quantities of both plans; "failed" with the run's message where one did not come to its end."""
    from model.gear_file import shipped_gear
    from model.motor import shipped_motor
    from rig.bench.backends.order import Order, WorldChoice
    from rig.run.start import run_order
    from tests.rig.fitting import fit_files

    wanted = [("motor-tare", {"points": 12}), *(("friction", plan) for plan in PLANS)]
    paths: list[Path] = []
    with tempfile.TemporaryDirectory() as folder:
        for number, (protocol, values) in enumerate(wanted, start=1):
            report = run_order(
                Order(
                    protocol=protocol,
                    gear=shipped_gear(),
                    motor=shipped_motor(),
                    folder=Path(folder),
                    values=values,
                    serial=f"S{seed}",
                    seed=seed,
                    world=WorldChoice(
                        gear_seed=seed,
                        bench_seed=seed,
                        number=number,
                        population=population,
                        start_state="ambient",
                    ),
                )
            )
            if not report.safe or report.outcome in FAILED:
                words = f"{protocol}, run {number} of {len(wanted)}: {report.message}"
                return {"outcome": "failed", "words": words}
            paths.append(report.path)
        first, second = (fit.result.estimates for fit in fit_files(paths[1:], tare=paths[0]))
    both = [q for q in QUANTITIES if q in first and q in second]
    return {"numbers": [pair_line(first[q], second[q]) for q in both]}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study and print its table, or everything as JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--first-seed", type=int, required=True)
    parser.add_argument("--seeds", type=int, required=True)
    parser.add_argument("--population", choices=("narrow", "wide"), default="wide")
    parser.add_argument("--rows", type=Path, help="file of JSON lines to which every seed is added")
    parser.add_argument("--uncommitted", action="store_true")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    commit = code_commit(uncommitted=options.uncommitted)
    lines = []
    for seed in range(options.first_seed, options.first_seed + options.seeds):
        lines.append(seed_line(seed, options.population) | {"commit": commit})
        if options.rows is not None:
            with options.rows.open("a", encoding="utf-8") as file:
                file.write(json.dumps(lines[-1]) + "\n")
        print(f"seed {seed}: {lines[-1]['outcome']}", file=sys.stderr, flush=True)
    found = answer(lines, commit, options.first_seed)
    if options.json:
        print(json.dumps(found))
        return 0
    print("| quantity | pairs | E_n <= 1 | largest |\n|---|---|---|---|")
    for row in found["rows"]:
        print(f"| {row['quantity']} | {row['pairs']} | {row['within']} | {row['worst']} |")
    for line in found["without_result"]:
        print(f"seed {line['seed']}: {line['outcome']}: {line['words']}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
