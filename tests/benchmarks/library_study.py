"""How long a folder of many runs takes to list: the first scan, every later look, a search, the window's list.

    python -m tests.benchmarks.library_study [--runs 10000] [--folder DIR] [--processes N]

Two short runs are made on the simulated rig and copied into folders YEAR/MONTH/GEAR, each copy with
its own run id, serial number and day in its header, sealed anew, and with its analysis beside it.
Printed are runs per second of the first scan by the clock and by the processors, and what later
looks cost a process that has the program loaded. With --folder the copies are kept and used again.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from unittest import mock

import h5py

from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.analysis.store import analysis_folder
from rig.bench.backends.order import Order
from rig.library.index import LibraryIndex
from rig.library.place import VARIABLE, index_path
from rig.run.start import run_order
from rig.runfile.layout import read_text, rewrite_field
from rig.runfile.seal import file_sha256, hash_path

PROTOCOLS = {
    "home": {"zero_time": 0.5},
    "starting-torque": {"positions": 2, "zero_time": 0.5, "rate": 0.05},
}
"""Two protocols that take seconds."""
GEARS = 100
SERIAL = "G0000"
"""What the copied runs call their gear: as long as the serial numbers that are written over it."""
SAMPLE_RATE = 200.0
"""Hz: what a list reads of a run does not grow with its rows."""


def make(folder: Path, scratch: Path, runs: int) -> None:
    """Copies of two runs, told apart by run id, serial number and day, sealed, each with its analysis."""
    for protocol, values in PROTOCOLS.items():
        run_order(
            Order(
                protocol=protocol,
                gear=shipped_gear(),
                motor=shipped_motor(),
                folder=scratch,
                values=values,
                serial=SERIAL,
                sample_rate=SAMPLE_RATE,
            )
        )
    made = sorted(scratch.glob("*.h5"))
    for path in made:
        subprocess.run([sys.executable, "-m", "rig", "fit", path], capture_output=True, check=True)
    for number in range(1, runs + 1):
        copy(made[number % len(made)], folder, number)


def copy(source: Path, folder: Path, number: int) -> None:
    """One copy of a run under its own number, gear and day."""
    before = source.name.removesuffix(".h5")
    serial, month, day = f"G{number % GEARS:04d}", number // GEARS % 12 + 1, number // 1200 % 28 + 1
    run_id = f"{number:05d}-{before.split('-', 1)[1]}".replace(SERIAL, serial)
    path = folder / "2026" / f"{month:02d}" / serial / f"{run_id}.h5"
    path.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, path)
    with h5py.File(path, "r+", libver="v110") as file:
        start = read_text(file, "entry/start_time")
        texts = {
            "entry/run_id": run_id,
            "entry/sample/serial_number": serial,
            "entry/start_time": f"2026-{month:02d}-{day:02d}{start[10:]}",
        }
        for name, text in texts.items():
            rewrite_field(file, name, text)
    digest = file_sha256(path)
    hash_path(path).write_text(f"{digest}  {path.name}\n")
    store = analysis_folder(path)
    store.mkdir()
    for analysis in analysis_folder(source).glob("*.json"):
        text = analysis.read_text().replace(file_sha256(source), digest)
        stored = store / analysis.name
        stored.write_text(text.replace(before, run_id))
        hash_path(stored).write_text(f"{file_sha256(stored)}  {stored.name}\n")


def measured(what: str, action: Callable[[], object], times: int = 5) -> None:
    """Print the clock and the processor's time of an action: the first time and the best of the later ones."""
    seconds = []
    for _ in range(times):
        wall, busy = time.perf_counter(), time.process_time()
        action()
        seconds.append((time.perf_counter() - wall, time.process_time() - busy))
    best = min(seconds[1:] or seconds)
    print(
        f"{what:<44} first {seconds[0][0]:6.3f} s ({seconds[0][1]:6.3f} s busy), "
        f"then {best[0]:6.3f} s ({best[1]:6.3f} s busy), {memory():.0f} MB",
        flush=True,
    )


