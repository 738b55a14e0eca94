"""Kinematic error: the output's deviation from the ideal over whole output revolutions, slowly, in both directions.

(15) ke = theta_o - theta_i/N
(16) ke_sim(theta_i) = a_0 + sum (a_n cos n theta_i + b_n sin n theta_i)
(22) MSE = 100/(N_0 sigma^2) sum (ke_sim - ke)^2, on the curve averaged per input angle; on raw samples beside it

Each traverse is streamed (constant memory); all are fitted in the orders that they have, and both
directions combined; figures 12, 13 and 16.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from experiments.angle.certified import CertifiedAngle, angle_of, certified_angles
from experiments.angle.phase_reference import PhaseReference, phase_reference
from experiments.angle.traverses import traverses_of
from experiments.assumed import LOWEST_MODE, MOTOR_ENCODER, OUTPUT_ENCODER, OUTPUT_INERTIA, Assumed
from experiments.budget import budget_table, scale_line
from experiments.contract import Evidence
from experiments.errors import AnalysisError, PlanError, analysing
from experiments.evidence import check_recording, check_settings, rotary_ratio, usable
from experiments.load import UNSTATED, is_simulated
from experiments.planning.speeds import (
    first_resonances,
)
from experiments.protocols.kinematic_error.declaration import NAME, SETTINGS
from experiments.protocols.kinematic_error.plots import (
    goodness_table,
    kinematic_error_plots,
    order_table,
    prediction_plot,
)
from experiments.protocols.kinematic_error.quantities import QUANTITIES
from experiments.quantity import quantity_of
from experiments.recording import Recording, Segment
from experiments.result import Covariance, Result, way_of
from experiments.setting import names_of
from experiments.torque.zero import TorqueZero, torque_zero
from model.arrays import FloatArray
from model.channel import Channel
from model.gear import Harmonic, HarmonicDrive, Origin
from model.gear_file import harmonic_path
from model.identify.angle_regression import AngleFit, solve_angle
from model.identify.directions import CombinedKinematicError, PhaseRelation, combine, phase_relation
from model.identify.estimate import BudgetLine, Estimate
from model.identify.kinematic_error import (
    Encoders,
    KinematicErrorAccumulator,
    KinematicErrorFit,
    fit_traverses,
    score_kinematic_error,
)
from model.identify.torsion import Spring, StatedMode, Torsion, UnstatedMode
from model.identify.transmission import left_out_mse
from model.kinematic_error import normalised_mse, order_of_label, series_value
from model.linear import dynamic_parameters
from model.units import ARCSEC, REVOLUTION

HIGHEST_ORDER = 12
"""Input orders that are fitted unless the setting says otherwise."""

OUTPUT_ECCENTRICITY, INPUT_ECCENTRICITY = 2.0, 1.0
"""arcsec at the output, once per output and once per input revolution: a seat that is trued up to half a micrometre."""

_TORQUE_LAG = 0.002
"""s; what the torque port may lag (filters and settling), standard uncertainty of a lag that is taken as zero."""

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
class _Context:
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


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """Kinematic error, transmission accuracy per direction, orders with intervals, and figure 16
    where torque was recorded.

    Settings: highest_order (12) of the input orders, accuracy_order (the highest) of the transmission accuracy,
    edge_triggered (False), output_eccentricity and input_eccentricity of the mounting (2, 1 arcsec at the output).
    Raises `AnalysisError` for missing channels, too many missed cycles, a wrong ratio.
    """
    check_settings(evidence.settings, names_of(SETTINGS), NAME)
    context, segments, warnings = _prepare(recording, evidence)
    with analysing(recording.metadata.run_id):
        traverses = _traverses_of(context, segments)
        pairs = _pairs(traverses)
        if not pairs:
            return _one_direction(context, traverses, evidence, warnings)
        combined = [combine(ahead.fit, back.fit) for ahead, back in pairs]
        relation = _figure_16(pairs[0], combined[0], abs(segments[0].setpoint))
    estimates = _pooled([c.estimates for c in combined])
    metrics = _metrics(context, traverses, combined, evidence.gear, abs(segments[0].setpoint))
    options: dict[str, object] = _options(context)
    for one in combined:
        warnings += one.warnings
    if relation is not None:
        estimates |= {
            f"figure_16_{name}": e.with_budget([scale_line(recording, e.value)])
            if e.unit == "N m"
            else e
            for name, e in relation.estimates.items()
        }
        # Of several repeats the relation has the first; the order's own number is that of all.
        error = estimates.get(f"amplitude_{relation.order:g}")
        if error is not None:
            estimates["figure_16_error_amplitude"] = replace(
                error, name="figure_16_error_amplitude"
            )
        options["figure_16"] = relation.sentence
    return Result(
        run=recording.metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates=estimates,
        metrics=metrics,
        warnings=tuple(dict.fromkeys(warnings)),
        plots=kinematic_error_plots(
            [t.fit for t in traverses], combined[0], relation, recording, context.reference
        ),
        tables=(
            order_table(combined[0]),
            goodness_table([t.fit for t in traverses]),
            budget_table(estimates.values()),
        ),
        options=options,
        covariance=_covariance(combined, estimates),
    )


def fitted_traverses(
    recording: Recording, evidence: Evidence
) -> tuple[list[KinematicErrorFit], PhaseReference, Encoders]:
    """Every traverse of a run, fitted, from where its angles count, and what the encoders may add. Raises
    `AnalysisError` as `analyse`.
    """
    context, segments, _ = _prepare(recording, evidence)
    with analysing(recording.metadata.run_id):
        fits = [one.fit for one in _traverses_of(context, segments)]
    return fits, context.reference, context.encoders


def _prepare(
    recording: Recording, evidence: Evidence
) -> tuple[_Context, tuple[Segment, ...], list[str]]:
    recording.require("the kinematic error", "input_angle", "output_angle")
    warnings = list(
        check_recording(recording, "the kinematic error", evidence.maximum_missed_share).warnings
    )
    ratio = rotary_ratio(recording, evidence.gear.mounted_ratio(recording.metadata.mounting))
    segments = recording.labelled("traverse") or recording.labelled("traverse (cut)")
    if not segments and not recording.segments:
        segments = traverses_of(recording)
        warnings.append(
            "The recording has no segments: stretches in one direction were found from the input angle."
        )
    if not segments:
        raise AnalysisError(
            "there is no traverse: no stretch in which the input turns one way by more than a revolution",
            where=recording.metadata.run_id,
            remedy="Record whole output revolutions at constant speed.",
        )
    ends = {"input": recording.signals["input_angle"], "output": recording.signals["output_angle"]}
    certified, sentences = certified_angles(recording)
    warnings += [f"{sentence} Its class stands in the budget." for sentence in sentences]
    encoders = Encoders(
        ends["output"].quantum or math.nan,
        ends["input"].quantum or math.nan,
        _class_of(ends["output"], OUTPUT_ENCODER),
        _class_of(ends["input"], MOTOR_ENCODER),
        float(evidence.settings.get("output_eccentricity", OUTPUT_ECCENTRICITY)) * ARCSEC,
        float(evidence.settings.get("input_eccentricity", INPUT_ECCENTRICITY)) * ARCSEC,
        output_certified=_uncertainty_of(certified.get("output_angle")),
        input_certified=_uncertainty_of(certified.get("input_angle")),
        output_unsaid=_unsaid(ends["output"], OUTPUT_ENCODER),
        input_unsaid=_unsaid(ends["input"], MOTOR_ENCODER),
    )
    reference = phase_reference(recording)
    warnings += reference.warnings()
    zero = torque_zero(recording) if recording.has("torque") else None
    warnings += zero.warnings if zero else ("No torque was recorded: figure 16 cannot be drawn.",)
    settings = evidence.settings
    return (
        _Context(
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
        ),
        segments,
        warnings,
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


def _traverses_of(context: _Context, segments: tuple[Segment, ...]) -> list[Traverse]:
    """Stream the segments, then fit kinematic error and torque of all in the orders that they have."""
    recording = context.recording
    timed = recording.metadata.time_base != "none"
    sums = [_streamed(context, segment, timed) for segment in segments]
    fits = fit_traverses(
        sums,
        accuracy_order=context.accuracy_order,
        spring=context.spring if timed else None,
        time=0 if timed else None,
    )
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


def _streamed(context: _Context, segment: Segment, timed: bool) -> KinematicErrorAccumulator:
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
        time = recording.time(rows)[good] if timed or context.zero is not None else None
        beside = [time] if timed and time is not None else []
        if context.zero is not None and time is not None:
            beside.append(recording.si("torque", rows)[good] - context.zero.at(time))
        error.add(
            context.angle("input_angle", rows)[good] - context.reference.input_angle,
            recording.metadata.output_sense * context.angle("output_angle", rows)[good],
            *beside,
        )
    return error


def _pairs(traverses: list[Traverse]) -> list[tuple[Traverse, Traverse]]:
    """Forward and reverse of each repeat."""
    ahead = [t for t in traverses if t.fit.direction > 0]
    back = [t for t in traverses if t.fit.direction < 0]
    return list(zip(ahead, back, strict=False))


def _figure_16(
    pair: tuple[Traverse, Traverse], combined: CombinedKinematicError, speed: float
) -> PhaseRelation | None:
    ahead, back = pair
    if ahead.torque is None or back.torque is None:
        return None
    return phase_relation(
        combined, ahead.torque, back.torque, torque_lag_angle=(0.0, _TORQUE_LAG * speed)
    )


def _covariance(
    combined: list[CombinedKinematicError], estimates: dict[str, Estimate]
) -> Covariance:
    """Of the cosines and sines (rad) of the orders that are reported, mean of both directions and of the repeats."""
    reported = [k for k, n in enumerate(combined[0].labels) if f"amplitude_{n}" in estimates]
    rows = [2 * k + part for k in reported for part in (0, 1)]
    labels = [combined[0].labels[k] for k in reported]
    names = tuple(f"{part}_{label}" for label in labels for part in ("cosine", "sine"))
    whole = np.sum([one.covariance for one in combined], axis=0) / len(combined) ** 2
    return Covariance(names, whole[np.ix_(rows, rows)])


def _one_direction(
    context: _Context, traverses: list[Traverse], evidence: Evidence, warnings: list[str]
) -> Result:
    """A recording of one direction only: no half-difference, so nothing about wind-up, friction or figure 16."""
    warnings = [*warnings, "One direction only: wind-up and skew stand in the kinematic error."]
    estimates = _pooled([t.fit.estimates for t in traverses])
    metrics = _metrics(context, traverses, [], evidence.gear, abs(traverses[0].segment.setpoint))
    for t in traverses:
        warnings += t.fit.warnings
    plots = kinematic_error_plots(
        [t.fit for t in traverses], None, None, context.recording, context.reference
    )
    tables = (goodness_table([t.fit for t in traverses]), budget_table(estimates.values()))
    run = context.recording.metadata.run_id
    return Result(
        run=run,
        kind=NAME,
        quantities=QUANTITIES,
        estimates=estimates,
        metrics=metrics,
        warnings=tuple(dict.fromkeys(warnings)),
        plots=plots,
        tables=tables,
        options=_options(context),
    )


def _pooled(repeats: list[dict[str, Estimate]]) -> dict[str, Estimate]:
    """The mean over repeats; the interval is the wider of each repeat's own and the scatter between them."""
    if len(repeats) == 1:
        return {name: replace(e, name=name) for name, e in repeats[0].items()}
    common = [name for name in repeats[0] if all(name in other for other in repeats)]
    return {name: _mean_of(name, [f[name] for f in repeats]) for name in common}


