"""All tests, a process of its own for every few files of a room: README's test command.

    python -m tests                             # everything, on all cores
    python -m tests tests/rig/run tests/model   # some rooms: folders, or files
    python -m tests --processes 1 -- -x         # what follows is for pytest

A room is a folder of tests. A process imports what its files need, and gives all of it back at its end: one that went
through all rooms would hold 1.3 GB. The longest files come first, so that nothing is waited for at the end. Of a
process that failed all is shown that pytest said. The exit code is 1 then, and 5 where no test was found.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

from tests.extras.conftest import collect_ignore as WITHOUT_EXTRA

TESTS = Path(__file__).parent
NOT_COLLECTED = TESTS / "benchmarks"
"""Run by hand: they need packages of their own."""
ALONE = (
    "rig/trial/test_drill.py",
    "rig/trial/test_drill_proofs.py",
    "docs/test_howto_commands.py",
    "rig/trial/test_demo.py",
    "rig/window/test_fleet.py",
)
"""Files with a process of their own, those that take longest first: what they load, no other file of the room does."""
MOST_FILES = 11
"""Of one process. With twice as many some would hold more than 600 MB; each more takes two seconds of imports."""
FEWER_FILES = {"rig/window": 5, "extras": 6, "end_to_end": 4}
"""Of rooms that import more than the others."""
PASSED, FAILED, NOTHING_FOUND = 0, 1, 5
"""What pytest's exit codes say; the last also where `-k` or `-m` left no test."""
_COUNT = re.compile(r"(\d+) (passed|failed|skipped|deselected|xfailed|error)s?\b")


@dataclass(frozen=True)
class Outcome:
    """A process that has ended: its name, exit code, everything that it said, and how long it took [s]."""

    name: str
    code: int
    said: str
    seconds: float

    @property
    def counts(self) -> Counter[str]:
        """How many tests passed, failed, were skipped, by the last line that says so: a thread may speak after it."""
        lines = (_COUNT.findall(line) for line in reversed(self.said.splitlines()))
        return Counter({word: int(n) for n, word in next(filter(None, lines), [])})

    @property
    def failures(self) -> list[str]:
        """What failed, a line each, as pytest names it; the process where it did not come to that."""
        named = [line for line in self.said.splitlines() if line.startswith(("FAILED ", "ERROR "))]
        return named or [f"FAILED {self.name}: ended by {self.code}"]

    @property
    def is_failed(self) -> bool:
        """Whether a test failed, or pytest did not come to its end."""
        return self.code not in (PASSED, NOTHING_FOUND)


def files_below(places: Iterable[Path]) -> list[Path]:
    """The files of tests that lie in these folders, or are named themselves."""
    found = {f for p in places for f in ([p] if p.is_file() else p.rglob("test_*.py"))}
    # What a file is named by, pytest collects, whatever a conftest says.
    found -= {TESTS / "extras" / name for name in WITHOUT_EXTRA}
    return sorted(f for f in found if NOT_COLLECTED not in f.parents)


def processes_of(files: Sequence[Path]) -> list[list[Path]]:
    """What each process takes: some files alone; large rooms in equal parts; small ones together."""
    alone = [TESTS / name for name in ALONE if TESTS / name in files]
    rooms: dict[Path, list[Path]] = {}
    for file in files:
        if file not in alone:
            rooms.setdefault(file.parent, []).append(file)
    parts: list[list[Path]] = [[]]
    for room in sorted(rooms.values(), key=len):
        if len(room) <= _most(room) and len(parts[-1]) + len(room) <= MOST_FILES:
            parts[-1] += room
        else:
            parts += _parts(room)
    return [[file] for file in alone] + [part for part in reversed(parts) if part]


def _parts(room: Sequence[Path]) -> Iterator[list[Path]]:
    """A room in as few parts as need be, every n-th file: neighbours are often alike."""
    number = -(-len(room) // _most(room))
    for k in range(number):
        yield list(room[k::number])


def _most(room: Sequence[Path]) -> int:
    """How many files of a room one process takes."""
    return FEWER_FILES.get(name_of(room[:1]).rpartition("/")[0], MOST_FILES)


def run(files: Sequence[Path], more: Sequence[str]) -> Outcome:
    """One process of pytest over these files."""
    began = time.monotonic()
    ended = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", *more, *map(str, files)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        errors="replace",
        check=False,
    )
    return Outcome(name_of(files), ended.returncode, ended.stdout, time.monotonic() - began)


def name_of(files: Sequence[Path]) -> str:
    """The rooms and how many files of them, or the one file."""
    places = files if len(files) == 1 else dict.fromkeys(file.parent for file in files)
    names = [p.relative_to(TESTS).as_posix() if p.is_relative_to(TESTS) else str(p) for p in places]
    return names[0] if len(files) == 1 else f"{', '.join(names)} ({len(files)} files)"


def run_all(parts: Sequence[Sequence[Path]], processes: int, more: Sequence[str]) -> int:
    """All of them, so many at a time; the exit code."""
    began, outcomes = time.monotonic(), list[Outcome]()
    with ThreadPoolExecutor(processes) as pool:
        for done in as_completed([pool.submit(run, part, more) for part in parts]):
            outcomes.append(done.result())
            _show(outcomes[-1], f"{len(outcomes)}/{len(parts)}")
    counts = sum((o.counts for o in outcomes), Counter[str]())
    failed = [words for o in outcomes if o.is_failed for words in o.failures]
    words = ", ".join(f"{n} {word}" for word, n in counts.items()) or "no test found"
    print(f"{words} in {time.monotonic() - began:.0f} s, {len(parts)} processes")
    if failed:
        print("\n".join(failed))
        return FAILED
    return PASSED if counts["passed"] else NOTHING_FOUND


def _show(outcome: Outcome, place: str) -> None:
    """A line of a process, after all that it said where it failed."""
    if outcome.is_failed:
        print(outcome.said)
    counts = ", ".join(f"{n} {word}" for word, n in outcome.counts.items())
    words = counts or f"ended by {outcome.code}"
    print(f"[{place}] {outcome.name}: {words}, {outcome.seconds:.0f} s", flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command: which rooms, how many processes at a time, what pytest is told."""
    parser = argparse.ArgumentParser(prog="python -m tests", description=__doc__.partition("\n")[0])
    parser.add_argument("places", nargs="*", type=Path, default=[TESTS], help="folders or files")
    parser.add_argument(
        "--processes", type=int, default=os.cpu_count() or 1, help="at a time (one a core)"
    )
    given = list(sys.argv[1:] if arguments is None else arguments)
    split = given.index("--") if "--" in given else len(given)
    order = parser.parse_args(given[:split])
    files = files_below(p.resolve() for p in order.places)
    if not files:
        parser.error(f"no file test_*.py in {', '.join(map(str, order.places))}")
    return run_all(processes_of(files), order.processes, given[split + 1 :])


if __name__ == "__main__":
    raise SystemExit(main())
