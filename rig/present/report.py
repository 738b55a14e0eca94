"""The report of runs: their results with the paper's figures, the verdict on them, conditions, provenance, definitions.

Runs that do not come from hardware are marked on every figure and cannot be signed.
"""

from __future__ import annotations

import hashlib
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from experiments import catalogue as experiments_catalogue
from experiments.quantity import key_names
from experiments.result import DECISION_RULE, Plot, Result, Verdict
from rig.analysis.judging import GearVerdict, doubts_of, held_against, whose_limit
from rig.analysis.rows import (
    budget_grid,
    estimate_grid,
    metric_grid,
    order_grid,
    statistical_grid,
    truth_grid,
)
from rig.content.data import data_grid
from rig.content.grid import Grid, capital, columns, tone_of
from rig.content.page import Figure, Page, Section, Signature, State, annexes_of
from rig.content.phrase import phrase, shortened
from rig.content.wording import days_text, readable, show
from rig.errors import RigError
from rig.present import catalogue, definitions
from rig.present import figure as figures
from rig.present.limits import with_limits
from rig.present.numbers import number_grids
from rig.present.page import write_page
from rig.present.parameters import parameter_grids
from rig.present.provenance import Provenance, provenance_of, provenance_sections
from rig.program import version
from rig.runfile.header import ORIGIN_WORDS

if TYPE_CHECKING:
    from experiments.recording import RunMetadata
    from experiments.truth import TruthRow
    from model.gear import HarmonicDrive
    from rig.analysis.fit.recorded import Fit
    from rig.analysis.validate import Validation

UNFINISHED = {"ABORTED", "TRIPPED", "ERROR", "INTERRUPTED"}
"""Outcomes of runs that did not reach their end."""
_LONG_TABLE = 16
"""Rows above which a table of data stands in the annex."""
LONGEST_LINE = 124
"""Letters of run numbers that fit on the foot of a page."""
_ORIGIN_SENTENCES = {
    "simulated": "Made on a simulated rig with a simulated gear. "
    "This is no measurement of a physical gear, stays out of any gear's history and cannot be signed.",
    "replay": "Made by playing back a recorded run. It is no new measurement and cannot be signed.",
    "imported": "Made from a recording of another rig, whose calibration this program has not seen. "
    "It cannot be signed.",
}


def write_report(
    fits: Sequence[Fit],
    path: str | Path,
    *,
    created: str,
    verdict: GearVerdict,
    truth: Sequence[tuple[str, TruthRow]] = (),
    note: str = "",
) -> Path:
    """Write the report of these fits (of one gear) as one file, HTML or PDF by its suffix, and return its path.

    `created` is the calendar time of the report (ISO 8601); `verdict` what `judge` said; `truth` kind of fit
    and what the simulator knows; `note` a sentence under the title. The same input gives the same bytes. Raises
    `RigError` for nothing to report or a file that cannot be written.
    """
    return write_page(
        report_page(fits, created=created, verdict=verdict, truth=truth, note=note), path
    )


def report_page(
    fits: Sequence[Fit],
    *,
    created: str,
    verdict: GearVerdict,
    truth: Sequence[tuple[str, TruthRow]] = (),
    note: str = "",
    models: Sequence[Validation] = (),
) -> Page:
    """Everything that a report shows, on screen and on paper: each number is worded once, here.

    `models` of a kind stand with the last of its runs.
    """
    if not fits:
        raise RigError("there is nothing to report", remedy="Name at least one run.")
    fits = [with_limits(fit, verdict.lines) for fit in sorted(fits, key=_place)]
    parts, plots = _parts(fits, models)
    sources = [(part.title, provenance_of(fit)) for part, fit in zip(parts, fits, strict=True)]
    runs = [fit.recording.metadata for fit in fits]
    gears, serials = _tested(fits)
    sections = (
        *parts,
        *_numbers(fits),
        *_truth(truth, [fit.result for fit in fits]),
        *provenance_sections(sources, _file_grid(fits)),
        *definitions.sections(fit.result.kind for fit in fits),
    )
    conditions = [source.conditions for _, source in sources]
    return Page(
        number=_report_number(fits),
        heading=_heading(gears, serials, fits),
        created=created,
        version=program_version(),
        subtitle=" · ".join(part.title for part in parts),
        note=note,
        facts=_facts([gear.name for gear in gears], serials, runs),
        marks=marks_of(m.origin for m in runs),
        states=(overall(verdict, fits),),
        alarms=_alarms([one for _, one in sources], serials),
        judged=shown(verdict_grid(verdict), catalogue.catalogue_grid(fits, conditions)),
        warnings=tuple((part.title, part.anchor, text) for part in parts for text in part.warnings),
        summary=shown(key_grid(_key_results(fits)), _paper_grid(plots, whole=len(fits) > 1)),
        sections=sections,
        annexes=annexes_of(
            sections, "parameter set with its sources", parameter_grids(_mounted(fits))
        ),
        signature=signature_of(fits),
        run_line=run_line([m.run_id for m in runs]),
    )


