"""An ideal rig for tests: walks a plan, follows every set-point, and writes what perfect kinematics
plus stated errors give.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np
import scipy

from experiments.recording import ArraySource, Recording, RunMetadata, Segment
from experiments.steps.follow import Corrected
from experiments.steps.vocabulary import (
    FindIndex,
    FollowTable,
    HoldRevolutions,
    HoldTime,
    Mark,
    MoveRevolutions,
    MoveToAngle,
    Prompt,
    Ramp,
    SegmentLabel,
    ServoOff,
    Settle,
    SpeedStep,
    Step,
    TorqueRamp,
)
from model.channel import Calibration, Channel
from model.dynamics import simulate_prescribed
from model.friction import friction_torque
from model.gear import Harmonic, HarmonicDrive
from model.kinematic_error import series_value
from model.units import REVOLUTION

RATE = 1000.0
INPUT_COUNTS = 8192 * 4
OUTPUT_COUNTS = 18000 * 4
TORQUE_QUANTUM = 2e-4
SPEED_QUANTUM = 1e-5
LAG = 0.88
"""Pole of the elastic bench's drive per cycle: a rise of some 17 ms."""


@dataclass(frozen=True, kw_only=True)
class Bench:
    """What is wrong with the ideal rig. Torques in N m, angles in rad."""

    gear: HarmonicDrive
    error: tuple[Harmonic, ...] = ()
    motor: Callable[[np.ndarray], np.ndarray] = lambda speed: (
        0.012 * np.sign(speed) + 3.8e-5 * speed
    )
    cogging: tuple[Harmonic, ...] = ()
    depth: tuple[Harmonic, ...] = ()
    """Friction that varies with the angle, with the sign of the speed [N m]."""
    breakaway: float = 0.09
    offset: float = 0.01
    drift: float = 0.0
    """Drift of the torque zero over the run [N m]."""
    noise: float = 0.002
    index: float = 1.0
    output_index: float = 0.02
    output_shows: tuple[Harmonic, ...] = ()
    """What the output encoder, which counts down, shows too much over its own angle from its mark [rad]."""
    mounted: bool = True
    seed: int = 1
    ratio: float = 0.0
    elastic: bool = False
    """Whether the output answers the input by equation 2, and the drive takes some milliseconds to
    follow a set-point.
    """


@dataclass(kw_only=True)
class _Walk:
    speed: list[np.ndarray] = field(default_factory=list)
    powered: list[np.ndarray] = field(default_factory=list)
    held: list[np.ndarray] = field(default_factory=list)
    segments: list[Segment] = field(default_factory=list)
    rows: int = 0
    angle: float = 0.3
    setpoint: float = 0.0

    def add(self, speed: np.ndarray, powered: bool = True, held: np.ndarray | None = None) -> None:
        self.speed.append(speed)
        self.powered.append(np.full(len(speed), powered))
        self.held.append(np.full(len(speed), np.nan) if held is None else held)
        self.rows += len(speed)
        self.angle += float(speed.sum()) / RATE
        if len(speed):
            self.setpoint = float(speed[-1])

    def constant(self, speed: float, cycles: int) -> None:
        self.add(np.full(max(cycles, 1), speed))

    def ramp(self, speed: float, acceleration: float) -> None:
        cycles = max(1, math.ceil(abs(speed - self.setpoint) / acceleration * RATE))
        self.add(np.linspace(self.setpoint, speed, cycles + 1)[1:])


def _cycles(revolutions: float, speed: float) -> int:
    return math.ceil(revolutions * REVOLUTION / abs(speed) * RATE) + 1


def _move(walk: _Walk, angle: float, speed: float, acceleration: float) -> None:
    top = math.copysign(min(abs(speed), math.sqrt(abs(angle) * acceleration)), angle)
    walk.ramp(top, acceleration)
    left = abs(angle) - top * top / acceleration
    if left > 0.0:
        walk.constant(top, round(left / abs(top) * RATE))
    walk.ramp(0.0, acceleration)


