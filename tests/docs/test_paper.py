"""The page that holds the paper against the code is true: every equation, figure, experiment and number of it."""

from __future__ import annotations

import ast
import importlib
import inspect
import os
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from experiments import catalogue
from experiments.protocols.velocity_steps.declaration import Parameters as StepParameters
from model.gear_file import harmonic_path, shipped_gear
from model.kinematic_error import normalised_mse
from model.motor import shipped_motor
from sim_backend.imperfections import Sizes

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "explanation" / "paper.md"
TEXT = PAGE.read_text(encoding="utf-8")
GEAR = shipped_gear()

SHARED = Path(os.environ.get("HARMONIC_RIG_SHARED", ROOT.parent / "shared"))
COPY = SHARED / "paper" / "extract.txt"
needs_copy = pytest.mark.skipif(not COPY.is_file(), reason="the copy of the paper is not there")

EQUATIONS = range(1, 23)
FIGURES = range(1, 20)
LEGIBLE = frozenset({1, 2, 4, 6, 10, 17, 18, 19, 20, 22})
"""Equations whose number stands in the copy."""

NUMBERS = {
    "120": "tion ratio is 120",
    "CSF-25": "its type is Unit Type CSF-25",
    "SGMJV-02": "type is SGMJV-02 of YASKAWA",
    "8192": "resolution of 8192 lines",
    "18,000": "resolution of 18,000 lines",
    "eight": "velocity step experiments at eight different",
    "60": "from 60 to 3000 r/min",
    "3000": "from 60 to 3000 r/min",
    "0.71": "data is 0.71",
    "100": "MSE will be 100",
    "5.0": "an MSE of less than 5.0 indicates a good fit",
    "1.0": "MSE of less than 1.0 indicates an excellent fit",
    "two": "error waveform with a frequency of two cycles",
    "90": "wave generator rotates (angle 1 ¼ 90 in",
}
"""What may be quoted as the paper's: each number with words of the copy in which it stands."""

PUBLISHED = frozenset({"teeth.flexspline", "teeth.circular_spline", "damping.structural"})
"""Values of the shipped gear that the copy gives: the tooth numbers of ratio 120 with a difference of two, and a damper
that equation 2 has not.
"""

_REFERENCES = (
    r"`[^`]*`",
    r"\]\([^)]*\)",
    r"\[10\.\d+/\d+",
    r"“[^”]*”",
    r"\*\*[^*]*\*\*",
    r"[Ee]quations? \d+(?:(?:, | and | to )\d+)*",
    r"[Ff]igures? \d+",
    r"Tables? \d+",
    r"\(\d+\)",
)


def section(title: str) -> str:
    """The text below a heading of the page, up to the next one."""
    found = re.search(rf"^## {re.escape(title)}\n(.*?)(?=^## |\Z)", TEXT, re.DOTALL | re.MULTILINE)
    assert found, f"{PAGE.name} has no section '{title}'"
    return found.group(1)


def rows(title: str) -> list[dict[str, str]]:
    """The table of a section, one mapping of heading to cell per row."""
    lines = [line for line in section(title).splitlines() if line.startswith("|")]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    heading, body = cells[0], cells[2:]
    assert body, f"the table '{title}' is empty"
    return [dict(zip(heading, row, strict=True)) for row in body]


def names(cell: str) -> list[str]:
    """What stands in backticks in a cell; none only where it says `none` or `nowhere`."""
    found = re.findall(r"`([^`]+)`", cell)
    assert found or cell.startswith(("none", "nowhere")), cell
    return found


def resolve(path: str) -> tuple[ModuleType, Any]:
    """The module and the object of a dotted path. A renamed one fails."""
    parts = path.split(".")
    module = importlib.import_module(parts[0])
    for index in range(1, len(parts)):
        name = ".".join(parts[: index + 1])
        try:
            module = importlib.import_module(name)
        except ModuleNotFoundError as missing:
            if missing.name != name:
                raise
            found: Any = module
            for attribute in parts[index:]:
                assert hasattr(found, attribute), f"{path}: there is no {attribute}"
                found = getattr(found, attribute)
            return module, found
    return module, module


def equations_in(text: str) -> set[int]:
    """Numbers of equations that a docstring names: "(6)" at the start of a line, "equations 1, 3-5 and 9"."""
    found: set[int] = {int(n) for n in re.findall(r"^\s*\((\d+)\)", text, re.MULTILINE)}
    for run in re.findall(r"[Ee]quations?\s+(\d+(?:(?:-|,\s*|\s+and\s+)\d+)*)", text):
        for first, last in re.findall(r"(\d+)(?:-(\d+))?", run):
            found.update(range(int(first), int(last or first) + 1))
    return found


def figures_in(text: str) -> set[int]:
    """Numbers of figures that a docstring names: "figure 12", "Figures 9 and 17", "figures 12, 13 and 16"."""
    found: set[int] = set()
    for run in re.findall(r"[Ff]igures?\s+(\d+(?:(?:,\s*|\s+and\s+)\d+)*)", text):
        found.update(int(n) for n in re.findall(r"\d+", run))
    return found


def docstrings(path: str) -> str:
    """The docstring of an object and that of its module."""
    module, found = resolve(path)
    return f"{inspect.getdoc(found) or ''}\n{inspect.getdoc(module) or ''}"


