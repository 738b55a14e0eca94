"""How often the stated intervals hold the truth: whole runs on simulated gears and benches that nobody looked at.

    python -m tests.benchmarks.coverage_study --population wide --first-seed 9000 --seeds 8 --rows rows.jsonl --json

Each seed is a gear and a bench of their own and one run of every kind, each at a speed and a rate
drawn by the seed. What is found is kept as it comes, one line of JSON per run and per number; seeds
that stand in the file of rows are not run again, so that a study goes on where it was cut off.
How it is made and what its columns mean: docs/explanation/coverage.md.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from experiments.finding import Severity
from tests.benchmarks.coverage_table import pooled, table
from tests.benchmarks.cramer_rao import information_bounds
from tests.benchmarks.rows_file import Line, add_rows, code_commit, read_rows

KINDS = (
    "home",
    "warm-up",
    "motor-tare",
    "friction",
    "kinematic-error",
    "velocity-steps",
    "starting-torque",
)
"""In the order in which one seed runs them: the tare before what takes it."""
RATES = {"velocity-steps": (1000.0, 625.0)}
OTHER_RATES = (1000.0, 250.0)
"""Hz; one is drawn per run."""
SHORT: Mapping[str, Mapping[str, Any]] = {
    "motor-tare": {"points": 12},
    "friction": {"points": 12},
}
"""What is shortened against the protocols' defaults."""
SPEEDS: Mapping[str, tuple[str, float, float]] = {
    "home": ("input_speed_rpm", 3.0, 12.0),
    "warm-up": ("speed_rpm", 300.0, 3000.0),
    "motor-tare": ("highest_rpm", 1500.0, 3000.0),
    "friction": ("highest_rpm", 1500.0, 3000.0),
    "kinematic-error": ("speed_rpm", 20.0, 120.0),
    "velocity-steps": ("speeds_rpm", 60.0, 3000.0),
    "starting-torque": ("approach_rpm", 10.0, 30.0),
}
"""The parameter whose speed is drawn, log-uniform between two values [r/min]."""
TRIES = 6
"""Speeds that are drawn until the plan accepts one."""
FAILED = ("ABORTED", "TRIPPED", "ERROR", "INTERRUPTED")
"""Outcomes of a run that did not come to its end."""


@dataclass(frozen=True, kw_only=True)
class Study:
    """What is studied: which gears, which kinds, and the speeds to draw from (none: the ranges above); or each protocol
    as it is, nothing shortened and nothing drawn.
    """

    population: str
    kinds: tuple[str, ...]
    speeds: tuple[float, ...]
    commit: str
    is_whole: bool = False

    @property
    def key(self) -> Line:
        """What two lines of one study have in common."""
        return {
            "commit": self.commit,
            "population": self.population,
            "speeds": ["as planned"] if self.is_whole else list(self.speeds),
        }


@dataclass(frozen=True)
class Setting:
    """How one run is made: SYNC rate [Hz] and the parameters that are not the protocol's own."""

    rate: float
    values: Mapping[str, Any]


def settings_of(seed: int, kind: str, study: Study) -> Iterator[Setting]:
    """The rate that a seed draws for a kind, with one speed after the other; a protocol as it is has one setting."""
    from sim_backend.streams import stream

    random = stream(seed, f"study {kind}")
    rate = float(random.choice(RATES.get(kind, OTHER_RATES)))
    name, low, high = SPEEDS[kind]
    speeds = study.speeds
    if study.is_whole:
        yield Setting(rate, {})
        return
    while True:
        drawn = (
            float(random.choice(speeds)) if speeds else low * (high / low) ** float(random.random())
        )
        speed = round(drawn, 2)
        value = (speed,) if name.endswith("speeds_rpm") else speed
        yield Setting(rate, {**SHORT.get(kind, {}), name: value})


