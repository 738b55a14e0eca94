"""Recordings with known truth for the identification tests: quantised counts of a gear whose error
and friction are given.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import lfilter

from model.friction import friction_torque
from model.gear import HarmonicDrive
from model.identify.angle_fit import AngleFit, solve_angle
from model.identify.angle_regression import AngleRegression, Basis
from model.identify.checks import channels
from model.identify.encoders import Encoders
from model.identify.kinematic_error import (
    KinematicErrorAccumulator,
    KinematicErrorFit,
    fit_traverses,
)
from model.identify.running_torque import RunningTorque, average_torque
from model.units import ARCMIN, REVOLUTION, RPM

Array = NDArray[np.float64]
RATIO = 120.0
OUTPUT_QUANTUM = REVOLUTION / 72000.0
INPUT_QUANTUM = REVOLUTION / 32768.0
TRUTH = {
    1.0: (0.10, 0.10),
    2.0: (0.30, 0.10),
    4.0: (0.08, 0.0),
    2.0 + 2.0 / RATIO: (0.05, 0.02),
    2.0 - 1.0 / RATIO: (0.02, 0.01),
    1.0 / RATIO: (0.30, 0.10),
    2.0 / RATIO: (0.05, 0.05),
}
"""Orders of the kinematic error with their a and b [arcmin]."""


def error_curve(angle: Array) -> Array:
    """The true kinematic error at input angles [rad]."""
    total = np.zeros_like(angle)
    for order, (a, b) in TRUTH.items():
        total += ARCMIN * (a * np.cos(order * angle) + b * np.sin(order * angle))
    return total


def counted(values: Array, quantum: float) -> Array:
    return (np.floor(values / quantum) + 0.5) * quantum


@dataclass(frozen=True)
class SlowRun:
    time: Array
    input_angle: Array
    output_angle: Array


def slow_run(
    seed: int,
    *,
    speed_rpm: float = 61.8,
    rate: float = 1000.0,
    revolutions: float = 125.0,
    direction: float = 1.0,
    noise: float = 0.0,
) -> SlowRun:
    """A kinematic-error run in one direction with speed ripple; both angles counted; `noise` [rad]
    white at the output.
    """
    random = np.random.default_rng(seed)
    n = int(revolutions / (speed_rpm / 60.0) * rate)
    time = np.arange(n) / rate
    angle = random.uniform(0.0, REVOLUTION) + direction * speed_rpm * RPM * time
    angle = angle + 0.003 * np.sin(REVOLUTION * 1.3 * time + random.uniform(0.0, 6.0))
    output = angle / RATIO + error_curve(angle) + 1.234 + noise * random.standard_normal(n)
    return SlowRun(time, counted(angle, INPUT_QUANTUM), counted(output, OUTPUT_QUANTUM))


def hold(
    gear: HarmonicDrive,
    speed_rpm: float,
    seed: int,
    *,
    revolutions: int = 4,
    rate: float = 500.0,
    zero: float = 0.01,
    motor: float = 0.0,
    geared: bool = True,
    noise: float = 0.004,
    gain: float = 1.0,
    extra: float = 0.0,
) -> RunningTorque:
    """One hold at constant speed: gear friction, motor friction [N m], cogging, offset of the zero, AR(1) noise."""
    random = np.random.default_rng(seed)
    speed = speed_rpm * RPM
    n = int(max(revolutions * 60.0 / abs(speed_rpm), 1.0) * rate) + 20
    time = np.arange(n) / rate
    angle = random.uniform(0.0, REVOLUTION) + speed * time
    friction = float(friction_torque(gear, np.array([speed]))[0]) if geared else 0.0
    friction += np.sign(speed) * motor * (1.0 + abs(speed) / 300.0)
    coloured = lfilter([1.0], [1.0, -0.8], noise * random.standard_normal(n))
    torque = (
        gain * (friction + 0.004 * np.cos(2.0 * angle) + 0.003 * np.sin(4.0 * angle))
        + zero
        + coloured
        + extra
    )
    return average_torque(time, counted(angle, INPUT_QUANTUM), torque)


def sweep(
    gear: HarmonicDrive, seed: int, speeds_rpm: Array, **options: float
) -> list[RunningTorque]:
    """Holds at all speeds in both directions."""
    found = []
    for i, speed in enumerate(speeds_rpm):
        for sign in (1.0, -1.0):
            turns = 2 if speed < 10.0 else 8
            found.append(
                hold(
                    gear,
                    float(sign * speed),
                    1000 * seed + 2 * i + (sign > 0),
                    revolutions=turns,
                    **options,
                )
            )  # type: ignore[arg-type]
    return found


SPEEDS = np.concatenate([np.geomspace(1.0, 100.0, 18), np.geomspace(130.0, 3000.0, 12)])


def fit_kinematic_error(
    input_angle: ArrayLike,
    output_angle: ArrayLike,
    ratio: float,
    *,
    basis: Basis | None = None,
    encoders: Encoders | None = None,
    edge_triggered: bool = False,
    accuracy_order: float | None = None,
) -> KinematicErrorFit:
    """The kinematic error from whole arrays [rad], shape (n,): one direction, steady, at low speed.
    See the accumulator.
    """
    accumulator = KinematicErrorAccumulator(
        ratio, basis=basis, encoders=encoders, edge_triggered=edge_triggered
    )
    accumulator.add(input_angle, output_angle)
    return accumulator.fit(accuracy_order=accuracy_order)


def fit_both_ways(
    runs: Sequence[SlowRun], *, wind_up: float = 0.0, encoders: Encoders | None = None
) -> list[KinematicErrorFit]:
    """Traverses of one gear in the orders that all have; what `wind_up` [rad] takes off changes sign with the way."""
    sums = []
    for run in runs:
        way = float(np.sign(run.input_angle[-1] - run.input_angle[0]))
        accumulator = KinematicErrorAccumulator(RATIO, encoders=encoders)
        accumulator.add(run.input_angle, run.output_angle - way * wind_up)
        sums.append(accumulator)
    return fit_traverses(sums)


def fit_over_angle(angle: ArrayLike, value: ArrayLike, basis: Basis) -> AngleFit:
    """Any channel over the input angle by the same streaming regression: trend, orders, covariance by blocks."""
    x, y = channels(16, angle=angle, value=value)
    regression = AngleRegression(basis.ratio)
    regression.add(x, y)
    return solve_angle(regression.cells(), basis)[0]
