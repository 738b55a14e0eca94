"""Figure 19 and what belongs to it, as data: output speed per step, measured and simulated;
resonance over speed; orders.

Figure 19 is simulated from the command: a customer asks a gear for a speed, and sees what comes out.
What drive and motor make of the command stands in its residual, beside what the measured input leaves.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from experiments.protocols.velocity_steps.data import RISE, RecordedStep, commanded_step
from experiments.result import Plot, Series, Table, residual_panel, way_of
from model.arrays import FloatArray
from model.errors import ModelError
from model.identify.dynamics import LadderFit
from model.identify.sensitivity import Identifiability
from model.identify.step_data import StepScore, score_step
from model.kinematic_error import order_spectrum
from model.units import ARCSEC, RPM

SHOWN = 0.3
"""s of a step that figure 19 shows: the rise and the ring-down."""
_AT_THE_END = 0.1
"""s before the end of what is fitted of a step in which a slope has no room on both sides."""
HIGHEST_ORDER = 16.0
LEAST_REVOLUTIONS = 6.0


_Simulation = Callable[[RecordedStep], FloatArray]
"""Output angle (n,) [rad] of a model at the stamps of a step, for the input that the step has."""


def fitted_step_plots(
    steps: list[RecordedStep], scores: list[StepScore], ladder: LadderFit, paper: _Simulation
) -> tuple[Plot, ...]:
    """Figure 19 per speed with the chosen rung beside the paper's model, what each rung leaves, and skills."""
    return (
        *_figure_19(steps, scores, lambda step: ladder.answer(step.data), "simulated", paper),
        _rungs(steps, ladder),
        _skills(steps, scores),
        *_orders(steps, scores),
    )


def scored_step_plots(
    steps: list[RecordedStep], scores: list[StepScore], simulation: _Simulation, name: str
) -> tuple[Plot, ...]:
    """Figure 19 per speed with a given parameter set, and its skills."""
    return (*_figure_19(steps, scores, simulation, name), _skills(steps, scores))


def _figure_19(
    steps: list[RecordedStep],
    scores: list[StepScore],
    simulation: _Simulation,
    label: str,
    paper: _Simulation | None = None,
) -> list[Plot]:
    """One figure per speed: the first forward step of it (reverse where there is none).

    `scores` are those with the measured input, of which only the residual is shown.
    """
    chosen: dict[int, int] = {}
    for place, step in enumerate(steps):
        key = round(abs(step.segment.setpoint) / RPM)
        other = chosen.get(key)
        if other is None or (steps[other].segment.direction < 0 < step.segment.direction):
            chosen[key] = place
    figures = [
        _step_figure(rpm, steps[place], scores[place], simulation, label, paper)
        for rpm, place in sorted(chosen.items())
    ]
    heights = [
        steps[place].segment.setpoint / steps[place].data.ratio / RPM
        for _, place in sorted(chosen.items())
    ]
    return [_all_speeds(sorted(chosen), figures, heights), *figures] if figures else []


def _all_speeds(speeds: list[int], figures: list[Plot], heights: list[float]) -> Plot:
    """All steps in one picture, each over its own height, and what is left of each by the command."""
    series: list[Series] = []
    for place, (rpm, figure, height) in enumerate(zip(speeds, figures, heights, strict=True)):
        by_label = {one.label: one for one in figure.of_panel(0)}
        measured = by_label["measured"]
        left = figure.of_panel(1)[-1]
        soon = measured.x <= SHOWN
        x, y = measured.x[soon], measured.y[soon] / height
        series.append(Series(label=f"{rpm} r/min", x=x, y=y, group=place))
        series.append(Series(label="", x=x, y=left.y[soon] / height, group=place, panel=1))
    return Plot(
        name="velocity-steps",
        title="Velocity steps at all speeds, each over its own height",
        x_label="time [s]",
        y_label="output speed / (command / N)",
        series=tuple(series),
        figure="19",
        note="Each step over its own height: 1 is a rigid gear that follows at once. Good where what is left below, "
        "measured less simulated from the command, is small beside the swing above it.",
        panels=(residual_panel("1"),),
    )


def _step_figure(
    rpm: int,
    step: RecordedStep,
    score: StepScore,
    simulation: _Simulation,
    label: str,
    paper: _Simulation | None,
) -> Plot:
    """Figure 19 of one step: measured, and simulated from the commanded input."""
    asked = commanded_step(step)
    end = float(score.time[-1]) - _AT_THE_END
    shown = score.time <= min(max(SHOWN, 3.0 * 60.0 / max(rpm, 1)), end)

    def speed_of(simulated: FloatArray) -> FloatArray:
        return score_step(asked.data, simulated).predicted_speed[shown] / RPM

    x = score.time[shown]
    measured, simulated = score.measured_speed[shown] / RPM, speed_of(simulation(asked))
    with_measured_input = measured - score.predicted_speed[shown] / RPM
    behind = [_rigid(step, x)]
    if paper is not None:
        unfitted = speed_of(paper(asked))
        behind.append(Series(label="equation 2, unfitted", x=x, y=unfitted, role="null"))
    return Plot(
        name=f"velocity-step-{rpm}",
        title=f"Velocity step to {rpm} r/min at the input",
        x_label="time [s]",
        y_label="output speed [r/min]",
        series=(
            *behind,
            Series(label="measured", x=x, y=measured, style="points", group=0),
            Series(label=f"{label} from command", x=x, y=simulated, group=1),
            Series(
                label="residual, measured input", x=x, y=with_measured_input, role="null", panel=1
            ),
            Series(label="", x=x, y=measured - simulated, group=1, panel=1),
        ),
        figure="19",
        note=f"The output after a step of the command, measured and simulated. Input: the commanded speed, risen "
        f"over {1e3 * RISE:g} ms; what drive and motor make of it is left. "
        f"With the measured input the skill against a rigid gear is {score.metrics['skill_speed']:.2f}; 1 is perfect.",
        panels=(residual_panel("r/min"),),
    )