def run_seed(seed: int, study: Study) -> list[Line]:
    """Every kind on the gear and the bench of one seed: a line per run and per number whose truth is known."""
    lines: list[Line] = []
    with tempfile.TemporaryDirectory() as folder:
        tare: Path | None = None
        wanted = [k for k in KINDS if k in study.kinds]
        if "friction" in wanted and "motor-tare" not in wanted:
            wanted.insert(0, "motor-tare")
        for number, kind in enumerate(wanted, start=1):
            start = time.process_time()
            # A folder each: a trip is latched in its folder, and the next kind is another run.
            try:
                path, run, numbers = _one_run(seed, kind, number, Path(folder) / kind, tare, study)
            except Exception as error:  # noqa: BLE001
                # A defect of the program is a row like another: the other seeds do not fall with it.
                crash = {"outcome": "crashed", "words": repr(error), "refusals": []}
                path, run, numbers = None, crash, []
            if kind == "motor-tare":
                tare = path
            if kind not in study.kinds:
                continue
            head = {**study.key, "seed": seed, "kind": kind}
            seconds = round(time.process_time() - start, 2)
            lines.append({"what": "run", **head, "seconds": seconds, **run})
            lines += [{"what": "number", **head, **n} for n in numbers]
    return lines


def _one_run(
    seed: int, kind: str, number: int, folder: Path, tare: Path | None, study: Study
) -> tuple[Path | None, Line, list[Line]]:
    """One run and its analysis: where it lies, what it came to, its numbers beside the truth."""
    from experiments.errors import AnalysisError, PlanError
    from model.errors import ModelError
    from rig.errors import RigError
    from rig.run.start import plan_order, run_order

    run: Line = {"refusals": []}
    settings = settings_of(seed, kind, study)
    planned = request = None
    while planned is None and len(run["refusals"]) < TRIES:
        if (setting := next(settings, None)) is None:
            break
        run |= {"rate": setting.rate, "values": dict(setting.values)}
        request = request_of(seed, kind, number, folder, study.population, setting)
        try:
            planned = plan_order(request)
        except (PlanError, ModelError, RigError) as refusal:
            run["refusals"].append(str(refusal))
    if planned is None or request is None:
        return None, {**run, "outcome": "not planned", "words": run["refusals"][-1]}, []
    report = run_order(request, planned)
    if not report.safe or report.outcome in FAILED:
        return None, {**run, "outcome": "failed", "words": report.message}, []
    path = Path(report.path)
    run["bounds"] = _bounds(path, kind)
    try:
        fit = _fitted(path, tare if planned.experiment.takes_tare else None)
    except (AnalysisError, ModelError, RigError) as refusal:
        return path, {**run, "outcome": "refused", "words": str(refusal)}, []
    unchecked = [
        c.what for c in fit.result.checks if c.is_evidence and c.severity is Severity.NOT_LOOKED_AT
    ]
    subject = str(fit.result.options.get("torque_is_of", ""))
    run |= {"outcome": "analysed", "words": "", "unchecked": unchecked, "subject": subject}
    return path, run, list(_numbers(fit))


def request_of(
    seed: int, kind: str, number: int, folder: Path, population: str, setting: Setting
) -> Any:
    """What is asked of the simulated rig: a run of this kind on the gear and the bench of a seed."""
    from model.gear_file import shipped_gear
    from model.motor import shipped_motor
    from rig.bench.backends.order import AMBIENT, Order, WorldChoice
    from sim_backend.world import LARGEST, mixed

    return Order(
        protocol=kind,
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=folder,
        values=setting.values,
        serial=f"S{seed}",
        seed=seed,
        sample_rate=setting.rate,
        world=WorldChoice(
            gear_seed=mixed("study gear", seed) & LARGEST,
            bench_seed=mixed("study bench", seed) & LARGEST,
            population=population,  # type: ignore[arg-type]
            number=number,
            start_state=AMBIENT,
        ),
    )


def _fitted(path: Path, tare: Path | None) -> Any:
    from tests.rig.fitting import fit_files

    (fit,) = fit_files([path], tare=tare)
    return fit


def _bounds(path: Path, kind: str) -> dict[str, float]:
    """The least standard deviations (type A) that the information in this run allows, by quantity."""
    from rig.runfile.read import open_run

    return information_bounds(open_run(path), kind)