def _mounted(fits: Sequence[Fit]) -> list[Fit]:
    """The fits of runs with a gear."""
    return [fit for fit in fits if fit.recording.metadata.gear_mounted]


def _tested(fits: Sequence[Fit]) -> tuple[list[HarmonicDrive], list[str]]:
    """The gears that were tested and their serial numbers, each once."""
    mounted = _mounted(fits)
    serials = [s for s in dict.fromkeys(f.recording.metadata.gear_serial for f in mounted) if s]
    return list({f.gear.name: f.gear for f in mounted if f.gear_known}.values()), serials


def shown(*grids: Grid | None) -> tuple[Grid, ...]:
    """The tables in which anything stands."""
    return tuple(grid for grid in grids if grid is not None and grid.rows)


def _facts(
    gears: Sequence[str], serials: Sequence[str], runs: Sequence[RunMetadata]
) -> tuple[tuple[str, str], ...]:
    operators = [m.operator or "not stated" for m in runs]
    if not any(m.gear_mounted for m in runs):
        gears, serials = ["none mounted"], ["none"]
    return page_facts(gears, ", ".join(serials), operators, days_text(m.start_time for m in runs))


def page_facts(
    gears: Sequence[str], serial: str, operators: Iterable[str], days: str
) -> tuple[tuple[str, str], ...]:
    """What stands under the heading: gear, serial number, operator, days."""
    facts = {
        "Gear": ", ".join(gears),
        "Serial number": serial,
        "Operator": ", ".join(dict.fromkeys(operators)),
        "Date of the runs": days,
    }
    return tuple((name, text or "not stated") for name, text in facts.items())


def marks_of(origins: Iterable[str]) -> tuple[tuple[str, str], ...]:
    """The words that tell what is no measurement, each with its sentence."""
    return tuple(
        (ORIGIN_WORDS.get(origin, origin.upper()), _ORIGIN_SENTENCES.get(origin, ""))
        for origin in dict.fromkeys(origins)
        if origin != "hardware"
    )


def _report_number(fits: Sequence[Fit]) -> str:
    """A number that follows from what is reported: the same runs and results give the same number."""
    digest = hashlib.sha256()
    for fit in fits:
        result = fit.result
        digest.update(f"{result.run}|{result.kind}|{fit.recording.metadata.sha256}|".encode())
        digest.update("|".join(f"{n}={e.value:.9g}" for n, e in result.estimates.items()).encode())
    return "HR-" + digest.hexdigest()[:10].upper()


def overall(verdict: GearVerdict, fits: Sequence[Fit] = ()) -> State:
    """The verdict in a word and a sentence; a run that did not reach its end is said, never passed over."""
    limits = len(verdict.lines)
    sentence = {
        "PASS": f"{'One limit' if limits == 1 else f'{limits} limits'} kept with the whole expanded uncertainty.",
        "MARGINAL": "At least one limit is neither kept nor broken for certain: it lies inside the expanded "
        "uncertainty of the value, or it is a lower one of a number that may be zero.",
        "FAIL": "At least one quantity breaks its limit by more than its expanded uncertainty.",
        "NOT JUDGED": "Nothing is claimed of the gear; the values stand for themselves.",
    }[verdict.verdict]
    because = phrase(" {}.", capital("; ".join(verdict.because)))
    broken = [f.recording.metadata for f in fits if f.recording.metadata.outcome in UNFINISHED]
    runs = ", ".join(f"{m.run_id} ({m.outcome})" for m in broken)
    unfinished = phrase(" Not every run reached its end: {}.", runs)
    tone = tone_of(verdict.verdict) or "muted"
    return State(verdict.verdict, sentence + because + unfinished, tone)


