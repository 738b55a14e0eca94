"""How the window keeps up with a growing run file: frames, processor time, memory, and whether a row is lost.

    QT_QPA_PLATFORM=offscreen python -m tests.benchmarks.window_study       # an hour of rig time at 1 kHz, 30 fold
    QT_QPA_PLATFORM=offscreen python -m tests.benchmarks.window_study --rig-time 60 --times 1
    QT_QPA_PLATFORM=offscreen python -m tests.benchmarks.window_study --rate 10000 --rig-time 60 --times 1

A process of its own writes eight channels by the recorder of a rig in real time; the window shows
the whole Run page in the state RUNNING with the board of kinematic-error (the one that reads most)
at 1366x768, and is told progress, margins and events as often as a run tells them.

A *frame* is complete when new rows were handed to the plots and every plot that changed with them
was painted to its end: it is counted at the last of those paintings, once. A beat that found no new
rows is no frame, and neither is a painting of the same rows again. The writer's lateness is how far
it fell behind its own clock: what the window could cost the acquisition on the same computer.
Processor time is that of the window's process, which a busy computer lengthens far less than the
time on a clock.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from PySide6.QtWidgets import QApplication

    from rig.window.run.page import RunPage

BLOCK_SECONDS = 0.02
SETTLING = 5.0
"""s before anything is measured."""
RIPPLE = 2.0e-4
REVERSAL = 40.0
"""s of rig time after which the rig turns the other way: both directions are drawn."""
SPEED = 20.0


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
        Channel(name="torque", unit="N m", scale=1e-4),
        Channel(name="drive_torque", unit="N m", scale=1e-3),
        Channel(name="target_speed", unit="rad/s", scale=1e-3),
        Channel(name="statusword", unit="1", scale=1.0),
        Channel(name="housing_temperature", unit="degC", scale=0.01),
        Channel(name="ambient_temperature", unit="degC", scale=0.01),
    )
    ratio = gear.mounted_ratio("circular-spline-fixed")
    metadata = RunMetadata(
        run_id="00001-window_study",
        experiment="kinematic-error",
        origin="simulated",
        gear=gear,
        ratio=ratio,
        sample_rate=rate,
        time_base="virtual",
    )
    writer = RunWriter(path, RunHeader(metadata, tuple(map(Column.of, channels))), compress=False)
    recorder = ThreadedRecorder(writer, rate)
    random = np.random.default_rng(0)
    rows, total = round(rate * BLOCK_SECONDS), round(rate * rig_time)
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
        stamp = cycles / rate
        within, backwards = np.mod(stamp, REVERSAL), np.mod(stamp // REVERSAL, 2.0) == 1.0
        angle = SPEED * np.where(backwards, REVERSAL - within, within)
        output = angle / ratio + RIPPLE * np.sin(2.0 * angle)
        noise = random.normal(size=rows)
        values = (
            angle,
            -output,
            0.07 + 0.01 * np.cos(2.0 * angle) + 1e-3 * noise,
            0.07 + 1e-3 * noise,
            np.where(backwards, -SPEED, SPEED),
            np.full(rows, 0x237),
            22.0 + 1e-3 * stamp,
            np.full(rows, 21.0),
        )
        counts = np.column_stack(
            [np.rint(v / (c.direction * c.scale)) for v, c in zip(values, channels, strict=True)]
        )
        stamps = np.rint(cycles * (1e9 / rate)).astype(np.int64)
        recorder.put(
            SampleBlock(first, stamps, counts.astype(np.int64), np.zeros(rows, dtype=np.uint16))
        )
    recorder.close("COMPLETED", "")
    told = {
        "rows": total,
        "dropped": writer.rows_dropped,
        "late_p99_ms": 1e3 * _quantile(late, 0.99),
        "late_max_ms": 1e3 * max(late, default=0.0),
        "seconds": time.monotonic() - begin,
    }
    print(json.dumps(told))


class Frames:
    """Counts the frames of a page: when each was complete, and how often each plot was painted."""

    def __init__(self, page: RunPage) -> None:
        self.at: list[float] = []
        self.paintings: dict[str, int] = {}
        self._changed: set[str] = set()
        self._fresh = False
        for plot in page.plots.plots:
            name = plot.canvas.accessibleName()
            self.paintings[name] = 0
            watch_painting(plot.canvas, partial(self._painted, name))
            for curve in plot.curves:
                curve.item.sigPlotChanged.connect(lambda *_, name=name: self._changed.add(name))
        page.plots.drawn.connect(self._drawn)

    def _drawn(self) -> None:
        self._fresh = True

    def _painted(self, name: str) -> None:
        self.paintings[name] += 1
        self._changed.discard(name)
        if self._fresh and not self._changed:
            self._fresh = False
            self.at.append(time.monotonic())


def watch_painting(widget: Any, painted: Callable[[], None]) -> None:
    """Have it told when a widget has been painted, after its painting is done."""
    paint = widget.paintEvent

    def watched(event: Any) -> None:
        paint(event)
        painted()

    widget.paintEvent = watched


class Watcher:
    """Looks after a window in front of a writer, from inside the window's own event loop."""

    def __init__(
        self,
        page: RunPage,
        path: Path,
        writer: subprocess.Popen[str],
        rate: float,
        rig_time: float,
        times: float,
    ) -> None:
        self.page, self.plots, self.path, self.writer = page, page.plots, path, writer
        self.rate, self.rig_time, self.times = rate, rig_time, times
        self.frames: Frames | None = None
        self.begin = self.cpu = self.behind = 0.0
        self.waited: list[float] = []
        self.memory: list[float] = []
        self.looks: list[float] = []
        self._opened = time.monotonic()
        self._told = 0
        beat = self.plots.beat

        def timed() -> None:
            start = time.monotonic()
            beat()
            self.looks.append(time.monotonic() - start)

        self.plots._timer.timeout.disconnect()
        self.plots._timer.timeout.connect(timed)

    def tell(self) -> None:
        """Ten times a second: what a run tells."""
        from experiments.recording import Event
        from rig.run.parts import Progress

        if self.plots.live is None:
            if self.path.exists():
                self.plots.open(self.path)
            return
        self._told += 1
        elapsed = min((time.monotonic() - self._opened) * self.times, self.rig_time)
        peak = 1.0 - math.exp(-elapsed / 600.0)
        margins = {
            name: {"peak": peak * limit, "limit": limit, "margin": 1.0 - peak}
            for name, limit in LIMITS.items()
        }
        step = 1 + int(elapsed // REVERSAL)
        self.page._on_progress(
            Progress(
                step=step,
                steps=90,
                what=f"hold at {SPEED:g} rad/s",
                elapsed=elapsed,
                left=self.rig_time - elapsed,
                speed=SPEED,
                events=0,
                nearest="torque",
                margin=1.0 - peak,
                margins=margins,
                file=str(self.path),
            )
        )
        if self._told % 50 == 0:
            self.page._on_event(
                Event(self._told, "info", "step", "session", f"step {step} has begun")
            )

    def look(self) -> None:
        """Four times a second: begins to measure when the window has settled, and ends with the writer."""
        from PySide6.QtWidgets import QApplication

        live, now = self.plots.live, time.monotonic()
        if self.writer.poll() is not None:
            QApplication.exit()
        elif live is not None and self.frames is None:
            if now - self._opened > SETTLING:
                self.frames, self.begin, self.cpu = Frames(self.page), now, time.process_time()
                self.looks.clear()
        elif live is not None:
            self.behind = max(self.behind, live.behind)
            self.waited.append(self.plots._pacer.waiting / self.rate / self.times)
            self.memory.append(_resident())


LIMITS = {
    "input_speed": 250.0,
    "torque": 0.9,
    "drive_torque": 0.9,
    "output_speed": 5.0,
    "housing_temperature": 60.0,
    "following_error": 0.5,
}


def watch(
    application: QApplication, rate: float, rig_time: float, times: float, size: tuple[int, int]
) -> dict[str, Any]:
    """The window in front of the writer; what was measured."""
    import pyqtgraph as pg
    from PySide6.QtCore import QTimer

    from rig.window.main import MainWindow
    from rig.window.shell.session import WindowSession
    from rig.window.shell.theme import apply_theme

    pg.setConfigOptions(antialias=True)
    apply_theme(application, "light")
    load = [os.getloadavg()[0]] if hasattr(os, "getloadavg") else []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "00001-window_study.h5"
        command = [
            sys.executable,
            "-m",
            "tests.benchmarks.window_study",
            "--write",
            str(path),
            "--rate",
            str(rate),
        ]
        command += ["--rig-time", str(rig_time), "--times", str(times)]
        writer = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        window = MainWindow(WindowSession(Path(folder)))
        window.resize(*size)
        window.show()
        window.show_page("run")
        watcher = Watcher(
            window.run, path.with_name(path.name + ".part"), writer, rate, rig_time, times
        )
        timers = []
        for interval, action in ((100, watcher.tell), (250, watcher.look)):
            timer = QTimer()
            timer.timeout.connect(action)
            timer.start(interval)
            timers.append(timer)
        application.exec()
        for timer in timers:
            timer.stop()
        seconds, cpu, looks = (
            time.monotonic() - watcher.begin,
            time.process_time() - watcher.cpu,
            list(watcher.looks),
        )
        drawn, frames = window.run.plots.rows_read, watcher.frames
        window.run.plots.finish(path)
        assert writer.stdout is not None
        assert frames is not None
        told = json.loads(writer.stdout.read())
        load += [os.getloadavg()[0]] if load else []
        found = {
            "rows": told["rows"],
            "rows_read": window.run.plots.rows_read,
            "drawn_before_the_end": drawn,
            "most_behind": watcher.behind,
            "rows_wait_p50_s": _quantile(watcher.waited, 0.5),
            **_rates(frames.at, seconds),
            "paintings_per_second": {k: n / seconds for k, n in frames.paintings.items()},
            "cpu_ms_per_frame": 1e3 * cpu / len(frames.at),
            "cpu_share_of_a_core": cpu / seconds,
            "beat_p50_ms": 1e3 * _quantile(looks, 0.5),
            "beat_p99_ms": 1e3 * _quantile(looks, 0.99),
            "beat_longest_ms": 1e3 * max(looks),
            "memory_by_quarter_MB": [
                watcher.memory[round(q * (len(watcher.memory) - 1))]
                for q in (0, 0.25, 0.5, 0.75, 1)
            ],
            "memory_highest_MB": max(watcher.memory),
            "load_average": load,
            "writer": told,
        }
        window.run.state = type(window.run.state)()
        window.close()
    return found


def _rates(at: list[float], seconds: float) -> dict[str, float]:
    """Frames per second: all of them over the time, the rate in the middle, that of the slowest
    twentieth, the longest gap.
    """
    gaps = np.diff(at)
    return {
        "frames": len(at),
        "frames_per_second": len(at) / seconds,
        "rate_median": 1.0 / _quantile(gaps, 0.5),
        "rate_5th_percentile": 1.0 / _quantile(gaps, 0.95),
        "longest_gap_ms": 1e3 * float(gaps.max()),
    }


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
    parser.add_argument(
        "--rate", type=float, default=1000.0, help="cycles per second of rig time [Hz]"
    )
    parser.add_argument("--rig-time", type=float, default=3600.0, help="rig time [s]")
    parser.add_argument("--times", type=float, default=30.0, help="how much faster than a clock")
    parser.add_argument(
        "--size", type=int, nargs=2, default=(1366, 768), help="of the window [pixels]"
    )
    parser.add_argument("--write", type=Path, help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.write is not None:
        write(chosen.write, chosen.rate, chosen.rig_time, chosen.times)
        return 0
    from PySide6.QtWidgets import QApplication

    from rig.window.shell.collector import collector_in_this_thread

    application = QApplication([])
    with collector_in_this_thread():
        found = watch(application, chosen.rate, chosen.rig_time, chosen.times, tuple(chosen.size))
    print(json.dumps(found, indent=1))
    good = (
        found["frames_per_second"] > 30.0
        and found["rows_read"] == found["rows"]
        and found["writer"]["dropped"] == 0
    )
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
