"""A constant nominal speed on which a table is laid that takes the kinematic error out of the motion.

    theta(t) = phi(t) + f(phi) c(phi)          phi(t) = phi_0 + w t
    set speed of cycle k = (theta_{k+1} - theta_k)/T

c is the table (`model.compensation`), f fades it in over `fade` nominal revolutions from nothing, 1 without. phi_0 is
the nominal angle of where the input is found, against the index marks, and it is found anew after every input
revolution: what the drive rounds, and how far it lags, turns no phase.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from experiments.steps.kind import (
    Course,
    Drive,
    Goal,
    IndexPassed,
    Leg,
    Motion,
    Note,
    OperatingPoint,
    Piece,
    RigView,
    SegmentLabel,
    Situation,
    StepForecast,
    Turned,
)
from experiments.steps.profile import Constant, cycles_of
from model.arrays import FloatArray
from model.units import REVOLUTION

if TYPE_CHECKING:
    # Whoever lists protocols and their flags needs no table.
    from model.compensation import CompensationTable, Correction

_CHUNK = 256
"""Cycles that are computed at a time, always as many: a sine may differ in its last bit with the array's length."""
_POINTS = 360
"""Points of operation that stand for an output revolution."""
_PER_TURN = 16
"""Points of an input revolution among which its slowest and its fastest are looked for."""
INDEX_GAP = 0.1
"""Input revolutions by which the distance of the index marks may differ from the table's."""


@dataclass(frozen=True)
class Corrected:
    """Set speeds along a table: nominal `speed` [rad/s] from the nominal angle `begin` [rad], one every `period` [s].

    The table is faded in over the first `fade` [rad of the nominal angle]; 0: it is there.
    """

    speed: float
    begin: float
    period: float
    correction: Correction
    fade: float = 0.0
    _chunks: dict[int, FloatArray] = field(
        default_factory=dict[int, FloatArray], compare=False, repr=False
    )

    def targets(self, start: int, count: int) -> FloatArray:
        """(theta_{k+1} - theta_k)/T of the cycles from `start` on."""
        first, last = start // _CHUNK, (start + count - 1) // _CHUNK
        together = np.concatenate([self._chunk(n) for n in range(first, last + 1)])
        at = start - first * _CHUNK
        return together[at : at + count]

    def _chunk(self, number: int) -> FloatArray:
        if number not in self._chunks:
            # Blocks go forward: the chunk before may be asked for once more, no older one.
            for old in [n for n in self._chunks if n < number - 1]:
                del self._chunks[old]
            done = self.speed * self.period * np.arange(number * _CHUNK, (number + 1) * _CHUNK + 1)
            added = self.correction.added(
                np.asarray(self.begin + done, dtype=np.float64)
            ) * self._share(np.abs(done))
            self._chunks[number] = self.speed + np.diff(added) / self.period
        return self._chunks[number]

    def _share(self, done: FloatArray) -> FloatArray | float:
        if not self.fade > 0.0:
            return 1.0
        share = np.minimum(done / self.fade, 1.0)
        faded: FloatArray = 0.5 - 0.5 * np.cos(np.pi * share)
        return faded


