"""Page one of a certificate: what was tested, one sentence, the verdict, its values, two curves, conditions, hashes."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from experiments.assumed import TABLE as ASSUMED
from experiments.assumed import assumed_kinds
from experiments.quantity import key_names
from experiments.result import DECISION_RULE, Plot, Series, Verdict
from model.identify.estimate import Estimate
from rig.analysis.fit import Fit
from rig.analysis.gear_set import set_sha256
from rig.analysis.judging import held_against, whose_limit
from rig.analysis.rows import coverage
from rig.content.grid import Grid, columns, tone_of
from rig.content.wording import days_text, number, show
from rig.present import definitions, provenance
from rig.present import figure as figures
from rig.present.certificate.gather import Certified, acceptance_sha256
from rig.present.certificate.laboratory import LaboratoryWords
from rig.program import Program, this_program
from rig.runfile.manifest import Manifest
from rig.runfile.prevailing import conditions_of

VALUES = 5
"""Lines of page one: every judged one, and until there are so many the first key quantity of every kind in turn."""
NO_LIMIT = "not listed"
"""What stands in the place of a verdict where the acceptance file says nothing of a quantity."""
CURVES = (
    ("kinematic-error", "kinematic-error-fit", (6.85, 1.1)),
    ("friction", "friction-curve", (6.85, 1.85)),
)
"""The curves of page one: kind, name of the figure, width and height of its first panel [inch]."""
COUNTED = {
    "PASS": "keeps all {all} limits of the acceptance file {name}",
    "MARGINAL": "breaks none of the {all} limits of the acceptance file {name} for certain, but does not keep {bad} of "
    "them for certain",
    "FAIL": "breaks {bad} of the {all} limits of the acceptance file {name}",
}


@dataclass(frozen=True, kw_only=True)
class Curve:
    """One curve of page one: its drawing, and what it shows."""

    svg: str
    title: str


def front_page(
    gathered: Certified, laboratory: LaboratoryWords, manifest: Manifest
) -> dict[str, Any]:
    """What page one shows, as plain values, tables and drawings; `manifest` is that of what it rests on."""
    verdict = gathered.verdict
    return {
        "laboratory": _laboratory(laboratory),
        "tested": _tested(gathered),
        "facts": _facts(gathered, laboratory),
        "word": verdict.verdict,
        "tone": tone_of(verdict.verdict) or "muted",
        "sentence": sentence_of(gathered),
        "because": list(verdict.because) if verdict.verdict != "PASS" else [],
        "incomplete": _incomplete(gathered),
        "rule": DECISION_RULE,
        "values": value_grid(gathered),
        "curves": [asdict(curve) for curve in _curves(gathered.fits)],
        "conditions": prevailed(gathered),
        "hashes": _hash_grid(gathered, manifest),
        "remarks": _remarks(gathered),
    }


def _laboratory(laboratory: LaboratoryWords) -> dict[str, Any]:
    logo = laboratory.logo
    media = {"png": "image/png", "jpg": "image/jpeg", "svg": "image/svg+xml"}
    source = (
        f"data:{media[logo.format]};base64,{base64.b64encode(logo.content).decode()}"
        if logo
        else ""
    )
    return {
        "name": laboratory.name,
        "address": laboratory.address,
        "logo": source,
        "logo_bytes": list(logo.content) if logo else [],
        "logo_format": logo.format if logo else "",
    }


def _tested(gathered: Certified) -> str:
    """What was tested, in one line."""
    fit = _of_gear(gathered)
    metadata = fit.recording.metadata
    name = fit.gear.name if fit.gear_known else "of a type that nobody stated"
    mounting = metadata.mounting.replace("-", " ")
    ratio = number(metadata.ratio) if math.isfinite(metadata.ratio) else "not stated"
    return f"Harmonic drive {name}, serial number {gathered.serial}, ratio {ratio}, {mounting}"


def _of_gear(gathered: Certified) -> Fit:
    """A run with the gear mounted."""
    mounted = [fit for fit in gathered.fits if fit.recording.metadata.gear_mounted]
    return (mounted or gathered.fits)[0]


def _facts(gathered: Certified, laboratory: LaboratoryWords) -> list[tuple[str, str]]:
    """Customer, order, method, days and operators: who wanted it, and who did it."""
    span = days_text(fit.recording.metadata.start_time for fit in gathered.fits)
    operators = dict.fromkeys(
        fit.recording.metadata.operator or "not stated" for fit in gathered.fits
    )
    facts = [
        ("Customer", laboratory.customer),
        ("Order", laboratory.order),
        ("Method", laboratory.method),
        ("Tested on", span),
        ("Tested by", ", ".join(operators)),
    ]
    return [(name, text) for name, text in facts if text]


def sentence_of(gathered: Certified) -> str:
    """The verdict in one plain sentence."""
    verdict, acceptance = gathered.verdict, gathered.acceptance
    gear = f"The gear {gathered.serial}"
    if verdict.verdict == "NOT JUDGED" or acceptance is None:
        return f"{gear} is not judged: {verdict.because[0] if verdict.because else 'nothing was held against a limit'}."
    bad = sum(line.outcome == verdict.verdict for line in verdict.lines)
    words = COUNTED[verdict.verdict].format(all=len(verdict.lines), bad=bad, name=acceptance.name)
    return f"{gear} {words}."


def _incomplete(gathered: Certified) -> str:
    if gathered.is_complete:
        return ""
    missing = ", ".join(gathered.missing)
    return f"What was asked for is not all there: no analysed run of {missing}."


def value_grid(gathered: Certified) -> Grid:
    """Quantity, value ± U, k, degrees of freedom, limit and verdict; what is judged comes first."""
    rows = [_judged_row(line) for line in gathered.verdict.lines]
    told = {(line.kind, line.estimate.name) for line in gathered.verdict.lines}
    for fit, estimate in _others(gathered.fits, told):
        if len(rows) >= VALUES:
            break
        quantity = fit.result.quantity(estimate.name)
        value = show(estimate, quantity).with_uncertainty
        rows.append((quantity.headed(estimate.name), value, *coverage(estimate), "–", NO_LIMIT))
    heads = columns(
        ("quantity", "quantity"),
        ("value ± U (95 %)", "number"),
        ("k", "number"),
        ("ν", "number"),
        ("limit", "number"),
        ("verdict", "word"),
    )
    sources = dict.fromkeys(whose_limit(line) for line in gathered.verdict.lines)
    limits = f" Limits: {'; '.join(sources)}." if sources else ""
    note = f"U = k u covers 95 %; ν: effective degrees of freedom of u.{limits}"
    return Grid("", heads, rows, note)


def _judged_row(line: Verdict) -> tuple[str, ...]:
    value, limit = held_against(line)
    title = line.quantity.headed(line.estimate.name)
    return (title, value, *coverage(line.estimate), limit, line.outcome)


def _others(fits: Sequence[Fit], told: set[tuple[str, str]]) -> Iterator[tuple[Fit, Estimate]]:
    """Key quantities that are not judged: the first of every kind in turn, then the second, and so on."""
    queues = [
        [
            (fit, fit.result.estimates[name])
            for name in key_names(fit.result.quantities, fit.result.estimates)
            if (fit.result.kind, name) not in told
            and fit.result.estimates[name].identifiable != "no"
        ]
        for fit in fits
        if fit.recording.metadata.gear_mounted
    ]
    for place in range(max(map(len, queues), default=0)):
        yield from (queue[place] for queue in queues if place < len(queue))


def _curves(fits: Sequence[Fit]) -> Iterator[Curve]:
    """The curves of page one that there are runs for."""
    for kind, name, size in CURVES:
        for fit in fits:
            plot = next((p for p in fit.result.plots if p.name == name), None)
            if fit.result.kind != kind or plot is None:
                continue
            origin = fit.recording.metadata.origin
            drawing = figures.draw_svg(_without_residuals(plot), origin, f"front-{kind}", size)
            yield Curve(svg=drawing.svg, title=plot.title)


def _without_residuals(plot: Plot) -> Plot:
    """A figure for little room: without the panel of what a fit leaves, each word of the legend once."""
    kept = [k for k, panel in enumerate(plot.panels, 1) if "residual" not in panel.y_label]
    series = [s for s in plot.series if not s.panel or s.panel in kept]
    return replace(
        plot,
        series=tuple(_said_once(series)),
        panels=tuple(plot.panels[k - 1] for k in kept),
        note="",
    )


def _said_once(series: Sequence[Series]) -> Iterator[Series]:
    said: set[str] = set()
    for one in series:
        word = one.label.partition(",")[0]
        yield replace(one, label="" if word in said else word)
        said.add(word)


def prevailed(gathered: Certified) -> list[tuple[str, str]]:
    """What prevailed, kind by kind in one line, and what was subtracted."""
    lines = []
    for fit in gathered.fits:
        facts = {one.title: one.text for one in conditions_of(fit.recording, None)}
        names = ("input speeds", "wave-generator positions", "housing temperature", "lubricant")
        words = [f"{name} {facts[name]}" for name in names if facts.get(name)]
        tare = provenance.tare_of(fit)
        subject = str(fit.result.options.get("torque_is_of", ""))
        words += [f"torque of {subject}"] if subject else []
        words += [f"tare {tare}"] if tare != "none" else []
        lines.append((definitions.title_of(fit.result.kind), "; ".join(words)))
    return lines


def _hash_grid(gathered: Certified, manifest: Manifest) -> Grid:
    """Run files, tares, parameter sets, acceptance file, program and manifest with their SHA-256."""
    rows = [
        (f"run, {fit.result.kind}", fit.recording.metadata.run_id, fit.recording.metadata.sha256)
        for fit in gathered.fits
    ]
    listed = {row[2] for row in rows}
    for fit in gathered.fits:
        tare = fit.tare_as_json()
        if tare and tare["sha256"] not in listed:
            rows.append(("tare", str(tare["run"]), str(tare["sha256"])))
            listed.add(tare["sha256"])
    rows += dict.fromkeys(_gear_set(fit) for fit in gathered.fits if fit.gear_known)
    if gathered.acceptance is not None:
        acceptance = gathered.acceptance
        name = Path(acceptance.path).name
        rows.append(("acceptance file", name, acceptance_sha256(acceptance)))
    program = this_program()
    rows.append(("program", _named(program), program.sha256))
    rows.append(("manifest", "all that this rests on", manifest.sha256))
    return Grid("", columns("what", "name", ("SHA-256", "hash")), rows)


def _named(program: Program) -> str:
    """A program by version and commit, short enough for a cell of a table."""
    return program.in_words().partition(", files")[0]


def _gear_set(fit: Fit) -> tuple[str, str, str]:
    """The set that an analysis leaned on, before anything identified was written into it."""
    noted = fit.gear_source.sha256
    return "parameter set", fit.gear.name, noted or set_sha256(fit.gear)


def _remarks(gathered: Certified) -> list[str]:
    """What makes the page doubtful: analyses without a seal, stale ones with the command that renews them, those by
    different programs, newer runs left away.
    """
    stale = [
        f"The {one.kind} analysis is stale ({'; '.join(one.stale)}); {one.renewed_by}"
        for one in gathered.analyses
        if one.stale
    ]
    return [
        *gathered.unsealed,
        *stale,
        *_assumed(gathered),
        *_different_programs(gathered),
        *gathered.passed_over,
    ]


def _assumed(gathered: Certified) -> Iterator[str]:
    """What nobody stated and was assumed in the budgets of what is judged: one line a kind, and what rests on it."""
    lines = gathered.verdict.lines
    for row in ASSUMED:
        if any(row.kind in assumed_kinds(line.estimate) for line in lines):
            yield f"Nobody stated the {row.kind}. {row.note[0].upper()}{row.note[1:]}."
    for line in lines:
        if line.rests_on:
            yield f"{line.quantity.headed(line.estimate.name)} {line.rests_on}."


def _different_programs(gathered: Certified) -> list[str]:
    """A sentence where the analyses were not all made by one program, with the analyses that each one made."""
    kinds: dict[str, list[str]] = {}
    for one in gathered.analyses:
        if one.analysis is not None:
            made_by = Program.from_json(one.analysis.content).in_words()
            kinds.setdefault(made_by, []).append(one.analysis.kind)
    if len(kinds) < 2:
        return []
    words = "; ".join(f"{', '.join(names)} by {program}" for program, names in kinds.items())
    return [f"The analyses were made by different programs: {words}."]
