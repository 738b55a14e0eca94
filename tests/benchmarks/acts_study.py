"""Broken recordings beside their unbroken twins: which acts make a number wrong that is called "yes" all the same.

    python -m tests.benchmarks.acts_study --seeds 100,101 --rows acts.jsonl

Each seed is a wide gear on a wide bench with three tares of its motor and a run of each kind that the
list names (`acts_list`). Each act is done to a copy, and both are analysed. A case is missed where a
number is "yes" in both and the two lie apart by more than U of the broken one. Every case is a line of
JSON, appended as it comes; a case that stands in the file is not run again.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from experiments import catalogue
from experiments.contract import Evidence
from experiments.errors import AnalysisError
from experiments.recording import Recording
from experiments.result import Result
from model.errors import ModelError
from tests.adversarial.acts import Honest, in_memory
from tests.benchmarks.acts_list import REFUSED_BY_0_2_0, SEEN, UNSEEN, Listed
from tests.benchmarks.rows_file import Line, add_rows, code_commit, read_rows

PLANS: Mapping[str, Mapping[str, Any]] = {
    "motor-tare": {"points": 8},
    "friction": {"points": 8},
    "kinematic-error": {},
    "velocity-steps": {"speeds_rpm": (300.0, 1200.0, 1800.0), "repeats": 1},
    "starting-torque": {},
    "warm-up": {},
    "home": {},
}
"""What is changed of each protocol's own parameters: a run that is long enough to tell, and no longer."""
TARES = 3
ALLOWED = 7 / 360
"""Share of the cases that may be missed."""


class Rig:
    """The honest runs of one seed, each made when it is first asked for, with what they are analysed with."""

    def __init__(self, seed: int, folder: Path) -> None:
        self._seed, self._folder, self._number = seed, folder, 0
        self._runs: dict[str, Recording] = {}
        self._tares: list[tuple[Recording, Result]] = []

    def honest(self, kind: str) -> Honest:
        """The honest run of a kind. Raises `AnalysisError` where it did not come to its end."""
        tares = (
            self._with_tares() if kind == "motor-tare" or catalogue.load(kind).takes_tare else []
        )
        if kind == "motor-tare":
            recording = tares[0][0]
        else:
            if kind not in self._runs:
                self._runs[kind] = self._run(kind)
            recording = self._runs[kind]
        evidence = Evidence(_gear(recording))
        if tares:
            others = tuple(result for _, result in tares[1:])
            evidence = dataclasses.replace(evidence, other_tares=others)
        if catalogue.load(kind).takes_tare:
            first, result = tares[0]
            evidence = dataclasses.replace(evidence, tare=result, tare_recording=first)
        return Honest(kind, recording, evidence)

    def _with_tares(self) -> list[tuple[Recording, Result]]:
        while len(self._tares) < TARES:
            tare = self._run("motor-tare")
            result = catalogue.load("motor-tare").analyse(tare, Evidence(_gear(tare)))
            self._tares.append((tare, result))
        return self._tares

    def _run(self, kind: str) -> Recording:
        from rig.run.start import run_order
        from rig.runfile.read import close_recording, open_run
        from tests.benchmarks.coverage_study import FAILED, Setting, request_of

        self._number += 1
        # A folder each: a trip is latched in its folder, and the next run is another one.
        folder = self._folder / str(self._number)
        setting = Setting(1000.0, PLANS[kind])
        report = run_order(request_of(self._seed, kind, self._number, folder, "wide", setting))
        if report.outcome in FAILED:
            raise AnalysisError(f"the honest run ended as {report.outcome}: {report.message}")
        recording = open_run(report.path)
        try:
            return in_memory(recording)
        finally:
            close_recording(recording)


def _gear(recording: Recording) -> Any:
    assert recording.metadata.gear is not None
    return recording.metadata.gear


def cases_of(seed: int, listed: Sequence[Listed], commit: str) -> Iterator[Line]:
    """What each act came to on one seed."""
    with tempfile.TemporaryDirectory() as folder:
        rig = Rig(seed, Path(folder))
        twins: dict[str, Result | str] = {}
        for one in listed:
            began = time.process_time()
            line: Line = {"what": "act", "commit": commit, "seed": seed, "act": one.name}
            line |= {"counts": not one.unseen}
            try:
                line |= _case(one, rig, twins)
            except Exception as error:  # noqa: BLE001
                # A defect of the program is a row like another: the other acts do not fall with it.
                line |= {"outcome": "crashed", "words": repr(error)}
            yield line | {"seconds": round(time.process_time() - began, 2)}