def _numbers(fit: Any) -> Iterator[Line]:
    """Each estimate whose truth the rig knows."""
    from experiments.truth import truth_of, truth_rows

    truth = truth_of(fit.recording.metadata.process)
    for row in truth_rows(fit.result, truth):
        e = row.estimate
        quantity = fit.result.quantity(e.name)
        shared = [line.standard_uncertainty for line in e.budget if line.kind == "B"]
        yield {
            "quantity": e.name,
            "called": e.identifiable,
            "value": e.value,
            "low": e.low,
            "high": e.high,
            "expanded": e.expanded_uncertainty,
            "factor": e.coverage_factor,
            "unit": e.unit,
            "type_b": math.hypot(*shared),
            "seen": row.seen,
            "true": row.measurand,
            "target": quantity.target_for(e.value, e.unit),
            "is_share": quantity.target_share is not None,
            "is_circular": quantity.is_circular,
        }


# --- The command ---------------------------------------------------------------------------------


def conducted(
    study: Study, seeds: Sequence[int], workers: int, rows: Path | None
) -> Iterator[list[Line]]:
    """The lines of each seed as it is done; a seed is written to `rows` in one piece."""
    with ProcessPoolExecutor(workers) as pool:
        waiting = {pool.submit(run_seed, seed, study): seed for seed in seeds}
        for done, future in enumerate(as_completed(waiting), 1):
            lines = future.result()
            add_rows(rows, lines)
            print(f"\r{done}/{len(seeds)}", end="", file=sys.stderr, flush=True)
            yield lines
    print(file=sys.stderr)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study, or what is missing of it, and print its table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--population", choices=("narrow", "wide"), default="wide")
    parser.add_argument("--first-seed", type=int, required=True)
    parser.add_argument("--seeds", type=int, required=True)
    parser.add_argument("--kinds", default="all", help="all, or names with commas")
    parser.add_argument("--speeds", default="", help="r/min with commas, to draw from")
    parser.add_argument("--whole", action="store_true", help="each protocol as it is planned")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--rows", type=Path, help="file of JSON lines to which every seed is added")
    parser.add_argument("--uncommitted", action="store_true")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    kinds = KINDS if options.kinds == "all" else tuple(options.kinds.split(","))
    unknown = [kind for kind in kinds if kind not in KINDS]
    if unknown:
        parser.error(f"no such kind: {', '.join(unknown)}; there are {', '.join(KINDS)}")
    study = Study(
        population=options.population,
        kinds=kinds,
        speeds=tuple(float(s) for s in options.speeds.split(",") if s),
        commit=code_commit(uncommitted=options.uncommitted),
        is_whole=options.whole,
    )
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    lines = [
        line
        for line in read_rows(options.rows, study.key)
        if line["seed"] in seeds and line["kind"] in kinds
    ]
    have: dict[int, set[str]] = defaultdict(set)
    for line in lines:
        have[line["seed"]].add(line["kind"])
    missing = [seed for seed in seeds if not have[seed] >= set(kinds)]
    lines = [line for line in lines if line["seed"] not in missing]
    for found in conducted(study, missing, options.workers, options.rows):
        lines += found
    answer = {
        "commit": study.commit,
        "first_seed": options.first_seed,
        "rows": table(lines),
        "pooled": pooled(lines),
    }
    if options.json:
        print(json.dumps(answer))
    else:
        print_table(answer["rows"], lines)
        print(json.dumps(answer["pooled"]))
    return 0


def print_table(rows: Sequence[Line], lines: Iterable[Line]) -> None:
    """The table as the documentation keeps it, and what came of the runs."""
    names = list(rows[0]) if rows else []
    print("| " + " | ".join(names) + " |\n|" + "---|" * len(names))
    for row in rows:
        print("| " + " | ".join("" if v is None else str(v) for v in row.values()) + " |")
    for line in lines:
        if line["what"] == "run" and line["outcome"] != "analysed":
            print(f"{line['kind']}, seed {line['seed']}: {line['outcome']}: {line['words']}")


if __name__ == "__main__":
    raise SystemExit(main())
