"""What is promised stays: the names that other packages import, with the words by which they are called.

`stable.json` is the list as it was promised. Who adds a name adds it there; one that goes, or that loses a word, needs
a line in the changelog and a version in which the old one warns.
"""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import json
import re
from pathlib import Path

import pytest

HERE = Path(__file__).parent
PROMISED: dict[str, dict[str, list[str]]] = json.loads(
    (HERE / "stable.json").read_text(encoding="utf-8")
)


def words_of(value: object) -> list[str]:
    """By what a function is called, what a class is made of, or what a protocol class asks for."""
    if isinstance(value, type) and dataclasses.is_dataclass(value):
        return [field.name for field in dataclasses.fields(value)]
    if isinstance(value, type) and getattr(value, "_is_protocol", False):
        return sorted(name for name in vars(value) if not name.startswith("_"))
    if inspect.isfunction(value):
        return list(inspect.signature(value).parameters)
    return []


@pytest.mark.parametrize("module", PROMISED)
def test_what_was_promised_is_there(module: str) -> None:
    names = importlib.import_module(module)
    for name, words in PROMISED[module].items():
        assert name in names.__all__, f"{module}.{name} is gone"
        lost = set(words) - set(words_of(getattr(names, name)))
        assert not lost, f"{module}.{name} has lost {', '.join(sorted(lost))}"


@pytest.mark.parametrize("module", PROMISED)
def test_what_is_offered_is_promised_and_listed(module: str) -> None:
    names = sorted(importlib.import_module(module).__all__)
    assert names == sorted(PROMISED[module]), "add the new name to stable.json"
    page = (HERE.parent / "docs" / "reference" / "stable.md").read_text(encoding="utf-8")
    ((listed,),) = [re.findall(rf"^`{re.escape(module)}`: .*\n\n: (.*)$", page, re.MULTILINE)]
    assert sorted(re.findall(r"`(\w+)`", listed)) == names


def test_each_name_is_what_it_is_inside() -> None:
    import harmonic_rig
    import rig

    assert harmonic_rig.fit is rig.fit
    assert set(dir(harmonic_rig)) >= set(rig.__all__)
    with pytest.raises(AttributeError, match=r"harmonic_rig.*nothing_like_it"):
        _ = harmonic_rig.nothing_like_it  # type: ignore[attr-defined]
