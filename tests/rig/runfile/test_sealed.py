"""Small sealed files: written whole with their note, whatever ends the writing; read and checked in one look."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from rig.errors import ChangedRunError, RunFileError, UnsealedError
from rig.runfile import sealed
from rig.runfile.seal import allowing_unsealed, hash_path
from rig.runfile.sealed import (
    names_of_notes,
    read_sealed,
    replace_sealed,
    seal_in_place,
    write_sealed,
)


class Killed(BaseException):
    """The process ends here."""


def killed_at(step: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The writing is cut off before its file number `step` (0 is the first) takes its name."""
    put, done = sealed._put, []

    def until_killed(path: Path, data: bytes, *, is_new: bool) -> None:
        if len(done) == step:
            raise Killed
        done.append(path)
        put(path, data, is_new=is_new)

    monkeypatch.setattr(sealed, "_put", until_killed)


def test_what_is_written_is_read_and_its_note_is_that_of_sha256sum(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    digest = write_sealed(path, b"{}\n")
    assert digest == hashlib.sha256(b"{}\n").hexdigest()
    assert hash_path(path).read_text() == f"{digest}  a.json\n"
    data, seal = read_sealed(path)
    assert (data, seal.sha256, seal.is_whole) == (b"{}\n", digest, True)
    assert [oct(one.stat().st_mode & 0o777) for one in (path, hash_path(path))] == ["0o444"] * 2
    with pytest.raises(FileExistsError):
        write_sealed(path, b"other")
    assert read_sealed(path)[0] == b"{}\n"
    assert names_of_notes(tmp_path) == ["a.json"]


@pytest.mark.parametrize("step", [0, 1])
def test_a_new_file_that_is_cut_off_is_not_there(
    step: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.json"
    with monkeypatch.context() as patch:
        killed_at(step, patch)
        with pytest.raises(Killed):
            write_sealed(path, b"one")
    assert not path.exists()
    assert hash_path(path).exists() == (step == 1)
    if step:
        # The name is taken: nobody else's file gets this note.
        with pytest.raises(FileExistsError):
            write_sealed(path, b"two")
        assert not path.exists()
    with pytest.raises(RunFileError, match=r"a\.json"):
        read_sealed(path)


@pytest.mark.parametrize("step", [0, 1])
def test_a_file_that_is_replaced_and_cut_off_is_refused_by_name_until_it_is_written_again(
    step: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "c.json"
    replace_sealed(path, b"one")
    with monkeypatch.context() as patch:
        killed_at(step, patch)
        with pytest.raises(Killed):
            replace_sealed(path, b"two")
    with pytest.raises(UnsealedError, match=r"c\.json"):
        read_sealed(path)
    assert path.read_bytes() == (b"one", b"two")[step]
    replace_sealed(path, b"three")
    assert read_sealed(path)[0] == b"three"


def test_a_changed_file_and_one_without_its_note_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "c.pdf"
    path.write_bytes(b"%PDF")
    with pytest.raises(UnsealedError, match="--unsealed"):
        read_sealed(path)
    with allowing_unsealed():
        assert not read_sealed(path)[1].is_whole
    assert not read_sealed(path, is_sealed_from_birth=False)[1].is_whole
    seal_in_place(path, b"%PDF")
    assert read_sealed(path)[1].is_whole
    path.write_bytes(b"%PDf")
    with (
        pytest.raises(ChangedRunError, match="was changed since it was sealed"),
        allowing_unsealed(),
    ):
        read_sealed(path)
