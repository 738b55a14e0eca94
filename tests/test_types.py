"""Types are checked as strictly as a folder says in every file of it; the tests that are not yet are known."""

from __future__ import annotations

import json
import re
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_no_file_is_checked_less_than_its_folder() -> None:
    packages = ("model", "experiments", "drivers", "sim_backend", "rig", "tests")
    files = [path for package in packages for path in (ROOT / package).rglob("*.py")]
    heads = {path: path.read_text("utf-8").partition("import")[0] for path in files}
    assert [path for path, head in heads.items() if "# pyright: " in head] == []


def test_the_list_of_tests_that_are_not_typed_yet_only_shrinks() -> None:
    text = (ROOT / ".ci" / "pyright-tests.json").read_text(encoding="utf-8")
    without_comments = re.sub(r"^\s*//.*$", "", text, flags=re.MULTILINE)
    files = [name.removeprefix("../") for name in json.loads(without_comments)["exclude"]]
    assert [file for file in files if not (ROOT / file).is_file()] == []
    assert len(set(files)) == len(files)
    # Lower this number with every file that comes off the list.
    assert len(files) <= 26
