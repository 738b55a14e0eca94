"""The chain of evidence of a file or a folder: runs with what they rest on, campaigns, gear cards, sealed files."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from experiments.finding import Severity
from rig.analysis.chain import Link, broken, links_of_run
from rig.analysis.store import analysis_folder
from rig.bench.commissioning import is_sealed_record
from rig.errors import RigError
from rig.gears import card as cards
from rig.gears.acceptance import shipped_acceptance
from rig.library.folder import ANALYSES_SUFFIX, RUN_SUFFIXES, run_files
from rig.run.frames import SUFFIX as FRAMES_SUFFIX
from rig.runfile.layout import HASH_SUFFIX
from rig.runfile.seal import check_seal, file_sha256
from rig.runfile.sealed import read_sealed
from rig.trial.campaign import journal as journals
from rig.trial.commission.record import links_of_record

_OTHER_RUN_SUFFIXES = (".hdf5", ".nxs")
"""How files of other programs end that are opened as runs."""


def runs_in(path: Path) -> list[Path]:
    """The run files that a file or a folder means: itself, those of a folder and of the folders in it, or the run
    beside whose analyses it lies.
    """
    if path.is_dir() and not path.name.endswith(ANALYSES_SUFFIX):
        return [run for folder in _folders(path) for run in run_files(folder)]
    folder = path if path.name.endswith(ANALYSES_SUFFIX) else path.parent
    if folder.name.endswith(ANALYSES_SUFFIX):
        stem = folder.name.removesuffix(ANALYSES_SUFFIX)
        return [folder.with_name(f"{stem}.h5")]
    return [path] if _is_run(path) else []


def links_of(path: Path) -> Iterator[Link]:
    """The links of the chain that a file or a folder means, in the order in which one rests on the other."""
    for run in runs_in(path):
        yield from links_of_run(run)
    if path.is_dir():
        for folder in _folders(path):
            yield from _links_of_folder(folder)
    elif path.suffix == ".jsonl":
        yield from _links_of_campaign(path)
    elif path.suffix == ".toml":
        yield _card(path)
    elif is_sealed_record(path):
        yield from links_of_record(path)
    elif not runs_in(path):
        yield _sealed_link(_kind(path), path)


def _links_of_campaign(path: Path) -> Iterator[Link]:
    """A campaign's journal, line by line, and the runs that it names."""
    try:
        journal = journals.read(path)
    except RigError as error:
        yield broken("campaign", path, error)
        return
    if journal is None:
        yield Link(
            "campaign", Severity.WARNS, "nothing was begun in it: it was cut off", where=str(path)
        )
        return
    if journal.is_chained:
        yield Link(
            "campaign",
            Severity.PASSED,
            "ok, each line follows upon the one before",
            where=str(path),
        )
    else:
        yield Link("campaign", Severity.WARNS, "not sealed (0.2.0)", where=str(path))
    for done in journal.stages:
        yield from _run_of(path, done)
    if journal.ended is not None:
        yield from _links_of_end(path, journal.ended)


def _links_of_end(path: Path, ended: Mapping[str, Any]) -> Iterator[Link]:
    """What the end of a campaign names: its certificates, and what the gear had to show."""
    for one in ended.get("certificates", ()):
        certificate = path.parent.parent / str(one["name"])
        yield _named("certificate", certificate, str(one["sha256"]), path, Severity.BLOCKS)
    if ended.get("acceptance_sha256"):
        # People edit this file: another edition of it is no forgery, but no longer what the verdict rests on.
        yield _acceptance(str(ended["acceptance"]), str(ended["acceptance_sha256"]), path)


def _named(kind: str, path: Path, sha256: str, by: Path, severity: Severity) -> Link:
    """A file that something else names by its hash."""
    if not path.is_file():
        return Link(
            kind, Severity.WARNS, f"is not here, though {by.name} names it", where=str(path)
        )
    found = file_sha256(path)
    if found != sha256:
        text = f"is not the one that {by.name} names: that had SHA-256 {sha256}"
        return Link(kind, severity, text, where=str(path), sha256=found)
    return Link(kind, Severity.PASSED, f"ok, named by {by.name}", where=str(path), sha256=found)


