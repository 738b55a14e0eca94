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
from rig.bench.commissioning import STAGES
from rig.bench.config.apply import configured_limits
from rig.bench.config.load import load_configuration
from rig.bench.state import VARIABLE
from rig.run.start import bench_for
from rig.run.stop import StopRequest
from rig.trial.commission.conduct import do_stage
from rig.trial.commission.work import Work
from sim_backend.wire.bench import WireBench
from sim_backend.wire.person import Person
from sim_backend.wire.serve import Addresses, serve
from sim_backend.world import World
from tests.rig.trial.commission.benches import GEAR, MOTOR, RATE, right_text
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


def first_failure(row: Wrong, folder: Path) -> tuple[str, str, float]:
    """The stage that finds what is wrong, its sentence, and how fast the coupled motor was ever driven [rad/s]."""
    benches = {coupled: served(coupled=coupled) for coupled in (True, False)}
    paths: dict[bool, Path] = {}
    for coupled, (_, port) in benches.items():
        paths[coupled] = folder / f"{coupled}.toml"
        text = row.edit(right_text()).replace("port = 29536", f"port = {port}")
        paths[coupled].write_text(text, encoding="utf-8")
    configuration = load_configuration(paths[True])
    order = Order(
        protocol="commission",
        backend=HARDWARE,
        operator="A. Example",
        serial="SN-1",
        folder=folder,
        sample_rate=configuration.rig.sample_rate_hz,
        limits=configured_limits(configuration),
        mounting=row.mounting,  # type: ignore[arg-type]
        config=paths[True],
    )
    fastest = [0.0]
    demand = benches[True][0].drive.demand

    def watched() -> tuple[object, float]:
        mode, target = demand()
        fastest[0] = max(fastest[0], abs(target))
        return mode, target

    benches[True][0].drive.demand = watched  # type: ignore[method-assign, assignment]

    def make(order: Order, setup: Setup) -> AssembledRig:
        rig = make_port(replace(order, config=paths[setup.gear_mounted]), setup)
        return replace(rig, person=Person(benches[setup.gear_mounted][0]).act)

    for stage in STAGES:
        if stage.name not in ("listen", *BEFORE):
            continue
        work = Work(
            order=order,
            bench=bench_for(order),
            ask=lambda prompt: None,
            stop=StopRequest(),
            now=lambda: "2026-11-27T08:00:00+00:00",
            make=make,
        )
        seen = do_stage(stage, work, "described")
        if not seen.is_fine:
            failed = next(one for one in seen.findings if one.severity == "blocks")
            return stage.name, failed.sentence, fastest[0]
    return "", "", fastest[0]


def main() -> None:
    asked = set(sys.argv[1:])
    rows = (Wrong("nothing", lambda text: text, "", ""), *ROWS)
    for row in rows:
        if row.analog_scale or (asked and row.name not in asked):
            continue
        with tempfile.TemporaryDirectory() as folder:
            os.environ[VARIABLE] = str(Path(folder, "state"))
            began = time.monotonic()
            stage, sentence, fastest = first_failure(row, Path(folder))
            right = "as on the wire" if stage == row.stage else f"ANOTHER STAGE THAN {row.stage}"
            print(
                f"{row.name:36} {stage or 'none':10} {right:16} coupled {fastest:g} rad/s "
                f"{time.monotonic() - began:5.1f} s  {sentence[:110]}",
                flush=True,
            )


if __name__ == "__main__":
    main()
