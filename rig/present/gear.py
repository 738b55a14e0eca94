"""The report of one gear over its life: its passport as a page, with the same content on screen and on paper."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from experiments.result import DECISION_RULE
from rig.analysis.judging import GearVerdict, judge
from rig.analysis.passport.content import Passport, PassportSeries
from rig.content.data import data_grid
from rig.content.grid import Grid, columns
from rig.content.wording import decimals_of, fixed, number
from rig.present import catalogue, content, definitions, provenance
from rig.present import figure as figures
from rig.present.content import Overall, Part
from rig.present.gear_runs import gear_alarms, gear_files, newest_fits
from rig.present.page import ORIGIN_SENTENCES, Figure, Signature, run_line

if TYPE_CHECKING:
    from rig.analysis.fit import Fit
    from rig.gears.acceptance import Acceptance

_STYLES = {
    "in control": "pass",
    "to be watched": "marginal",
    "out of control": "fail",
    "no control limits yet": "open",
}
_WORDS = {
    "in control": "IN CONTROL",
    "to be watched": "TO BE WATCHED",
    "out of control": "OUT OF CONTROL",
    "no control limits yet": "NO CONTROL LIMITS YET",
}
_WORST = ("out of control", "to be watched", "no control limits yet", "in control")


def gear_context(
    passport: Passport, *, created: str, acceptance: Acceptance | None = None
) -> dict[str, Any]:
    """What the report of a gear shows, under the names that the page's template knows.

    The verdict and the catalogue are those of the newest analysed run of every kind; the charts are
    those of all its runs.
    """
    with newest_fits(passport) as fits:
        verdict = judge(fits, acceptance)
        newest = _of_newest(passport, fits, verdict)
        return {**_of_all_runs(passport), **newest, "created": created, "judged": verdict}


def _of_all_runs(passport: Passport) -> dict[str, Any]:
    """Who and what the gear is, its charts, and the runs that count."""
    origins = list(dict.fromkeys(run.origin for run in passport.runs))
    words = [
        word
        for word in (figures.WATERMARKS.get(origin, origin.upper()) for origin in origins)
        if word
    ]
    starts = sorted(run.start[:10] for run in passport.runs if run.start)
    days = (
        "not stated"
        if not starts
        else starts[0]
        if starts[0] == starts[-1]
        else f"{starts[0]} to {starts[-1]}"
    )
    counted = f"{len(passport.runs)} {'run counts' if len(passport.runs) == 1 else 'runs count'}"
    return {
        "note": f"{counted} for this gear; they are listed in the annex.",
        "number": _number(passport),
        "gear_name": passport.gear or "not stated",
        "heading": f"Passport of gear {passport.serial}",
        "subtitle": "Catalogue values of the newest runs, and every followed quantity over the life of the gear",
        "serial": passport.serial,
        "operators": ", ".join(
            dict.fromkeys(run.operator or "not stated" for run in passport.runs)
        ),
        "dates": days,
        "words": words,
        "origin_sentences": [
            ORIGIN_SENTENCES[origin] for origin in origins if origin in ORIGIN_SENTENCES
        ],
        "alarms": gear_alarms(passport),
        "run_line": run_line([run.run_id for run in passport.runs]),
        "warnings": _warnings(passport),
        "parts": tuple(_parts(passport)),
        "truth": None,
        "truth_note": "",
        "paper_figures": (),
        "run_word": "Runs with",
        "annex_title": "runs",
        "parameter_sets": (_run_grid(passport),),
        "definitions": _definitions(passport),
        "not_measured": definitions.NOT_MEASURED,
        "paper": definitions.PAPER,
        "signature": _signature(words),
        "version": content.program_version(),
        "key_results": _newest(passport.series),
    }


def _of_newest(passport: Passport, fits: Sequence[Fit], verdict: GearVerdict) -> dict[str, Any]:
    """Verdict, catalogue, conditions, calibrations and provenance of the newest analysed runs, and the files of all."""
    titles = [f"{definitions.title_of(fit.result.kind)}, run {fit.result.run}" for fit in fits]
    origins = list(zip(titles, map(provenance.provenance_of, fits), strict=True))
    told = content.overall(verdict, fits)
    told = (
        replace(told, sentence=f"{told.sentence} This is of the newest run of every kind.")
        if fits
        else Overall("NOT JUDGED", "No run of this gear is analysed.", "open")
    )
    return {
        "overall": told,
        "states": (told, _state(passport.series)),
        "verdicts": content.verdict_lines(verdict),
        "decision_rule": DECISION_RULE,
        "catalogue": catalogue.catalogue_grid(fits, [origin.conditions for _, origin in origins]),
        "files": gear_files(passport, fits),
        "conditions": provenance.side_by_side(
            [(title, origin.conditions) for title, origin in origins]
        ),
        "calibrations": provenance.side_by_side(
            [(title, origin.calibrations) for title, origin in origins]
        ),
        "identities": provenance.side_by_side(
            [(title, origin.rows) for title, origin in origins], "Newest runs"
        ),
        "conventions": provenance.side_by_side(
            [(title, origin.options) for title, origin in origins], "Conventions of the analyses"
        ),
        "settings": provenance.side_by_side(
            [(title, origin.settings) for title, origin in origins],
            "Parameters of the protocols and settings of the analyses",
        ),
    }


def _number(passport: Passport) -> str:
    """A number that follows from the points: the same runs and analyses give the same."""
    digest = hashlib.sha256(passport.serial.encode())
    for series in passport.series:
        digest.update(
            "".join(f"{series.key}{p.run}{p.analysis}{p.value!r}" for p in series.points).encode()
        )
    return "HP-" + digest.hexdigest()[:10].upper()


def _state(series: Sequence[PassportSeries]) -> Overall:
    """The worst state of all charts."""
    states = [one.state for one in series]
    if not states:
        return Overall(
            "NOTHING TO FOLLOW",
            "No run of this gear has an analysis with a quantity that is followed.",
            "open",
        )
    worst = next(state for state in _WORST if state in states)
    counted = ", ".join(f"{states.count(state)} {state}" for state in _WORST if state in states)
    return Overall(_WORDS[worst], f"{len(states)} quantities over time: {counted}.", _STYLES[worst])


def _warnings(passport: Passport) -> list[tuple[str, str, str, str]]:
    """What is missing, and runs that do not count, as lines with a place to go to."""
    concerns = [("Missing", one) for one in passport.missing] + [
        ("Left out", one) for one in passport.left_out
    ]
    lines = []
    for title, one in concerns:
        what = f"{one.run}: {one.what}" if one.run else one.what
        lines.append(
            (title, "parameters", one.run, f"{what}. {one.remedy}" if one.remedy else what)
        )
    return lines


def _parts(passport: Passport) -> list[Part]:
    tables = dict(zip((series.key for series in passport.series), passport.tables, strict=False))
    plots = [(series.title, series.plot, series) for series in passport.series]
    parts = []
    for index, (title, plot, series) in enumerate(plots, 1):
        table = tables.get(series.key)
        grid = data_grid(table) if table is not None else None
        facts = "; ".join(f"{name}: {value}" for name, value in series.conditions.items())
        parts.append(
            _part(
                index,
                title,
                (_drawn(plot, series.origin, index),),
                grid,
                tuple(series.notes),
                facts or "all",
            )
        )
    origin = passport.runs[-1].origin if passport.runs else "simulated"
    spectra = tuple(
        _drawn(plot, origin, len(plots) + k) for k, plot in enumerate(passport.spectra, 1)
    )
    if spectra:
        parts.append(
            _part(len(plots) + 1, "Order spectra", spectra, run="the kinematic error identified")
        )
    return parts


def _part(
    index: int,
    title: str,
    figures: tuple[Figure, ...],
    grid: Grid | None = None,
    warnings: tuple[str, ...] = (),
    run: str = "all",
) -> Part:
    return Part(
        anchor=f"part-{index}",
        title=title,
        run=run,
        grids=(grid,) if grid else (),
        warnings=warnings,
        figures=figures,
    )


def _drawn(plot: Any, origin: str, number_: int) -> Figure:
    drawing = figures.draw_svg(plot, origin, f"f{number_}", figures.FULL_WIDTH)
    note = " ".join(part for part in (plot.note, *drawing.remarks) if part)
    return Figure(
        number=number_,
        anchor=f"figure-{number_}",
        svg=Markup(drawing.svg),
        title=plot.title,
        after="",
        note=note,
        half=False,
    )


def _newest(series: Sequence[PassportSeries]) -> tuple[tuple[str, str, str, str], ...]:
    """The newest value of every quantity with its state."""
    rows = []
    for one in series:
        newest = one.points[-1]
        value, doubt = newest.value / one.factor, newest.expanded_uncertainty / one.factor
        decimals = decimals_of(doubt)
        shown = (
            number(value)
            if decimals is None
            else f"{fixed(value, decimals)} ± {fixed(doubt, decimals)}"
        )
        text = f"{shown} {one.display_unit}".rstrip()
        rows.append((one.kind, f"{one.title} ({one.state})", text, newest.identifiability))
    return tuple(rows)


def _run_grid(passport: Passport) -> Grid:
    rows = tuple(
        (
            run.run_id,
            run.start[:16].replace("T", " "),
            run.protocol,
            run.operator or "not stated",
            run.outcome,
            run.origin,
        )
        for run in passport.runs
    )
    heads = columns("run", "started", "protocol", "operator", "outcome", "origin")
    return Grid("Runs that count", heads, rows)


def _definitions(passport: Passport) -> list[tuple[str, str]]:
    """What is followed, what the signals of the charts mean, and how uncertainty and verdict are to be read."""
    followed = {one.title: one.definition for one in passport.series}
    signals = ((f"Signal {name}", meaning) for name, meaning in passport.rules.items())
    return [*followed.items(), *signals, *definitions.definitions_for(())]


def _signature(words: Sequence[str]) -> Signature:
    if words:
        return Signature(
            False,
            f"This passport holds runs marked {', '.join(words)}. There is no room for a signature on it.",
        )
    return Signature(True)
