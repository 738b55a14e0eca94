"""Whether a certificate can be believed: its seals, what it rests on, its record against the analyses, its pages
against the record.

Nothing is fitted, and what came after the certificate does not matter: a newer run makes it older, not wrong.
"""

from __future__ import annotations

import html
import json
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from experiments.finding import Finding, Severity, passed_if
from model.errors import WordedError
from rig.analysis.judging import GearVerdict, StoredResult, judge
from rig.analysis.result_data import result_from_mapping
from rig.analysis.store import json_text
from rig.bench.commissioning import is_sealed_record
from rig.errors import RigError
from rig.floors import DISTRIBUTION
from rig.gears.acceptance import Part, acceptance_named
from rig.library.folder import ANALYSES_SUFFIX
from rig.present.certificate.record import (
    FORMAT_1,
    STORED,
    certificate_files,
    manifest_path,
    read_record,
    record_path,
    values_with_uncertainty,
)
from rig.present.certificate.rests_on import PROGRAM
from rig.present.certificate.words import SHIPPED
from rig.program import this_program
from rig.runfile.header import ORIGIN_WORDS
from rig.runfile.manifest import Manifest, manifest_from
from rig.runfile.read import glance
from rig.runfile.seal import file_sha256, hash_path
from rig.runfile.sealed import read_sealed

PAGES = (".pdf", ".html")
_GOES_ON = frozenset({"gear card", "choice"})
"""Kinds that people go on writing after a certificate: another state of theirs is told, and contradicts nothing. What
was used of them stands in the runs and analyses.
"""
SAME_NUMBER = 1e-12
"""Relative; numbers nearer than this are one number."""
_NOT_READ = re.compile(r"[\s\u200b\u2060\u00ad\u2009\u202f-]+")
"""What line breaks, hyphens and thin spaces make of a text on a page."""


@dataclass(frozen=True)
class _Certificate:
    """A certificate as it lies there: one of its pages or its record, the record's content, its folder of runs."""

    path: Path
    record: Mapping[str, Any]
    manifest: Manifest

    @property
    def runs(self) -> Path:
        """The folder of runs, where it lies as seen from the certificate."""
        return self.path.parent / str(self.record.get("runs_folder", "."))


def certificates_in(place: Path) -> list[Path]:
    """The certificates that a file or a folder means, each by one of its files: that file, or every one in the folder
    and the folders in it that has a record, or a page that is sealed and has lost its record.
    """
    if not place.is_dir():
        is_one = place.suffix.lower() in (*PAGES, ".json") and not is_sealed_record(place)
        return [place] if is_one and not place.parent.name.endswith(ANALYSES_SUFFIX) else []
    found: dict[Path, Path] = {}
    for folder, inside, names in os.walk(place):
        inside[:] = sorted(
            name
            for name in inside
            if not name.startswith(".") and not name.endswith(ANALYSES_SUFFIX)
        )
        for path in (Path(folder, name) for name in sorted(names)):
            is_page = path.suffix.lower() in PAGES and hash_path(path).exists()
            if is_page or (path.suffix.lower() == ".json" and certificate_files(path)):
                found.setdefault(path.with_suffix(""), path)
    return list(found.values())


def runs_of(certificate: Path) -> list[Path]:
    """The runs whose analyses stand in a certificate; none where its record cannot be read."""
    record = record_path(certificate)
    try:
        content = read_record(record.read_bytes(), record)
        folder = record.parent / content["runs_folder"]
        return [(folder / one["run_file"]).resolve() for one in content["analyses"]]
    except (OSError, RigError, KeyError, TypeError):
        return []


