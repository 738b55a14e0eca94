"""Does the stage `stop-kill` on the bench of a description, until it is killed: `python -m ... CONFIG FOLDER`."""

from __future__ import annotations

import sys
from pathlib import Path

from rig.bench.backends.order import Order
from rig.bench.backends.registry import HARDWARE
from rig.bench.commissioning import STAGES
from rig.run.start import bench_for
from rig.run.stop import StopRequest
from rig.trial.commission.conduct import do_stage
from rig.trial.commission.work import Seen, Work

RATE = 100.0


def stop_kill(config: Path, folder: Path, seconds: str = "") -> Seen:
    """The stage, every question answered with yes; `seconds` is what is typed for how long it turned."""
    order = Order(
        protocol="commission",
        backend=HARDWARE,
        operator="A. Example",
        serial="SN-1",
        folder=folder,
        sample_rate=RATE,
        config=config,
    )
    work = Work(
        order=order,
        bench=bench_for(order),
        ask=lambda prompt: prompt.consent or seconds,
        stop=StopRequest(),
        now=lambda: "2026-11-27T08:00:00+00:00",
        on_progress=lambda progress: print(f"{progress.speed:.3f}", flush=True),
    )
    (stage,) = [one for one in STAGES if one.name == "stop-kill"]
    return do_stage(stage, work, "D")


if __name__ == "__main__":
    stop_kill(Path(sys.argv[1]), Path(sys.argv[2]))