def _mean_of(name: str, estimates: list[Estimate]) -> Estimate:
    values = np.array([e.value for e in estimates])
    quantity = quantity_of(QUANTITIES, name)
    if quantity is not None and quantity.is_circular:
        mean = float(np.angle(np.mean(np.exp(1j * values))))
        away = np.angle(np.exp(1j * (values - mean)))
    else:
        mean = float(values.mean())
        away = values - mean
    n = len(values)
    within = float(np.mean([0.5 * (e.high - e.low) for e in estimates])) / math.sqrt(n)
    between = float(np.sqrt((away**2).sum() / (n - 1) / n))
    half = max(within, 2.0 * between)
    first = estimates[0]
    # The statistical part may be of something beside the value: a peak-to-peak with the bench's share in it.
    middle = mean + float(np.mean([0.5 * (e.low + e.high) - e.value for e in estimates]))
    budget = tuple(
        replace(line, standard_uncertainty=line.standard_uncertainty / math.sqrt(n))
        if line.kind == "A"
        else line
        for line in first.budget
    )
    if budget:
        budget = (*budget, BudgetLine("between repeats", "A", between, f"{n} repeats"))
    return replace(
        first, name=name, value=mean, low=middle - half, high=middle + half, budget=budget
    )


def _metrics(
    context: _Context,
    traverses: list[Traverse],
    combined: list[CombinedKinematicError],
    gear: HarmonicDrive,
    speed: float,
) -> dict[str, float]:
    metrics: dict[str, float] = {}
    for t in traverses[:2]:
        way = way_of(t.fit.direction)
        metrics |= {f"{name}_{way}": value for name, value in t.fit.metrics.items()}
    if combined:
        metrics["agreement_of_directions"] = combined[0].metrics["agreement"]
    same_way = [t.fit for t in traverses if t.fit.direction > 0]
    if len(same_way) > 1:
        scores = [score_kinematic_error(same_way[0], other).mse for other in same_way[1:]]
        metrics["mse_on_other_repeats"] = float(np.mean(scores))
    highest = max((h.order for h in gear.kinematic_error), default=4.0)
    if speed > 0.0:
        metrics["margin_to_first_mode"] = first_resonances(gear)[0] / (highest * speed)
    metrics["delay"] = traverses[0].fit.delay
    metrics["slipped_counts"] = float(sum(len(t.fit.slips) for t in traverses))
    return metrics


