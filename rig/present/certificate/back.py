"""Page two of a certificate: conditions, instruments, method, decision rule, uncertainty, hash, signatures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from experiments.assumed import TABLE as ASSUMED
from experiments.assumed import assumed_kinds
from rig.content.grid import Grid, columns
from rig.content.page import Signature
from rig.content.phrase import shortened
from rig.content.wording import number
from rig.present import definitions, provenance
from rig.present.certificate.gather import Certified
from rig.present.certificate.laboratory import LaboratoryWords
from rig.present.certificate.rests_on import brought_to
from rig.present.certificate.traceability import Instrument
from rig.present.certificate.words import Words
from rig.present.report import signature_of
from rig.program import Program
from rig.runfile.manifest import Manifest
from rig.runfile.prevailing import alarms_of, conditions_of

MOST_REMARKS, LONGEST_REMARK = 6, 260
_MOST_INSTRUMENTS = 8
_AMBIENT, _HOUSING = "ambient temperature", "housing temperature"
_PLACES = ("input speeds", "wave-generator positions")


@dataclass(frozen=True, kw_only=True)
class Back:
    """What page two shows."""

    conditions: tuple[tuple[str, str], ...]
    tests: Grid
    instruments: Grid
    paragraphs: tuple[tuple[str, str], ...]
    """Method, deviations, decision rule, uncertainty: name and words."""
    remarks: tuple[str, ...]
    manifest: str
    """SHA-256 of the list of what it rests on, in groups of eight."""
    rests_on: str
    scope: str
    signature: Signature


def back_of(
    gathered: Certified,
    laboratory: LaboratoryWords,
    manifest: Manifest,
    instruments: tuple[Instrument, ...],
    names: tuple[str, str],
) -> Back:
    """Page two; `names` are what the paper calls itself and the file of its manifest."""
    prevailed = {
        fit.result.kind: {one.title: one.text for one in conditions_of(fit.recording, None)}
        for fit in gathered.fits
    }
    kind, manifest_file = names
    words = laboratory.words
    return Back(
        conditions=tuple(_conditions(gathered, prevailed, words)),
        tests=_tests(gathered, prevailed, words),
        instruments=_instruments(instruments, words),
        paragraphs=tuple(_paragraphs(gathered, laboratory)),
        remarks=_remarks(gathered, words),
        manifest=" ".join(manifest.sha256[at : at + 8] for at in range(0, 64, 8)),
        rests_on=words.HASH.format(manifest=manifest_file),
        scope=words.SCOPE.format(kind=kind),
        signature=signature_of(gathered.fits, words.name),
    )


_Prevailed = dict[str, dict[str, str]]
"""What prevailed by kind and by what it is called."""


def _conditions(
    gathered: Certified, prevailed: _Prevailed, words: Words
) -> Iterator[tuple[str, str]]:
    told: dict[str, object] = {}
    for fit in gathered.fits:
        if fit.recording.metadata.gear_mounted:
            told |= fit.recording.metadata.conditions
    hours = told.get("hours")
    yield words.LUBRICANT, str(told.get("lubricant") or words.NOT_STATED)
    yield words.HOURS, words.NOT_STATED if hours is None else words.numbers(f"{number(hours)} h")
    warm = gathered.fit_of("warm-up")
    warmed = prevailed.get("warm-up", {})
    said = [warmed.get("input speeds", ""), warmed.get("duration", "").partition(" in ")[0]]
    text = words.named(", ".join(filter(None, said)))
    if warm and warm.recording.metadata.origin == "simulated":
        text = words.SIMULATED.format(text=text)
    yield words.WARM_UP, text if warm else words.NO_WARM_UP
    judged = {line.kind for line in gathered.verdict.lines} or prevailed.keys()
    ambient = dict.fromkeys(
        facts[_AMBIENT] for kind, facts in prevailed.items() if kind in judged and _AMBIENT in facts
    )
    yield words.AMBIENT, words.named("; ".join(ambient)) or words.NOT_STATED


def _tests(gathered: Certified, prevailed: _Prevailed, words: Words) -> Grid:
    """Each test that is judged with its day, what the rig was set to, and the temperature at which its values hold."""
    rows = []
    judged = {line.kind for line in gathered.verdict.lines}
    for fit in gathered.fits:
        if judged and fit.result.kind not in judged:
            continue
        facts = prevailed[fit.result.kind]
        speeds = next((facts[one] for one in _PLACES if facts.get(one)), "–")
        day = fit.recording.metadata.start_time[:10] or words.NOT_STATED
        housing = str(facts.get(_HOUSING) or words.NOT_STATED)
        tare = provenance.tare_of(fit)
        subject = words.name(str(fit.result.options.get("torque_is_of", ""))) or "–"
        if tare != "none":
            subject = words.TARE.format(subject=subject, tare=tare)
        title = words.name(definitions.title_of(fit.result.kind))
        rows.append((title, day, words.named(str(speeds)), words.named(housing), subject))
    heads = columns(*words.HEADS_TESTS)
    return Grid("", heads, rows, words.HOLDS_AT)


def _instruments(instruments: tuple[Instrument, ...], words: Words) -> Grid:
    rows = [
        tuple(
            cell or "–"
            for cell in (
                words.name(one.title),
                " ".join(filter(None, (words.name(one.device), one.serial))),
                words.name(one.certificate),
                one.laboratory,
                one.date,
                one.due + (f" ({one.doubt_in(words)})" if one.doubt and one.due else ""),
            )
        )
        for one in instruments[:_MOST_INSTRUMENTS]
    ]
    heads = columns(*words.HEADS_INSTRUMENTS)
    return Grid("", heads, rows)


def _paragraphs(gathered: Certified, laboratory: LaboratoryWords) -> Iterator[tuple[str, str]]:
    words = laboratory.words
    kinds = [definitions.title_of(fit.result.kind) for fit in gathered.fits]
    own = [words.names.get(kind) or kind.lower() for kind in kinds]
    titles = ", ".join(own)
    yield words.METHOD, laboratory.method or words.PROTOCOLS.format(protocols=titles)
    yield words.DEVIATIONS, laboratory.deviations or words.NO_DEVIATIONS
    yield words.RULE_NAME, words.RULE
    yield words.COVERAGE_NAME, words.COVERAGE


def _remarks(gathered: Certified, words: Words) -> tuple[str, ...]:
    """What makes the paper doubtful: scales, analyses without a seal, stale ones with the command that renews them,
    those by different programs, newer runs left away; what does not fit is counted.
    """
    stale = [
        words.STALE.format(kind=one.kind, why="; ".join(one.stale), renewed_by=one.renewed_by)
        for one in gathered.analyses
        if one.stale
    ]
    alarms = (alarm for fit in gathered.fits for alarm in alarms_of(fit.recording))
    remarks = dict.fromkeys(
        [
            *stale,
            *gathered.unsealed,
            *alarms,
            *_different_programs(gathered, words),
            *(words.ANOTHER_PACKAGE.format(name=one) for one in brought_to(gathered)),
            *gathered.passed_over,
            *_assumed(gathered, words),
        ]
    )
    cut = [shortened(one, LONGEST_REMARK) for one in remarks]
    if len(cut) > MOST_REMARKS:
        more = words.MORE_REASONS.format(count=len(cut) - MOST_REMARKS)
        cut = [*cut[:MOST_REMARKS], more]
    return tuple(cut)


def _assumed(gathered: Certified, words: Words) -> Iterator[str]:
    """What nobody stated and was assumed in the budgets of what is judged: one line a kind, and what rests on it."""
    lines = gathered.verdict.lines
    for row in ASSUMED:
        if any(row.kind in assumed_kinds(line.estimate) for line in lines):
            note = row.note[0].upper() + row.note[1:]
            yield words.NOBODY_STATED.format(kind=words.name(row.kind), note=note)
    for line in lines:
        if line.rests_on:
            yield f"{line.quantity.headed(line.estimate.name)} {line.rests_on}."


def _different_programs(gathered: Certified, words: Words) -> list[str]:
    """A sentence where the analyses were not all made by one program, with the analyses that each one made."""
    kinds: dict[str, list[str]] = {}
    for one in gathered.analyses:
        if one.analysis is not None:
            made_by = Program.from_json(one.analysis.content).in_words()
            kinds.setdefault(made_by, []).append(one.analysis.kind)
    if len(kinds) < 2:
        return []
    said = "; ".join(f"{', '.join(names)} by {program}" for program, names in kinds.items())
    return [words.DIFFERENT_PROGRAMS.format(said=said)]