def verdict_grid(verdict: GearVerdict) -> Grid:
    """Every limit with what it was held against, as `judge` said it."""
    heads = columns(
        ("quantity", "quantity"),
        ("value ± U (95 %)", "number"),
        ("limit", "number"),
        "definition and source of the limit",
        ("verdict", "word"),
    )
    rows = [
        (readable(line.name), *held_against(line), _source(line), line.outcome)
        for line in verdict.lines
    ]
    decides = "".join(f" Next: {sentence}" for sentence in verdict.next_steps)
    return Grid("Judged quantities", heads, rows, DECISION_RULE + decides)


def _source(line: Verdict) -> str:
    doubts = "; ".join(words for words in (line.because, line.rests_on) if words)
    return f"{line.quantity.definition}; {whose_limit(line)}{phrase(' ({})', doubts)}"


def _file_grid(fits: Sequence[Fit]) -> Grid:
    """The run files that the report rests on, the tares among them, with their hashes whole."""
    recordings = [r for f in fits for r in (f.recording, f.tare and f.tare.recording) if r]
    files = {r.metadata.run_id: r.metadata for r in recordings}
    rows = tuple(
        (m.run_id, m.outcome or "not stated", seal_words(m.is_sealed), m.sha256)
        for _, m in sorted(files.items())
    )
    return run_files(rows)


def run_files(rows: Sequence[tuple[str, str, str, str]]) -> Grid:
    """The table of run files: run, outcome, seal, hash."""
    heads = columns("run", "outcome", "seal", ("SHA-256 of the run file", "hash"))
    return Grid("Run files", heads, rows)


def seal_words(is_sealed: bool) -> str:
    """Whether the hash of a file is the one that was noted when it was sealed."""
    return "sealed" if is_sealed else "NOT SEALED"


def part_of(fit: Fit, index: int, title: str) -> Section:
    """One analysed run for the page, its figures still to be drawn."""
    result = fit.result
    orders = [name for name in result.estimates if _is_order(result, name)]
    if len(orders) < 8:
        orders = []
    others = [name for name in result.estimates if name not in orders]
    any_budget = any(e.budget for e in result.estimates.values())
    tables = [
        data_grid(t).without_empty() for t in result.tables if t.name != "budget" or not any_budget
    ]
    annex = (statistical_grid(result), *(grid for grid in tables if len(grid.rows) > _LONG_TABLE))
    return Section(
        anchor=f"part-{index + 1}",
        title=title,
        subtitle=f"Run {result.run}",
        warnings=(*doubts_of(fit), *result.warnings),
        grids=shown(
            estimate_grid(result, others).without_empty(),
            order_grid(result, orders),
            metric_grid(result),
            *(grid for grid in tables if len(grid.rows) <= _LONG_TABLE),
            budget_grid(result, others),
        ),
        annex=tuple(replace(grid, title=f"{title}: {grid.title}") for grid in shown(*annex)),
    )


def _numbers(fits: Sequence[Fit]) -> Iterator[Section]:
    """The gear by its card, as the model computes it, and as identified; nothing of a gear that nobody named."""
    grids = number_grids(fits)
    if grids:
        title = "The gear in numbers: card, computed, identified"
        yield Section(title=title, anchor="numbers", grids=grids)


def _is_order(result: Result, name: str) -> bool:
    """Whether an estimate is one of a series over orders, which stand in a table of their own."""
    return result.quantity(name).placeholder == "order"