@dataclass(frozen=True)
class FollowTable(Motion):
    """Turn the input by `revolutions` (> 0) at the nominal `speed` [rad/s] along a table; with `fade` revolutions of it
    the table is faded in from nothing.
    """

    revolutions: float
    speed: float
    table: CompensationTable
    at_most: float
    fade: float = 0.0
    segment: SegmentLabel | None = None

    @property
    def _correction(self) -> Correction:
        return self.table.of(self.speed)

    def forecast(self, at: Situation) -> StepForecast:
        """Its peaks of speed and acceleration are those of the table at this speed; they lie apart."""
        if self.speed == 0.0:
            raise at.refusal("a table cannot be followed at standstill", "0 r/min")
        nominal = self.revolutions * REVOLUTION / abs(self.speed)
        at.require_within(nominal, self.at_most)
        first, second = self._correction.steepness
        if self.fade:
            # (f c)' = f' c + f c',   (f c)'' = f'' c + 2 f' c' + f c''
            rate = 0.5 * math.pi / (self.fade * REVOLUTION)
            second += 2.0 * rate * first + 2.0 * rate**2 * self._correction.largest
            first += rate * self._correction.largest
        peak, acceleration = abs(self.speed) * (1.0 + first), self.speed**2 * second
        net = math.copysign(self.revolutions * REVOLUTION, self.speed)
        return at.forecast(
            nominal,
            self.at_most,
            net=net,
            end=self.speed,
            speed=peak,
            acceleration=acceleration,
            points=(
                *_points(self._correction, self.speed),
                OperatingPoint(0.0, peak, acceleration),
            ),
        )

    def course(self, rig: RigView, note: Note) -> Course:
        """Revolution by revolution, each from where the input is found; refused where a mark has not passed before."""
        correction, table = self._correction, self.table
        marks = ("input", "output") if correction.counts_from_output else ("input",)
        for which in marks:
            if not rig.has_index(which):
                goal = Goal(f"the {which} index mark before it", rig.period)
                yield Leg(1, Constant(self.speed), IndexPassed(which), goal)
        zero = rig.index_angle("input")
        if correction.counts_from_output:
            zero, gap = index_zero(rig, table)
            self._tell_gap(gap, note)
        left, turn, within = self.revolutions * REVOLUTION, REVOLUTION, self.at_most
        fade = self.fade * REVOLUTION
        goal = Goal(f"{self.revolutions:g} revolutions", self.at_most)
        while left > 0.0:
            found = rig.input_angle() - zero
            # Where nothing is laid on it yet the nominal angle is that of the input itself.
            at = found if fade else float(correction.nominal(np.array([found]))[0])
            # The latest count is that of the cycle before.
            begin = at + self.speed * rig.period
            if left == self.revolutions * REVOLUTION:
                note("info", "nominal-angle", f"nominally at {begin:.9f} rad from the index marks")
            profile = Corrected(self.speed, begin, rig.period, correction, fade)
            cycles = cycles_of((fade or turn) / abs(self.speed), rig.period)
            if left > 1.5 * turn and within > 0.0:
                # By time: only where it ends is counted.
                leg = Leg(cycles, profile)
            else:
                cycles = cycles_of(max(within, rig.period), rig.period)
                leg = Leg(cycles, profile, Turned(left, self.speed), goal)
            end = yield leg
            if end.reached:
                return
            within -= end.cycles * rig.period
            left -= abs(end.turned)
            fade = 0.0

    def _tell_gap(self, gap: float, note: Note) -> None:
        expected = self.table.index_gap
        if expected is not None and abs(math.remainder(gap - expected, 1.0)) > INDEX_GAP:
            note(
                "warning",
                "index-gap",
                f"the output's index mark lies {gap:.3f} input revolutions behind that of the input, the table's "
                f"{expected:.3f}: is this its gear, as it was mounted?",
            )

    def pieces(self, forecast: StepForecast, left: float, drive: Drive) -> Iterator[Piece]:
        """The slowest and the fastest of every input revolution, in their order."""
        turns = max(math.ceil(self.revolutions), 1)
        phi = math.copysign(1.0, self.speed) * np.linspace(
            0.0, turns * REVOLUTION, turns * _PER_TURN, endpoint=False
        )
        speed = _speeds(self._correction, self.speed, phi).reshape(turns, _PER_TURN)
        at = np.sort(np.stack([speed.argmin(axis=1), speed.argmax(axis=1)]), axis=0).T
        values = np.take_along_axis(speed, at, axis=1).ravel()
        times = ((at + _PER_TURN * np.arange(turns)[:, None]) / (_PER_TURN * turns) * left).ravel()
        begin, before = self.speed, 0.0
        for time, value in zip(times.tolist(), values.tolist(), strict=True):
            if time > before:
                yield Piece(time - before, begin, value)
            begin, before = value, time
        yield Piece(left - before, begin, self.speed)


def index_zero(rig: RigView, table: CompensationTable) -> tuple[float, float]:
    """The input angle [rad] from which the table's angles count, and how far behind the input's mark the output's lies.

    Which of its revolutions it is, is told by the output's mark: the one that is nearest to the table's own distance,
    the one behind it where the table has none.
    """
    mark = rig.index_angle("input")
    since = table.ratio * table.sense * (rig.output_angle() - rig.index_angle("output"))
    behind = (rig.input_angle() - since - mark) / REVOLUTION
    turns = whole_turns(behind, table.index_gap)
    return mark + REVOLUTION * turns, behind - turns


def whole_turns(behind: float, gap: float | None) -> int:
    """Which revolution the output's mark tells: the one behind it, or the one nearest to `gap` [revolutions] away."""
    return math.floor(behind) if gap is None else round(behind - gap)


def _speeds(correction: Correction, speed: float, phi: FloatArray) -> FloatArray:
    """Set speeds [rad/s] at nominal angles."""
    step = 1e-4
    slope = (correction.added(phi + step) - correction.added(phi - step)) / (2.0 * step)
    return speed * (1.0 + slope)


def _points(correction: Correction, speed: float) -> Iterator[OperatingPoint]:
    """Points of operation that stand for an output revolution."""
    phi, step = correction.turn(_POINTS), 1e-3
    speeds = _speeds(correction, speed, phi)
    beside = _speeds(correction, speed, phi + step)
    for value, change in zip(
        speeds.tolist(), ((beside - speeds) / step * speed).tolist(), strict=True
    ):
        yield OperatingPoint(1.0 / _POINTS, abs(value), math.copysign(1.0, speed) * change)
