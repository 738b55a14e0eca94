"""Small files that are sealed as runs are: analyses, copies of calibrations, certificates.

A new file takes its name by its note (`<file>.sha256`), which stands before the file does; both
reach the disk under a scratch name first. What a kill can leave:

- a scratch file (`.<name>.<process>.tmp`): nothing reads it;
- a note without its file: the name is taken, nothing was stored, and `rig verify` names it;
- of a file that is replaced (a certificate): the file without its note, which is refused by name as
  not sealed until it is written again.

Never a file with the note of another.
"""

from __future__ import annotations

import hashlib
import os
import stat
from pathlib import Path

from rig.errors import ConfigurationError, RunFileError
from rig.runfile.layout import HASH_SUFFIX
from rig.runfile.seal import (
    Seal,
    hash_path,
    held_against_note,
    note_text,
    rename_to_new,
    synchronise_folder,
)

_READ_ONLY = stat.S_IRUSR | stat.S_IRGRP | stat.S_IROTH


def write_sealed(path: Path, data: bytes) -> str:
    """Write a new file with its note, both read-only, and return its SHA-256.

    Raises `FileExistsError` where the name or its note is taken, `OSError` where it cannot be written.
    """
    digest, note = hashlib.sha256(data).hexdigest(), hash_path(path)
    if path.exists():
        raise FileExistsError(str(path))
    # Whoever has the note has the name: two writers never seal each other's file.
    _put(note, note_text(digest, path).encode(), is_new=True)
    _put(path, data, is_new=True)
    synchronise_folder(path.parent)
    return digest


def write_new_sealed(path: Path, data: bytes) -> Path:
    """Write a new file that a person named, with its note. Raises `ConfigurationError`; a name that is taken is left
    alone.
    """
    try:
        write_sealed(path, data)
    except FileExistsError as error:
        raise ConfigurationError(
            "exists already and is left alone", where=str(path), remedy="Name another file."
        ) from error
    except OSError as error:
        raise ConfigurationError(
            "cannot be written", where=str(path), value=error.strerror or str(error)
        ) from error
    return path


def replace_sealed(path: Path, data: bytes) -> str:
    """Write a file over an earlier one, with its note, and return its SHA-256. Raises `OSError`."""
    # Without its note the old file is refused by name; with the note of the new one it would be called changed.
    hash_path(path).unlink(missing_ok=True)
    _put(path, data, is_new=False)
    return seal_in_place(path, data)


def seal_in_place(path: Path, data: bytes) -> str:
    """Note the SHA-256 of a file that lies there with these bytes; an earlier note is replaced."""
    digest = hashlib.sha256(data).hexdigest()
    _put(hash_path(path), note_text(digest, path).encode(), is_new=False)
    synchronise_folder(path.parent)
    return digest


def read_sealed(path: Path, *, is_sealed_from_birth: bool = True) -> tuple[bytes, Seal]:
    """The bytes of a file and its seal; read once, and held against the note beside it.

    Raises `ChangedRunError` for bytes that are not those that were sealed, `UnsealedError` where there
    is no note although it was sealed from birth (unless that is allowed), `RunFileError` for a file
    that cannot be read.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise RunFileError(f"cannot be read: {error.strerror or error}", where=str(path)) from error
    digest = hashlib.sha256(data).hexdigest()
    return data, held_against_note(path, digest, is_sealed_from_birth=is_sealed_from_birth)


def names_of_notes(folder: Path) -> list[str]:
    """The names of the files of a folder that have, or had, a note."""
    return sorted(
        path.name.removesuffix(HASH_SUFFIX) for path in folder.glob(f"[!.]*{HASH_SUFFIX}")
    )


def _put(path: Path, data: bytes, *, is_new: bool) -> None:
    """Write a whole read-only file under its name or nothing at all; `is_new` takes no name that is taken."""
    scratch = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with scratch.open("xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        scratch.chmod(_READ_ONLY)
        if is_new:
            rename_to_new(scratch, path)
        else:
            scratch.replace(path)
    finally:
        scratch.unlink(missing_ok=True)
