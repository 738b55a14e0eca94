"""Inertia and friction from any motion: inverse dynamics, for recordings of this rig and of others.

symmetric     F = M a + F_v v + F_c sgn v + F_0
asymmetric    F = M a + F_v+ v + F_c+  (v > 0),   F = M a + F_v- v - F_c-  (v < 0)
stribeck      F = M a + F_v v + {F_c + (F_s - F_c) exp[-(v/v_s)^2]} sgn v + F_0
load          + sum over k of A_k sin(k theta) + B_k cos(k theta)

Cut-off, dead zone, lag and rung follow from the data where no setting says otherwise
(`model.identify.motion`).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from experiments.assumed import ONE_WAY
from experiments.budget import STATED, budget_table, scale_line, zero_uncertainty
from experiments.contract import Evidence
from experiments.errors import AnalysisError, analysing
from experiments.evidence import check_recording, check_settings, require_time_base
from experiments.planning.speeds import first_resonances
from experiments.recording import Recording
from experiments.recordings.motion.declaration import NAME, QUANTITIES, SETTINGS
from experiments.recordings.motion.remedies import load_remedy
from experiments.recordings.motion_channels import RecordedMotion, number, recorded_motion
from experiments.recordings.motion_plots import motion_plots, motion_tables
from experiments.result import Covariance, Result
from experiments.setting import names_of
from model.identify.estimate import BudgetLine, Estimate
from model.identify.motion import (
    VARIANTS,
    MotionChoice,
    identify_motion,
)
from model.identify.motion_result import MotionFit
from model.units import REVOLUTION

_MOST_HARMONICS = 40


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """Inertia, viscous and Coulomb friction and offset of one axis, with intervals that respect autocorrelation.

    Settings: variant (auto, symmetric, asymmetric, stribeck); position, effort and instrument
    (channel names; instrument=none for no other than the position's own halves); load (gravity or
    harmonics:K); lag_s of the effort; least_speed, cutoff_hz and decimation by hand; start and stop
    [s] of the part of the run. Raises `AnalysisError` without a true time base.
    """
    settings = evidence.settings
    check_settings(settings, names_of(SETTINGS), NAME)
    motion, warnings = channels_of(recording, settings, evidence.maximum_missed_share)
    with analysing(recording.metadata.run_id):
        choice = choice_of(motion, settings)
        fit = identify_motion(motion, choice, rotary=motion.position_unit == "rad")
        warnings += _remarks(motion, fit)
        if not choice.load_orders:
            warnings += filter(None, [load_remedy(motion, fit, _turn_if_known(motion))])
    estimates = _with_budget(motion, fit)
    return Result(
        run=recording.metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates=estimates,
        metrics=dict(fit.metrics),
        warnings=(*warnings, *fit.warnings),
        plots=motion_plots(fit, motion),
        tables=(*motion_tables(fit, estimates), budget_table(estimates.values())),
        options=_options(motion, fit, choice),
        covariance=Covariance(tuple(fit.estimates), fit.covariance),
    )


def channels_of(
    recording: Recording, settings: Mapping[str, Any], maximum_missed_share: float
) -> tuple[RecordedMotion, list[str]]:
    """The channels of the motion, and what must be said of the recording."""
    motion = recorded_motion(recording, settings, NAME)
    checked = check_recording(recording, "inverse dynamics", maximum_missed_share)
    require_time_base(recording, "inverse dynamics")
    zero = () if motion.zero is None else motion.zero.warnings
    return motion, [*checked.warnings, *zero]


def choice_of(motion: RecordedMotion, settings: Mapping[str, Any]) -> MotionChoice:
    """What the settings choose by hand."""
    variant = settings.get("variant", "auto")
    if variant not in VARIANTS:
        raise AnalysisError(
            "no such variant",
            where=f"{NAME}.variant",
            value=repr(variant),
            limit=", ".join(VARIANTS),
        )
    orders = _load_orders(settings)
    by_hand: dict[str, float | None] = {
        name: number(settings, name, NAME, math.nan) if name in settings else None
        for name in ("cutoff_hz", "decimation", "least_speed", "lag_s")
    }
    decimation, lag = by_hand["decimation"], by_hand["lag_s"]
    return MotionChoice(
        variant=variant,
        cutoff_hz=by_hand["cutoff_hz"],
        rigid_hz=_rigid_below(motion.recording),
        decimation=None if decimation is None else int(decimation),
        least_speed=by_hand["least_speed"],
        load_orders=orders,
        load_turn=load_turn(motion) if orders else 1.0,
        lag=motion.stated_lag if lag is None else lag,
        instrument_is_position=motion.instrument_is_position,
    )


def _rigid_below(recording: Recording) -> float:
    """Hz below which a gear that is known turns its output with its input: a third of the first mode by its card."""
    gear = recording.metadata.gear
    if gear is None or not recording.metadata.gear_mounted:
        return math.inf
    return first_resonances(gear)[0] / REVOLUTION / 3.0


def _load_orders(settings: Mapping[str, Any]) -> tuple[int, ...]:
    """Orders of the load over one revolution: 1 for gravity, 1 to K for harmonics."""
    load = str(settings.get("load", ""))
    if load in ("", "none"):
        return ()
    if load == "gravity":
        return (1,)
    name, _, count = load.partition(":")
    if name == "harmonics" and count.isdecimal() and 1 <= int(count) <= _MOST_HARMONICS:
        return tuple(range(1, int(count) + 1))
    raise AnalysisError(
        "no such load",
        where=f"{NAME}.load",
        value=repr(load),
        limit=f"gravity, or harmonics:K with K from 1 to {_MOST_HARMONICS}",
    )


def load_turn(motion: RecordedMotion) -> float:
    """Angle of the load per position: a load turns with the output, one ratio slower than the input."""
    recording = motion.recording
    if motion.position_unit != "rad":
        raise AnalysisError(
            "a load over position needs an angle",
            where=f"{NAME}.load",
            value=f"{motion.place} in {motion.position_unit}",
            limit="rad",
            remedy="On a linear axis gravity is part of the offset.",
        )
    if motion.place != "input_angle":
        return 1.0
    ratio = recording.metadata.ratio
    if not (math.isfinite(ratio) and ratio > 0.0):
        raise AnalysisError(
            "a load over the output's angle needs the ratio of the gear",
            where=f"{NAME}.load",
            value=f"ratio {ratio:g}",
            remedy="State the ratio at the import (--ratio), or use the output's angle.",
        )
    return 1.0 / ratio


def _turn_if_known(motion: RecordedMotion) -> float:
    """Angle of the load per position, where that can be known; else as if the position were the load's."""
    try:
        return load_turn(motion)
    except AnalysisError:
        return 1.0


