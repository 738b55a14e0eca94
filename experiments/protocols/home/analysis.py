"""Home: the index marks of both encoders, slowly and from one side, so that phases survive the power being off."""

from __future__ import annotations

import math

import numpy as np

from experiments.angle.phase_reference import INPUT_SEEN, OUTPUT_SEEN
from experiments.assumed import MOTOR_ENCODER, OUTPUT_ENCODER
from experiments.contract import Evidence
from experiments.errors import AnalysisError
from experiments.evidence import check_settings, quality_remarks
from experiments.protocols.home.declaration import NAME, QUANTITIES
from experiments.recording import Recording, Segment
from experiments.result import Result, Table
from model.channel import Channel
from model.identify.estimate import BudgetLine, Cause, Estimate
from model.identify.least_squares import student_quantile
from model.units import DEGREE, REVOLUTION


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """Where the index marks lie within the revolution of their encoder, and how well they repeat.

    Every pass is forward, so that the mark is met from one side; the spread of the passes is the type A part.
    """
    check_settings(evidence.settings, (), NAME)
    recording.require("homing", "input_angle", "input_index", "index_seen")
    warnings = quality_remarks(recording, "homing", evidence)
    estimates: dict[str, Estimate] = {}
    rows: list[tuple[float | int | str, ...]] = []
    for which, bit, cause in (
        ("input", INPUT_SEEN, Cause.MOTOR_ENCODER),
        ("output", OUTPUT_SEEN, Cause.OUTPUT_ENCODER),
    ):
        if not recording.has(f"{which}_index"):
            warnings.append(
                f"There is no {which}_index channel: the {which} mark was not looked for."
            )
            continue
        marks = _marks(recording, which, bit)
        rows += [(which, k + 1, mark % REVOLUTION / DEGREE) for k, mark in enumerate(marks)]
        if not marks:
            warnings.append(
                f"The {which} index mark was not seen: phases cannot be carried to another run."
            )
            continue
        estimates[f"{which}_index"] = _circular_mean(
            f"{which}_index", marks, recording.signals[f"{which}_index"], cause
        )
    if not estimates:
        raise AnalysisError(
            "no index mark was seen",
            where=recording.metadata.run_id,
            remedy="Check the index lines of both encoders.",
        )
    table = Table(
        "index-marks",
        "Index marks within the revolution",
        ("encoder", "pass", "angle [deg]"),
        tuple(rows),
    )
    return Result(
        run=recording.metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates=estimates,
        metrics={f"{name}_spread": e.high - e.low for name, e in estimates.items()},
        warnings=tuple(warnings),
        tables=(table,),
    )


def _marks(recording: Recording, which: str, bit: int) -> list[float]:
    """The latched angles [rad] of the passes over the mark of the "input" or "output" encoder."""
    passes = recording.labelled(f"home-{which}")
    found = [_mark(recording, segment, which, bit) for segment in passes]
    return [mark for mark in found if mark is not None]


def _mark(recording: Recording, segment: Segment, which: str, bit: int) -> float | None:
    """The latched angle [rad] at the end of one pass, or None where no mark has been seen."""
    if segment.stop <= segment.start:
        return None
    last = slice(segment.stop - 1, segment.stop)
    if not int(recording.stored("index_seen", last)[0]) & bit:
        return None
    return float(recording.si(f"{which}_index", last)[0])


def _circular_mean(name: str, marks: list[float], signal: Channel, cause: Cause) -> Estimate:
    """Mean of angles on the circle [rad], with the spread of the passes and the size of one count.

    A count is any angle within its width, as likely: 95 % of a rectangle are 0.95 of its half width.
    """
    angles = np.array(marks)
    mean = float(np.angle(np.mean(np.exp(1j * angles)))) % REVOLUTION
    away = np.angle(np.exp(1j * (angles - mean)))
    quantum = signal.quantum / math.sqrt(12.0)
    spread, half, note = 0.0, 0.0, "one pass only: repeatability is not known"
    if len(marks) > 1:
        spread, note = float(away.std(ddof=1)) / math.sqrt(len(marks)), ""
        half = student_quantile(len(marks) - 1) * spread
    half = math.hypot(half, 0.95 * math.sqrt(3.0) * quantum)
    budget = (
        BudgetLine("passes", "A", spread, degrees_of_freedom=max(len(marks) - 1, 1)),
        BudgetLine("one count of the encoder", "B", quantum),
        _accuracy_line(signal, cause),
    )
    return Estimate(
        name=name,
        value=mean,
        unit="rad",
        low=mean - half,
        high=mean + half,
        identifiable="yes",
        note=note,
        budget=budget,
    )


def _accuracy_line(signal: Channel, cause: Cause) -> BudgetLine:
    """The encoder's accuracy [rad], the half width of its whole curve: the mark lies at one place of it."""
    accuracy, source = signal.calibration.accuracy, "accuracy of the encoder"
    if accuracy is None:
        row = OUTPUT_ENCODER if cause is Cause.OUTPUT_ENCODER else MOTOR_ENCODER
        return row.line(source, row.standard_uncertainty, cause)
    return BudgetLine(source, "B", accuracy / math.sqrt(3.0), "", cause)