def _acceptance(name: str, sha256: str, by: Path) -> Link:
    if name.lower().endswith(".toml"):
        return _named("acceptance", Path(name), sha256, by, Severity.WARNS)
    try:
        found = shipped_acceptance(name).sha256
    except RigError as error:
        return Link("acceptance", Severity.WARNS, str(error), where=name)
    severity, text = Severity.PASSED, f"ok, named by {by.name}"
    if found != sha256:
        severity, text = Severity.WARNS, f"is another one in this version than for {by.name}"
    return Link("acceptance", severity, text, where=name, sha256=found)


def _run_of(path: Path, done: journals.DoneStage) -> Iterator[Link]:
    run = path.parent.parent / done.run
    if not run.is_file():
        yield Link(
            "run", Severity.WARNS, f"is not here, though {path.name} names it", where=str(run)
        )
        return
    if not done.sha256:
        return
    try:
        found = check_seal(run).sha256
    except RigError as error:
        yield broken("run", run, error)
        return
    if found != done.sha256:
        text = f"is not the one that {path.name} names: that had SHA-256 {done.sha256}"
        yield Link("run", Severity.BLOCKS, text, where=str(run), sha256=found)


def _sealed_link(kind: str, path: Path) -> Link:
    """A file that has, or must have, a note of its SHA-256 beside it."""
    try:
        _, seal = read_sealed(path)
    except RigError as error:
        return broken(kind, path, error)
    if not seal.is_whole:
        return Link(
            kind,
            Severity.WARNS,
            "is not sealed: its note is missing",
            where=str(path),
            sha256=seal.sha256,
        )
    return Link(kind, Severity.PASSED, "ok", where=str(path), sha256=seal.sha256)


def _kind(path: Path) -> str:
    """What a sealed file is that is neither run nor record."""
    return "frames" if path.name.endswith(FRAMES_SUFFIX) else "certificate"


def _card(path: Path) -> Link:
    try:
        card = cards.load_card(path)
    except RigError as error:
        return broken("gear card", path, error)
    severity = Severity.WARNS if card.warning else Severity.PASSED
    return Link("gear card", severity, card.warning or "ok, as it was confirmed", where=str(path))


def _links_of_folder(folder: Path) -> Iterator[Link]:
    """What lies in a folder of runs besides them: sealed files, campaigns, gear cards."""
    for note in sorted(folder.glob(f"*{HASH_SUFFIX}")):
        path = note.with_name(note.name.removesuffix(HASH_SUFFIX))
        if _is_run(path):
            if not path.exists() and not path.with_name(f"{path.name}.part").exists():
                yield _lost(path, "note is")
        elif is_sealed_record(path):
            yield from links_of_record(path)
        else:
            yield _sealed_link(_kind(path), path)
    analysed = {analysis_folder(path) for path in folder.iterdir() if _is_run(path)}
    for path in sorted(folder.glob(f"*{ANALYSES_SUFFIX}")):
        if path not in analysed and any(path.glob("[0-9]*.json")):
            yield _lost(path, "analyses are")
    for path in sorted((folder / journals.FOLDER).glob("*.jsonl")):
        yield from _links_of_campaign(path)
    for path in sorted(cards.cards_folder(folder).glob("*.toml")):
        yield _card(path)


def _lost(path: Path, left: str) -> Link:
    return Link("run", Severity.BLOCKS, f"is not there, though its {left}", where=str(path))


def _folders(path: Path) -> Iterator[Path]:
    """A folder and the folders in it, but for those of analyses and hidden ones."""
    for place, folders, _ in os.walk(path):
        folders[:] = sorted(
            name
            for name in folders
            if not name.startswith(".") and not name.endswith(ANALYSES_SUFFIX)
        )
        yield Path(place)


def _is_run(path: Path) -> bool:
    return path.name.lower().endswith((*RUN_SUFFIXES, *_OTHER_RUN_SUFFIXES))
