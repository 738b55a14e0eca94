"""Time and memory of the kind motion on a recording of any length, which is made as it is read.

    python -m tests.benchmarks.motion_length --rows 20000000

Prints one JSON object: rows, seconds, peak of the resident memory [MB], and the parameters over
their truths. The recording lies nowhere: position, torque and time of a block are computed when the
analysis asks for them, so that the peak is that of the analysis.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from experiments import catalogue
from experiments.contract import Evidence
from experiments.recording import Recording, RunMetadata
from model.channel import Channel
from model.gear_file import shipped_gear

RATE = 1000.0
LINES = ((0.11, 1.0), (0.37, 0.4), (1.3, 0.1))
"""Frequencies [Hz] and amplitudes [rad] of the motion."""
TRUTH = {"inertia": 0.3, "viscous": 2.0, "coulomb": 1.0, "offset": 0.05}


@dataclass(frozen=True)
class MadeSource:
    """A rotary axis with friction in a motion of three lines; rows are made when they are read."""

    rows: int

    def time_ns(self, start: int, stop: int) -> NDArray[np.int64]:
        return np.arange(start, min(stop, self.rows), dtype=np.int64) * int(1e9 / RATE)

    def flags(self, start: int, stop: int) -> NDArray[np.uint16]:
        return np.zeros(min(stop, self.rows) - start, dtype=np.uint16)

    def stored(self, name: str, start: int, stop: int) -> NDArray[np.float64]:
        rows = np.arange(start, min(stop, self.rows))
        time = rows / RATE
        noise = _noise(rows, 1 if name == "position" else 2)
        position, speed, acceleration = np.zeros((3, len(time)))
        for frequency, size in LINES:
            w = 2.0 * np.pi * frequency
            position += size * np.sin(w * time)
            speed += size * w * np.cos(w * time)
            acceleration -= size * w**2 * np.sin(w * time)
        if name == "position":
            return position + 1e-5 * noise
        moved = TRUTH["inertia"] * acceleration + TRUTH["viscous"] * speed
        return moved + TRUTH["coulomb"] * np.sign(speed) + TRUTH["offset"] + 0.02 * noise


def _noise(rows: NDArray[np.int64], kind: int) -> NDArray[np.float64]:
    """Noise of variance one that is the same whenever a row is read: bits of its number, mixed."""
    mixed = (rows + kind * 0x9E3779B9).astype(np.uint64)
    for shift, factor in ((33, 0xFF51AFD7ED558CCD), (33, 0xC4CEB9FE1A85EC53)):
        mixed = (mixed ^ (mixed >> np.uint64(shift))) * np.uint64(factor)
    uniform = (mixed >> np.uint64(11)).astype(np.float64) / 2.0**53
    return (uniform - 0.5) * np.sqrt(12.0)


def made_recording(rows: int) -> Recording:
    """A recording of that length, of an imported origin."""
    metadata = RunMetadata(
        run_id="made", experiment="", origin="imported", time_base="device", sample_rate=RATE
    )
    units = {"position": "rad", "torque": "N m"}
    signals = {
        name: Channel(name=name, unit=unit, is_counted=False) for name, unit in units.items()
    }
    return Recording(metadata, signals, (), (), MadeSource(rows))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=20_000_000)
    rows = parser.parse_args().rows
    analyse = catalogue.load("motion").analyse
    begun = time.perf_counter()
    result = analyse(made_recording(rows), Evidence(shipped_gear()))
    seconds = time.perf_counter() - begun
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    ratios = {name: result.estimates[name].value / truth for name, truth in TRUTH.items()}
    print(json.dumps({"rows": rows, "seconds": seconds, "peak_mb": peak, "over_truth": ratios}))


if __name__ == "__main__":
    main()
