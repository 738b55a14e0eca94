"""The report of a lot: one page for screen and paper, under the names that the page's template knows."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path

from rig.content.grid import Grid, capital, columns
from rig.content.page import Page, Section, Signature, State, annexes_of
from rig.content.phrase import phrase
from rig.content.wording import days_text, decimals_of, fixed, number
from rig.fleet.dataset import DataSet
from rig.fleet.gauge.page import gauge_sections
from rig.fleet.lot import Lot, why_of
from rig.fleet.lot_benches import BenchValues, by_bench
from rig.fleet.lot_figures import distribution, over_time
from rig.fleet.lot_quantity import LotQuantity
from rig.fleet.lot_words import limits_words, with_interval
from rig.present import definitions
from rig.present.page import write_page
from rig.present.report import drawn, marks_of, page_facts, program_version, shown
from rig.runfile.seal import file_sha256

_MOST_DRAWN = 12
"""Quantities with figures of their own: those with limits first."""
_MOST_NAMED = 8
"""Gears that a reason names; of more their number is told."""


def write_lot_report(lot: Lot, path: Path, created: str) -> Path:
    """Write the report of a lot as HTML or, by its suffix, as PDF. Raises `RigError` where it cannot be written."""
    return write_page(lot_page(lot, created), path)


def lot_page(lot: Lot, created: str) -> Page:
    """Everything that the report of a lot shows; `created` is its calendar time (ISO 8601)."""
    rows = lot.data.rows
    drawn_ones = [one for one in lot.quantities if one.measured][:_MOST_DRAWN]
    sections = (
        *_parts(lot, drawn_ones),
        *gauge_sections(lot.data.folder, lot.data.origin),
        Section(title="Provenance", anchor="provenance", grids=(_files(lot),)),
        *definitions.sections((), _terms(drawn_ones)),
    )
    return Page(
        number=_number(lot),
        heading=f"Lot of {len(lot.gears)} gears",
        created=created,
        version=program_version(),
        subtitle="Verdicts, key quantities against their limits, benches, and the gears to look at",
        note="Every gear counts once, by the newest analysed run of each kind. Verdicts are those of the time when "
        "the runs were fitted; rig fleet fit makes anew what has changed.",
        facts=page_facts(
            [_named(sorted({row.part for row in rows if row.part})) or "not stated"],
            _range([gear.gear for gear in lot.gears]),
            [_named(sorted({row.operator for row in rows if row.operator})) or "not stated"],
            days_text(
                datetime.fromtimestamp(row.started, UTC).isoformat()
                for row in rows
                if row.started is not None
            ),
        ),
        marks=marks_of([lot.data.origin]),
        states=(_state(lot),),
        alarms=tuple(lot.notes),
        judged=shown(_capability_grid(lot)),
        sections=sections,
        annexes=annexes_of(sections, "gears", [_gear_grid(lot)]),
        signature=Signature(
            False, "The report of a lot is an overview; what is signed is the report of a gear."
        ),
        run_line=f"{len(lot.gears)} gears, {lot.data.runs} runs",
        made_from="results whose SHA-256 stands under Provenance; they name every run by its own",
    )


def _state(lot: Lot) -> State:
    counted = lot.verdicts
    told = ", ".join(f"{count} {word}" for word, count in counted.items())
    judged = sum(gear.is_complete for gear in lot.gears)
    sentence = f"{told}. {judged} gears are judged by all that their acceptance file asks."
    return State(f"{counted['PASS']} of {len(lot.gears)} PASS", sentence)


def _capability_grid(lot: Lot) -> Grid | None:
    """Every quantity with a limit, and the drawn ones without: how it is spread, and how capable the production is."""
    rows = []
    for one in lot.quantities:
        if one.limits is None and not one.measured:
            continue
        rows.append(_capability_row(one))
    if not rows:
        return None
    heads = columns(
        ("quantity", "quantity"),
        ("unit", "unit"),
        ("gears", "number"),
        ("mean", "number"),
        ("s", "number"),
        ("mean U", "number"),
        ("limit", "number"),
        ("Cp (95 %)", "number"),
        ("Cpk (95 %)", "number"),
        "P / M / F / –",
    )
    grid = Grid(
        "Key quantities against their limits",
        heads,
        rows,
        "s: standard deviation between gears, which holds that of their measurement; mean U: expanded uncertainty "
        "(95 %) of one gear. Cp and Cpk of the gears that are judged, assuming a normal distribution; * where the "
        "values refuse it at 1 %. P / M / F / –: gears with PASS, MARGINAL, FAIL, NOT JUDGED.",
    )
    has_two_sides = any(
        one.limits and None not in (one.limits.lower, one.limits.upper) for one in lot.quantities
    )
    return grid if has_two_sides else grid.without("Cp (95 %)")


def _capability_row(one: LotQuantity) -> tuple[str, ...]:
    factor, unit = one.shown_in
    values = [row.value / factor for row in one.measured if row.value is not None]
    doubts = [row.expanded_uncertainty / factor for row in one.measured if row.expanded_uncertainty]
    mean = _mean(values)
    spread = None
    if mean is not None and len(values) > 1:
        spread = (sum((v - mean) ** 2 for v in values) / (len(values) - 1)) ** 0.5
    doubt = _mean(doubts)
    found = one.capability
    if isinstance(found, str):
        indices = ("–", "–")
    else:
        mark = "" if found.is_normal else " *"
        potential = with_interval(found.potential, found.potential_interval)
        indices = (potential, with_interval(found.actual, found.actual_interval) + mark)
    decimals = decimals_of(spread or 0.0)
    verdicts = one.verdicts
    counted = " / ".join(
        str(verdicts.get(word, 0)) for word in ("PASS", "MARGINAL", "FAIL", "NOT JUDGED")
    )
    return (
        one.title,
        unit,
        str(len(values)),
        _text(mean, decimals),
        _text(spread, decimals),
        _text(doubt, decimals),
        limits_words(one) or "–",
        *indices,
        counted if verdicts else "–",
    )


def _mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None


def _text(value: float | None, decimals: int | None) -> str:
    if value is None:
        return "–"
    return number(value) if decimals is None else fixed(value, decimals)


def _parts(lot: Lot, quantities: Sequence[LotQuantity]) -> Iterator[Section]:
    """What to look at, what could not be judged, then every drawn quantity with its figures."""
    yield _look_at(lot)
    yield _unknown(lot)
    number_ = 0
    for place, one in enumerate(quantities, 3):
        plots = [plot for plot in (distribution(one), over_time(one)) if plot is not None]
        figures = tuple(
            drawn(plot, lot.data.origin, at, half=True)
            for at, plot in enumerate(plots, number_ + 1)
        )
        number_ += len(plots)
        warnings: tuple[str, ...] = ()
        if isinstance(one.capability, str) and one.limits:
            warnings = (f"No capability: {one.capability}.",)
        yield Section(
            title=f"{capital(one.title)} ({one.kind})",
            anchor=f"part-{place}",
            warnings=warnings,
            figures=figures,
            grids=(_bench_grid(one),),
        )


def _look_at(lot: Lot) -> Section:
    rows = tuple(
        (one.gear, one.bench or "–", one.verdict, "; ".join(why_of(one))) for one in lot.to_look_at
    )
    grid = Grid(
        "The gears to look at first",
        columns("gear", "bench", ("verdict", "word"), "why"),
        rows,
        "In this order: what fails, what is marginal, what has changed over its runs or is unlike the others (more "
        "than 3.5 robust standard deviations from the median), what is nearest to a limit.",
    )
    return Section(title="Gears to look at", anchor="part-1", grids=shown(grid))


def _unknown(lot: Lot) -> Section:
    """What could not be judged, and why."""
    rows = [(reason, str(len(gears)), _named(gears)) for reason, gears in lot.not_judged.items()]
    rows += [
        (f"run {run} could not be analysed: {reason}", "1", gear)
        for gear, run, reason in lot.data.failures
        if not any(run in told for told in lot.not_judged)
    ]
    grid = Grid(
        "What could not be judged",
        columns("why", ("gears", "number"), "which"),
        rows,
        "A gear may stand in several lines." if len(rows) > 1 else "",
    )
    none = () if rows else ("Every gear is judged by all that its acceptance file asks.",)
    return Section(title=grid.title, anchor="part-2", warnings=none, grids=shown(grid))


def _named(several: Sequence[str]) -> str:
    names = ", ".join(several[:_MOST_NAMED])
    more = len(several) - _MOST_NAMED
    return names if more <= 0 else f"{names} and {more} more"


def _bench_grid(one: LotQuantity) -> Grid:
    factor, unit = one.shown_in
    where = phrase(" [{}]", unit)
    rows = tuple(_bench_row(bench, factor) for bench in by_bench(one))
    return Grid(
        "Bench beside bench",
        columns(
            "bench",
            ("gears", "number"),
            (f"mean{where}", "number"),
            (f"s{where}", "number"),
            ("beside the others (95 %)", "number"),
            ("per 30 days (95 %)", "number"),
        ),
        rows,
        "Different gears were on different benches: a difference is of gears, of benches, or of both. Of many such "
        "intervals one in twenty leaves zero out by chance.",
    )


def _bench_row(bench: BenchValues, factor: float) -> tuple[str, ...]:
    decimals = decimals_of((bench.standard_deviation or 0.0) / factor)

    def with_half_width(pair: tuple[float, float] | None) -> str:
        if pair is None:
            return "–"
        digits = decimals_of(pair[1] / factor)
        return f"{_text(pair[0] / factor, digits)} ± {_text(pair[1] / factor, digits)}"

    spread = bench.standard_deviation
    return (
        bench.bench or "not stated",
        str(bench.gears),
        _text(bench.mean / factor, decimals),
        _text(None if spread is None else spread / factor, decimals),
        with_half_width(bench.difference),
        with_half_width(bench.slope),
    )


def _gear_grid(lot: Lot) -> Grid:
    rows = tuple(
        (
            one.gear,
            one.bench or "–",
            one.verdict,
            (*one.because, one.nearest or "–")[0],
        )
        for one in lot.gears
    )
    heads = columns("gear", "bench", ("verdict", "word"), "first reason, or nearest limit")
    return Grid("Gears of the lot", heads, rows)


def _files(lot: Lot) -> Grid:
    rows = tuple((path.name, file_sha256(path)) for _, path in DataSet(lot.data.folder).parts())
    return Grid("Results", columns("file", ("SHA-256", "hash")), rows, str(lot.data.folder))


def _number(lot: Lot) -> str:
    """A number that follows from what is told: the same results give the same one."""
    digest = hashlib.sha256()
    for row in lot.data.rows:
        digest.update(
            f"{row.gear}|{row.run}|{row.kind}|{row.quantity}|{row.value!r}|{row.verdict}".encode()
        )
    return "HL-" + digest.hexdigest()[:10].upper()


def _terms(quantities: Sequence[LotQuantity]) -> Iterator[tuple[str, str]]:
    """What is drawn, and what tells of a capability."""
    yield from {q.title: q.quantity.definition for q in quantities if q.quantity.definition}.items()
    yield (
        "Cp, Cpk",
        "Cp = (upper − lower) / 6s; Cpk = distance of the mean from the nearer limit / 3s. 95 % intervals: chi-square "
        "for Cp, Bissell (Applied Statistics 39, 1990, 331–340) for Cpk. Not told of fewer than ten judged gears.",
    )


def _range(gears: Sequence[str]) -> str:
    return ", ".join(gears) if len(gears) <= 2 else f"{gears[0]} to {gears[-1]}, in the annex"
