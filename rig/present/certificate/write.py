"""The certificate of a gear from the analyses in its folder: gathered, laid out on two pages, written and sealed."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from rig.analysis.judging import GearVerdict
from rig.errors import RigError
from rig.gears.acceptance import Acceptance
from rig.present.certificate.front import sentence_of
from rig.present.certificate.gather import Certified, acceptance_sha256, certified
from rig.present.certificate.laboratory import LaboratoryWords
from rig.present.certificate.record import certificate_files, manifest_path, record_of, record_path
from rig.present.certificate.rests_on import manifest_of
from rig.present.certificate.sheets import Paper, rendered, sheets_of
from rig.present.certificate.words import ENGLISH
from rig.runfile.seal import forget_hashes
from rig.runfile.sealed import replace_sealed


@dataclass(frozen=True, kw_only=True)
class Certificate:
    """A written certificate: its files, its number, the verdict that stands on it, and what is missing."""

    number: str
    title: str
    """CERTIFICATE, TEST REPORT or SIMULATION."""
    untraceable: str
    """Which instruments keep it from being a CERTIFICATE, in a sentence."""
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
            "title": self.title,
            "untraceable": self.untraceable,
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
    paper: Paper = "a4",
) -> Certificate:
    """Write the certificate of a gear, two pages, HTML or PDF by the suffix of each output.

    `acceptance` is what the gear must show (that of its card without one), `protocols` those that a
    plan lists; `created` is the calendar time, now without one. The outputs differ in their suffix alone; beside
    them come the record (`.json`) and the manifest of what the certificate rests on (`.manifest.txt`), all
    sealed. Nothing is fitted. Raises `RigError` where no run of this gear is analysed or a file cannot be written.
    """
    forget_hashes()
    created = created or datetime.now().astimezone().isoformat(timespec="seconds")
    with certified(folder, serial, acceptance=acceptance, protocols=protocols) as gathered:
        manifest = manifest_of(gathered)
        record_file, manifest_file = record_path(outputs[0]), manifest_path(outputs[0])
        told = laboratory or LaboratoryWords()
        sheets = sheets_of(
            gathered,
            told,
            manifest,
            number=number_of(gathered, told, created),
            created=created,
            manifest_file=manifest_file.name,
        )
        pages = {output: rendered(sheets, output, paper) for output in outputs}
        record = record_of(gathered, sheets=sheets, created=created, manifest=manifest, pages=pages)
        # The record comes last: it names all others, and without it there is no certificate to verify.
        _write_sealed({**pages, manifest_file: manifest.as_bytes(), record_file: record}, serial)
        return Certificate(
            number=sheets.number,
            title=ENGLISH.TITLES[sheets.title.kind],
            untraceable=sheets.title.untraceable,
            serial=serial,
            paths=tuple(outputs),
            record=record_file,
            manifest=manifest_file,
            manifest_sha256=manifest.sha256,
            verdict=gathered.verdict,
            sentence=sentence_of(gathered, told.words),
            missing=gathered.missing,
            runs={fit.result.kind: fit.result.run for fit in gathered.fits},
        )


def _write_sealed(files: Mapping[Path, bytes], serial: str) -> None:
    """Write each file with its note, the record last, over an earlier certificate of this gear alone."""
    *_, record = files
    there = [path for path in files if path.exists()]
    if there and not certificate_files(record, serial):
        raise RigError(
            f"is there already, and no earlier certificate of gear {serial} by its record",
            where=str(there[-1]),
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


def number_of(gathered: Certified, laboratory: LaboratoryWords, created: str) -> str:
    """The number of one issue: it follows from what is certified, for whom, and when it was issued; two issues never
    share one.
    """
    told = replace(laboratory, logo=None)
    digest = hashlib.sha256(f"{gathered.serial}|{created}|{told}".encode())
    for fit in gathered.fits:
        digest.update(f"|{fit.recording.metadata.sha256}|{fit.stored}".encode())
        for name, estimate in fit.result.estimates.items():
            digest.update(f"|{name}={estimate.value:.9g}".encode())
    if gathered.acceptance is not None:
        digest.update(acceptance_sha256(gathered.acceptance).encode())
    return "HC-" + digest.hexdigest()[:10].upper()
