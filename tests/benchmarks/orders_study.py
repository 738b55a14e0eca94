"""How often orders are found, and how often their intervals hold the truth: synthetic recordings of any sampling.

    python -m tests.benchmarks.orders_study --first-seed 9761 --recordings 40 --workers 1 --json > rows.jsonl

Each seed is a recording of its own: motion, rate (50 Hz to 20 kHz), orders (0.5 to 400, aliased or
not), noise, rounding of the angle, gaps, jitter and an error of the torque's scale. A line of JSON
per true order, one per order that is claimed ("yes") and is none, and one per recording; a table at
the end of standard error. `peer` is the amplitude that a plain transform over an even grid of angle
gives of the same recording.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

MOTIONS = ("constant", "drift", "both", "robot")
MOST_ROWS = 40_000
SCALE = 0.05
"""Bounds of the torque's scale error, rectangular: what an unknown torque constant is taken for."""
TURN = 2.0 * math.pi
Line = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Made:
    """One synthetic recording: time [s], angle as recorded [rad], torque as recorded [N m], and what is true."""

    motion: str
    rate: float
    time: np.ndarray
    angle: np.ndarray
    torque: np.ndarray
    true_angle: np.ndarray
    orders: dict[float, float]
    scale: float
    noise: float


def made(seed: int) -> Made:
    """The recording of a seed."""
    random = np.random.default_rng([seed, 12])
    motion = str(random.choice(MOTIONS))
    rate = float(50.0 * 400.0 ** random.random())
    rows = min(MOST_ROWS, max(3000, int(rate * random.uniform(20.0, 60.0))))
    clock = np.arange(rows) / rate
    clock = clock + random.uniform(0.0, 0.2) / rate * random.standard_normal(rows) * 0.5
    clock = np.sort(clock)
    true_angle = _turned(motion, clock, random)
    kept = _without_gaps(rows, random)
    clock, true_angle = clock[kept], true_angle[kept]
    orders = _orders(motion, true_angle, random)
    noise = float(10.0 ** random.uniform(-3.0, -1.5))
    torque = _background(motion, clock, true_angle, random)
    for order, size in orders.items():
        torque += size * np.cos(order * true_angle + random.uniform(0.0, TURN))
    smooth = int(random.choice((1, 1, 5)))
    raw = random.standard_normal(len(clock) + smooth - 1)
    torque += noise * np.convolve(raw, np.full(smooth, 1.0 / math.sqrt(smooth)), "valid")
    scale = 1.0 + float(random.uniform(-SCALE, SCALE))
    counts = float(random.choice((0.0, 4096.0, 16384.0, 131072.0)))
    angle = true_angle if counts == 0.0 else np.rint(true_angle * counts / TURN) * TURN / counts
    return Made(
        motion=motion,
        rate=rate,
        time=clock,
        angle=angle,
        torque=scale * torque,
        true_angle=true_angle,
        orders=orders,
        scale=scale,
        noise=noise,
    )


