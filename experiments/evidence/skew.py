"""The skew between the channels of a recording: whole revolutions at constant speed, and the two
readings of the torque.

It needs no protocol: any recording in which the input turns both ways at several speeds shows the
encoders' skew, and any in which the torque varies that of the torque port against what the drive
reports.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from experiments.evidence import BAD_CYCLE, SATURATED, TRUE_TIME, rotary_ratio
from experiments.recording import Recording
from model.arrays import FloatArray, IntArray, joined
from model.friction import friction_torque
from model.gear import HarmonicDrive
from model.identify.estimate import Estimate
from model.identify.skew import WINDOW, RevolutionMeans, encoder_skew, torque_skew
from model.units import REVOLUTION

_SLOWEST_SHARE = 0.1
"""Revolutions slower than this share of the fastest are left out: there friction does not grow with
speed (Stribeck).
"""
STEADY = 0.03
"""Relative difference of neighbouring revolutions' durations below which the speed is constant."""
_NEEDED_SHARE = 0.1
"""A skew known to this share of the SYNC period is identified."""
TORQUE_PIECES, PIECE_ROWS = 24, 2048
"""So much of a recording is looked at for the skew of the torque."""


def skews(recording: Recording, gear: HarmonicDrive | None = None) -> dict[str, Estimate]:
    """Skew between the encoders ("encoder_skew": output after input) and between the torques
    ("torque_skew": port after drive).

    Only what the recording has the channels for; nothing without time stamps of SYNC or device. What the data cannot
    identify says so in its verdict.
    """
    rate = recording.metadata.sample_rate
    if recording.metadata.time_base not in TRUE_TIME or not rate > 0.0:
        return {}
    estimates: dict[str, Estimate] = {}
    encoders = skew_of_encoders(recording, gear)
    if encoders is not None:
        estimates["encoder_skew"] = encoders
    if recording.has("torque", "drive_torque"):
        estimates["torque_skew"] = _torque_skew(recording, 1.0 / rate, _NEEDED_SHARE / rate)
    return estimates


def skew_of_encoders(recording: Recording, gear: HarmonicDrive | None = None) -> Estimate | None:
    """How much later the output is latched than the input [s]; None without stamps, or both angles of a gear."""
    rate = recording.metadata.sample_rate
    if recording.metadata.time_base not in TRUE_TIME or not rate > 0.0:
        return None
    gear = gear or recording.metadata.gear
    ratio = rotary_ratio(
        recording, gear.mounted_ratio(recording.metadata.mounting) if gear else math.nan
    )
    encoders = [
        recording.signals[name] for name in ("input_angle", "output_angle") if recording.has(name)
    ]
    rotary = len(encoders) == 2 and all(signal.unit == "rad" for signal in encoders)
    if not (rotary and recording.metadata.gear_mounted and ratio > 0.0):
        return None
    means = _revolution_means(recording, ratio)
    doubt = viscous_windup(gear, means.speed, ratio) if gear is not None else 0.0
    return encoder_skew(means, _NEEDED_SHARE / rate, doubt)


def viscous_windup(gear: HarmonicDrive, speed: FloatArray, ratio: float) -> float:
    """Standard uncertainty of the viscous wind-up per output speed c/K [s], over the output speeds (n,) [rad/s].

    The most that it can be is all of the gear's friction that grows with speed, carried through its
    softest spring; anything from nothing to that is taken as equally likely.
    """
    if not len(speed):
        return 0.0
    ends = np.array([np.abs(speed).min(), np.abs(speed).max()]) * ratio
    torque = friction_torque(gear, ends)
    ratings = gear.ratings
    stiffness = min(ratings.stiffness_1, ratings.stiffness_2, ratings.stiffness_3)
    growth = max(float(np.diff(torque)[0]), 0.0) / max(float(np.diff(ends)[0]), 1e-9)
    return growth * ratio**2 / stiffness / math.sqrt(3.0)