def _key_results(fits: Sequence[Fit], most: int = 8) -> list[tuple[str, str, str, str]]:
    """The results that a reader looks for first: kind, quantity, value ± U, identifiable."""
    rows = []
    for result in (fit.result for fit in fits):
        names = key_names(result.quantities, result.estimates)
        names = names or tuple(n for n in result.estimates if not _is_order(result, n))
        for name in names[:most]:
            e, quantity = result.estimates[name], result.quantity(name)
            value = show(e, quantity).with_uncertainty
            rows.append((result.kind, quantity.titled(name), value, e.identifiable))
    return rows


def key_grid(rows: Sequence[tuple[str, str, str, str]]) -> Grid:
    """Those results as a table."""
    heads = columns(
        "test", ("quantity", "quantity"), ("value ± U (95 %)", "number"), ("identifiable", "word")
    )
    return Grid("Summary", heads, rows)


def program_version() -> str:
    """Name and version of the program that made the report."""
    return f"harmonic-rig {version()}"


def run_line(runs: Sequence[str]) -> str:
    """The runs that a report is of, for the foot of every page: their numbers, or how many and the
    first and the last.
    """
    named = sorted(set(runs))
    if not named:
        return ""
    if len(named) == 1:
        return shortened(f"Run {named[0]}", LONGEST_LINE)
    line = f"Runs {', '.join(named)}"
    if len(line) <= LONGEST_LINE:
        return line
    most = LONGEST_LINE // 2 - 8
    return f"{len(named)} runs, {shortened(named[0], most)} to {shortened(named[-1], most)}"


def _place(fit: Fit) -> tuple[int, str]:
    """Parts stand in the order of the catalogue, behind all of it what it does not have."""
    kind = fit.result.kind
    return [*experiments_catalogue.kinds(), kind].index(kind), fit.recording.metadata.start_time


def _alarms(sources: Sequence[Provenance], serials: Sequence[str]) -> tuple[str, ...]:
    """What stands loudly at the top: doubtful scales, and runs of more than one gear under one verdict."""
    alarms = dict.fromkeys(alarm for one in sources for alarm in one.alarms)
    if len(serials) > 1:
        alarms[
            f"These runs are of more than one gear ({', '.join(serials)}): the verdict covers them together."
        ] = None
    return tuple(alarms)


def _truth(truth: Sequence[tuple[str, TruthRow]], results: Sequence[Result]) -> Iterator[Section]:
    """What was found against what the simulated rig was built from."""
    if not truth:
        return
    covered, within = sum(r.covered for _, r in truth), sum(r.within for _, r in truth)
    text = (
        f"The simulated rig knows what it was built from. Of {len(truth)} rows {covered} have what this "
        f"bench sees in the statistical part, {within} have the measurand within ± U; of many, about one in "
        "twenty should not. The measurand is the gear or the motor alone, at the run's temperature. "
        "What this bench sees has its output bearing in the friction, all torque read through the scale "
        "error of the torque port, and the errors of both encoders and of the mounting in the kinematic error."
    )
    grid = truth_grid(truth, results)
    yield Section(title=grid.title, anchor="truth", text=text, grids=(grid,))


def _parts(
    fits: Sequence[Fit], models: Sequence[Validation]
) -> tuple[list[Section], list[tuple[Figure, Plot]]]:
    parts, drawn = [], []
    last = {fit.result.kind: index for index, fit in enumerate(fits)}
    for index, fit in enumerate(fits):
        judged = [m for m in models if last[m.kind] == index]
        plots = (*fit.result.plots, *(m.plot() for m in judged))
        here = figures_of(plots, fit.recording.metadata.origin, len(drawn))
        drawn += here
        part = part_of(fit, index, _title(fit, fits))
        grids = (*part.grids, *(data_grid(m.table()) for m in judged))
        parts.append(replace(part, figures=tuple(f for f, _ in here), grids=grids))
    return parts, drawn


def _title(fit: Fit, fits: Sequence[Fit]) -> str:
    title = definitions.title_of(fit.result.kind)
    same = [f for f in fits if f.result.kind == fit.result.kind]
    return f"{title}, run {fit.result.run}" if len(same) > 1 else title