def _options(context: _Context) -> dict[str, object]:
    metadata = context.recording.metadata
    corrected: dict[str, object] = {}
    if context.certified:
        names = sorted(context.certified)
        corrected["corrected_by_certificate"] = ", ".join(names)
        told = [context.recording.signals[name].calibration.certificate for name in names]
        corrected["certificates"] = "; ".join(told)
    return corrected | {
        "mounting": metadata.mounting,
        "ratio": context.ratio,
        "sign": "positive: output leads in the direction of travel of a positive input",
        "phases_count_from": context.reference.what,
        "phase_reference_angle": context.reference.input_angle,
        "highest_order": context.highest_order,
        "edge_triggered": context.edge_triggered,
    }


def compare(recording: Recording, gear: HarmonicDrive, evidence: Evidence) -> Result:
    """Score the kinematic error of a given parameter set on a run: MSE (22) per direction, 100 being the mean alone.

    Where the run saw no index mark the phase of the set is not known here; the best common shift is scored beside it.
    """
    check_settings(evidence.settings, names_of(SETTINGS), NAME)
    context, segments, warnings = _prepare(recording, evidence)
    with analysing(recording.metadata.run_id):
        traverses = _traverses_of(context, segments)
    if not gear.kinematic_error:
        raise AnalysisError(
            "the parameter set has no kinematic error", where="kinematic_error.orders"
        )
    metrics: dict[str, float] = {}
    for t in traverses:
        way = f"{way_of(t.fit.direction)}_{t.segment.repeat}"
        metrics[f"mse_{way}"] = _mse_of(gear, t.fit, 0.0)
        if not context.reference.carries:
            shifts = np.linspace(0.0, 2.0 * math.pi, 360, endpoint=False)
            metrics[f"mse_free_phase_{way}"] = min(_mse_of(gear, t.fit, shift) for shift in shifts)
    metrics["mse_of_the_mean"] = 100.0
    whole = [h.order for h in gear.kinematic_error if abs(h.order - round(h.order)) < 1e-9]
    if len(whole) < len(gear.kinematic_error):
        warnings.append(
            "Output orders and sidebands of the set average out in the curve over the input and are not scored."
        )
    plots = tuple(prediction_plot(gear, t.fit) for t in traverses[:2])
    return Result(
        run=recording.metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates={},
        metrics=metrics,
        warnings=tuple(warnings),
        plots=plots,
        options={**_options(context), "parameter_set": gear.name, "fitted": "nothing"},
    )


