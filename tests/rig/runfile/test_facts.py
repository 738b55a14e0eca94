"""The facts of a run: what they are called, in which unit they are read, and that nothing of them is lost."""

from __future__ import annotations

from pathlib import Path

import pytest

from model.units import RPM
from rig.analysis.difference import difference
from rig.content.grid import Fact
from rig.content.wording import quantity_text
from rig.runfile.facts import GROUPS, flat, limit_facts, parameter_facts, run_facts
from rig.runfile.prevailing import acquisition_facts, certificates_of, conditions_of
from rig.runfile.read import close_recording, open_run
from tests.rig.library.stored import write


@pytest.mark.parametrize(
    ("name", "title", "unit"),
    [
        ("speed_rpm", "speed", "r/min"),
        ("load_inertia_kg_m2", "load inertia", "kg m²"),
        ("output_radial_runout_um", "output radial run-out", "µm"),
        ("hours", "hours", "h"),
        ("index_marks.input_angle.marks", "index marks, input angle, marks", ""),
        ("F_c", "F_c", ""),
        ("room no. 2", "room no. 2", ""),
    ],
)
def test_a_fact_has_its_title_and_the_unit_of_its_name(name: str, title: str, unit: str) -> None:
    (fact,) = flat("conditions", {name: 1.5})
    assert (fact.title, fact.unit, fact.value, fact.name) == (title, unit, "1.5", name)


def test_a_parameter_has_the_unit_of_its_protocol() -> None:
    (fact,) = parameter_facts("friction", {"acceleration": 20.0})
    assert fact.text == "20 rad/s²"
    (duration,) = parameter_facts("velocity-steps", {"duration": 1.5})
    assert duration.text == "1.5 s"
    (unknown,) = parameter_facts("of another rig", {"speed_rpm": (60.0, 1.25)})
    assert unknown.text == "60, 1.25 r/min"


@pytest.mark.parametrize(
    ("unit", "value", "text"),
    [
        ("rad/s", 100.0 * RPM, "100 r/min"),
        ("N m", 2.7e-3, "2.7 mN m"),
        ("s", 2.1e-5, "21 µs"),
        ("s", 12.5, "12.5 s"),
        ("degC", 21.5, "21.5 °C"),
        ("1", 0.25, "0.25"),
    ],
)
def test_a_number_is_read_in_the_unit_of_a_laboratory(unit: str, value: float, text: str) -> None:
    assert quantity_text(value, unit) == text


def test_what_holds_others_is_one_fact_a_leaf_and_an_estimate_keeps_its_uncertainty() -> None:
    nested = {"skew": {"encoder_skew": {"value": 2e-6, "expanded_uncertainty": 1e-6, "unit": "s"}}}
    (fact,) = flat("acquisition", nested | {"end": {}})
    assert (fact.name, fact.text) == ("skew.encoder_skew", "2.0 ± 1.0 × 10⁻⁶ s")
    (mean,) = flat("acquisition", {"thermal_state": {"motor": 31.25}})
    assert mean.text == "31.25 °C"
    said = {fact.title: fact.text for fact in flat("versions", {"on": True, "a": None})}
    assert said == {"on": "yes", "a": "not stated"}


def test_a_limit_says_where_it_is_from() -> None:
    limit = {"value": 1.5, "unit": "N m", "tier": "gear", "origin": "csf", "provenance": "stated"}
    (fact,) = limit_facts({"torque": limit})
    assert fact == Fact("torque", "1.5 N m (gear, csf, stated)", "", "limits", "torque")
    assert [one.text for one in limit_facts({"torque": 2})] == ["2"]


def test_every_group_of_a_run_is_told_once_and_its_truth_is_not(tmp_path: Path) -> None:
    process = {"backend": "sim", "program_version": "0.1.0", "truth": {"coulomb": 70.0}}
    recording = open_run(write(tmp_path, 1, process=process))
    try:
        facts = run_facts(recording)
        prevailed = {fact.title: fact.text for fact in conditions_of(recording, None)}
        certificates = {fact.title: fact.text for fact in certificates_of(recording)}
    finally:
        close_recording(recording)
    names = [(fact.group, fact.name) for fact in facts]
    assert len(set(names)) == len(names)
    assert {group for group, _ in names} == set(GROUPS)
    assert not any("coulomb" in name and group != "gear" for group, name in names)
    assert ("versions", "program_version") in names
    assert ("acquisition", "backend") in names
    assert prevailed["lubricant"] == "SK-1A"
    assert prevailed["incomplete cycles"].startswith("0 of ")
    assert certificates["torque"] == "PTB-17, of 2025-02-03, due 2027-02-03"


def test_an_acquisition_is_told_in_sentences_of_what_is_known() -> None:
    figures = {
        "achieved_rate": 999.5,
        "missed_share": 1e-3,
        "index_marks": {"output_angle": {"marks": 3}},
        "skew": {"encoder_skew": {"value": 2e-6, "identifiability": "weakly"}},
    }
    assert [fact.text for fact in acquisition_facts(figures)] == [
        "999.5 Hz achieved, 0.1 % missed",
        "output_angle: 3 marks",
        "+2.0 µs, identifiable: weakly",
    ]
    assert list(acquisition_facts(None)) == []


def test_both_protocols_give_units_to_their_own_parameters(tmp_path: Path) -> None:
    slow = write(tmp_path, 1, "kinematic-error", parameters={"speed_rpm": 30.3})
    swept = write(tmp_path, 2, "friction", parameters={"lowest_rpm": 1.0})
    told = {change.name: change for change in difference(slow, swept).of("parameters")}
    assert told["speed_rpm"].in_words(told["speed_rpm"].first) == "30.3 r/min"
    assert told["lowest_rpm"].in_words(told["lowest_rpm"].second) == "1 r/min"
    assert told["lowest_rpm"].in_words(told["lowest_rpm"].first) == "–"
