"""The record of a certificate: `<certificate>.json` beside it, with its numbers and the hashes of what it rests on.

The pages are for people; what stands on them can be held against the record by a program, and the record against
the stored analyses.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rig.analysis.fit.recorded import Fit
from rig.analysis.in_force import InForce
from rig.analysis.store import Analysis, json_text
from rig.content.wording import show
from rig.errors import RunFileError
from rig.present.certificate.front import sentence_of
from rig.present.certificate.gather import Certified, acceptance_sha256
from rig.present.certificate.rests_on import programs_of
from rig.present.certificate.sheets import Sheets, texts_of
from rig.present.certificate.traceability import instruments_of
from rig.present.certificate.words import ENGLISH
from rig.program import this_program
from rig.runfile.manifest import SUFFIX, Manifest

FORMAT, FORMAT_1 = "harmonic-rig-certificate-2", "harmonic-rig-certificate-1"
"""Format 1 is of certificates of many pages (0.3 and before), on which every number was printed."""


def record_path(certificate: Path) -> Path:
    """The record of a certificate that lies there."""
    return certificate.with_suffix(".json")


def manifest_path(certificate: Path) -> Path:
    """The manifest of what a certificate rests on, beside it."""
    return certificate.with_name(certificate.stem + SUFFIX)


def record_of(
    gathered: Certified,
    *,
    sheets: Sheets,
    created: str,
    manifest: Manifest,
    pages: Mapping[Path, bytes],
) -> bytes:
    """The record of a certificate that is written as these pages: JSON that a person can read too.

    `sheets` is what the pages were made of.
    """
    place = next(iter(pages))
    content = {
        "format": FORMAT,
        "certificate": sheets.number,
        "title": ENGLISH.TITLES[sheets.title.kind],
        "untraceable": sheets.title.untraceable,
        "serial": gathered.serial,
        "language": sheets.words.language,
        "created": created,
        **this_program().as_json(),
        "programs_of_the_analyses": [one.as_json() for one in programs_of(gathered)],
        "files": {path.name: hashlib.sha256(data).hexdigest() for path, data in pages.items()},
        "runs_folder": _from(place.parent, gathered.folder),
        "manifest": {"file": manifest_path(place).name, "sha256": manifest.sha256},
        "missing": list(gathered.missing),
        "sentence": sentence_of(gathered, sheets.words),
        **gathered.verdict.as_json(),
        "acceptance_file": _acceptance(gathered),
        "page_one": _page_one(sheets),
        "page_two": texts_of(sheets)[1],
        "instruments": [{**asdict(one), "doubt": one.doubt} for one in instruments_of(gathered)],
        "analyses": [
            _analysis(fit, found, gathered.folder)
            for fit, found in zip(gathered.fits, gathered.analyses, strict=True)
        ],
    }
    return (json_text(content) + "\n").encode()


def _page_one(sheets: Sheets) -> dict[str, Any]:
    """What page one says: the table of values, the reasons, all its texts, and how many values with their U."""
    texts, _ = texts_of(sheets)
    return {
        "values": [list(row) for row in sheets.front.values.rows],
        "because": list(sheets.front.because),
        "texts": texts,
        "with_uncertainty": sum(map(values_with_uncertainty, texts)),
    }


def values_with_uncertainty(text: str) -> int:
    """How many values with their U a text says."""
    return len(re.findall(r"\d\s*±\s*\d", text))


def _acceptance(gathered: Certified) -> dict[str, str] | None:
    """The acceptance file by its path from the folder of runs on, a shipped one by its name."""
    acceptance = gathered.acceptance
    if acceptance is None:
        return None
    is_file = acceptance.path.lower().endswith(".toml")
    name = _from(gathered.folder, Path(acceptance.path)) if is_file else acceptance.path
    return {"file": name, "sha256": acceptance_sha256(acceptance)}


def _from(folder: Path, path: Path) -> str:
    """A path as seen from a folder, with slashes."""
    return os.path.relpath(path.resolve(), folder.resolve()).replace(os.sep, "/")


def _analysis(fit: Fit, found: InForce, folder: Path) -> dict[str, Any]:
    """One analysis with its run, by their paths from the folder of runs on, and all its numbers."""
    assert fit.path is not None
    assert found.analysis is not None
    return {
        "kind": fit.result.kind,
        "run": fit.result.run,
        "origin": fit.recording.metadata.origin,
        "run_file": _from(folder, fit.path),
        "file": _from(folder, fit.path.parent / fit.stored),
        "numbers": dict(_numbers(fit, found.analysis)),
    }


def _numbers(fit: Fit, analysis: Analysis) -> Iterator[tuple[str, dict[str, Any]]]:
    """Every number of a fit by its name: as it is stored, and as it is printed."""
    for name, estimate in fit.result.estimates.items():
        quantity, stored = fit.result.quantity(name), analysis.content["result"]["parameters"][name]
        yield (
            name,
            {
                "title": quantity.titled(name),
                **{key: stored.get(key) for key in STORED},
                # Infinitely many are null: JSON has no number for them.
                "degrees_of_freedom": float(estimate.degrees_of_freedom),
                "printed": show(estimate, quantity).with_uncertainty,
            },
        )


STORED = ("value", "unit", "expanded_uncertainty", "coverage_factor", "identifiable")
"""What the record and the stored analysis say alike of a number."""


def read_record(data: bytes, where: Path) -> dict[str, Any]:
    """A record from its bytes. Raises `RunFileError` for what is none."""
    try:
        content = json.loads(data)
    except ValueError:
        content = None
    if not isinstance(content, dict) or content.get("format") not in (FORMAT, FORMAT_1):
        raise RunFileError(
            "is no record of a certificate", where=str(where), limit=f"format {FORMAT}"
        )
    return content


def certificate_files(record: Path, serial: str = "") -> Sequence[Path]:
    """The files of a certificate by its record: itself, pages, manifest; none for a file that is no
    record, or that of another gear.
    """
    try:
        content = read_record(record.read_bytes(), record)
    except (OSError, RunFileError):
        return ()
    if serial and content.get("serial") != serial:
        return ()
    names = [*content.get("files", {}), (content.get("manifest") or {}).get("file", "")]
    beside = [record.with_name(Path(str(name)).name) for name in names if name]
    return [record, *(path for path in beside if path.is_file())]
