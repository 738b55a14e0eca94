"""The pages that are made from the program name every word of its files, and every measurand."""

from __future__ import annotations

import dataclasses
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

from experiments import catalogue
from model.gear_file import SECTIONS
from model.motor import ServoMotor
from rig.gears.acceptance import Limit

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Every generated page, by its name."""
    folder = tmp_path_factory.mktemp("pages")
    _module().write(folder)
    return {file.stem: file.read_text(encoding="utf-8") for file in folder.glob("*.md")}


def _module() -> ModuleType:
    spec = importlib.util.spec_from_file_location("reference_pages", DOCS / "reference_pages.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_every_word_of_gear_motor_and_acceptance_file_is_told(pages: dict[str, str]) -> None:
    for section, kind in SECTIONS.items():
        part = pages["gear-file"].partition(f"\n## {section}\n")[2].partition("\n## ")[0]
        for f in dataclasses.fields(kind):  # type: ignore[arg-type]
            assert f"| `{f.name}` |" in part, f"{section}.{f.name}"
    for f in dataclasses.fields(ServoMotor):
        if "unit" in f.metadata:
            assert f"| `{f.name}` |" in pages["motor-file"], f.name
    for f in dataclasses.fields(Limit):
        assert f"| `{f.name}` |" in pages["acceptance-file"], f.name


def test_every_measurand_is_told_with_its_definition(pages: dict[str, str]) -> None:
    text = pages["measurands"]
    for name in catalogue.names():
        for q in catalogue.load(name).quantities:
            if q.is_key:
                assert f"`{name}.{q.name}`" in text, q.name
                assert q.definition.partition("|")[0].partition("<")[0] in text, q.name
    assert "kinematic-error.transmission_accuracy" in pages["acceptance-file"]


def test_every_generated_page_is_in_the_table_of_contents(pages: dict[str, str]) -> None:
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    for name in pages:
        assert f"reference/generated/{name}\n" in index
