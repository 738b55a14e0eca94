"""A manifest: a sorted list of files by name, kind and SHA-256, as one text file, with one hash over it.

A hash that lies beside its file says that nobody changed the one without the other, and no more: whoever
can write the folder can write both. A manifest is small enough to lie elsewhere, and its own hash to be printed,
posted or signed; what it names cannot be changed unnoticed from then on by somebody who cannot change that too.
There is no time in it: the same files give the same bytes.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from rig.errors import RigError

HEADING = "# harmonic-rig manifest 1: "
SUFFIX = ".manifest.txt"
_SHA256 = re.compile(r"[0-9a-f]{64}")
_ESCAPES = (("\\", r"\\"), ("\t", r"\t"), ("\n", r"\n"), ("\r", r"\r"))


@dataclass(frozen=True, order=True)
class Entry:
    """One file: its name from the manifest's folder on, what it is, and the SHA-256 of its bytes."""

    name: str
    kind: str
    sha256: str


@dataclass(frozen=True)
class Manifest:
    """What files there are of something. `of` says of what: a folder's content, a gear, a certificate."""

    of: str
    entries: tuple[Entry, ...]

    @classmethod
    def made_of(cls, of: str, entries: Iterable[Entry]) -> Manifest:
        """The manifest of these files, sorted, each once."""
        return cls(of, tuple(sorted(set(entries))))

    def as_bytes(self) -> bytes:
        """The text file: a heading, then a line per file with name, kind and SHA-256 between tabs."""
        lines = [HEADING + _escaped(self.of)]
        lines += [f"{_escaped(e.name)}\t{e.kind}\t{e.sha256}" for e in self.entries]
        return ("\n".join(lines) + "\n").encode()

    @property
    def sha256(self) -> str:
        """The one hash over it: that of the text file, as `sha256sum` gives it."""
        return hashlib.sha256(self.as_bytes()).hexdigest()


@dataclass(frozen=True)
class Changes:
    """What became of the files of an older manifest."""

    missing: tuple[Entry, ...] = ()
    changed: tuple[tuple[Entry, Entry], ...] = ()
    """As it was listed, and as it is."""
    added: tuple[Entry, ...] = ()

    @property
    def is_kept(self) -> bool:
        """Whether all that was listed is there as it was; what was added since breaks nothing."""
        return not (self.missing or self.changed)


def changes_since(older: Manifest, now: Manifest) -> Changes:
    """What is missing, changed or added since an older manifest; one that changed its kind is changed."""
    before = {entry.name: entry for entry in older.entries}
    after = {entry.name: entry for entry in now.entries}
    return Changes(
        missing=tuple(entry for name, entry in before.items() if name not in after),
        changed=tuple(
            (entry, after[name])
            for name, entry in before.items()
            if name in after and after[name] != entry
        ),
        added=tuple(entry for name, entry in after.items() if name not in before),
    )


def read_manifest(path: Path) -> Manifest:
    """A manifest as it lies there. Raises `RigError` for a file that cannot be read or is none."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise RigError(
            "the manifest cannot be read", where=str(path), value=error.strerror or str(error)
        ) from None
    return manifest_from(data, str(path))


def manifest_from(data: bytes, where: str) -> Manifest:
    """A manifest from its bytes. Raises `RigError` for bytes that `Manifest.as_bytes` would not write."""
    lines = data.decode("utf-8", errors="replace").removesuffix("\n").split("\n")
    if not lines[0].startswith(HEADING):
        raise _no_manifest(where, lines[0], f"a first line {HEADING!r}...")
    entries = []
    for number, line in enumerate(lines[1:], 2):
        words = line.split("\t")
        if len(words) != 3 or not _SHA256.fullmatch(words[2]):
            limit = "name, kind and SHA-256 between tabs"
            raise _no_manifest(f"{where}, line {number}", line, limit)
        entries.append(Entry(_plain(words[0]), words[1], words[2]))
    manifest = Manifest.made_of(_plain(lines[0].removeprefix(HEADING)), entries)
    if manifest.as_bytes() != data:
        raise _no_manifest(where, "other bytes than this program writes", "sorted lines, each once")
    return manifest


def _no_manifest(where: str, value: str, limit: str) -> RigError:
    return RigError(
        "is no manifest of this program",
        where=where,
        value=value[:200],
        limit=limit,
        remedy="Take the file as it was written; a new one is written under a name that is free.",
    )


def _escaped(text: str) -> str:
    for plain, written in _ESCAPES:
        text = text.replace(plain, written)
    return text


def _plain(text: str) -> str:
    back = {written[1]: plain for plain, written in _ESCAPES}
    return re.sub(r"\\(.)", lambda found: back.get(found[1], found[0]), text)
