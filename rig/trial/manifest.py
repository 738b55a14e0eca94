"""All files that are evidence on a gear, or on every gear of a folder, as one manifest.

Runs and tares, their analyses with figures and choices by hand, calibrations, gear cards with the acceptance files that
they name, campaign journals, certificates. What a person edits is listed as it lies there now.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from model.errors import WordedError
from rig.analysis.store import analysis_folder
from rig.analysis.tare import tare_kind
from rig.bench.commissioning import is_sealed_record
from rig.content.phrase import phrase
from rig.errors import ChangedRunError, RigError
from rig.gears import card as cards
from rig.gears import card_places
from rig.library.folder import ANALYSES_SUFFIX
from rig.library.index import LibraryIndex
from rig.library.listed import IndexedRun
from rig.present.certificate.record import certificate_files
from rig.run import keeping
from rig.runfile.layout import HASH_SUFFIX, PART_SUFFIX
from rig.runfile.manifest import Changes, Entry, Manifest, changes_since, read_manifest
from rig.runfile.seal import file_sha256
from rig.trial.campaign import journal

Found = tuple[Path, str]
"""A file and its kind."""


class _NothingToListError(RigError):
    """A folder without evidence, or without any on that gear."""


def _manifest_of_folder(folder: Path, serial: str = "") -> Manifest:
    """The manifest of a folder with all folders in it: of everything, or of one gear and what its analyses rest on.

    Names are paths from the folder on. Raises `RigError` where the folder holds nothing of that.
    """
    library = LibraryIndex(folder, nested=True)
    runs = [run for run in library.search(gear=serial) if not run.path.name.endswith(PART_SUFFIX)]
    found = [*_of_runs(runs), *_beside(folder, serial)]
    if serial:
        known = {path.resolve() for path, _ in found}
        tares = [path for path in _tares_of(runs) if path.resolve() not in known]
        found += [one for path in dict.fromkeys(tares) for one in _of_run(path, "tare")]
    if not found:
        raise _NothingToListError(
            "there is no evidence to list",
            where=str(folder),
            value=phrase("gear {}", serial) or "no run, no card, no certificate",
            remedy="Serial numbers are compared letter for letter; `rig runs` lists what is there.",
        )
    return Manifest.made_of(_of(serial), _entries_of(found, folder))


def _of(serial: str) -> str:
    return phrase("gear {}", serial) or "a folder of runs"


@dataclass(frozen=True)
class HeldManifest:
    """The manifest of a folder, and what became of an older one's files; `changes` is None where it was written now."""

    file: Path
    now: Manifest
    changes: Changes | None = None
    older_sha256: str = ""

    @property
    def error(self) -> RigError | None:
        """What is wrong: files of the older manifest that are gone or not as they were."""
        if self.changes is None or self.changes.is_kept:
            return None
        lost = [f"missing: {entry.name}" for entry in self.changes.missing]
        lost += [f"changed: {entry.name}" for entry, _ in self.changes.changed]
        more = phrase(", and {} more", len(lost[1:]))
        return ChangedRunError(
            "files are not as the manifest lists them",
            where=str(self.file),
            value=lost[0] + more,
            remedy="Take the originals, or the backup.",
        )

    def as_json(self) -> dict[str, Any]:
        """As `rig verify --manifest --json` tells it."""
        told: dict[str, Any] = {
            "file": str(self.file),
            "files": len(self.now.entries),
            "sha256": self.now.sha256,
            "written": self.changes is None,
        }
        if self.changes is None:
            return told
        return told | {
            "older_sha256": self.older_sha256,
            "missing": [vars(entry) for entry in self.changes.missing],
            "changed": [
                {**vars(entry), "sha256_now": now.sha256} for entry, now in self.changes.changed
            ],
            "added": [vars(entry) for entry in self.changes.added],
        }


