"""Figure 19 and what belongs to it, as data: output speed per step, measured and simulated;
resonance over speed; orders.
"""

from __future__ import annotations

import math

import numpy as np

from experiments.protocols.velocity_steps.data import RecordedStep
from experiments.result import Plot, Series, Table, both_ways, way_of
from model.errors import ModelError
from model.identify.dynamics import CombinedSteps, StepFit
from model.identify.sensitivity import Identifiability
from model.identify.step_data import StepScore
from model.kinematic_error import order_spectrum
from model.units import ARCSEC, RPM

SHOWN = 0.6
"""s of a step that figure 19 shows: the rise and the ring-down."""
HIGHEST_ORDER = 16.0
LEAST_REVOLUTIONS = 6.0


def fitted_step_plots(
    steps: list[RecordedStep], fits: list[StepFit], combined: CombinedSteps
) -> tuple[Plot, ...]:
    """Figure 19 per speed with the identified mode, K/J_o over speed, skills, and the orders of the deviation."""
    figures = _figure_19(steps, [f.score for f in fits], "simulated, measured input")
    return (
        *figures,
        _resonance(combined),
        _skills(steps, [f.score for f in fits]),
        *_orders(steps, fits),
    )


def scored_step_plots(
    steps: list[RecordedStep], scores: list[StepScore], name: str
) -> tuple[Plot, ...]:
    """Figure 19 per speed with a given parameter set, and its skills."""
    return (*_figure_19(steps, scores, f"{name}, measured input"), _skills(steps, scores))


def _figure_19(steps: list[RecordedStep], scores: list[StepScore], label: str) -> list[Plot]:
    """One figure per speed: the first forward step of it (reverse where there is none)."""
    chosen: dict[int, tuple[RecordedStep, StepScore]] = {}
    for step, score in zip(steps, scores, strict=True):
        key = round(abs(step.segment.setpoint) / RPM)
        other = chosen.get(key)
        if other is None or (other[0].segment.direction < 0 < step.segment.direction):
            chosen[key] = (step, score)
    plots = []
    for rpm, (_, score) in sorted(chosen.items(), key=lambda item: item[0]):
        shown = score.time <= max(SHOWN, 3.0 * 60.0 / max(rpm, 1))
        x = score.time[shown]
        series = (
            Series(
                label="measured", x=x, y=score.measured_speed[shown] / RPM, style="points", group=0
            ),
            Series(label=label, x=x, y=score.predicted_speed[shown] / RPM, style="line", group=1),
            Series(
                label="rigid gear", x=x, y=score.rigid_speed[shown] / RPM, style="line", group=2
            ),
        )
        note = f"skill on the output speed {score.metrics['skill_speed']:.2f} against a rigid gear with kinematic error"
        plots.append(
            Plot(
                name=f"velocity-step-{rpm}",
                title=f"Velocity step to {rpm} r/min at the input",
                x_label="time [s]",
                y_label="output speed [r/min]",
                series=series,
                figure="19",
                note=note,
            )
        )
    return plots


def _resonance(combined: CombinedSteps) -> Plot:
    low, high = (
        np.sqrt(np.maximum(v, 0.0)) / (2.0 * math.pi) for v in (combined.low, combined.high)
    )
    y = np.sqrt(combined.stiffness_over_inertia) / (2.0 * math.pi)
    series = both_ways(combined.speed, np.abs(combined.speed) / RPM, y, low=low, high=high)
    mean = combined.estimates["frequency"].value
    ends = np.array([np.abs(combined.speed).min(), np.abs(combined.speed).max()]) / RPM
    series.append(
        Series(label="weighted mean", x=ends, y=np.array([mean, mean]), style="line", group=2)
    )
    return Plot(
        name="step-resonance",
        title="Torsional resonance per step",
        x_label="input speed [r/min]",
        y_label="frequency [Hz]",
        series=tuple(series),
        note="a trend is the hardening of the stiffness",
    )


def _skills(steps: list[RecordedStep], scores: list[StepScore]) -> Plot:
    series = []
    x = np.array([abs(s.segment.setpoint) / RPM for s in steps])
    names = (("skill", "deviation x"), ("skill_speed", "output speed"))
    for k, (name, label) in enumerate(names):
        y = np.array([score.metrics[name] for score in scores])
        series.append(Series(label=label, x=x, y=y, style="points", group=k))
    return Plot(
        name="step-skill",
        title="Skill against a rigid gear with kinematic error",
        x_label="input speed [r/min]",
        y_label="1 - SSE/SSE of the null [1]",
        series=tuple(series),
        x_scale="log",
        note="0 is no better than a rigid gear with kinematic error, 1 is perfect",
    )


