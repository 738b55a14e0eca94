"""Synthetic recordings of two channels, with their truth: encoders apart in time, loops of torque over torsion."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from tests.benchmarks.recordings_cases import SCALE, Case, recording_of


def encoders(random: np.random.Generator) -> Case:
    """Input and output angle of a gear that is driven to and fro at many speeds, the output late and behind."""
    rate = float(np.exp(random.uniform(np.log(100.0), np.log(5_000.0))))
    seconds = min(random.uniform(10.0, 40.0), 60_000 / rate)
    time = np.arange(int(seconds * rate)) / rate
    jitter = random.uniform(0.02, 0.2) if random.random() < 0.3 else 0.0
    time = time + jitter / rate * random.uniform(-1.0, 1.0, len(time))
    delay = random.choice([0.0, random.uniform(-3e-3, 3e-3), random.uniform(-0.02, 0.02)])
    ratio = float(random.integers(50, 161))
    lines = [
        (random.uniform(low, high), random.uniform(5.0, 40.0), random.uniform(0.0, 6.28))
        for low, high in ((0.05, 0.2), (0.3, 0.9))
    ]

    def turned(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        parts = [(a, 2.0 * np.pi * f, 2.0 * np.pi * f * at + p) for f, a, p in lines]
        angle = np.sum([a * np.sin(x) for a, _, x in parts], axis=0)
        return angle, np.sum([a * w * np.cos(x) for a, w, x in parts], axis=0)

    half = random.choice([0.0, float(np.exp(random.uniform(np.log(2e-5), np.log(5e-4))))])
    angle, _ = turned(time)
    before, speed = turned(time - delay)
    output = before / ratio - half * np.sign(speed)
    counts = [2.0 * np.pi / float(np.exp(random.uniform(np.log(8e3), np.log(4e6)))) for _ in "io"]
    noisy = [
        np.round((v + 0.3 * q * random.standard_normal(len(v))) / q) * q
        for v, q in zip((angle, output), counts, strict=True)
    ]
    is_stated = bool(random.random() < 0.5)
    process: dict[str, Any] = {"stated": {"lag_s": {"output_angle": delay}}} if is_stated else {}
    stamps = np.round(time * 1e9).astype(np.int64)
    made = recording_of(
        "skew", stamps, process, input_angle=(noisy[0], "rad"), output_angle=(noisy[1], "rad")
    )
    metadata = replace(made.metadata, ratio=ratio, output_sense=1)
    return Case(
        kind="skew",
        recording=replace(made, metadata=metadata),
        truth={"skew": delay, "gain": 1.0 / ratio, "hysteresis": -half},
        seen={},
        settings={"first": "input_angle", "second": "output_angle"},
        facts={
            "rate": rate,
            "jitter": jitter,
            "delay": delay,
            "half": half,
            "counts": counts,
            "stated": is_stated,
        },
    )


def torque_loops(random: np.random.Generator) -> Case:
    """Slow swings of a spring with friction elements (Jenkins), whose numbers have closed forms."""
    stiffness = float(np.exp(random.uniform(np.log(2e3), np.log(2e5))))
    swing = random.uniform(1e-3, 4e-3)
    # Every element slips well before half the amplitude, and together they are a part of the whole.
    shares = random.uniform(0.01, 0.05, int(random.integers(1, 4)))
    elements = [(s * stiffness * swing, random.uniform(0.02, 0.1) * swing) for s in shares]
    number, rows = int(random.integers(3, 9)), int(random.integers(300, 3000))
    period = random.uniform(5.0, 60.0)
    time = np.arange(int((number + 0.4) * rows)) * (period / rows)
    lag = random.uniform(0.002, 0.02) * period if random.random() < 0.3 else 0.0

    def torque_at(at: np.ndarray) -> np.ndarray:
        angle = swing * np.sin(2.0 * np.pi * at / period)
        total = stiffness * angle
        for limit, give in elements:
            force, spring, last = 0.0, limit / give, 0.0
            for k, place in enumerate(angle.tolist()):
                force = min(max(force + spring * (place - last), -limit), limit)
                total[k] += force
                last = place
        return total

    amplitude = stiffness * swing
    noise = amplitude * float(np.exp(random.uniform(np.log(1e-4), np.log(1e-2))))
    scale = 1.0 + SCALE * random.standard_normal()
    torque = scale * torque_at(time - lag) + noise * random.standard_normal(len(time))
    count = swing / float(np.exp(random.uniform(np.log(300.0), np.log(3e4))))
    angle = swing * np.sin(2.0 * np.pi * time / period)
    angle = np.round((angle + 0.3 * count * random.standard_normal(len(time))) / count) * count
    level = amplitude * random.uniform(0.03, 0.2)
    limits = sum(limit for limit, _ in elements)
    truth = {
        "branch_stiffness": stiffness,
        "secant_stiffness": stiffness + limits / swing,
        "loss": sum(4.0 * limit * (swing - give) for limit, give in elements),
        "hysteresis_loss": 2.0 * limits / stiffness,
        "lost_motion": 2.0 * level / stiffness,
    }
    scaled = {n: scale * truth[n] for n in ("branch_stiffness", "secant_stiffness", "loss")}
    process: dict[str, Any] = {"stated": {"lag_s": {"output_torque": lag}}} if lag else {}
    return Case(
        kind="hysteresis",
        recording=recording_of(
            "hysteresis",
            np.round(time * 1e9).astype(np.int64),
            process,
            position=(angle, "rad"),
            output_torque=(torque, "N m"),
        ),
        truth=truth,
        # At the level that this bench reads.
        seen={**scaled, "lost_motion": truth["lost_motion"] / scale},
        settings={"at_torque": float(level)},
        facts={
            "loops": number,
            "rows": rows,
            "lag": lag,
            "noise": noise / amplitude,
            "counts": swing / count,
        },
    )
