"""`import rig`: light, complete, and one sentence where another package stands in the way."""

from __future__ import annotations

import json
import os
import pkgutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import rig

HEAVY = ("numpy", "scipy", "h5py", "numba", "matplotlib", "pandas", "xarray", "typer", "model")


def python(code: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """A script that lies in a folder and is started there, as its owner would."""
    script = folder / "script.py"
    script.write_text(code, encoding="utf-8")
    words = [sys.executable, str(script)]
    return subprocess.run(
        words, cwd=folder, capture_output=True, text=True, timeout=1800, check=False
    )


def test_the_import_loads_no_array_library_until_something_is_used(tmp_path: Path) -> None:
    code = (
        "import sys, json, rig\n"
        f"before = [m for m in {HEAVY!r} if m in sys.modules]\n"
        "names = dir(rig)\nrig.simulate\n"
        "print(json.dumps([before, 'load' in names, 'numpy' in sys.modules]))"
    )
    done = python(code, tmp_path)
    assert json.loads(done.stdout) == [[], True, True], done.stderr


def test_every_public_name_is_there_and_says_what_it_is() -> None:
    for name in rig.__all__:
        assert (getattr(rig, name).__doc__ or "").strip(), name
    assert set(rig.__all__) == set(rig._PLACES)


def test_no_public_name_is_a_module() -> None:
    modules = {module.name for module in pkgutil.iter_modules(rig.__path__)}
    assert not modules & set(rig.__all__)


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'lode'"):
        rig.lode  # noqa: B018


def test_a_model_beside_a_script_is_named_in_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "model.py").write_text("mine = 1\n", encoding="utf-8")
    done = python(
        "import rig\ntry:\n    rig.load\nexcept ImportError as e:\n    print(e)", tmp_path
    )
    (sentence,) = done.stdout.splitlines()
    assert (
        f"finds {tmp_path / 'model.py'}, which is not the package model of harmonic-rig" in sentence
    )
    assert done.stderr == ""


def test_a_foreign_package_ends_the_command_with_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "drivers").mkdir()
    (tmp_path / "drivers" / "__init__.py").write_text("", encoding="utf-8")
    paths = {**os.environ, "PYTHONPATH": str(tmp_path)}
    words = [sys.executable, "-m", "rig", "--help"]
    done = subprocess.run(
        words, env=paths, cwd=tmp_path, capture_output=True, text=True, timeout=1800, check=False
    )
    assert done.returncode == 6
    (sentence,) = done.stderr.splitlines()
    assert f"finds {tmp_path / 'drivers'}, which is not the package drivers" in sentence


def test_another_distribution_that_wrote_into_our_folder_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from rig.floors import foreign_floor

    assert foreign_floor() == ""
    monkeypatch.delattr(rig, "DISTRIBUTION")
    assert foreign_floor().startswith("`import rig` finds")


def test_a_module_made_by_hand_is_no_floor_of_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    from rig.floors import foreign_floor

    module = ModuleType("drivers")
    module.__spec__ = None
    monkeypatch.setitem(sys.modules, "drivers", module)
    assert "<module drivers in memory>" in foreign_floor()