def _remarks(motion: RecordedMotion, fit: MotionFit) -> list[str]:
    """What a reader must know of the channels and of what was left out."""
    share, unit = fit.metrics["standstill_share"], motion.position_unit
    remarks: list[str] = []
    if share > 0.0:
        remarks.append(
            f"{100.0 * share:.2g} % of the samples are at standstill (below {fit.recipe.least_speed:.3g} {unit}/s) "
            "and were left out: they are no samples of sliding friction."
        )
    if _is_one_way(fit):
        remarks.append(
            "The motion goes one way: an offset (gravity, a zero) is one with the Coulomb friction, and is in it."
        )
    axis = motion.axis
    if axis.gaps:
        remarks.append(
            f"{axis.gaps} gaps of up to {axis.longest_gap:.3g} s were cut out; nothing is drawn across them."
        )
    if not axis.is_even:
        remarks.append(
            f"Sampling steps differ by up to {100.0 * axis.worst_step:.2g} %: the channels were brought onto "
            "an even axis by their true times."
        )
    if motion.sense_is_unknown:
        remarks.append(
            f"Nobody stated how {motion.place} counts: it is taken as recorded (--output-sense states it)."
        )
    return remarks


def _with_budget(motion: RecordedMotion, fit: MotionFit) -> dict[str, Estimate]:
    """The estimates with budget, in the units of the channels where these are not torque and angle
    or force and length.
    """
    estimates: dict[str, Estimate] = {}
    for place, (name, estimate) in enumerate(fit.estimates.items()):
        error = math.sqrt(max(float(fit.covariance[place, place]), 0.0))
        lines = [
            BudgetLine(
                "residual, autocorrelation respected", "A", error, degrees_of_freedom=fit.freedom
            )
        ]
        for source, u, note in (
            ("filter", fit.filter_uncertainty, "half and twice the cut-off"),
            ("choice of the model", fit.rung_uncertainty, "difference to the Stribeck rung"),
            ("lag of the effort", fit.lag_uncertainty, "not stated"),
            ("noise that samples share", fit.shared_uncertainty, "by instruments far apart"),
        ):
            if u.get(name, 0.0) > 0.0:
                lines.append(BudgetLine(source, "B", u[name], note))
        if name != "stribeck_velocity":
            lines.append(scale_line(motion.recording, estimate.value, motion.effort))
        if name == "offset":
            lines.append(_zero_line(motion))
        if _is_one_way(fit) and name in ("coulomb", "static"):
            lines.append(
                ONE_WAY.line(
                    "offset, in it", ONE_WAY.standard_uncertainty * fit.estimates["coulomb"].value
                )
            )
        unit = estimate.unit if motion.is_mechanical else _unit(name, motion)
        estimates[name] = dataclasses.replace(estimate, unit=unit).with_budget(lines)
    if fit.speed_channel is not None and not motion.instrument_is_position:
        lag, u = fit.speed_channel.lag, fit.speed_channel.lag_uncertainty
        verdict, note = ("yes", "") if np.isfinite(u) else ("no", "too little motion to tell")
        estimates["speed_lag"] = Estimate(
            name="speed_lag",
            value=lag,
            unit="s",
            low=lag - u,
            high=lag + u,
            identifiable=verdict,
            note=note,
        )
    return estimates


def _is_one_way(fit: MotionFit) -> bool:
    """Whether its motion goes in one direction alone, so that no offset is told."""
    return fit.variant != "asymmetric" and "offset" not in fit.estimates


def _zero_line(motion: RecordedMotion) -> BudgetLine:
    """What the zero of the effort leaves open of an offset."""
    source = "zero of the effort"
    if motion.zero is not None:
        return dataclasses.replace(motion.zero.budget(), source=source)
    size, assumed = zero_uncertainty(motion.recording, motion.effort)
    if assumed is not None:
        return assumed.line(source, size)
    return BudgetLine(source, "B", size, STATED)


def _unit(name: str, motion: RecordedMotion) -> str:
    """The unit of a parameter made of those of the channels."""
    effort, length = motion.effort_unit, motion.position_unit
    units = {
        "inertia": f"{effort} s2/{length}",
        "viscous": f"{effort} s/{length}",
        "stribeck": f"{length}/s",
    }
    return units.get(name.split("_")[0], effort)


def _options(motion: RecordedMotion, fit: MotionFit, choice: MotionChoice) -> dict[str, Any]:
    """The conventions of this fit."""
    return {
        "variant": fit.variant,
        "position": motion.place,
        "effort": motion.effort,
        "torque_is_of": "the whole axis",
        "instrument": fit.instrument,
        "load_orders": list(choice.load_orders),
        "lag_s": fit.basis.lag,
        "lag_is": "stated" if choice.lag is not None else "of the data",
        "filter": dataclasses.asdict(fit.recipe),
    }
