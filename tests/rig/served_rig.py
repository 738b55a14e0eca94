"""A simulated rig as a process of its own, for tests: prints its port, serves until it is terminated.

By set speed, without a gear (`wire-bare`), by target position (`wire-csp`) or by analog reference (`wire-analog`).
Where it is wanted it logs how fast the plant turns, on the computer's monotonic clock, which all processes share.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from drivers.bus.cyclic import CanRig
from drivers.bus.network import BusConfig, open_raw_bus
from drivers.clock import Clock, VirtualClock, WallClock
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench.backends.assembly import AssembledRig
from rig.bench.backends.order import Order
from rig.bench.backends.simulated import (
    position_config,
    reference_config,
    reference_device,
    wire_config,
)
from rig.bench.hub import hub_id
from rig.bench.state import state_places
from sim_backend.wire.bench import WireBench
from sim_backend.wire.serve import Addresses, serve
from sim_backend.world import World

TEMPLATE = resources.files("rig.bench.config").joinpath("template.toml").read_text(encoding="utf-8")


@dataclass
class Served:
    """A simulated rig in a process of its own."""

    process: subprocess.Popen[str]
    port: int
    log: Path | None = None

    def configuration(self, folder: Path, *, guard_closed: int = 8) -> Path:
        """The description of it."""
        text = re.sub(r'interface = "socketcan" ', 'interface = "socketcand" ', TEMPLATE)
        text = text.replace(
            "# arguments = {}", f'arguments = {{ host = "127.0.0.1", port = {self.port} }} #'
        )
        text += f"\n[guard]\nnode_id = 1\nmask = 8\nclosed = {guard_closed}\n"
        path = folder / "rig.toml"
        path.write_text(text, encoding="utf-8")
        return path

    def plant(self) -> np.ndarray:
        """When [ns, monotonic clock] and how fast [rad/s] the input of the plant turned, so far: rows of both."""
        assert self.log is not None
        lines = self.log.read_text(encoding="utf-8").split("\n")[:-1]
        return np.array([[float(word) for word in line.split()] for line in lines]).reshape(-1, 2)

    def forget(self) -> None:
        """A hub is the bench at its address: the trip of a test before is nobody's now."""
        for _, state in state_places(hub_id("127.0.0.1", self.port, "can0"), site=False):
            shutil.rmtree(state)


@contextmanager
def served_rig(
    rate: float, carrier: str = "wire", log: Path | None = None, lifetime: float = 150.0
) -> Iterator[Served]:
    """Start one, with SYNC at `rate` [Hz], and end it, after `lifetime` [s] at the latest."""
    told = [str(rate), carrier, str(log or ""), str(lifetime)]
    command = [sys.executable, "-m", "tests.rig.served_rig", *told]
    root = Path(__file__).parents[2]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=root) as process:
        assert process.stdout is not None
        port = json.loads(process.stdout.readline())["port"]
        served = Served(process, port, log)
        served.forget()
        yield served
        process.terminate()


def announce(addresses: Addresses) -> None:
    """Tell where the rig is, as one line."""
    print(json.dumps({"port": addresses.port, "readout": addresses.readout}), flush=True)


LOG_INTERVAL_NS = 2_000_000
"""ns between two lines of the log at least."""


def bench_of(carrier: str, rate: float, clock: Clock) -> WireBench:
    """The bench that is served: the same parts wherever it is made, so that its drivers can be described elsewhere."""
    gear, motor = shipped_gear(), shipped_motor()
    reference = None
    if carrier == "wire-analog":
        reference = reference_device(Order(protocol="", gear=gear, motor=motor), motor)
    return WireBench(
        gear,
        motor,
        world=World.of(3),
        cycle_ns=round(1e9 / rate),
        clock=clock,
        silence_cycles=1,
        gear_mounted=carrier != "wire-bare",
        reference=reference,
    )


def reached_rig(carrier: str, rate: float, port: int) -> AssembledRig:
    """The drivers in front of a served rig, over the hub in real time; `wire_config` and its like describe it."""
    bench, motor, clock = bench_of(carrier, rate, VirtualClock()), shipped_motor(), WallClock()
    configs = {"wire-csp": position_config, "wire-analog": reference_config}
    address = {"host": "127.0.0.1", "port": port}
    bus = BusConfig(interface="socketcand", channel="can0", arguments=address, stamps="host")
    can_rig = CanRig(
        configs.get(carrier, wire_config)(bench, motor, has_guard=True),
        clock,
        lambda: open_raw_bus(bus),
        time_base=bus.time_base,
    )
    return AssembledRig(
        name=carrier,
        port=can_rig,
        clock=clock,
        real_time=True,
        nodes=lambda: can_rig.nodes,
        second_bus=lambda: open_raw_bus(bus),
        guard=lambda: (1, True),
    )


def log_the_plant(bench: WireBench, path: Path) -> None:
    """Write down how fast the plant turns whenever its time goes on."""
    file = path.open("w", encoding="utf-8", buffering=1)
    latest = [0]

    def told(name: str) -> None:
        go_on = getattr(bench, name)

        def call(*arguments: Any, **more: Any) -> Any:
            result = go_on(*arguments, **more)
            now = time.monotonic_ns()
            if now - latest[0] >= LOG_INTERVAL_NS:
                latest[0] = now
                file.write(f"{now} {bench.plant.input_speed:.4f}\n")
            return result

        setattr(bench, name, call)

    told("elapse")
    told("send")


if __name__ == "__main__":
    rate, carrier, log, lifetime = float(sys.argv[1]), *sys.argv[2:4], float(sys.argv[4])
    bench = bench_of(carrier, rate, WallClock())
    if log:
        log_the_plant(bench, Path(log))
    serve(bench, port=0, readout="socket", announce=announce, lifetime=lifetime)
