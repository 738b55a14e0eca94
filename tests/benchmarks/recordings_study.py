"""Coverage of the analyses of recordings, over synthetic recordings that nobody looked at before.

    python -m tests.benchmarks.recordings_study --first-seed 9721 --recordings 40 --workers 2 --json rows.jsonl

Every seed is one recording. Of six, three are joints that move (standstill 0 to 70 %, torque late,
jitter, gaps, gravity, quantisation, 50 Hz to 20 kHz, a Stribeck dip), one is a table of friction
over speed (any static against Coulomb friction, either direction or both, wrong points, presliding,
any unit), one two encoders apart in time, one loops of torque over torsion. Truth and recording are
made by none of the code that is studied (`recordings_cases`, `recordings_pairs`).

Prints per quantity (a) how often the statistical interval holds what this bench sees (the truth
with the bench's own torque scale), (b) how often value ± U holds the truth, the width of (a) over
what the errors scatter, U over what 95 % of the errors need, their mean over U, and how often there
is no answer: refused, or not called identified. Errors are counted in units of their own interval
or U, so that recordings of any size count alike. `--json FILE` keeps every row as a line, as it comes.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from experiments import catalogue
from experiments.contract import Evidence
from experiments.errors import AnalysisError
from model.gear_file import shipped_gear
from tests.benchmarks.recordings_cases import friction_table, joint
from tests.benchmarks.recordings_pairs import encoders, torque_loops

MAKERS = (friction_table, joint, encoders, joint, torque_loops, joint)


def study(seed: int) -> list[dict[str, Any]]:
    """One recording analysed: a row per quantity of its truth."""
    random = np.random.default_rng(seed)
    case = MAKERS[seed % len(MAKERS)](random)
    head = {"seed": seed, "kind": case.kind, **case.facts}
    try:
        result = catalogue.load(case.kind).analyse(
            case.recording, Evidence(shipped_gear(), settings=case.settings)
        )
    except AnalysisError as error:
        return [
            {**head, "quantity": name, "truth": truth, "refused": str(error)}
            for name, truth in case.truth.items()
        ]
    rows = []
    for name, truth in case.truth.items():
        row: dict[str, Any] = {**head, "quantity": name, "truth": truth}
        if name in result.estimates:
            e = result.estimates[name]
            row |= {
                "seen": case.seen.get(name, truth),
                "value": e.value,
                "low": e.low,
                "high": e.high,
                "U": e.expanded_uncertainty,
                "identifiable": e.identifiable,
                "note": e.note,
            }
        rows.append(row)
    return rows


def summary(rows: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Per kind and quantity: answered "yes", (a) and (b) of those, and the share without an answer."""
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["kind"], row["quantity"]), []).append(row)
    lines: list[dict[str, Any]] = []
    for (kind, quantity), group in sorted(groups.items()):
        answered = [row for row in group if row.get("identifiable") == "yes"]
        lines.append(
            {
                "kind": kind,
                "quantity": quantity,
                "recordings": len(group),
                "answered": len(answered),
                **_coverage(answered),
                "not_answered": len(group) - len(answered),
                "refused": sum("refused" in row for row in group),
            }
        )
    return lines


def _coverage(answered: list[dict[str, Any]]) -> dict[str, float | None]:
    """(a), (b), and the errors in units of the interval and of U."""
    if len(answered) < 2:
        return dict.fromkeys(("a", "b", "width", "U_ratio", "bias_over_U"))
    low, high, seen, value, truth, u = (
        np.array([row[key] for row in answered])
        for key in ("low", "high", "seen", "value", "truth", "U")
    )
    own, whole = (value - seen) / (high - low), (value - truth) / u
    found = {
        "a": np.mean((low <= seen) & (seen <= high)),
        "b": np.mean(np.abs(whole) <= 1.0),
        "width": 1.0 / (3.92 * float(np.std(own, ddof=1))),
        "U_ratio": 1.0 / float(np.quantile(np.abs(whole), 0.95)),
        "bias_over_U": abs(float(np.mean(whole))),
    }
    return {name: round(float(number), 3) for name, number in found.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first-seed", type=int, default=9721)
    parser.add_argument("--recordings", type=int, default=40)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--json", type=Path, help="file that takes every row as a line")
    chosen = parser.parse_args()
    seeds = range(chosen.first_seed, chosen.first_seed + chosen.recordings)
    rows: list[dict[str, Any]] = []
    kept = chosen.json.open("w", encoding="utf-8") if chosen.json else nullcontext()
    with kept as file, ProcessPoolExecutor(chosen.workers) as pool:
        for part in pool.map(study, seeds):
            rows += part
            if file is not None:
                file.writelines(json.dumps(row, default=float) + "\n" for row in part)
                file.flush()
    for line in summary(rows):
        print(json.dumps(line))


if __name__ == "__main__":
    main()
