"""Time and memory of the order spectrum over a long recording that is read as it is needed, beside a plain transform.

    python -m tests.benchmarks.orders_length --rows 20e6 --per-turn 300

The samples are made when they are asked for, as a run file would be read; the plain transform holds
them all. Printed: processor time [s], largest memory [MB], and the error of each order.
"""

from __future__ import annotations

import argparse
import resource
import time
from typing import Any

import numpy as np

from experiments import catalogue
from experiments.contract import Evidence
from experiments.recording import Recording, RunMetadata
from model.channel import Channel
from model.gear_file import shipped_gear
from model.units import REVOLUTION

ORDERS = {4.0: 0.05, 2.0167: 0.02, 24.0: 0.01}
"""Amplitudes [N m] by order."""
RATE = 1000.0


class Lazy:
    """A channel over an angle that is made row by row when it is asked for."""

    def __init__(self, rows: int, per_turn: float) -> None:
        self.rows = rows
        self._step = REVOLUTION / per_turn

    def stored(self, name: str, start: int, stop: int) -> np.ndarray:
        angle = self._step * np.arange(start, min(stop, self.rows))
        if name == "input_angle":
            return angle
        noise = 0.05 * np.random.default_rng(start).standard_normal(len(angle))
        return 0.1 + sum(size * np.cos(order * angle) for order, size in ORDERS.items()) + noise

    def time_ns(self, start: int, stop: int) -> np.ndarray:
        return (np.arange(start, min(stop, self.rows)) * (1e9 / RATE)).astype(np.int64)

    def flags(self, start: int, stop: int) -> np.ndarray:
        return np.zeros(min(stop, self.rows) - start, dtype=np.uint16)


def recording(rows: int, per_turn: float) -> Recording:
    """The recording as an analysis sees it."""
    metadata = RunMetadata(
        run_id="long", experiment="", origin="imported", time_base="device", sample_rate=RATE
    )
    signals = {
        name: Channel(name=name, unit=unit, is_counted=False)
        for name, unit in (("input_angle", "rad"), ("torque", "N m"))
    }
    return Recording(metadata, signals, (), (), Lazy(rows, per_turn))


def main() -> None:
    """Measure one length."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=float, default=20e6)
    parser.add_argument("--per-turn", type=float, default=300.3)
    parser.add_argument("--kind", default="order-spectrum")
    parser.add_argument("--plain", action="store_true", help="the plain transform instead")
    given = parser.parse_args()
    run = recording(int(given.rows), given.per_turn)
    start = time.process_time()
    if given.plain:
        found = plain(run, given.per_turn)
    else:
        result = catalogue.load(given.kind).analyse(run, Evidence(shipped_gear()))
        found = {
            float(name.removeprefix("amplitude_")): e.value
            for name, e in result.estimates.items()
            if name.startswith("amplitude_")
        }
    seconds = time.process_time() - start
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(f"{run.rows} rows: {seconds:.1f} s of processor time, {memory:.0f} MB")
    for order, size in ORDERS.items():
        value = found.get(order)
        told = "absent" if value is None else f"{100.0 * (value / size - 1.0):+.3f} %"
        print(f"order {order:g}: {told}")


def plain(run: Recording, per_turn: float) -> dict[float, float]:
    """The whole recording in memory, transformed at once; the largest line beside each order."""
    torque: Any = run.si("torque")
    lines = 2.0 * np.abs(np.fft.rfft(torque - torque.mean())) / len(torque)
    at = {order: round(order / per_turn * len(torque)) for order in ORDERS}
    return {order: float(lines[max(k - 1, 0) : k + 2].max()) for order, k in at.items()}


if __name__ == "__main__":
    main()
