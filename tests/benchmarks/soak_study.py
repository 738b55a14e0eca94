"""The soak: ten minutes of rig time at 1 kHz over the wire in virtual time, with the session and
the recorder of every run.

    python -m tests.benchmarks.soak_study                      # 600 s of rig time at 1 kHz
    python -m tests.benchmarks.soak_study --duration 60

Prints cycles, lost cycles, the numbers of the file against those of the report, memory as the run
goes, and the wall time. Exit code 0 if no cycle was lost and the memory of the second half is flat.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from drivers.samples import CycleFlag
from rig.run.parts import Progress, RunReport
from tests.benchmarks.long_run import LongRunParameters, load_average, long_run, resident_megabytes

LOST = CycleFlag.INCOMPLETE | CycleFlag.LATE | CycleFlag.DOUBLED | CycleFlag.SHORT
GROWTH = 0.02
"""Share by which the memory of the second half may exceed that of the first and still be called flat."""


@dataclass
class Memory:
    """Looks at the memory every so many seconds of rig time."""

    interval: float
    seen: list[tuple[float, float]] = field(default_factory=list)

    def look(self, progress: Progress) -> None:
        """Take notice of a progress."""
        if not self.seen or progress.elapsed >= self.seen[-1][0] + self.interval:
            self.seen.append((progress.elapsed, resident_megabytes()))

    def at(self, moment: float) -> float:
        """MB at the look nearest to a moment [s]."""
        return min(self.seen, key=lambda look: abs(look[0] - moment))[1]


def soak(duration: float, rate: float, folder: Path, memory: Memory) -> tuple[RunReport, float]:
    """The run and its wall time [s]."""
    from model.gear_file import shipped_gear
    from model.motor import shipped_motor
    from rig.bench.backends.order import Order
    from rig.run.dry_run import plan_run
    from rig.run.start import run_order

    gear, motor = shipped_gear(), shipped_motor()
    planned = plan_run(
        long_run(duration),
        LongRunParameters(),
        gear,
        motor,
        "circular-spline-fixed",
        sample_rate=rate,
    )
    request = Order(
        protocol="long-run",
        gear=gear,
        motor=motor,
        folder=folder,
        backend="wire",
        serial="SOAK",
        sample_rate=rate,
    )
    start = time.perf_counter()
    report = run_order(request, planned, on_progress=memory.look)
    return report, time.perf_counter() - start


def lost_in_file(path: Path) -> tuple[int, int, float, float]:
    """Of the sealed file: rows, rows marked as lost, smallest and largest step of the SYNC's own time [ns]."""
    from rig.runfile.read import close_recording, open_run

    recording = open_run(path, verify=True)
    try:
        marked, steps, last = 0, [np.inf, -np.inf], np.empty(0)
        for first in range(0, recording.rows, 100_000):
            rows = slice(first, min(first + 100_000, recording.rows))
            marked += int(np.count_nonzero(recording.flags(rows) & int(LOST)))
            times = np.concatenate([last, recording.time(rows)])
            step = np.diff(times)
            steps = [min(steps[0], float(step.min())), max(steps[1], float(step.max()))]
            last = times[-1:]
        return recording.rows, marked, steps[0], steps[1]
    finally:
        close_recording(recording)


def main() -> int:
    """Run the study."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--duration", type=float, default=600.0, help="s of rig time")
    parser.add_argument("--rate", type=float, default=1000.0, help="SYNC rate [Hz]")
    options = parser.parse_args()
    memory = Memory(options.duration / 60.0)
    with tempfile.TemporaryDirectory() as folder:
        print(f"load average before: {load_average()}", file=sys.stderr)
        report, wall = soak(options.duration, options.rate, Path(folder), memory)
        rows, marked, least, most = lost_in_file(report.path)
        size = report.path.stat().st_size
    half = [mb for moment, mb in memory.seen if moment > 0.5 * options.duration]
    first = [
        mb
        for moment, mb in memory.seen
        if 0.1 * options.duration < moment <= 0.5 * options.duration
    ]
    flat = max(half) <= (1.0 + GROWTH) * max(first)
    lost = round(
        sum(
            report.metrics[f"acquisition_{name}"]
            for name in ("incomplete", "late", "doubled", "short")
        )
    )
    table = {
        "outcome, standstill verified": f"{report.outcome}, {'yes' if report.safe else 'NO'}",
        "rig time": f"{report.rows / options.rate:.1f} s at {options.rate:g} Hz, {report.rows} cycles",
        "rows in the sealed file": f"{rows} ({size / 1e6:.1f} MB)",
        "cycles lost (drivers; marked in the file)": f"{lost}; {marked}",
        "interval between two SYNCs, least and most": f"{least * 1e3:.3f} ms, {most * 1e3:.3f} ms",
        "memory at the start, after a tenth, the middle, the end": ", ".join(
            f"{memory.at(share * options.duration):.0f}" for share in (0.0, 0.1, 0.5, 1.0)
        )
        + " MB",
        "wall time": f"{wall:.0f} s, {report.rows / options.rate / wall:.1f} x real time",
        "load average at the end": load_average(),
    }
    print("| what | measured |\n|---|---|")
    for what, value in table.items():
        print(f"| {what} | {value} |")
    return (
        0
        if report.outcome == "COMPLETED"
        and not lost
        and not marked
        and rows == report.rows
        and flat
        else 1
    )


if __name__ == "__main__":
    raise SystemExit(main())
