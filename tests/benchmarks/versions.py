"""Two versions of this program measured in turn: what became faster, what slower.

    python -m tests.benchmarks.versions e139ac7 HEAD
    python -m tests.benchmarks.versions 550c546 HEAD --only "closed loop" --pairs 7

Each commit is laid out in a folder of its own and run with the packages of this environment, its kernels compiled into a folder of
its own; both take turns (A B A B ...) on one core. Printed is the median of each and the median of the ratios of the pairs: processor
time of the whole process, user and system, with what it starts. A figure under 1 in the last column is less time than OLD takes.
Runs that are fitted and listed are recorded by OLD, which both can read. On a noisy machine quote the ratio, never the seconds.
"""  # noqa: E501

from __future__ import annotations

import argparse
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
LOOP = """
import numpy as np
from model.closed_loop import SPEED, ClosedLoop, LoopSettings
from model.gear_file import shipped_gear
from model.motor import shipped_motor
loop = ClosedLoop(shipped_gear(), shipped_motor(), settings=LoopSettings(cycle=1.25e-4, step=1.25e-4))
targets = np.full(8000 * 60, 104.72)
columns = loop.advance(loop.rest(), SPEED, targets[:1]).shape[1]
rows = np.empty((len(targets), columns))
for _ in range({rounds}):
    loop.advance(loop.rest(), SPEED, targets, rows)
"""
"""A minute of the closed loop at 8 kHz, so many times. Once and many times: the difference is the loop alone."""
ROUNDS = 40


@dataclass(frozen=True)
class Version:
    """One commit, laid out, with folders of its own."""

    name: str
    source: Path
    home: Path

    def environment(self, cold: bool = False) -> dict[str, str]:
        """That of a process of this version; `cold`: with no kernel compiled."""
        cache = Path(tempfile.mkdtemp(dir=self.home)) if cold else self.home / "cache"
        state = {
            "HARMONIC_RIG_STATE": str(self.home / "state"),
            "HARMONIC_RIG_INDEX": str(self.home / "index"),
        }
        paths = {
            "PYTHONPATH": str(self.source),
            "XDG_CACHE_HOME": str(cache),
            "PYTHONPYCACHEPREFIX": str(self.home / "bytecode"),
        }
        own = {**os.environ, **state, **paths, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        # Whoever uses a version has its bytecode, as that is installed: nothing is parsed at each start.
        own.pop("PYTHONDONTWRITEBYTECODE", None)
        return own

    def run(self, *arguments: str, folder: Path, cold: bool = False) -> float:
        """Processor time [s] of Python with these arguments in a folder. Raises `CalledProcessError`."""
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [sys.executable, *arguments]
        subprocess.run(
            command, cwd=folder, env=self.environment(cold), check=True, capture_output=True
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime

    def rig(self, *arguments: str, folder: Path, cold: bool = False) -> float:
        """The same of a command of `rig`."""
        return self.run("-m", "rig", *arguments, folder=folder, cold=cold)


Measurement = Callable[[Version, Path], float]
"""Processor time of one version in a folder of its own, in which `runs` has seven runs of OLD."""


def _closed_loop(version: Version, folder: Path) -> float:
    many = version.run("-c", LOOP.format(rounds=ROUNDS), folder=folder)
    return many - version.run("-c", LOOP.format(rounds=1), folder=folder)


def _chain(version: Version, folder: Path) -> float:
    begun = version.rig("--help", folder=folder)
    return version.rig("run", "kinematic-error", "--seed", "7", folder=folder) - begun


def _fit(version: Version, folder: Path) -> float:
    run = min((folder / "runs").glob("*.h5"))  # the first that was recorded
    return version.rig("fit", str(run), folder=folder)


MEASUREMENTS: Mapping[str, Measurement] = {
    "closed loop": _closed_loop,
    "whole chain": _chain,
    "kinematic-error fit": _fit,
    "demo, caches warm": lambda version, folder: version.rig("demo", folder=folder),
    "demo, caches cold": lambda version, folder: version.rig("demo", folder=folder, cold=True),
    "rig runs of seven runs": lambda version, folder: version.rig("runs", "runs", folder=folder),
    "import rig": lambda version, folder: version.run("-c", "import rig", folder=folder),
    "rig --help": lambda version, folder: version.rig("--help", folder=folder),
}


def laid_out(commit: str, home: Path) -> Version:
    """A commit in a folder of its own. Raises `CalledProcessError` for a commit that is not there."""
    source = home / "source"
    source.mkdir(parents=True)
    archive = subprocess.run(
        ["git", "archive", commit], cwd=REPOSITORY, check=True, capture_output=True
    )
    subprocess.run(["tar", "-x", "-C", str(source)], input=archive.stdout, check=True)
    return Version(commit, source, home)


def recorded(version: Version, folder: Path) -> None:
    """Seven short runs of a version in `folder / "runs"`, the first of them of the kinematic error."""
    for number, protocol in enumerate(("kinematic-error", *["starting-torque"] * 6)):
        version.rig("run", protocol, "--seed", str(number + 1), folder=folder)


def measured(name: str, versions: Sequence[Version], runs: Path, pairs: int) -> list[list[float]]:
    """Processor times of both versions, pair by pair; the first pair warms up and is not counted."""
    times: list[list[float]] = []
    for _ in range(pairs + 1):
        pair = []
        for version in versions:
            with tempfile.TemporaryDirectory(dir=version.home) as folder:
                shutil.copytree(runs, Path(folder) / "runs")
                pair.append(MEASUREMENTS[name](version, Path(folder)))
        times.append(pair)
    return times[1:]


def on_one_core() -> None:
    """This process and what it starts, where the system can be told."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints a line for each figure; exit code 0."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("old", help="the commit that is compared with")
    parser.add_argument("new", help="the commit that is measured")
    parser.add_argument("--pairs", type=int, default=7, help="pairs that are counted (7)")
    parser.add_argument(
        "--only", action="append", choices=list(MEASUREMENTS), help="this figure; may be repeated"
    )
    chosen = parser.parse_args(arguments)
    on_one_core()
    with tempfile.TemporaryDirectory() as place:
        versions = [
            laid_out(commit, Path(place) / side)
            for side, commit in (("a", chosen.old), ("b", chosen.new))
        ]
        recorded(versions[0], versions[0].home)
        print(
            f"{'processor time, median of ' + str(chosen.pairs):34s} {chosen.old:>10s} {chosen.new:>10s}  ratio"
        )
        for name in chosen.only or MEASUREMENTS:
            times = measured(name, versions, versions[0].home / "runs", chosen.pairs)
            old, new = (statistics.median(column) for column in zip(*times, strict=True))
            ratio = statistics.median(b / a for a, b in times)
            print(f"{name:34s} {old:8.2f} s {new:8.2f} s  {ratio:5.2f}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
