"""How the window keeps up with a growing run file: frames per second, time per look, memory, and whether a row is lost.

    QT_QPA_PLATFORM=offscreen python -m tests.benchmarks.window_study       # an hour of rig time at 1 kHz, 30 fold
    QT_QPA_PLATFORM=offscreen python -m tests.benchmarks.window_study --rate 10000 --rig-time 60 --times 1

A process of its own writes eight channels by the recorder of a rig in real time; the window shows the board of
kinematic-error (the one that reads most) at 1366x768. Frames are paintings of its first plot. The writer's lateness is how
far it fell behind its own clock: what the window could cost the acquisition on the same computer.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from PySide6.QtWidgets import QApplication

BLOCK_SECONDS = 0.02
SETTLING = 5.0
"""s before memory is looked at for the first time."""
RIPPLE = 2.0e-4


def write(path: Path, rate: float, rig_time: float, times: float) -> None:
    """The writer: blocks of 20 ms of rig time, `times` as fast as a clock; prints what it lost and how late it was."""
    from drivers.channel import Channel, encoder_channel
    from drivers.samples import SampleBlock
    from experiments.recording import RunMetadata
    from model.gear_file import shipped_gear
    from rig.run.recorder import ThreadedRecorder
    from rig.runfile.header import RunHeader
    from rig.runfile.layout import Column
    from rig.runfile.write import RunWriter

    gear = shipped_gear()
    channels = (
        encoder_channel("input_angle", lines=2500, multiplication=4),
        encoder_channel("output_angle", lines=18000, multiplication=4, direction=-1),
        Channel("torque", "N m", 1e-4), Channel("drive_torque", "N m", 1e-3), Channel("target_speed", "rad/s", 1e-3),
        Channel("statusword", "1", 1.0), Channel("housing_temperature", "degC", 0.01),
        Channel("ambient_temperature", "degC", 0.01),
    )  # fmt: skip
    ratio = gear.mounted_ratio("circular-spline-fixed")
    metadata = RunMetadata(
        "00001-window_study", "kinematic-error", "simulated", gear=gear, ratio=ratio, sample_rate=rate, time_base="virtual"
    )
    writer = RunWriter(path, RunHeader(metadata, tuple(map(Column.of, channels))), compress=False)
    recorder = ThreadedRecorder(writer, rate)
    random = np.random.default_rng(0)
    rows, total, speed = round(rate * BLOCK_SECONDS), round(rate * rig_time), 20.0
    late: list[float] = []
    begin = time.monotonic()
    for first in range(0, total, rows):
        due = begin + first / rate / times
        now = time.monotonic()
        if now < due:
            time.sleep(due - now)
        else:
            late.append(now - due)
        cycles = np.arange(first, first + rows)
        angle = speed * cycles / rate
        output = angle / ratio + RIPPLE * np.sin(2.0 * angle)
        noise = random.normal(size=rows)
        values = (angle, -output, 0.07 + 0.01 * np.cos(2.0 * angle) + 1e-3 * noise, 0.07 + 1e-3 * noise,
                  np.full(rows, speed), np.full(rows, 0x237), 22.0 + 1e-3 * cycles / rate, np.full(rows, 21.0))  # fmt: skip
        counts = np.column_stack([np.rint(v / (c.direction * c.scale)) for v, c in zip(values, channels, strict=True)])
        stamps = np.rint(cycles * (1e9 / rate)).astype(np.int64)
        recorder.put(SampleBlock(first, stamps, counts.astype(np.int64), np.zeros(rows, dtype=np.uint16)))
    recorder.close("PASS", "")
    told = {"rows": total, "dropped": writer.rows_dropped, "late_p99_ms": 1e3 * _quantile(late, 0.99),
            "late_max_ms": 1e3 * max(late, default=0.0), "seconds": time.monotonic() - begin}  # fmt: skip
    print(json.dumps(told))


def watch(application: QApplication, rate: float, rig_time: float, times: float, size: tuple[int, int]) -> dict[str, Any]:
    """The window in front of the writer; what was measured."""
    import pyqtgraph as pg
    from PySide6.QtCore import QEvent, QObject

    from rig.window.main import MainWindow
    from rig.window.session import WindowSession
    from rig.window.theme import apply_theme

    class Frames(QObject):
        """Counts the paintings of a widget."""

        def __init__(self) -> None:
            super().__init__()
            self.at: list[float] = []

        def eventFilter(self, watched: QObject, event: QEvent) -> bool:
            if event.type() is QEvent.Type.Paint:
                self.at.append(time.monotonic())
            return False

    pg.setConfigOptions(antialias=True)
    apply_theme(application, "light")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "00001-window_study.h5"
        command = [sys.executable, "-m", "tests.benchmarks.window_study", "--write", str(path), "--rate", str(rate)]
        command += ["--rig-time", str(rig_time), "--times", str(times)]
        writer = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        window = MainWindow(WindowSession(Path(folder)))
        window.resize(*size)
        window.show()
        window.show_page("run")
        plots, looks, frames = window.run.plots, [], Frames()
        beat = plots.beat

        def timed() -> None:
            start = time.monotonic()
            beat()
            looks.append(time.monotonic() - start)

        plots._timer.timeout.disconnect()
        plots._timer.timeout.connect(timed)
        part = path.with_name(path.name + ".part")
        memory: list[tuple[float, float]] = []
        begin, behind, watched = time.monotonic(), 0, False
        while writer.poll() is None:
            application.processEvents()
            if plots.live is None:
                plots.open(part)
            elif not watched:
                watched = True
                plots.plots[0].canvas.viewport().installEventFilter(frames)
                begin = time.monotonic()
            else:
                behind = max(behind, plots.live.behind)
            now = time.monotonic() - begin
            if watched and now > SETTLING and (not memory or now - memory[-1][0] > 1.0):
                memory.append((now, _resident()))
            time.sleep(0.0005)
        drawn = plots.rows_read
        plots.finish(path)
        assert writer.stdout is not None
        told = json.loads(writer.stdout.read())
        gaps = np.diff(frames.at)
        found = {
            "rows": told["rows"], "rows_read": plots.rows_read, "read_before_the_end": drawn, "most_behind": behind,
            "frames_per_second": len(frames.at) / (frames.at[-1] - frames.at[0]), "frame_p99_ms": 1e3 * _quantile(gaps, 0.99),
            "look_p50_ms": 1e3 * _quantile(looks, 0.5), "look_p99_ms": 1e3 * _quantile(looks, 0.99),
            "memory_start_MB": memory[0][1], "memory_end_MB": memory[-1][1], "memory_highest_MB": max(m for _, m in memory),
            "writer": told,
        }  # fmt: skip
        window.close()
    return found


def _resident() -> float:
    """Resident memory of this process [MB]."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return float(line.split()[1]) / 1024.0
    return math.nan


def _quantile(values: Any, share: float) -> float:
    return float(np.quantile(values, share)) if len(values) else 0.0


def main() -> int:
    """Print what was measured; the exit code says whether it is good enough."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rate", type=float, default=1000.0, help="cycles per second of rig time [Hz]")
    parser.add_argument("--rig-time", type=float, default=3600.0, help="rig time [s]")
    parser.add_argument("--times", type=float, default=30.0, help="how much faster than a clock")
    parser.add_argument("--size", type=int, nargs=2, default=(1366, 768), help="of the window [pixels]")
    parser.add_argument("--write", type=Path, help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.write is not None:
        write(chosen.write, chosen.rate, chosen.rig_time, chosen.times)
        return 0
    from PySide6.QtWidgets import QApplication

    from rig.window.collector import collector_in_this_thread

    application = QApplication([])
    with collector_in_this_thread():
        found = watch(application, chosen.rate, chosen.rig_time, chosen.times, tuple(chosen.size))
    print(json.dumps(found, indent=1))
    good = found["frames_per_second"] > 30.0 and found["rows_read"] == found["rows"] and found["writer"]["dropped"] == 0
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
