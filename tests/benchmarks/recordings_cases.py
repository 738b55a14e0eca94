"""Synthetic joints in motion and tables of friction, with their truth: made by none of the code that is studied."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from experiments.recording import ArraySource, Recording, RunMetadata
from model.channel import Channel

MOST_ROWS = 120_000
SCALE = 0.03
"""Standard deviation of a bench's torque scale: what the analysis assumes where nobody states it."""
SCALED = ("inertia", "viscous", "coulomb", "static", "offset", "load_sin_1", "load_cos_1")


@dataclass(frozen=True, kw_only=True)
class Case:
    """A recording, the kind that analyses it, settings, the truth by quantity, what the bench itself sees where that
    is another number, and what it was made with.
    """

    kind: str
    recording: Recording
    truth: dict[str, float]
    seen: dict[str, float]
    settings: dict[str, Any] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)


def recording_of(
    kind: str, stamps: np.ndarray, process: dict[str, Any], **channels: tuple[np.ndarray, str]
) -> Recording:
    base = "none" if kind == "friction-curve" else "device"
    metadata = RunMetadata(
        run_id=kind, experiment="", origin="imported", time_base=base, process=process
    )
    signals = {
        name: Channel(name=name, unit=unit, is_counted=False)
        for name, (_, unit) in channels.items()
    }
    arrays = {name: values for name, (values, _) in channels.items()}
    return Recording(metadata, signals, (), (), ArraySource(arrays, stamps))


def joint(random: np.random.Generator) -> Case:
    """A joint in a motion from place to place, or in a sum of sines."""
    rate = float(np.exp(random.uniform(np.log(50.0), np.log(20_000.0))))
    seconds = min(random.uniform(20.0, 60.0), MOST_ROWS / rate)
    seconds = max(seconds, 2000.0 / rate)
    time = np.arange(int(seconds * rate)) / rate
    jitter = random.uniform(0.02, 0.2) if random.random() < 0.3 else 0.0
    time = time + jitter / rate * random.uniform(-1.0, 1.0, len(time))
    lag = random.uniform(0.002, 0.02) if random.random() < 0.4 else 0.0
    dwell = random.choice([0.0, random.uniform(0.05, 0.7)])
    slowness = min(seconds / 25.0, 1.5)
    course = (
        _moves(random, seconds, dwell, slowness) if dwell else _sines(random, seconds, slowness)
    )
    size = float(np.exp(random.uniform(np.log(0.1), np.log(10.0))))
    position, speed, acceleration, _ = course(time, size)
    top, hard = np.quantile(np.abs(speed), 0.99), np.quantile(np.abs(acceleration), 0.99)
    coulomb = float(np.exp(random.uniform(np.log(0.05), np.log(20.0))))
    truth = {
        "inertia": coulomb * random.uniform(0.2, 2.0) / hard,
        "viscous": coulomb * random.uniform(0.2, 2.0) / top,
        "coulomb": coulomb,
        "offset": coulomb * random.uniform(-0.2, 0.2),
    }
    gravity = coulomb * random.uniform(0.5, 5.0) if random.random() < 0.3 else 0.0
    dip = coulomb * random.uniform(0.3, 1.0) if random.random() < 0.2 else 0.0
    critical = top * random.uniform(0.05, 0.2)
    _, v, a, held = course(time - lag, size)
    q = course(time - lag, size)[0]
    friction = (coulomb + dip * np.exp(-((v / critical) ** 2))) * np.sign(v)
    friction = np.where(np.isnan(held), friction, held * coulomb)
    torque = truth["inertia"] * a + truth["viscous"] * v + friction + truth["offset"]
    torque = torque + gravity * np.sin(q)
    scale = 1.0 + SCALE * random.standard_normal()
    noise = coulomb * float(np.exp(random.uniform(np.log(0.003), np.log(0.1))))
    measured = scale * (torque + noise * random.standard_normal(len(time)))
    step = coulomb * random.choice([0.0, 0.01])
    measured = np.round(measured / step) * step if step else measured
    count = np.ptp(position) / float(np.exp(random.uniform(np.log(2e3), np.log(1e6))))
    place = position + 0.3 * count * random.standard_normal(len(time))
    place = np.round(place / count) * count
    kept = np.ones(len(time), dtype=bool)
    gaps = int(random.integers(1, 4)) if random.random() < 0.3 else 0
    for start in random.integers(0, len(time), gaps).tolist():
        kept[start : start + int(random.uniform(0.01, 0.08) * len(time))] = False
    is_stated = bool(lag and random.random() < 0.5)
    if gravity:
        truth |= {"load_sin_1": gravity, "load_cos_1": 0.0}
    if dip:
        truth |= {"static": coulomb + dip, "stribeck_velocity": critical}
    return Case(
        kind="motion",
        recording=recording_of(
            "motion",
            np.round(time[kept] * 1e9).astype(np.int64),
            {"stated": {"lag_s": {"torque": lag}}} if is_stated else {},
            position=(place[kept], "rad"),
            torque=(measured[kept], "N m"),
        ),
        truth=truth,
        seen={name: scale * v for name, v in truth.items() if name in SCALED},
        settings={"load": "gravity"} if gravity else {},
        facts={
            "rate": rate,
            "seconds": seconds,
            "dwell": float(dwell),
            "lag": lag,
            "lag_stated": is_stated,
            "jitter": jitter,
            "gaps": gaps,
            "gravity": bool(gravity),
            "dip": bool(dip),
            "noise": noise / coulomb,
            "counts": float(np.ptp(position) / count),
        },
    )


