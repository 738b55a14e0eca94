"""The nominal course of a plan over time: pieces of linear speed or torque, and the marks between them.

An ideal rig, as in the dry run: every step takes its nominal time. Angles that are approached take
half a revolution, index marks are found half-way, torque ramps end at the predicted starting
torque.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from experiments import steps as s
from rig.bench import limits as lim
from rig.run.dry_run import PlannedRun
from rig.run.engine import ENABLE_WINDOW, STAND_TIME
from rig.run.forecast import StepForecast
from rig.run.trajectory import cycles_of, ramp

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

OFF, SPEED, TORQUE = 0, 1, 2
"""What the servo does in a piece."""

MarkKind = Literal["prompt", "mark"]


@dataclass(frozen=True, slots=True)
class PreviewMark:
    """Something that happens between two pieces: a prompt to the operator, or an event of the protocol."""

    time: float
    step: int
    kind: MarkKind
    text: str


@dataclass(frozen=True, kw_only=True)
class Timeline:
    """The pieces of a plan in their order, one row each.

    `start`, `stop` [s]; `begin`, `end` the input speed [rad/s] at both, signed; `torque` the
    set-point [N m] that a torque ramp reaches, 0 elsewhere; `step` the index of the step; `mode`
    OFF, SPEED or TORQUE.
    """

    start: FloatArray
    stop: FloatArray
    begin: FloatArray
    end: FloatArray
    torque: FloatArray
    step: IntArray
    mode: IntArray
    marks: tuple[PreviewMark, ...]

    @property
    def duration(self) -> float:
        """Nominal duration [s]."""
        return float(self.stop[-1]) if len(self.stop) else 0.0

    @property
    def acceleration(self) -> FloatArray:
        """Input acceleration of each piece [rad/s2]."""
        length = self.stop - self.start
        return np.divide(
            self.end - self.begin, length, out=np.zeros_like(length), where=length > 0.0
        )

    def polyline(self) -> tuple[FloatArray, FloatArray]:
        """Speed over time as a line: times [s] and input speeds [rad/s], points that change nothing left away."""
        time = np.column_stack([self.start, self.stop]).ravel()
        speed = np.column_stack([self.begin, self.end]).ravel()
        if len(time) < 3:
            return time, speed
        inner = np.ones(len(time), dtype=bool)
        flat = (speed[1:-1] == speed[:-2]) & (speed[1:-1] == speed[2:])
        inner[1:-1] = ~flat
        return time[inner], speed[inner]

    def torque_line(self) -> tuple[FloatArray, FloatArray]:
        """Torque set-points over time: times [s] and N m; NaN between the torque ramps, so that they do not join."""
        ramps = self.mode == TORQUE
        count = int(ramps.sum())
        time = np.column_stack([self.start[ramps], self.stop[ramps], self.stop[ramps]]).ravel()
        torque = np.column_stack(
            [np.zeros(count), self.torque[ramps], np.full(count, np.nan)]
        ).ravel()
        return time, torque


Piece = tuple[float, float, float]
"""Duration [s], speed at its begin and at its end [rad/s]."""


def timeline(planned: PlannedRun) -> Timeline:
    """The course of a planned run."""
    rows: list[tuple[float, float, float, float, float, int, int]] = []
    marks: list[PreviewMark] = []
    now, powered = 0.0, False
    course = _Course(planned.limits.value(lim.ACCELERATION), 1.0 / planned.sample_rate)
    for step, forecast in zip(planned.plan, planned.steps, strict=True):
        if isinstance(step, s.Mark | s.Prompt):
            kind: MarkKind = "prompt" if isinstance(step, s.Prompt) else "mark"
            marks.append(PreviewMark(now, forecast.index, kind, step.text))
            continue
        mode = (
            OFF
            if isinstance(step, s.ServoOff)
            else TORQUE
            if isinstance(step, s.TorqueRamp)
            else SPEED
        )
        left = forecast.nominal
        if (mode != OFF) is not powered:
            powered = not powered
            begin = forecast.begin if powered else 0.0
            rows.append((now, now + ENABLE_WINDOW, begin, begin, 0.0, forecast.index, OFF))
            now += ENABLE_WINDOW
            left -= ENABLE_WINDOW
        torque = (
            math.copysign(min(abs(step.rate) * left, step.limit), step.rate)
            if isinstance(step, s.TorqueRamp)
            else 0.0
        )
        for length, begin, end in _PIECES[type(step)](course, step, forecast, left):
            if length > 0.0:
                rows.append((now, now + length, begin, end, torque, forecast.index, mode))
                now += length
    columns = (
        [np.array(column, dtype=np.float64) for column in zip(*rows, strict=True)]
        if rows
        else [np.empty(0)] * 7
    )
    start, stop, begin, end, torque_reached, index, modes = columns
    return Timeline(
        start=start,
        stop=stop,
        begin=begin,
        end=end,
        torque=torque_reached,
        step=index.astype(np.int64),
        mode=modes.astype(np.int64),
        marks=tuple(marks),
    )


@dataclass(frozen=True, slots=True)
class _Course:
    drive_ramp: float
    period: float


def _to_speed(
    c: _Course, begin: float, end: float, acceleration: float, left: float
) -> Iterable[Piece]:
    """A ramp, then the speed held for what is left."""
    finite = math.isfinite(acceleration) and acceleration > 0.0
    up = min(abs(end - begin) / acceleration, left) if finite else 0.0
    yield up, begin, end
    yield left - up, end, end


def _still(c: _Course, step: s.Step, f: StepForecast, left: float) -> Iterable[Piece]:
    yield left, 0.0, 0.0


def _hold(c: _Course, step: s.Step, f: StepForecast, left: float) -> Iterable[Piece]:
    yield left, f.begin, f.begin


def _ramp(c: _Course, step: s.Ramp, f: StepForecast, left: float) -> Iterable[Piece]:
    yield left, f.begin, f.end


def _at_drive_ramp(c: _Course, step: Any, f: StepForecast, left: float) -> Iterable[Piece]:
    yield from _to_speed(c, f.begin, step.speed, c.drive_ramp, left)


def _move(c: _Course, step: Any, f: StepForecast, left: float) -> Iterable[Piece]:
    if f.angle == 0.0:
        yield left, f.begin, 0.0
        return
    peak = math.copysign(f.speed, f.angle)
    away = ramp(f.begin, peak, step.acceleration, c.period).cycles * c.period
    brake = ramp(peak, 0.0, step.acceleration, c.period).cycles * c.period
    stand = min(cycles_of(STAND_TIME, c.period) * c.period, max(left - away - brake, 0.0))
    cruise = max(left - away - brake - stand, 0.0)
    yield away, f.begin, peak
    yield cruise, peak, peak
    yield brake, peak, 0.0
    yield stand, 0.0, 0.0


_PIECES: dict[type[Any], Callable[[_Course, Any, StepForecast, float], Iterable[Piece]]] = {
    s.ServoOff: _still,
    s.TorqueRamp: _still,
    s.Ramp: _ramp,
    s.SpeedStep: _at_drive_ramp,
    s.FindIndex: _at_drive_ramp,
    s.HoldRevolutions: _hold,
    s.HoldTime: _hold,
    s.Settle: _hold,
    s.MoveToAngle: _move,
    s.MoveRevolutions: _move,
}
