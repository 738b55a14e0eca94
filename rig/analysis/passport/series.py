"""Series of a quantity: comparable runs in order of time, what the alarm says of them, and what is to
be said of each point.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from model.gear_file import gear_from_mapping
from model.identify.estimate import Estimate
from rig.analysis.alarm.promise import Watching
from rig.analysis.alarm.watching import WatchedSeries
from rig.analysis.number_or_none import known
from rig.analysis.passport.content import (
    Alarm,
    CatalogueLimit,
    PassportPoint,
    PassportSeries,
    State,
    Wear,
)
from rig.analysis.passport.draw import history_plot, sums_plot
from rig.analysis.passport.followed import FollowedQuantity, comparable
from rig.analysis.passport.gather import AnalysedRun
from rig.analysis.passport.watch import Group, alarm_of, changes_between, days_words, wear_of
from rig.content.phrase import phrase
from rig.gears.acceptance import Acceptance
from rig.runfile.header import ORIGIN_WORDS

_TEMPERATURE_THAT_MATTERS = 1.0
"""K between a run's housing and that of the first runs from which on it is told: friction falls
some percent per kelvin.
"""


_STATED = ("catalogue", "measured", "identified", "published")
"""Provenances that somebody can be asked for."""


@dataclass(frozen=True)
class _Told:
    """What is to be said of a series beside its points."""

    alarm: Alarm | None
    wear: Wear | None
    limit: CatalogueLimit | None


def groups_of(quantity: FollowedQuantity, analysed: Sequence[AnalysedRun]) -> list[Group]:
    """The sets of comparable runs of a quantity; what parts them is in their titles."""
    groups: dict[tuple[str, tuple[tuple[str, str], ...]], list[AnalysedRun]] = {}
    for one in analysed:
        if one.analysis.kind == quantity.kind and usable(one.estimates.get(quantity.key)):
            groups.setdefault(
                (one.origin, tuple(comparable(one.facts, quantity.quantity).items())), []
            ).append(one)
    everywhere = (
        set.intersection(*(set(conditions) for _, conditions in groups)) if groups else set()
    )
    several = len({origin for origin, _ in groups}) > 1
    found = []
    for (origin, conditions), members in groups.items():
        apart = [text for name, text in conditions if (name, text) not in everywhere]
        if several:
            apart.append(ORIGIN_WORDS.get(origin, "") or "hardware")
        title = quantity.title + phrase(" ({})", ", ".join(apart))
        found.append(Group(quantity, origin, dict(conditions), title, tuple(members)))
    return found


def usable(estimate: Estimate | None) -> bool:
    """Whether a number may be followed: it is there, and the data could tell it."""
    return estimate is not None and not math.isnan(estimate.value) and estimate.identifiable != "no"


def series_of(
    group: Group,
    series: WatchedSeries | None,
    watching: Watching,
    acceptance: Acceptance | None,
) -> PassportSeries:
    """One series of a passport; `series` None for one that is drawn without alarm."""
    quantity, members = group.quantity, group.members
    baseline = watching.promise.baseline
    temperature = _mean([one.housing_temperature for one in members[:baseline]])
    points = tuple(
        _point(group, index, series, baseline, temperature) for index in range(len(members))
    )
    limit = _catalogue_limit(quantity, members[-1])
    factor, shown = group.shown
    alarm = wear = None
    if series is not None:
        alarm = alarm_of(group, series, watching)
        wear = wear_of(group, series, _judging_limit(quantity, acceptance, limit))
    axis = f"{quantity.axis} [{shown}]".removesuffix(" []")
    mark = ORIGIN_WORDS.get(group.origin, "")
    name = f"passport-{quantity.key}"
    plot = history_plot(
        axis, points, alarm, limit, factor=factor, name=name, title=group.title, mark=mark
    )
    threshold = sums = None
    if series is not None and len(points) > baseline:
        threshold = series.threshold
        sums = sums_plot(points, threshold, name=f"{name}-sums", title=group.title, mark=mark)
    return PassportSeries(
        key=" | ".join((group.origin, quantity.key, *group.conditions.values())),
        quantity=quantity.key,
        title=group.title,
        definition=quantity.quantity.definition,
        kind=quantity.kind,
        unit=group.unit,
        factor=factor,
        display_unit=shown,
        origin=members[0].origin,
        conditions=group.conditions,
        points=points,
        plot=plot,
        sums=sums,
        state=_state(series, alarm, len(points), baseline),
        threshold=threshold,
        alarm=alarm,
        wear=wear,
        limit=limit,
        notes=tuple(_notes(points, series, _Told(alarm, wear, limit), baseline)),
    )


def _state(series: WatchedSeries | None, alarm: Alarm | None, count: int, baseline: int) -> State:
    if series is None:
        return "not watched"
    if alarm is not None:
        return "changed"
    return "no change seen" if count > baseline else "learning"


def _mean(values: Sequence[float | None]) -> float | None:
    numbers = [value for value in values if value is not None]
    return sum(numbers) / len(numbers) if numbers else None


def _point(
    group: Group,
    index: int,
    series: WatchedSeries | None,
    baseline: int,
    temperature: float | None,
) -> PassportPoint:
    members = group.members
    one = members[index]
    estimate = one.estimates[group.quantity.key]
    remarks = changes_between(members[max(index - 1, 0)], one)
    if temperature is not None and one.housing_temperature is not None:
        warmer = one.housing_temperature - temperature
        if abs(warmer) > _TEMPERATURE_THAT_MATTERS:
            remarks.append(
                f"housing {abs(warmer):.1f} K {'warmer' if warmer > 0 else 'colder'} than in the first runs"
            )
    if estimate.identifiable == "weakly":
        remarks.append(f"weakly identifiable: {estimate.note or 'wide interval'}")
    point = PassportPoint(
        position=index + 1,
        run=one.run.run_id,
        number=one.run.number,
        path=one.run.path,
        start=one.run.start,
        value=estimate.value,
        low=estimate.low,
        high=estimate.high,
        expanded_uncertainty=estimate.expanded_uncertainty,
        identifiability=estimate.identifiable,
        analysis=f"{one.analysis.path.parent.name}/{one.analysis.path.name}",
        housing_temperature=one.housing_temperature,
        remarks=tuple(remarks),
    )
    if series is None:
        return point
    return _with_watch(point, series, index, is_summed=index >= baseline)


def _with_watch(
    point: PassportPoint, series: WatchedSeries, index: int, *, is_summed: bool
) -> PassportPoint:
    """A point with what the watch says of it; the sums begin after the baseline."""
    change = series.change
    if is_summed:
        sums = series.sums
        point = replace(
            point,
            upper_sum=float(sums.upper[0, index]),
            lower_sum=float(sums.lower[0, index]),
        )
    return replace(
        point,
        expected=known(series.expected[index]),
        is_alarm=change is not None and index == change.run,
        is_changed=change is not None and index >= change.since,
    )


def _catalogue_limit(quantity: FollowedQuantity, newest: AnalysedRun) -> CatalogueLimit | None:
    """What the catalogue of the newest run's gear states of this quantity; it is shown, and judges nothing."""
    counterpart, stored = quantity.quantity.catalogue, newest.analysis.content.get("gear")
    if counterpart is None or not stored:
        return None
    gear = gear_from_mapping(stored, str(newest.analysis.path))
    stated = gear.value(f"ratings.{counterpart.rating}")
    return CatalogueLimit(stated.value, stated.origin.source, stated.origin.provenance)


