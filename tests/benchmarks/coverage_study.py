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
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tests.benchmarks.cramer_rao import information_bounds

Line = dict[str, Any]
"""One line of the file of rows: what a run came to, or one number of its result beside the truth."""

KINDS = (
    "home",
    "warm-up",
    "motor-tare",
    "friction",
    "kinematic-error",
    "velocity-steps",
    "starting-torque",
)
"""Every protocol, in the order in which one seed runs them: the tare before what takes it."""
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
SAMPLING_CHECKS = ("sampling of the resonance", "count lattice")
"""Checks that refuse what the sampling cannot tell (orders and resonances above 0.4 of the rate):
no missing answer."""
FULL_TURN = 2.0 * math.pi


@dataclass(frozen=True, kw_only=True)
class Study:
    """What is studied: which gears, which kinds, and the speeds to draw from (none: the ranges above)."""

    population: str
    kinds: tuple[str, ...]
    speeds: tuple[float, ...]
    commit: str

    @property
    def key(self) -> Line:
        """What two lines of one study have in common."""
        return {
            "commit": self.commit,
            "population": self.population,
            "speeds": list(self.speeds),
        }


@dataclass(frozen=True)
class Setting:
    """How one run is made: SYNC rate [Hz] and the parameters that are not the protocol's own."""

    rate: float
    values: Mapping[str, Any]


def settings_of(seed: int, kind: str, speeds: Sequence[float]) -> Iterator[Setting]:
    """The rate that a seed draws for a kind, with one speed after the other."""
    from sim_backend.streams import stream

    random = stream(seed, f"study {kind}")
    rate = float(random.choice(RATES.get(kind, OTHER_RATES)))
    name, low, high = SPEEDS[kind]
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
    from rig.run.start import plan_request, run_request

    run: Line = {"refusals": []}
    settings = settings_of(seed, kind, study.speeds)
    planned = request = None
    while planned is None and len(run["refusals"]) < TRIES:
        setting = next(settings)
        run |= {"rate": setting.rate, "values": dict(setting.values)}
        request = _request(seed, kind, number, folder, study, setting)
        try:
            planned = plan_request(request)
        except (PlanError, ModelError, RigError) as refusal:
            run["refusals"].append(str(refusal))
    if planned is None or request is None:
        return None, {**run, "outcome": "not planned", "words": run["refusals"][-1]}, []
    report = run_request(request, planned)
    if not report.safe or report.outcome in FAILED:
        return None, {**run, "outcome": "failed", "words": report.message}, []
    path = Path(report.path)
    run["bounds"] = _bounds(path, kind)
    try:
        fit = _fitted(path, tare if planned.experiment.takes_tare else None)
    except (AnalysisError, ModelError, RigError) as refusal:
        return path, {**run, "outcome": "refused", "words": str(refusal)}, []
    return path, {**run, "outcome": "analysed", "words": ""}, list(_numbers(fit))


def _request(
    seed: int, kind: str, number: int, folder: Path, study: Study, setting: Setting
) -> Any:
    from model.gear_file import shipped_gear
    from model.motor import shipped_motor
    from rig.bench.backends.assembly import AMBIENT, WorldChoice
    from rig.run.start import RunRequest
    from sim_backend.world import LARGEST, mixed

    return RunRequest(
        protocol=kind,
        gear=shipped_gear(),
        motor=shipped_motor(),
        output=folder,
        values=setting.values,
        gear_serial=f"S{seed}",
        seed=seed,
        sample_rate=setting.rate,
        world=WorldChoice(
            gear_seed=mixed("study gear", seed) & LARGEST,
            bench_seed=mixed("study bench", seed) & LARGEST,
            population=study.population,  # type: ignore[arg-type]
            number=number,
            start_state=AMBIENT,
        ),
    )


def _fitted(path: Path, tare: Path | None) -> Any:
    from rig.analysis.fit_run import fit_files

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
            "type_b": math.hypot(*shared),
            "seen": row.seen,
            "true": row.measurand,
            "target": quantity.target_for(e.value, e.unit),
            "is_share": quantity.target_share is not None,
            "is_circular": quantity.is_circular,
        }


# --- The table -----------------------------------------------------------------------------------


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
        return row | {f"covered_{name}": None for name in empty} | dict.fromkeys(_RATIOS)
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
    return row | {
        "covered_statistical": round(float(np.mean(held)), 4),
        "covered_expanded": round(float(np.mean(within)), 4),
        **dict(zip(_RATIOS, finite, strict=True)),
    }


_RATIOS = ("width_ratio", "expanded_ratio", "bias_over_u")


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


# --- The command ---------------------------------------------------------------------------------


def code_commit(*, uncommitted: bool) -> str:
    """The commit of the code; `SystemExit` where files differ from it, unless that is allowed (then "+" is added)."""
    root = Path(__file__).resolve().parents[2]

    def git(*words: str) -> str:
        done = subprocess.run(
            ["git", "-C", str(root), *words], capture_output=True, text=True, check=True
        )
        return done.stdout.strip()

    changed = git("status", "--porcelain")
    if changed and not uncommitted:
        raise SystemExit(
            f"The code has uncommitted changes; commit them, or say --uncommitted:\n{changed}"
        )
    return git("rev-parse", "HEAD") + ("+" if changed else "")


def read_rows(path: Path | None, study: Study) -> list[Line]:
    """The lines of this study in a file of rows; a line that was cut off while it was written is left out."""
    if path is None or not path.exists():
        return []
    lines = []
    for text in path.read_text(encoding="utf-8").splitlines():
        try:
            line = json.loads(text)
        except ValueError:
            continue
        if all(line.get(name) == value for name, value in study.key.items()):
            lines.append(line)
    return lines


def conducted(
    study: Study, seeds: Sequence[int], workers: int, rows: Path | None
) -> Iterator[list[Line]]:
    """The lines of each seed as it is done; a seed is written to `rows` in one piece."""
    with ProcessPoolExecutor(workers) as pool:
        waiting = {pool.submit(run_seed, seed, study): seed for seed in seeds}
        for done, future in enumerate(as_completed(waiting), 1):
            lines = future.result()
            if rows is not None:
                with rows.open("a", encoding="utf-8") as file:
                    file.write("".join(json.dumps(line) + "\n" for line in lines))
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
    )
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    lines = [
        line
        for line in read_rows(options.rows, study)
        if line["seed"] in seeds and line["kind"] in kinds
    ]
    have: dict[int, set[str]] = defaultdict(set)
    for line in lines:
        have[line["seed"]].add(line["kind"])
    missing = [seed for seed in seeds if not have[seed] >= set(kinds)]
    lines = [line for line in lines if line["seed"] not in missing]
    for found in conducted(study, missing, options.workers, options.rows):
        lines += found
    answer = {"commit": study.commit, "first_seed": options.first_seed, "rows": table(lines)}
    if options.json:
        print(json.dumps(answer))
    else:
        print_table(answer["rows"], lines)
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
