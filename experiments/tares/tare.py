"""The motor's own friction over speed, from the result of a motor-tare run, so that the torque of
the gear alone is left.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass

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
_DOUBTS = "tare-doubts"
"""The table by which a tare carries what is not known of it as a whole."""
_DOUBT_COLUMNS = ("contribution", "speed [r/min]", "standard uncertainty [N m]", "remark")


@dataclass(frozen=True)
class TareDoubt:
    """An error of a whole tare: its name in budgets, its standard uncertainty [N m] at speeds [rad/s], its source."""

    source: str
    speed: FloatArray
    uncertainty: FloatArray
    note: str

    def at(self, speed: FloatArray) -> FloatArray:
        """What it does at other speeds [rad/s]; beyond its own as at the nearest."""
        return np.interp(speed, self.speed, self.uncertainty)


def with_doubts(result: Result, doubts: Iterable[TareDoubt]) -> Result:
    """A tare that carries what is not known of it."""
    rows = tuple(
        (one.source, float(speed) / RPM, float(u), one.note)
        for one in doubts
        for speed, u in zip(one.speed, one.uncertainty, strict=True)
    )
    if not rows:
        return result
    table = Table(_DOUBTS, "What is not known of the tare as a whole", _DOUBT_COLUMNS, rows)
    return dataclasses.replace(result, tables=(*result.tables, table))


def doubts_of(result: Result | None) -> tuple[TareDoubt, ...]:
    """What a tare carries of its own doubts."""
    if result is None:
        return ()
    rows = [row for table in result.tables if table.name == _DOUBTS for row in table.rows]
    doubts: list[TareDoubt] = []
    for source in dict.fromkeys(str(row[0]) for row in rows):
        own = [row for row in rows if row[0] == source]
        speed, u = np.array([[float(row[1]) * RPM, float(row[2])] for row in own]).T
        doubts.append(TareDoubt(source, speed, u, str(own[0][3])))
    return tuple(doubts)


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
    tare = tare_of(result)
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


def tare_of(result: Result) -> Tare | None:
    """The points of a tare by speed; None where it holds less than two, or one that is no number."""
    table = next((t for t in result.tables if t.name == TABLE), None)
    if table is None or len(table.rows) < 2:
        return None
    rows = np.array([[float(v) for v in row] for row in table.rows])
    rows = rows[np.argsort(rows[:, 0])]
    if not np.isfinite(rows).all():
        return None
    return Tare(rows[:, 0] * RPM, rows[:, 1], rows[:, 2])
