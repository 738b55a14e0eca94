"""A plan seen in advance: speed over time, predicted torque and output with their bands, margins,
and what touches a limit.

Quasi-static: at every instant the torque that this speed and this acceleration need. What the
drive's ramp shapes is in it; overshoot of the speed loop is not. The ringing of the gear during a
ramp is in the uncertainty alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.steps.kind import Servo
from model.units import RPM
from rig.bench import limits as lim
from rig.content.grid import Grid, columns, number_columns
from rig.content.phrase import phrase
from rig.content.wording import percent
from rig.present.preview.output import OutputModel, PredictedError
from rig.present.preview.timeline import PreviewMark, Timeline, timeline
from rig.present.preview.torque import PredictedTorque, TorqueModel
from rig.run.dry_run import Margin, PlannedRun

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_RAMP_POINTS = 9
"""Instants within a ramp at which the torque is predicted; the friction curve bends, a ramp does not."""


@dataclass(frozen=True, kw_only=True)
class _StepPeak:
    """The largest predicted torques of one step: at the motor, and in the gear at the output, with
    uncertainties [N m].
    """

    index: int
    where: str
    start: float
    stop: float
    speed: float
    torque: float
    torque_uncertainty: float
    torsion: float
    torsion_uncertainty: float

    @property
    def predicted(self) -> dict[str, tuple[float, float]]:
        """Value and uncertainty of each limited quantity that is predicted step by step."""
        return {
            lim.MOTOR_TORQUE: (self.torque, self.torque_uncertainty),
            lim.TORSION_TORQUE: (self.torsion, self.torsion_uncertainty),
        }


@dataclass(frozen=True)
class PredictedMargin(Margin):
    """A limited quantity as it is planned or predicted, with its expanded uncertainty."""

    uncertainty: float

    @property
    def least_margin(self) -> float:
        """Share of the limit that is left at the upper end of the uncertainty; negative when it may be broken."""
        return 1.0 - (self.value + self.uncertainty) / self.limit.value

    @property
    def touches(self) -> bool:
        """Whether the prediction with its uncertainty reaches the limit."""
        return self.least_margin <= 0.0

    @property
    def cells(self) -> tuple[str, str, str, str]:
        """Quantity, prediction ± U, limit and what is left of it, in the units of a laboratory."""
        return self._cells(self.uncertainty)

    def as_json(self) -> dict[str, Any]:
        """The margin as JSON, in SI."""
        return {
            "quantity": self.quantity,
            "value": self.value,
            "uncertainty": self.uncertainty,
            "unit": self.limit.unit,
            "where": self.where,
            "limit": self.limit.value,
            "margin": self.margin,
            "least_margin": self.least_margin,
        }


def predicted_grid(margins: Iterable[PredictedMargin]) -> Grid:
    """What is planned or predicted beside every limit; a mark stands where the uncertainty reaches the limit."""
    rows = []
    for one in margins:
        mark = "! " if one.touches else ""
        held = f"{one.limit.tier}{one.limit.doubt}"
        rows.append((*one.cells, f"{mark}{percent(one.least_margin)}", held, one.where))
    numbers = number_columns("predicted", "limit", "margin", "least margin")
    heads = (*columns("limit on"), *numbers, *columns("held by", "where"))
    return Grid("Margins as the model predicts them", heads, rows)


@dataclass(frozen=True)
class _PreviewWarning:
    """A prediction that touches a limit: the step (None: the whole plan) and the sentence."""

    step: int | None
    quantity: str
    text: str


@dataclass(frozen=True, kw_only=True)
class PlanPreview:
    """Everything that can be said of a planned run in advance, as data.

    `time`, `speed`, `step`, `torque` run over the same instants (n,): s, rad/s signed, index of the
    step, N m at the input. `output_speed` and `output_ripple` [rad/s] belong to them as well; NaN
    where no gear is mounted. `curve_speed` and `curve` are the running torque over speed.
    """

    planned: PlannedRun
    timeline: Timeline
    time: FloatArray
    speed: FloatArray
    step: IntArray
    torque: PredictedTorque
    output_speed: FloatArray
    output_ripple: FloatArray
    error: PredictedError | None
    curve_speed: FloatArray
    curve: PredictedTorque
    starting: PredictedTorque
    peaks: tuple[_StepPeak, ...]
    margins: tuple[PredictedMargin, ...]
    warnings: tuple[_PreviewWarning, ...]

    @property
    def marks(self) -> tuple[PreviewMark, ...]:
        """Prompts and events of the plan."""
        return self.timeline.marks

    def as_json(self) -> dict[str, Any]:
        """A summary as JSON, in SI."""
        return {
            "protocol": self.planned.experiment.name,
            "gear": self.planned.gear.name,
            "duration": {
                "nominal": self.planned.nominal,
                "longest": self.planned.longest,
                "unit": "s",
            },
            "margins": [margin.as_json() for margin in self.margins],
            "warnings": [warning.text for warning in self.warnings],
            "starting_torque": {
                "value": float(self.starting.value),
                "uncertainty": float(self.starting.uncertainty),
                "unit": "N m",
            },
            "running_torque": {
                "speed": self.curve_speed.tolist(),
                "value": self.curve.value.tolist(),
                "uncertainty": self.curve.uncertainty.tolist(),
                "unit": "N m",
            },
        }


def preview_plan(planned: PlannedRun) -> PlanPreview:
    """The preview of a planned run."""
    model = torque_model(planned)
    mounted = planned.experiment.gear_mounted
    output = OutputModel(planned.gear, planned.mounting) if mounted else None
    course = timeline(planned)
    time, speed, acceleration, direction, step, piece = _instants(course)
    torque = model.torque(speed, acceleration, direction)
    off = course.mode[piece] == Servo.OFF
    unsure = np.hypot(torque.uncertainty, model.ringing(acceleration))
    torque = PredictedTorque(np.where(off, 0.0, torque.value), np.where(off, 0.0, unsure))
    torque = _with_torque_ramps(torque, course, piece, time)
    ripple, shaking = _ripple(output, course)
    peaks = tuple(
        _peaks(planned, model, output, course, (torque, speed, acceleration, step), shaking)
    )
    margins = tuple(
        _predicted(margin, peaks, torque, time, course.duration) for margin in planned.margins
    )
    highest = max(float(np.max(np.abs(speed), initial=0.0)), 10.0 * RPM)
    curve_speed = np.geomspace(min(1.0 * RPM, 0.1 * highest), highest, 121)
    return PlanPreview(
        planned=planned,
        timeline=course,
        time=time,
        speed=speed,
        step=step,
        torque=torque,
        output_speed=speed / planned.load.ratio if mounted else np.full_like(speed, np.nan),
        output_ripple=ripple[piece] if mounted else np.full_like(speed, np.nan),
        error=output and output.kinematic_error(),
        curve_speed=curve_speed,
        curve=model.running(curve_speed),
        starting=model.starting(),
        peaks=peaks,
        margins=margins,
        warnings=tuple(_warnings(planned, model, peaks, margins)),
    )


def torque_model(planned: PlannedRun) -> TorqueModel:
    """The torque model of a planned run: its gear, motor and load, and the disc of a tare."""
    disc = float(getattr(planned.parameters, "disc_inertia", 0.0) or 0.0)
    return TorqueModel(
        planned.gear, planned.motor, planned.load, planned.experiment.gear_mounted, disc
    )


def _instants(
    course: Timeline,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, IntArray, IntArray]:
    """Instants at which the torque is predicted: time, speed, acceleration, direction of turning, step, piece.

    Two for a piece at constant speed; a ramp is divided, once more where it passes zero, where the torque jumps.
    """
    share = np.linspace(0.0, 1.0, _RAMP_POINTS)
    steady = np.array([0.0, 1.0])
    shares, owners, senses = [], [], []
    for k, (begin, end) in enumerate(zip(course.begin, course.end, strict=True)):
        if begin == end:
            parts = [(steady, float(np.sign(begin)))]
        elif begin * end < 0.0:
            zero = begin / (begin - end)
            parts = [
                (share * zero, float(np.sign(begin))),
                (zero + share * (1.0 - zero), float(np.sign(end))),
            ]
        else:
            parts = [(share, float(np.sign(begin + end)))]
        for points, sense in parts:
            shares.append(points)
            owners.append(np.full(len(points), k))
            senses.append(np.full(len(points), sense))
    if not shares:
        empty, none = np.empty(0), np.empty(0, dtype=np.int64)
        return empty, empty, empty, empty, none, none
    at, piece, sense = np.concatenate(shares), np.concatenate(owners), np.concatenate(senses)
    time = course.start[piece] + at * (course.stop - course.start)[piece]
    speed = course.begin[piece] + at * (course.end - course.begin)[piece]
    return time, speed, course.acceleration[piece], sense, course.step[piece], piece


def _with_torque_ramps(
    torque: PredictedTorque, course: Timeline, piece: IntArray, time: FloatArray
) -> PredictedTorque:
    """During a torque ramp the torque is what is commanded."""
    ramps = course.mode[piece] == Servo.TORQUE
    if not ramps.any():
        return torque
    begun = time == course.start[piece]
    value = np.where(ramps, np.where(begun, 0.0, course.torque[piece]), torque.value)
    return PredictedTorque(value, np.where(ramps, 0.0, torque.uncertainty))


def _ripple(output: OutputModel | None, course: Timeline) -> tuple[FloatArray, FloatArray]:
    """Ripple of the output speed [rad/s] and of the torque in the gear [N m] in each piece at
    constant speed, 0 elsewhere.
    """
    shaking, torque = np.zeros(len(course.start)), np.zeros(len(course.start))
    if output is None:
        return shaking, torque
    held = (course.mode == Servo.SPEED) & (course.begin == course.end) & (course.begin != 0.0)
    speeds, which = np.unique(np.abs(course.begin[held]), return_inverse=True)
    if len(speeds):
        at_speed, in_gear = output.ripple(speeds)
        shaking[held], torque[held] = at_speed[which], in_gear[which]
    return shaking, torque


def _peaks(
    planned: PlannedRun,
    model: TorqueModel,
    output: OutputModel | None,
    course: Timeline,
    instants: tuple[PredictedTorque, FloatArray, FloatArray, IntArray],
    shaking: FloatArray,
) -> Iterator[_StepPeak]:
    """The peaks of each step that takes time."""
    torque, speed, acceleration, step = instants
    if not len(step):
        return
    first = np.flatnonzero(np.diff(step, prepend=-1))
    size, doubt = np.abs(torque.value), torque.uncertainty
    top = _at_largest(size + doubt, first)
    fastest = np.maximum.reduceat(np.abs(speed), first)
    sharpest = np.maximum.reduceat(np.abs(acceleration), first)
    ends = np.append(first[1:], len(step))
    begun = np.flatnonzero(np.diff(course.step, prepend=-1))
    shaken = np.maximum.reduceat(shaking, begun)
    starts, stops = course.start[begun], course.stop[np.append(begun[1:], len(course.step)) - 1]
    relative = 0.0
    if planned.load.output_inertia:
        relative = model.output_inertia_doubt() / planned.load.output_inertia
    ripple_doubt = output.ripple_doubt() if output else 0.0
    for row in range(len(ends)):
        forecast = planned.steps[int(step[first[row]])]
        wound = planned.load.ratio * forecast.torque
        turning = max(planned.load.gear_torque(float(sharpest[row])), float(shaken[row]))
        spread = (
            math.hypot(2.0 * relative, ripple_doubt if shaken[row] == turning else 0.0) * turning
        )
        torsion, unsure = (wound, 0.0) if wound > turning + spread else (turning, spread)
        peak, peak_doubt = float(size[top[row]]), float(doubt[top[row]])
        if forecast.torque > peak + peak_doubt:
            # A torque ramp may go on to its own limit.
            peak, peak_doubt = forecast.torque, 0.0
        yield _StepPeak(
            index=forecast.index,
            where=forecast.where,
            start=float(starts[row]),
            stop=float(stops[row]),
            speed=float(fastest[row]),
            torque=peak,
            torque_uncertainty=peak_doubt,
            torsion=torsion if planned.experiment.gear_mounted else 0.0,
            torsion_uncertainty=unsure,
        )


def _at_largest(values: FloatArray, first: IntArray) -> IntArray:
    """Rows of the largest value of each section that begins at `first`."""
    ends = np.append(first[1:], len(values))
    return np.array(
        [start + int(np.argmax(values[start:end])) for start, end in zip(first, ends, strict=True)]
    )


def _predicted(
    margin: Margin,
    peaks: tuple[_StepPeak, ...],
    torque: PredictedTorque,
    time: FloatArray,
    duration: float,
) -> PredictedMargin:
    name = margin.quantity
    if peaks and name in peaks[0].predicted:
        worst = max(peaks, key=lambda peak: sum(peak.predicted[name]))
        value, doubt = worst.predicted[name]
        return PredictedMargin(name, value, worst.where, margin.limit, doubt)
    if margin.quantity == lim.RMS_TORQUE and duration > 0.0:
        mean = math.sqrt(_integral(torque.value**2, time) / duration)
        # The same parameters are wrong throughout: their doubts add up as they stand.
        doubt = 0.0
        if mean:
            doubt = _integral(np.abs(torque.value) * torque.uncertainty, time) / duration / mean
        return PredictedMargin(margin.quantity, mean, margin.where, margin.limit, doubt)
    return PredictedMargin(margin.quantity, margin.value, margin.where, margin.limit, 0.0)


def _integral(values: FloatArray, time: FloatArray) -> float:
    return float(np.sum(0.5 * (values[1:] + values[:-1]) * np.diff(time)))


def _warnings(
    planned: PlannedRun,
    model: TorqueModel,
    peaks: tuple[_StepPeak, ...],
    margins: tuple[PredictedMargin, ...],
) -> Iterator[_PreviewWarning]:
    """Predictions that touch a limit with their uncertainty, and torque ramps that may end before anything moves."""
    for margin in margins:
        if not margin.touches:
            continue
        reached = margin.limit.value
        touching = [p for p in peaks if sum(p.predicted.get(margin.quantity, ())) >= reached]
        index = next((peak.index for peak in touching if peak.where == margin.where), None)
        others = len(touching[1:])
        more = phrase("; {} more {} so", others, "step does" if others == 1 else "steps do")
        yield _PreviewWarning(index, margin.quantity, f"{_sentence(margin)}{more}")
    starting = model.starting()
    value, doubt = float(starting.value), float(starting.uncertainty)
    weak = [forecast for forecast in planned.steps if 0.0 < forecast.torque <= value + doubt]
    if weak:
        first = weak[0]
        yield _PreviewWarning(
            first.index,
            lim.MOTOR_TORQUE,
            f"the input may not begin to turn in {first.where}: predicted starting torque {1e3 * value:.0f} ± "
            f"{1e3 * doubt:.0f} mN m, the ramp ends at {1e3 * first.torque:.0f} mN m",
        )


def _sentence(margin: PredictedMargin) -> str:
    factor, unit = (RPM, "r/min") if margin.limit.unit == "rad/s" else (1.0, margin.limit.unit)
    value, doubt, limit = (
        x / factor for x in (margin.value, margin.uncertainty, margin.limit.value)
    )
    return (
        f"predicted {margin.quantity.replace('_', ' ')} {value:.3g} ± {doubt:.2g} {unit} in "
        f"{margin.where} touches the limit of "
        f"{limit:.4g} {unit} ({margin.limit.tier}): margin {percent(margin.margin)}, with the uncertainty "
        f"{percent(margin.least_margin)}"
    )
