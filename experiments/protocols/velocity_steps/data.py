"""The steps of a run as `model.identify.dynamics` takes them: from standstill through the step,
with the kinematic error.

The kinematic error is that of the parameter set where it was identified and the run saw the index
marks; otherwise it is taken from the steady parts of the run's own slow steps, where the output
follows it quasi-statically.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from experiments.angle.phase_reference import PhaseReference
from experiments.evidence import usable
from experiments.recording import Recording, Segment
from experiments.torque.zero import TorqueZero
from model.arrays import FloatArray
from model.dynamics import simulate_prescribed
from model.errors import IdentificationError
from model.gear import Harmonic, HarmonicDrive
from model.gear_file import harmonic_path
from model.identify.differentiation import speed_from_counts
from model.identify.step_data import SPEED_SMOOTHING, StepData, step_data
from model.kinematic_error import design_matrix
from model.units import RPM

REST_SHOWN = 0.1
"""s of standstill before the step that belong to it."""
SLOW = 300.0 * RPM
"""Input speed up to which a step's steady part shows the kinematic error as it is (its orders far
below the first mode).
"""
SLOW_ORDERS = (1, 2, 3, 4, 5, 6)


@dataclass(frozen=True)
class RecordedStep:
    """One step: its segment, its data with time 0 at the first cycle of the step, its torque [N m]
    where it was recorded.
    """

    segment: Segment
    data: StepData
    torque: FloatArray | None


def recorded_steps(
    recording: Recording,
    ratio: float,
    reference: PhaseReference,
    zero: TorqueZero | None,
    source: HarmonicDrive | None,
    resonance: float,
) -> tuple[list[RecordedStep], str, list[str]]:
    """Every step of a run, where its kinematic error is from, and what could not be used.

    `source` is the parameter set whose kinematic error is taken as it stands; None: the run's own
    slow steps, in which the first mode, expected at `resonance` [rad/s], raises order n by 1/(1 -
    (n speed/resonance)^2).
    """
    raw: list[tuple[Segment, FloatArray, FloatArray, FloatArray, FloatArray | None]] = []
    for segment in recording.labelled("step"):
        raw.append((segment, *_arrays(recording, segment, reference.input_angle, zero)))
    if source is not None:
        series, origin = source.kinematic_error, f"the parameter set {source.name}"
    else:
        series, origin = (
            _own_series(raw, ratio, resonance),
            "the steady parts of the run's own slow steps",
        )
    quanta = {
        name: recording.signals[name].quantum or 1e-7 for name in ("input_angle", "output_angle")
    }
    recorded, unused = [], []
    for segment, time, angle, output, torque in raw:
        try:
            data = step_data(
                time,
                angle,
                output,
                ratio,
                output_quantum=quanta["output_angle"],
                input_quantum=quanta["input_angle"],
                kinematic_error=series,
            )
        except IdentificationError as error:
            unused.append(f"{segment.setpoint / RPM:.0f} r/min ({error.what})")
            if error.where == "ratio":
                raise
            continue
        recorded.append(RecordedStep(segment, data, torque))
    warnings = [f"{len(unused)} steps were left out: {', '.join(unused[:4])}."] if unused else []
    if not series:
        origin = "none"
        warnings.append(
            "There is no slow step and no identified kinematic error: the gear's error stands in the deviations."
        )
    return recorded, origin, warnings


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


def _arrays(
    recording: Recording, segment: Segment, reference: float, zero: TorqueZero | None
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray | None]:
    """Time, input angle, output angle, torque of one step with some standstill before it."""
    rate = (
        recording.metadata.sample_rate if math.isfinite(recording.metadata.sample_rate) else 1000.0
    )
    before = next((s for s in recording.labelled("rest") if s.stop == segment.start), None)
    start = (
        segment.start
        if before is None
        else max(before.start, segment.start - round(REST_SHOWN * rate))
    )
    rows = slice(start, segment.stop)
    good = usable(recording, rows)
    stamp = recording.time(rows)
    time = stamp[good] - stamp[segment.start - start]
    torque = None
    if zero is not None:
        torque = recording.si("torque", rows)[good] - zero.at(stamp[good])
    return (
        time,
        recording.si("input_angle", rows)[good] - reference,
        recording.output_angle(rows)[good],
        torque,
    )


def _own_series(
    raw: list[tuple[Segment, FloatArray, FloatArray, FloatArray, FloatArray | None]],
    ratio: float,
    resonance: float,
) -> tuple[Harmonic, ...]:
    """Whole orders of theta_o - theta_i/N over the steady parts of the slow steps, one constant per
    step; () without any.
    """
    slow = [part for part in raw if abs(part[0].setpoint) <= SLOW and len(part[1]) > 200]
    if not slow:
        return ()
    designs, values, which = [], [], []
    for index, (_, time, angle, output, _) in enumerate(slow):
        steady = time >= max(0.4 * float(time[-1]), 0.2)
        orders = [float(n) for n in SLOW_ORDERS]
        raised = 1.0 / (
            1.0 - (np.array(orders) * part_speed(angle[steady], time[steady]) / resonance) ** 2
        )
        designs.append(
            design_matrix(angle[steady], orders, constant=False, trend=False) * np.repeat(raised, 2)
        )
        values.append(output[steady] - angle[steady] / ratio)
        which.append(np.full(int(steady.sum()), index))
    step = np.concatenate(which)
    constants = (step[:, None] == np.arange(len(slow))[None, :]).astype(np.float64)
    design = np.column_stack([constants, np.concatenate(designs)])
    coefficients = np.linalg.lstsq(design, np.concatenate(values), rcond=None)[0][len(slow) :]
    pairs = coefficients.reshape(-1, 2)
    return tuple(
        Harmonic(float(n), float(a), float(b)) for n, (a, b) in zip(SLOW_ORDERS, pairs, strict=True)
    )


def part_speed(angle: FloatArray, time: FloatArray) -> float:
    """Mean speed over a stretch [rad/s]."""
    return float(angle[-1] - angle[0]) / float(time[-1] - time[0])


def simulated_output(step: RecordedStep, gear: HarmonicDrive) -> FloatArray:
    """Output angle [rad] of equation 2 with the measured input of one step, at its stamps.

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