def verify_certificate(path: str | Path) -> tuple[Finding, ...]:
    """Every check of a certificate, by its PDF, its HTML or its record; what cannot be read is an error among them."""
    path = Path(path)
    findings: list[Finding] = []
    try:
        record_file = record_path(path)
        record = read_record(_sealed(record_file, "record", findings), record_file)
        listed = _sealed(manifest_path(path), "manifest", findings)
        found = _Certificate(path, record, manifest_from(listed, str(manifest_path(path))))
    except WordedError as error:
        return (*findings, Finding("readable", Severity.BLOCKS, str(error)))
    for check in CHECKS:
        try:
            findings.extend(check(found))
        except WordedError as error:
            findings.append(Finding("readable", Severity.BLOCKS, str(error)))
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            text = f"the record says not what a record says: {type(error).__name__} {error}"
            findings.append(Finding("record", Severity.BLOCKS, text))
    return tuple(findings)


def _sealed(path: Path, what: str, findings: list[Finding]) -> bytes:
    data, seal = read_sealed(path)
    words = f"{what} {path.name}: SHA-256 {seal.sha256}"
    if not seal.is_whole:
        words += ", NOT SEALED"
    findings.append(passed_if("seal", seal.is_whole, words, otherwise=Severity.WARNS))
    return data


def _pages(found: _Certificate) -> Iterator[Finding]:
    """The pages are those that the record names, and sealed."""
    if found.path.suffix.lower() in PAGES and found.path.name not in found.record["files"]:
        text = f"{found.path.name} is no page of certificate {found.record['certificate']}"
        yield Finding("pages", Severity.BLOCKS, text)
    for name, sha256 in found.record["files"].items():
        page = found.path.with_name(Path(name).name)
        if not page.is_file():
            yield Finding("pages", Severity.WARNS, f"{name} does not lie here")
            continue
        sealed: list[Finding] = []
        try:
            _sealed(page, "page", sealed)
        except WordedError as error:
            sealed.append(Finding("seal", Severity.BLOCKS, str(error)))
        yield from sealed
        if file_sha256(page) != sha256:
            yield Finding("pages", Severity.BLOCKS, f"{name} is not the page that the record names")


def _rests_on(found: _Certificate) -> Iterator[Finding]:
    """Everything that the certificate rests on is there as it was."""
    if found.manifest.sha256 != found.record["manifest"]["sha256"]:
        text = "the manifest is not the one that the record names"
        yield Finding("rests on", Severity.BLOCKS, text)
    files = [entry for entry in found.manifest.entries if entry.kind != PROGRAM]
    kept = 0
    for entry in files:
        path = found.runs / entry.name
        severity = Severity.WARNS if entry.kind in _GOES_ON else Severity.BLOCKS
        if not path.is_file():
            yield Finding("rests on", severity, f"{entry.kind} {path} is missing")
        elif (now := file_sha256(path)) != entry.sha256:
            text = f"{entry.kind} {path} was changed: SHA-256 {now}, certified {entry.sha256}"
            yield Finding("rests on", severity, text)
        else:
            kept += 1
    if kept == len(files):
        yield Finding(
            "rests on", Severity.PASSED, f"{kept} files, manifest {found.manifest.sha256}"
        )


def _programs(found: _Certificate) -> Iterator[Finding]:
    """By which program it was made; another one than this is worth knowing."""
    made_by = str(found.record.get("program_sha256", ""))
    listed = {e.sha256: e.name for e in found.manifest.entries if e.kind == PROGRAM}
    if made_by not in listed:
        yield Finding(
            "program", Severity.BLOCKS, "the manifest does not name the program of the record"
        )
    ours = {sha: name for sha, name in listed.items() if name.startswith(DISTRIBUTION)}
    if len(ours) > 1:
        names = "; ".join(f"{name}, files {sha[:12]}" for sha, name in ours.items())
        yield Finding("program", Severity.WARNS, f"made by different programs: {names}")
    if made_by != this_program().sha256:
        text = f"made by {listed.get(made_by, 'a program without a name')}, not by this program"
        yield Finding("program", Severity.WARNS, text)


