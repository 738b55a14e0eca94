"""The report: one self-contained HTML page that a laboratory can send out, made from fits.

Verdict first, then warnings, results with the paper's figures, conditions, uncertainty, provenance,
definitions. Nothing is loaded from elsewhere; everything that comes from files is escaped. Runs
that do not come from hardware are marked on every figure and cannot be signed.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments import catalogue as experiments_catalogue
from experiments.result import DECISION_RULE, Plot
from rig.analysis.judging import GearVerdict
from rig.analysis.rows import truth_grid
from rig.content.data import data_grid
from rig.content.grid import capital, tone_of
from rig.content.wording import printable, unbroken
from rig.errors import RigError
from rig.present import catalogue, content, definitions, provenance
from rig.present import figure as figures

if TYPE_CHECKING:
    from experiments.truth import TruthRow
    from model.gear import HarmonicDrive
    from rig.analysis.fit import Fit
    from rig.analysis.validate import Validation

TEMPLATE, STYLE = "page.html", "page.css"

ORIGIN_SENTENCES = {
    "simulated": "Made on a simulated rig with a simulated gear. "
    "This is no measurement of a physical gear, stays out of any gear's history and cannot be signed.",
    "replay": "Made by playing back a recorded run. It is no new measurement and cannot be signed.",
    "imported": "Made from a recording of another rig, whose calibration this program has not seen. "
    "It cannot be signed.",
}


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A drawing in the page with its number and caption."""

    number: int
    anchor: str
    svg: Any
    title: str
    after: str
    note: str
    half: bool


@dataclass(frozen=True)
class Signature:
    """Who may sign: only runs from hardware, all of them."""

    allowed: bool
    reason: str = ""


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
    context = report_context(fits, created=created, verdict=verdict, truth=truth, note=note)
    return write_context(context, path)


