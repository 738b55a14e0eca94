"""How often a verdict is wrong: limits at the truth, and limits anywhere within two U of the value.

    python -m tests.benchmarks.verdict_study --rows coverage.jsonl --commit COMMIT

Nothing is run: each number that the study of coverage stored beside its truth is held against limits by the program's
own judge. With the limit *at* the truth a PASS says more than anybody can know; U lets it happen in one of forty, to
either side. With limits drawn uniformly within ± 2 U of the value, a PASS is wrong where the truth lies beyond the
limit. Numbers that are "weakly" identified are judged as well: the program does. Phases and index marks have no limit.
"""

from __future__ import annotations

import argparse
import json
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments import catalogue
from experiments.finding import Finding, Severity
from experiments.result import Result
from model.identify.estimate import BudgetLine, Estimate
from rig.analysis.judging import StoredResult, judge
from rig.gears.acceptance import Acceptance, Limit
from sim_backend.streams import stream
from tests.benchmarks.rows_file import Line, read_rows

ALLOWED_AT_TRUTH = 18 / 400
ALLOWED_BEYOND = 0.005
DRAWN = 20
"""Limits that are drawn for each number."""
WITHIN = 2.0
"""U on either side of the value from which they are drawn."""
RESAMPLED = 2000


def outcome(run: Line, number: Line, limit: float, *, is_upper: bool) -> str:
    """The verdict of the program on one stored number, held against one limit that a customer confirmed."""
    kind, name = number["kind"], number["quantity"]
    experiment = catalogue.declared(kind)
    assert experiment is not None
    lines = (BudgetLine("stored", "B", number["expanded"] / number["factor"]),)
    estimate = Estimate(
        name=name,
        value=number["value"],
        unit=number["unit"],
        low=number["low"],
        high=number["high"],
        identifiable=number["called"],
        budget=lines,
        stated_coverage_factor=number["factor"],
    )
    checks = tuple(Finding(c, Severity.NOT_LOOKED_AT) for c in run["unchecked"])
    options = {"torque_is_of": run["subject"]} if run["subject"] else {}
    result = Result(
        run=str(run["seed"]),
        kind=kind,
        estimates={name: estimate},
        options=options,
        quantities=experiment.quantities,
        checks=checks,
    )
    side: Mapping[str, float] = {"upper": limit} if is_upper else {"lower": limit}
    asked: Any = run["subject"] if run["subject"] == "motor + gear" else "gear"
    held = Limit(
        quantity=f"{kind}.{name}",
        unit=number["unit"],
        source="the truth",
        standing="customer",
        confirmed_by="the study",
        confirmed_on="2026-11-25",
        subject=asked,
        **side,
    )
    acceptance = Acceptance(name="study", source="truth", use="any", limits=(held,), path="study")
    return judge([StoredResult(result, "simulated", "COMPLETED")], acceptance).verdict


def judged(lines: Iterable[Line]) -> Iterator[Line]:
    """Each number that can have a limit: its verdicts at the truth, from both sides, and within two U of the value."""
    lines = list(lines)
    runs = {(n["seed"], n["kind"]): n for n in lines if n["what"] == "run"}
    for n in lines:
        if n["what"] != "number" or n["is_circular"] or not math.isfinite(n["expanded"]):
            continue
        run = runs[n["seed"], n["kind"]]
        random = stream(n["seed"], f"limits {n['kind']} {n['quantity']}")
        places = random.uniform(-WITHIN, WITHIN, DRAWN)
        beyond = {
            way: [
                _beyond(run, n, float(n["value"] + p * n["expanded"]), is_upper=way == "upper")
                for p in places
            ]
            for way in ("upper", "lower")
        }
        yield {
            "seed": n["seed"],
            "kind": n["kind"],
            "quantity": n["quantity"],
            "upper": outcome(run, n, n["true"], is_upper=True),
            # Whatever cannot be negative keeps a limit of 0: what is held against it is the least above.
            "lower": outcome(run, n, n["true"] or math.ulp(0.0), is_upper=False),
            "drawn": 2 * DRAWN,
            "passed": sum(word != "" for words in beyond.values() for word in words),
            "wrong": sum(word == "wrong" for words in beyond.values() for word in words),
        }


def _beyond(run: Line, number: Line, limit: float, *, is_upper: bool) -> str:
    """ "" for no PASS, "right", or "wrong" where the truth lies beyond the limit that was kept."""
    if outcome(run, number, limit, is_upper=is_upper) != "PASS":
        return ""
    above = number["true"] > limit
    return "wrong" if above == is_upper and number["true"] != limit else "right"


def summary(cases: Sequence[Line]) -> Line:
    """Per quantity PASS at the truth from either side, of how many benches; and the share of wrong ones, by bench."""
    groups: dict[tuple[str, str], list[Line]] = defaultdict(list)
    for case in cases:
        if case["upper"] != "NOT JUDGED":
            groups[case["kind"], case["quantity"]].append(case)
    rows: list[Line] = []
    for (kind, quantity), group in sorted(groups.items()):
        row: Line = {"kind": kind, "quantity": quantity, "benches": len(group)}
        row |= {way: sum(c[way] == "PASS" for c in group) for way in ("upper", "lower")}
        row["allowed"] = math.floor(ALLOWED_AT_TRUTH * len(group))
        row["wrong_share"] = round(_share(group), 5)
        rows.append(row)
    counted = [case for group in groups.values() for case in group]
    return {
        "rows": rows,
        "miss": [r for r in rows if max(r["upper"], r["lower"]) > r["allowed"]],
        "wrong": _resampled(counted) if counted else None,
        "allowed": ALLOWED_BEYOND,
        "not_judged": len(cases) - len(counted),
    }


def _share(cases: Iterable[Line]) -> float:
    """Wrong ones among all limits that were drawn."""
    cases = list(cases)
    return sum(c["wrong"] for c in cases) / sum(c["drawn"] for c in cases)


def _resampled(cases: Sequence[Line]) -> Line:
    """The share of wrong ones with its 95 % interval over benches."""
    by_seed: dict[int, list[Line]] = defaultdict(list)
    for case in cases:
        by_seed[case["seed"]].append(case)
    sums = np.array(
        [[sum(c[name] for c in group) for name in ("drawn", "wrong")] for group in by_seed.values()]
    )
    drawn = np.random.default_rng(len(sums)).integers(0, len(sums), (RESAMPLED, len(sums)))
    drawn_sums = sums[drawn].sum(axis=1)
    low, high = np.quantile(drawn_sums[:, 1] / drawn_sums[:, 0], (0.025, 0.975))
    return {
        "benches": len(sums),
        "limits": int(sums[:, 0].sum()),
        "passed_wrongly": int(sums[:, 1].sum()),
        "share": round(_share(cases), 6),
        "low": round(float(low), 6),
        "high": round(float(high), 6),
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Judge what a study of coverage stored, and print what came of it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rows", type=Path, required=True, help="file of the study of coverage")
    parser.add_argument("--commit", required=True, help="whose rows of that file are judged")
    parser.add_argument("--population", choices=("narrow", "wide"), default="wide")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--seeds", type=int, default=10**9)
    options = parser.parse_args(arguments)
    key = {"commit": options.commit, "population": options.population}
    last = options.first_seed + options.seeds
    lines = [n for n in read_rows(options.rows, key) if options.first_seed <= n["seed"] < last]
    if not lines:
        raise SystemExit(f"{options.rows} has no row of {options.commit} and these seeds")
    print(json.dumps(summary(list(judged(lines))), indent=1))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
