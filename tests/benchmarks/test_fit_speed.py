"""How fast fits are, and that a day of data takes no more memory than a quarter of an hour."""

from __future__ import annotations

import tracemalloc
from typing import Any

import numpy as np
import pytest

from model.friction import friction_torque
from model.gear_file import shipped_gear
from model.identify.friction import fit_friction
from model.identify.kinematic_error import KinematicErrorAccumulator
from model.identify.running_torque import RunningTorque
from model.kinematic_error import series_value
from model.units import RPM
from tests.benchmarks.conftest import Note

SAMPLES = 1_440_000
COUNTS_IN, COUNTS_OUT = 32768, 72000
GEAR = shipped_gear()


def counted_block(first: int, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Input and output angle at 5.0x r/min and 1 kHz, as both encoders count them."""
    gear = GEAR
    angle = 5.017 * RPM * 1e-3 * np.arange(first, first + samples)
    output = angle / gear.ratio + series_value(gear.kinematic_error, angle)
    turn = 2.0 * np.pi
    return np.floor(angle / turn * COUNTS_IN) * turn / COUNTS_IN, np.floor(
        output / turn * COUNTS_OUT
    ) * turn / COUNTS_OUT


def holds(seed: int) -> list[RunningTorque]:
    """Thirty speeds each way with 0.5 % noise."""
    gear, rng = shipped_gear(), np.random.default_rng(seed)
    speeds = np.geomspace(1.0, 3000.0, 30) * RPM
    found = []
    for sign in (1.0, -1.0):
        for i, speed in enumerate(sign * speeds):
            torque = float(np.asarray(friction_torque(gear, speed)))
            error = 0.005 * abs(torque)
            found.append(
                RunningTorque(
                    speed=float(speed),
                    torque=torque + error * rng.standard_normal(),
                    standard_error=error,
                    freedom=10.0,
                    revolutions=20,
                    time=float(i),
                )
            )
    return found


@pytest.mark.parametrize("profile", [False, True], ids=["fit", "fit and profile intervals"])
def test_friction_fit(benchmark: Any, note: Note, profile: bool) -> None:
    gear, points = shipped_gear(), holds(3)
    found = benchmark.pedantic(
        lambda: fit_friction(points, gear, profile=profile), rounds=20, warmup_rounds=2
    )
    what = "friction fit, 60 holds" + (", with profile intervals" if profile else "")
    note(what, 1e3 * float(benchmark.stats.stats.min), "ms", "<= 20")
    assert found.estimates["coulomb"].value == pytest.approx(gear.mesh_friction.coulomb, rel=0.1)


@pytest.mark.parametrize("edge", [False, True], ids=["every sample", "edge-triggered"])
def test_kinematic_error_fit(benchmark: Any, note: Note, edge: bool) -> None:
    block = counted_block(0, SAMPLES)

    def fit() -> float:
        accumulator = KinematicErrorAccumulator(120.0, edge_triggered=edge)
        accumulator.add(*block)
        return accumulator.fit().order(2.0).amplitude.value

    amplitude = benchmark.pedantic(fit, rounds=5, warmup_rounds=1)
    what = "kinematic-error fit of 1.44 million samples" + (", edge-triggered" if edge else "")
    note(what, float(benchmark.stats.stats.min), "s", "<= 0.1")
    assert amplitude > 0.0


def test_memory_of_a_long_recording(note: Note) -> None:
    peaks = []
    for times in (1, 100):
        accumulator = KinematicErrorAccumulator(120.0)
        tracemalloc.start()
        for part in range(times):
            for first in range(0, SAMPLES, 65536):
                accumulator.add(*counted_block(part * SAMPLES + first, min(65536, SAMPLES - first)))
        accumulator.fit()
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    note("peak memory, 144 million samples over 1.44 million", peaks[1] / peaks[0], "x", "1")
    assert peaks[1] < 1.1 * peaks[0]