def _mse_of(gear: HarmonicDrive, fit: KinematicErrorFit, shift: float) -> float:
    whole = [h for h in gear.kinematic_error if abs(h.order - round(h.order)) < 1e-9]
    predicted = series_value(whole, fit.input_angle + shift)
    return normalised_mse(
        fit.measured_curve, predicted - predicted.mean() + fit.measured_curve.mean()
    )


def identified(result: Result, gear: HarmonicDrive) -> HarmonicDrive:
    """The gear with the orders that the run identified, each with its uncertainty; others are taken
    out of the series.
    """
    if result.kind != NAME:
        raise PlanError(
            "is the result of another protocol", where=result.run, value=result.kind, limit=NAME
        )
    series: list[Harmonic] = []
    origins = {
        path: o for path, o in gear.origins.items() if not path.startswith("kinematic_error.")
    }
    ratio = float(result.options.get("ratio", gear.ratio))
    for name, amplitude in result.estimates.items():
        if (
            not name.startswith("amplitude_")
            or amplitude.identifiable == "no"
            or not amplitude.low > 0.0
            or name.replace("amplitude_", "phase_") not in result.estimates
        ):
            # What is above the noise belongs to gear and encoders together; it is kept, with the doubt who made it.
            continue
        label = name.removeprefix("amplitude_")
        phase = result.estimates[f"phase_{label}"].value
        order = order_of_label(label, ratio)
        series.append(
            Harmonic(order, amplitude.value * math.cos(phase), amplitude.value * math.sin(phase))
        )
        source = (
            f"run {result.run}, phases from {result.options.get('phases_count_from', 'unknown')}"
        )
        origins[harmonic_path(order)] = Origin("identified", source, amplitude.standard_uncertainty)
    if not series:
        return gear
    return replace(
        gear,
        kinematic_error=tuple(sorted(series, key=lambda h: h.order)),
        origins=MappingProxyType(origins),
    )
