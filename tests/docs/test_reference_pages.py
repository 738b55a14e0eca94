"""The pages that are made from the program name every word of its files, and every measurand."""

from __future__ import annotations

import dataclasses
import json
import re
import tomllib
from pathlib import Path

import pytest

from experiments import catalogue
from experiments.assumed import TABLE
from experiments.parameters import parameter_fields
from model.gear_file import SECTIONS
from model.motor import ServoMotor
from rig.bench.backends.order import WORDS, WORLD_WORDS, key_of
from rig.fleet.results import COLUMNS
from rig.gears.acceptance import Limit
from rig.trial.campaign import plan
from tests.docs.building import building

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Every generated page, by its name."""
    folder = tmp_path_factory.mktemp("pages")
    building("reference_pages").write(folder)
    return {file.stem: file.read_text(encoding="utf-8") for file in folder.glob("*.md")}


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


def test_every_line_of_every_budget_is_told(pages: dict[str, str]) -> None:
    budgets = json.loads((DOCS / "budgets.json").read_text(encoding="utf-8"))
    sections = pages["measurands"].split("\n### ")
    told = 0
    for name in catalogue.names():
        for q in catalogue.load(name).quantities:
            part = next((s for s in sections if f"`{name}.{q.name}` |" in s), "")
            for source, kind, _ in budgets[name].get(q.name, ()):
                assert f"| {source} | {kind} |" in part, f"{name}.{q.name}: {source}"
                told += 1
    assert told > 50


def test_every_field_of_an_order_and_every_word_of_a_world_is_told(pages: dict[str, str]) -> None:
    text = pages["order"]
    for name, words in WORDS.items():
        assert f"| `{name}` |" in text, name
        assert not words.option or f"| `{words.option}` |" in text, name
    for name in WORLD_WORDS:
        assert f"| `{key_of(name)}` |" in text, name


def test_every_key_of_a_campaign_is_told(pages: dict[str, str]) -> None:
    text = pages["campaign-file"]
    for key in (*plan.TOP, *plan.STAGE):
        assert f"| `{key.name}` |" in text, key.name
    for name in catalogue.names():
        part = text.partition(f"\n### {name}\n")[2].partition("\n### ")[0]
        for field in parameter_fields(catalogue.load(name).parameters):
            assert f"| `{field.name}` |" in part, f"{name}.{field.name}"


def test_a_plan_of_every_key_that_is_told_is_read(tmp_path: Path) -> None:
    path = tmp_path / "plan.toml"
    path.write_text(
        'format = "campaign-1"\nname = "night"\ntitle = "Friction"\n'
        '[[protocol]]\nname = "friction"\nvalues = { points = 12 }\n',
        encoding="utf-8",
    )
    content = tomllib.loads(path.read_text(encoding="utf-8"))
    assert set(content) == {key.name for key in plan.TOP}
    assert set(content["protocol"][0]) == {key.name for key in plan.STAGE}
    assert plan.load_plan(path).stages[0].values == {"points": 12}


def test_every_row_of_what_is_assumed_is_told(pages: dict[str, str]) -> None:
    text = pages["assumed"]
    for row in TABLE:
        part = text.partition(f"\n## {row.kind}\n")[2].partition("\n## ")[0]
        for words in (row.what, row.bounds, row.source, row.reason):
            assert words.replace("|", "\\|") in part, f"{row.kind}: {words}"
        assert f"{row.standard_uncertainty:.3g} {row.unit}" in part
        assert "what replaces it" in part


def test_every_column_of_a_fleet_s_results_is_told(pages: dict[str, str]) -> None:
    text = pages["fleet-results"]
    for column in COLUMNS:
        assert f"| `{column.name}` |" in text
        assert column.meaning in text


def test_no_page_shows_what_only_python_reads(pages: dict[str, str]) -> None:
    inside = re.compile(r"<function|annotation=| at 0x|CertificateFile")
    assert {name for name, text in pages.items() if inside.search(text)} == set()


def test_every_generated_page_is_in_the_table_of_contents(pages: dict[str, str]) -> None:
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    for name in pages:
        assert f"reference/generated/{name}\n" in index
