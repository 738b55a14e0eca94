"""`rig model`: every derived quantity, in SI under the paper's names, for people and for programs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from model.errors import ParameterError
from model.gear_file import save_gear, shipped_gear
from rig.commands import modelling
from rig.content.wording import number

NAMES = ("Z_R", "K_ms", "K_m", "K_cyl", "K_bot", "K_t", "K_b", "K_HDf", "K_HDw", "alpha_n")


def call(*words: str) -> str:
    app = typer.Typer()
    app.command()(modelling.model)
    called = CliRunner().invoke(app, list(words), catch_exceptions=False)
    assert called.exit_code == 0
    return called.stdout


def test_json_holds_the_paper_s_quantities_in_si() -> None:
    found = json.loads(call("--json"))
    quantities = found["quantities"]
    assert set(NAMES) <= set(quantities)
    assert quantities["K_cyl"]["value"] == pytest.approx(3.25e5, rel=0.01)
    assert quantities["alpha_n"] == {
        "value": pytest.approx(0.0144328, rel=1e-4),
        "unit": "rad",
        "description": "wedge angle",
        "equation": "1",
    }
    assert sum(found["compliance_shares"].values()) == pytest.approx(1.0)
    assert found["modes"]
    assert found["resonance_speeds"]
    assert found["friction_torque"]
    assert found["catalogue"]["K1"]["catalogue"] == 31000.0


def test_people_get_every_quantity_and_where_the_compliance_comes_from() -> None:
    shown = call()
    found = json.loads(call("--json"))
    for name in NAMES:
        assert name in shown
        assert number(found["quantities"][name]["value"], 5) in shown
    for words in (
        "at the output: bottom",
        "beside the catalogue",
        "Modes",
        "meet the first mode",
        "Friction torque",
    ):
        assert words.lower() in " ".join(shown.split()).lower()


def test_a_parameter_file_is_used(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    save_gear(shipped_gear().with_values({"inertia.output": 0.2}), path)
    ours, theirs = (json.loads(call("--json", *more)) for more in (("--parameters", str(path)), ()))
    ratio = theirs["quantities"]["K_HDf/J_o"]["value"] / ours["quantities"]["K_HDf/J_o"]["value"]
    assert ratio == pytest.approx(2.0)


def test_an_impossible_file_is_a_parameter_error(tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_text("format = 1")
    with pytest.raises(ParameterError):
        call("--parameters", str(path))
