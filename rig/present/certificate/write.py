"""The certificate of a gear from the analyses in its folder: gathered, laid out, written as HTML and PDF."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from rig.analysis.fit import Fit
from rig.analysis.judging import GearVerdict
from rig.content.page import Page, Section, annexes_of
from rig.errors import RigError
from rig.gears.acceptance import Acceptance
from rig.present import definitions
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
from rig.present.page import rendered
from rig.present.parameters import parameter_grids
from rig.present.provenance import provenance_of, provenance_sections
from rig.present.report import (
    figures_of,
    marks_of,
    paper_grid,
    part_of,
    program_version,
    run_line,
    shown,
    signature_of,
)
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
        page = certificate_page(
            gathered,
            laboratory or LaboratoryWords(),
            manifest,
            created=created.replace("T", " ", 1),
        )
        pages = {output: rendered(page, output) for output in outputs}
        record = record_of(gathered, page=page, created=created, manifest=manifest, pages=pages)
        record_file, manifest_file = record_path(outputs[0]), manifest_path(outputs[0])
        # The record comes last: it names all others, and without it there is no certificate to verify.
        _write_sealed({**pages, manifest_file: manifest.as_bytes(), record_file: record})
        return Certificate(
            number=page.number,
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


def certificate_page(
    gathered: Certified, laboratory: LaboratoryWords, manifest: Manifest, *, created: str
) -> Page:
    """Everything that a certificate shows."""
    fits = tuple(with_limits(fit, gathered.verdict.lines) for fit in gathered.fits)
    paper = paper_curves(fits, 0)
    charts = chart_part(gathered, len(paper))
    annexes = _annexes(fits, len(paper) + (len(charts.figures) if charts else 0))
    sources = [(a.title, provenance_of(fit)) for a, fit in zip(annexes, fits, strict=True)]
    parts = (curve_part([figure for figure, _ in paper]), _numbers(fits), charts, *annexes)
    sections = (
        *(part for part in parts if part is not None),
        *provenance_sections(sources, None),
        *definitions.sections(fit.result.kind for fit in fits),
    )
    return Page(
        kind="Certificate",
        number=_number(gathered),
        heading=f"Certificate of gear {gathered.serial}",
        created=created,
        version=program_version(),
        marks=marks_of(fit.recording.metadata.origin for fit in fits),
        alarms=tuple(dict.fromkeys(alarm for _, one in sources for alarm in one.alarms)),
        warnings=tuple((a.title, a.anchor, text) for a in annexes for text in a.warnings),
        summary=shown(paper_grid(paper, whole=False)),
        sections=sections,
        annexes=annexes_of(sections, "parameter set with its sources", parameter_grids(fits)),
        signature=signature_of(fits),
        run_line=run_line([fit.recording.metadata.run_id for fit in fits]),
        front=front_page(replace(gathered, fits=fits), laboratory, manifest),
    )


def _annexes(fits: Sequence[Fit], before: int) -> list[Section]:
    """One annex per run: what a report of it shows, without the figures that stand before."""
    annexes = []
    for index, fit in enumerate(map(without_paper, fits)):
        drawn = figures_of(fit.result.plots, fit.recording.metadata.origin, before)
        before += len(drawn)
        title = f"Annex {chr(ord('A') + index)}: {definitions.title_of(fit.result.kind)}"
        annexes.append(
            replace(part_of(fit, index, title), figures=tuple(figure for figure, _ in drawn))
        )
    return annexes


def _numbers(fits: Sequence[Fit]) -> Section | None:
    grids = number_grids(fits)
    title = "The gear in numbers: card, computed, identified"
    return Section(title=title, anchor="numbers", grids=grids) if grids else None


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
