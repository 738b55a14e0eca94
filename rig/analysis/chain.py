"""The chain of evidence behind a run: its file, its analyses, and the tares and analyses on which those rest.

Each link is a file with its SHA-256, held against the note beside it and against what names it. The
walk reads and judges nothing; it says what it finds, link by link, and goes on behind a broken one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from experiments.finding import Finding, Severity
from rig.analysis.in_force import kept_by_hand
from rig.analysis.learnt import learnt_by
from rig.analysis.store import (
    NOT_SEALED_THEN,
    STORE_FORMAT,
    Analysis,
    analysis_folder,
    read_analysis,
)
from rig.errors import RigError, UnsealedError
from rig.runfile.checks import LEVELS
from rig.runfile.layout import HASH_SUFFIX, PART_SUFFIX
from rig.runfile.read import glance
from rig.runfile.seal import check_seal, is_unsealed_allowed
from rig.runfile.sealed import names_of_notes, read_sealed


@dataclass(frozen=True)
class Link(Finding):
    """What was found of one file of the chain, or of one thing that names another.

    `what` is run, analysis, figures, tare, basis, choice, campaign, gear card, acceptance or calibration, `where` its
    path; `sha256` that of its bytes, "" where they were not read; `found` says what is wrong with it, or "ok".
    """

    sha256: str = field(default="", kw_only=True)
    error: RigError | None = field(default=None, compare=False, kw_only=True)
    """What was raised where it was refused."""

    def as_json(self) -> dict[str, Any]:
        """As `rig verify --json` tells it: as every finding, and the keys of 0.2.0 beside."""
        return super().as_json() | {
            "kind": self.what,
            "name": self.where,
            "level": LEVELS[self.severity],
            "text": self.found,
            "sha256": self.sha256,
        }


def broken(kind: str, path: Path, error: RigError) -> Link:
    """A link that is refused; one without its note is only told where that is allowed."""
    allowed = isinstance(error, UnsealedError) and is_unsealed_allowed()
    severity = Severity.WARNS if allowed else Severity.BLOCKS
    return Link(kind, severity, str(error), where=str(path), error=error)


def links_of_run(run: Path) -> Iterator[Link]:
    """The chain of one run: its file first, then each of its analyses with all that it names."""
    sha256 = ""
    try:
        seal = check_seal(run, anew=True)
        sha256 = seal.sha256
        if run.name.endswith(PART_SUFFIX):
            yield Link(
                "run",
                Severity.WARNS,
                "is not sealed: still being written, or cut off",
                where=str(run),
            )
        elif not seal.is_whole:
            yield Link(
                "run",
                Severity.WARNS,
                "is not sealed: its note is missing",
                where=str(run),
                sha256=sha256,
            )
        else:
            yield Link("run", Severity.PASSED, "ok", where=str(run), sha256=sha256)
    except RigError as error:
        yield broken("run", run, error)
    yield from _calibrations(run)
    yield from _links_of_store(run, sha256)


def _calibrations(run: Path) -> Iterator[Link]:
    """The sealed copies of the calibrations that a run used."""
    try:
        files = glance(run).metadata.process.get("files", ())
    except RigError:
        return  # What is wrong with the run file is said by the checks of its content.
    for file in files:
        path = run.parent / str(file.get("copy", ""))
        if not file.get("copy"):
            continue
        yield _calibration_named(path, str(file.get("sha256", "")), run.name)


def _calibration_named(path: Path, sha256: str, by: str) -> Link:
    """A calibration that a run or an analysis names by its hash."""
    if not path.is_file():
        return Link("calibration", Severity.WARNS, f"is not here; {by} used it", where=str(path))
    try:
        _, seal = read_sealed(path)
    except RigError as error:
        return broken("calibration", path, error)
    if seal.sha256 != sha256:
        text = f"is not the one that {by} used: that had SHA-256 {sha256}"
        return Link("calibration", Severity.BLOCKS, text, where=str(path), sha256=seal.sha256)
    return Link(
        "calibration", Severity.PASSED, f"ok, named by {by}", where=str(path), sha256=seal.sha256
    )


def _links_of_store(run: Path, sha256: str) -> Iterator[Link]:
    folder = analysis_folder(run)
    if not folder.is_dir():
        return
    numbers = []
    for path in sorted(folder.glob("[0-9]*.json")):
        try:
            analysis = read_analysis(path)
        except RigError as error:
            numbers.append(int(path.stem) if path.stem.isdigit() else 0)
            yield broken("analysis", path, error)
            continue
        numbers.append(analysis.number)
        yield _link_of(analysis, sha256)
        yield from _links_named_by(run, analysis)
    yield from _gone(folder, numbers)
    try:
        kept_by_hand(run)
    except RigError as error:
        yield broken("choice", folder, error)


def _link_of(analysis: Analysis, run_sha256: str) -> Link:
    named = str(analysis.content.get("run_sha256", ""))
    if run_sha256 and named != run_sha256:
        return Link(
            "analysis",
            Severity.BLOCKS,
            f"is of another run file: of SHA-256 {named or 'none'}, not {run_sha256}",
            where=str(analysis.path),
            sha256=analysis.seal.sha256,
        )
    if int(analysis.content.get("number", analysis.number)) != analysis.number:
        text = (
            f"was stored as number {analysis.content['number']}, and lies here as {analysis.number}"
        )
        return Link(
            "analysis", Severity.BLOCKS, text, where=str(analysis.path), sha256=analysis.seal.sha256
        )
    if analysis.seal.is_whole:
        return Link(
            "analysis", Severity.PASSED, "ok", where=str(analysis.path), sha256=analysis.seal.sha256
        )
    is_older = analysis.content.get("format") != STORE_FORMAT
    text = NOT_SEALED_THEN if is_older else "is not sealed: its note is missing"
    return Link(
        "analysis", Severity.WARNS, text, where=str(analysis.path), sha256=analysis.seal.sha256
    )


def _links_named_by(run: Path, analysis: Analysis) -> Iterator[Link]:
    """What an analysis names: its figures, its tare with the analysis of that, the analysis that it builds on."""
    try:
        analysis.whole_result()
    except RigError as error:
        yield broken("figures", analysis.path, error)
    for path, sha256 in learnt_by(run.parent, analysis.result.options):
        yield _calibration_named(path, sha256, analysis.name)
    tare = analysis.tare
    if tare:
        path = run.parent / str(tare.get("file") or f"{tare.get('run', '')}.h5")
        yield _run_named("tare", path, str(tare.get("sha256", "")), analysis)
        if tare.get("analysis"):
            yield _analysis_named("tare", path.parent / str(tare["analysis"]), tare, analysis)
    built_on: Mapping[str, Any] = (analysis.content.get("gear_source") or {}).get("builds_on") or {}
    if built_on.get("analysis_sha256"):
        other = analysis_folder(run.parent / str(built_on["file"]))
        path = other / f"{int(built_on['number']):04d}.json"
        yield _analysis_named("basis", path, built_on, analysis)


def _run_named(kind: str, path: Path, sha256: str, by: Analysis) -> Link:
    """A run file that an analysis names by its hash."""
    return _named(kind, path, sha256, by, lambda: check_seal(path).sha256)


def _analysis_named(kind: str, path: Path, naming: Mapping[str, Any], by: Analysis) -> Link:
    """A stored analysis that another one names by its hash."""
    sha256 = str(naming.get("analysis_sha256", ""))
    return _named(kind, path, sha256, by, lambda: read_analysis(path).seal.sha256)


def _named(kind: str, path: Path, sha256: str, by: Analysis, sealed: Callable[[], str]) -> Link:
    """A file that an analysis names by its hash, beside the one that its own seal has."""
    if not path.is_file():
        # One that lay in another place may be out of reach: these files may be a copy.
        lay_here = path.is_relative_to(by.path.parent.parent)
        severity = Severity.BLOCKS if lay_here else Severity.WARNS
        text = f"is not here; {by.name} rests on SHA-256 {sha256}"
        return Link(kind, severity, text, where=str(path))
    try:
        found = sealed()
    except RigError as error:
        return broken(kind, path, error)
    if found != sha256:
        text = f"is not the one on which {by.name} rests: that had SHA-256 {sha256}"
        return Link(kind, Severity.BLOCKS, text, where=str(path), sha256=found)
    return Link(kind, Severity.PASSED, f"ok, named by {by.name}", where=str(path), sha256=found)


def _gone(folder: Path, numbers: list[int]) -> Iterator[Link]:
    """Analyses that were stored, or begun to be, and are not there."""
    noted = {int(name[:-5]) for name in names_of_notes(folder) if name[:-5].isdigit()}
    for number in sorted(noted - set(numbers)):
        path = folder / f"{number:04d}.json"
        text = (
            f"is not there, though its note {path.name}{HASH_SUFFIX} is: "
            "its writing was cut off, or it was taken away"
        )
        yield Link("analysis", Severity.WARNS, text, where=str(path))
    for number in sorted(set(range(1, max(numbers, default=0))) - noted - set(numbers)):
        path = folder / f"{number:04d}.json"
        yield Link(
            "analysis", Severity.WARNS, "is not there, though a later one is", where=str(path)
        )