def _judging_limit(
    quantity: FollowedQuantity, acceptance: Acceptance | None, catalogue: CatalogueLimit | None
) -> float | None:
    """The upper limit that a quantity of a gear is held against: of its acceptance file, else of its catalogue."""
    if acceptance is not None:
        name = f"{quantity.kind}.{quantity.key}"
        for line in acceptance.limits:
            if line.quantity == name and line.upper is not None:
                return line.upper
    return catalogue and catalogue.value


def _notes(
    points: Sequence[PassportPoint],
    series: WatchedSeries | None,
    told: _Told,
    baseline: int,
) -> Iterator[str]:
    if told.alarm is not None:
        yield f"{told.alarm.sentence}. {told.alarm.decides}"
        if told.alarm.within_uncertainty:
            yield "The change is no larger than U of one run."
    if series is not None and len(points) <= baseline:
        yield f"Nothing is told yet: {len(points)} of {baseline} runs have taught what is usual."
    elif series is not None:
        yield _days_note(series)
        for at, what in series.noted.begins.items():
            yield f"A new level begins with run {points[at].run}: {what}."
    if told.wear is not None:
        yield told.wear.sentence
    limit = told.limit
    if limit is not None and limit.provenance not in _STATED:
        yield f"The catalogue's value is {limit.provenance}, not verified: {limit.source}."


def _days_note(series: WatchedSeries) -> str:
    words = days_words(series.days)
    return f"Held against a threshold of {series.threshold:.2f}: {words}."