def _step(walk: _Walk, step: Step, bench: Bench) -> None:
    if isinstance(step, ServoOff):
        walk.add(np.zeros(round(step.duration * RATE)), powered=False)
    elif isinstance(step, Ramp):
        walk.ramp(step.speed, step.acceleration)
    elif isinstance(step, SpeedStep):
        turn = step.least_revolutions * REVOLUTION / abs(step.speed)
        walk.constant(step.speed, math.ceil(max(step.duration, turn) * RATE) + 1)
    elif isinstance(step, HoldRevolutions):
        walk.constant(walk.setpoint, _cycles(step.revolutions, walk.setpoint))
    elif isinstance(step, FollowTable):
        correction = step.table.of(step.speed)
        at = np.array([walk.angle - bench.index])
        begin = float(at[0] if step.fade else correction.nominal(at)[0])
        fade = step.fade * REVOLUTION
        profile = Corrected(step.speed, begin, 1.0 / RATE, correction, fade)
        walk.add(profile.targets(0, _cycles(step.revolutions, step.speed)))
    elif isinstance(step, HoldTime):
        walk.constant(walk.setpoint, round(step.duration * RATE))
    elif isinstance(step, Settle):
        walk.constant(walk.setpoint, round(2.0 * step.window * RATE))
    elif isinstance(step, MoveRevolutions):
        _move(walk, step.revolutions * REVOLUTION, step.speed, step.acceleration)
    elif isinstance(step, MoveToAngle):
        way = math.copysign(1.0, step.speed)
        ahead = way * (step.phase - (walk.angle - bench.index)) % REVOLUTION
        ahead += 0.0 if ahead > 0.1 else REVOLUTION
        _move(walk, way * ahead, step.speed, step.acceleration)
    elif isinstance(step, FindIndex):
        if step.which == "input":
            ahead = (bench.index - walk.angle) % REVOLUTION
        else:
            ratio = bench.gear.ratio
            ahead = (ratio * bench.output_index - walk.angle) % (REVOLUTION * ratio)
        ahead = (
            ahead
            if ahead > 0.05
            else ahead + REVOLUTION * (1.0 if step.which == "input" else bench.gear.ratio)
        )
        walk.constant(step.speed, math.ceil(ahead / step.speed * RATE) + 2)
    elif isinstance(step, TorqueRamp):
        still = math.ceil(bench.breakaway / abs(step.rate) * RATE)
        torque = np.arange(1, still + 1) / RATE * step.rate
        walk.add(np.zeros(still), held=torque)
        cycles = 1
        while 0.5 * 40.0 * (cycles / RATE) ** 2 < step.motion:
            cycles += 1
        speed = np.sign(step.rate) * 40.0 * np.arange(1, cycles + 1) / RATE
        walk.add(speed, held=torque[-1] + np.arange(1, cycles + 1) / RATE * step.rate)


def record(plan: Iterable[Step], bench: Bench, experiment: str, **metadata: object) -> Recording:
    """The recording that this bench makes of a plan, in counts."""
    walk = _Walk()
    for step in plan:
        if isinstance(step, Mark | Prompt):
            continue
        start = walk.rows
        _step(walk, step, bench)
        label: SegmentLabel | None = step.segment
        if label is not None:
            walk.segments.append(
                Segment(
                    index=len(walk.segments),
                    label=label.label,
                    start=start,
                    stop=walk.rows,
                    setpoint=label.setpoint,
                    direction=label.direction,
                    repeat=label.repeat,
                )
            )
    return assemble(walk, bench, experiment, **metadata)