def _case(one: Listed, rig: Rig, twins: dict[str, Result | str]) -> Line:
    if one.kind not in twins:
        try:
            twins[one.kind] = _analysed(rig.honest(one.kind))
        except (AnalysisError, ModelError) as refusal:
            twins[one.kind] = str(refusal)
    twin = twins[one.kind]
    if isinstance(twin, str):
        return {"outcome": "no honest run", "words": twin}
    try:
        broken = _analysed(one.act(rig.honest(one.kind)))
    except (AnalysisError, ModelError) as refusal:
        return {"outcome": "refused", "words": str(refusal)}
    missed = [number for number in compared(twin, broken) if number["is_missed"]]
    said = [check.what for check in broken.checks if check.severity == "notes"]
    before = [check.what for check in twin.checks if check.severity == "notes"]
    new = sorted(set(said) - set(before))
    return {
        "outcome": "missed" if missed else "said" if new else "harmless",
        "words": ", ".join(new),
        "missed": missed,
        "yes": [
            sum(e.identifiable == "yes" for e in of.estimates.values()) for of in (twin, broken)
        ],
    }


def _analysed(honest: Honest) -> Result:
    return catalogue.load(honest.kind).analyse(honest.recording, honest.evidence)


def compared(twin: Result, broken: Result) -> Iterator[Line]:
    """Each number that is "yes" in both: how far apart, by U of the broken one."""
    for name, after in broken.estimates.items():
        before = twin.estimates.get(name)
        if before is None or (before.identifiable, after.identifiable) != ("yes", "yes"):
            continue
        apart = after.value - before.value
        if broken.quantity(name).is_circular:
            apart = math.remainder(apart, 2.0 * math.pi)
        u = after.expanded_uncertainty
        yield {
            "quantity": name,
            "twin": before.value,
            "broken": after.value,
            "expanded": u,
            "is_missed": abs(apart) > u,
        }


def summary(lines: Iterable[Line], refused_before: Iterable[str] = ()) -> Line:
    """How many cases came to what, each that was missed, and which of those refused before are refused no more."""
    counts: dict[str, dict[str, int]] = {"seen": {}, "unseen": {}}
    missed: list[str] = []
    no_more: list[str] = []
    before = set(refused_before)
    for line in lines:
        group = counts["seen" if line["counts"] else "unseen"]
        group[line["outcome"]] = group.get(line["outcome"], 0) + 1
        if line["outcome"] in ("missed", "crashed"):
            mark = "" if line["counts"] else " (unseen)"
            missed.append(f"{line['act']}, seed {line['seed']}{mark}: {_worst(line)}")
        if line["act"] in before and line["outcome"] not in ("refused", "no honest run"):
            no_more.append(f"{line['act']}, seed {line['seed']}: {line['outcome']} {line['words']}")
    cases = sum(counts["seen"].values()) - counts["seen"].get("no honest run", 0)
    return {
        "cases": cases,
        "allowed": math.floor(ALLOWED * cases),
        **counts,
        "missed": missed,
        "refused_no_more": no_more,
    }


def _worst(line: Line) -> str:
    if line["outcome"] == "crashed":
        return str(line["words"])
    numbers = sorted(line["missed"], key=lambda n: -abs(n["broken"] - n["twin"]) / n["expanded"])
    n = numbers[0]
    away = abs(n["broken"] - n["twin"]) / n["expanded"]
    return f"{n['quantity']} {n['twin']:.4g} becomes {n['broken']:.4g}, {away:.1f} U; {len(numbers)} numbers"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing, print what came of it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", required=True, help="with commas")
    parser.add_argument("--only", default="", help="acts whose name begins so")
    parser.add_argument("--rows", type=Path, help="file of JSON lines to which every case is added")
    parser.add_argument("--workers", type=int, default=1, help="processes, a seed each")
    parser.add_argument("--list", action="store_true", help="print the acts and run nothing")
    parser.add_argument("--uncommitted", action="store_true")
    options = parser.parse_args(arguments)
    listed = [one for one in (*SEEN, *UNSEEN) if one.name.startswith(options.only)]
    if options.list:
        for one in listed:
            print(one.name + (f" -- cannot be told: {one.unseen}" if one.unseen else ""))
        return 0
    commit = code_commit(uncommitted=options.uncommitted)
    seeds = [int(seed) for seed in options.seeds.split(",")]
    names = {one.name for one in listed}
    lines = [
        line
        for line in read_rows(options.rows, {"commit": commit, "what": "act"})
        if line["seed"] in seeds and line["act"] in names
    ]
    done = {(line["seed"], line["act"]) for line in lines}
    jobs = []
    for seed in seeds:
        missing = [one.name for one in listed if (seed, one.name) not in done]
        if missing:
            jobs.append((seed, missing, commit, options.rows))
    with ProcessPoolExecutor(options.workers) as pool:
        for found in pool.map(_job, jobs):
            lines += found
    print(json.dumps(summary(lines, REFUSED_BY_0_2_0), indent=1))
    return 0


def _job(job: tuple[int, list[str], str, Path | None]) -> list[Line]:
    """The missing acts of a seed; each is added to the file as it is done."""
    seed, names, commit, rows = job
    listed = [one for one in (*SEEN, *UNSEEN) if one.name in names]
    found: list[Line] = []
    for line in cases_of(seed, listed, commit):
        add_rows(rows, [line])
        found.append(line)
        print(f"{seed} {line['act']}: {line['outcome']}", file=sys.stderr, flush=True)
    return found


if __name__ == "__main__":
    raise SystemExit(main())
