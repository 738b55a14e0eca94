"""Wrong descriptions of a bench behind a hub, in real time: which stage of the commissioning finds each.

    python -m tests.benchmarks.commission_hub [ROW ...]

The rows are those of tests/rig/trial/commission/test_wrong_descriptions.py, but for what only the rig in this process
can be told wrongly. The bench is served twice, with the gear and without; one motor is never turned with it.
"""

from __future__ import annotations

import os
import sys
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue

from drivers.clock import WallClock
from rig.bench.backends.assembly import AssembledRig
from rig.bench.backends.order import Order, Setup
from rig.bench.backends.registry import HARDWARE, make_port
from rig.bench.state import VARIABLE
from sim_backend.wire.bench import WireBench
from sim_backend.wire.person import Person
from sim_backend.wire.serve import Addresses, serve
from sim_backend.world import World
from tests.rig.trial.commission.benches import (
    GEAR,
    MOTOR,
    RATE,
    first_failure,
    order_for,
    right_text,
    watch,
)
from tests.rig.trial.commission.test_wrong_descriptions import BEFORE, ROWS, Wrong


def served(*, coupled: bool) -> tuple[WireBench, int]:
    """A bench behind a hub of its own, and its port."""
    bench = WireBench(
        GEAR,
        MOTOR,
        world=World.of(4),
        cycle_ns=round(1e9 / RATE),
        clock=WallClock(),
        gear_mounted=coupled,
    )
    told: SimpleQueue[Addresses] = SimpleQueue()

    def behind_a_hub() -> None:
        serve(bench, port=0, readout=None, announce=told.put)

    threading.Thread(target=behind_a_hub, daemon=True).start()
    return bench, told.get(timeout=30.0).port


def found_by(row: Wrong, folder: Path) -> tuple[str, str, float]:
    """The stage that finds what is wrong, its sentence, and how fast the coupled motor was ever driven [rad/s]."""
    benches = {coupled: served(coupled=coupled) for coupled in (True, False)}
    paths: dict[bool, Path] = {}
    for coupled, (_, port) in benches.items():
        paths[coupled] = folder / f"{coupled}.toml"
        text = row.edit(right_text()).replace("port = 29536", f"port = {port}")
        paths[coupled].write_text(text, encoding="utf-8")
    order = order_for(paths[True], backend=HARDWARE, mounting=row.mounting, config=paths[True])
    driven = [0.0]
    watch(benches[True][0], driven.append)

    def make(order: Order, setup: Setup) -> AssembledRig:
        rig = make_port(replace(order, config=paths[setup.gear_mounted]), setup)
        return replace(rig, person=Person(benches[setup.gear_mounted][0]).act)

    stage, seen = first_failure(order, make, ("listen", *BEFORE))
    blocking = [one.sentence for one in seen.findings if one.severity == "blocks"] if seen else [""]
    return stage, blocking[0], max(driven)


def main() -> None:
    asked = set(sys.argv[1:])
    rows = (Wrong("nothing", lambda text: text, "", ""), *ROWS)
    for row in rows:
        if row.analog_scale or (asked and row.name not in asked):
            continue
        with tempfile.TemporaryDirectory() as folder:
            os.environ[VARIABLE] = str(Path(folder, "state"))
            began = time.monotonic()
            stage, sentence, fastest = found_by(row, Path(folder))
            right = "as on the wire" if stage == row.stage else f"ANOTHER STAGE THAN {row.stage}"
            print(
                f"{row.name:36} {stage or 'none':10} {right:16} coupled {fastest:g} rad/s "
                f"{time.monotonic() - began:5.1f} s  {sentence[:110]}",
                flush=True,
            )


if __name__ == "__main__":
    main()
