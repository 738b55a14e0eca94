"""The report of a lot: one page for screen and paper, under the names that the page's template knows."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from experiments.result import Plot
from rig.content.grid import Grid, columns
from rig.content.wording import decimals_of, fixed, number
from rig.fleet.dataset import DataSet
from rig.fleet.lot import Lot, why_of
from rig.fleet.lot_benches import BenchValues, by_bench
from rig.fleet.lot_figures import distribution, over_time
from rig.fleet.lot_quantity import LotQuantity
from rig.fleet.lot_words import limits_words, with_interval
from rig.present import content, definitions
from rig.present import figure as figures
from rig.present.content import Overall, Part
from rig.present.page import ORIGIN_SENTENCES, Figure, Signature, write_context
from rig.runfile.seal import file_sha256

MOST_DRAWN = 12
"""Quantities with figures of their own: those with limits first."""
MOST_NAMED = 8
"""Gears that a reason names; of more their number is told."""


def write_lot_report(lot: Lot, path: Path, created: str) -> Path:
    """Write the report of a lot as HTML or, by its suffix, as PDF. Raises `RigError` where it cannot be written."""
    return write_context(lot_context(lot, created), path)


def lot_context(lot: Lot, created: str) -> dict[str, Any]:
    """Everything that the report of a lot shows; `created` is its calendar time (ISO 8601)."""
    origin, rows = lot.data.origin, lot.data.rows
    word = figures.WATERMARKS.get(origin, origin.upper())
    drawn = [one for one in lot.quantities if one.measured][:MOST_DRAWN]
    parts = _parts(lot, drawn, origin)
    return {
        "created": created,
        "note": "Every gear counts once, by the newest analysed run of each kind. Verdicts are those of the time when "
        "the runs were fitted; rig fleet fit makes anew what has changed.",
        "number": _number(lot),
        "gear_name": _several(sorted({row.part for row in rows if row.part})),
        "heading": f"Lot of {len(lot.gears)} gears",
        "subtitle": "Verdicts, key quantities against their limits, benches, and the gears to look at",
        "serial": _range([gear.gear for gear in lot.gears]),
        "operators": _several(sorted({row.operator for row in rows if row.operator})),
        "dates": _dates(lot),
        "words": [word] if word else [],
        "origin_sentences": [ORIGIN_SENTENCES[origin]] if origin in ORIGIN_SENTENCES else [],
        "states": (_overall(lot),),
        "overall": _overall(lot),
        "verdicts": (),
        "decision_rule": "",
        "alarms": lot.notes,
        "catalogue": _capability_grid(lot),
        "files": _files(lot),
        "run_line": f"{len(lot.gears)} gears, {lot.data.runs} runs",
        "warnings": [],
        "parts": parts,
        "conditions": (),
        "calibrations": (),
        "identities": (),
        "conventions": (),
        "settings": (),
        "truth": None,
        "truth_note": "",
        "paper_figures": (),
        "run_word": "",
        "annex_title": "gears",
        "parameter_sets": (_gear_grid(lot),),
        "definitions": _definitions(drawn),
        "not_measured": definitions.NOT_MEASURED,
        "paper": definitions.PAPER,
        "signature": Signature(
            False, "The report of a lot is an overview; what is signed is the report of a gear."
        ),
        "version": content.program_version(),
        "key_results": (),
        "made_from": "results whose SHA-256 stands under Provenance; they name every run by its own",
    }


def _overall(lot: Lot) -> Overall:
    counted = lot.verdicts
    told = ", ".join(f"{count} {word}" for word, count in counted.items())
    judged = sum(gear.is_complete for gear in lot.gears)
    return Overall(
        f"{counted['PASS']} of {len(lot.gears)} PASS",
        f"{told}. {judged} gears are judged by all that their acceptance file asks.",
        "open",
    )


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
    mean = sum(values) / len(values) if values else None
    spread = None
    if mean is not None and len(values) > 1:
        spread = (sum((v - mean) ** 2 for v in values) / (len(values) - 1)) ** 0.5
    doubt = sum(doubts) / len(doubts) if doubts else None
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


def _text(value: float | None, decimals: int | None) -> str:
    if value is None:
        return "–"
    return number(value) if decimals is None else fixed(value, decimals)


def _parts(lot: Lot, drawn: Sequence[LotQuantity], origin: str) -> tuple[Part, ...]:
    parts = [_look_at(lot), _unknown(lot)]
    number_ = 0
    for one in drawn:
        plots = [plot for plot in (distribution(one), over_time(one)) if plot is not None]
        drawings = []
        for plot in plots:
            number_ += 1
            drawings.append(_drawn(plot, origin, number_))
        found = one.capability
        why = (
            (f"No capability: {found}.",)
            if isinstance(found, str) and one.limits is not None
            else ()
        )
        parts.append(
            _part(
                len(parts) + 1,
                f"{one.title[:1].upper()}{one.title[1:]} ({one.kind})",
                tuple(drawings),
                (_bench_grid(one),),
                why,
            )
        )
    return tuple(parts)


def _look_at(lot: Lot) -> Part:
    rows = tuple(
        (one.gear, one.bench or "–", one.verdict, "; ".join(why_of(one))) for one in lot.to_look_at
    )
    grid = Grid(
        "The gears to look at first",
        columns("gear", "bench", ("verdict", "word"), "why"),
        rows,
        "In this order: what fails, what is marginal, what is unlike the others (more than 3.5 robust standard "
        "deviations from the median), what is nearest to a limit.",
    )
    return _part(1, "Gears to look at", (), (grid,) if rows else ())


def _unknown(lot: Lot) -> Part:
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
    return _part(2, "What could not be judged", (), (grid,) if rows else (), none)


def _named(gears: Sequence[str]) -> str:
    names = ", ".join(gears[:MOST_NAMED])
    return names if len(gears) <= MOST_NAMED else f"{names} and {len(gears) - MOST_NAMED} more"


def _bench_grid(one: LotQuantity) -> Grid:
    factor, unit = one.shown_in
    where = f" [{unit}]" if unit else ""
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


def _part(
    index: int,
    title: str,
    drawings: tuple[Figure, ...],
    tables: tuple[Grid, ...] = (),
    warnings: tuple[str, ...] = (),
) -> Part:
    return Part(
        anchor=f"part-{index}", title=title, grids=tables, warnings=warnings, figures=drawings
    )


def _drawn(plot: Plot, origin: str, number_: int) -> Figure:
    from markupsafe import Markup

    drawing = figures.draw_svg(plot, origin, f"f{number_}", figures.HALF_WIDTH)
    return Figure(
        number=number_,
        anchor=f"figure-{number_}",
        svg=Markup(drawing.svg),
        title=plot.title,
        after="",
        note=" ".join(part for part in (plot.note, *drawing.remarks) if part),
        half=True,
    )


def _gear_grid(lot: Lot) -> Grid:
    rows = tuple(
        (
            one.gear,
            one.bench or "–",
            one.verdict,
            one.because[0] if one.because else one.nearest or "–",
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


def _definitions(drawn: Sequence[LotQuantity]) -> list[tuple[str, str]]:
    told = [(one.title, one.quantity.definition) for one in drawn if one.quantity.definition]
    capable = (
        "Cp, Cpk",
        "Cp = (upper − lower) / 6s; Cpk = distance of the mean from the nearer limit / 3s. 95 % intervals: chi-square "
        "for Cp, Bissell (Applied Statistics 39, 1990, 331–340) for Cpk. Not told of fewer than ten judged gears.",
    )
    return [*dict(told).items(), capable, *definitions.definitions_for(())]


def _several(names: Sequence[str]) -> str:
    return (
        ", ".join(names[:MOST_NAMED])
        + (f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else "")
        or "not stated"
    )


def _range(gears: Sequence[str]) -> str:
    return ", ".join(gears) if len(gears) <= 2 else f"{gears[0]} to {gears[-1]}, in the annex"


def _dates(lot: Lot) -> str:
    starts = {row.started for row in lot.data.rows if row.started is not None}
    days = sorted({datetime.fromtimestamp(one, UTC).date().isoformat() for one in starts})
    if not days:
        return "not stated"
    return days[0] if len(days) == 1 else f"{days[0]} to {days[-1]}"
