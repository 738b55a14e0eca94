"""Inertia and friction from any motion: inverse dynamics by least squares, for recordings of this rig and of others.

symmetric     F = M a + F_v v + F_c sgn v + F_0
asymmetric    F = M a + F_v+ v + F_c+  (v > 0),   F = M a + F_v- v - F_c-  (v < 0)
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.budget import budget_table, scale_line
from experiments.contract import Evidence, Experiment, NoParameters, no_plan
from experiments.errors import AnalysisError, analysing
from experiments.evidence import check_recording, check_settings, require_time_base, usable
from experiments.planning.parts import ZERO_AFTER, ZERO_BEFORE
from experiments.quantity import Quantity
from experiments.recording import Recording
from experiments.recordings.channels import ANGLES, EFFORTS, chosen_channel
from experiments.result import Covariance, Plot, Result, Series
from experiments.torque.zero import torque_zero
from model.arrays import FloatArray
from model.identify.estimate import BudgetLine, Estimate
from model.identify.motion import (
    MotionFilter,
    MotionFit,
    MotionScore,
    Variant,
    fit_motion,
    score_motion,
)

NAME = "motion"
SETTINGS = ("variant", "position", "effort", "cutoff_hz", "decimation", "start", "stop")
EVEN = 0.01
"""Relative deviation of a sampling step above which the channels are brought onto an even time axis."""

QUANTITIES = (
    Quantity(name="inertia", title="inertia", unit=""),
    Quantity(name="viscous", title="viscous friction", unit=""),
    Quantity(name="coulomb", title="Coulomb friction", unit=""),
    Quantity(name="viscous_{way}", title="viscous {way}", unit=""),
    Quantity(name="coulomb_{way}", title="coulomb {way}", unit=""),
    Quantity(name="offset", title="offset", unit="", is_signed=True),
    Quantity(name="relative_error_percent", title="relative error percent", unit="1"),
    Quantity(name="condition", title="condition", unit="1"),
    Quantity(name="condition_scaled", title="condition scaled", unit="1"),
    Quantity(name="residual_norm", title="residual norm", unit=""),
    Quantity(name="samples", title="samples", unit="1"),
)


@dataclass(frozen=True, kw_only=True)
class _Channels:
    """Time [s], position and effort on an even time axis, with their units."""

    time: FloatArray
    position: FloatArray
    effort: FloatArray
    position_unit: str
    effort_unit: str
    effort_name: str
    warnings: list[str]


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """Inertia, viscous and Coulomb friction and offset of one axis, with intervals that respect autocorrelation.

    Settings: variant ("symmetric" or "asymmetric"), position and effort (channel names), cutoff_hz
    and decimation of the filter, start and stop [s] of the part of the run. Raises `AnalysisError`
    without a true time base.
    """
    settings = evidence.settings
    check_settings(settings, SETTINGS, NAME)
    data = _channels(recording, settings, evidence.maximum_missed_share)
    with analysing(recording.metadata.run_id):
        fit = _fit(data, settings)
    estimates = _with_units(recording, fit, data)
    plots = (_force_plot(fit, data), _friction_plot(fit, data))
    options = {
        "variant": fit.variant,
        "effort": data.effort_name,
        "torque_is_of": "the whole axis",
        "filter": dataclasses.asdict(_recipe(settings)),
    }
    return Result(
        run=recording.metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates=estimates,
        metrics=dict(fit.metrics),
        warnings=(*data.warnings, *fit.warnings),
        plots=plots,
        tables=(budget_table(estimates.values()),),
        options=options,
        covariance=Covariance(tuple(fit.estimates), fit.covariance),
    )


def cross_validate(fitted: Recording, other: Recording, evidence: Evidence) -> MotionScore:
    """Fit one recording and predict the effort of another one with it: relative error in per cent."""
    settings = evidence.settings
    check_settings(settings, SETTINGS, NAME)
    first = _channels(fitted, settings, evidence.maximum_missed_share)
    second = _channels(other, settings, evidence.maximum_missed_share)
    with analysing(other.metadata.run_id):
        return score_motion(
            _fit(first, settings),
            second.time,
            second.position,
            second.effort,
            recipe=_recipe(settings),
        )


def _fit(data: _Channels, settings: Mapping[str, Any]) -> MotionFit:
    variant: Variant = settings.get("variant", "symmetric")
    if variant not in ("symmetric", "asymmetric"):
        raise AnalysisError(
            "no such variant",
            where=f"{NAME}.variant",
            value=repr(variant),
            limit="symmetric, asymmetric",
        )
    return fit_motion(
        data.time,
        data.position,
        data.effort,
        variant=variant,
        recipe=_recipe(settings),
        rotary=data.position_unit == "rad",
    )


def _recipe(settings: Mapping[str, Any]) -> MotionFilter:
    usual = MotionFilter()
    return MotionFilter(
        cutoff_hz=float(settings.get("cutoff_hz", usual.cutoff_hz)),
        decimation=int(settings.get("decimation", usual.decimation)),
    )


def _channels(
    recording: Recording, settings: Mapping[str, Any], maximum_missed_share: float
) -> _Channels:
    position = chosen_channel(recording, settings, "position", ANGLES, "the motion")
    effort = chosen_channel(recording, settings, "effort", EFFORTS, "inverse dynamics")
    warnings = list(check_recording(recording, "inverse dynamics", maximum_missed_share).warnings)
    require_time_base(recording, "inverse dynamics")
    rows = _rows(recording, settings)
    good = usable(recording, rows)
    time = recording.time(rows)[good]
    place = (
        recording.output_angle(rows) if position == "output_angle" else recording.si(position, rows)
    )
    force = recording.si(effort, rows)[good]
    if recording.labelled(ZERO_BEFORE, ZERO_AFTER):
        zero = torque_zero(recording, effort)
        force = force - zero.at(time)
        warnings += zero.warnings
    time, place, force, said = _even(time, place[good], force)
    signals = recording.signals
    return _Channels(
        time=time,
        position=place,
        effort=force,
        position_unit=signals[position].unit,
        effort_unit=signals[effort].unit,
        effort_name=effort,
        warnings=warnings + said,
    )


def _rows(recording: Recording, settings: Mapping[str, Any]) -> slice:
    """The part of the run that is used: between the torque zeros, or from `start` to `stop` seconds."""
    first, last = 0, recording.rows
    for segment in recording.labelled(ZERO_BEFORE):
        first = max(first, segment.stop)
    for segment in recording.labelled(ZERO_AFTER):
        last = min(last, segment.start)
    if "start" in settings or "stop" in settings:
        time = recording.time()
        first = int(np.searchsorted(time, float(settings.get("start", time[0]))))
        last = int(np.searchsorted(time, float(settings.get("stop", time[-1])), side="right"))
    if last - first < 2:
        raise AnalysisError(
            "the chosen part of the run is empty", where=f"{NAME}.start, {NAME}.stop"
        )
    return slice(first, last)


def _even(
    time: FloatArray, position: FloatArray, effort: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, list[str]]:
    """The channels on an even time axis; left alone where they are on one already."""
    steps = np.diff(time)
    if len(steps) < 2 or steps.min() <= 0.0:
        return time, position, effort, []
    period = float(np.median(steps))
    worst = float(np.max(np.abs(steps - period))) / period
    if worst <= EVEN:
        return time, position, effort, []
    axis = np.arange(time[0], time[-1], period)
    text = (
        f"Sampling steps differ by up to {100.0 * worst:.2g} %: the channels were brought onto "
        "an even axis by their true "
        "times."
    )
    return axis, np.interp(axis, time, position), np.interp(axis, time, effort), [text]


def _with_units(recording: Recording, fit: MotionFit, data: _Channels) -> dict[str, Estimate]:
    """The estimates with budget, in the units of the channels where these are not torque and angle
    or force and length.
    """
    derived = {
        "inertia": f"{data.effort_unit} s2/{data.position_unit}",
        "viscous": f"{data.effort_unit} s/{data.position_unit}",
        "coulomb": data.effort_unit,
        "offset": data.effort_unit,
    }
    mechanical = (data.effort_unit, data.position_unit) in (("N m", "rad"), ("N", "m"))
    estimates: dict[str, Estimate] = {}
    for name, estimate in fit.estimates.items():
        unit = estimate.unit if mechanical else derived[name.split("_")[0]]
        error = 0.25 * (estimate.high - estimate.low)
        lines = (
            BudgetLine("residual, autocorrelation respected", "A", error),
            scale_line(recording, estimate.value, data.effort_name),
        )
        estimates[name] = dataclasses.replace(estimate, unit=unit).with_budget(lines)
    return estimates


def _force_plot(fit: MotionFit, data: _Channels) -> Plot:
    series = (
        Series(label="measured", x=fit.time, y=fit.measured, style="line", group=0),
        Series(label="inverse dynamics", x=fit.time, y=fit.predicted, style="line", group=1),
        Series(label="residual", x=fit.time, y=fit.measured - fit.predicted, style="line", group=2),
    )
    return Plot(
        name="motion-effort",
        title=f"{data.effort_name}, measured and predicted",
        x_label="time [s]",
        y_label=f"{data.effort_name} [{data.effort_unit}]",
        series=series,
    )


def _friction_plot(fit: MotionFit, data: _Channels) -> Plot:
    """What is left of the effort without inertia, over velocity."""
    inertia = fit.estimates["inertia"].value
    order = np.argsort(fit.velocity)
    acceleration = np.gradient(fit.velocity, fit.time)
    friction = fit.measured - inertia * acceleration
    series = (
        Series(
            label="effort without inertia", x=fit.velocity[order], y=friction[order], style="points"
        ),
    )
    return Plot(
        name="motion-friction",
        title="Friction over velocity",
        x_label=f"velocity [{data.position_unit}/s]",
        y_label=f"{data.effort_name} [{data.effort_unit}]",
        series=series,
    )


EXPERIMENT = Experiment(
    name=NAME,
    title="Inertia and friction from motion",
    summary="inertia and friction from any motion (inverse dynamics)",
    parameters=NoParameters,
    plan=no_plan,
    analyse=analyse,
    needs=(),
    has_plan=False,
    quantities=QUANTITIES,
    version=2,
)
