"""The certificate of a gear from the analyses in its folder: gathered, laid out, written as HTML and PDF."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from experiments.result import DECISION_RULE
from rig.analysis.judging import GearVerdict
from rig.errors import RigError
from rig.gears.acceptance import Acceptance
from rig.present import content, definitions, provenance
from rig.present import figure as figures
from rig.present.certificate.curves import (
    chart_part,
    curve_part,
    paper_curves,
    with_limits,
    without_paper,
)
from rig.present.certificate.front import front_page, sentence_of
from rig.present.certificate.gather import Certified, acceptance_sha256, certified
from rig.present.certificate.laboratory import LaboratoryWords
from rig.present.certificate.numbers import number_grids
from rig.present.certificate.record import certificate_files, manifest_path, record_of, record_path
from rig.present.certificate.rests_on import manifest_of
from rig.present.content import Part
from rig.present.page import (
    ORIGIN_SENTENCES,
    figures_of,
    paper_figure_rows,
    rendered,
    run_line,
    signature_of,
)
from rig.present.provenance import Provenance
from rig.runfile.manifest import Manifest
from rig.runfile.seal import forget_hashes
from rig.runfile.sealed import replace_sealed


@dataclass(frozen=True, kw_only=True)
class Certificate:
    """A written certificate: its files, its number, the verdict that stands on it, and what is missing."""

    number: str
    serial: str
    paths: tuple[Path, ...]
    record: Path
    """Its numbers and hashes for programs, beside it."""
    manifest: Path
    """The list of what it rests on, beside it."""
    manifest_sha256: str
    verdict: GearVerdict
    sentence: str
    missing: tuple[str, ...]
    runs: Mapping[str, str]
    """The run of every kind that stands in it."""

    def as_json(self) -> dict[str, Any]:
        """The object that `rig certificate --json` prints."""
        return {
            "certificate": self.number,
            "serial": self.serial,
            "files": [str(path) for path in self.paths],
            "record": str(self.record),
            "manifest": str(self.manifest),
            "manifest_sha256": self.manifest_sha256,
            "complete": not self.missing,
            "missing": list(self.missing),
            "runs": dict(self.runs),
            "sentence": self.sentence,
            **self.verdict.as_json(),
        }


def write_certificate(
    folder: Path,
    serial: str,
    outputs: Sequence[Path],
    *,
    acceptance: Acceptance | None = None,
    protocols: Sequence[str] = (),
    laboratory: LaboratoryWords | None = None,
    created: str = "",
) -> Certificate:
    """Write the certificate of a gear, HTML or PDF by the suffix of each output.

    `acceptance` is what the gear must show (that of its card without one), `protocols` those that a
    plan lists; `created` is the calendar time, now without one. The outputs differ in their suffix alone; beside
    them come the record (`.json`) and the manifest of what the certificate rests on (`.manifest.txt`), all
    sealed. Nothing is fitted. Raises `RigError` where no run of this gear is analysed or a file cannot be written.
    """
    forget_hashes()
    created = created or datetime.now().astimezone().isoformat(timespec="seconds")
    with certified(folder, serial, acceptance=acceptance, protocols=protocols) as gathered:
        manifest = manifest_of(gathered)
        context = certificate_context(
            gathered,
            laboratory or LaboratoryWords(),
            manifest,
            created=created.replace("T", " ", 1),
        )
        pages = {output: rendered(context, output) for output in outputs}
        record = record_of(
            gathered, context=context, created=created, manifest=manifest, pages=pages
        )
        record_file, manifest_file = record_path(outputs[0]), manifest_path(outputs[0])
        # The record comes last: it names all others, and without it there is no certificate to verify.
        _write_sealed({**pages, manifest_file: manifest.as_bytes(), record_file: record})
        return Certificate(
            number=context["number"],
            serial=serial,
            paths=tuple(outputs),
            record=record_file,
            manifest=manifest_file,
            manifest_sha256=manifest.sha256,
            verdict=gathered.verdict,
            sentence=sentence_of(gathered),
            missing=gathered.missing,
            runs={fit.result.kind: fit.result.run for fit in gathered.fits},
        )


def _write_sealed(files: Mapping[Path, bytes]) -> None:
    """Write each file with its note, over what this program wrote there before."""
    for path in files:
        if path.suffix == ".json" and path.exists() and not certificate_files(path):
            raise RigError(
                "the record of the certificate has no place: another file has its name",
                where=str(path),
                remedy="Choose another --output, or move that file away.",
            )
    for path, data in files.items():
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            replace_sealed(path, data)
        except OSError as error:
            raise RigError(
                "the certificate cannot be written",
                where=str(path),
                value=error.strerror or str(error),
                remedy="Choose another --output.",
            ) from None


def certificate_context(
    gathered: Certified, laboratory: LaboratoryWords, manifest: Manifest, *, created: str
) -> dict[str, Any]:
    """Everything that a certificate shows, under the names that the templates know."""
    fits = tuple(with_limits(fit, gathered.verdict.lines) for fit in gathered.fits)
    paper = paper_curves(fits, 0)
    charts = chart_part(gathered, len(paper))
    annexes = _annexes(fits, len(paper) + (len(charts.figures) if charts else 0))
    parts = [curve_part([figure for figure, _ in paper]), _numbers(fits)]
    parts = [part for part in (*parts, charts, *annexes) if part is not None]
    origins = list(dict.fromkeys(fit.recording.metadata.origin for fit in fits))
    facts = [(part.title, part.provenance) for part in annexes]
    return {
        "front": front_page(replace(gathered, fits=fits), laboratory, manifest),
        "created": created,
        "number": _number(gathered),
        "heading": f"Certificate of gear {gathered.serial}",
        "subtitle": "",
        "note": "",
        "gear_name": fits[0].gear.name,
        "serial": gathered.serial,
        "operators": "",
        "dates": "",
        "words": [w for w in (figures.WATERMARKS.get(o, o.upper()) for o in origins) if w],
        "origin_sentences": [ORIGIN_SENTENCES[o] for o in origins if o in ORIGIN_SENTENCES],
        "states": (),
        "verdicts": (),
        "decision_rule": DECISION_RULE,
        "catalogue": None,
        "key_results": (),
        "alarms": tuple(dict.fromkeys(alarm for _, one in facts for alarm in one.alarms)),
        "files": None,
        "run_line": run_line([fit.recording.metadata.run_id for fit in fits]),
        "warnings": [(p.title, p.anchor, p.run, text) for p in annexes for text in p.warnings],
        "parts": tuple(parts),
        "truth": None,
        "truth_note": "",
        "paper_figures": [row for row in paper_figure_rows(paper) if row[2]],
        "run_word": "Run",
        "annex_title": "parameter set with its sources",
        "parameter_sets": content.parameter_grids(fits),
        "definitions": definitions.definitions_for(fit.result.kind for fit in fits),
        "not_measured": definitions.NOT_MEASURED,
        "paper": definitions.PAPER,
        "signature": signature_of(origins, fits),
        "version": content.program_version(),
        **_facts_side_by_side(facts),
    }


def _facts_side_by_side(facts: Sequence[tuple[str, Provenance]]) -> dict[str, Any]:
    """Conditions, calibrations and provenance of all runs, one column each."""

    def beside(name: str, caption: str = "") -> Any:
        return provenance.side_by_side(
            [(title, getattr(one, name)) for title, one in facts], caption
        )

    return {
        "conditions": beside("conditions"),
        "calibrations": beside("calibrations"),
        "identities": beside("rows", "Runs"),
        "conventions": beside("options", "Conventions of the analyses"),
        "settings": beside("settings", "Parameters of the protocols and settings of the analyses"),
    }


def _annexes(fits: Sequence[Any], before: int) -> list[Part]:
    """One annex per run: what a report of it shows, without the figures that stand before."""
    annexes = []
    for index, fit in enumerate(map(without_paper, fits)):
        drawn = figures_of(fit.result.plots, fit.recording.metadata.origin, before)
        before += len(drawn)
        title = f"Annex {chr(ord('A') + index)}: {definitions.title_of(fit.result.kind)}"
        part = content.part_of(fit, index, title)
        annexes.append(replace(part, figures=tuple(figure for figure, _ in drawn)))
    return annexes


def _numbers(fits: Sequence[Any]) -> Part | None:
    grids = number_grids(fits)
    if not grids:
        return None
    return replace(
        curve_part(()),
        anchor="numbers",
        title="The gear in numbers: card, computed, identified",
        grids=grids,
    )


def _number(gathered: Certified) -> str:
    """A number that follows from what is certified: the same runs, analyses and limits give the same."""
    digest = hashlib.sha256(gathered.serial.encode())
    for fit in gathered.fits:
        digest.update(f"|{fit.recording.metadata.sha256}|{fit.stored}".encode())
        for name, estimate in fit.result.estimates.items():
            digest.update(f"|{name}={estimate.value:.9g}".encode())
    if gathered.acceptance is not None:
        digest.update(acceptance_sha256(gathered.acceptance).encode())
    return "HC-" + digest.hexdigest()[:10].upper()