def memory() -> float:
    """The most memory that this process has taken so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def measure_scans(folder: Path, processes: int | None) -> None:
    """The first scan, in one process and in several."""
    from rig.library import index, reading

    for number in (1, processes):
        index_path(folder).unlink(missing_ok=True)
        library = LibraryIndex(folder, nested=True)
        children = resource.getrusage(resource.RUSAGE_CHILDREN)
        wall, busy = time.perf_counter(), time.process_time()

        def read(paths: list[Path], asked: int | None = number) -> object:
            return reading.read_many(paths, asked)

        with mock.patch.object(index, "read_many", read):
            runs = library.refresh()
        wall, busy = time.perf_counter() - wall, time.process_time() - busy
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        helped = after.ru_utime + after.ru_stime - children.ru_utime - children.ru_stime
        print(
            f"first scan, {number or 'as many processes as pay'}: {runs} runs in {wall:.1f} s: "
            f"{runs / wall:.0f} a second; processor {busy:.1f} s, helpers {helped:.1f} s; "
            f"{memory():.0f} MB, a helper at most {after.ru_maxrss / 1024:.0f} MB",
            flush=True,
        )


def measure_looks(folder: Path) -> None:
    """What somebody waits for once the index is there, in a process that has the program loaded."""
    from rig.analysis.judging import judge_listed
    from rig.commands.listing import newest

    measured("open the index, list everything", lambda: LibraryIndex(folder, nested=True).search())
    library = LibraryIndex(folder, nested=True)
    measured("list everything again", library.search)
    measured("search for two words and a gear", lambda: library.search("home g00", gear="G0042"))
    runs = library.search()
    measured("verdicts of the newest 50", lambda: judge_listed(newest(runs, 50)))
    for _ in range(20):
        library.search()
    print(f"after 20 more looks: {memory():.0f} MB")


def measure_window(folder: Path) -> None:
    """The window's list: its rows made, sorted by another column, filtered by words."""
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    from PySide6.QtCore import Qt
    from PySide6.QtWidgets import QApplication, QTableView

    from rig.window.review.table_model import LibraryFilter, LibraryModel, Wanted
    from rig.window.shell.palette import LIGHT

    program = QApplication.instance() or QApplication([])
    runs = LibraryIndex(folder, nested=True).search()
    model, filtered, table = LibraryModel(lambda: LIGHT), LibraryFilter(), QTableView()
    filtered.setSourceModel(model)
    table.setModel(filtered)
    table.show()

    def drawn(action: Callable[[], object]) -> Callable[[], None]:
        def act() -> None:
            action()
            program.processEvents()

        return act

    def filter_and_back() -> None:
        filtered.set_wanted(Wanted(text="home g00"))
        filtered.set_wanted(Wanted())

    measured("window: list the runs", drawn(lambda: model.set_runs(runs)))
    measured("window: sort by time", drawn(lambda: filtered.sort(5, Qt.SortOrder.DescendingOrder)))
    measured("window: filter by words, and all again", drawn(filter_and_back))


def measure_command(folder: Path) -> None:
    """`rig runs` as a process of its own, everything counted."""
    for words in (("--version",), ("runs", str(folder)), ("runs", str(folder), "--gear", "G0042")):
        command = [sys.executable, "-m", "rig", *words]
        measured(
            "process: rig " + words[0] + " ..." * (len(words) > 1) + " --gear" * (len(words) > 2),
            lambda command=command: subprocess.run(command, capture_output=True, check=True),
        )


def main() -> None:
    """Make the folder, or take one that is there, and measure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--processes", type=int)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="library-study-") as scratch:
        os.environ[VARIABLE] = str(Path(scratch) / "indexes")
        folder = asked.folder or Path(scratch) / "runs"
        if not folder.exists():
            make(folder, Path(scratch) / "made", asked.runs)
        measure_scans(folder, asked.processes)
        measure_looks(folder)
        measure_window(folder)
        measure_command(folder)


if __name__ == "__main__":
    main()
