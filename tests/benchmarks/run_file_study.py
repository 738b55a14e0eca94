"""A thousand run files with something changed at random, read in every way: refused in our words, or the same numbers.

    python -m tests.benchmarks.run_file_study --files 1000

Sources are what version 0.1.0 wrote (a friction run, an import, a run that was cut off) and one
made by hand. Whatever raises anything but an error of ours, or does not come back, is printed with
its seed; the exit code is then 1.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path

from rig.runfile.read import close_recording, open_run
from tests.rig.runfile.making import write_run
from tests.rig.runfile.mutated import mutated, outcome_of, uses
from tests.rig.runfile.test_damage import everything

WRITTEN = Path(__file__).parents[1] / "data" / "0.1.0"


def seen(path: Path) -> str:
    """All that a reader can see of a run whose seal nobody asks for."""
    recording = open_run(path, digest=False)
    try:
        return everything(recording)
    finally:
        close_recording(recording)


def study(first: int, files: int) -> int:
    """How many files ended in anything but a refusal or a reading."""
    counted: Counter[tuple[str, str]] = Counter()
    kinds: Counter[str] = Counter()
    defects, slowest = 0, 0.0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "sound").mkdir()
        sources = (
            write_run(folder / "sound", 300),
            WRITTEN / "runs" / "00003-friction-SN_010.h5",
            WRITTEN / "runs" / "00005-import-SN_010.h5",
            WRITTEN / "killed" / "00001-friction-SN_010.h5.part",
        )
        sound = [seen(source) for source in sources]
        for seed in range(first, first + files):
            here = folder / str(seed)
            here.mkdir()
            place = seed % len(sources)
            path, what, resealed = mutated(sources[place], here, seed)
            kinds[what.partition(" of ")[0]] += 1
            for use, action in uses(path).items():
                begin = time.process_time()
                try:
                    outcome = outcome_of(action)
                    if outcome == "read" and use == "read" and " of " not in what:
                        assert seen(path) == sound[place], "other numbers"
                except Exception:  # noqa: BLE001  a defect is what is looked for
                    defects += 1
                    outcome = "DEFECT"
                    print(f"seed {seed}: {what}, sealed anew: {resealed}, {use}", flush=True)
                    traceback.print_exc(limit=-3)
                slowest = max(slowest, time.process_time() - begin)
                counted[use, outcome] += 1
            for left in sorted(here.rglob("*"), reverse=True):
                left.rmdir() if left.is_dir() else left.unlink()
    for (use, outcome), number in sorted(counted.items()):
        print(f"{use:8} {outcome:8} {number}")
    print(f"changes: {dict(kinds.most_common())}")
    print(
        f"{files} files, {defects} defects, the slowest reading took {slowest:.1f} s of the processor"
    )
    return defects


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    chosen = parser.parse_args()
    sys.exit(1 if study(chosen.first, chosen.files) else 0)
