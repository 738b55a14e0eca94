"""Kinds of files that need a package which is not there."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from rig.errors import RigError
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
    kind: str, package: str, module: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    said = rf"needs the package {package}, .*: pip install 'harmonic-rig\[import\]'"
    with pytest.raises(RigError, match=said):
        open_table(kind, Path(f"bench.{kind}"))
