"""The program by its version, commit and hash: the same files give the same, any other file gives another."""

from __future__ import annotations

import fnmatch
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

from rig import program
from rig.floors import OURS
from rig.program import CHANGED, PACKAGES, Program, files_sha256, this_program, tree_commit


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A small program of five packages."""
    for package in PACKAGES:
        folder = tmp_path / "clone" / package
        folder.mkdir(parents=True)
        (folder / "__init__.py").write_bytes(b"x = 1\ny = 2\n")
    (tmp_path / "clone" / "model" / "gears").mkdir()
    (tmp_path / "clone" / "model" / "gears" / "a.toml").write_bytes(b"teeth = 200\n")
    return tmp_path / "clone"


def test_the_same_files_give_the_same_hash_wherever_they_lie(tree: Path, tmp_path: Path) -> None:
    expected = files_sha256(tree)
    other = tmp_path / "site-packages"
    shutil.copytree(tree, other)
    (other / "rig" / "__pycache__").mkdir()
    (other / "rig" / "__pycache__" / "__init__.cpython-311.pyc").write_bytes(b"\0")
    (other / "numpy").mkdir()
    (other / "numpy" / "__init__.py").write_text("of other people")
    for path in other.glob("*/__init__.py"):
        path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    assert files_sha256(other) == expected


@pytest.mark.parametrize("change", ["edit", "rename", "add", "delete", "move the border"])
def test_any_other_program_has_another_hash(tree: Path, change: str) -> None:
    before = files_sha256(tree)
    first, gear = tree / "rig" / "__init__.py", tree / "model" / "gears" / "a.toml"
    if change == "edit":
        gear.write_text("teeth = 202\n")
    elif change == "rename":
        gear.rename(gear.with_name("b.toml"))
    elif change == "add":
        (tree / "drivers" / "more.py").touch()
    elif change == "delete":
        gear.unlink()
    else:
        first.write_bytes(b"x = 1\n")
        (tree / "rig" / "__init__a.py").write_bytes(b"y = 2\n")
    assert files_sha256(tree) != before


def test_what_is_hashed_is_what_a_wheel_ships() -> None:
    project = tomllib.loads((OURS / "pyproject.toml").read_text(encoding="utf-8"))
    data = project["tool"]["setuptools"]["package-data"]
    hashed = {name for name, _ in program._shipped(OURS)}
    for name in hashed:
        package, _, inside = name.partition("/")
        patterns = [*data.get(package, ())]
        shipped = inside.endswith((".py", "py.typed")) or any(
            fnmatch.fnmatch(inside, pattern) for pattern in patterns
        )
        assert shipped, f"{name} is hashed, and no wheel carries it"
    for package, patterns in data.items():
        for pattern in patterns if package in PACKAGES else ():
            found = {path.relative_to(OURS).as_posix() for path in (OURS / package).glob(pattern)}
            assert found
            assert found <= hashed


def git(tree: Path, *words: str) -> None:
    who = ["-c", "user.name=A", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false"]
    subprocess.run(["git", "-C", str(tree), *who, *words], check=True, capture_output=True)


@pytest.mark.skipif(shutil.which("git") is None, reason="git is not here")
def test_a_changed_tree_says_so_beside_its_commit(
    tree: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert tree_commit(tree) == ""
    git(tree, "init", "-q")
    assert tree_commit(tree) == ""
    git(tree, "add", ".")
    git(tree, "commit", "-q", "-m", "first")
    monkeypatch.setenv("GIT_DIR", str(tree / "elsewhere"))
    commit = tree_commit(tree)
    assert len(commit) == 40
    (tree / "runs").mkdir()
    (tree / "runs" / "00001-friction.h5").touch()
    assert tree_commit(tree) == commit
    (tree / "rig" / "more.py").touch()
    assert tree_commit(tree) == commit + CHANGED
    (tree / "rig" / "more.py").unlink()
    (tree / "rig" / "__init__.py").write_text("x = 3\n")
    assert tree_commit(tree) == commit + CHANGED


def test_this_program_names_all_three_and_is_asked_once() -> None:
    told = this_program()
    assert told is this_program()
    assert len(told.sha256) == 64
    assert Program.from_json(told.as_json()) == told
    assert told.sha256[:12] in told.in_words()
    assert Program.from_json({}).in_words() == "version not stated, files not hashed"


def test_the_version_is_that_of_the_tree_and_not_of_an_older_installation(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(program.metadata, "version", lambda name: "0.0.1")
    program.version.cache_clear()
    stated = tomllib.loads((OURS / "pyproject.toml").read_text(encoding="utf-8"))
    try:
        assert program.version() == stated["project"]["version"]
    finally:
        program.version.cache_clear()
