"""Torque scale: what the torque shows of the inertia on the bare shaft, and how late it shows it.

One run has one inertia. What two of them say together of the gain is learnt of the bench (`rig bench learn`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from experiments.budget import PAIR, budget_table
from experiments.contract import Evidence
from experiments.errors import AnalysisError, analysing
from experiments.evidence import (
    check_settings,
    quality_remarks,
    require_bare_motor,
    time_base_remark,
    usable,
)
from experiments.protocols.torque_scale.declaration import NAME, QUANTITIES, Parameters
from experiments.protocols.torque_scale.disc import disc_of
from experiments.recording import Recording
from experiments.result import Plot, Result, Series, Table, residual_panel
from experiments.torque.zero import TorqueZero, torque_zero
from model.identify.estimate import BudgetLine, Estimate
from model.identify.least_squares import LinearFit, student_quantile
from model.identify.ramp_inertia import (
    RampMean,
    lag_of,
    mean_of_ramp,
    shown_inertia,
    whole_turns,
)

EDGE = 0.12
"""s at either end of a ramp that are left out: the port lags, the corner is rounded."""
LEVELS = "levels"
"""The table of what the ramps of each acceleration show, by channel: what a bench learns its scale from."""
SAMPLING = "sampling"
"""The line of a time that is known to a cycle."""
LEAST_PAIRS = 4
"""Of each acceleration: ramps up and down, twice each way."""


@dataclass(frozen=True)
class _Rows:
    """One ramp between two constant speeds: the rows of all three, and its own among them."""

    rows: slice
    ramp: slice
    direction: int
    level: float
    turns: int


@dataclass(frozen=True)
class _Ramp:
    """The same with its means."""

    at: _Rows
    mean: RampMean


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """Inertia that the torque shows, by its ramps up and down; lag of the torque behind the acceleration."""
    check_settings(evidence.settings, (), NAME)
    recording.require("torque scale", "input_angle", "torque")
    metadata = recording.metadata
    require_bare_motor(recording, NAME, "its inertia and friction are not those of a disc")
    warnings = quality_remarks(recording, NAME, evidence)
    warnings += time_base_remark(recording)
    zero = torque_zero(recording)
    warnings += zero.warnings
    channels = tuple(name for name in PAIR if recording.has(name))
    ramps = list(_ramps(recording, zero, channels))
    pairs = _pairs(ramps)
    levels = sorted({ramp.at.level for ramp in ramps})
    _require_pairs(metadata.run_id, pairs, levels)
    disc = disc_of(metadata.parameters)
    with analysing(metadata.run_id):
        every = [pair for level in levels for pair in pairs[level]]
        fits = {name: shown_inertia(every, k) for k, name in enumerate(channels)}
        by_level = {
            name: [float(shown_inertia(pairs[one], k).values[0]) for one in levels]
            for k, name in enumerate(channels)
        }
        # The steepest tell a delay best: on a long ramp a little friction passes for one.
        steepest = [ramp.at for ramp in ramps if ramp.at.level == levels[-1]]
        lags = {name: _lag(recording, name, steepest) for name in channels}
    shown = _shown_inertia(fits["torque"])
    estimates = {shown.name: shown}
    if math.isfinite(lags["torque"][0]):
        estimates["torque_lag"] = _lag_estimate(*lags["torque"], 1.0 / metadata.sample_rate)
    metrics = {
        "disc_inertia": disc.inertia,
        "ramps": float(len(ramps)),
        "torque_zero_drift": zero.drift,
        **_housing(recording),
    }
    return Result(
        run=metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates=estimates,
        metrics=metrics,
        warnings=tuple(warnings),
        plots=(_plot(every, fits["torque"]),),
        tables=(
            _level_table(levels, channels, fits, by_level, lags),
            budget_table(estimates.values()),
        ),
        options={"torque_is_of": "motor"},
    )


def _require_pairs(
    run: str, pairs: dict[float, list[tuple[RampMean, RampMean]]], levels: list[float]
) -> None:
    """Raise `AnalysisError` where an acceleration has fewer pairs of ramps than it needs, or there is none."""
    if not levels or any(len(pairs.get(level, ())) < LEAST_PAIRS for level in levels):
        raise AnalysisError(
            "too few pairs of ramps with a whole revolution between their ends",
            where=run,
            value=", ".join(f"{len(pairs.get(one, ()))} at {one:g} rad/s2" for one in levels)
            or "none",
            limit=f">= {LEAST_PAIRS} of each acceleration",
            remedy="Run it with a wider range of speeds (--highest-rpm), gentler ramps, or more repeats.",
        )


def _ramps(recording: Recording, zero: TorqueZero, channels: tuple[str, ...]) -> Iterator[_Ramp]:
    """The ramps that hold a whole revolution, with their means: as many revolutions of all of one acceleration."""
    found = [one for one in _rows(recording) if one.turns]
    turns: dict[float, int] = {}
    for one in found:
        turns[one.level] = min(turns.get(one.level, one.turns), one.turns)
    for one in found:
        rows = slice(one.rows.start + one.ramp.start, one.rows.start + one.ramp.stop)
        time = recording.time(rows)
        torques = [
            recording.si(name, rows) - (zero.at(time) if name == "torque" else 0.0)
            for name in channels
        ]
        angle = recording.si("input_angle", rows)
        yield _Ramp(one, mean_of_ramp(time, angle, torques, EDGE, turns[one.level]))


def _rows(recording: Recording) -> Iterator[_Rows]:
    """The ramps between two constant speeds of one direction."""
    wanted = recording.metadata.parameters.get("accelerations") or Parameters().accelerations
    segments = recording.segments
    for before, segment, after in zip(segments, segments[1:], segments[2:], strict=False):
        is_between = before.label == after.label == "settle" and segment.label == "ramp"
        rows = slice(before.start, after.stop)
        if not is_between or not usable(recording, rows).all():
            continue
        ramp = slice(segment.start, segment.stop)
        time = recording.time(ramp)
        pace = abs(segment.setpoint - before.setpoint) / float(time[-1] - time[0])
        yield _Rows(
            rows=rows,
            ramp=slice(ramp.start - rows.start, ramp.stop - rows.start),
            direction=segment.direction,
            level=float(min(wanted, key=lambda one: abs(pace - one))),
            turns=whole_turns(time, recording.si("input_angle", ramp), EDGE),
        )


def _pairs(ramps: Sequence[_Ramp]) -> dict[float, list[tuple[RampMean, RampMean]]]:
    """Ramps of opposite sense that follow each other, each in one pair, by their level of acceleration."""
    pairs: dict[float, list[tuple[RampMean, RampMean]]] = {}
    waiting: _Ramp | None = None
    for ramp in ramps:
        is_pair = (
            waiting is not None
            and (ramp.at.level, ramp.at.direction) == (waiting.at.level, waiting.at.direction)
            and ramp.mean.acceleration * waiting.mean.acceleration < 0.0
        )
        if waiting is None or not is_pair:
            waiting = ramp
            continue
        pairs.setdefault(ramp.at.level, []).append((waiting.mean, ramp.mean))
        waiting = None
    return pairs


def _shown_inertia(fit: LinearFit) -> Estimate:
    low, high = fit.interval(0)
    scatter = BudgetLine(
        "scatter of the ramps", "A", float(fit.standard_error[0]), degrees_of_freedom=fit.freedom
    )
    return Estimate(
        name="shown_inertia",
        value=float(fit.values[0]),
        unit="kg m2",
        low=low,
        high=high,
        budget=(scatter,),
    )


def _lag(recording: Recording, channel: str, ramps: Sequence[_Rows]) -> tuple[float, float, int]:
    """Mean lag of a channel [s], its standard error, and by how many ramps."""
    found: list[float] = []
    for ramp in ramps:
        time, angle = recording.time(ramp.rows), recording.si("input_angle", ramp.rows)
        found.append(lag_of(time, angle, recording.si(channel, ramp.rows), ramp.ramp))
    known = np.array([one for one in found if math.isfinite(one)])
    if len(known) < 2:
        return math.nan, math.nan, len(known)
    error = float(known.std(ddof=1)) / math.sqrt(len(known))
    return float(known.mean()), error, len(known)


def _lag_estimate(lag: float, error: float, ramps: int, period: float) -> Estimate:
    half = student_quantile(ramps - 1) * error
    scatter = BudgetLine("scatter of the ramps", "A", error, degrees_of_freedom=ramps - 1.0)
    return Estimate(
        name="torque_lag",
        value=lag,
        unit="s",
        low=lag - half,
        high=lag + half,
        budget=(scatter, BudgetLine(SAMPLING, "B", period / math.sqrt(12.0), "known to a cycle")),
    )


def _housing(recording: Recording) -> dict[str, float]:
    """Mean temperature of the housing [degC], where it was recorded."""
    if not recording.has("housing_temperature"):
        return {}
    mean = float(recording.si("housing_temperature", slice(0, recording.rows)).mean())
    return {"housing_temperature": mean} if math.isfinite(mean) else {}


def _level_table(
    levels: list[float],
    channels: tuple[str, ...],
    fits: dict[str, LinearFit],
    by_level: dict[str, list[float]],
    lags: dict[str, tuple[float, float, int]],
) -> Table:
    """What each channel shows, at all accelerations (0) and at each, as a bench learns from it."""
    rows: list[tuple[float | int | str, ...]] = []
    for name in channels:
        fit, (lag, error, _) = fits[name], lags[name]
        rows.append(
            (name, 0.0, float(fit.values[0]), float(fit.standard_error[0]), fit.freedom, lag, error)
        )
        for level, shown in zip(levels, by_level[name], strict=True):
            rows.append((name, level, shown, math.nan, math.nan, math.nan, math.nan))
    columns = (
        "channel",
        "acceleration [rad/s2]",
        "shown inertia [kg m2]",
        "standard error [kg m2]",
        "degrees of freedom",
        "lag [s]",
        "standard error of the lag [s]",
    )
    return Table(LEVELS, "What the ramps show", columns, tuple(rows), "0 rad/s2: all of them.")


def _plot(pairs: Sequence[tuple[RampMean, RampMean]], fit: LinearFit) -> Plot:
    change = np.array([a.acceleration - b.acceleration for a, b in pairs])
    torque = np.array([a.torques[0] - b.torques[0] for a, b in pairs])
    ends = np.array([change.min(), change.max()])
    return Plot(
        name="ramps",
        title="Torque of a ramp up less that of the ramp down",
        x_label="acceleration up less down [rad/s2]",
        y_label="torque [mN m]",
        series=(
            Series(label="pairs of ramps", x=change, y=torque * 1e3, style="points"),
            Series(label="shown inertia", x=ends, y=fit.values[0] * ends * 1e3, group=1),
            Series(
                label="",
                x=change,
                y=(torque - fit.values[0] * change) * 1e3,
                style="points",
                panel=1,
            ),
        ),
        note="Each pair of ramps as a point: friction and gravity cancel, the slope is the inertia that the torque "
        "shows. Good where the points below scatter about zero.",
        panels=(residual_panel("mN m"),),
    )
