"""Kinematic error: the output's deviation from the ideal over whole output revolutions, slowly, in both directions.

(15) ke = theta_o - theta_i/N
(16) ke_sim(theta_i) = a_0 + sum (a_n cos n theta_i + b_n sin n theta_i)
(22) MSE = 100/(N_0 sigma^2) sum (ke_sim - ke)^2, on the curve averaged per input angle; on raw samples beside it

Each traverse is streamed (constant memory); all are fitted in the orders that they have, and both
directions combined; figures 12, 13 and 16.
"""

from __future__ import annotations

import math
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from experiments.budget import budget_table, scale_line
from experiments.contract import Evidence
from experiments.errors import AnalysisError, PlanError, analysing
from experiments.evidence import check_settings
from experiments.planning.speeds import first_resonances
from experiments.protocols.kinematic_error.declaration import NAME, SETTINGS
from experiments.protocols.kinematic_error.plots import (
    goodness_table,
    kinematic_error_plots,
    order_table,
    predicted_curve,
    prediction_plot,
    whole_orders,
)
from experiments.protocols.kinematic_error.quantities import QUANTITIES
from experiments.protocols.kinematic_error.traverses import (
    Context,
    Traverse,
    prepare,
    recorded_traverses,
)
from experiments.quantity import quantity_of
from experiments.recording import Recording
from experiments.result import Covariance, Result, way_of
from experiments.setting import names_of
from model.gear import Harmonic, HarmonicDrive, Origin
from model.gear_file import harmonic_path
from model.identify.directions import CombinedKinematicError, PhaseRelation, combine, phase_relation
from model.identify.estimate import BudgetLine, Estimate
from model.identify.kinematic_error import score_kinematic_error
from model.kinematic_error import normalised_mse, order_of_label

_TORQUE_LAG = 0.002
"""s; what the torque port may lag (filters and settling), standard uncertainty of a lag that is taken as zero."""


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """Kinematic error, transmission accuracy per direction, orders with intervals, and figure 16
    where torque was recorded.

    Settings: highest_order (12) of the input orders, accuracy_order (the highest) of the transmission accuracy,
    edge_triggered (False), output_eccentricity and input_eccentricity of the mounting (2, 1 arcsec at the output).
    Raises `AnalysisError` for missing channels, too many missed cycles, a wrong ratio.
    """
    check_settings(evidence.settings, names_of(SETTINGS), NAME)
    context, segments, warnings = prepare(recording, evidence)
    with analysing(recording.metadata.run_id):
        traverses = recorded_traverses(context, segments)
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
        estimates |= _of_figure_16(recording, relation, estimates)
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


def _of_figure_16(
    recording: Recording, relation: PhaseRelation, estimates: dict[str, Estimate]
) -> dict[str, Estimate]:
    """The numbers of figure 16, torques with their scale; the amplitude of the order beside them."""
    told: dict[str, Estimate] = {}
    for name, e in relation.estimates.items():
        is_torque = e.unit == "N m"
        told[f"figure_16_{name}"] = (
            e.with_budget([scale_line(recording, e.value)]) if is_torque else e
        )
    # Of several repeats the relation has the first; the order's own number is that of all.
    error = estimates.get(f"amplitude_{relation.order:g}")
    if error is not None:
        told["figure_16_error_amplitude"] = replace(error, name="figure_16_error_amplitude")
    return told


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
    context: Context, traverses: list[Traverse], evidence: Evidence, warnings: list[str]
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
    shares = {"A": math.sqrt(n), "B": 1.0}
    budget = tuple(
        replace(line, standard_uncertainty=line.standard_uncertainty / shares[line.kind])
        for line in first.budget
    )
    if budget:
        budget = (*budget, BudgetLine("between repeats", "A", between, f"{n} repeats"))
    return replace(
        first, name=name, value=mean, low=middle - half, high=middle + half, budget=budget
    )


def _metrics(
    context: Context,
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


def _options(context: Context) -> dict[str, object]:
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
    context, segments, warnings = prepare(recording, evidence)
    with analysing(recording.metadata.run_id):
        traverses = recorded_traverses(context, segments)
    if not gear.kinematic_error:
        raise AnalysisError(
            "the parameter set has no kinematic error", where="kinematic_error.orders"
        )
    metrics: dict[str, float] = {}
    for t in traverses:
        way = f"{way_of(t.fit.direction)}_{t.segment.repeat}"
        measured = t.fit.measured_curve
        metrics[f"mse_{way}"] = normalised_mse(measured, predicted_curve(gear, t.fit))
        if not context.reference.carries:
            shifts = np.linspace(0.0, 2.0 * math.pi, 360, endpoint=False)
            metrics[f"mse_free_phase_{way}"] = min(
                normalised_mse(measured, predicted_curve(gear, t.fit, shift)) for shift in shifts
            )
    metrics["mse_of_the_mean"] = 100.0
    if len(whole_orders(gear)) < len(gear.kinematic_error):
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
