"""The traverses of a run, fitted: each direction of each repeat, from where its angles count and what may be in them.

A traverse is streamed (constant memory); all are fitted in the orders that they have.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from experiments.angle.certified import CertifiedAngle, angle_of, certified_angles
from experiments.angle.phase_reference import PhaseReference, phase_reference
from experiments.angle.traverses import traverses_of
from experiments.assumed import LOWEST_MODE, MOTOR_ENCODER, OUTPUT_ENCODER, OUTPUT_INERTIA, Assumed
from experiments.contract import Evidence
from experiments.errors import AnalysisError, analysing
from experiments.evidence import quality_remarks, rotary_ratio, usable
from experiments.load import UNSTATED, is_simulated
from experiments.recording import Recording, Segment
from experiments.torque.zero import TorqueZero, recorded_zero
from model.arrays import FloatArray
from model.channel import Channel
from model.gear import HarmonicDrive
from model.identify.angle_fit import AngleFit, solve_angle
from model.identify.encoders import Encoders
from model.identify.kinematic_error import (
    KinematicErrorAccumulator,
    KinematicErrorFit,
    fit_traverses,
)
from model.identify.torsion import Spring, StatedMode, Torsion, UnstatedMode
from model.identify.transmission import left_out_mse
from model.linear import dynamic_parameters
from model.units import ARCSEC, REVOLUTION

HIGHEST_ORDER = 12
"""Input orders that are fitted unless the setting says otherwise."""

OUTPUT_ECCENTRICITY, INPUT_ECCENTRICITY = 2.0, 1.0
"""arcsec at the output, once per output and once per input revolution: a seat that is trued up to half a micrometre."""

_STATED_MODE_UNCERTAINTY = 0.05
"""Relative standard uncertainty of a resonance that was stated: it depends on amplitude and warmth."""

_STIFFNESS_TOLERANCE = 0.4
"""Half-width of the rectangular distribution of K over the stiffness of a parameter set that no run identified."""


@dataclass(frozen=True)
class Traverse:
    """One direction of one repeat: its segment, its fit, and the torque over the same angle where it was recorded."""

    segment: Segment
    fit: KinematicErrorFit
    torque: AngleFit | None


@dataclass(frozen=True, kw_only=True)
class Context:
    """What every traverse of one recording shares."""

    recording: Recording
    ratio: float
    encoders: Encoders
    spring: Spring
    reference: PhaseReference
    zero: TorqueZero | None
    highest_order: int
    accuracy_order: float | None
    edge_triggered: bool
    certified: Mapping[str, CertifiedAngle]

    def angle(self, channel: str, rows: slice) -> FloatArray:
        """An encoder's angle [rad], without the errors that its certificate states."""
        return angle_of(self.recording, channel, rows, self.certified)


def fitted_traverses(
    recording: Recording, evidence: Evidence
) -> tuple[list[KinematicErrorFit], PhaseReference, Encoders]:
    """Every traverse of a run, fitted, from where its angles count, and what the encoders may add. Raises
    `AnalysisError` as `analyse`.
    """
    context, segments, _ = prepare(recording, evidence)
    with analysing(recording.metadata.run_id):
        fits = [one.fit for one in recorded_traverses(context, segments)]
    return fits, context.reference, context.encoders


def prepare(
    recording: Recording, evidence: Evidence
) -> tuple[Context, tuple[Segment, ...], list[str]]:
    """What the traverses of a recording share, their segments, and what is to be said of them. Raises
    `AnalysisError` where nothing can be computed.
    """
    recording.require("the kinematic error", "input_angle", "output_angle")
    warnings = quality_remarks(recording, "the kinematic error", evidence)
    ratio = rotary_ratio(recording, evidence.gear.mounted_ratio(recording.metadata.mounting))
    segments, remarks = _segments_of(recording)
    certified, sentences = certified_angles(recording)
    warnings += remarks + [f"{sentence} Its class stands in the budget." for sentence in sentences]
    encoders = _encoders_of(recording, evidence, certified)
    reference = phase_reference(recording)
    warnings += reference.warnings()
    zero = recorded_zero(recording)
    warnings += zero.warnings if zero else ("No torque was recorded: figure 16 cannot be drawn.",)
    settings = evidence.settings
    context = Context(
        recording=recording,
        ratio=ratio,
        encoders=encoders,
        spring=stated_mode(recording)
        or spring_of(evidence.gear, ratio, is_simulated=is_simulated(recording)),
        reference=reference,
        zero=zero,
        highest_order=int(settings.get("highest_order", HIGHEST_ORDER)),
        accuracy_order=settings.get("accuracy_order"),
        edge_triggered=bool(settings.get("edge_triggered", False)),
        certified=certified,
    )
    return context, segments, warnings


def _segments_of(recording: Recording) -> tuple[tuple[Segment, ...], list[str]]:
    """The segments of the traverses, and what is to be said where they were found from the angle alone."""
    remarks: list[str] = []
    segments = recording.labelled("traverse") or recording.labelled("traverse (cut)")
    if not segments and not recording.segments:
        segments = traverses_of(recording)
        remarks.append(
            "The recording has no segments: stretches in one direction were found from the input angle."
        )
    if not segments:
        raise AnalysisError(
            "there is no traverse: no stretch in which the input turns one way by more than a revolution",
            where=recording.metadata.run_id,
            remedy="Record whole output revolutions at constant speed.",
        )
    return segments, remarks