def _turned(motion: str, clock: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """The angle over time [rad]."""
    span = float(clock[-1])
    if motion == "robot":
        # Moves between poses with pauses, minimum jerk; the joint covers a part of a revolution or two.
        reach = random.uniform(0.3, 2.0) * TURN
        poses = reach * random.random(int(random.integers(8, 16)))
        ends = np.sort(random.uniform(0.0, span, 2 * len(poses) - 2))
        angle = np.full(len(clock), poses[0])
        for k, (begin, end) in enumerate(zip(ends[::2], ends[1::2], strict=True)):
            x = np.clip((clock - begin) / max(end - begin, 1e-3), 0.0, 1.0)
            angle += (poses[k + 1] - poses[k]) * x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
        return angle
    turns = float(10.0 ** random.uniform(-0.5, 1.2))
    if motion == "both":
        half = 0.5 * span
        pause = 0.02 * span
        there = np.clip(clock, 0.0, half) - np.clip(clock - half - pause, 0.0, span)
        return TURN * turns * there
    drift = 0.0 if motion == "constant" else float(10.0 ** random.uniform(-4.0, -1.3))
    return TURN * turns * (clock + 0.5 * drift * clock**2 / span)


def _without_gaps(rows: int, random: np.random.Generator) -> np.ndarray:
    kept = np.ones(rows, dtype=bool)
    for _ in range(int(random.integers(0, 3))):
        at = int(random.integers(0, rows))
        kept[at : at + int(rows * random.uniform(0.001, 0.03))] = False
    return kept


def _orders(motion: str, angle: np.ndarray, random: np.random.Generator) -> dict[float, float]:
    """True orders with their amplitudes [N m]."""
    found: dict[float, float] = {}
    covered = np.ptp(angle) / TURN
    for _ in range(int(random.integers(1, 5))):
        highest = 400.0 if motion == "robot" or random.random() < 0.3 else 40.0
        lowest = 60.0 if motion == "robot" else 0.5
        order = float(lowest * (highest / lowest) ** random.random())
        order = round(order) if random.random() < 0.7 and order > 0.8 else order
        if order * covered > 4.0 and all(abs(order - v) * covered > 4.0 for v in found):
            found[order] = float(10.0 ** random.uniform(-2.5, -0.5))
    return found or {float(round(max(80.0, 6.0 / covered))): 0.05}


def _background(
    motion: str, clock: np.ndarray, angle: np.ndarray, random: np.random.Generator
) -> np.ndarray:
    """Friction by direction, a drift, and a robot's inertia and gravity [N m]."""
    speed = np.gradient(angle, clock)
    torque = 0.2 * np.sign(np.where(np.abs(speed) > 1e-4, speed, 0.0)) + 0.05
    torque += 0.02 * clock / clock[-1]
    if motion == "robot":
        pull = random.uniform(0.0, 2.0)
        torque += 0.1 * speed + 0.05 * np.gradient(speed, clock) + pull * np.cos(angle)
    return torque


def run_seed(seed: int) -> list[Line]:
    """The lines of one recording."""
    from experiments import catalogue
    from experiments.contract import Evidence
    from experiments.errors import AnalysisError
    from model.gear_file import shipped_gear
    from tests.experiments.test_analyses_without_plan import foreign

    one = made(seed)
    recording = foreign(one.time, input_angle=(one.angle, "rad"), torque=(one.torque, "N m"))
    head = {"seed": seed, "motion": one.motion, "rate": round(one.rate, 1)}
    # The highest order asked for is the study's, not the recording's: nothing is told of the truth.
    evidence = Evidence(shipped_gear(), settings={"highest_order": 420.0})
    start = time.process_time()
    try:
        result = catalogue.load("order-spectrum").analyse(recording, evidence)
    except AnalysisError as refusal:
        return [{"what": "recording", **head, "outcome": "refused", "words": str(refusal)}]
    seconds = time.process_time() - start
    lines: list[Line] = []
    covered = np.ptp(one.true_angle) / TURN
    near = max(1.0 / covered, 1e-3)
    steps = np.abs(np.gradient(one.true_angle))
    per_turn = TURN / float(np.median(steps[steps > 0.1 * steps.mean()]))
    named = {
        float(name.rpartition("_")[2]): e
        for name, e in result.estimates.items()
        if name.startswith("amplitude_")
    }
    start = time.process_time()
    peer = plain_transform(one.angle, one.torque)
    peer_seconds = time.process_time() - start
    for order, size in one.orders.items():
        at = min(named, key=lambda v, order=order: abs(v - order), default=math.inf)
        line = {
            "what": "order",
            **head,
            "order": order,
            "truth": size,
            "whole": order == round(order),
            "in_band": order <= 0.4 * per_turn,
            "answered": "absent",
            "peer": peer(order) / one.scale,
        }
        if abs(at - order) <= near:
            e = named[at]
            line |= {
                "answered": e.identifiable,
                "value": e.value,
                "note": e.note,
                "u": e.expanded_uncertainty,
                "a": e.low <= one.scale * size <= e.high,
                "b": abs(e.value - size) <= e.expanded_uncertainty,
            }
        elif order > 0.4 * per_turn:
            images = folded(order, per_turn)
            seen = [e for v, e in named.items() if any(abs(v - i) <= near for i in images)]
            if seen:
                line |= {"answered": f"image {seen[0].identifiable}", "note": seen[0].note}
        lines.append(line)
    for at, e in named.items():
        if e.identifiable == "yes" and min(abs(at - v) for v in one.orders) > near:
            lines.append({"what": "false", **head, "order": at, "value": e.value})
    lines.append(
        {
            "what": "recording",
            **head,
            "outcome": "analysed",
            "rows": len(one.time),
            "per_turn": per_turn,
            "noise": one.noise,
            "seconds": seconds,
            "peer_seconds": peer_seconds,
        }
    )
    return lines


def folded(order: float, per_turn: float) -> list[float]:
    """Where an order may stand in evenly taken samples: at |k S - order|."""
    folds = range(1, math.ceil(2.0 * order / per_turn) + 1)
    return [abs(fold * per_turn - order) for fold in folds]


def plain_transform(angle: np.ndarray, torque: np.ndarray) -> Any:
    """What people do: the longest way in one direction, interpolated onto an even grid of angle, transformed."""
    way = np.sign(np.gradient(angle))
    cuts = np.flatnonzero(np.diff(way)) + 1
    longest = max(np.split(np.arange(len(angle)), cuts), key=lambda rows: np.ptp(angle[rows]))
    theta, value = angle[longest], torque[longest]
    order = np.argsort(theta, kind="stable")
    grid = np.linspace(theta.min(), theta.max(), max(len(theta), 16))
    even = np.interp(grid, theta[order], value[order])
    lines = 2.0 * np.abs(np.fft.rfft(even - even.mean())) / len(even)
    spacing = TURN / max(float(np.ptp(theta)), 1e-9)

    def amplitude(at: float) -> float:
        k = round(at / spacing)
        return float(lines[max(k - 1, 0) : k + 2].max()) if k < len(lines) else math.nan

    return amplitude


def table(lines: Sequence[Line]) -> str:
    """Coverage and missing answers per group of orders, and what was claimed and is none."""
    text = [
        "group                     n   yes  weakly  no  image  absent   (a) %   (b) %   peer error %"
    ]
    orders = [line for line in lines if line["what"] == "order"]
    for motion in (*MOTIONS, "all"):
        for in_band in (True, False):
            own = [
                line
                for line in orders
                if line["in_band"] is in_band and motion in ("all", line["motion"])
            ]
            yes = [line for line in own if line["answered"] == "yes"]
            share = {
                key: 100.0 * float(np.mean([line[key] for line in yes])) if yes else math.nan
                for key in ("a", "b")
            }
            off = [100.0 * abs(line["peer"] / line["truth"] - 1.0) for line in own]
            count = [
                sum(line["answered"] == word for line in own)
                for word in ("yes", "weakly", "no", "absent")
            ]
            images = sum(line["answered"].startswith("image") for line in own)
            name = f"{motion}, {'in' if in_band else 'above'} band"
            text.append(
                f"{name:22s} {len(own):4d} {count[0]:5d} {count[1]:7d} {count[2]:3d} {images:6d} {count[3]:7d} "
                f"{share['a']:7.1f} {share['b']:7.1f} {np.median(off) if off else math.nan:10.1f}"
            )
    false = sum(line["what"] == "false" for line in lines)
    whole = [line for line in lines if line["what"] == "recording"]
    refused = sum(line["outcome"] == "refused" for line in whole)
    text.append(f"claimed and none: {false} in {len(whole)} recordings, of which {refused} refused")
    return "\n".join(text)


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first-seed", type=int, required=True)
    parser.add_argument("--recordings", type=int, default=40)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--json", action="store_true", help="lines of JSON on standard output")
    given = parser.parse_args()
    seeds = range(given.first_seed, given.first_seed + given.recordings)
    lines: list[Line] = []
    with ProcessPoolExecutor(given.workers) as pool:
        for found in pool.map(run_seed, seeds):
            lines += found
            if given.json:
                for line in found:
                    print(json.dumps(line), flush=True)
    print(table(lines), file=sys.stderr)


if __name__ == "__main__":
    main()