def hold_against(file: Path, folder: Path, serial: str = "") -> HeldManifest:
    """Write the manifest of a folder, or of one gear in it; hold the folder against a file that is there already.

    A manifest that is there is never written over. Raises `RigError` for one of something else, and
    where it cannot be read or written.
    """
    if not file.exists():
        now = _manifest_of_folder(folder, serial)
        try:
            with file.open("xb") as stream:
                stream.write(now.as_bytes())
        except OSError as error:
            raise RigError(
                "the manifest cannot be written",
                where=str(file),
                value=error.strerror or str(error),
                remedy="Name a file in a folder that is there and can be written.",
            ) from None
        return HeldManifest(file, now)
    older = read_manifest(file)
    try:
        now = _manifest_of_folder(folder, serial)
    except _NothingToListError:
        now = Manifest.made_of(_of(serial), ())
    if older.of != now.of:
        raise RigError(
            "is a manifest of something else",
            where=str(file),
            value=older.of,
            limit=now.of,
            remedy="Give the --gear that it was made with, or the name of a new file.",
        )
    # What is listed and lies there is held against the list, whatever leads to it now: a card may name another file.
    found = {entry.name for entry in now.entries}
    there = [
        Entry(entry.name, entry.kind, file_sha256(folder / entry.name))
        for entry in older.entries
        if entry.name not in found and (folder / entry.name).is_file()
    ]
    now = Manifest.made_of(now.of, [*now.entries, *there])
    return HeldManifest(file, now, changes_since(older, now), older.sha256)


def _entries_of(found: Iterable[Found], folder: Path) -> Iterator[Entry]:
    """These files as lines of a manifest; their bytes are read anew."""
    start = folder.resolve()
    for path, kind in found:
        name = os.path.relpath(path.resolve(), start).replace(os.sep, "/")
        yield Entry(name, kind, file_sha256(path))


def _of_runs(runs: Iterable[IndexedRun]) -> Iterator[Found]:
    for run in runs:
        yield from _of_run(run.path, "tare" if run.protocol == tare_kind() else "run")


def _of_run(run: Path, kind: str) -> Iterator[Found]:
    """A run and everything that lies in the folder of its analyses."""
    if run.is_file():
        yield run, kind
    folder = analysis_folder(run)
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        if path.name.startswith(".") or path.name.endswith(HASH_SUFFIX):
            continue
        yield path, _kind_in_store(path)


def _kind_in_store(path: Path) -> str:
    if path.name.startswith("figures-"):
        return "figures"
    return "analysis" if path.stem.isdigit() else "choice"


def _tares_of(runs: Iterable[IndexedRun]) -> Iterator[Path]:
    """The tares that the analyses of these runs name."""
    for run in runs:
        for path, kind in _of_run(run.path, "run"):
            named = _json(path) if kind == "analysis" else {}
            file = (named.get("tare") or {}).get("file")
            if file:
                yield run.path.parent / str(file)


def _beside(folder: Path, serial: str) -> Iterator[Found]:
    """Cards, acceptance files, journals and certificates below a folder, of one gear or of all."""
    for place, inside, names in os.walk(folder):
        inside[:] = sorted(name for name in inside if not name.endswith(ANALYSES_SUFFIX))
        here = Path(place)
        paths = [here / name for name in sorted(names) if not name.endswith((HASH_SUFFIX, ".tmp"))]
        if here.name == keeping.FOLDER:
            # Named by their content, and small: those of other gears of the bench do no harm.
            yield from ((path, "calibration") for path in paths)
        elif here.name == card_places.FOLDER:
            yield from _cards(paths, serial)
        elif here.name == journal.FOLDER:
            yield from _journals(paths, serial)
        elif not here.name.startswith("."):
            for path in paths:
                if is_sealed_record(path):
                    # It is of the bench, and so of every gear on it.
                    yield path, "commissioning"
                elif path.suffix == ".json":
                    yield from ((one, "certificate") for one in certificate_files(path, serial))


def _cards(paths: Iterable[Path], serial: str) -> Iterator[Found]:
    for path in paths:
        if path.suffix != ".toml" or (serial and path.name != card_places.card_file(serial)):
            continue
        yield path, "gear card"
        try:
            named = Path(cards.load_card(path).facts.acceptance)
        except WordedError:
            continue
        if named.suffix.lower() == ".toml" and named.is_file():
            yield named, "acceptance"


def _journals(paths: Iterable[Path], serial: str) -> Iterator[Found]:
    for path in paths:
        if path.suffix == ".jsonl" and (not serial or _first_line(path).get("gear") == serial):
            yield path, "campaign"


def _first_line(path: Path) -> dict[str, Any]:
    with path.open(encoding="utf-8", errors="replace") as file:
        return _object(file.readline())


def _json(path: Path) -> dict[str, Any]:
    return _object(path.read_text(encoding="utf-8", errors="replace"))


def _object(text: str) -> dict[str, Any]:
    """A JSON object; an empty one for what is none: its bytes are listed all the same."""
    try:
        content = json.loads(text)
    except ValueError:
        return {}
    return content if isinstance(content, dict) else {}
