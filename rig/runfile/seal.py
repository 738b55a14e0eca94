"""Sealing a file: its SHA-256 beside it, its final name, read-only. After that it is never changed.

Runs are sealed here, and by the same note (`<file>.sha256`, as `sha256sum --check` reads it) the
small files of `rig.runfile.sealed`. Where the note of a file that is sealed from birth is missing,
the file is refused, unless whoever asks for it said that it may be read unsealed (`allowing_unsealed`).
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import os
import stat
import sys
import tempfile
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rig.errors import ChangedRunError, RunFileError, UnsealedError
from rig.runfile.damage import refusing_damage
from rig.runfile.layout import HASH_SUFFIX, PART_SUFFIX

_SETTLED_NS = 2_000_000_000
"""ns after its last change from which on a further one shows in a file's times, on every file system."""
_LONGEST_NOTE = 4096
_Fingerprint = tuple[int, int, int, int, int]
HASHES_KEPT = 4096
"""Hashes that a process remembers: those of thousands of runs that it looks at once need not be."""
_hashes: OrderedDict[_Fingerprint, str] = OrderedDict()
"""The latest hashes that this process took, by what changes when a file does."""

_unsealed_allowed: ContextVar[bool] = ContextVar("unsealed_allowed", default=False)


@contextlib.contextmanager
def allowing_unsealed() -> Iterator[None]:
    """Within it a file whose note is missing is read, and told as not sealed, where it is refused otherwise."""
    token = _unsealed_allowed.set(True)
    try:
        yield
    finally:
        _unsealed_allowed.reset(token)


def is_unsealed_allowed() -> bool:
    """Whether a file whose note is missing may be read (`allowing_unsealed`)."""
    return _unsealed_allowed.get()


@dataclass(frozen=True)
class Seal:
    """The SHA-256 of a file's bytes ("" while it is written), and whether it is the one noted when it was sealed."""

    sha256: str = ""
    is_whole: bool = False


def part_path(final: Path) -> Path:
    """The name of a run while it is written."""
    return final.with_name(final.name + PART_SUFFIX)


def final_path(part: Path) -> Path:
    """The name that a `.part` file gets when it is sealed."""
    return part.with_name(part.name.removesuffix(PART_SUFFIX))


def hash_path(run: Path) -> Path:
    """The file beside a sealed file that holds its SHA-256, in the form that `sha256sum --check` reads."""
    return run.with_name(run.name + HASH_SUFFIX)


def file_sha256(path: Path) -> str:
    """SHA-256 of a file's bytes, in hexadecimal."""
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise RunFileError(f"cannot be read: {error.strerror or error}", where=str(path)) from error


def recorded_sha256(run: Path) -> str:
    """The SHA-256 that was noted when the file was sealed; "" where there is no note. Raises
    `ChangedRunError` for a note that cannot be read or holds nothing.
    """
    note, reason = hash_path(run), "it is empty"
    try:
        with note.open(encoding="ascii", errors="replace") as stream:
            words = stream.read(_LONGEST_NOTE).split()
        if words:
            return words[0]
    except FileNotFoundError:
        return ""
    except OSError as error:
        reason = error.strerror or str(error)
    raise ChangedRunError(
        f"the note of the SHA-256 cannot be used: {reason}",
        where=str(note),
        remedy="Take the original, or the backup.",
    )


def check_seal(run: Path, *, anew: bool = False, now_ns: Callable[[], int] = time.time_ns) -> Seal:
    """The seal of a run file: the hash of its bytes, held against the note beside it.

    A file whose size, times and file number are those of an earlier look is not read again, unless
    `anew`. Raises `ChangedRunError` for a file that is not the one that was sealed, `UnsealedError`
    for a run without a note: every run was sealed, and nothing says that this one is what was recorded.
    """
    if run.name.endswith(PART_SUFFIX):
        return Seal()
    before = _fingerprint(run)
    computed = "" if anew else _hashes.get(before, "")
    if not computed:
        computed = file_sha256(run)
        if _fingerprint(run) != before:
            raise ChangedRunError("was changed while it was read", where=str(run))
        if now_ns() - max(before[-2:]) > _SETTLED_NS:
            _hashes[before] = computed
            if len(_hashes) > HASHES_KEPT:
                _hashes.popitem(last=False)
    return held_against_note(run, computed)


def held_against_note(path: Path, computed: str, *, is_sealed_from_birth: bool = True) -> Seal:
    """The seal of a file whose bytes have the SHA-256 `computed`, held against the note beside it.

    Raises `ChangedRunError` where the note says another, `UnsealedError` where there is none although
    it was sealed from birth (unless that is allowed).
    """
    noted = recorded_sha256(path)
    if not noted and is_sealed_from_birth and not is_unsealed_allowed():
        raise unsealed(path)
    if noted and noted != computed:
        changed, sealed = (_moment(one.stat().st_mtime) for one in (path, hash_path(path)))
        raise ChangedRunError(
            "was changed since it was sealed",
            where=str(path),
            value=f"SHA-256 {computed} ({path.stat().st_size} bytes, last changed {changed})",
            limit=f"{noted} (noted {sealed})",
            remedy="Take the original, or the backup.",
        )
    return Seal(computed, bool(noted))


def unsealed(path: Path) -> UnsealedError:
    """The refusal of a file that was sealed when it was made, and whose note is gone."""
    return UnsealedError(
        "is not sealed: the note of its SHA-256 is missing",
        where=str(path),
        limit=f"a file {hash_path(path).name} beside it",
        remedy="Take the original with its note, or the backup; --unsealed uses it as it is, and says so.",
    )