def all_rows() -> Iterator[tuple[str, dict[str, str]]]:
    for title in ("Equations", "Figures", "Experiments", "Numbers"):
        for row in rows(title):
            yield title, row


def test_every_equation_and_every_figure_has_one_row_in_order() -> None:
    assert [int(row["equation"]) for row in rows("Equations")] == list(EQUATIONS)
    assert [int(row["figure"]) for row in rows("Figures")] == list(FIGURES)


@pytest.mark.parametrize("row", rows("Equations"), ids=lambda row: row["equation"])
def test_a_function_names_its_equation(row: dict[str, str]) -> None:
    functions = names(row["function"])
    assert functions
    for path in functions:
        assert int(row["equation"]) in equations_in(docstrings(path)), path


@pytest.mark.parametrize("row", rows("Figures"), ids=lambda row: row["figure"])
def test_what_draws_a_figure_names_it(row: dict[str, str]) -> None:
    drawing = names(row["drawn by"])
    for path in drawing:
        assert int(row["figure"]) in figures_in(docstrings(path)), path
    assert bool(drawing) == bool(names(row["protocol"])) == bool(names(row["test"]))


def test_every_protocol_is_in_the_catalogue() -> None:
    for title, row in all_rows():
        for name in names(row.get("protocol", "none")):
            assert name in catalogue.names(), f"{title}: {name}"


def test_every_test_exists() -> None:
    for title, row in all_rows():
        for name in names(row["test"]):
            path, _, function = name.partition("::")
            file = ROOT / path
            assert file.is_file(), f"{title}: {name}"
            tree = ast.parse(file.read_text(encoding="utf-8"))
            there = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
            assert function.startswith("test_"), f"{title}: {name}"
            assert function in there, f"{title}: {name}"


def test_every_place_of_a_number_exists() -> None:
    for row in rows("Numbers"):
        for place in names(row["where it stands"]):
            if "/" in place:
                assert (ROOT / place).is_file(), place
            else:
                resolve(place)


def test_what_is_legible_is_said_of_the_equations_that_are() -> None:
    said = {int(row["equation"]): row["in our copy"] for row in rows("Equations")}
    assert set(said.values()) == {"legible", "reconstructed", "lost"}
    assert {n for n, word in said.items() if word == "legible"} == LEGIBLE


def test_the_numbers_of_the_page_are_those_of_the_list() -> None:
    quoted = {row["number"]: row["words of the copy"] for row in rows("Numbers")}
    assert quoted == {number: f"“{words}”" for number, words in NUMBERS.items()}
    for number, words in NUMBERS.items():
        assert number in words


def test_every_quotation_is_in_the_list() -> None:
    assert set(re.findall(r"“([^”]*)”", TEXT)) == set(NUMBERS.values())


def test_no_other_number_stands_on_the_page() -> None:
    prose = re.sub(r"^\| \d+ \|", "|", TEXT, flags=re.MULTILINE)
    for reference in _REFERENCES:
        prose = re.sub(reference, "", prose)
    found = re.findall(r"(?<![\w.-])\d[\d.,]*(?<![.,])", prose)
    assert set(found) <= set(NUMBERS)


def test_numbers_of_the_paper_stand_in_the_code() -> None:
    speeds = StepParameters().speeds_rpm
    strongest = max(GEAR.kinematic_error, key=lambda h: np.hypot(h.cosine, h.sine))
    measured = np.array([1.0, -2.0, 4.0])
    assert GEAR.ratio == 120.0
    assert GEAR.name.startswith("CSF-25")
    assert shipped_motor().name == "SGMJV-02"
    assert (Sizes.input_lines, Sizes.output_lines) == (8192, 18_000)
    assert (len(speeds), min(speeds), max(speeds)) == (8, 60.0, 3000.0)
    assert strongest.order == 2.0
    assert normalised_mse(measured, np.full(3, measured.mean())) == pytest.approx(100.0)


def test_the_shipped_set_calls_published_only_what_the_copy_holds() -> None:
    said = {v.path for v in GEAR.values() if v.origin.provenance == "published"}
    assert said == PUBLISHED
    assert GEAR.damping.structural == 0.0
    for harmonic in GEAR.kinematic_error:
        assert GEAR.origins[harmonic_path(harmonic.order)].provenance != "published"
    motor = (ROOT / "model" / "motors" / "sgmjv-02.toml").read_text(encoding="utf-8")
    assert "published" not in motor


@needs_copy
def test_the_copy_says_so() -> None:
    copy = re.sub(r"[ \t]+", " ", COPY.read_text(encoding="utf-8"))
    for words in NUMBERS.values():
        assert words in copy
    assert {int(n) for n in re.findall(r"ð(\d+)Þ", copy)} == LEGIBLE
    mentioned = {int(n) for n in re.findall(r"Figure\s+(\d+)", copy)}
    said = {int(row["figure"]) for row in rows("Figures") if row["in our copy"] != "lost"}
    assert mentioned == said


@needs_copy
def test_captions_are_where_they_are_said_to_be() -> None:
    copy = COPY.read_text(encoding="utf-8")
    captions = {int(n) for n in re.findall(r"Figure (\d+)\. [A-Z]", copy)}
    said = {int(row["figure"]) for row in rows("Figures") if row["in our copy"] == "caption"}
    assert captions == said
