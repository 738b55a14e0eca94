"""Mutants drawn at random: each is put into a copy of the tree, and the tests that reach its line are run there.

    python -m tests.benchmarks.mutants --modules-from list.txt --seed 25 --count 60 --to mutants.jsonl [--processes 2]

`list.txt` names modules, a line each: paths or dotted names; a package stands for all that is in it. First the tests
are run once to see who reaches which line (`--tests`: which of them, all by default; kept in `--map`, and made anew
when a module has changed). Then each mutant: first the tests that reach its line, the quickest first, then the other
tests of every file that reaches its module. The first test that fails, and passes without the mutant, has killed it;
a time of `--factor` times what the tests take kills it too. Each mutant is a line of `--to`, as it comes; what stands
there is not tried again, so that a second call goes on; `--seconds` ends the first one in time. Prints each mutant
that survived with its lines; exit code 1 when there are any. A survivor is either a gap in the tests or says the same
as the original: that is for a person to see. What only a process of its own reaches is not noted: such a line counts
as not reached, and only the tests of its module's files are asked. Needs `coverage` (pip install coverage).
"""

from __future__ import annotations

import argparse
import json
import os
import queue
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from tests.benchmarks.mutants.draw import Mutant, drawn, modules_of
from tests.benchmarks.mutants.reach import reached
from tests.benchmarks.mutants.trial import Copy, tried


def read_rows(path: Path) -> dict[str, dict[str, Any]]:
    """What was tried before; a last line that was cut off is tried again."""
    found: dict[str, dict[str, Any]] = {}
    for line in path.read_text().splitlines() if path.exists() else ():
        try:
            row = json.loads(line)
        except ValueError:
            continue
        found[row["key"]] = row
    return found


def summary(rows: Sequence[dict[str, Any]]) -> int:
    """Print the survivors, and how many there are of each verdict; how many survived."""
    alive = [row for row in rows if not row["verdict"].startswith("killed")]
    for row in alive:
        asked = f"{row['tests']} tests that reach it, {row['other_tests']} beside them"
        asked += f"; {row['not_asked']} not asked for want of time" if row["not_asked"] else ""
        print(
            f"\n{row['verdict']}: {row['module']}:{row['line']} ({row['kind']}; {asked})\n{row['diff']}"
        )
    counts: dict[str, int] = {}
    for row in rows:
        counts[row["verdict"]] = counts.get(row["verdict"], 0) + 1
    told = ", ".join(f"{number} {verdict}" for verdict, number in sorted(counts.items()))
    print(
        f"\n{len(rows)} mutants: {told}; {sum(row['seconds'] for row in rows):.0f} s of wall time"
    )
    return len(alive)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--modules-from", type=Path, required=True, help="file with a module a line"
    )
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--to", type=Path, required=True, help="takes every mutant as a line")
    parser.add_argument("--map", type=Path, help="who reaches which line (default: beside --to)")
    parser.add_argument("--tests", nargs="*", default=["tests"], help="tests that are asked")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--seconds", type=float, help="no further mutant is begun after so long")
    parser.add_argument("--each", type=float, default=600.0, help="s of tests for one mutant")
    parser.add_argument("--factor", type=float, default=10.0, help="how much longer it may take")
    parser.add_argument("--list", action="store_true", help="only say what was drawn")
    return parser.parse_args()


def main() -> int:
    chosen = _arguments()
    root = Path.cwd()
    modules = modules_of(root, chosen.modules_from.read_text().splitlines())
    sources = {module: (root / module).read_text(encoding="utf-8") for module in modules}
    mutants = list(drawn(root, modules, chosen.count, chosen.seed))
    if chosen.list:
        for mutant in mutants:
            print(
                f"{mutant.module}:{mutant.line} ({mutant.kind})\n{mutant.diff(sources[mutant.module])}"
            )
        return 0
    begun = time.monotonic()
    where = chosen.map or chosen.to.with_suffix(".map.json")
    changed = sorted({mutant.module for mutant in mutants})
    reach = reached(root, changed, chosen.tests, where, chosen.processes)
    rows = read_rows(chosen.to)
    keys = {mutant.key(sources[mutant.module]): mutant for mutant in mutants}
    waiting = {key: mutant for key, mutant in keys.items() if key not in rows}
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder, chosen.to.open("a") as lines:
        copies: queue.Queue[Copy] = queue.Queue()
        for number in range(chosen.processes if waiting else 0):
            copies.put(Copy.of(root, Path(folder) / str(number)))

        def one(key: str, mutant: Mutant) -> None:
            if chosen.seconds is not None and time.monotonic() - begun > chosen.seconds:
                return
            copy = copies.get()
            try:
                row = tried(copy, mutant, sources[mutant.module], reach, chosen.each, chosen.factor)
            finally:
                copies.put(copy)
            rows[key] = {"key": key, "seed": chosen.seed, **row}
            lines.write(json.dumps(rows[key]) + "\n")
            lines.flush()
            print(
                f"{row['verdict']}: {mutant.module}:{mutant.line} ({mutant.kind})", file=sys.stderr
            )

        with ThreadPoolExecutor(chosen.processes) as pool:
            for done in [pool.submit(one, key, mutant) for key, mutant in waiting.items()]:
                done.result()
    return 1 if summary([rows[key] for key in keys if key in rows]) else 0


if __name__ == "__main__":
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.exit(main())