def _sines(random: np.random.Generator, seconds: float, slowness: float) -> Any:
    """A sum of three sines."""
    lines = [
        (
            random.uniform(low, high) / slowness,
            random.uniform(0.5, 1.0) * share,
            random.uniform(0, 6),
        )
        for low, high, share in ((0.1, 0.3, 1.0), (0.4, 0.8, 0.4), (1.0, 2.0, 0.15))
    ]

    def course(time: np.ndarray, size: float) -> tuple[np.ndarray, ...]:
        parts = [(size * s, 2.0 * np.pi * f, 2.0 * np.pi * f * time + p) for f, s, p in lines]
        return (
            np.sum([s * np.sin(x) for s, _, x in parts], axis=0),
            np.sum([s * w * np.cos(x) for s, w, x in parts], axis=0),
            np.sum([-s * w**2 * np.sin(x) for s, w, x in parts], axis=0),
            np.full(len(time), np.nan),
        )

    return course


def _moves(random: np.random.Generator, seconds: float, dwell: float, slowness: float) -> Any:
    """Moves of least jerk with rests, in which stiction holds any share of the Coulomb friction."""
    moves, at = [], 0.1
    while at < seconds:
        length = random.uniform(0.5, 1.5) * slowness
        rest = length * dwell / (1.0 - dwell) * random.uniform(0.6, 1.4)
        size = random.uniform(0.3, 1.0) * random.choice([-1.0, 1.0])
        moves.append((at, length, rest, size, random.uniform(-0.95, 0.95)))
        at += length + rest

    def course(time: np.ndarray, scale: float) -> tuple[np.ndarray, ...]:
        q, v, a = np.zeros((3, len(time)))
        held = np.zeros(len(time))
        for start, length, _, size, stuck in moves:
            x = np.clip((time - start) / length, 0.0, 1.0)
            q += scale * size * (10 * x**3 - 15 * x**4 + 6 * x**5)
            v += scale * size / length * (30 * x**2 - 60 * x**3 + 30 * x**4)
            a += scale * size / length**2 * (60 * x - 180 * x**2 + 120 * x**3)
            held[time >= start] = np.nan
            held[time >= start + length] = stuck
        return q, v, a, held

    return course


def friction_table(random: np.random.Generator) -> Case:
    """A table of friction over speed."""
    coulomb = float(np.exp(random.uniform(np.log(1e-3), np.log(1e3))))
    top = float(np.exp(random.uniform(np.log(1e-2), np.log(300.0))))
    count = int(random.integers(6, 60))
    slowest = float(np.exp(random.uniform(np.log(1e-3), np.log(0.05))))
    speed = top * np.geomspace(slowest, 1.0, count)
    both = bool(random.random() < 0.7)
    speed = np.concatenate([speed, -speed]) if both else speed
    v = np.abs(speed) / top
    truth = {"coulomb": coulomb, "viscous": coulomb * random.uniform(0.2, 2.0) / top}
    size = coulomb + truth["viscous"] * np.abs(speed)
    bends = bool(random.random() < 0.6)
    if bends:
        static = coulomb * random.uniform(0.3, 2.5)
        critical, shape = random.uniform(0.02, 0.2), random.uniform(0.5, 2.0)
        size = size + (static - coulomb) * np.exp(-((v / critical) ** shape))
        truth |= {"static": static, "stribeck_velocity": critical * top, "shape": shape}
    if both:
        truth["offset"] = coulomb * random.uniform(-0.1, 0.1)
    noise = coulomb * float(np.exp(random.uniform(np.log(0.002), np.log(0.03))))
    effort = np.sign(speed) * size + truth.get("offset", 0.0)
    effort = effort + noise * random.standard_normal(len(speed))
    wrong = int(random.integers(1, 1 + max(1, len(speed) // 12))) if random.random() < 0.4 else 0
    if len(speed) >= 20:
        rows = random.choice(len(speed), wrong, replace=False)
        effort[rows] *= random.choice([0.4, 1.8], len(rows))
    presliding = bool(random.random() < 0.2 and len(speed) >= 24)
    if presliding:
        slow = top * slowest * random.uniform(0.05, 0.9, 6) * random.choice([-1.0, 1.0], 6)
        slow = slow if both else np.abs(slow)
        speed = np.concatenate([speed, slow])
        effort = np.concatenate([effort, np.sign(slow) * coulomb * random.uniform(0.0, 0.9, 6)])
    scale = 1.0 + SCALE * random.standard_normal()
    channels = {"speed": (speed, "rad/s"), "torque": (scale * effort, "N m")}
    if random.random() < 0.5:
        channels["torque_uncertainty"] = (np.full(len(speed), scale * noise), "N m")
    return Case(
        kind="friction-curve",
        recording=recording_of(
            "friction-curve", np.arange(len(speed), dtype=np.int64), {}, **channels
        ),
        truth=truth,
        seen={name: scale * v for name, v in truth.items() if name in SCALED},
        facts={
            "points": len(speed),
            "both": both,
            "bends": bends,
            "wrong": wrong,
            "presliding": presliding,
            "noise": noise / coulomb,
            "stated": "torque_uncertainty" in channels,
        },
    )
