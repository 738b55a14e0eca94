"""Real time over the socketcand hub: ten minutes at 250 Hz, the simulated rig served by `rig sim
serve` in another process.

    python -m tests.benchmarks.realtime_study                  # 600 s at 250 Hz
    python -m tests.benchmarks.realtime_study --priority 50    # both processes in the real-time class, as on a rig's computer

The run is that of `rig run --backend hardware`: turn thread, writer thread, watchdog, the drivers
over python-can's socketcand interface, described by the rig.toml that the server writes. Prints the
achieved rate, the jitter of the SYNC interval on the computer's clock, missed cycles, the latency
from SYNC to the last frame of its cycle, and the load average beside them. Exit code 0 if the run
was completed and made safe, with no cycle missed.
"""  # noqa: E501

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from rig.bench.backends.order import Order
from rig.run.parts import RunReport
from rig.run.start import run_order
from tests.benchmarks.long_run import LongRunParameters, load_average, long_run

ROOT = Path(__file__).parents[2]
GEAR = "STUDY"


@contextmanager
def served(folder: Path, rate: float, reaction: float, priority: int) -> Iterator[Path]:
    """`rig sim serve` as another process, and the rig.toml that reaches it, with its own reaction
    time [ms] and priority.
    """
    description = folder / "rig.toml"
    command = [
        sys.executable,
        "-m",
        "rig",
        "sim",
        "serve",
        "--port",
        "0",
        "--readout",
        "none",
        "--gear",
        GEAR,
        "--json",
        "--sample-rate",
        f"{rate:g}",
        "--time",
        "wall",
        "--config-out",
        str(description),
    ]
    if priority:
        # The served rig stands for devices that have processors of their own.
        command = ["chrt", "--fifo", str(priority), *command]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        assert process.stdout is not None
        json.loads(process.stdout.readline())
        written = description.read_text(encoding="utf-8")
        lock = "true" if priority else "false"
        asked = f"[real_time]\nreaction_ms = {reaction!r}\nscheduler_priority = {priority}\nlock_memory = {lock}\n"
        description.write_text(f"{written}\n{asked}", encoding="utf-8")
        try:
            yield description
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait(10.0)


def request_for(description: Path, rate: float, folder: Path) -> Order:
    """The order of the study."""
    from rig.bench.backends.registry import HARDWARE
    from rig.bench.config.apply import configured_rig

    rig = configured_rig(description)
    return Order(
        protocol="long-run",
        gear=rig.gear,
        motor=rig.motor,
        folder=folder,
        backend=HARDWARE,
        serial=GEAR,
        operator="study",
        sample_rate=rate,
        config=description,
        limits=rig.limits,
    )


def run(duration: float, rate: float, reaction: float, priority: int, folder: Path) -> RunReport:
    """The run, in real time."""
    from rig.run.dry_run import plan_run

    with served(folder, rate, reaction, priority) as description:
        request = request_for(description, rate, folder)
        planned = plan_run(
            long_run(duration),
            LongRunParameters(),
            request.gear,
            request.motor,
            "circular-spline-fixed",
            sample_rate=rate,
            configured=request.limits,
        )
        return run_order(request, planned, confirmation=GEAR)


def intervals(path: Path) -> np.ndarray:
    """Every interval [s] between two SYNCs while the motor turned at constant speed, from the sealed file.

    Nothing is left out: a block that was begun late is jitter like any other. Between these
    stretches the drive is switched on and off by SDO, and the SYNC stands.
    """
    from rig.runfile.read import close_recording, open_run

    recording = open_run(path, verify=True)
    try:
        holds = [segment for segment in recording.segments if segment.label.startswith("hold")]
        return np.concatenate([np.empty(0), *(np.diff(recording.time(hold)) for hold in holds)])
    finally:
        close_recording(recording)


def _scheduling(priority: int) -> str:
    return f"SCHED_FIFO {priority}" if priority else f"as any program, niceness {os.nice(0)}"


def main() -> int:
    """Run the study."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--duration", type=float, default=600.0, help="s")
    parser.add_argument("--rate", type=float, default=250.0, help="SYNC rate [Hz]")
    parser.add_argument("--reaction", type=float, default=20.0, help="ms of cycles in one exchange")
    parser.add_argument(
        "--priority",
        type=int,
        default=0,
        help="SCHED_FIFO priority of both processes; 0: like any program",
    )
    options = parser.parse_args()
    before = load_average()
    with tempfile.TemporaryDirectory() as folder:
        report = run(
            options.duration, options.rate, options.reaction, options.priority, Path(folder)
        )
        between = intervals(report.path)
    if not len(between):
        print(f"{report.outcome}: {report.message}", file=sys.stderr)
        return 1
    told = {name.removeprefix("acquisition_"): value for name, value in report.metrics.items()}
    nominal = 1.0 / options.rate
    p50, p99, p999, most = np.percentile(np.abs(between - nominal), [50.0, 99.0, 99.9, 100.0]) * 1e3
    late = int(np.count_nonzero(between > 1.5 * nominal))
    missed = round(sum(told[name] for name in ("incomplete", "late", "doubled", "short")))
    table = {
        "outcome, standstill verified": f"{report.outcome}, {'yes' if report.safe else 'NO'}",
        "reaction time; scheduling": f"{options.reaction:g} ms; {_scheduling(options.priority)}",
        "cycles; of them at constant speed": f"{report.rows}; {len(between) + 1}",
        "achieved rate at constant speed": f"{1.0 / between.mean():.3f} Hz of {options.rate:g} Hz",
        "jitter of the SYNC interval, p50, p99, p99.9, greatest": f"{p50:.3f}, {p99:.3f}, {p999:.3f}, {most:.3f} ms",
        "intervals of more than one and a half periods": f"{late} ({100.0 * late / len(between):.3f} %)",
        "cycles missed: incomplete, late, doubled, short": ", ".join(
            f"{told[name]:.0f}" for name in ("incomplete", "late", "doubled", "short")
        ),
        "latency from SYNC to the last frame, p50, p99, greatest": ", ".join(
            f"{told[name] * 1e3:.2f}" for name in ("latency_p50", "latency_p99", "latency_max")
        )
        + " ms",
        "load average before; after; cores": f"{before}; {load_average()}; {os.cpu_count()}",
    }
    print("| what | measured |\n|---|---|")
    for what, value in table.items():
        print(f"| {what} | {value} |")
    if report.message:
        print(report.message, file=sys.stderr)
    return 0 if report.outcome == "COMPLETED" and report.safe and not missed else 1


if __name__ == "__main__":
    raise SystemExit(main())
