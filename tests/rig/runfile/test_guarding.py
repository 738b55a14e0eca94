"""A file that is being written is seen to be, by the locks of any system; where there are none, that is said."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from types import ModuleType

import pytest

from rig.errors import RunFileError
from rig.run import preflight
from rig.runfile.seal import hold_while_writing, is_guarded, refuse_live


class ByteLocks(ModuleType):
    """`msvcrt` as its documents say: a byte of a file is locked for one descriptor, as long as that is open."""

    LK_NBLCK = 2

    def __init__(self) -> None:
        super().__init__("msvcrt")
        self.owners: dict[tuple[int, int], tuple[int, int]] = {}

    def locking(self, descriptor: int, mode: int, size: int) -> None:
        assert (mode, size) == (self.LK_NBLCK, 1)
        at = os.lseek(descriptor, 0, os.SEEK_CUR)
        key = (os.fstat(descriptor).st_ino, at)
        assert at > 2**38, "a byte that is locked can't be read"
        owner = self.owners.get(key)
        # A descriptor that is asking now was closed before, if it ever was the owner.
        if owner is not None and owner[0] != descriptor and self._is_open(*owner):
            raise OSError(36, "locked")
        self.owners[key] = (descriptor, key[0])

    @staticmethod
    def _is_open(descriptor: int, inode: int) -> bool:
        try:
            return os.fstat(descriptor).st_ino == inode
        except OSError:
            return False


@pytest.fixture(params=["fcntl", "msvcrt", "neither"])
def system(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """The locks that a system has."""
    name = str(request.param)
    if name != "fcntl":
        monkeypatch.setitem(sys.modules, "fcntl", None)
        monkeypatch.setitem(sys.modules, "msvcrt", ByteLocks() if name == "msvcrt" else None)
    return name


def test_a_file_that_is_written_is_refused_until_it_is_not(system: str, tmp_path: Path) -> None:
    part = tmp_path / "00001-home-A1.h5.part"
    part.write_bytes(b"rows")
    refuse_live(part)
    release = hold_while_writing(part)
    if system == "neither":
        refuse_live(part)
    else:
        with pytest.raises(RunFileError, match=r"still being written.*Stop that run first"):
            refuse_live(part)
        assert part.read_bytes() == b"rows", "whoever only reads is not disturbed"
    release()
    release()
    refuse_live(part)


def test_preflight_says_where_nobody_guards(system: str, tmp_path: Path) -> None:
    assert is_guarded(tmp_path) == (system != "neither")
    told = preflight._guarded(tmp_path / "runs")
    assert bool(told) == (system == "neither")
    if told:
        assert "nobody guards the file of a run" in told[0].sentence
        assert "Let nobody recover" in told[0].sentence
    assert not list(tmp_path.iterdir())
