"""The torque's pattern over the input revolution, per direction: what both directions share and what turns its sign.

half-difference of the directions = friction that varies with the angle (and the wedge reaction F_b
de/dtheta, which friction loads); half-sum = cogging and everything else that does not know the
direction. Amplitudes are complex: c = a - ib of a cos(n theta) + b sin(n theta) = Re[c exp(i n
theta)].
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from experiments.evidence import usable
from experiments.recording import Recording, Segment
from experiments.torque.zero import TorqueZero
from model.arrays import ComplexArray, FloatArray
from model.identify.least_squares import student_quantile
from model.units import REVOLUTION

BINS = 512
HIGHEST_ORDER = 128


@dataclass(frozen=True)
class TorquePattern:
    """Amplitudes of whole orders 1..n of the torque over the input angle, from several traverses of one direction.

    amplitude (n,) complex [N m]; standard_error (n,) of its real and imaginary part each; mean [N m]; traverses used.
    """

    mean: float
    amplitude: ComplexArray
    standard_error: FloatArray
    traverses: int

    @property
    def orders(self) -> FloatArray:
        """1..n cycles per input revolution."""
        return np.arange(1.0, len(self.amplitude) + 1.0)

    def curve(self, angle: FloatArray, highest: int | None = None) -> FloatArray:
        """The pattern without its mean at input angles [rad]."""
        amplitude = self.amplitude[: highest or len(self.amplitude)]
        orders = np.arange(1, len(amplitude) + 1)
        return np.real(np.exp(1j * np.outer(angle, orders)) @ amplitude)


@dataclass(frozen=True)
class PatternPair:
    """Friction (half-difference) and cogging (half-sum) of two directions."""

    friction: TorquePattern
    cogging: TorquePattern
    forward: TorquePattern
    reverse: TorquePattern


def direction_patterns(
    recording: Recording,
    segments: Iterable[Segment],
    zero: TorqueZero,
    reference: float = 0.0,
    channel: str = "torque",
) -> PatternPair | None:
    """The patterns of whole revolutions in these segments, both directions; None where one of them has none.

    Angles count from `reference` [rad]. Streaming: memory does not grow with the run.
    """
    chosen = list(segments)
    patterns: list[TorquePattern] = []
    for direction in (1, -1):
        parts = [
            part
            for segment in chosen
            if segment.direction == direction
            and (part := _pattern(recording, segment, zero, reference, channel))
        ]
        if not parts:
            return None
        patterns.append(_pooled(parts))
    forward, reverse = patterns
    error = 0.5 * np.hypot(forward.standard_error, reverse.standard_error)
    least = min(forward.traverses, reverse.traverses)
    friction = TorquePattern(
        0.5 * (forward.mean - reverse.mean),
        0.5 * (forward.amplitude - reverse.amplitude),
        error,
        least,
    )
    cogging = TorquePattern(
        0.5 * (forward.mean + reverse.mean),
        0.5 * (forward.amplitude + reverse.amplitude),
        error,
        least,
    )
    return PatternPair(friction, cogging, forward, reverse)


def _pattern(
    recording: Recording, segment: Segment, zero: TorqueZero, reference: float, channel: str
) -> tuple[float, ComplexArray, float] | None:
    """Mean, amplitudes and the error of one amplitude from the scatter within bins, of one stretch."""
    counts, sums, squares = np.zeros(BINS), np.zeros(BINS), 0.0
    first = last = math.nan
    for rows in recording.blocks(segment):
        good = usable(recording, rows)
        angle = recording.si("input_angle", rows)[good]
        if not len(angle):
            continue
        if math.isnan(first):
            first = float(angle[0])
        last = float(angle[-1])
        torque = recording.si(channel, rows)[good] - zero.at(recording.time(rows)[good])
        where = (
            np.floor(((angle - reference) % REVOLUTION) * (BINS / REVOLUTION)).astype(np.int64)
            % BINS
        )
        counts += np.bincount(where, minlength=BINS)
        sums += np.bincount(where, weights=torque, minlength=BINS)
        squares += float(torque @ torque)
    turned = abs(last - first)
    if not turned >= 0.999 * REVOLUTION or np.count_nonzero(counts) < 0.9 * BINS:
        return None
    filled = counts > 0
    means = np.interp(
        np.arange(BINS), np.flatnonzero(filled), sums[filled] / counts[filled], period=BINS
    )
    spectrum = np.fft.rfft(means)
    orders = np.arange(1, HIGHEST_ORDER + 1)
    middle = np.exp(-1j * math.pi * orders / BINS) / np.sinc(orders / BINS)
    amplitude = 2.0 / BINS * spectrum[1 : HIGHEST_ORDER + 1] * middle
    within = max(squares - float((sums[filled] ** 2 / counts[filled]).sum()), 0.0)
    samples = float(counts.sum())
    error = math.sqrt(2.0 * within / max(samples - BINS, 1.0) / samples)
    return float(means.mean()), amplitude, error


def _pooled(parts: list[tuple[float, ComplexArray, float]]) -> TorquePattern:
    """Mean over traverses; the error from their scatter, from the noise within bins where there is one stretch only."""
    amplitudes: ComplexArray = np.array([part[1] for part in parts])
    mean = float(np.mean([part[0] for part in parts]))
    noise = math.sqrt(sum(part[2] ** 2 for part in parts)) / len(parts)
    if len(parts) == 1:
        return TorquePattern(mean, amplitudes[0], np.full(len(amplitudes[0]), noise), 1)
    n = len(parts)
    spread = np.sqrt(
        0.5 * (amplitudes.real.var(axis=0, ddof=1) + amplitudes.imag.var(axis=0, ddof=1)) / n
    )
    widened = student_quantile(2.0 * (n - 1)) / 1.96
    return TorquePattern(mean, amplitudes.mean(axis=0), np.maximum(spread * widened, noise), n)