@dataclass
class _Revolutions:
    """Whole input revolutions as they come, block by block."""

    ratio: float
    rows: list[tuple[int, float, float, float, float]] = field(
        default_factory=list[tuple[int, float, float, float, float]]
    )
    """Index of the revolution, its begin and end [s], mean offset, mean output angle."""
    tail: tuple[FloatArray, FloatArray, FloatArray] = field(
        default_factory=lambda: (np.empty(0), np.empty(0), np.empty(0))
    )
    entered: float = math.nan
    """When the revolution that waits in the tail was entered [s]."""

    def add(self, time: FloatArray, inner: FloatArray, outer: FloatArray) -> None:
        """Take usable samples that follow those of the last call; the revolution that is not over
        waits for the next.
        """
        time, inner, outer = (
            np.concatenate(pair) for pair in zip(self.tail, (time, inner, outer), strict=True)
        )
        if not len(time):
            return
        turn = np.floor(inner / REVOLUTION).astype(np.int64)
        begins = np.flatnonzero(np.diff(turn, prepend=turn[0] - 1))
        crossed = self._crossed(time, inner, turn, begins)
        if len(begins) > 1:
            counts = np.diff(begins)
            offset = np.add.reduceat(outer - inner / self.ratio, begins)[:-1] / counts
            angle = np.add.reduceat(outer, begins)[:-1] / counts
            columns = (turn[begins[:-1]], crossed[:-1], crossed[1:], offset, angle)
            self.rows += list(zip(*(column.tolist() for column in columns), strict=True))
        last = int(begins[-1])
        self.tail, self.entered = (time[last:], inner[last:], outer[last:]), float(crossed[-1])

    def _crossed(
        self,
        time: FloatArray,
        inner: FloatArray,
        turn: IntArray,
        begins: IntArray,
    ) -> FloatArray:
        """When each revolution was entered, between the samples: a fast one has few of them."""
        after, before = begins[1:], begins[1:] - 1
        edge = np.maximum(turn[after], turn[before]) * REVOLUTION
        share = (edge - inner[before]) / (inner[after] - inner[before])
        first = float(time[0]) if math.isnan(self.entered) else self.entered
        return np.concatenate([[first], time[before] + share * (time[after] - time[before])])


def _revolution_means(recording: Recording, ratio: float) -> RevolutionMeans:
    """Means over the whole input revolutions of a recording that were turned at constant speed, in
    constant memory per block.
    """
    revolutions = _Revolutions(ratio)
    origin: tuple[float, float] | None = None
    for rows in recording.blocks():
        good = (recording.flags(rows) & BAD_CYCLE) == 0
        inner, outer = recording.si("input_angle", rows)[good], recording.output_angle(rows)[good]
        if not len(inner):
            continue
        # Counters may begin anywhere: differences of large angles would lose digits.
        origin = origin or (REVOLUTION * math.floor(inner[0] / REVOLUTION), float(outer[0]))
        revolutions.add(recording.time(rows)[good], inner - origin[0], outer - origin[1])
    return _steady(revolutions.rows, ratio)


def _steady(rows: list[tuple[int, float, float, float, float]], ratio: float) -> RevolutionMeans:
    """The revolutions that were turned through, as fast as the one before and the one after."""
    table = np.array(rows, dtype=np.float64).reshape(-1, 5)
    turn, duration = table[:, 0], table[:, 2] - table[:, 1]
    step = np.diff(turn)
    same = np.zeros(len(table), dtype=bool)
    if len(table) > 2:
        middle = duration[1:-1]
        close = (np.abs(duration[:-2] - middle) < STEADY * middle) & (
            np.abs(duration[2:] - middle) < STEADY * middle
        )
        same[1:-1] = close & (np.abs(step[1:]) == 1) & (step[1:] == step[:-1])
    steady = np.flatnonzero(same)
    sense = step[np.maximum(steady - 1, 0)]
    speed = sense * REVOLUTION / (ratio * duration[steady])
    breaks = np.diff(steady, prepend=steady[:1]) > 1
    plateau = np.cumsum(breaks).astype(np.int64)
    fast = np.abs(speed) >= _SLOWEST_SHARE * np.abs(speed).max(initial=0.0)
    steady = steady[fast]
    return RevolutionMeans(speed[fast], table[steady, 3], table[steady, 4], plateau[fast])


def _torque_skew(recording: Recording, interval: float, needed: float) -> Estimate:
    """Pieces spread over the recording, without flagged cycles."""
    count = min(TORQUE_PIECES, max(1, recording.rows // PIECE_ROWS))
    begins = np.linspace(0, max(0, recording.rows - PIECE_ROWS), count).astype(int)
    port: list[FloatArray] = []
    drive: list[FloatArray] = []
    for begin in begins.tolist():
        rows = slice(begin, min(begin + PIECE_ROWS, recording.rows))
        if (
            recording.flags(rows) & (BAD_CYCLE | SATURATED)
        ).any() or rows.stop - rows.start < 3 * WINDOW:
            continue
        port.append(recording.si("torque", rows))
        drive.append(recording.si("drive_torque", rows))
    lengths = [len(piece) for piece in port]
    starts = np.cumsum([0, *lengths], dtype=np.int64)[: len(port)]
    quantum = recording.signals["drive_torque"].quantum
    return torque_skew(joined(drive), joined(port), interval, needed, starts, quantum)