def write_context(context: dict[str, Any], path: str | Path) -> Path:
    """Write the content of a report as HTML or, by its suffix, as PDF. Raises `RigError` for a file
    that cannot be written.
    """
    path = Path(path)
    page = rendered(context, path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(page)
    except OSError as error:
        raise RigError(
            "the report cannot be written",
            where=str(path),
            value=error.strerror or str(error),
            remedy="Choose another --output.",
        ) from None
    return path


def rendered(context: dict[str, Any], path: Path) -> bytes:
    """The content of a report as PDF or HTML, by the suffix of its path. Raises `RigError`."""
    if path.suffix.lower() != ".pdf":
        return render_page(context).encode("utf-8")
    from rig.present.paper import render_pdf

    return render_pdf(context)


def report_context(
    fits: Sequence[Fit],
    *,
    created: str,
    verdict: GearVerdict,
    truth: Sequence[tuple[str, TruthRow]] = (),
    note: str = "",
    models: Sequence[Validation] = (),
) -> dict[str, Any]:
    """Everything that a report shows, on screen and on paper: each number is worded once, here.

    `models` of a kind stand with the last of its runs.
    """
    if not fits:
        raise RigError("there is nothing to report", remedy="Name at least one run.")
    ordered = sorted(fits, key=_place)
    return {"created": created, "note": note, **_context(ordered, verdict, truth, models)}


def render_page(context: dict[str, Any]) -> str:
    """The HTML of a report's content."""
    import jinja2
    from markupsafe import Markup

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("rig", "present"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_finalize,
    )
    environment.filters["css"] = lambda text: Markup(css_text(text))
    environment.filters["headed"] = lambda text: capital(unbroken(text))
    environment.filters["tone"] = lambda text: tone_of(text) or ""
    environment.filters["symbols"] = lambda text: Markup(
        _symbols(str(Markup.escape(printable(text))))
    )
    style = environment.get_template(STYLE).render()
    return environment.get_template(TEMPLATE).render(style=Markup(style), **context)


def css_text(text: str) -> str:
    """A text as a string of a style sheet, letter for letter: whatever is no plain letter goes by its number."""
    plain = "".join(
        c if c.isascii() and (c.isalnum() or c in " ,.-_") else f"\\{ord(c):x} "
        for c in printable(text)
    )
    return f'"{plain}"'


_SYMBOL = re.compile(r"\b((?:[^\W\d_]/)?[^\W\d_])_([A-Za-z0-9]{1,4})\b")


def _symbols(escaped: str) -> str:
    """Symbols of the paper as they are printed: what follows the underscore of a single letter
    stands below the line.
    """
    return _SYMBOL.sub(r"<i>\1</i><sub>\2</sub>", escaped)


def _finalize(value: Any) -> Any:
    """Texts without control characters; markup of ours as it is."""
    return printable(value) if type(value) is str else value


LONGEST_LINE = 124
"""Letters of run numbers that fit on the foot of a page."""


def run_line(runs: Sequence[str]) -> str:
    """The runs that a report is of, for the foot of every page: their numbers, or how many and the
    first and the last.
    """
    named = sorted(set(runs))
    line = ("Run " if len(named) == 1 else "Runs ") + ", ".join(named)
    if len(line) <= LONGEST_LINE or not named:
        return line if named else ""
    if len(named) == 1:
        return _cut(line, LONGEST_LINE)
    most = LONGEST_LINE // 2 - 8
    return f"{len(named)} runs, {_cut(named[0], most)} to {_cut(named[-1], most)}"


def _cut(text: str, most: int) -> str:
    """A text of no more letters than that; that something is cut off is seen."""
    return text if len(text) <= most else f"{text[: most - 1]}…"


def _place(fit: Fit) -> tuple[int, str]:
    """Parts stand in the order of the catalogue."""
    kinds, kind = experiments_catalogue.kinds(), fit.result.kind
    place = kinds.index(kind) if kind in kinds else len(kinds)
    return place, fit.recording.metadata.start_time


def _context(
    fits: Sequence[Fit],
    verdict: GearVerdict,
    truth: Sequence[tuple[str, TruthRow]],
    models: Sequence[Validation],
) -> dict[str, Any]:
    """Everything that the template shows."""
    results = [f.result for f in fits]
    number = content.report_number(results, [f.recording.metadata.sha256 for f in fits])
    mounted = [f for f in fits if f.recording.metadata.gear_mounted] or list(fits)
    parts, all_figures = _parts(fits, models)
    origins = list(dict.fromkeys(f.recording.metadata.origin for f in fits))
    warnings = [(p.title, p.anchor, p.run, w) for p in parts for w in p.warnings]
    serials = list(dict.fromkeys(f.recording.metadata.gear_serial for f in mounted))
    gears = list({f.gear.name: f.gear for f in mounted if f.gear_known}.values())
    return {
        "number": number,
        "gear_name": ", ".join(g.name for g in gears) or "not stated",
        "heading": _heading(gears, serials, fits),
        "serial": ", ".join(s for s in serials if s) or "not stated",
        "operators": ", ".join(
            dict.fromkeys(f.recording.metadata.operator or "not stated" for f in fits)
        ),
        "dates": _dates(fits),
        "words": [w for w in (figures.WATERMARKS.get(o, o.upper()) for o in origins) if w],
        "origin_sentences": [ORIGIN_SENTENCES[o] for o in origins if o in ORIGIN_SENTENCES],
        "subtitle": " · ".join(p.title for p in parts),
        "overall": content.overall(verdict, fits),
        "states": (content.overall(verdict, fits),),
        "verdicts": content.verdict_lines(verdict),
        "decision_rule": DECISION_RULE,
        "alarms": _alarms(parts, [s for s in serials if s]),
        "catalogue": catalogue.catalogue_grid(fits, [p.provenance.conditions for p in parts]),
        "files": content.file_grid(fits),
        "run_line": run_line([f.recording.metadata.run_id for f in fits]),
        "warnings": warnings,
        "parts": parts,
        "conditions": provenance.side_by_side([(p.title, p.provenance.conditions) for p in parts]),
        "calibrations": provenance.side_by_side(
            [(p.title, p.provenance.calibrations) for p in parts]
        ),
        "identities": provenance.side_by_side(
            [(p.title, p.provenance.rows) for p in parts], "Runs"
        ),
        "conventions": provenance.side_by_side(
            [(p.title, p.provenance.options) for p in parts], "Conventions of the analyses"
        ),
        "settings": provenance.side_by_side(
            [(p.title, p.provenance.settings) for p in parts],
            "Parameters of the protocols and settings of the analyses",
        ),
        "truth": truth_grid(truth, results) if truth else None,
        "truth_note": _truth_note(truth),
        "paper_figures": [row for row in paper_figure_rows(all_figures) if row[2] or len(fits) > 1],
        "run_word": "Run",
        "annex_title": "parameter set with its sources",
        "parameter_sets": content.parameter_grids(fits),
        "definitions": definitions.definitions_for(r.kind for r in results),
        "not_measured": definitions.NOT_MEASURED,
        "paper": definitions.PAPER,
        "signature": signature_of(origins, fits),
        "version": content.program_version(),
        "key_results": content.key_results(fits),
    }


def _alarms(parts: Sequence[content.Part], serials: Sequence[str]) -> tuple[str, ...]:
    """What stands loudly at the top: doubtful scales, and runs of more than one gear under one verdict."""
    alarms = dict.fromkeys(alarm for p in parts for alarm in p.provenance.alarms)
    if len(serials) > 1:
        alarms[
            f"These runs are of more than one gear ({', '.join(serials)}): the verdict covers them together."
        ] = None
    return tuple(alarms)


def _truth_note(truth: Sequence[tuple[str, TruthRow]]) -> str:
    if not truth:
        return ""
    covered, within = sum(r.covered for _, r in truth), sum(r.within for _, r in truth)
    return (
        f"The simulated rig knows what it was built from. Of {len(truth)} rows {covered} have what this "
        f"bench sees in the statistical part, {within} have the measurand within ± U; of many, about one in "
        "twenty should not. The measurand is the gear or the motor alone, at the run's temperature. "
        "What this bench sees has its output bearing in the friction, all torque read through the scale "
        "error of the torque port, and the errors of both encoders and of the mounting in the kinematic error."
    )


def _parts(
    fits: Sequence[Fit], models: Sequence[Validation]
) -> tuple[tuple[content.Part, ...], list[tuple[Figure, Plot]]]:
    parts, all_figures = [], []
    last = {fit.result.kind: index for index, fit in enumerate(fits)}
    for index, fit in enumerate(fits):
        judged = [m for m in models if last[m.kind] == index]
        plots = (*fit.result.plots, *(m.plot() for m in judged))
        figures_and_plots = figures_of(plots, fit.recording.metadata.origin, len(all_figures))
        all_figures += figures_and_plots
        part = content.part_of(fit, index, _title(fit, fits))
        parts.append(
            replace(
                part,
                figures=tuple(f for f, _ in figures_and_plots),
                grids=(*part.grids, *(data_grid(m.table()) for m in judged)),
            )
        )
    return tuple(parts), all_figures


def _title(fit: Fit, fits: Sequence[Fit]) -> str:
    title = definitions.title_of(fit.result.kind)
    same = [f for f in fits if f.result.kind == fit.result.kind]
    return f"{title}, run {fit.result.run}" if len(same) > 1 else title


def figures_of(plots: Sequence[Plot], origin: str, before: int) -> list[tuple[Figure, Plot]]:
    """Plots of runs of one origin as figures, numbered after `before`; three or more of one figure of
    the paper stand two in a row.
    """
    from markupsafe import Markup

    siblings: dict[str, int] = defaultdict(int)
    for plot in plots:
        siblings[plot.figure] += bool(plot.figure)
    figures_and_plots = []
    begun: set[str] = set()
    for number, plot in enumerate(plots, before + 1):
        half = siblings[plot.figure] >= 3 and not (
            siblings[plot.figure] % 2 and plot.figure not in begun
        )
        begun.add(plot.figure)
        size = figures.HALF_WIDTH if half else figures.FULL_WIDTH
        drawing = figures.draw_svg(plot, origin, f"f{number}", size)
        after = f"cf. figure {plot.figure} of the paper" if plot.figure else ""
        note = " ".join(part for part in (plot.note, *drawing.remarks) if part)
        figures_and_plots.append(
            (
                Figure(
                    number=number,
                    anchor=f"figure-{number}",
                    svg=Markup(drawing.svg),
                    title=plot.title,
                    after=after,
                    note=note,
                    half=half,
                ),
                plot,
            )
        )
    return figures_and_plots


def paper_figure_rows(
    figures_and_plots: Sequence[tuple[Figure, Plot]],
) -> list[tuple[str, str, list[Figure], str]]:
    """Each of the paper's figures: its number, what it shows, the figures here, and what is missing."""
    rows = []
    for figure, kind in definitions.paper_figures():
        number = str(figure.number)
        here = [f for f, plot in figures_and_plots if number in _figure_numbers(plot.figure)]
        rows.append((number, figure.shows, here, "" if here else f"needs a {kind} run"))
    return rows


def _figure_numbers(text: str) -> set[str]:
    """The numbers named in a plot's `figure`: "12", "12-13", "9, 17"."""
    numbers: set[str] = set()
    for first, last in re.findall(r"(\d+)(?:\s*[-–]\s*(\d+))?", text):
        numbers |= {str(n) for n in range(int(first), int(last or first) + 1)}
    return numbers


def _heading(gears: Sequence[HarmonicDrive], serials: Sequence[str], fits: Sequence[Fit]) -> str:
    """What was tested: the gear, or the recordings where nobody said which gear it is."""
    if gears:
        serial = ", ".join(s for s in serials if s) or "not stated"
        return f"Harmonic drive {', '.join(g.name for g in gears)}, serial {serial}"
    runs = dict.fromkeys(f.recording.metadata.title or f.recording.metadata.run_id for f in fits)
    return ", ".join(runs)


def _dates(fits: Sequence[Fit]) -> str:
    days = sorted(
        {f.recording.metadata.start_time[:10] for f in fits if f.recording.metadata.start_time}
    )
    if not days:
        return "not stated"
    return days[0] if len(days) == 1 else f"{days[0]} to {days[-1]}"


def signature_of(origins: Sequence[str], fits: Sequence[Fit]) -> Signature:
    if any(o != "hardware" for o in origins):
        words = ", ".join(figures.WATERMARKS.get(o, o.upper()) for o in origins if o != "hardware")
        return Signature(
            False, f"This report holds runs marked {words}. There is no room for a signature on it."
        )
    unsealed = [f.recording.metadata.run_id for f in fits if not f.recording.metadata.is_sealed]
    if unsealed:
        return Signature(
            False,
            f"Not sealed, so that it could still change: {', '.join(unsealed)}. It is not signed.",
        )
    if any(f.recording.metadata.outcome in content.UNFINISHED for f in fits):
        return Signature(False, "Not every run reached its end; an incomplete test is not signed.")
    return Signature(True)