def drawn(plot: Plot, origin: str, number: int, *, half: bool = False, after: str = "") -> Figure:
    """A plot as a figure with its caption."""
    size = figures.HALF_WIDTH if half else figures.FULL_WIDTH
    drawing = figures.draw_svg(plot, origin, f"f{number}", size)
    note = " ".join(part for part in (plot.note, *drawing.remarks) if part)
    return Figure(
        number=number, svg=drawing.svg, title=plot.title, after=after, note=note, half=half
    )


def figures_of(plots: Sequence[Plot], origin: str, before: int) -> list[tuple[Figure, Plot]]:
    """Plots of runs of one origin as figures, numbered after `before`; three or more of one figure of
    the paper stand two in a row.
    """
    siblings: dict[str, int] = defaultdict(int)
    for plot in plots:
        siblings[plot.figure] += bool(plot.figure)
    figures_and_plots = []
    begun: set[str] = set()
    for number, plot in enumerate(plots, before + 1):
        is_odd_one = siblings[plot.figure] % 2 and plot.figure not in begun
        half = siblings[plot.figure] >= 3 and not is_odd_one
        begun.add(plot.figure)
        after = phrase("cf. figure {} of the paper", plot.figure)
        figures_and_plots.append((drawn(plot, origin, number, half=half, after=after), plot))
    return figures_and_plots


def _paper_grid(figures_and_plots: Sequence[tuple[Figure, Plot]], *, whole: bool) -> Grid:
    """The paper's figures: the number of each, what it shows, and the figures here; `whole` also what is missing."""
    rows = []
    for figure, kind in definitions.paper_figures():
        number = str(figure.number)
        here = [
            str(f.number) for f, plot in figures_and_plots if number in _figure_numbers(plot.figure)
        ]
        if here or whole:
            words = phrase("Figure {}", ", ".join(here)) or f"needs a {kind} run"
            rows.append((number, figure.shows, words))
    heads = columns(("paper", "number"), "what it shows", ("here", "figure"))
    return Grid("Figures after the paper", heads, rows)


def _figure_numbers(text: str) -> set[str]:
    """The numbers named in a plot's `figure`: "12", "12-13", "9, 17"."""
    numbers: set[str] = set()
    for first, last in re.findall(r"(\d+)(?:\s*[-–]\s*(\d+))?", text):
        numbers |= {str(n) for n in range(int(first), int(last or first) + 1)}
    return numbers


def _heading(gears: Sequence[HarmonicDrive], serials: Sequence[str], fits: Sequence[Fit]) -> str:
    """What was tested: the gear, the motor alone, or the recordings where nobody said which gear it is."""
    if gears:
        names = ", ".join(gear.name for gear in gears)
        return f"Harmonic drive {names}, serial {', '.join(serials) or 'not stated'}"
    runs = dict.fromkeys(f.recording.metadata.title or f.recording.metadata.run_id for f in fits)
    named = ", ".join(runs)
    return named if _mounted(fits) else f"Bare motor, {named}"


_NOT_SIGNED = {
    "marked": "This report holds runs marked {runs}. There is no room for a signature on it.",
    "unsealed": "Not sealed, so that it could still change: {runs}. It is not signed.",
    "unfinished": "Not every run reached its end; an incomplete test is not signed.",
}
"""Why there is no room for a signature."""


def signature_of(fits: Sequence[Fit], said: Callable[[str], str] = str) -> Signature:
    """Only runs from hardware, sealed and brought to their end, all of them, are signed; `said` is another language's
    sentence for one of `_NOT_SIGNED`.
    """
    runs = [fit.recording.metadata for fit in fits]
    words = ", ".join(word for word, _ in marks_of(m.origin for m in runs))
    if words:
        return Signature(False, said(_NOT_SIGNED["marked"]).format(runs=words))
    unsealed = ", ".join(m.run_id for m in runs if not m.is_sealed)
    if unsealed:
        return Signature(False, said(_NOT_SIGNED["unsealed"]).format(runs=unsealed))
    if any(m.outcome in UNFINISHED for m in runs):
        return Signature(False, said(_NOT_SIGNED["unfinished"]))
    return Signature(True)
