"""Gear cards: what is remembered comes back, what changed asks for a confirmation, what is broken says so."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from experiments.errors import PlanError
from experiments.finding import Severity
from experiments.parameters import parameter_fields
from model.gear_file import save_gear, shipped_gear
from model.motor import shipped_motor
from rig.bench.backends.order import Order
from rig.errors import ConfigurationError
from rig.gears.card import (
    CONFIRMED_FIELDS,
    GearCard,
    card_for,
    card_path,
    card_text,
    conditions_of,
    gear_of,
    list_cards,
    load_card,
    save_card,
    with_changes,
    with_confirmation,
)
from rig.gears.card_history import CardEvent
from rig.gears.facts import GearFacts, make_facts
from rig.main import run as main
from rig.run.gear import acceptance_checks_of_card, card_checks, with_card
from rig.run.start import run_order

FACTS = {
    "serial": "SN-0815",
    "part": "csf-25-120",
    "mounting": "circular-spline-fixed",
    "lubricant": "Harmonic Grease SK-1A",
    "hours": "12.5",
    "hours_counted": "log book",
    "load_inertia_kg_m2": "0.08",
    "load_inertia_uncertainty_kg_m2": "0.002",
    "output_radial_runout_um": "8",
}


def confirmed_card(**more: str) -> GearCard:
    return with_confirmation(
        with_changes(None, {**FACTS, **more}, "A. Example", "2026-01-01"), "B. Other", "2026-01-02"
    )


def rig(*arguments: str) -> int:
    with pytest.raises(SystemExit) as end:
        main([*arguments])
    return int(end.value.code or 0)


@settings(max_examples=60)
@given(
    serial=st.text(min_size=1, max_size=20).filter(lambda s: s.strip() != ""),
    notes=st.text(max_size=40),
    hours=st.none() | st.floats(0.0, 1e6),
    runout=st.none() | st.floats(0.0, 1000.0),
)
def test_what_is_written_is_read_back(
    tmp_path_factory: pytest.TempPathFactory,
    serial: str,
    notes: str,
    hours: float | None,
    runout: float | None,
) -> None:
    folder = tmp_path_factory.mktemp("cards")
    values = {
        "serial": serial,
        "mounting_notes": notes,
        "hours": hours,
        "input_axial_runout_um": runout,
    }
    card = with_changes(None, values, "A. Example", "2026-01-01T10:00:00+00:00")
    assert save_card(folder, card).parent == folder / ".gears"
    assert card_for(folder, serial) == card
    assert [one.card for one in list_cards(folder)] == [card]
    assert card.facts.hours == hours


def test_nothing_is_guessed() -> None:
    facts = make_facts({"serial": "SN-1"})
    told = {field.name: getattr(facts, field.name) for field in parameter_fields(GearFacts)}
    assert {name for name, value in told.items() if value not in (None, "")} == {"serial"}
    card = with_changes(None, {"serial": "SN-1"}, "A. Example", "now")
    with pytest.raises(ConfigurationError, match="part, mounting"):
        with_confirmation(card, "A. Example", "now")
    assert gear_of(facts, shipped_gear()) == shipped_gear()
    assert conditions_of(card) == {
        "gear_card_warning": "the card of gear SN-1 has never been confirmed"
    }


@pytest.mark.parametrize("name", [name for name in CONFIRMED_FIELDS if name != "serial"])
def test_a_change_of_the_mounting_takes_the_confirmation_away(name: str) -> None:
    card = confirmed_card()
    assert card.is_confirmed
    assert not card.warning
    numbers = {f.name: f.kind is float for f in parameter_fields(GearFacts)}
    other = {"part": "other.toml", "mounting": "flexspline-fixed", "mounted_on": "2026-02-03"}
    changed = with_changes(
        card, {name: other.get(name, "0.5" if numbers[name] else "other")}, "C. Third", "2026-02-04"
    )
    assert not changed.is_confirmed
    assert name in changed.warning
    assert "C. Third" in changed.warning
    assert card_checks(changed, changed.serial)[0].severity is Severity.BLOCKS
    assert with_confirmation(changed, "C. Third", "2026-02-05").is_confirmed


@pytest.mark.parametrize(
    ("facts", "severity", "words"),
    [
        ({"acceptance": "demonstration"}, "passed", "demonstration, for CSF-25-120"),
        (
            {"acceptance": "demonstration", "part": "shg-32-100"},
            "warns",
            "not for SHG-32-100-2UH: the verdict will be NOT JUDGED",
        ),
        ({"acceptance": "gone.toml"}, "blocks", "gone.toml"),
    ],
)
def test_limits_of_another_part_are_told_before_anything_turns(
    facts: dict[str, str],
    severity: str,
    words: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if facts.get("part") == "shg-32-100":
        assert (
            rig(
                "gear",
                "new",
                "SHG-32-100-2UH",
                "--serial",
                "S",
                "--runs",
                str(tmp_path),
                "--by",
                "A",
            )
            == 0
        )
        made = card_for(tmp_path, "S")
        assert made is not None
        facts = {**facts, "part": made.facts.part}
    card = confirmed_card(**facts)
    (check,) = acceptance_checks_of_card(card)
    assert check.severity == severity
    assert words in check.found
    if severity != "blocks":
        save_card(tmp_path, card)
        capsys.readouterr()
        assert rig("gear", "show", card.serial, "--runs", str(tmp_path)) == 0
        assert (words in " ".join(capsys.readouterr().out.split())) is (severity == "warns")
        assert rig("plan", "home", "--gear", card.serial, "--runs", str(tmp_path)) == 0
        assert (words in capsys.readouterr().err) is (severity == "warns")


def test_hours_grow_without_a_new_confirmation_and_nothing_new_leaves_no_trace() -> None:
    card = confirmed_card()
    older = with_changes(card, {"hours": "20"}, "A. Example", "later")
    assert older.is_confirmed
    assert older.history[-1].values == {"hours": 20.0}
    assert with_changes(card, {"hours": 12.5, "part": "csf-25-120"}, "A. Example", "later") is card


def test_the_history_tells_who_and_forgetting_is_a_change() -> None:
    card = with_changes(confirmed_card(), {"lubricant": ""}, "C. Third", "2026-03-01")
    assert [(e.what, e.by) for e in card.history] == [
        ("changed", "A. Example"),
        ("confirmed", "B. Other"),
        ("changed", "C. Third"),
    ]
    assert card.history[-1].values == {"lubricant": ""}
    assert card.facts.lubricant == ""
    checks = card_checks(with_confirmation(card, "C. Third", "2026-03-02"), "SN-0815")
    assert [check.severity for check in checks] == ["passed", "warns"]
    assert "lubricant" in checks[1].found


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"hours": "-1"}, "gear.hours.*-1.* h.*>= 0"),
        ({"hours": "many"}, "wrong kind.*a number"),
        ({"load_inertia_kg_m2": "0"}, "> 0"),
        ({"load_inertia_kg_m2": "nan"}, "finite"),
        ({"mounting": "glued"}, "circular-spline-fixed, flexspline-fixed"),
        ({"mounted_on": "yesterday"}, "YYYY-MM-DD"),
        ({"load_inertia_kg_m2": ""}, "uncertainty without its value"),
        ({"serial": "  "}, "serial number"),
        ({"colour": "grey"}, "no such parameter"),
    ],
)
def test_impossible_facts_are_refused_by_name(values: dict[str, str], words: str) -> None:
    with pytest.raises(PlanError, match=words):
        make_facts({**FACTS, **values})


def test_nobody_is_no_name_and_a_serial_number_does_not_change() -> None:
    with pytest.raises(ConfigurationError, match="nobody is named"):
        with_changes(None, FACTS, "  ", "now")
    with pytest.raises(ConfigurationError, match="another gear"):
        with_changes(confirmed_card(), {"serial": "SN-2"}, "A. Example", "now")


def test_the_load_inertia_of_the_card_is_the_gear_s(tmp_path: Path) -> None:
    gear = gear_of(confirmed_card().facts, shipped_gear())
    value = gear.value("inertia.output")
    assert (value.value, value.origin.provenance, value.origin.standard_uncertainty) == (
        0.08,
        "measured",
        0.002,
    )
    assert "SN-0815" in value.origin.source
    other = shipped_gear().with_values({"mesh_friction.coulomb": 50.0})
    save_gear(other, tmp_path / "mine.toml")
    mine = gear_of(confirmed_card(part=str(tmp_path / "mine.toml")).facts, shipped_gear())
    assert mine.mesh_friction.coulomb == 50.0


def test_a_request_takes_over_what_the_card_tells_once(tmp_path: Path) -> None:
    plain = Order(
        protocol="home",
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=tmp_path,
        conditions={"lubricant": "another, as typed"},
    )
    card = confirmed_card(mounting="flexspline-fixed")
    carded = with_card(plain, card)
    assert (carded.mounting, carded.gear.inertia.output) == ("flexspline-fixed", 0.08)
    assert carded.conditions["lubricant"] == "another, as typed"
    assert carded.conditions["hours"] == 12.5
    assert with_card(carded, card, parameters_given=True) == carded


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no gear card"),
        ("format = 3", "no gear card"),
        ("format = [", "not valid TOML"),
        ('format = "gear-card-1"', "no serial number"),
        ('format = "gear-card-1"\nfacts = 3', "no table"),
        ('format = "gear-card-1"\n[facts]\nserial = "SN-2"\nhours = -3', "facts|hours"),
        ('format = "gear-card-1"\n[facts]\nserial = "SN-1"\n[[history]]\nat = 3', r"history\[0\]"),
        (
            'format = "gear-card-1"\n[facts]\nserial = "SN-1"\n[[history]]\nat = "a"\nby = "b"\nwhat = "c"',
            "confirmed",
        ),
        ('format = "gear-card-1"\n[facts]\nserial = "sn-1"', "another gear"),
    ],
)
def test_a_damaged_card_says_what_is_wrong(tmp_path: Path, text: str, words: str) -> None:
    path = card_path(tmp_path, "SN-1")
    path.parent.mkdir()
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError, match=words) as refused:
        card_for(tmp_path, "SN-1")
    assert str(path) in str(refused.value)


def test_a_card_that_cannot_be_written_leaves_the_old_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_card(tmp_path, confirmed_card())

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(ConfigurationError, match="No space left"):
        save_card(tmp_path, with_changes(confirmed_card(), {"hours": "99"}, "A. Example", "now"))
    assert card_for(tmp_path, "SN-0815") == confirmed_card()
    assert [path.name for path in (tmp_path / ".gears").iterdir()] == ["SN-0815.toml"]


def test_the_commands_tell_set_confirm_and_list(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    where = f"--output={tmp_path}"
    assert rig("gear", "show", "SN-1", where) == 2
    assert rig("gear", "set", "SN-1", where, "--by", "A. Example", "--hours", "-3") == 2
    assert rig("gear", "set", "SN-1", where, "--by", "A. Example", "--hour", "3") == 2
    assert "hours" in capsys.readouterr().err
    assert rig("gear", "set", "SN-1", where, "--part", "csf-25-120") == 2
    mounted = (
        "--part",
        "csf-25-120",
        "--mounting",
        "flexspline-fixed",
        "--mounting-notes",
        "shim 0.1 mm",
    )
    assert rig("gear", "set", "SN-1", where, "--by", "A. Example", *mounted) == 0
    assert "never been confirmed" in capsys.readouterr().out.replace("\n", " ")
    assert rig("gear", "confirm", "SN-1", where, "--by", "B. Other", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["confirmed"]
    assert told["facts"]["mounting_notes"] == "shim 0.1 mm"
    assert rig("gear", "list", where) == 0
    assert "B. Other" in capsys.readouterr().out
    assert rig("gear", "set", "--help") == 0
    assert "--output-radial-run" in capsys.readouterr().out


def test_a_run_file_keeps_the_card_among_its_conditions(tmp_path: Path) -> None:
    card = confirmed_card()
    request = Order(
        protocol="starting-torque",
        gear=gear_of(card.facts, shipped_gear()),
        motor=shipped_motor(),
        folder=tmp_path,
        values={"zero_time": 0.5, "positions": 2},
        serial=card.serial,
        conditions=conditions_of(card),
    )
    report = run_order(request)
    with h5py.File(report.path) as file:
        text = {}
        for name in ("lubricant", "hours", "conditions", "serial_number"):
            field = file[f"entry/sample/{name}"]
            assert isinstance(field, h5py.Dataset)
            text[name] = str(field.asstr()[()])
    assert text["lubricant"] == "Harmonic Grease SK-1A"
    assert text["hours"] == "12.5"
    assert text["serial_number"] == "SN-0815"
    kept = json.loads(text["conditions"])
    assert kept["output_radial_runout_um"] == 8.0
    assert kept["gear_card_confirmed"] == "B. Other, 2026-01-02"


def test_folders_of_folders_share_the_card_above_and_the_nearest_counts(tmp_path: Path) -> None:
    deep = tmp_path / "2026" / "11"
    deep.mkdir(parents=True)
    assert card_for(deep, "SN-0815") is None
    save_card(tmp_path, confirmed_card())
    assert card_for(deep, "SN-0815") == confirmed_card()
    changed = with_changes(card_for(deep, "SN-0815"), {"hours": "99"}, "A. Example", "2026-02-01")
    assert save_card(deep, changed) == card_path(tmp_path, "SN-0815"), "one gear has one history"
    other = confirmed_card(hours="7")
    (deep / ".gears").mkdir()
    (deep / ".gears" / "SN-0815.toml").write_text(card_text(other), encoding="utf-8")
    assert card_for(deep, "SN-0815") == other
    assert [one.path.parent.parent for one in list_cards(deep)] == [deep]
    assert card_for(deep.parent, "SN-0815") == changed
    assert card_for(deep, "SN-0816") is None


def edited(folder: Path, before: str, after: str) -> GearCard:
    """The card as somebody changes it in an editor, once."""
    path = save_card(folder, confirmed_card())
    text = path.read_text(encoding="utf-8")
    assert before in text
    path.write_text(text.replace(before, after, 1), encoding="utf-8")
    return load_card(path)


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ('= "circular-spline-fixed"', '= "flexspline-fixed"', "mounting flexspline-fixed, confirmed was circular"),
        ("load_inertia_kg_m2 = 0.08", "load_inertia_kg_m2 = 0.09", "load inertia 0.09, confirmed was 0.08"),
        ("output_radial_runout_um = 8.0  # um\n", "", "output radial run-out unknown, confirmed was 8"),
        ("[facts]", "[facts]\noutput_axial_runout_um = 0", "axial run-out 0.0, confirmed was unknown"),
    ],
)  # fmt: skip
def test_a_card_that_was_edited_by_hand_is_not_confirmed(
    tmp_path: Path, before: str, after: str, words: str
) -> None:
    card = edited(tmp_path, before, after)
    assert not card.is_confirmed
    assert words in card.warning
    assert "edited by hand" in card.warning
    assert [check.severity for check in card_checks(card, card.serial)] == ["blocks"]
    assert "gear_card_confirmed" not in conditions_of(card)
    assert card.as_json()["confirmed"] is False
    assert with_confirmation(card, "C. Third", "2026-03-01").is_confirmed


def test_what_is_not_confirmed_may_be_edited(tmp_path: Path) -> None:
    assert edited(tmp_path, "hours = 12.5", "hours = 20.0").is_confirmed


def test_a_confirmation_whose_values_were_edited_confirms_nothing(tmp_path: Path) -> None:
    path = save_card(tmp_path, confirmed_card())
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("circular-spline-fixed", "flexspline-fixed"), encoding="utf-8")
    card = load_card(path)
    assert not card.is_confirmed
    assert "what was confirmed" in card.warning


def test_a_confirmation_of_version_0_2_0_is_of_what_the_changes_before_it_made(
    tmp_path: Path,
) -> None:
    card = confirmed_card()
    bare = CardEvent("2026-01-02", "B. Other", "confirmed")
    before = GearCard(card.facts, (card.history[0], bare))
    assert before.is_confirmed
    path = save_card(tmp_path, before)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("circular-spline-fixed", "flexspline-fixed", 1), encoding="utf-8")
    assert not load_card(path).is_confirmed
