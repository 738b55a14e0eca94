"""The report of one gear over its life: its passport as a page, with the same content on screen and on paper."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from rig.analysis.judging import GearVerdict, judge
from rig.analysis.passport.content import Passport, PassportSeries
from rig.analysis.passport.rows import conditions_text, newest_pair
from rig.content.data import data_grid
from rig.content.grid import Grid, columns, tone_of
from rig.content.page import Page, Section, Signature, State, annexes_of
from rig.content.phrase import counted, phrase
from rig.content.wording import days_text
from rig.present import catalogue, definitions
from rig.present.gear_runs import gear_alarms, gear_files, newest_fits
from rig.present.provenance import provenance_of, provenance_sections
from rig.present.report import (
    drawn,
    key_grid,
    marks_of,
    overall,
    page_facts,
    program_version,
    run_line,
    shown,
    verdict_grid,
)

if TYPE_CHECKING:
    from rig.analysis.fit.recorded import Fit
    from rig.gears.acceptance import Acceptance

_WORST = ("changed", "no change seen", "learning", "not watched")


def gear_page(
    passport: Passport, *, created: str, acceptance: Acceptance | None = None
) -> tuple[Page, GearVerdict]:
    """What the report of a gear shows, and its verdict.

    The verdict and the catalogue are those of the newest analysed run of every kind; the charts are
    those of all its runs.
    """
    with newest_fits(passport) as fits:
        verdict = judge(fits, acceptance)
        return _page(passport, fits, verdict, created), verdict


def _page(passport: Passport, fits: Sequence[Fit], verdict: GearVerdict, created: str) -> Page:
    runs = passport.runs
    marks = marks_of(run.origin for run in runs)
    are_counted = counted(len(runs), "run counts", "runs count")
    titles = [f"{definitions.title_of(fit.result.kind)}, run {fit.result.run}" for fit in fits]
    sources = list(zip(titles, map(provenance_of, fits), strict=True))
    sections = (
        *_parts(passport),
        *provenance_sections(sources, gear_files(passport, fits), "Newest runs"),
        *definitions.sections((), _terms(passport)),
    )
    return Page(
        number=_number(passport),
        heading=f"Passport of gear {passport.serial}",
        created=created,
        version=program_version(),
        subtitle="Catalogue values of the newest runs, and every followed quantity over the life of the gear",
        note=f"{are_counted} for this gear; they are listed in the annex.",
        facts=page_facts(
            [passport.gear],
            passport.serial,
            [run.operator or "not stated" for run in runs],
            days_text(run.start for run in runs),
        ),
        marks=marks,
        states=(_verdict_state(verdict, fits), _chart_state(passport)),
        alarms=gear_alarms(passport),
        judged=shown(
            verdict_grid(verdict),
            catalogue.catalogue_grid(fits, [one.conditions for _, one in sources]),
        ),
        warnings=tuple(_warnings(passport)),
        summary=shown(key_grid(_newest(passport.series))),
        sections=sections,
        annexes=annexes_of(sections, "runs", [_run_grid(passport)]),
        signature=_signature(", ".join(word for word, _ in marks)),
        run_line=run_line([run.run_id for run in runs]),
    )


def _verdict_state(verdict: GearVerdict, fits: Sequence[Fit]) -> State:
    if not fits:
        return State("NOT JUDGED", "No run of this gear is analysed.")
    state = overall(verdict, fits)
    return replace(state, sentence=f"{state.sentence} This is of the newest run of every kind.")


def _number(passport: Passport) -> str:
    """A number that follows from the points: the same runs and analyses give the same."""
    digest = hashlib.sha256(passport.serial.encode())
    for series in passport.series:
        digest.update(
            "".join(f"{series.key}{p.run}{p.analysis}{p.value!r}" for p in series.points).encode()
        )
    return "HP-" + digest.hexdigest()[:10].upper()


def _chart_state(passport: Passport) -> State:
    """The worst state of all charts, and what has changed."""
    states = [one.state for one in passport.series]
    if not states:
        sentence = "No run of this gear has an analysis with a quantity that is followed."
        return State("NOTHING TO FOLLOW", sentence)
    worst = next(state for state in _WORST if state in states)
    by_state = ", ".join(f"{states.count(state)} {state}" for state in _WORST if state in states)
    told = " ".join(f"{one.sentence}. {one.decides}" for one in passport.alarms)
    charts = "one quantity" if len(states) == 1 else f"{len(states)} quantities"
    sentence = f"{told} Of {charts} over time: {by_state}.".strip()
    return State(worst.upper(), sentence, tone_of(worst) or "muted")


def _warnings(passport: Passport) -> Iterator[tuple[str, str, str]]:
    """What is missing, and runs that do not count, as lines with a place to go to."""
    for title, concerns in (("Missing", passport.missing), ("Left out", passport.left_out)):
        for one in concerns:
            what = phrase("{}: ", one.run) + one.what + phrase(". {}", one.remedy)
            yield title, "parameters", what


def _parts(passport: Passport) -> Iterator[Section]:
    """Every followed quantity with its chart, then what was measured once, then the order spectra of all runs."""
    both = list(zip(passport.series, passport.tables, strict=True))
    charted = [(series, table) for series, table in both if len(series.points) > 1]
    numbers = itertools.count(1)
    for place, (series, table) in enumerate(charted, 1):
        facts = "; ".join(f"{name}: {value}" for name, value in series.conditions.items())
        yield Section(
            title=series.title,
            anchor=f"part-{place}",
            subtitle=f"Runs with {facts or 'all'}",
            warnings=tuple(series.notes),
            figures=tuple(drawn(plot, series.origin, next(numbers)) for plot in series.plots),
            grids=(data_grid(table),),
        )
    once = [series for series in passport.series if len(series.points) == 1]
    if once:
        # A chart of one point shows nothing that its line does not say.
        yield Section(
            title="Measured once",
            anchor="measured-once",
            subtitle="A second run of the same conditions begins the chart",
            grids=(_once_grid(once),),
        )
    if passport.spectra:
        origin = passport.runs[-1].origin
        yield Section(
            title="Order spectra",
            anchor=f"part-{len(charted) + 1}",
            subtitle="Runs with the kinematic error identified",
            figures=tuple(drawn(plot, origin, next(numbers)) for plot in passport.spectra),
        )


def _once_grid(once: Sequence[PassportSeries]) -> Grid:
    """Quantities of which there is one run: the value, where it holds, and what is to be said of it."""
    heads = columns(
        ("quantity", "quantity"),
        ("value ± U (95 %)", "number"),
        ("unit", "unit"),
        "run",
        "conditions",
        "remarks",
    )
    rows = [
        (
            one.title,
            newest_pair(one),
            one.display_unit,
            one.points[-1].run,
            conditions_text(one.conditions),
            "; ".join(one.points[-1].remarks),
        )
        for one in once
    ]
    return Grid("Quantities of one run", heads, rows).without_empty()


def _newest(series: Sequence[PassportSeries]) -> list[tuple[str, str, str, str]]:
    """The newest value of every quantity with its state."""
    rows = []
    for one in series:
        text = f"{newest_pair(one)} {one.display_unit}".rstrip()
        rows.append((one.kind, f"{one.title} ({one.state})", text, one.points[-1].identifiability))
    return rows


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


def _terms(passport: Passport) -> Iterator[tuple[str, str]]:
    """What is followed, and how often a change is told where there is none."""
    yield from {one.title: one.definition for one in passport.series}.items()
    yield "Changed", f"A sum of scores of the runs is above its threshold: {passport.promise}"


def _signature(words: str) -> Signature:
    if not words:
        return Signature(True)
    return Signature(
        False,
        f"This passport holds runs marked {words}. There is no room for a signature on it.",
    )
