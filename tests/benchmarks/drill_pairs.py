"""Pairs of faults at random, in numbers and resumable.

    python -m tests.benchmarks.drill_pairs --seed 4711 --pairs 1000 --to pairs.jsonl

The pairs are those of `rig sim drill --pairs N --seed S`. Of each three things are asked beside the program's own word
(standstill verified or not): the motor stands without power by the truth of the plant, the file can be read, and no
count stands in it wrong without a mark. For the last one every row before the first fault, and every row where
neither fault may do harm, is held against the run with nothing going wrong; the closure of the revolutions is held
against a run that completed. Each row is a line of `--to`, as it comes; a second call with the same file goes on
where the first was ended, and one without pairs left prints the summary. `--only 34,303` makes these again, `--known`
the six that docs/drills.md names.

Exit code 1 when a pair fails. A pair that software cannot mend is named as such, with the reason (`beyond_software`).
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rig.trial.drill.catalogue import every_drill
from rig.trial.drill.pairs import Pair, PairRow, drawn
from rig.trial.drill.rigs import CARRIERS, Carrier
from rig.trial.drill.staging import SPOILED, Placed, Staged
from rig.trial.drill.suite import Stage, stage

DEAF_DRIVE, NO_BUS = "quick stop and servo off not obeyed", ("bus lost", "bus off", "hub gone")


Known = tuple[int, Carrier, tuple[str, str], tuple[int, int]]
KNOWN: tuple[Known, ...] = (
    (34, "wire", ("TPDO lost for good", "no data for 0.4 s"), (2045, 2206)),
    (303, "wire", ("statusword fault, motor coasts", "no data for 0.4 s"), (1213, 1421)),
    (418, "sim", ("encoder stuck, output", "encoder count jump, output"), (1360, 1381)),
    (538, "wire", ("encoder stuck, output", "slip, output"), (1829, 1874)),
    (808, "wire", ("SDO time-out", "NMT STOPPED from outside"), (1474, 1839)),
    (882, "wire", (DEAF_DRIVE, "bus lost"), (1726, 1982)),
)
"""The six of docs/drills.md, by what they are: the list from which the numbers were drawn has grown since."""


def beyond_software(faults: Sequence[str]) -> str:
    """Why no software can stop the motor with these two faults; empty where it must."""
    if DEAF_DRIVE in faults and any(fault in NO_BUS for fault in faults):
        return "the drive obeys nothing, and then nobody can speak to it: only the emergency stop is left"
    return ""


def staged_pair(staged: Stage, pair: Pair) -> PairRow:
    """One pair run, its file held against the run with nothing going wrong as far as that may be asked."""
    reference = staged.reference(pair.carrier)
    if not all(drill.is_harmless for drill in pair.drills):
        first = min(pair.rows)
        counts = {name: counted[:first] for name, counted in reference.counts.items()}
        reference = replace(reference, counts=counts)
    staged.staged += 1
    ending = Staged(
        parts=tuple(map(Placed, pair.drills, pair.rows)),
        planned=staged.planned(pair.carrier),
        carrier=pair.carrier,
        seed=staged.seed,
        folder=staged.root / f"{pair.number:05d}",
        reference=reference,
        compares=True,
    ).run()
    return PairRow(pair=pair, ending=ending)


def row_of(row: PairRow, seed: int, seconds: float) -> dict[str, Any]:
    """A line of the table of results."""
    told = row.as_json()
    ending = row.ending
    return {
        **told,
        "seed": seed,
        "refused": ending.report is None,
        "wrong_counts": ending.marks.wrong,
        "spoiled": SPOILED in ending.causes,
        "beyond_software": beyond_software(told["faults"]),
        "seconds": round(seconds, 2),
    }


def failures_of(row: dict[str, Any]) -> list[str]:
    """What is not as it must be; empty where all is."""
    wrong = {
        "it turns, or has power": not row["safe"],
        "it stands, and the program could not say so": row["verdict"] == "SAFE AND NOT SAID",
        "the file cannot be read": not row["file_readable"],
        f"{row['wrong_counts']} wrong counts without a mark": bool(row["wrong_counts"]),
        "a run that lost a revolution counts as completed": row["spoiled"],
    }
    return [words for words, is_so in wrong.items() if is_so]


def run(numbers: Sequence[int], seed: int, backend: str | None) -> Iterator[dict[str, Any]]:
    """The pairs of these numbers, each on a rig of its own."""
    with stage(seed) as staged:
        length = len(staged.reference(CARRIERS[0]).counts["torque"])
        yield from run_pairs(
            staged, (drawn(number, seed, length, backend) for number in numbers), seed
        )


def run_known(seed: int) -> Iterator[dict[str, Any]]:
    """The six of the documentation."""
    with stage(seed) as staged:
        pairs = (
            Pair(number, carrier, (every_drill()[first], every_drill()[second]), rows)
            for number, carrier, (first, second), rows in KNOWN
        )
        yield from run_pairs(staged, pairs, seed)


def run_pairs(staged: Stage, pairs: Iterable[Pair], seed: int) -> Iterator[dict[str, Any]]:
    """A line for each."""
    for pair in pairs:
        begun = time.process_time()
        row = staged_pair(staged, pair)
        yield row_of(row, seed, time.process_time() - begun)


def read_rows(path: Path, seed: int) -> dict[int, dict[str, Any]]:
    """What was made of this seed before; a last line that was cut off is made again."""
    found: dict[int, dict[str, Any]] = {}
    for line in path.read_text().splitlines() if path.exists() else ():
        try:
            row = json.loads(line)
        except ValueError:
            continue
        if row["seed"] == seed:
            found[row["number"]] = row
    return found


def print_failures(rows: Sequence[dict[str, Any]]) -> int:
    """Name the pairs that fail, and count what came of all; how many failed that software could mend."""
    print("| by the plant's truth, and by the program's word | pairs |\n|---|---:|")
    for verdict, number in Counter(row["verdict"] for row in rows).most_common():
        print(f"| {verdict} | {number} |")
    failed = 0
    for row in rows:
        words = failures_of(row)
        if not words:
            continue
        failed += not row["beyond_software"]
        why = f" ({row['beyond_software']})" if row["beyond_software"] else ""
        faults = " + ".join(
            f"{fault} at {at}" for fault, at in zip(row["faults"], row["rows"], strict=True)
        )
        print(f"{row['number']} on {row['backend']}, {faults}: {'; '.join(words)}{why}")
        print(f"    {row['detected']}. {row['action']}. {row['message']}")
    print(
        f"{len(rows)} pairs, {sum(row['seconds'] for row in rows):.0f} s of processor time; {failed} failed"
    )
    return failed


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--pairs", type=int, default=1000)
    parser.add_argument("--backend", choices=CARRIERS)
    parser.add_argument("--to", type=Path, help="file that takes every row as a line")
    parser.add_argument("--known", action="store_true", help="the six that docs/drills.md names")
    parser.add_argument("--only", help="numbers of pairs that are made again, with commas")
    parser.add_argument("--seconds", type=float, help="no further pair is begun after so long")
    chosen = parser.parse_args()
    if chosen.known:
        return 1 if print_failures(list(run_known(chosen.seed))) else 0
    if chosen.only:
        numbers = [int(number) for number in chosen.only.split(",")]
        return 1 if print_failures(list(run(numbers, chosen.seed, chosen.backend))) else 0
    if chosen.to is None:
        parser.error("--to FILE takes the rows")
    rows = read_rows(chosen.to, chosen.seed)
    wanted = [number for number in range(chosen.pairs) if number not in rows]
    begun = time.monotonic()
    with chosen.to.open("a") as lines:
        for row in run(wanted, chosen.seed, chosen.backend) if wanted else ():
            rows[row["number"]] = row
            lines.write(json.dumps(row) + "\n")
            lines.flush()
            if chosen.seconds is not None and time.monotonic() - begun > chosen.seconds:
                break
    return 1 if print_failures([rows[number] for number in sorted(rows)]) else 0


if __name__ == "__main__":
    sys.exit(main())
