"""A simulated rig as a process of its own, for tests: prints its port, serves until it is terminated."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench.hub import hub_id
from rig.bench.state import state_places
from sim_backend.wire.serve import Addresses, make_bench, serve
from sim_backend.world import World

TEMPLATE = resources.files("rig.bench.config").joinpath("template.toml").read_text(encoding="utf-8")


@dataclass
class Served:
    """A simulated rig in a process of its own."""

    process: subprocess.Popen[str]
    port: int

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


@contextmanager
def served_rig(rate: float) -> Iterator[Served]:
    """Start one, with SYNC at `rate` [Hz], and end it."""
    command = [sys.executable, "-m", "tests.rig.served_rig", str(rate)]
    root = Path(__file__).parents[2]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=root) as process:
        assert process.stdout is not None
        port = json.loads(process.stdout.readline())["port"]
        # A hub is the bench at its address: the trip of a test that had this port before is nobody's now.
        for _, state in state_places(hub_id("127.0.0.1", port, "can0"), site=False):
            shutil.rmtree(state)
        yield Served(process, port)
        process.terminate()


def announce(addresses: Addresses) -> None:
    """Tell where the rig is, as one line."""
    print(json.dumps({"port": addresses.port, "readout": addresses.readout}), flush=True)


if __name__ == "__main__":
    cycle_ns = round(1e9 / float(sys.argv[1]))
    bench = make_bench(shipped_gear(), shipped_motor(), world=World.of(3), cycle_ns=cycle_ns)
    serve(bench, port=0, readout="socket", announce=announce, lifetime=600.0)
