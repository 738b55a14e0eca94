"""A passport in rows: what every chart says of the newest run, and what is missing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rig.analysis.passport.content import Missing, PassportSeries
from rig.content.grid import Grid, columns
from rig.content.wording import decimals_of, fixed, number


def series_grid(series: Sequence[PassportSeries]) -> Grid:
    """Every chart in the unit of the laboratory: the newest value, what was expected of it, and whether it changed."""
    heads = columns(
        ("quantity", "quantity"),
        ("newest ± U (95 %)", "number"),
        ("unit", "unit"),
        ("state", "word"),
        ("expected", "number"),
        "since",
        ("catalogue limit", "number"),
        ("runs", "number"),
        "conditions",
        "remarks",
    )
    return Grid("What the charts say", heads, [_series_row(one) for one in series])


def _series_row(series: PassportSeries) -> tuple[str, ...]:
    newest, limit, factor = series.points[-1], series.limit, series.factor
    expected = "–" if newest.expected is None else number(newest.expected / factor)
    return (
        series.title,
        newest_pair(series),
        series.display_unit,
        series.state,
        expected,
        series.alarm.since if series.alarm is not None else "–",
        f"{number(limit.value / factor)} ({limit.provenance})" if limit else "–",
        str(len(series.points)),
        conditions_text(series.conditions),
        "; ".join((*newest.remarks, *series.notes)),
    )


def conditions_text(conditions: Mapping[str, str]) -> str:
    """What all runs of a series have in common, in a line; a value that begins with its name says it once."""
    return ", ".join(
        value if value.startswith(name) else f"{name} {value}" for name, value in conditions.items()
    )


def newest_pair(series: PassportSeries) -> str:
    """The newest value ± U in the unit of the series, rounded by U."""
    newest = series.points[-1]
    value, doubt = newest.value / series.factor, newest.expanded_uncertainty / series.factor
    decimals = decimals_of(doubt)
    if decimals is None:
        return number(value)
    return f"{fixed(value, decimals)} ± {fixed(doubt, decimals)}"


def missing_grid(missing: Sequence[Missing]) -> Grid:
    """What a whole passport would have besides, of which run, and what to do about it."""
    rows = [(one.what, one.run, one.remedy) for one in missing]
    return Grid("What is missing", columns("what", "run", "what to do"), rows)