def _numbers(found: _Certificate) -> Iterator[Finding]:
    """The numbers of the record are those of the stored analyses."""
    listed = {entry.name for entry in found.manifest.entries}
    wrong, compared = 0, 0
    for one in found.record["analyses"]:
        for name in (one["file"], one["run_file"]):
            if name not in listed:
                wrong += 1
                yield Finding(
                    "numbers", Severity.BLOCKS, f"{name} stands in no line of the manifest"
                )
        stored = _object(found.runs / one["file"])["result"]["parameters"]
        for name in dict.fromkeys((*one["numbers"], *stored)):
            compared += 1
            said, kept = one["numbers"].get(name, {}), stored.get(name, {})
            if any(not _is_same(said.get(key), kept.get(key)) for key in STORED):
                wrong += 1
                here, there = _number_text(said), _number_text(kept)
                text = f"{one['kind']} {name}: {here} in the record, {there} in {one['file']}"
                yield Finding("numbers", Severity.BLOCKS, text)
    if not wrong:
        yield Finding(
            "numbers", Severity.PASSED, f"{compared} numbers are those of the stored analyses"
        )


def _number_text(number: Mapping[str, Any]) -> str:
    if not number:
        return "nothing"
    return f"{number.get('value')} ± {number.get('expanded_uncertainty')} {number.get('unit', '')}"


def _is_same(a: Any, b: Any) -> bool:
    if isinstance(a, float) and isinstance(b, float):
        return math.isclose(a, b, rel_tol=SAME_NUMBER)
    return a == b


def _verdict(found: _Certificate) -> Iterator[Finding]:
    """The verdict is the one that the stored analyses get from the acceptance file, limit by limit."""
    said = found.record
    now = json.loads(json_text(_judged(found).as_json()))
    keys = ("limits",) if said["stale"] else ("verdict", "limits")
    for key in keys:
        if said[key] != now[key]:
            words = f"{said[key]} in the record, {now[key]} by the analyses"
            if key == "limits":
                words = _limits_apart(said[key], now[key])
            yield Finding("verdict", Severity.BLOCKS, words)
            return
    yield Finding(
        "verdict", Severity.PASSED, f"{said['verdict']}, judged anew from the stored analyses"
    )


def _limits_apart(said: Sequence[Any], now: Sequence[Any]) -> str:
    for one, other in zip(said, now, strict=False):
        apart = [key for key in dict.fromkeys((*one, *other)) if one.get(key) != other.get(key)]
        if apart:
            key = apart[0]
            name = other.get("quantity", other.get("name", ""))
            return (
                f"limit on {name}: {key} {one.get(key)} in the record, {other.get(key)} judged anew"
            )
    return f"{len(said)} limits in the record, {len(now)} judged anew"


def _judged(found: _Certificate) -> GearVerdict:
    named = found.record["acceptance_file"]
    acceptance = None
    if named is not None:
        file = str(named["file"])
        is_file = file.lower().endswith(".toml")
        acceptance = acceptance_named(str(found.runs / file) if is_file else file)
    results = []
    for one in found.record["analyses"]:
        content = _object(found.runs / one["file"])
        metadata = glance(found.runs / one["run_file"]).metadata
        result = result_from_mapping(content["result"], content.get("tables", ()))
        results.append(
            StoredResult(
                result,
                metadata.origin,
                metadata.outcome,
                metadata.gear_serial,
                Part.of(metadata),
            )
        )
    return judge(results, acceptance)


def _origin(found: _Certificate) -> Iterator[Finding]:
    """What the record says of where the runs come from is what their files say."""
    for one in found.record["analyses"]:
        origin = glance(found.runs / one["run_file"]).metadata.origin
        if origin != one["origin"]:
            text = f"{one['run']} is {origin}, the record says {one['origin']}"
            yield Finding("origin", Severity.BLOCKS, text)


