"""A simulated rig as a process of its own, for tests: prints its port, serves until it is terminated."""

from __future__ import annotations

import json
import sys

from model.gear_file import shipped_gear
from model.motor import shipped_motor
from sim_backend.wire.serve import Addresses, make_bench, serve


def announce(addresses: Addresses) -> None:
    """Tell where the rig is, as one line."""
    print(json.dumps({"port": addresses.port, "readout": addresses.readout}), flush=True)


if __name__ == "__main__":
    rate = float(sys.argv[1])
    bench = make_bench(shipped_gear(), shipped_motor(), seed=3, cycle_ns=round(1e9 / rate))
    serve(bench, port=0, readout="socket", announce=announce, lifetime=60.0)
