"""Series of a quantity: comparable runs in order of time, their control limits, and what is to be
said of each point.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from model.gear_file import gear_from_mapping
from model.identify.estimate import Estimate
from rig.analysis.causes import common_grounds, own_uncertainty
from rig.analysis.passport.chart import control_limits, signals_of
from rig.analysis.passport.content import (
    CatalogueLimit,
    ControlLimits,
    PassportPoint,
    PassportSeries,
)
from rig.analysis.passport.draw import control_plot
from rig.analysis.passport.followed import FollowedQuantity, comparable
from rig.analysis.passport.gather import AnalysedRun
from rig.content.wording import laboratory_unit
from rig.runfile.header import ORIGIN_WORDS

_TEMPERATURE_THAT_MATTERS = 1.0
"""K between a run's housing and that of the first runs from which on it is told: friction falls
some percent per kelvin.
"""


def series_of(
    quantity: FollowedQuantity, analysed: Sequence[AnalysedRun], baseline: int
) -> list[PassportSeries]:
    """One series per set of comparable runs; what parts them is in their titles."""
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
    series = []
    for (origin, conditions), members in groups.items():
        apart = [text for name, text in conditions if (name, text) not in everywhere]
        apart += [ORIGIN_WORDS.get(origin, "") or "hardware"] if several else []
        title = quantity.title + (f" ({', '.join(apart)})" if apart else "")
        series.append(_one_series(quantity, title, dict(conditions), members, baseline))
    return series


def usable(estimate: Estimate | None) -> bool:
    """Whether a number may be followed: it is there, and the data could tell it."""
    return estimate is not None and not math.isnan(estimate.value) and estimate.identifiable != "no"


def _one_series(
    quantity: FollowedQuantity,
    title: str,
    conditions: Mapping[str, str],
    members: Sequence[AnalysedRun],
    baseline: int,
) -> PassportSeries:
    values = [one.estimates[quantity.key].value for one in members]
    control = control_limits(values, [one.run.run_id for one in members], baseline)
    signals = signals_of(values, control) if control is not None else ((),) * len(values)
    temperature = _mean([one.housing_temperature for one in members[:baseline]])
    points = tuple(
        _point(quantity.key, index, members, signals[index], control, temperature)
        for index in range(len(members))
    )
    limit = _catalogue_limit(quantity, members[-1])
    origin = members[0].origin
    unit = members[0].estimates[quantity.key].unit
    size = max(abs(value) for value in values)
    factor, shown = laboratory_unit(unit, size, quantity.quantity.shown)
    notes = _notes(points, control, limit, (factor, shown), baseline)
    return PassportSeries(
        key=" | ".join((origin, quantity.key, *conditions.values())),
        quantity=quantity.key,
        title=title,
        definition=quantity.quantity.definition,
        kind=quantity.kind,
        unit=unit,
        factor=factor,
        display_unit=shown,
        origin=origin,
        conditions=conditions,
        points=points,
        plot=control_plot(
            f"{quantity.axis} [{shown}]".removesuffix(" []"),
            points,
            control,
            limit,
            factor=factor,
            name=f"passport-{quantity.key}",
            title=title,
            mark=ORIGIN_WORDS.get(origin, ""),
        ),
        control=control,
        limit=limit,
        notes=notes,
    )


def _mean(values: Sequence[float | None]) -> float | None:
    numbers = [value for value in values if value is not None]
    return sum(numbers) / len(numbers) if numbers else None


def _point(
    key: str,
    index: int,
    members: Sequence[AnalysedRun],
    signals: tuple[str, ...],
    control: ControlLimits | None,
    temperature: float | None,
) -> PassportPoint:
    one = members[index]
    estimate = one.estimates[key]
    value = estimate.value
    remarks = list(_changes(members[index - 1], one)) if index else []
    if temperature is not None and one.housing_temperature is not None:
        warmer = one.housing_temperature - temperature
        if abs(warmer) > _TEMPERATURE_THAT_MATTERS:
            remarks.append(
                f"housing {abs(warmer):.1f} K {'warmer' if warmer > 0 else 'colder'} than in the first runs"
            )
    if estimate.identifiable == "weakly":
        remarks.append(f"weakly identifiable: {estimate.note or 'wide interval'}")
    within = None
    if control is not None:
        own = own_uncertainty(estimate, common_grounds(members[0].grounds, one.grounds))
        within = abs(value - control.centre) <= own
    return PassportPoint(
        position=index + 1,
        run=one.run.run_id,
        number=one.run.number,
        path=one.run.path,
        start=one.run.start,
        value=value,
        low=estimate.low,
        high=estimate.high,
        expanded_uncertainty=estimate.expanded_uncertainty,
        identifiability=estimate.identifiable,
        analysis=f"{one.analysis.path.parent.name}/{one.analysis.path.name}",
        signals=signals,
        within_uncertainty=within,
        housing_temperature=one.housing_temperature,
        remarks=tuple(remarks),
    )


def _changes(before: AnalysedRun, after: AnalysedRun) -> list[str]:
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


def _catalogue_limit(quantity: FollowedQuantity, newest: AnalysedRun) -> CatalogueLimit | None:
    """What the catalogue of the newest run's gear states of this quantity; it is shown, and judges nothing."""
    counterpart, stored = quantity.quantity.catalogue, newest.analysis.content.get("gear")
    if counterpart is None or not stored:
        return None
    gear = gear_from_mapping(stored, str(newest.analysis.path))
    stated = gear.value(f"ratings.{counterpart.rating}")
    return CatalogueLimit(stated.value, stated.origin.source, stated.origin.provenance)


def _notes(
    points: Sequence[PassportPoint],
    control: ControlLimits | None,
    limit: CatalogueLimit | None,
    shown: tuple[float, str],
    baseline: int,
) -> tuple[str, ...]:
    notes = []
    if control is None:
        same = len(points) >= baseline
        notes.append(
            "No control limits: the first runs do not differ at all."
            if same
            else f"No control limits yet: {len(points)} of {baseline} runs."
        )
    else:
        notes += _control_notes(points, control, *shown)
    if limit is not None and limit.provenance not in (
        "catalogue",
        "measured",
        "identified",
        "published",
    ):
        notes.append(f"The catalogue's value is {limit.provenance}, not verified: {limit.source}.")
    return tuple(notes)


def _control_notes(
    points: Sequence[PassportPoint], control: ControlLimits, factor: float, unit: str
) -> list[str]:
    share = f"{100.0 * control.false_alarms:.1f} %"
    notes = [
        f"Limits from the first {len(control.runs)} runs; of an unchanged gear {share} of "
        "later runs fall outside them too, "
        "because so few runs know their own scatter poorly."
    ]
    early = [str(p.position) for p in points[: len(control.runs)] if "1" in p.signals]
    if early:
        notes.append(
            f"Among the runs that made the limits, {', '.join(early)} lies outside: find the cause, then start anew."
        )
    expanded = sorted(
        p.expanded_uncertainty for p in points if math.isfinite(p.expanded_uncertainty)
    )
    if expanded:
        middle = expanded[len(expanded) // 2] / factor
        reach = 3.0 * control.sigma / factor
        notes.append(
            f"Control limits lie {reach:.3g} {unit} from the centre; U of one run is {middle:.3g} "
            f"{unit}, most of it common to all runs where that is larger."
            if middle > reach
            else f"Control limits lie {reach:.3g} {unit} from the centre; "
            f"U of one run is {middle:.3g} "
            f"{unit}."
        )
    return notes