def _printed(found: _Certificate) -> Iterator[Finding]:
    """What stands on both pages is what the record says; of many pages, on page one and every number."""
    for name in found.record["files"]:
        page = found.path.with_name(Path(name).name)
        if not page.is_file():
            continue
        first, whole = READERS[page.suffix.lower()](page)
        lacks = [words for words in _on_page_one(found) if squeezed(words) not in first]
        # Nothing is added either: a second number beside the right one would be seen first.
        said, there = found.record["page_one"]["with_uncertainty"], values_with_uncertainty(first)
        if there != said:
            lacks.append(f"{said} values with their U, where the page has {there}")
        if lacks:
            yield Finding(
                "printed", Severity.BLOCKS, f"{name} does not say on page one: {lacks[0]}"
            )
            continue
        missing = [words for words in _on_any_page(found) if squeezed(words) not in whole]
        if missing:
            yield Finding("printed", Severity.BLOCKS, f"{name} says on no page: {missing[0]}")
        else:
            yield Finding("printed", Severity.PASSED, f"{name} says what the record says")


def _on_page_one(found: _Certificate) -> Iterator[str]:
    record = found.record
    yield str(record["certificate"])
    is_english = record.get("language", SHIPPED[0]) == SHIPPED[0]
    yield f"serial number {record['serial']}" if is_english else str(record["serial"])
    yield str(record["verdict"])
    yield str(record["sentence"])
    if record["format"] == FORMAT_1:
        yield str(record["manifest"]["sha256"])
    for row in record["page_one"]["values"]:
        yield " ".join(str(cell) for cell in row)
    yield from record["page_one"]["because"]
    for origin in {one["origin"] for one in record["analyses"]}:
        yield ORIGIN_WORDS.get(origin, str(origin).upper())


def _on_any_page(found: _Certificate) -> Iterator[str]:
    """What stands on page two; of a certificate of many pages the value of each number that its annexes list,
    where what is not identifiable is not listed as one.
    """
    if found.record["format"] != FORMAT_1:
        yield from found.record["page_one"]["texts"]
        yield from found.record["page_two"]
        yield str(found.record["manifest"]["sha256"])
        return
    for one in found.record["analyses"]:
        for number in one["numbers"].values():
            if number["identifiable"] and number["value"] is not None:
                yield number["printed"].partition("±")[0]


def squeezed(text: str) -> str:
    """A text without what line breaks, hyphens and thin spaces make of it on a page."""
    return _NOT_READ.sub("", text)


def _of_pdf(path: Path) -> tuple[str, str]:
    """The text of page one and of all pages of a PDF."""
    import logging

    # Read when a certificate is verified, not when its module is imported: it takes a quarter of a second.
    import pypdf
    from pypdf.errors import PyPdfError

    # What it cannot make sense of it tells the log; here the text alone counts.
    logging.getLogger("pypdf").setLevel(logging.CRITICAL)
    try:
        pages = [squeezed(page.extract_text()) for page in pypdf.PdfReader(path).pages]
    except (PyPdfError, OSError, ValueError, KeyError, TypeError) as error:
        raise RigError("the PDF cannot be read", where=str(path), value=str(error)) from None
    return "".join(pages[:1]), "".join(pages)


def _of_html(path: Path) -> tuple[str, str]:
    """The text of page one and of all of an HTML page."""
    text = path.read_text(encoding="utf-8", errors="replace")
    text = re.sub(r"(?s)<(style|svg|script)\b.*?</\1>", " ", text)
    first = text.partition("</main>")[0].partition("</section>")[0]

    def plain(part: str) -> str:
        return squeezed(html.unescape(re.sub(r"(?s)<[^>]*>", " ", part)))

    return plain(first), plain(text)


def _object(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise RigError("cannot be read", where=str(path), value=str(error)) from None
    return content


READERS: Mapping[str, Callable[[Path], tuple[str, str]]] = {".pdf": _of_pdf, ".html": _of_html}
CHECKS = (_pages, _rests_on, _programs, _origin, _numbers, _verdict, _printed)
"""Every check in turn, each a generator of what it finds."""