def _encoders_of(
    recording: Recording, evidence: Evidence, certified: Mapping[str, CertifiedAngle]
) -> Encoders:
    """What both encoders of a recording can do, and how they are seated."""
    input_end, output_end = recording.signals["input_angle"], recording.signals["output_angle"]
    settings = evidence.settings
    return Encoders(
        output_end.quantum or math.nan,
        input_end.quantum or math.nan,
        _class_of(output_end, OUTPUT_ENCODER),
        _class_of(input_end, MOTOR_ENCODER),
        float(settings.get("output_eccentricity", OUTPUT_ECCENTRICITY)) * ARCSEC,
        float(settings.get("input_eccentricity", INPUT_ECCENTRICITY)) * ARCSEC,
        output_certified=_uncertainty_of(certified.get("output_angle")),
        input_certified=_uncertainty_of(certified.get("input_angle")),
        output_unsaid=_unsaid(output_end, OUTPUT_ENCODER),
        input_unsaid=_unsaid(input_end, MOTOR_ENCODER),
    )


def _class_of(encoder: Channel, otherwise: Assumed) -> float:
    """Half the width of an encoder's whole curve [rad]: by its class, where none is stated by its certificate, and
    where there is none either as it is assumed.
    """
    stated = encoder.calibration
    if stated.accuracy is not None:
        return stated.accuracy
    return otherwise.half_width if stated.curve is None else stated.curve.half_width


def _unsaid(encoder: Channel, otherwise: Assumed) -> str:
    """The words of an assumed class; "" where somebody states one."""
    stated = encoder.calibration
    return otherwise.note if stated.accuracy is None and stated.curve is None else ""


def _uncertainty_of(certified: CertifiedAngle | None) -> float:
    return 0.0 if certified is None else certified.certificate.standard_uncertainty


def stated_mode(recording: Recording) -> StatedMode | None:
    """The first mode that was stated when a recording was imported; None where nobody did."""
    stated = recording.metadata.process.get("stated", {}).get("resonance_hz")
    if stated is None:
        return None
    return StatedMode(
        first_mode=float(stated) * REVOLUTION, relative_uncertainty=2.0 * _STATED_MODE_UNCERTAINTY
    )


def spring_of(gear: HarmonicDrive, ratio: float, *, is_simulated: bool = False) -> Spring:
    """The gear's spring with what its output carries, and the relative standard uncertainty of 1/w_1^2.

    What nobody said that the output carries is not that of another gear: its mode is one of which nothing is known
    but what the run shows (`UnstatedMode`).

    Where a run identified the resonance (it stands in the set's output inertia) its uncertainty
    counts; else the stiffness is one within `_STIFFNESS_TOLERANCE` of the set's.
    """
    origin = gear.value("inertia.output").origin
    if origin.provenance in UNSTATED and not is_simulated:
        line = OUTPUT_INERTIA.line("torsional amplification: first mode not stated", 0.0)
        return UnstatedMode(largest=1.0 / LOWEST_MODE**2, line=line)
    parameters = dynamic_parameters(gear, ratio=ratio)
    if origin.provenance == "identified" and origin.standard_uncertainty is not None:
        return Torsion(
            parameters=parameters,
            relative_uncertainty=origin.standard_uncertainty / gear.inertia.output,
        )
    low, high = 1.0 - _STIFFNESS_TOLERANCE, 1.0 + _STIFFNESS_TOLERANCE
    mean = math.log(high / low) / (high - low)
    return Torsion(
        parameters=parameters, relative_uncertainty=math.sqrt(1.0 / (low * high) - mean**2)
    )


def recorded_traverses(context: Context, segments: tuple[Segment, ...]) -> list[Traverse]:
    """Stream the segments, then fit kinematic error and torque of all in the orders that they have."""
    recording = context.recording
    timed = recording.metadata.time_base != "none"
    sums = [_streamed(context, segment, timed) for segment in segments]
    spring, time = (context.spring, 0) if timed else (None, None)
    fits = fit_traverses(sums, accuracy_order=context.accuracy_order, spring=spring, time=time)
    traverses: list[Traverse] = []
    for segment, fit in zip(segments, fits, strict=True):
        torque = None
        left_out = {"mse_left_out": left_out_mse(fit.regression)}
        fit = replace(fit, metrics=fit.metrics | left_out)
        if context.zero is not None:
            cells = fit.regression.cells
            torque, _ = solve_angle(cells, fit.basis, value=len(cells.mean) - 1)
        traverses.append(Traverse(segment, fit, torque))
    return traverses


def _streamed(context: Context, segment: Segment, timed: bool) -> KinematicErrorAccumulator:
    """One segment's angles, with its time and its torque where they were recorded."""
    recording = context.recording
    error = KinematicErrorAccumulator(
        context.ratio,
        encoders=context.encoders,
        edge_triggered=context.edge_triggered,
        highest_order=context.highest_order,
        beside=int(timed) + int(context.zero is not None),
    )
    for rows in recording.blocks(segment):
        good = usable(recording, rows)
        time = recording.time(rows)[good]
        beside = [time] if timed else []
        if context.zero is not None:
            beside.append(recording.si("torque", rows)[good] - context.zero.at(time))
        error.add(
            context.angle("input_angle", rows)[good] - context.reference.input_angle,
            recording.metadata.output_sense * context.angle("output_angle", rows)[good],
            *beside,
        )
    return error
