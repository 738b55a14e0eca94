"""Coverage of the analyses of recordings, over synthetic joints and friction tables that nobody looked at before.

    python -m tests.benchmarks.recordings_study --first-seed 9721 --recordings 40 --workers 2 --json rows.jsonl

Every seed is one recording: three of four are joints that move (standstill 0 to 70 %, torque late,
jitter, gaps, gravity, quantisation, 50 Hz to 20 kHz, a Stribeck dip), one of four is a table of
friction over speed (any static against Coulomb friction, either direction or both, wrong points,
presliding, any unit). Truth and recording are made here, by none of the code that is studied.

Prints per quantity (a) how often the statistical interval holds what this bench sees (the truth
with the bench's own torque scale), (b) how often value ± U holds the truth, and how often there is
no answer: refused, or not called identified. `--json FILE` keeps every row as a line.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from experiments import catalogue
from experiments.contract import Evidence
from experiments.errors import AnalysisError
from experiments.recording import ArraySource, Recording, RunMetadata
from model.channel import Channel
from model.gear_file import shipped_gear

MOST_ROWS = 120_000
SCALE = 0.03
"""Standard deviation of a bench's torque scale: what the analysis assumes where nobody states it."""
SCALED = ("inertia", "viscous", "coulomb", "static", "offset", "load_sin_1", "load_cos_1")


@dataclass(frozen=True, kw_only=True)
class Case:
    """A recording, the kind that analyses it, settings, the truth by quantity, and what it was made with."""

    kind: str
    recording: Recording
    truth: dict[str, float]
    scale: float
    settings: dict[str, Any] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)


def _recording(
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
        recording=_recording(
            "motion",
            np.round(time[kept] * 1e9).astype(np.int64),
            {"stated": {"lag_s": {"torque": lag}}} if is_stated else {},
            position=(place[kept], "rad"),
            torque=(measured[kept], "N m"),
        ),
        truth=truth,
        scale=scale,
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
        recording=_recording(
            "friction-curve", np.arange(len(speed), dtype=np.int64), {}, **channels
        ),
        truth=truth,
        scale=scale,
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


def study(seed: int) -> list[dict[str, Any]]:
    """One recording analysed: a row per quantity of its truth."""
    random = np.random.default_rng(seed)
    case = friction_table(random) if seed % 4 == 0 else joint(random)
    head = {"seed": seed, "kind": case.kind, **case.facts}
    try:
        result = catalogue.load(case.kind).analyse(
            case.recording, Evidence(shipped_gear(), settings=case.settings)
        )
    except AnalysisError as error:
        return [
            {**head, "quantity": name, "truth": truth, "refused": str(error)}
            for name, truth in case.truth.items()
        ]
    rows = []
    for name, truth in case.truth.items():
        row: dict[str, Any] = {**head, "quantity": name, "truth": truth}
        if name in result.estimates:
            e = result.estimates[name]
            row |= {
                "seen": truth * (case.scale if name in SCALED else 1.0),
                "value": e.value,
                "low": e.low,
                "high": e.high,
                "U": e.expanded_uncertainty,
                "identifiable": e.identifiable,
                "note": e.note,
            }
        rows.append(row)
    return rows


def summary(rows: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Per kind and quantity: answered "yes", (a) and (b) of those, and the share without an answer."""
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["kind"], row["quantity"]), []).append(row)
    lines = []
    for (kind, quantity), group in sorted(groups.items()):
        answered = [row for row in group if row.get("identifiable") == "yes"]
        a = [row["low"] <= row["seen"] <= row["high"] for row in answered]
        b = [abs(row["value"] - row["truth"]) <= row["U"] for row in answered]
        lines.append(
            {
                "kind": kind,
                "quantity": quantity,
                "recordings": len(group),
                "answered": len(answered),
                "a": float(np.mean(a)) if a else None,
                "b": float(np.mean(b)) if b else None,
                "not_answered": 1.0 - len(answered) / len(group),
                "refused": sum("refused" in row for row in group),
            }
        )
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first-seed", type=int, default=9721)
    parser.add_argument("--recordings", type=int, default=40)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--json", type=Path, help="file that takes every row as a line")
    chosen = parser.parse_args()
    seeds = range(chosen.first_seed, chosen.first_seed + chosen.recordings)
    with ProcessPoolExecutor(chosen.workers) as pool:
        rows = [row for part in pool.map(study, seeds) for row in part]
    if chosen.json:
        chosen.json.write_text("".join(json.dumps(row) + "\n" for row in rows), encoding="utf-8")
    for line in summary(rows):
        print(json.dumps(line))


if __name__ == "__main__":
    main()
