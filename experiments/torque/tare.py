"""The motor's own friction over speed, from the result of a motor-tare run, so that the torque of
the gear alone is left.
"""

from __future__ import annotations

import numpy as np

from experiments.result import Result, Table
from model.arrays import FloatArray
from model.identify.running_torque import Tare
from model.units import RPM

KIND = "motor-tare"
TABLE = "motor-friction"
COLUMNS = ("speed [r/min]", "friction [N m]", "standard error [N m]")
"""Columns of the table that carries a tare from its result to those who subtract it."""
REACH = 1.25
"""A tare may be used up to this factor beyond its slowest and its fastest speed."""
FEWEST = 6
"""Speeds that a Stribeck curve needs."""


def tare_table(tare: Tare) -> Table:
    """The table that carries a tare: half-difference of the directions at each speed."""
    rows = tuple(
        (float(s) / RPM, float(t), float(u))
        for s, t, u in zip(tare.speed, tare.torque, tare.standard_error, strict=True)
    )
    note = "half-difference of the directions; standard errors without the torque scale"
    return Table(TABLE, "Friction of the bare motor", COLUMNS, rows, note)


def read_tare(result: Result | None, speeds: FloatArray) -> tuple[Tare | None, list[str]]:
    """The tare for a run at these input speeds (magnitudes) [rad/s], or None and the reason why there is none.

    Valid is a tare from a motor-tare run with at least two speeds that covers the slowest and at least `FEWEST` speeds
    of the run. What is faster than the tare is not said to be the gear's (`Tare.reaches`): words name it.
    """
    if result is None:
        return None, []
    if result.kind != KIND:
        return None, [_unused(result, f"it is the result of {result.kind}, not of {KIND}")]
    tare = _tare(result)
    if tare is None:
        return None, [_unused(result, "it holds less than two speeds")]
    reached = tare.reaches(speeds, REACH)
    levels = len(np.unique(np.round(np.log(speeds[reached]), 1)))
    span = f"{tare.speed[0] / RPM:.3g} to {tare.speed[-1] / RPM:.4g} r/min"
    if tare.speed[0] / REACH > speeds.min() or (not reached.all() and levels < FEWEST):
        run = f"{speeds.min() / RPM:.3g} to {speeds.max() / RPM:.4g} r/min"
        return None, [_unused(result, f"it covers {span}, the run {run}")]
    if reached.all():
        return tare, []
    beyond = f"{int((~reached).sum())} holds at up to {speeds.max() / RPM:.4g} r/min"
    return tare, [
        f"The motor tare {result.run} covers {span}: {beyond} were left out. Repeat the tare for them."
    ]


def _unused(result: Result, problem: str) -> str:
    return f"The motor tare {result.run} was not used: {problem}."


def _tare(result: Result) -> Tare | None:
    table = next((t for t in result.tables if t.name == TABLE), None)
    if table is None or len(table.rows) < 2:
        return None
    rows = np.array([[float(v) for v in row] for row in table.rows])
    rows = rows[np.argsort(rows[:, 0])]
    if not np.isfinite(rows).all():
        return None
    return Tare(rows[:, 0] * RPM, rows[:, 1], rows[:, 2])