def assemble(walk: _Walk, bench: Bench, experiment: str, **extra: object) -> Recording:
    """Channels in counts from what was walked."""
    random = np.random.default_rng(bench.seed)
    speed, powered, held = (
        np.concatenate(parts) for parts in (walk.speed, walk.powered, walk.held)
    )
    if bench.elastic:
        speed = np.asarray(scipy.signal.lfilter([1.0 - LAG, 0.0], [1.0, -LAG], speed))
        angle = 0.3 + scipy.integrate.cumulative_simpson(speed, dx=1.0 / RATE, initial=0.0)
    else:
        angle = 0.3 + np.concatenate([[0.0], np.cumsum(speed)[:-1]]) / RATE
    ratio = bench.ratio or bench.gear.ratio
    relative = angle - bench.index
    if bench.elastic:
        gear = dataclasses.replace(bench.gear, kinematic_error=bench.error)
        answer = simulate_prescribed(
            gear, relative, 1.0 / RATE, input_speed=speed, smoothing_speed=0.5
        )
        output = answer.output_angle + bench.index / ratio
    else:
        output = angle / ratio + series_value(bench.error, relative)
    torque = bench.motor(speed) + series_value(bench.cogging, relative)
    if bench.mounted:
        torque = (
            torque
            + friction_torque(bench.gear, speed)
            + np.sign(speed) * series_value(bench.depth, relative)
        )
    torque = np.where(np.isnan(held), torque, held)
    torque = (
        np.where(powered, torque, 0.0)
        + bench.offset
        + bench.drift * np.linspace(0.0, 1.0, len(speed))
    )
    torque = torque + bench.noise * random.standard_normal(len(speed))
    q_in, q_out = REVOLUTION / INPUT_COUNTS, REVOLUTION / OUTPUT_COUNTS
    marks = bench.index + REVOLUTION * np.floor((angle - bench.index) / REVOLUTION)
    turn_in = np.floor((angle - bench.index) / REVOLUTION)
    seen_input = np.maximum.accumulate((turn_in != turn_in[0]).astype(int))
    turn_out = np.floor((output - bench.output_index) / REVOLUTION)
    seen_output = np.maximum.accumulate((turn_out != turn_out[0]).astype(int))
    latch_out = bench.output_index + REVOLUTION * turn_out
    shown = -output + series_value(bench.output_shows, bench.output_index - output)
    arrays = {
        "input_angle": np.round(angle / q_in).astype(np.int64),
        "output_angle": np.round(shown / q_out).astype(np.int64),
        "torque": np.round(torque / TORQUE_QUANTUM).astype(np.int64),
        "input_index": np.round(marks / q_in).astype(np.int64) * seen_input,
        "output_index": np.round(-latch_out / q_out).astype(np.int64) * seen_output,
        "index_seen": seen_input + 2 * seen_output,
    }
    signals = {
        "input_angle": Channel(name="input_angle", unit="rad", scale=q_in),
        "output_angle": Channel(name="output_angle", unit="rad", scale=q_out),
        "torque": Channel(
            name="torque",
            unit="N m",
            scale=TORQUE_QUANTUM,
            calibration=Calibration(scale_relative_uncertainty=0.01),
        ),
        "input_index": Channel(name="input_index", unit="rad", scale=q_in),
        "output_index": Channel(name="output_index", unit="rad", scale=q_out),
        "index_seen": Channel(name="index_seen", unit="1", is_counted=False),
    }
    if experiment == "compensated-error":
        arrays["target_speed"] = np.round(speed / SPEED_QUANTUM).astype(np.int64)
        signals["target_speed"] = Channel(name="target_speed", unit="rad/s", scale=SPEED_QUANTUM)
    known: dict[str, object] = {
        "ratio": bench.gear.ratio,
        "gear_mounted": bench.mounted,
        "sample_rate": RATE,
        "time_base": "virtual",
        "gear": bench.gear,
        "origin": "simulated",
        "run_id": "synthetic-1",
        "experiment": experiment,
    }
    info = RunMetadata(**{**known, **extra})  # type: ignore[arg-type]
    times = np.arange(len(speed), dtype=np.int64) * round(1e9 / RATE)
    return Recording(info, signals, tuple(walk.segments), (), ArraySource(arrays, times))