def _orders(steps: list[RecordedStep], fits: list[StepFit]) -> list[Plot]:
    """Orders of theta_o - theta_i/N - ke over the input in the second half of the fast forward steps."""
    series = []
    for step, fit in zip(steps, fits, strict=True):
        if step.segment.direction < 0 or step.segment.repeat:
            continue
        half = len(step.data.time) // 2
        angle, value = step.data.input_angle[half:], fit.score.measured_deviation[half:]
        if abs(angle[-1] - angle[0]) < LEAST_REVOLUTIONS * 2.0 * math.pi:
            continue
        try:
            spectrum = order_spectrum(angle, value, HIGHEST_ORDER)
        except ModelError:
            continue
        label = f"{abs(step.segment.setpoint) / RPM:.0f} r/min"
        series.append(
            Series(
                label=label,
                x=spectrum.orders[1:],
                y=spectrum.amplitude[1:] / ARCSEC,
                style="line",
                group=len(series),
            )
        )
    if not series:
        return []
    return [
        Plot(
            name="step-orders",
            title="Orders of the deviation at speed",
            x_label="order per input revolution",
            y_label="amplitude [arcsec]",
            series=tuple(series),
            y_scale="log",
        )
    ]


_SCORE_COLUMNS = ("skill", "skill_rigid", "skill_speed", "skill_speed_rigid", "mse_speed")


def step_table(steps: list[RecordedStep], fits: list[StepFit]) -> Table:
    """Every step: what it identifies and how it scores."""
    rows: list[tuple[float | int | str, ...]] = []
    for step, fit in zip(steps, fits, strict=True):
        ratio, damping = fit.estimates["stiffness_over_inertia"], fit.estimates["damping_ratio"]
        rows.append(
            (
                *_which(step),
                "yes" if fit.resolvable else "not resolvable",
                ratio.value,
                0.5 * (ratio.high - ratio.low),
                fit.estimates["frequency"].value,
                damping.value,
                0.5 * (damping.high - damping.low),
                *_scores(fit.metrics),
                fit.metrics["rms"] / ARCSEC,
                fit.metrics["transient_counts"],
            )
        )
    columns = (
        "speed [r/min]",
        "direction",
        "repeat",
        "resolvable",
        "K/J_o [1/s2]",
        "half width",
        "frequency [Hz]",
        "damping ratio",
        "half width of it",
        *_SCORE_HEADS,
        "rms of x [arcsec]",
        "transient [counts]",
    )
    return Table("steps", "Every step", columns, tuple(rows))


def score_table(steps: list[RecordedStep], scores: list[StepScore]) -> Table:
    """Every step scored with a given parameter set."""
    rows = tuple(
        (*_which(step), *_scores(score.metrics), score.metrics["rms"] / ARCSEC)
        for step, score in zip(steps, scores, strict=True)
    )
    columns = ("speed [r/min]", "direction", "repeat", *_SCORE_HEADS, "rms of x [arcsec]")
    return Table("steps", "Every step, nothing fitted", columns, rows)


def identifiability_table(identifiability: Identifiability) -> Table:
    """What the fastest step could tell of equation 2 at best: its directions, from best to worst determined."""
    rows = tuple(
        (k + 1, d.sentence(), d.relative_deviation)
        for k, d in enumerate(identifiability.directions)
    )
    columns = ("direction", "combination of relative changes", "relative standard deviation")
    return Table(
        "identifiability",
        "What the data can tell of the parameters of equation 2",
        columns,
        rows,
        identifiability.sentence(),
    )


_SCORE_HEADS = (
    "skill x",
    "skill x, rigid",
    "skill speed",
    "skill speed, rigid",
    "MSE speed (22)",
    "overshoot",
    "overshoot simulated",
    "ripple",
    "ripple simulated",
)


def _which(step: RecordedStep) -> tuple[float, str, int]:
    segment = step.segment
    return abs(segment.setpoint) / RPM, way_of(segment.direction), segment.repeat


def _scores(metrics: dict[str, float]) -> tuple[float, ...]:
    shape = ("overshoot_measured", "overshoot_predicted", "ripple_measured", "ripple_predicted")
    return tuple(metrics[name] for name in (*_SCORE_COLUMNS, *shape))
