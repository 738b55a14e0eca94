"""A gear of one's own: set and card from a part number, cards that hold only what loads, values with their units."""

from __future__ import annotations

import io
import json
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from model.errors import ParameterError
from model.gear_file import SECTIONS, load_gear, shipped_gear
from model.motor import load_motor
from model.units import RPM
from rig.commands.gear_sets import asked
from rig.errors import ConfigurationError
from rig.gears.card import GearCard, card_for, card_text, save_card, with_changes
from rig.gears.card_history import confirmation_of
from rig.gears.card_places import card_path
from rig.gears.facts import make_facts
from rig.gears.making import made_gear, set_path, write_card, write_new_gear
from rig.gears.stating import declared, read_stated
from rig.main import run as main
from rig.trial.campaign.standing import facts_of

KNOWN = declared(SECTIONS)


def rig(*arguments: str) -> int:
    with pytest.raises(SystemExit) as end:
        main([*arguments])
    return int(end.value.code or 0)


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "stdin", io.StringIO())


def made(product: str, serial: str, *more: str) -> int:
    return rig("gear", "new", product, "--serial", serial, "--by", "A. Example", *more)


def test_a_script_is_never_asked_and_gets_set_and_card(
    capsys: pytest.CaptureFixture[str],
) -> None:
    torque = "ratings.rated_torque=176 N m"
    assert made("SHG-32-100-2UH", "SN/1", "--set", torque, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["part"] == "SHG-32-100-2UH"
    assert "inertia.output" in told["assumed"]
    assert told["contradictions"] == []
    card = card_for("runs", "SN/1")
    assert card is not None
    assert not card.is_confirmed
    gear = load_gear(card.facts.part)
    assert Path(card.facts.part) == set_path("runs", "SN/1").resolve()
    assert gear.ratings.rated_torque == 176.0
    assert "A. Example" in gear.origins["ratings.rated_torque"].source
    assert rig("gear", "check", "SN/1") == 0
    assert rig("gear", "list") == 0
    assert "unreadable" not in capsys.readouterr().out


@pytest.mark.parametrize(
    "product", ["CSF-14-50-2UH", "CSG-20-160-2UH", "HFUS-25-30-2UH", "SHG-40-80-2UH-LW"]
)
def test_a_made_gear_is_planned_and_turns_on_the_simulated_rig(
    product: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert made(product, "SN-1", "--mounting", "circular-spline-fixed") == 0
    assert rig("gear", "confirm", "SN-1", "--by", "A. Example") == 0
    assert rig("plan", "friction", "--gear", "SN-1") == 0
    capsys.readouterr()
    assert rig("run", "home", "--gear", "SN-1", "--operator", "A. Example", "--seed", "7") == 0
    (file,) = Path("runs").glob("*.h5")
    assert rig("show", str(file), "--json") == 0
    assert product in capsys.readouterr().out


def test_a_folder_that_is_moved_takes_the_gears_made_in_it_along(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert made("SHG-32-100-2UH", "SN-1", "--mounting", "circular-spline-fixed") == 0
    assert rig("gear", "confirm", "SN-1", "--by", "A. Example") == 0
    mounted = facts_of(Path("runs"), "SN-1", "")
    Path("runs").rename("moved")
    moved = ("--runs", "moved")
    assert rig("gear", "check", "SN-1", *moved) == 0
    capsys.readouterr()
    assert rig("gear", "set", "SN-1", "--by", "A. Example", "--hours", "3", *moved, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["facts"]["part"] == "SHG-32-100-2UH"
    assert told["confirmed"]
    assert facts_of(Path("moved"), "SN-1", "") == mounted
    for command in (("list",), ("show", "SN-1")):
        assert rig("gear", *command, *moved) == 0
        assert "SHG-32-100-2UH" in capsys.readouterr().out


def test_an_older_card_is_read_where_it_says_and_kept_by_its_place_when_it_is_written(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert made("SHG-32-100-2UH", "SN-1", "--mounting", "circular-spline-fixed") == 0
    path, whole = card_path("runs", "SN-1"), str(set_path("runs", "SN-1").resolve())
    facts = {"serial": "SN-1", "part": whole, "mounting": "circular-spline-fixed"}
    older = GearCard(make_facts(facts), (confirmation_of("A", "then", facts),))
    path.write_text(card_text(older), encoding="utf-8")
    Path("runs").rename("moved")
    assert rig("gear", "check", "SN-1", "--runs", "moved") == 2
    assert "rig gear set SN-1 --by NAME --part FILE" in capsys.readouterr().err
    Path("moved").rename("runs")
    assert rig("gear", "check", "SN-1") == 0
    assert rig("gear", "set", "SN-1", "--by", "A. Example", "--hours", "3") == 0
    Path("runs").rename("moved")
    assert rig("gear", "check", "SN-1", "--runs", "moved") == 0
    now = card_for("moved", "SN-1")
    assert now is not None
    assert now.is_confirmed


def test_a_gear_is_not_made_over_another() -> None:
    assert made("SHG-32-100-2UH", "SN-1") == 0
    before = set_path("runs", "SN-1").read_text(encoding="utf-8")
    assert made("CSF-25-120-2UH", "SN-1") == 2
    assert set_path("runs", "SN-1").read_text(encoding="utf-8") == before
    gear = made_gear("CSF-25-120-2UH", {}, "A", "now")
    set_path("runs", "SN-2").write_text("mine", encoding="utf-8")
    with pytest.raises(ConfigurationError, match="somebody typed"):
        write_new_gear("runs", gear, {"serial": "SN-2"}, "A", "now")
    assert card_for("runs", "SN-2") is None


@pytest.mark.parametrize("fact", ["part", "acceptance"])
def test_a_card_with_what_cannot_be_loaded_is_refused_when_it_is_written(
    fact: str, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = Path("wrong.toml")
    wrong.write_text('format = "harmonic-drive-1"\nname = ""', encoding="utf-8")
    for value in (str(wrong), "gone.toml", "csf-1-1"):
        assert rig("gear", "set", "SN-1", "--by", "A. Example", f"--{fact}", value) == 2
        assert f"gear.{fact}: cannot be loaded" in capsys.readouterr().err
        assert card_for("runs", "SN-1") is None
    card = with_changes(None, {"serial": "SN-1", fact: str(wrong)}, "A", "now")
    with pytest.raises(ConfigurationError, match=rf"gear\.{fact}"):
        write_card("runs", card)
    save_card("runs", card)
    assert rig("gear", "confirm", "SN-1", "--by", "A. Example") == 2


def test_a_check_names_each_contradiction_and_ends_with_2(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert made("CSG-25-100-2UH", "SN-1") == 0
    file = set_path("runs", "SN-1")
    text = file.read_text(encoding="utf-8")
    assert 'value = 4.13e-05, unit = "kg m2"' in text
    file.write_text(text.replace("value = 4.13e-05", "value = 4.13e-03"), encoding="utf-8")
    capsys.readouterr()
    assert rig("gear", "check", "SN-1", "--json") == 2
    found = json.loads(capsys.readouterr().out)["contradictions"]
    assert {one["where"] for one in found} == {"inertia.wave_generator"}
    assert all(one["value"] and one["expected"] and one["remedy"] for one in found)
    assert rig("gear", "check", str(file)) == 2
    assert rig("gear", "check", "nobody") == 2


def test_at_a_terminal_each_value_of_the_plate_is_asked_and_enter_keeps_it() -> None:
    gear = shipped_gear()
    values = [gear.value(p) for p in ("ratings.rated_torque", "ratings.maximum_input_speed")]
    asked_for: list[str] = []
    answers: Iterator[str] = iter(["", "5000", "5000 r/min"])

    def answer(question: str) -> str:
        asked_for.append(question)
        return next(answers)

    assert asked(values, KNOWN, answer) == {"ratings.maximum_input_speed": 5000.0 * RPM}
    assert len(asked_for) == 3
    assert "67.0 N m" in asked_for[0]

    def end(_: str) -> str:
        raise EOFError

    assert asked(values, KNOWN, end) == {}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("ratings.rated_torque", "states nothing"),
        ("ratings.rated_torque=137", "its unit"),
        ("ratings.rated_torque=much N m", "its unit"),
        ("ratings.rated_torque=137 mm", "another dimension"),
        ("ratings.rated_torqe=137 N m", "rated_torque"),
    ],
)
def test_a_value_without_path_number_or_unit_is_refused(text: str, says: str) -> None:
    with pytest.raises(ParameterError, match=says):
        read_stated([text], KNOWN)
    assert read_stated(["teeth.flexspline=200"], KNOWN) == {"teeth.flexspline": 200.0}


def test_a_motor_is_made_from_its_plate_and_looked_over(
    capsys: pytest.CaptureFixture[str],
) -> None:
    new = ("config", "new", "m.toml", "--motor", "M-1", "--by", "A. Example")
    assert rig(*new) == 2
    assert not Path("m.toml").exists()
    assert rig(*new, "--set", "rated_torque=1.27 N m", "--json") == 0
    assert "rotor_inertia" in json.loads(capsys.readouterr().out)["assumed"]
    assert load_motor("m.toml").rated_torque == 1.27
    assert rig(*new, "--set", "rated_torque=1.27 N m") == 2
    assert rig("config", "check", "m.toml") == 0
    assert rig("config", "check", "sgmjv-02") == 0
    text = Path("m.toml").read_text(encoding="utf-8")
    Path("m.toml").write_text(
        text.replace("torque_constant = { value = 0.", "torque_constant = { value = 1."),
        encoding="utf-8",
    )
    capsys.readouterr()
    assert rig("config", "check", "m.toml", "--json") == 2
    assert json.loads(capsys.readouterr().out)["contradictions"]


def test_a_serial_with_runs_of_another_part_is_named_and_asked_about(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from typer.testing import CliRunner

    import rig
    from rig.main import app

    rig.execute("home", serial="A1", folder=tmp_path, seed=9941)
    words = [
        "gear",
        "new",
        "SHG-32-100-2UH",
        "--serial",
        "A1",
        "--by",
        "B",
        "--runs",
        str(tmp_path),
    ]
    refused = CliRunner().invoke(app, words)
    assert refused.exit_code != 0
    assert "CSF-25-120-2UH" in str(refused.exception)
    assert not list(tmp_path.glob(".gears/*"))
    same = CliRunner().invoke(app, [*words[:2], "CSF-25-120-2UH", *words[3:]])
    assert same.exit_code == 0, same.output
    other = ["A2" if word == "A1" else word for word in words]
    assert CliRunner().invoke(app, other).exit_code == 0
    for made in tmp_path.glob(".gears/**/A1*"):
        made.unlink()
    assert CliRunner().invoke(app, [*words, "--despite-runs"]).exit_code == 0
