"""The nominal course of a plan over time: pieces of linear speed or torque, and the marks between them.

An ideal rig, as in the dry run: every step takes its nominal time. Angles that are approached take
half a revolution, index marks are found half-way, torque ramps end at the predicted starting
torque.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, assert_never

import numpy as np
from numpy.typing import NDArray

from experiments.steps.kind import SWITCHING_TIME, Drive, Motion, Piece, Servo
from experiments.steps.note import Mark, Prompt
from rig.bench import limits as lim
from rig.run.dry_run import PlannedRun

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_MarkKind = Literal["prompt", "mark"]


@dataclass(frozen=True, slots=True)
class PreviewMark:
    """Something that happens between two pieces: a prompt to the operator, or an event of the protocol."""

    time: float
    step: int
    kind: _MarkKind
    text: str


@dataclass(frozen=True, kw_only=True)
class Timeline:
    """The pieces of a plan in their order, one row each.

    `start`, `stop` [s]; `begin`, `end` the input speed [rad/s] at both, signed; `torque` the
    set-point [N m] that a torque ramp reaches, 0 elsewhere; `step` the index of the step; `mode`
    what the servo does (`Servo`).
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
        return float(self.stop.max(initial=0.0))

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
        ramps = self.mode == Servo.TORQUE
        count = int(ramps.sum())
        time = np.column_stack([self.start[ramps], self.stop[ramps], self.stop[ramps]]).ravel()
        torque = np.column_stack(
            [np.zeros(count), self.torque[ramps], np.full(count, np.nan)]
        ).ravel()
        return time, torque


def timeline(planned: PlannedRun) -> Timeline:
    """The course of a planned run."""
    rows: list[tuple[float, float, float, float, float, int, int]] = []
    marks: list[PreviewMark] = []
    now, powered = 0.0, False

    def add(piece: Piece, step: int, servo: Servo) -> None:
        nonlocal now
        if piece.duration > 0.0:
            stop = now + piece.duration
            rows.append((now, stop, piece.begin, piece.end, piece.torque, step, servo))
            now = stop

    drive = Drive(planned.limits.value(lim.ACCELERATION), 1.0 / planned.sample_rate)
    for step, forecast in zip(planned.plan, planned.steps, strict=True):
        match step:
            case Prompt():
                marks.append(PreviewMark(now, forecast.index, "prompt", step.text))
            case Mark():
                marks.append(PreviewMark(now, forecast.index, "mark", step.text))
            case Motion():
                left = forecast.nominal
                if (step.servo is not Servo.OFF) is not powered:
                    powered = not powered
                    held = forecast.begin if powered else 0.0
                    add(Piece(SWITCHING_TIME, held, held), forecast.index, Servo.OFF)
                    left -= SWITCHING_TIME
                for piece in step.pieces(forecast, left, drive):
                    add(piece, forecast.index, step.servo)
            case _:
                assert_never(step)
    start, stop, begin, end, torque, index, modes = (
        np.array(rows, dtype=np.float64).reshape(-1, 7).T
    )
    return Timeline(
        start=start,
        stop=stop,
        begin=begin,
        end=end,
        torque=torque,
        step=index.astype(np.int64),
        mode=modes.astype(np.int64),
        marks=tuple(marks),
    )
