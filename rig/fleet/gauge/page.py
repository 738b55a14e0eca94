"""The study of a gauge as tables, figures and one page."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from experiments.result import Plot, Series
from rig.analysis.number_or_none import finite
from rig.content.grid import Grid, capital, columns, number_columns
from rig.content.page import Page, Section, Signature, State, annexes_of
from rig.content.phrase import phrase
from rig.content.wording import number
from rig.errors import ConfigurationError
from rig.fleet.gauge.components import GAUGE, TERMS, Gauge, Interval, Term
from rig.fleet.gauge.plan import ASSUMED_SHARES, Design, factor_of_few
from rig.fleet.gauge.study import TERM_WORDS, Studies, Study, studies_of, words_of
from rig.present.page import write_page
from rig.present.report import drawn, marks_of, page_facts, program_version, shown

GOOD, USABLE = 10.0, 30.0
"""%GRR up to which AIAG calls a gauge good, and one that may do."""
_SUMS: dict[str, tuple[Term, ...]] = {
    "EV, repeatability": ("repeat",),
    "AV, reproducibility of benches": ("bench", "interaction"),
    "mounting": ("mounting",),
    "GRR, the gauge": GAUGE,
    "PV, gears": ("gear",),
    "TV, all": TERMS,
}
_AVERAGES = ((1, 1), (1, 2), (1, 3), (2, 1), (2, 2), (3, 1), (3, 2))
"""Mountings, and repeats in each, of which the mean is looked at."""
_DEFINITIONS = (
    (
        "EV, AV, PV",
        "Standard deviations: of repeats without touching the gear; of benches with what gear and bench have together; "
        "of the gears themselves.",
    ),
    (
        "GRR, %GRR",
        "GRR: of the whole measurement, mounting included. %GRR of study: GRR over the deviation of all values; of "
        "tolerance: 6 GRR over both limits' distance, 3 GRR over that of mean and limit where there is one. Up to 10 % "
        "is good, up to 30 % may do (AIAG, Measurement Systems Analysis, 4th edition).",
    ),
    (
        "ndc",
        "Groups of gears that are told apart, 1.41 PV/GRR cut to a whole number; five are asked for.",
    ),
)


def percent(value: float) -> str:
    """A percentage in words; a dash where there is none."""
    return number(value, 3) if math.isfinite(value) else "–"


def _with_range(value: float, interval: Interval) -> str:
    """A percentage with its 95 % interval."""
    return f"{percent(value)} ({percent(interval[0])} … {percent(interval[1])})"


def summary(studies: Sequence[Study]) -> Grid:
    """One line for each quantity: how good the gauge is for it."""
    rows = [_summary_row(one) for one in studies]
    heads = columns(
        ("quantity", "quantity"),
        ("%GRR (95 %)", "number"),
        ("of tolerance", "number"),
        ("ndc", "number"),
        ("two benches", "number"),
        ("one bench", "number"),
        ("GRR", "number"),
        ("PV", "number"),
    )
    grid = Grid(
        "How well gears are told apart",
        heads,
        rows,
        "Two benches, one bench: two gears, measured once there, that differ by more are different (95 %).",
    )
    if any(math.isfinite(s.percent_of_tolerance) for s in studies):
        return grid
    return grid.without("of tolerance")


def _summary_row(one: Study) -> tuple[str, ...]:
    factor, unit = one.shown_in
    gauge, (_, benches) = one.gauge, one.values.counted

    def told(value: float, digits: int = 2) -> str:
        return f"{number(value / factor, digits)} {unit}".rstrip()

    return (
        one.title,
        _with_range(gauge.percent_of_study, gauge.interval_of_percent),
        percent(one.percent_of_tolerance),
        str(gauge.distinct),
        told(gauge.apart()) if benches > 1 else "–",
        told(gauge.apart(one_bench=True)),
        told(gauge.deviation(*GAUGE), 3),
        told(gauge.deviation("gear"), 3),
    )


def components_grid(one: Study) -> Grid:
    """Every part of the variation with its interval, and its share of the variance."""
    factor, unit = one.shown_in
    whole = one.gauge.deviation(*TERMS) or math.nan
    rows = []
    for title, terms in _SUMS.items():
        if not any(term in one.gauge.variances for term in terms):
            continue
        deviation = one.gauge.deviation(*terms)
        low, high = one.gauge.interval_of_deviation(*terms)
        interval = f"{number(low / factor, 3)} … {number(high / factor, 3)}"
        share = percent(100.0 * (deviation / whole) ** 2)
        rows.append((title, number(deviation / factor, 4), interval, share))
    where = phrase(" [{}]", unit)
    heads = columns(
        ("part", "name"),
        (f"standard deviation{where}", "number"),
        ("95 %", "number"),
        ("% of variance", "number"),
    )
    return Grid("Parts of the variation", heads, rows, _way(one.gauge, one.unpooled))


def _way(gauge: Gauge, unpooled: Gauge | None) -> str:
    """How the parts were found, and what to know of it."""
    if gauge.method == "reml":
        words = [
            "By restricted maximum likelihood: the study has gaps. Its intervals are approximate."
        ]
    else:
        words = ["By analysis of variance."]
    if unpooled is not None:
        told = percent(unpooled.percent_of_study)
        words.append(
            "Gear and bench together say nothing (p above 0.25) and went into the line below; "
            f"kept apart, %GRR is {told}."
        )
    if gauge.negative:
        named = ", ".join(TERM_WORDS[term] for term in gauge.negative)
        words.append(f"Set to zero, because nothing of it is seen: {named}.")
    return " ".join(words)


def _anova_grid(one: Study) -> Grid | None:
    """The analysis of variance; None where there was none."""
    if not one.gauge.rows:
        return None
    rows = [
        (
            TERM_WORDS[row.term].partition(",")[0],
            str(row.freedom),
            f"{row.squares:.5g}",
            f"{row.mean_square:.5g}",
            number(row.f, 4),
            number(row.p, 2),
        )
        for row in one.gauge.rows
    ]
    heads = (
        *columns(("term", "name")),
        *number_columns("degrees of freedom", "sum of squares", "mean square", "F", "p"),
    )
    return Grid("Analysis of variance (SI)", heads, rows)


def _averages_grid(one: Study) -> Grid | None:
    """What the mean of several mountings and repeats would give; None where nothing tells them apart."""
    if not {"mounting", "repeat"} & set(one.gauge.variances):
        return None
    rows = [
        (str(m), str(r), percent(one.gauge.averaged(m, r)))
        for m, r in _AVERAGES
        if m == 1 or "mounting" in one.gauge.variances
    ]
    heads = number_columns("mountings", "repeats in each", "%GRR of their mean")
    return Grid("What averaging would give", heads, rows)


def _values_plot(one: Study) -> Plot:
    """Every value by gear, the gears in the order of their means, each bench in its colour."""
    factor, unit = one.shown_in
    gears: dict[str, list[float]] = {}
    for gear, value in zip(one.values.gear, one.values.value, strict=True):
        gears.setdefault(gear, []).append(value)
    place = {gear: at for at, gear in enumerate(sorted(gears, key=lambda g: np.mean(gears[g])), 1)}
    series = []
    benches = sorted(set(one.values.bench))
    for group, bench in enumerate(benches):
        rows = [at for at, name in enumerate(one.values.bench) if name == bench]
        # Side by side: several benches of one gear do not lie on each other.
        beside = 0.5 * (group - 0.5 * (len(benches) - 1)) / max(len(benches), 1)
        x = np.array([place[one.values.gear[at]] + beside for at in rows])
        y = np.array([one.values.value[at] for at in rows]) / factor
        label = f"bench {bench or 'not stated'}"
        series.append(Series(label=label, x=x, y=y, style="points", group=group))
    order = ", ".join(f"{at} {gear}" for gear, at in place.items()) if len(place) <= 12 else ""
    return Plot(
        name=f"{one.kind}.{one.name}.gauge",
        title=f"{capital(one.title)}: every value, the gears in the order of their means",
        x_label="gear",
        y_label=f"{one.title}{phrase(' [{}]', unit)}",
        series=tuple(series),
        note="What lies apart at one gear is the gauge; how the groups rise is the gears. " + order,
    )


def _gauge_page(found: Studies, created: str) -> Page:
    """The report of a study; `created` is its calendar time (ISO 8601)."""
    sections = (
        *_sections(found),
        *_lacking(found.lacking),
        Section(title="Definitions", anchor="definitions", terms=_DEFINITIONS),
    )
    gears = sorted({gear for one in found.studies for gear in one.values.gear})
    benches = sorted({bench for one in found.studies for bench in one.values.bench})
    best = min(found.studies, key=lambda one: one.gauge.percent_of_study)
    good = sum(one.gauge.percent_of_study <= USABLE for one in found.studies)
    sentence = (
        f"{good} of {len(found.studies)} quantities have a %GRR of {USABLE:.0f} or less; the best is "
        f"{best.title} with {percent(best.gauge.percent_of_study)} %."
    )
    return Page(
        number=_number(found),
        heading=f"Gauge repeatability and reproducibility: {len(gears)} gears on {len(benches)} benches",
        created=created,
        version=program_version(),
        subtitle="What of the numbers is the gear, and what bench, mounting and repeat",
        facts=page_facts(["several"], f"{len(gears)} gears", [], "see the runs"),
        marks=marks_of([found.origin]),
        states=(State(f"{good} of {len(found.studies)}", sentence),),
        judged=shown(summary(found.studies)),
        sections=sections,
        annexes=annexes_of(sections, "values", [_values_grid(one) for one in found.studies]),
        signature=Signature(False, "A study of the gauge is signed by whom it was ordered."),
        run_line=f"{len(gears)} gears, {len(benches)} benches",
        made_from=f"the numbers in the annex, from {found.source.name}",
    )


def gauge_sections(folder: Path, origin: str) -> Iterator[Section]:
    """What the report of a lot says of the gauge: nothing where its runs are no study of it."""
    try:
        found = studies_of(folder, origin=origin)
    except ConfigurationError:
        return
    yield Section(
        title="The gauge: how well gears are told apart",
        anchor="gauge",
        subtitle="; ".join(sorted({one.shape for one in found.studies})),
        text="Over all whole runs, not the newest alone. rig fleet rr shows every part with its interval.",
        grids=shown(summary(found.studies)),
        terms=_DEFINITIONS,
    )


def write_gauge_page(found: Studies, path: Path, created: str) -> Path:
    """Write the report of a study as HTML or, by its suffix, as PDF. Raises `RigError` where it cannot be written."""
    return write_page(_gauge_page(found, created), path)


def _sections(found: Studies) -> Iterator[Section]:
    for place, one in enumerate(found.studies, 1):
        yield Section(
            title=f"{capital(one.title)} ({one.kind})",
            anchor=f"part-{place}",
            subtitle=one.shape,
            text=" ".join(words_of(one)),
            figures=(drawn(_values_plot(one), found.origin, place),),
            grids=shown(components_grid(one), _averages_grid(one), _anova_grid(one)),
        )


def _lacking(lacking: Iterable[tuple[str, str]]) -> Iterator[Section]:
    rows = [(title, why) for title, why in lacking]
    if rows:
        grid = Grid("What could not be studied", columns(("quantity", "quantity"), "why"), rows)
        yield Section(title=grid.title, anchor="part-0", grids=(grid,))


def _values_grid(one: Study) -> Grid:
    factor, unit = one.shown_in
    of = one.values
    rows = [
        (gear, bench or "–", mounting or "–", number(value / factor, 6))
        for gear, bench, mounting, value in zip(
            of.gear, of.bench, of.mounting, of.value, strict=True
        )
    ]
    value = f"value{phrase(' [{}]', unit)}"
    heads = columns("gear", "bench", "mounting", (value, "number"))
    return Grid(f"Values: {one.title}", heads, rows)


def _number(found: Studies) -> str:
    """A number that follows from what is told: the same values give the same one."""
    digest = hashlib.sha256()
    for one in found.studies:
        digest.update(f"{one.kind}|{one.name}|{list(one.values.value)!r}".encode())
    return "HG-" + digest.hexdigest()[:10].upper()


def designs_grid(proposed: Sequence[Design], title: str, *, is_assumed: bool) -> Grid:
    """Proposed studies, and what few benches mean."""
    rows = [
        (
            *map(str, (one.gears, one.benches, one.mountings, one.repeats, one.runs)),
            f"{percent(one.interval[0])} … {percent(one.interval[1])}",
            " … ".join(number(factor, 2) for factor in factor_of_few(one.benches)),
        )
        for one in proposed
    ]
    heads = number_columns(
        *("gears", "benches", "mountings", "repeats", "runs"),
        "%GRR to be expected (95 %)",
        "spread of benches, times",
    )
    shares = ", ".join(
        f"{TERM_WORDS[t].partition(',')[0]} {s:.0%}" for t, s in ASSUMED_SHARES.items()
    )
    note = (
        "Half of all studies come out wider. Spread of benches: between which multiples of its estimate it lies; "
        "more gears or repeats do not make it narrower, more benches do."
    )
    if is_assumed:
        note += f" Assumed of the gauge's variance, because no study was named: {shares}."
    return Grid(title, heads, rows, note)


def study_as_json(one: Study) -> dict[str, object]:
    """One study as `rig fleet rr --json` tells it, SI."""
    gauge = one.gauge
    sums = {title.partition(",")[0]: terms for title, terms in _SUMS.items()}
    tolerance = one.percent_of_tolerance
    return {
        "kind": one.kind,
        "quantity": one.name,
        "unit": one.quantity.unit,
        "shape": one.shape,
        "method": gauge.method,
        "interaction_pooled": gauge.pooled,
        "deviations": {
            name: {
                "value": gauge.deviation(*terms),
                "interval": gauge.interval_of_deviation(*terms),
            }
            for name, terms in sums.items()
            if any(term in gauge.variances for term in terms)
        },
        "percent_of_study": gauge.percent_of_study,
        "percent_of_study_interval": gauge.interval_of_percent,
        "percent_of_study_unpooled": one.unpooled and one.unpooled.percent_of_study,
        "percent_of_tolerance": finite(tolerance),
        "ndc": gauge.distinct,
        "told_apart_on_two_benches": gauge.apart() if one.values.counted[1] > 1 else None,
        "told_apart_on_one_bench": gauge.apart(one_bench=True),
        "set_to_zero": list(gauge.negative),
        "averages": [
            {"mountings": m, "repeats": r, "percent_of_study": gauge.averaged(m, r)}
            for m, r in _AVERAGES
        ],
        "sentences": list(words_of(one)),
    }
