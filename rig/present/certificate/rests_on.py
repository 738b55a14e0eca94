"""What a certificate rests on, as a manifest: not the certificate itself, and nothing that came after it.

Runs with the analyses in force that stand in it, their figures, what chose an analysis by hand, tares with their
analyses, analyses that they build on, copies of calibrations, the gear card, the acceptance file, and the programs.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from rig.analysis.in_force import KEPT_NAME, InForce, in_force_by_kind
from rig.analysis.learnt import learnt_by
from rig.analysis.store import Analysis, analysis_folder
from rig.gears.card import card_path
from rig.present.certificate.gather import Certified
from rig.program import EXTENSIONS, Program, brought_by, this_program
from rig.runfile.manifest import Entry, Manifest
from rig.runfile.seal import file_sha256

_Thing = tuple[Path, str]
"""A file and its kind."""
PROGRAM = "program"
"""The kind of an entry that is no file: a program by its version and commit, with the hash of its files."""


def manifest_of(gathered: Certified) -> Manifest:
    """The manifest of what a certificate rests on; names are paths from the folder of runs on."""
    start = gathered.folder.resolve()
    entries = {
        Entry(_name(path, start), kind, file_sha256(path))
        for path, kind in _things(gathered)
        if path.is_file()
    }
    programs = {this_program(), *programs_of(gathered)}
    entries |= {
        Entry(f"harmonic-rig {one.version} {one.commit}".rstrip(), PROGRAM, one.sha256)
        for one in programs
        if one.sha256
    }
    entries |= {
        Entry(f"{brought['package']} {brought['version']}", PROGRAM, brought["sha256"])
        for content in _contents(gathered)
        for brought in content.get(EXTENSIONS, ())
        if brought["sha256"]
    }
    return Manifest.made_of(f"what the certificate of gear {gathered.serial} rests on", entries)


def programs_of(gathered: Certified) -> tuple[Program, ...]:
    """The programs that made the analyses of a certificate, each once."""
    found = (one.analysis for one in gathered.analyses)
    return tuple(dict.fromkeys(Program.from_json(one.content) for one in found if one is not None))


def _contents(gathered: Certified) -> Iterator[Mapping[str, Any]]:
    """What runs and analyses say of how they were made."""
    for fit, found in zip(gathered.fits, gathered.analyses, strict=True):
        yield fit.recording.metadata.process
        if found.analysis is not None:
            yield found.analysis.content


def brought_to(gathered: Certified) -> tuple[str, ...]:
    """What other packages brought to the runs and the analyses of a certificate, each once."""
    found = (one for content in _contents(gathered) for one in brought_by(content))
    return tuple(dict.fromkeys(found))


def _name(path: Path, start: Path) -> str:
    return os.path.relpath(path.resolve(), start).replace(os.sep, "/")


def _things(gathered: Certified) -> Iterator[_Thing]:
    for fit, found in zip(gathered.fits, gathered.analyses, strict=True):
        assert fit.path is not None
        yield from _of_analysis(fit.path, found)
        for used in fit.recording.metadata.process.get("files", ()):
            if used.get("copy"):
                yield fit.path.parent / str(used["copy"]), "calibration"
    if gathered.has_charts:
        for run in gathered.runs:
            for found in in_force_by_kind(run.path).values():
                yield from _of_analysis(run.path, found)
    yield card_path(gathered.folder, gathered.serial), "gear card"
    if gathered.acceptance is not None and gathered.acceptance.path.lower().endswith(".toml"):
        yield Path(gathered.acceptance.path), "acceptance"


def _of_analysis(run: Path, found: InForce) -> Iterator[_Thing]:
    if found.analysis is not None:
        for path, _ in learnt_by(run.parent, found.analysis.result.options):
            yield path, "calibration"
    yield run, "run"
    if found.analysis is None:
        return
    yield analysis_folder(run) / KEPT_NAME, "choice"
    yield from _stored(found.analysis)
    tare = found.analysis.tare
    if tare.get("file"):
        path = run.parent / str(tare["file"])
        yield path, "tare"
        yield from _named(path.parent, tare.get("analysis"))
    builds_on = (found.analysis.content.get("gear_source") or {}).get("builds_on") or {}
    if builds_on:
        yield from _built_on(run.parent, builds_on)


def _stored(analysis: Analysis) -> Iterator[_Thing]:
    yield analysis.path, "analysis"
    figures = str(analysis.content.get("figures", ""))
    if figures:
        yield analysis.path.parent / figures, "figures"


def _named(folder: Path, name: Any) -> Iterator[_Thing]:
    if name:
        yield folder / str(name), "analysis"


def _built_on(folder: Path, named: Mapping[str, Any]) -> Iterator[_Thing]:
    """The run on whose analysis another one builds, and that analysis."""
    run = folder / str(named.get("file", ""))
    yield run, "run"
    yield from _named(analysis_folder(run), f"{int(named.get('number', 0)):04d}.json")
