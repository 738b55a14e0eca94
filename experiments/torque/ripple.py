"""What ripples of torque and speed do to a mean torque over the angle, where the torque is shown late.

The mean over angle holds the product of both ripples, half the sum of Re(T_n conj(w_n)/w). A port that lags by t (first
order) hides i n w t T_n of T_n. The sum of trapezoids over angle holds only a share sin(b)/b of that product, b = n w
times the sampling period: at a quarter of the rate a third is missing. A speed loop takes power from ripples (T_n
opposes w_n): the mean comes out too large, of a bare motor by its cogging.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from experiments.evidence import usable
from experiments.recording import Recording
from experiments.torque.running_torque import Hold
from model.arrays import ComplexArray, FloatArray
from model.units import REVOLUTION

PORT_LAG = "lag of the torque port"
"""Its line in budgets."""
LAG = 1e-3
"""s by which a torque port lags where its bench has not measured it, assumed; 0 to twice as much."""
_LAG_RELATIVE = 1.0 / math.sqrt(3.0)
"""Relative standard uncertainty of that."""
_ROWS = 20_000
"""Rows of a hold that are looked at, its last ones."""
_TREND = 2
"""Degree of the polynomial over time that stands for the turning of the output and its own slow orders in a block."""
_SEEN = 4.0
"""Mean square of an order over that of the noise from which on it is a motion."""
_BLOCK_ROWS, _BLOCK_REVOLUTIONS = 80, 5.0
"""A block has at least so many rows and covers so many input revolutions, all of a shorter hold, but one at least."""
_LEAST_REVOLUTIONS = 0.95
"""Input revolutions that a hold needs."""
_REVOLUTION_ROWS = 200
"""Rows per input revolution that are enough."""


def port_lag(recording: Recording, channel: str) -> tuple[float, float, str]:
    """How late a torque is shown [s], the standard uncertainty of that, and where both are from."""
    known = recording.signals[channel].calibration
    if known.lag is None or known.lag_uncertainty is None:
        return LAG, _LAG_RELATIVE * LAG, f"{1e3 * LAG:g} ms, 0 to twice as much"
    return known.lag, known.lag_uncertainty, f"{1e3 * known.lag:.3g} ms, learnt on this bench"


@dataclass(frozen=True)
class LateTorque:
    """What the mean torque of a hold would change [N m, positive where it brakes] if the port's lag were taken out
    (`lag`, standard uncertainty `lag_uncertainty`), and if ripples were integrated exactly between the samples.
    """

    lag: float = 0.0
    lag_uncertainty: float = 0.0
    between: float = 0.0


@dataclass(frozen=True)
class Waves:
    """Complex amplitudes c (signals, blocks, orders) of Re(c exp(i n theta)) in each block, theta growing, and mean
    squares of the noise of an amplitude (signals,)."""

    amplitude: ComplexArray
    noise: FloatArray

    def squares(self, which: int) -> FloatArray:
        """Mean squares of the amplitudes of a signal over the blocks (orders,), 0 where they are noise."""
        mean = np.mean(np.abs(self.amplitude[which]) ** 2, axis=0)
        noise = self.noise[which]
        return np.where(mean > _SEEN * noise, mean - noise, 0.0)

    def late(
        self, orders: FloatArray, speed: float, port: tuple[float, float], period: float
    ) -> LateTorque:
        """Of the first two signals, input angle and torque, at an input speed [rad/s]; `port`: its lag and the standard
        uncertainty of that [s], `period` [s] of the samples.
        """
        swing = 0.5j * orders * self.mean_product(0, 1)
        per_second = float((1j * swing * orders * speed).real.sum())
        # np.sinc has pi in it; what a sum of trapezoids is short of.
        missing = 1.0 - np.sinc(orders * speed * period / math.pi)
        return LateTorque(
            port[0] * per_second, port[1] * per_second, float((swing * missing).real.sum())
        )

    def mean_product(self, angle: int, torque: int) -> ComplexArray:
        """-conj(a) T, in the mean over blocks (orders,).

        i n of it is the torque times the ripple of the speed over its mean (amplitude i n a).
        """
        return -np.mean(np.conj(self.amplitude[angle]) * self.amplitude[torque], axis=0)


def waves_of(
    recording: Recording, hold: Hold, names: Sequence[str], orders: FloatArray
) -> Waves | None:
    """The orders of some signals of a hold by blocks; None where it is too short."""
    rows = slice(max(hold.segment.start, hold.segment.stop - _ROWS), hold.segment.stop)
    per_turn = REVOLUTION * recording.metadata.sample_rate / abs(hold.torque.speed)
    good = np.flatnonzero(usable(recording, rows))[:: max(1, int(per_turn / _REVOLUTION_ROWS))]
    angle = recording.si("input_angle", rows)[good]
    turns = abs(angle[-1] - angle[0]) / REVOLUTION if len(angle) else 0.0
    if turns < _LEAST_REVOLUTIONS:
        return None
    size = max(_BLOCK_ROWS, math.ceil(min(_BLOCK_REVOLUTIONS / turns, 1.0) * len(angle)))
    blocks = len(angle) // size
    if blocks == 0:
        return None
    signals = [
        recording.output_angle(rows)[good] if n == "output_angle" else recording.si(n, rows)[good]
        for n in names
    ]
    moved = np.array([s[: blocks * size].reshape(blocks, size) for s in signals])
    turned = hold.torque.direction * moved[0]
    moved = moved - moved.mean(axis=2, keepdims=True)
    place = np.broadcast_to(np.linspace(-1.0, 1.0, size), turned.shape)
    waves = [f(n * turned) for n in orders for f in (np.cos, np.sin)]
    design = np.stack([*(place**k for k in range(_TREND + 1)), *waves], axis=2)
    # Normal equations: columns are of unit size, and what aliases away is cut off.
    right = np.moveaxis(moved, 0, 2)
    inverse = np.linalg.pinv(design.mT @ design, rcond=1e-6, hermitian=True)
    solution = inverse @ (design.mT @ right)
    residual = right - design @ solution
    noise = 4.0 * np.mean(residual**2, axis=(0, 1)) / size
    parts = np.moveaxis(solution[:, _TREND + 1 :, :], 2, 0)
    return Waves(parts[:, :, 0::2] - 1j * parts[:, :, 1::2], noise)
