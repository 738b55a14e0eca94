"""Whether an hour at 1 kHz opens and pans in the window as ten minutes do: both in turn, over the same steps.

    QT_QPA_PLATFORM=offscreen python -m tests.benchmarks.long_review [--minutes 10 --minutes 60] [--rounds 5]

Makes the runs on the simulated rig, opens each on the page Review, waits for its signals, and pans and zooms. By the
clock and in the window's own thread (its longest pause is what a hand feels).
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tests.benchmarks.long_run import LongRunParameters, load_average, long_run

if TYPE_CHECKING:
    from PySide6.QtWidgets import QApplication

    from rig.window.main import MainWindow
    from rig.window.review.signals.view import SignalsView

CHANNELS = ("input_speed", "torque")
LONGEST = 300.0


def make(minutes: float, folder: Path) -> Path:
    """A run of so many minutes of rig time at 1 kHz."""
    from model.gear_file import shipped_gear
    from model.motor import shipped_motor
    from rig.bench.backends.order import Order
    from rig.run.dry_run import plan_run
    from rig.run.start import run_order

    gear, motor = shipped_gear(), shipped_motor()
    mounting = "circular-spline-fixed"
    order = Order(protocol="long-run", gear=gear, motor=motor, folder=folder, sample_rate=1000.0)
    planned = plan_run(
        long_run(60.0 * minutes), LongRunParameters(), gear, motor, mounting, sample_rate=1000.0
    )
    return Path(run_order(order, planned).path)


class Looker:
    """Who waits for a window, and takes down its longest pause."""

    def __init__(self, application: QApplication) -> None:
        self._application = application
        self.pause = 0.0

    def until(self, holds: Callable[[], Any]) -> float:
        """Seconds until something holds."""
        begin = time.perf_counter()
        while not holds():
            before = time.perf_counter()
            self._application.processEvents()
            self.pause = max(self.pause, time.perf_counter() - before)
            if before - begin > LONGEST:
                raise TimeoutError
            time.sleep(0.001)
        return time.perf_counter() - begin


def drawn(view: SignalsView, began: dict[str, Any]) -> bool:
    """Whether every curve shows other data than before."""
    now = {name: curve.item.xData for name, curve in view.curves.items()}
    return bool(now) and all(x is not None and x is not began.get(name) for name, x in now.items())


def complete(view: SignalsView) -> bool:
    """Whether nothing is read any more."""
    return not view._reading.is_running and not view._pause.isActive()


def opened(looker: Looker, window: MainWindow, run: Path) -> tuple[float, float, float]:
    """Seconds until a run's signals are drawn, until all of their rows are, and for another stretch (median)."""
    review = window.review
    window.show_page("review")
    begin = time.perf_counter()
    review.show_run(run)
    details = review.details
    looker.until(lambda: details.recording is not None and details.recording.rows)
    view = details.signals
    details.tabs.setCurrentWidget(view)
    view.choose(*CHANNELS)
    looker.until(lambda: drawn(view, {}))
    first = time.perf_counter() - begin
    looker.until(lambda: complete(view))
    whole = time.perf_counter() - begin
    end = view.view[1]
    looks = []
    for place in range(12):
        before = {name: curve.item.xData for name, curve in view.curves.items()}
        width = end * (0.5 if place % 3 == 0 else 0.05)
        view.jump(end * (0.2 + 0.05 * place), width)
        looks.append(looker.until(lambda before=before: drawn(view, before) and complete(view)))
    return first, whole, statistics.median(looks)


def main() -> int:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--minutes", type=float, action="append", help="10 and 60 without it")
    parser.add_argument("--rounds", type=int, default=5)
    chosen = parser.parse_args()
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    from PySide6.QtWidgets import QApplication

    from rig.window.main import MainWindow
    from rig.window.shell.session import WindowSession
    from rig.window.shell.theme import apply_theme

    application = QApplication([])
    print(f"load average {load_average()}")
    with tempfile.TemporaryDirectory() as place:
        runs = {minutes: make(minutes, Path(place)) for minutes in chosen.minutes or (10.0, 60.0)}
        found: dict[float, list[tuple[float, ...]]] = {minutes: [] for minutes in runs}
        for _ in range(chosen.rounds):
            for minutes, run in runs.items():
                session = WindowSession(Path(place))
                apply_theme(application, session.theme)
                window = MainWindow(session)
                window.resize(1366, 768)
                window.show()
                looker = Looker(application)
                found[minutes].append((*opened(looker, window, run), looker.pause))
                window.close()
                window.deleteLater()
                application.processEvents()
        print(
            "| minutes | drawn [s] | every row [s] | another stretch [s] | longest pause of the window [s] |"
        )
        print("|---|---|---|---|---|")
        for minutes, rows in found.items():
            cells = (f"{statistics.median(values):.3f}" for values in zip(*rows, strict=True))
            print(f"| {minutes:g} | {' | '.join(cells)} |")
        sys.stdout.flush()
        os._exit(0)


if __name__ == "__main__":
    sys.exit(main())
