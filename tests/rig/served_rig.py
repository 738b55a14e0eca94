"""A simulated rig as a process of its own, for tests: prints its port, serves until it is terminated."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench.identity import new_bench_id
from sim_backend.wire.serve import Addresses, make_bench, serve

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
        # Each rig that is served is a bench of its own: the trip of one test is nobody else's.
        text = text.replace('id = ""', f'id = "{new_bench_id()}"')
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
        yield Served(process, json.loads(process.stdout.readline())["port"])
        process.terminate()


def announce(addresses: Addresses) -> None:
    """Tell where the rig is, as one line."""
    print(json.dumps({"port": addresses.port, "readout": addresses.readout}), flush=True)


if __name__ == "__main__":
    cycle_ns = round(1e9 / float(sys.argv[1]))
    bench = make_bench(shipped_gear(), shipped_motor(), seed=3, cycle_ns=cycle_ns)
    serve(bench, port=0, readout="socket", announce=announce, lifetime=60.0)
