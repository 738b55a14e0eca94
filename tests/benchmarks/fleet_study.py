"""What a fleet costs: rate with one and two workers, memory, bytes read, the engine's own share, the questions' times.

    rig fleet simulate --gears 5000 --benches 4 --protocols home --short --sample-rate 100 --workers 2 --output DIR
    python -m tests.benchmarks.fleet_study DIR                     # one, two, one, two workers
    python -m tests.benchmarks.fleet_study DIR --runs 500 --pairs 1

Results go to a scratch folder; DIR is only read. Times are of the wall unless they are called processor time. The
engine's own share is what a worker does besides `fit`: key, verdict, rows, Parquet, by processor time; beside it stands
the processor time of client and scheduler, which for a cluster of this computer are one process. Exit code 0 if every
aim is met.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
import time
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path

import psutil

from rig.fleet.dataset import DataSet
from rig.fleet.engine import Workforce, cluster
from rig.fleet.fit import FleetOrder, FleetReport, fit_fleet
from rig.fleet.progress import Progress
from rig.fleet.questions import QUESTIONS, ask
from rig.fleet.results import Row
from rig.fleet.rows import EMPTY
from rig.fleet.table import table_bytes
from rig.fleet.task import Job, fit_runs
from rig.fleet.work import PathMap, runs_named, work_for

MEGABYTE = 1e6
AIMS = {
    "two workers over one": 1.8,
    "memory": 500.0,
    "growth": 0.05,
    "engine": 0.05,
    "question": 1.0,
}
"""Rate over rate, MB per worker, growth of the second half, share of a fit, seconds."""


@dataclass
class Watch:
    """Looks at the workers as a job goes on."""

    began: float = field(default_factory=time.perf_counter)
    tasks: int = 0
    memory: list[tuple[int, float]] = field(default_factory=list)
    processor: dict[int, float] = field(default_factory=dict)
    bytes_read: dict[int, int] = field(default_factory=dict)
    moments: list[tuple[float, int]] = field(default_factory=list)

    def look(self, progress: Progress) -> None:
        """Take notice of a progress: one per task."""
        self.tasks += progress.done > progress.reused
        self.moments.append((time.perf_counter() - self.began, progress.done))
        for child in _workers():
            with child.oneshot():
                times, spent = child.cpu_times(), child.io_counters()
                self.processor[child.pid] = times.user + times.system
                self.bytes_read[child.pid] = getattr(spent, "read_chars", spent.read_bytes)
                self.memory.append((progress.done, child.memory_info().rss / MEGABYTE))

    def rate(self) -> float:
        """Runs per second from a tenth to nine tenths of the job: neither start nor last batches."""
        last = self.moments[-1][1]
        inner = [one for one in self.moments if 0.1 * last <= one[1] <= 0.9 * last]
        (first_time, first), (last_time, end) = inner[0], inner[-1]
        return (end - first) / (last_time - first_time)

    def mean_memory(self, low: float, high: float) -> float:
        """MB of a worker, between two shares of the job."""
        of = self.moments[-1][1]
        seen = [size for done, size in self.memory if low * of <= done <= high * of]
        return sum(seen) / len(seen)


def _workers() -> list[psutil.Process]:
    """The processes that work: children of this one that have loaded the program."""
    found = []
    for child in psutil.Process().children(recursive=True):
        try:
            if child.memory_info().rss > 80.0 * MEGABYTE:
                found.append(child)
        except psutil.Error:
            continue
    return found


def measured(runs: list[Path], workers: int, scratch: Path) -> tuple[FleetReport, Watch, float]:
    """One job; its report, what was seen, and the processor time of this process [s]."""
    watch, before = Watch(), time.process_time()
    order = FleetOrder(names=runs, crew=Workforce(workers=workers), output=scratch)
    report = fit_fleet(order, watch.look)
    return report, watch, time.process_time() - before


def engine_share(runs: list[Path]) -> float:
    """What a worker does besides the fits, over the fits, by processor time: other programs have no part in it.

    The first runs are left out: they pay for what is imported and compiled once.
    """
    job = Job(name="study", created=datetime.now(UTC).isoformat())
    tasks = work_for(runs, job, {}, base=runs[0].parent, there=PathMap()).tasks
    fit_runs(job, tasks[: len(tasks) // 10], now=time.process_time)
    done = [
        fit_runs(job, tasks[first : first + 30], now=time.process_time)
        for first in range(len(tasks) // 10, len(tasks), 30)
    ]
    spent, fits = sum(one.seconds for one in done), sum(one.fit_seconds for one in done)
    rest = len(tasks) - len(tasks) // 10
    print(f"in this process, processor time of {rest} runs in batches of 30:")
    print(f"  a fit {1e3 * fits / rest:.2f} ms, besides it {1e3 * (spent - fits) / rest:.2f} ms")
    return (spent - fits) / fits


def told(workers: int, report: FleetReport, watch: Watch, own: float) -> None:
    """One line per figure of a job."""
    n = report.fitted + len(report.failed)
    print(f"{workers} worker(s): {n} runs, {len(report.failed)} failed, {watch.tasks} tasks")
    print(f"  rate                          {watch.rate():8.2f} runs/s (inner eight tenths)")
    print(f"  a fit, wall                   {1e3 * report.fit_seconds / n:8.1f} ms")
    print(f"  a run, worker's processor     {1e3 * sum(watch.processor.values()) / n:8.1f} ms")
    print(
        f"  besides the fit, in a worker  {1e3 * (report.seconds - report.fit_seconds) / n:8.2f} ms"
    )
    print(f"  client and scheduler, a run   {1e3 * own / n:8.2f} ms of processor")
    print(f"  read by a worker, a run       {sum(watch.bytes_read.values()) / n / 1e3:8.1f} kB")
    print(f"  memory of a worker, largest   {max(size for _, size in watch.memory):8.1f} MB")
    middle, end = watch.mean_memory(0.3, 0.6), watch.mean_memory(0.7, 1.0)
    print(f"  30-60 % of the job, 70-100 %  {middle:8.1f} MB, {end:.1f} MB", flush=True)


def nothing(numbers: list[int]) -> int:
    """A task that does nothing."""
    return len(numbers)


def cost_of_a_task(tasks: int = 2000) -> tuple[float, float]:
    """What an empty task costs: processor time of client and scheduler, and wall [s]."""
    with cluster(1) as client:
        client.gather([client.submit(nothing, [k], pure=False) for k in range(100)])
        processor, wall = time.process_time(), time.perf_counter()
        client.gather([client.submit(nothing, [k], pure=False) for k in range(tasks)])
        return (time.process_time() - processor) / tasks, (time.perf_counter() - wall) / tasks


def synthesise(folder: Path, rows: int) -> None:
    """So many rows of a made-up production: 40 quantities a run, 500 gears, 4 benches."""
    dice = random.Random(0)
    data = DataSet(folder)
    start = datetime(2026, 1, 5, 8, tzinfo=UTC)
    with data.writing():
        for first in range(0, rows, 40_000):
            made: list[Row] = []
            for k in range(first, min(first + 40_000, rows)):
                run, place = divmod(k, 40)
                value = dice.gauss(1.0 + place, 0.1)
                started = start + timedelta(minutes=10 * run)
                made.append(
                    EMPTY
                    | {
                        "run_file": f"bench/{run:06d}.h5",
                        "kind": "friction",
                        "outcome": "COMPLETED",
                        "gear": f"G-{run % 500:05d}",
                        "bench": str(run % 4),
                        "started": started,
                        "day": started.date(),
                        "quantity": f"quantity_{place}",
                        "unit": "N",
                        "is_metric": False,
                        "identifiable": "yes",
                        "value": value,
                        "expanded_uncertainty": 0.1,
                        "limit_value": 1.3 + place,
                        "limit_is": "upper",
                        "upper_limit": 1.3 + place,
                        "verdict": "PASS" if value < 1.2 + place else "MARGINAL",
                        "run_sha256": f"{dice.getrandbits(256):064x}",
                        "key": f"{run:032x}",
                        "surroundings": f"{run:032x}",
                    }
                )
            data.append(table_bytes(made))


def questions(scratch: Path, rows: int) -> float:
    """Ask every ready question twice, from a process that begins with it; the slowest of the better times [s]."""
    synthesise(scratch, rows)
    worst = 0.0
    for name in QUESTIONS:
        times = []
        for _ in range(2):
            began = time.perf_counter()
            ask(scratch, name)
            times.append(time.perf_counter() - began)
        worst = max(worst, min(times))
        print(f"  {name:12} {times[0]:6.3f} s, {times[1]:6.3f} s")
    return worst


def main() -> int:
    """Measure, print, and say by the exit code whether every aim is met."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", help="a folder of runs, or a pattern")
    parser.add_argument("--runs", type=int, default=0, help="the first so many runs only")
    parser.add_argument(
        "--pairs", type=int, default=2, help="how often one and two workers are measured"
    )
    parser.add_argument(
        "--share", type=int, default=300, help="runs by which the engine's share is measured"
    )
    parser.add_argument(
        "--rows", type=int, default=400_000, help="rows that the questions are asked of"
    )
    asked = parser.parse_args()
    runs = runs_named([asked.folder])[: asked.runs or None]
    print(
        f"{len(runs)} runs of {asked.folder}, load {', '.join(f'{x:.1f}' for x in psutil.getloadavg())}"
    )
    missed = []
    with tempfile.TemporaryDirectory() as scratch:
        for pair in range(asked.pairs):
            rates = {}
            for workers in (1, 2):
                report, watch, own = measured(runs, workers, Path(scratch) / f"{pair}-{workers}")
                told(workers, report, watch, own)
                rates[workers] = watch.rate()
                largest = max(size for _, size in watch.memory)
                growth = watch.mean_memory(0.7, 1.0) / watch.mean_memory(0.3, 0.6) - 1.0
                missed += [f"memory {largest:.0f} MB"] * (largest > AIMS["memory"])
                missed += [f"growth {growth:.3f}"] * (growth > AIMS["growth"])
            ratio = rates[2] / rates[1]
            load = psutil.getloadavg()[0]
            print(
                f"pair {pair + 1}: two workers over one {ratio:.2f} (load {load:.1f})", flush=True
            )
            missed += [f"two workers over one {ratio:.2f}"] * (ratio < AIMS["two workers over one"])
        share = engine_share(runs[: asked.share])
        print(f"  engine over fit {100 * share:.2f} %")
        missed += [f"engine {share:.3f}"] * (share > AIMS["engine"])
        processor, wall = cost_of_a_task()
        print(
            f"an empty task: {1e3 * processor:.2f} ms of client's and scheduler's processor, {1e3 * wall:.2f} ms"
        )
        print(f"questions of {asked.rows} rows:")
        slowest = questions(Path(scratch) / "questions", asked.rows)
        missed += [f"question {slowest:.2f} s"] * (slowest > AIMS["question"])
    print("missed: " + "; ".join(missed) if missed else "every aim is met")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
