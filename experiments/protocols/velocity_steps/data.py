"""The steps of a run as `model.identify.dynamics` takes them: from standstill through the step,
with the kinematic error.

The kinematic error is that of the parameter set where it was identified and the run saw the index
marks; otherwise it is taken from the steady parts of the run's own slow steps, where the output
follows it quasi-statically.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from experiments.angle.certified import CertifiedAngle, angle_of
from experiments.angle.phase_reference import PhaseReference
from experiments.evidence import usable
from experiments.recording import Recording, Segment
from experiments.torque.zero import TorqueZero
from model.arrays import FloatArray, IntArray
from model.dynamics import simulate_prescribed
from model.errors import IdentificationError
from model.gear import Harmonic, HarmonicDrive
from model.gear_file import harmonic_path
from model.identify.differentiation import speed_from_counts
from model.identify.step_data import SPEED_SMOOTHING, StepData, step_data
from model.kinematic_error import design_matrix
from model.units import RPM

_REST_SHOWN = 0.1
"""s of standstill before the step that belong to it."""
SLOW = 300.0 * RPM
"""Input speed up to which a step's steady part shows the kinematic error as it is (its orders far
below the first mode).
"""
_SLOW_ORDERS = (1, 2, 3, 4, 5, 6)
RISE = 0.015
"""s over which a commanded speed is taken to rise: that of a drive's speed loop of some 40 Hz. A step without any
would command an infinite acceleration, which no drive gives.
"""
TARGET_SPEED = "target_speed"
"""The channel of the set-point of the input speed [rad/s]."""


@dataclass(frozen=True)
class RecordedStep:
    """One step: its segment, its data with time 0 at the first cycle of the step.

    `torque` (n,) [N m] and `commanded` (n,), the set-point of the input speed [rad/s], where they were recorded.
    """

    segment: Segment
    data: StepData
    torque: FloatArray | None
    commanded: FloatArray | None = None


def recorded_steps(
    recording: Recording,
    *,
    ratio: float,
    reference: PhaseReference,
    zero: TorqueZero | None,
    source: HarmonicDrive | None,
    resonance: float,
    certified: Mapping[str, CertifiedAngle],
) -> tuple[list[RecordedStep], str, list[str]]:
    """Every step of a run, where its kinematic error is from, and what could not be used.

    What the encoders' certificates state (`certified`, by channel) is taken off their angles.

    `source` is the parameter set whose kinematic error is taken as it stands; None: the run's own
    slow steps, in which the first mode, expected at `resonance` [rad/s], raises order n by 1/(1 -
    (n speed/resonance)^2).
    """
    raw = [
        _arrays(recording, segment, reference.input_angle, zero, certified)
        for segment in recording.labelled("step")
    ]
    if source is not None:
        series, origin = source.kinematic_error, f"the parameter set {source.name}"
    else:
        series = _own_series(raw, ratio, resonance)
        origin = "the steady parts of the run's own slow steps"
    recorded, unused = _usable(recording, raw, ratio, series)
    warnings = [f"{len(unused)} steps were left out: {', '.join(unused[:4])}."] if unused else []
    if not series:
        origin = "none"
        warnings.append(
            "There is no slow step and no identified kinematic error: the gear's error stands in the deviations."
        )
    return recorded, origin, warnings


def _usable(
    recording: Recording, raw: list[_StepRecord], ratio: float, series: tuple[Harmonic, ...]
) -> tuple[list[RecordedStep], list[str]]:
    """The steps that can be used, their kinematic error being `series`, and words on those that cannot."""
    quanta = {
        name: recording.signals[name].quantum or 1e-7 for name in ("input_angle", "output_angle")
    }
    recorded: list[RecordedStep] = []
    unused: list[str] = []
    for part in raw:
        try:
            data = step_data(
                part.time,
                part.input_angle,
                part.output_angle,
                ratio,
                output_quantum=quanta["output_angle"],
                input_quantum=quanta["input_angle"],
                kinematic_error=series,
            )
        except IdentificationError as error:
            unused.append(f"{part.segment.setpoint / RPM:.0f} r/min ({error.what})")
            if error.where == "ratio":
                raise
            continue
        recorded.append(RecordedStep(part.segment, data, part.torque, part.commanded))
    return recorded, unused


def carries(gear: HarmonicDrive, reference: PhaseReference) -> bool:
    """Whether the kinematic error of a parameter set can be laid on this run: identified, and
    phases against index marks.
    """
    identified = [
        gear.origins[path].provenance == "identified"
        for h in gear.kinematic_error
        if (path := harmonic_path(h.order)) in gear.origins
    ]
    return reference.carries and bool(identified) and all(identified)


@dataclass(frozen=True, kw_only=True)
class _StepRecord:
    """The channels of one step with some standstill before it, as they were recorded."""

    segment: Segment
    time: FloatArray
    input_angle: FloatArray
    output_angle: FloatArray
    torque: FloatArray | None
    commanded: FloatArray | None


def _arrays(
    recording: Recording,
    segment: Segment,
    reference: float,
    zero: TorqueZero | None,
    certified: Mapping[str, CertifiedAngle],
) -> _StepRecord:
    rate = recording.metadata.sample_rate
    if not math.isfinite(rate):
        rate = 1000.0
    start = segment.start
    before = next((s for s in recording.labelled("rest") if s.stop == segment.start), None)
    if before is not None:
        start = max(before.start, segment.start - round(_REST_SHOWN * rate))
    rows = slice(start, segment.stop)
    good = usable(recording, rows)
    stamp = recording.time(rows)
    time = stamp[good] - stamp[segment.start - start]
    torque = None
    if zero is not None:
        torque = recording.si("torque", rows)[good] - zero.at(stamp[good])
    return _StepRecord(
        segment=segment,
        time=time,
        input_angle=angle_of(recording, "input_angle", rows, certified)[good] - reference,
        output_angle=recording.metadata.output_sense
        * angle_of(recording, "output_angle", rows, certified)[good],
        torque=torque,
        commanded=recording.si(TARGET_SPEED, rows)[good] if recording.has(TARGET_SPEED) else None,
    )


def commanded_step(step: RecordedStep) -> RecordedStep:
    """The same step with the input that was asked for in the place of the one that came.

    It stands at the first measured angle until the set-point changes (where none was recorded, to that of the
    segment at time 0), and takes `RISE` for each change. What else drive and motor do to a set-point is not in it.
    """
    data = step.data
    speed = step.commanded
    if speed is None:
        speed = np.where(data.time >= 0.0, step.segment.setpoint, 0.0)
    changes = np.diff(speed, prepend=0.0)
    turned = np.zeros(len(speed))
    for row in np.flatnonzero(changes):
        turned += changes[row] * _risen(data.time - data.time[row])
    return replace(step, data=replace(data, input_angle=data.input_angle[0] + turned))


def _risen(since: FloatArray) -> FloatArray:
    """Integral [s] of a rise from 0 to 1 over `RISE` along half a cosine, at times since its start [s]."""
    share = np.clip(since / RISE, 0.0, 1.0)
    rising = 0.5 * share - np.sin(math.pi * share) / (2.0 * math.pi)
    return RISE * rising + np.maximum(since - RISE, 0.0)


def _own_series(raw: list[_StepRecord], ratio: float, resonance: float) -> tuple[Harmonic, ...]:
    """Whole orders of theta_o - theta_i/N over the steady parts of the slow steps, one constant per
    step; () without any.
    """
    slow = [part for part in raw if abs(part.segment.setpoint) <= SLOW and len(part.time) > 200]
    if not slow:
        return ()
    designs: list[FloatArray] = []
    values: list[FloatArray] = []
    which: list[IntArray] = []
    for index, part in enumerate(slow):
        time, angle = part.time, part.input_angle
        steady = time >= max(0.4 * float(time[-1]), 0.2)
        orders = [float(n) for n in _SLOW_ORDERS]
        raised = 1.0 / (
            1.0 - (np.array(orders) * _part_speed(angle[steady], time[steady]) / resonance) ** 2
        )
        designs.append(
            design_matrix(angle[steady], orders, constant=False, trend=False) * np.repeat(raised, 2)
        )
        values.append(part.output_angle[steady] - angle[steady] / ratio)
        which.append(np.full(int(steady.sum()), index))
    step = np.concatenate(which)
    constants = (step[:, None] == np.arange(len(slow))[None, :]).astype(np.float64)
    design = np.column_stack([constants, np.concatenate(designs)])
    coefficients = np.linalg.lstsq(design, np.concatenate(values), rcond=None)[0][len(slow) :]
    pairs = coefficients.reshape(-1, 2)
    return tuple(
        Harmonic(float(n), float(a), float(b))
        for n, (a, b) in zip(_SLOW_ORDERS, pairs, strict=True)
    )


def _part_speed(angle: FloatArray, time: FloatArray) -> float:
    """Mean speed over a stretch [rad/s]."""
    return float(angle[-1] - angle[0]) / float(time[-1] - time[0])


def simulated_output(step: RecordedStep, gear: HarmonicDrive) -> FloatArray:
    """Output angle [rad] of equation 2 with the input of one step, at its stamps.

    The gear's own kinematic error is used; start at rest. The input is smoothed by local polynomials, not differenced.
    """
    even, angle, speed = even_input(step)
    interval = float(even[1] - even[0])
    response = simulate_prescribed(
        gear, angle, interval, input_speed=speed, smoothing_speed=SPEED_SMOOTHING
    )
    return np.interp(step.data.time, even, response.output_angle)


def even_input(step: RecordedStep) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Time [s], input angle [rad] and input speed [rad/s] of a step on an even axis, by local polynomials."""
    data = step.data
    motion = speed_from_counts(data.time, data.input_angle, data.input_quantum, longest=0.03)
    interval = float(np.median(np.diff(data.time)))
    even = np.arange(data.time[0], data.time[-1] + 0.5 * interval, interval)
    return (
        even,
        np.interp(even, motion.time, motion.angle),
        np.interp(even, motion.time, motion.speed),
    )
