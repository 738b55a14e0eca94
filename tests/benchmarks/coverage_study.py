"""How often the 95 % intervals hold the truth: short runs on many simulated gears with every imperfection on.

    python -m tests.benchmarks.coverage_study --seeds 200 --workers 2

Prints, per quantity and pooled, the share of seeds whose interval covers the truth and the mean
width over the scatter that really occurred (an honest interval is about 3.92 standard deviations
wide).
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

KINDS = ("friction", "kinematic-error")
SHORT: dict[str, dict[str, Any]] = {
    "motor-tare": {"points": 12},
    "friction": {"points": 12},
    "kinematic-error": {"speed_rpm": 61.8},
}
"""What is shortened against the protocols' defaults."""

COMPOSITE = ("transmission_accuracy", "running_torque")
"""Shown, but not pooled: made of the separable quantities, or of gear and encoder together."""

Row = tuple[str, str, float, float, float, float, float]
"""kind, quantity, found, low, high, truth, difference."""


def one_seed(seed: int) -> list[Row]:
    """Tare, friction and kinematic error of one gear on one rig; every estimate whose truth is known."""
    from experiments.truth import truth_of, truth_rows
    from model.gear_file import shipped_gear
    from model.motor import shipped_motor
    from rig.analysis.fit import fit_files
    from rig.run.start import RunRequest, run_request

    found: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        gear, motor, paths = shipped_gear(), shipped_motor(), {}
        for protocol, values in SHORT.items():
            request = RunRequest(
                protocol=protocol,
                gear=gear,
                motor=motor,
                output=Path(folder),
                values=values,
                gear_serial=f"S{seed}",
                seed=seed,
            )
            paths[protocol] = Path(run_request(request, judged=False).path)
        for kind in KINDS:
            tare = paths["motor-tare"] if kind == "friction" else None
            (fit,) = fit_files([paths[kind]], tare=tare)
            truth = truth_of(fit.recording.metadata.process)
            for row in truth_rows(fit.result, truth):
                e = row.estimate
                found.append(
                    (kind, e.name, e.value, e.low, e.high, e.value - row.difference, row.difference)
                )
    return found


def summarise(rows: list[Row], seeds: int) -> bool:
    """Print the table; True if each pooled share lies within 92 to 98 %."""
    grouped: dict[tuple[str, str], list[Row]] = defaultdict(list)
    for row in rows:
        grouped[row[0], row[1]].append(row)
    print(
        f"| kind | quantity | seeds | covered | mean width / (3.92 scatter) |\n|---|---|---|---|---|  ({seeds} seeds)"
    )
    pooled: dict[str, list[bool]] = defaultdict(list)
    for (kind, name), group in sorted(grouped.items()):
        hits = [
            low <= value - difference <= high for _, _, value, low, high, _, difference in group
        ]
        if not name.startswith(COMPOSITE):
            pooled[kind] += hits
        scatter = math.sqrt(sum(r[6] ** 2 for r in group) / len(group))
        width = sum(r[4] - r[3] for r in group) / len(group)
        ratio = width / (3.92 * scatter) if scatter else math.inf
        print(
            f"| {kind} | {name} | {len(group)} | {100.0 * sum(hits) / len(hits):.1f} % | {ratio:.2f} |"
        )
    fine = True
    for kind, hits in pooled.items():
        share = 100.0 * sum(hits) / len(hits)
        fine &= 92.0 <= share <= 98.0
        print(f"| {kind} | pooled | {len(hits)} | {share:.1f} % | |")
    return fine


def main() -> int:
    """Run the study; exit code 0 if the pooled coverage is honest."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--first", type=int, default=1000)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    rows: list[Row] = []
    with ProcessPoolExecutor(options.workers) as pool:
        for done, found in enumerate(
            pool.map(one_seed, range(options.first, options.first + options.seeds)), 1
        ):
            rows += found
            print(f"\r{done}/{options.seeds}", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return 0 if summarise(rows, options.seeds) else 1


if __name__ == "__main__":
    raise SystemExit(main())