def sealed_sha256(run: Path) -> str:
    """The SHA-256 of a sealed run at a glance: as it was noted, where the file is no younger than its note.

    For lists of many runs. A younger file is read (`check_seal`); so is one without a note. Raises
    `ChangedRunError` for a file that is not the one that was sealed, `RunFileError` for one that is gone.
    """
    noted = recorded_sha256(run)
    with refusing_damage(run):
        if noted and run.stat().st_mtime_ns <= hash_path(run).stat().st_mtime_ns:
            return noted
    return check_seal(run).sha256


def forget_hashes() -> None:
    """From here on every file is read again: for what must not lean on an earlier look."""
    _hashes.clear()


def _fingerprint(run: Path) -> _Fingerprint:
    """What changes when a file does: device, file number, size, and the times of its content and of itself [ns]."""
    with refusing_damage(run):
        status = run.stat()
        return status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns
    raise AssertionError


def _moment(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds")


def seal_file(part: Path, final: Path) -> Path:
    """Hash, make read-only and rename a closed file; an existing run is never overwritten."""
    try:
        digest = file_sha256(part)
        if final.exists():
            raise RunFileError(
                "there is a run of this name already",
                where=str(final),
                remedy="Move it away first.",
            )
        note = hash_path(final)
        note.unlink(missing_ok=True)
        # The note comes first: a sealed run without its hash could be anything, a hash without a run harms nobody.
        note.write_text(note_text(digest, final), encoding="utf-8")
        _synchronise(note)
        # The bytes reach the disk before the name does, or a power cut leaves a sealed name with half a run.
        _synchronise(part)
        rename_to_new(part, final)
        protect(final)
        synchronise_folder(final.parent)
    except OSError as error:
        raise RunFileError(
            f"cannot be sealed: {error.strerror or error}",
            where=str(part),
            remedy="The data are complete in this file; make room, then use `rig recover`.",
        ) from error
    return final


def note_text(digest: str, path: Path) -> str:
    """What stands in the note of a file: one line as `sha256sum --check` reads it."""
    return f"{digest}  {path.name}\n"


def synchronise_folder(folder: Path) -> None:
    """A new name is an entry of its folder; where folders cannot be opened (Windows) the system sees to it."""
    if hasattr(os, "O_DIRECTORY"):
        _synchronise(folder)


def protect(run: Path) -> None:
    """Make a file and the note of its hash read-only."""
    for path in (run, hash_path(run)):
        path.chmod(stat.S_IRUSR | stat.S_IRGRP | stat.S_IROTH)


def hold_while_writing(part: Path) -> Callable[[], None]:
    """Mark a file as being written for as long as this process lives; returns what takes the mark away.

    Other programs that read the growing file, and take shared locks themselves, are not disturbed.
    """
    descriptor = os.open(part, os.O_RDONLY | getattr(os, "O_BINARY", 0))
    with contextlib.suppress(OSError):
        _mark(descriptor, is_writer=True)
    return _closing_once(descriptor)


def refuse_live(part: Path) -> None:
    """Raise `RunFileError` for a file that a living writer holds, where the file system has locks."""
    with contextlib.suppress(OSError), part.open("rb") as stream:
        if not _mark(stream.fileno(), is_writer=False):
            raise RunFileError(
                "is still being written", where=str(part), remedy="Stop that run first."
            )


def is_guarded(folder: Path) -> bool:
    """Whether a file in this folder that one program writes can be seen to be written by another. Raises `OSError`."""
    descriptor, name = tempfile.mkstemp(dir=folder)
    os.close(descriptor)
    release = hold_while_writing(Path(name))
    try:
        refuse_live(Path(name))
    except RunFileError:
        return True
    finally:
        release()
        os.unlink(name)
    return False


_MARK_AT = 2**40
"""Where Windows locks one byte: behind the end of every run, since nobody may read a byte that is locked there."""


def _mark(descriptor: int, *, is_writer: bool) -> bool:
    """Lock a file as its writer, or look whether a writer holds it: False where it is held.

    True where the system has no locks. Raises `OSError` where its file system has none.
    """
    if sys.platform == "win32":
        return _mark_by_byte(descriptor)
    try:
        import fcntl
    except ImportError:
        return _mark_by_byte(descriptor)
    try:
        fcntl.flock(descriptor, (fcntl.LOCK_SH if is_writer else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _mark_by_byte(descriptor: int) -> bool:
    """The same on Windows (never run there): one byte, locked by whoever writes and asked for by whoever looks."""
    try:
        msvcrt: Any = importlib.import_module("msvcrt")
    except ImportError:
        return True
    os.lseek(descriptor, _MARK_AT, os.SEEK_SET)
    try:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
    except OSError:
        return False
    return True


def _closing_once(descriptor: int) -> Callable[[], None]:
    """Close a descriptor at the first call and do nothing at later ones."""
    left = [descriptor]

    def close() -> None:
        if left:
            os.close(left.pop())

    return close


def rename_to_new(part: Path, final: Path) -> None:
    """Rename without replacing anything; a hard link does that atomically where the file system has them.

    Raises `FileExistsError` for a name that is taken.
    """
    try:
        os.link(part, final)
    except FileExistsError:
        raise
    except (OSError, NotImplementedError):
        part.rename(final)
    else:
        part.unlink()


def _synchronise(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