def _rigid(step: RecordedStep, time: FloatArray) -> Series:
    """A rigid gear: the commanded input speed over the ratio, nothing before the step, the whole of it at once."""
    height = step.segment.setpoint / step.data.ratio / RPM
    return Series(
        label="rigid: command / N",
        x=np.array([min(float(time[0]), 0.0), 0.0, 0.0, float(time[-1])]),
        y=np.array([0.0, 0.0, height, height]),
        role="null",
    )


def _rungs(steps: list[RecordedStep], ladder: LadderFit) -> Plot:
    """What each rung leaves of the output angle, over speed; steps that the fit has not seen."""
    speeds, rows = _by_speed(steps, ladder)
    series = tuple(
        Series(label=rung.name, x=speeds, y=rows[:, k], style="points", group=k)
        for k, rung in enumerate(ladder.rungs)
    )
    return Plot(
        name="step-ladder",
        title="What each model leaves of the output angle",
        x_label="input speed [r/min]",
        y_label="root mean square [arcsec]",
        series=series,
        x_scale="log",
        y_scale="log",
        note="What each model leaves of steps that it was not fitted to: the lower the better. Chosen, because no "
        f"simpler one predicts as well: {ladder.chosen}.",
    )


def _by_speed(steps: list[RecordedStep], ladder: LadderFit) -> tuple[FloatArray, FloatArray]:
    """Speeds [r/min] and, per speed, what each rung leaves of the left-out steps [arcsec]."""
    speed = np.array([round(abs(s.segment.setpoint) / RPM) for s in steps])
    speeds = np.unique(speed)
    rows = np.array(
        [
            [float(np.sqrt(np.mean(r.left_out[speed == v] ** 2))) / ARCSEC for r in ladder.rungs]
            for v in speeds
        ]
    )
    return speeds.astype(np.float64), rows


def ladder_table(steps: list[RecordedStep], ladder: LadderFit) -> Table:
    """Per speed what each rung leaves of the output angle, on steps that the fit has not seen."""
    speeds, values = _by_speed(steps, ladder)
    rows: list[tuple[float | int | str, ...]] = [
        (float(v), *(float(x) for x in row)) for v, row in zip(speeds, values, strict=True)
    ]
    rows.append(("all", *(rung.prediction / ARCSEC for rung in ladder.rungs)))
    columns = ("speed [r/min]", *(f"{rung.name} [arcsec]" for rung in ladder.rungs))
    note = (
        f"Root mean square of the output angle that each model leaves; chosen: {ladder.chosen}. Rigid and paper "
        "(equation 2 with the set's values) have nothing fitted; the others are shown on steps left out of their fit. "
        "In the last row a step that no model explains counts by its weight only."
    )
    return Table("ladder", "What each model gains over the one before", columns, tuple(rows), note)


def _skills(steps: list[RecordedStep], scores: list[StepScore]) -> Plot:
    series: list[Series] = []
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
        note="How much of each step the model explains: 0 is no better than a rigid gear with kinematic error, 1 is "
        "perfect. Low points are steps in which the gear hardly winds, or a model that misses something.",
    )


def _orders(steps: list[RecordedStep], scores: list[StepScore]) -> list[Plot]:
    """Orders of theta_o - theta_i/N - ke over the input in the second half of the fast forward steps."""
    series: list[Series] = []
    for step, score in zip(steps, scores, strict=True):
        if step.segment.direction < 0 or step.segment.repeat:
            continue
        half = len(step.data.time) // 2
        angle, value = step.data.input_angle[half:], score.measured_deviation[half:]
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
            note="Orders of what a rigid gear would not show, in the second half of each step. Good where only the "
            "orders of the kinematic error stand out; one that grows with speed runs towards a resonance.",
        )
    ]


_SCORE_COLUMNS = ("skill", "skill_rigid", "skill_speed", "skill_speed_rigid", "mse_speed")


def step_table(steps: list[RecordedStep], scores: list[StepScore], ladder: LadderFit) -> Table:
    """Every step: whether the gear winds by a count in it, how it scores, and how much it counts in the fit."""
    rows: list[tuple[float | int | str, ...]] = []
    for step, score, transient, weight in zip(
        steps, scores, ladder.transient, ladder.weights, strict=True
    ):
        counts = float(transient) / step.data.output_quantum
        rows.append(
            (
                *_which(step),
                "yes" if counts > 1.0 else "not resolvable",
                counts,
                float(weight),
                *_scores(score.metrics),
                score.metrics["rms"] / ARCSEC,
            )
        )
    columns = (
        "speed [r/min]",
        "direction",
        "repeat",
        "resolvable",
        "transient [counts]",
        "weight",
        *_SCORE_HEADS,
        "rms of x [arcsec]",
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
