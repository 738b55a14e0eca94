"""Imports of which something is not said: whether a number that rests on it is called sure all the same.

    python -m tests.benchmarks.unsaid_study --first-seed 100 --recordings 10 --rows unsaid.jsonl

Each seed is a recording by arithmetic of the study's own (`unsaid_cases`), written to a file, imported as a person
imports it, with one pattern of what nobody said (encoders, torque scale, zero, ratio, rate, inertia, thermometer,
temperature, everything, nothing), and analysed. Counted are the numbers called "yes" that lie beyond 1.5 U from the
truth, and of those the ones that rest on what was not said. Every recording is a line of JSON, appended as it comes.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from experiments.errors import AnalysisError
from model.errors import ModelError
from model.identify.estimate import Estimate
from rig.errors import RigError
from tests.benchmarks.rows_file import Line, add_rows, code_commit, read_rows
from tests.benchmarks.unsaid_cases import Foreign, made

BEYOND = 1.5
"""U from the truth beyond which a number is wrong."""
ALLOWED = 0.01
NEAR = 0.02
"""Of an order, within which a line of a spectrum is that order."""


def imported(foreign: Foreign, folder: Path) -> Path:
    """The run file of a recording, imported with what is said of it."""
    from rig.runfile.importing.channel_map import ForeignSegment, ImportOptions
    from rig.runfile.importing.channel_source import ChannelSource
    from rig.runfile.importing.convert import import_tables
    from rig.runfile.importing.opening import open_tables

    path = folder / "foreign.npz"
    columns = {name: values for name, (values, _) in foreign.columns.items()}
    options: dict[str, Any] = dict(foreign.options)
    channels = [
        ChannelSource(name=name, column=name, unit=unit, **foreign.said.get(name, {}))
        for name, (_, unit) in foreign.columns.items()
    ]
    if foreign.kind == "friction-curve":
        options["no_time"] = True
    elif math.isfinite(foreign.rate):
        options["rate"] = foreign.rate
    else:
        columns["time"] = foreign.time
        channels.insert(0, ChannelSource(name="time", column="time", unit="s"))
    np.savez(path, **columns)
    options["segments"] = tuple(ForeignSegment(**s) for s in options.get("segments", ()))
    tables = open_tables("npz", [path])
    made_of = ImportOptions(channels=tuple(channels), **options)
    return import_tables(tables, made_of, lambda: folder / "00001-import-x.h5").path


def case_of(seed: int, commit: str) -> Line:
    """One recording analysed: its numbers beside the truth, and which of them rest on what was not said."""
    from rig.analysis.fit.run import Choices, fit_run

    began = time.process_time()
    foreign, pattern = made(seed)
    line: Line = {"what": "recording", "commit": commit, "seed": seed}
    line |= {"kind": foreign.kind, "unsaid": pattern}
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = imported(foreign, Path(folder))
            fit = fit_run(path, foreign.kind, Choices(settings=foreign.settings))
    except (AnalysisError, ModelError, RigError) as refusal:
        line |= {"outcome": "refused", "words": str(refusal), "numbers": []}
    except Exception as error:  # noqa: BLE001
        # A defect of the program is a row like another: the other recordings do not fall with it.
        line |= {"outcome": "crashed", "words": repr(error), "numbers": []}
    else:
        numbers = [
            {
                "quantity": name,
                "true": float(true),
                "value": e.value,
                "expanded": e.expanded_uncertainty,
                "called": e.identifiable,
                "rests": name.startswith(foreign.leans.get(pattern, ())),
            }
            for name, true in foreign.truth.items()
            if (e := _named(fit.result.estimates, name)) is not None
        ]
        line |= {"outcome": "analysed", "words": "", "numbers": numbers}
    return line | {"seconds": round(time.process_time() - began, 2)}


def _named(estimates: Mapping[str, Estimate], name: str) -> Estimate | None:
    """The estimate of this name; of a whole spectrum, in which orders are found, the one nearest to it."""
    if name in estimates or not name.startswith("spectrum_"):
        return estimates.get(name)
    order = float(name.removeprefix("spectrum_"))
    orders = {float(n.rpartition("_")[2]): e for n, e in estimates.items() if "amplitude_" in n}
    near = min(orders, key=lambda other: abs(other - order), default=math.inf)
    return orders[near] if abs(near - order) <= NEAR * order else None


def summary(lines: Iterable[Line]) -> Line:
    """By kind and pattern: numbers, "yes", of those beyond U and beyond 1.5 U; and each that is beyond."""
    lines = list(lines)
    groups: dict[tuple[str, str], list[Line]] = defaultdict(list)
    outcomes: dict[tuple[str, str], list[str]] = defaultdict(list)
    wrong: list[str] = []
    on_unsaid = 0
    for line in lines:
        key = line["kind"], line["unsaid"]
        outcomes[key].append(line["outcome"])
        for n in line["numbers"]:
            groups[key].append(n)
            if n["called"] == "yes" and _away(n) > BEYOND:
                on_unsaid += n["rests"]
                rests = " (rests on what was not said)" if n["rests"] else ""
                wrong.append(
                    f"{line['kind']}, {line['unsaid']} not said, seed {line['seed']}: {n['quantity']} "
                    f"{n['value']:.4g} for {n['true']:.4g}, {_away(n):.1f} U{rests}"
                )
    rows = []
    for key in sorted(outcomes):
        yes = [n for n in groups[key] if n["called"] == "yes"]
        rows.append(
            {
                "kind": key[0],
                "unsaid": key[1],
                "recordings": len(outcomes[key]),
                "refused": outcomes[key].count("refused"),
                "crashed": outcomes[key].count("crashed"),
                "numbers": len(groups[key]),
                "yes": len(yes),
                "beyond_u": int(sum(_away(n) > 1.0 for n in yes)),
                "beyond_1_5_u": int(sum(_away(n) > BEYOND for n in yes)),
            }
        )
    said_yes = sum(row["yes"] for row in rows)
    return {
        "rows": rows,
        "recordings": len(lines),
        "yes": said_yes,
        "wrong": wrong,
        "allowed": math.floor(ALLOWED * said_yes),
        "wrong_on_what_was_not_said": on_unsaid,
    }


def _away(number: Line) -> float:
    """The error in U."""
    return float(abs(number["value"] - number["true"]) / max(number["expanded"], 1e-300))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing, print what came of it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--first-seed", type=int, required=True)
    parser.add_argument("--recordings", type=int, required=True)
    parser.add_argument("--rows", type=Path, help="file of JSON lines to which each is added")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--uncommitted", action="store_true")
    options = parser.parse_args(arguments)
    commit = code_commit(uncommitted=options.uncommitted)
    seeds = range(options.first_seed, options.first_seed + options.recordings)
    lines = [
        line
        for line in read_rows(options.rows, {"commit": commit, "what": "recording"})
        if line["seed"] in seeds
    ]
    done = {line["seed"] for line in lines}
    missing = [seed for seed in seeds if seed not in done]
    with ProcessPoolExecutor(options.workers) as pool:
        for line in pool.map(case_of, missing, [commit] * len(missing)):
            add_rows(options.rows, [line])
            lines.append(line)
            print(f"{line['seed']} {line['kind']}: {line['outcome']}", file=sys.stderr, flush=True)
    print(json.dumps(summary(lines), indent=1))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
