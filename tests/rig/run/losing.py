"""A run over the hub in a process of its own, whose computer is lost in motion in one way or another.

    python -m tests.rig.run.losing CARRIER PORT FOLDER WAY

Prints `turning` once the motor turns, does what WAY says, and prints how the run ended.
"""

from __future__ import annotations

import ctypes
import sys
import threading
import time
from pathlib import Path
from typing import Any

from experiments.steps.vocabulary import HoldTime, Ramp
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench.backends.order import Order
from rig.run.dry_run import plan_run
from rig.run.start import run_on
from tests.rig.fake_rig import NoChoice, experiment_of
from tests.rig.served_rig import reached_rig

RATE = 100.0
SPEED = 30.0
"""rad/s."""
GIL_S = 5.0
"""s for which the interpreter is kept."""
STEPS = (Ramp(SPEED, 100.0), HoldTime(20.0), Ramp(0.0, 100.0))


def keep_the_interpreter() -> None:
    """Sleep without letting any other thread run, as a library in C may."""
    library = ctypes.PyDLL(None)
    library.usleep(round(GIL_S * 1e6))


def main(carrier: str, port: str, folder: str, way: str) -> None:
    """Run, and be lost."""
    gear, motor = shipped_gear(), shipped_motor()
    planned = plan_run(experiment_of(STEPS), NoChoice(), gear, motor, sample_rate=RATE)
    request = Order(
        protocol="literal",
        gear=gear,
        motor=motor,
        folder=Path(folder),
        serial="SN-1",
        sample_rate=RATE,
    )
    told: list[bool] = []

    def on_progress(progress: Any) -> None:
        if told or progress.speed < 0.9 * SPEED:
            return
        told.append(True)
        print("turning", time.monotonic_ns(), flush=True)
        if way == "interpreter":
            threading.Thread(target=keep_the_interpreter, daemon=True).start()
        elif way == "serving":
            raise SystemExit(3)

    try:
        report = run_on(
            reached_rig(carrier, RATE, int(port)), request, planned, on_progress=on_progress
        )
        print("ended", report.outcome, report.safe, report.message, flush=True)
    except SystemExit as end:
        print("raised", *getattr(end, "__notes__", ()), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
