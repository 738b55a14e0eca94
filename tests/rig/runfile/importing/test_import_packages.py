"""Kinds of files that need a package which is not there."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from rig.errors import RigError
from rig.runfile.importing import opening
from rig.runfile.importing.opening import open_table


@pytest.mark.parametrize(
    ("kind", "package", "module"),
    [
        ("parquet", "pyarrow", "pyarrow.parquet"),
        ("tdms", "nptdms", "nptdms"),
        ("mdf", "asammdf", "asammdf"),
    ],
)
def test_a_package_that_is_missing_is_named_with_the_line_that_installs_it(
    kind: str, package: str, module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    said = rf"needs the package {package}, .*: pip install 'harmonic-rig\[import\]'"
    (file := tmp_path / f"bench.{kind}").touch()
    with pytest.raises(RigError, match=said):
        open_table(kind, file)


def test_each_of_these_packages_is_named_by_one_adapter() -> None:
    """What a foreign format asks of its library stands in one file."""
    importing = Path(opening.__file__).parent
    named: dict[str, set[str]] = {}
    for file in importing.rglob("*.py"):
        for package in re.findall(r'optional\("(\w+)', file.read_text(encoding="utf-8")):
            named.setdefault(package, set()).add(file.relative_to(importing).as_posix())
    assert named == {
        "pyarrow": {"adapters/parquet.py"},
        "nptdms": {"adapters/tdms.py"},
        "asammdf": {"adapters/mdf.py"},
    }
