"""Small runs for the tests of the Python interface."""

from __future__ import annotations

from typing import Any

import numpy as np

from experiments.recording import ArraySource, Recording, RunMetadata, Segment
from model.channel import Channel
from rig.api.runs import Run

RATE = 200.0
ROWS = 2000


def swinging(run_id: str = "SWING", *, noise: float = 1e-3, seed: int = 9910) -> Run:
    """A shaft that swings under its own friction: torque = J a + b w + c sign w, with noise."""
    t = np.arange(ROWS) / RATE
    angle = 3.0 * np.sin(2 * np.pi * 0.9 * t) + 1.0 * np.sin(2 * np.pi * 0.31 * t)
    speed = np.gradient(angle, t)
    torque = 2e-3 * np.gradient(speed, t) + 5e-3 * speed + 0.08 * np.sign(speed)
    torque += np.random.default_rng(seed).normal(0.0, noise, ROWS)
    return made({"input_angle": ("rad", angle), "torque": ("N m", torque)}, run_id=run_id)


def made(channels: dict[str, tuple[str, np.ndarray]], **metadata: Any) -> Run:
    """A run in memory of these channels: unit and values."""
    facts: dict[str, Any] = {
        "run_id": "MADE",
        "experiment": "",
        "origin": "imported",
        "sample_rate": RATE,
        "time_base": "device",
    }
    rows = len(next(iter(channels.values()))[1])
    signals = {
        name: Channel(name=name, unit=unit, is_counted=False, long_name=f"{name} of a test")
        for name, (unit, _) in channels.items()
    }
    times = np.rint(np.arange(rows) * (1e9 / RATE)).astype(np.int64)
    source = ArraySource({name: values for name, (_, values) in channels.items()}, times)
    segments = (Segment(index=0, label="part", start=10, stop=30, setpoint=1.5, direction=1),)
    return Run(Recording(RunMetadata(**{**facts, **metadata}), signals, segments, (), source))
