"""Which series of a gear are watched together, and what each says in words: its alarm, and what hours do to it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rig.analysis.alarm.promise import MOST_QUANTITIES, Promise, Watching
from rig.analysis.alarm.threshold import Days
from rig.analysis.alarm.watching import (
    BOUNDING_RUNS,
    Change,
    WatchedSeries,
    correlation_of,
    days_of,
    scored,
    watch,
)
from rig.analysis.alarm.wear import trend
from rig.analysis.causes import common_grounds, own_uncertainty
from rig.analysis.passport.content import Alarm, Wear
from rig.analysis.passport.followed import FollowedQuantity
from rig.analysis.passport.gather import AnalysedRun, moment
from rig.content.phrase import phrase, quoted
from rig.content.wording import decimals_of, fixed, laboratory_unit, number

_ABOUT = 1
"""Runs before and after a change is told to have begun, in which what else changed is looked for."""


@dataclass(frozen=True)
class Group:
    """Comparable runs of one quantity, in order of time."""

    quantity: FollowedQuantity
    origin: str
    conditions: Mapping[str, str]
    title: str
    members: tuple[AnalysedRun, ...]

    @property
    def values(self) -> list[float]:
        """The values of its runs, SI."""
        return [one.estimates[self.quantity.key].value for one in self.members]

    @property
    def unit(self) -> str:
        """The SI unit of its values."""
        return self.members[0].estimates[self.quantity.key].unit

    @property
    def shown(self) -> tuple[float, str]:
        """SI = factor x shown number, and the unit in which a laboratory reads it."""
        size = max(abs(value) for value in self.values)
        return laboratory_unit(self.unit, size, self.quantity.quantity.shown)


def alarmed(groups: Sequence[Group]) -> list[Group]:
    """The series whose change is told: of quantities that give an alarm those with the newest runs, three at most."""
    giving = [one for one in groups if one.quantity.quantity.gives_alarm(one.quantity.key)]
    newest = sorted(giving, key=lambda one: moment(one.members[-1].run.start), reverse=True)
    chosen = newest[:MOST_QUANTITIES]
    return [one for one in groups if any(one is other for other in chosen)]


def days_between(groups: Sequence[Group], golden: Sequence[Group], promise: Promise) -> Days:
    """Whether the runs of a gear, or those of the golden gear, show that days are independent."""
    for several in (groups, golden):
        scores = [
            scored(one.values, [run.noted for run in one.members], promise.baseline)
            for one in several
        ]
        if days_of(scores) == "independent":
            return "independent"
    return "alike"


def watched(group: Group, promise: Promise, quantities: int, days: Days) -> WatchedSeries:
    """One of so many series that are watched together."""
    return watch(group.values, [run.noted for run in group.members], promise, quantities, days)


def alarm_of(group: Group, series: WatchedSeries, watching: Watching) -> Alarm | None:
    """The change of a watched series, in words; None where there is none."""
    change = series.change
    if change is None:
        return None
    members, quantity = group.members, group.quantity
    since, told = members[change.since], members[change.run]
    beside = _beside(members, change)
    newest = members[-1]
    own = own_uncertainty(
        newest.estimates[quantity.key], common_grounds(members[0].grounds, newest.grounds)
    )
    decides, command = _decides(group, watching, newest)
    return Alarm(
        quantity=quantity.key,
        title=group.title,
        direction=change.direction,
        since=since.run.run_id,
        run=told.run.run_id,
        runs_until_told=change.run - change.since + 1,
        size=change.size.value,
        size_low=change.size.low,
        size_high=change.size.high,
        scatter=change.scatter,
        per_run=_per_run(change),
        unit=group.unit,
        beside=beside,
        within_uncertainty=abs(change.size.value) <= own,
        sentence=_sentence(group, change, since, beside),
        decides=decides,
        command=command,
    )


def _per_run(change: Change) -> tuple[float, float, float]:
    one = change.per_run
    return (one.value / change.scatter, one.low / change.scatter, one.high / change.scatter)


def _beside(members: Sequence[AnalysedRun], change: Change) -> tuple[str, ...]:
    """What was noted to change about the run since which a quantity has changed, each with its run."""
    first, last = max(change.since - _ABOUT, 1), min(change.since + _ABOUT, len(members) - 1)
    return tuple(
        f"{text} ({members[at].run.run_id})"
        for at in range(first, last + 1)
        for text in changes_between(members[at - 1], members[at])
    )


def changes_between(before: AnalysedRun, after: AnalysedRun) -> list[str]:
    """What is no longer as it was in the run before."""
    changes = []
    for name, now in after.changing.items():
        then = before.changing.get(name, "")
        if then == now:
            continue
        # An instrument's identity is long: that it changed is what matters, and `rig diff` shows how.
        short = max(len(then), len(now)) <= 40
        changes.append(
            f"{name}: {then or 'unknown'} → {now or 'unknown'}" if short else f"{name} changed"
        )
    return changes


def _sentence(group: Group, change: Change, since: AnalysedRun, beside: Sequence[str]) -> str:
    factor, unit = group.shown
    size = change.size
    reach = 0.5 * (size.high - size.low) / factor
    decimals = decimals_of(reach)
    value = abs(size.value) / factor
    if decimals is not None:
        text = f"{fixed(value, decimals)} ± {fixed(reach, decimals)}"
    else:
        text = number(value)
    spread = number(abs(size.value) / change.scatter, 2)
    words = (
        f"{group.title} is {change.direction} by {text} {unit}".rstrip()
        + f" since run {since.run.run_id} ({spread} times the scatter of one run)"
    )
    return words + phrase("; beside it changed: {}", "; ".join(beside))


def _decides(group: Group, watching: Watching, newest: AnalysedRun) -> tuple[str, str]:
    """One run that tells whether gear or bench has changed, and its command."""
    golden = watching.golden_gear
    kind, bench = group.quantity.kind, newest.run.bench
    where = f"bench {bench}" if bench else "the same bench"
    if golden and golden != newest.run.gear_serial:
        return (
            f"One run of the golden gear {golden} on {where} decides: if it has changed as well, the bench has.",
            f"rig run {kind} --gear {quoted(golden)}",
        )
    if golden:
        return (
            f"This is the golden gear: {where} has changed, unless another gear shows that it has not.",
            f"rig run {kind} --gear SERIAL",
        )
    return (
        f"One run of another gear that was measured on {where} before decides: if it has changed as well, the bench "
        "has.",
        f"rig run {kind} --gear SERIAL",
    )


def wear_of(group: Group, series: WatchedSeries, limit: float | None) -> Wear | None:
    """What hours do to a watched series whose gear has its hours on the card; None where they tell nothing."""
    hours = np.array([one.hours for one in group.members])
    correlation = correlation_of(series.days)
    found = trend(np.asarray(group.values), series.noted.regressors, hours, limit, correlation)
    if found is None:
        return None
    factor, unit = group.shown
    slope = found.slope
    scaled = (1e3 * slope.value, 1e3 * slope.low, 1e3 * slope.high)
    to_limit = found.to_limit
    value, low, high = (number(one / factor, 2) for one in scaled)
    words = f"With the hours: {value} {unit} per 1000 h (95 %: {low} to {high})".replace("  ", " ")
    if to_limit is not None and limit is not None:
        end = "without end" if math.isinf(to_limit.high) else f"{number(to_limit.high, 2)} h"
        words += (
            f"; a straight line meets {number(limit / factor)} {unit} after another {number(to_limit.value, 2)} h "
            f"({number(to_limit.low, 2)} h to {end}). No remaining life is promised by that"
        )
    return Wear(
        per_1000_hours=scaled,
        hours_to_limit=to_limit and (to_limit.value, to_limit.low, to_limit.high),
        sentence=words + ".",
    )


def days_words(days: Days) -> str:
    """What thresholds take days to be, and why."""
    if days == "independent":
        return f"{BOUNDING_RUNS} runs or more show that days are independent of each other"
    return f"days are taken to be alike (correlation up to 0.3) until {BOUNDING_RUNS} runs show otherwise"
