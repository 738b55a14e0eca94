"""What a gear that is kept to be measured again says of the bench: its runs beside the first five.

    d = x - mean(x_1 ... x_5),     U_d = max(k sqrt(u^2 + u_1^2/5), t s sqrt(1 + 1/5))

with u what a run does not share with the others (`causes`), s the scatter of the first five and t Student's at 99 %.
What all its runs share, such as the scale of a torque channel or the curve of an encoder, cancels in the difference
until it changes: then the bench has changed, or the gear.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import numpy as np

from model.identify.estimate import NORMAL_COVERAGE_FACTOR
from model.identify.least_squares import student_quantile
from rig.analysis.causes import common_grounds, own_uncertainty
from rig.analysis.number_or_none import known
from rig.analysis.passport.build import followed_groups
from rig.analysis.passport.gather import gather, moment, runs_of
from rig.analysis.passport.watch import Group, alarmed, changes_between
from rig.errors import RigError

FIRST = 5
"""Runs that say how the bench was."""
LEVEL = 0.99
"""Of each single check: several quantities are looked at every time."""
CheckState = Literal["changed", "no change seen", "learning"]


@dataclass(frozen=True, kw_only=True)
class _CheckedRun:
    """One run beside the first ones: its difference and U of that (NaN while the first are gathered), in SI."""

    run: str
    start: str
    difference: float
    expanded_uncertainty: float
    changes: tuple[str, ...]

    @property
    def is_apart(self) -> bool:
        """Whether the difference is more than what the run does not share explains."""
        return abs(self.difference) > self.expanded_uncertainty

    @property
    def uncertainty_where_judged(self) -> float | None:
        """U, or None while the first are gathered."""
        return known(self.expanded_uncertainty)


@dataclass(frozen=True, kw_only=True)
class CheckedQuantity:
    """One quantity of the gear: the mean of its first runs and all runs beside it; SI = factor x shown number."""

    title: str
    unit: str
    factor: float
    shown_unit: str
    mean: float
    runs: tuple[_CheckedRun, ...]

    @property
    def newest(self) -> _CheckedRun:
        """The run that was made last."""
        return self.runs[-1]

    @property
    def state(self) -> CheckState:
        """What the newest run says."""
        if len(self.runs) <= FIRST:
            return "learning"
        return "changed" if self.newest.is_apart else "no change seen"

    @property
    def sentence(self) -> str:
        """The same in words, with the command that tells bench from gear where it changed."""
        if self.state == "learning":
            return f"{len(self.runs)} of {FIRST} first runs are there"
        newest = self.newest
        size, u = newest.difference / self.factor, newest.expanded_uncertainty / self.factor
        words = f"{size:+.3g} ± {u:.2g} {self.shown_unit}".rstrip()
        return f"{words} from the first {FIRST}: {self.state}"


@dataclass(frozen=True)
class Golden:
    """What the golden gear says of its bench, and how old its newest run is [days]."""

    serial: str
    origin: str
    quantities: tuple[CheckedQuantity, ...]
    newest: str
    age_days: float

    @property
    def is_changed(self) -> bool:
        """Whether any of its quantities has changed."""
        return any(one.state == "changed" for one in self.quantities)

    def as_json(self) -> dict[str, Any]:
        """As `rig bench check --json` tells it."""
        return {
            "gear": self.serial,
            "newest": self.newest,
            "age_days": self.age_days,
            "changed": self.is_changed,
            "quantities": [
                {
                    "title": one.title,
                    "unit": one.unit,
                    "state": one.state,
                    "mean_of_first": one.mean,
                    "runs": [
                        {
                            "run": run.run,
                            "start": run.start,
                            "difference": run.difference,
                            "expanded_uncertainty": run.uncertainty_where_judged,
                            "changes": list(run.changes),
                        }
                        for run in one.runs
                    ],
                }
                for one in self.quantities
            ],
        }


def golden_check(where: str | Path | Sequence[Path], serial: str, now: datetime) -> Golden:
    """The golden gear's runs beside its first ones. Raises `RigError` where it has no analysed run there."""
    gathered = gather(runs_of(where, serial))
    groups = alarmed(followed_groups(gathered.analysed))
    if not groups:
        raise RigError(
            "has no analysed run of a watched quantity",
            where=f"golden gear {serial or '(none is named)'}",
            remedy="Measure it: rig run friction --gear SERIAL; its serial stands in rig.toml, [alarms] golden_gear.",
        )
    newest = max((one.members[-1].run for one in groups), key=lambda run: moment(run.start))
    age = (now - moment(newest.start).astimezone(UTC)).total_seconds() / 86400.0
    return Golden(serial, newest.origin, tuple(map(_checked, groups)), newest.run_id, age)


def _checked(group: Group) -> CheckedQuantity:
    values = group.values
    factor, shown = group.shown
    return CheckedQuantity(
        title=group.title,
        unit=group.unit,
        factor=factor,
        shown_unit=shown,
        mean=float(np.mean(values[:FIRST])),
        runs=tuple(_runs(group, values)),
    )


def _runs(group: Group, values: Sequence[float]) -> Iterator[_CheckedRun]:
    first = np.array(values[:FIRST])
    freedom = len(first) - 1.0
    scatter = float(first.std(ddof=1)) if len(first) == FIRST else math.nan
    expected = student_quantile(freedom, LEVEL) * scatter * math.sqrt(1.0 + 1.0 / FIRST)
    wider = student_quantile(math.inf, LEVEL) / NORMAL_COVERAGE_FACTOR
    before = group.members[0]
    for place, member in enumerate(group.members):
        common = common_grounds(group.members[0].grounds, member.grounds)
        own, its = (
            own_uncertainty(one.estimates[group.quantity.key], common)
            for one in (member, group.members[0])
        )
        stated = wider * math.hypot(own, its / math.sqrt(FIRST))
        yield _CheckedRun(
            run=member.run.run_id,
            start=member.run.start,
            difference=values[place] - float(first.mean()),
            expanded_uncertainty=max(expected, stated) if place >= FIRST else math.nan,
            changes=tuple(changes_between(before, member)),
        )
        before = member
