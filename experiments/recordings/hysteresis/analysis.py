"""Hysteresis: loops of output torque over torsion, from slow swings with a locked input or from presliding."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from experiments.budget import budget_table, scale_line
from experiments.contract import Evidence
from experiments.errors import AnalysisError, analysing
from experiments.evidence import (
    check_recording,
    check_settings,
    require_time_base,
    rotary_ratio,
    usable,
)
from experiments.recording import Recording
from experiments.recordings.channels import brought_forward, chosen_channel, stated_lag
from experiments.recordings.hysteresis.declaration import NAME, QUANTITIES, SETTINGS
from experiments.result import Plot, Result, Series, Table
from experiments.setting import names_of
from model.arrays import BoolArray, FloatArray
from model.identify.estimate import Estimate
from model.identify.hysteresis import NAMES, UNITS, HysteresisFit, fit_hysteresis

TORQUE = "output_torque"

TORSION = "torsion"
"""The name of an angle that is made here: theta_o - theta_i/N."""

MOST_ROWS = 4_000_000
"""Rows that are read; of more the first."""

_PROPORTIONAL = ("branch_stiffness", "secant_stiffness", "loss", "lost_motion")
"""What is proportional to the scale of the torque; lost motion inversely, by the torque that it is stated at."""


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """Stiffness, loss and lost motion from the loops of output torque over torsion.

    Settings: angle ("torsion" where both angles are there, else "output_angle" or "position", with the input locked),
    torque ("output_torque"), at_torque [N m] of the lost motion (4 % of the amplitude). Refused without a torque at
    the output: what the motor gives is not what twists the gear. Lags that the import states are taken off.
    """
    settings = evidence.settings
    check_settings(settings, names_of(SETTINGS), NAME)
    torque = _torque(recording, settings)
    checked = check_recording(
        recording, "hysteresis loops", evidence.maximum_missed_share, least_rows=40
    )
    rows = slice(0, min(recording.rows, MOST_ROWS))
    good = usable(recording, rows)
    angle_name, angle = _angle(recording, settings, rows)
    angle, moment = angle[good], _aligned(recording, torque, rows, good)
    level = float(settings["at_torque"]) if "at_torque" in settings else None
    with analysing(recording.metadata.run_id):
        fit = fit_hysteresis(angle, moment, level)
    estimates = _with_scale(fit, recording, torque)
    return Result(
        run=recording.metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates=estimates,
        metrics={
            "loops": float(len(fit.loops)),
            "amplitude": fit.amplitude,
            "torque_of_lost_motion": fit.torque,
        },
        warnings=(*checked.warnings, *_remarks(recording, fit, level)),
        plots=(_plot(fit, angle, moment),),
        tables=(_table(fit), budget_table(estimates.values())),
        options={"angle": angle_name, "torque": torque},
    )


def _torque(recording: Recording, settings: Mapping[str, Any]) -> str:
    name = str(settings.get("torque", TORQUE))
    if not recording.has(name):
        raise AnalysisError(
            "hysteresis, stiffness and lost motion need the torque at the output, which this recording does not have",
            where=recording.metadata.run_id,
            value=name,
            limit="channels " + ", ".join(sorted(recording.signals)),
            remedy="Record an output-torque sensor with the input locked (channel output_torque). The motor's torque "
            "is not the torque that twists the gear.",
        )
    if recording.signals[name].unit != "N m":
        raise AnalysisError(
            "is no torque",
            where=f"{recording.metadata.run_id}: {name}",
            value=recording.signals[name].unit,
            limit="N m",
        )
    return name


def _angle(
    recording: Recording, settings: Mapping[str, Any], rows: slice
) -> tuple[str, FloatArray]:
    """The torsion angle [rad]: of both angles where they are there, else of the one beside a locked input."""
    both = recording.has("input_angle", "output_angle")
    wanted = settings.get("angle", TORSION if both else None)
    if wanted == TORSION:
        recording.require("the torsion", "input_angle", "output_angle")
        ratio = rotary_ratio(recording, float("nan"))
        if not np.isfinite(ratio):
            raise AnalysisError(
                "torsion needs the ratio of the gear",
                where=recording.metadata.run_id,
                value="none",
                limit="input revolutions per output revolution",
                remedy="Import it with --ratio, or analyse one angle: --set angle=output_angle.",
            )
        output = _at_its_time(recording, "output_angle", rows, recording.output_angle(rows))
        turned = _at_its_time(recording, "input_angle", rows, recording.si("input_angle", rows))
        return TORSION, output - turned / ratio
    names = ("output_angle", "position", "input_angle")
    name = chosen_channel(recording, settings, "angle", names, "hysteresis loops")
    if recording.signals[name].unit != "rad":
        raise AnalysisError(
            "is no angle",
            where=f"{recording.metadata.run_id}: {name}",
            value=recording.signals[name].unit,
            limit="rad",
        )
    # The sign of the output's sense is of its following the input, which is locked here.
    return name, _at_its_time(recording, name, rows, recording.si(name, rows))


def _aligned(recording: Recording, torque: str, rows: slice, good: BoolArray) -> FloatArray:
    """The torque at the times of the angle."""
    return _at_its_time(recording, torque, rows, recording.si(torque, rows))[good]


def _at_its_time(recording: Recording, name: str, rows: slice, values: FloatArray) -> FloatArray:
    """A channel with its stated lag taken off: one that is late widens the loops or narrows them."""
    if not stated_lag(recording, name):
        return values
    require_time_base(recording, f"a stated lag of {name}")
    return brought_forward(recording, name, recording.time(rows), values)


def _with_scale(fit: HysteresisFit, recording: Recording, torque: str) -> dict[str, Estimate]:
    """The estimates with the scale of the torque in their budgets, where they are proportional to it."""
    return dict(fit.estimates) | {
        name: e.with_budget((scale_line(recording, e.value, torque),))
        for name, e in fit.estimates.items()
        if name in _PROPORTIONAL and e.budget
    }


def _remarks(recording: Recording, fit: HysteresisFit, level: float | None) -> list[str]:
    said: list[str] = []
    if level is None:
        said.append(
            f"Lost motion is stated at ±{fit.torque:.3g} N m, 4 % of the loops' amplitude; a catalogue's is at 4 % of "
            "the rated torque: --set at_torque=."
        )
    if len(fit.loops) < 2:
        said.append("There is one loop: nothing tells how well its numbers repeat.")
    if recording.rows > MOST_ROWS:
        said.append(f"The first {MOST_ROWS} of {recording.rows} rows were used.")
    return said


def _plot(fit: HysteresisFit, angle: FloatArray, torque: FloatArray) -> Plot:
    series = tuple(
        Series(
            label=f"loop {number}",
            x=np.concatenate([angle[loop.up], angle[loop.down]]),
            y=np.concatenate([torque[loop.up], torque[loop.down]]),
            style="line",
            group=number - 1,
        )
        for number, loop in enumerate(fit.loops[:6], start=1)
    )
    return Plot(
        name="hysteresis",
        title="Torque over torsion",
        x_label="torsion [rad]",
        y_label="output torque [N m]",
        series=series,
        note="Torque at the output over the torsion, loop by loop: the width is what is lost, the slope the "
        "stiffness. Good where the loops lie on each other.",
    )


def _table(fit: HysteresisFit) -> Table:
    heads = (f"{name.replace('_', ' ')} [{unit}]" for name, unit in zip(NAMES, UNITS, strict=True))
    rows = tuple((number, *loop.numbers) for number, loop in enumerate(fit.loops, start=1))
    return Table("loops", "Each loop", ("loop", *heads), rows)
