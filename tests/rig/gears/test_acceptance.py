"""Acceptance files: what is written is read back, what is wrong is named, and nothing judges that nobody confirmed."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.units import ARCMIN
from rig.errors import ConfigurationError
from rig.gears.acceptance import (
    Acceptance,
    Limit,
    Part,
    acceptance_for,
    acceptance_text,
    load_acceptance,
    shipped_acceptance,
    shipped_names,
)
from rig.gears.card import save_card, with_changes
from tests.rig.handmade import save_acceptance

PART = Part("CSF-25-120", 120.0)
TEXT = """
format = "acceptance-1"
name = "Specification 4711"
source = "Specification 4711, revision C"
use = "any"

[[limits]]
quantity = "kinematic-error.transmission_accuracy"
upper = 1.0
unit = "arcmin"
condition = "one output revolution, no load"
source = "4711, page 3"
standing = "customer"
confirmed_by = "A. Example"
confirmed_on = 2026-11-20

[[limits]]
quantity = "friction.running_torque_2000_rpm"
lower = 20
upper = 120
unit = "mN m"
source = "catalogue 2015, page 12"
standing = "catalogue"
trust = "B"
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "acceptance.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_file_is_read_in_si_and_written_back_in_its_own_units(tmp_path: Path) -> None:
    acceptance = load_acceptance(written(tmp_path, TEXT))
    accuracy, torque = acceptance.limits
    assert (accuracy.kind, accuracy.name) == ("kinematic-error", "transmission_accuracy")
    assert accuracy.upper == pytest.approx(ARCMIN)
    assert accuracy.lower is None
    assert accuracy.confirmed_on == "2026-11-20"
    assert (torque.lower, torque.upper) == (0.02, 0.12)
    text = acceptance_text(acceptance)
    assert "upper = 1.0\nlower" not in text
    assert 'unit = "arcmin"' in text
    assert "upper = 120.0" in text
    save_acceptance(acceptance, acceptance.path)
    assert load_acceptance(acceptance.path) == acceptance


@settings(max_examples=60)
@given(
    upper=st.floats(1e-6, 1e6),
    unit=st.sampled_from(("rad", "arcmin", "arcsec", "deg")),
    words=st.text(max_size=30),
)
def test_every_limit_is_read_back_to_the_last_digits(
    tmp_path_factory: pytest.TempPathFactory, upper: float, unit: str, words: str
) -> None:
    limit = Limit(
        quantity="kinematic-error.amplitude_2",
        unit=unit,
        upper=upper,
        condition=words.strip(),
        source="page 1",
        standing="statistics",
    )
    acceptance = Acceptance(name="A", source="B", use="any", limits=(limit,), path="")
    path = tmp_path_factory.mktemp("limits") / "a.toml"
    save_acceptance(acceptance, path)
    (read,) = load_acceptance(path).limits
    assert read.upper == pytest.approx(upper, rel=1e-14)
    assert read.condition == words.strip()


@pytest.mark.parametrize(
    ("old", "new", "place", "says"),
    [
        ('"acceptance-1"', '"gear-card-1"', "format", "acceptance-1"),
        ('use = "any"', 'use = "some"', "use", "simulated"),
        ('use = "any"\n', "", "use", "is missing"),
        ("upper = 1.0", "uper = 1.0", "limits[0].uper", "upper"),
        ("upper = 1.0\n", "", "limits[0].upper", "lower or both"),
        ("upper = 1.0", 'upper = "1"', "limits[0].upper", "finite number"),
        ("upper = 1.0", "upper = nan", "limits[0].upper", "finite number"),
        ('"arcmin"', '"mN m"', "limits[0].unit", "arcmin"),
        ("transmission_accuracy", "transmission", "limits[0].quantity", "transmission_accuracy"),
        ("kinematic-error.", "kinematics.", "limits[0].quantity", "kinematic-error"),
        ('"customer"', '"neighbour"', "limits[0].standing", "statistics"),
        ('"customer"', '"demonstration"', "limits[0].standing", "simulated"),
        ('"customer"', '"catalogue"', "limits[0].trust", "derived"),
        ('trust = "B"', "", "limits[1].trust", "derived"),
        ("2026-11-20", '"20 Nov 2026"', "limits[0].confirmed_on", "YYYY-MM-DD"),
        ("confirmed_on = 2026-11-20\n", "", "limits[0].confirmed_on", "confirmed_by"),
        ("lower = 20", "lower = 200", "limits[1].upper", "value 120 mN m, allowed >= 200 mN m"),
        (
            "friction.running_torque_2000_rpm",
            "kinematic-error.transmission_accuracy",
            "limits[1].quantity",
            "once",
        ),
        ('source = "4711, page 3"\n', "", "limits[0].source", "is missing"),
    ],
)
def test_what_is_wrong_is_named_with_file_and_place(
    tmp_path: Path, old: str, new: str, place: str, says: str
) -> None:
    assert old in TEXT
    text = TEXT.replace(old, new, 1).replace(
        'unit = "mN m"', 'unit = "arcmin"' if "[1].quantity" in place else 'unit = "mN m"'
    )
    path = written(tmp_path, text)
    with pytest.raises(ConfigurationError) as refused:
        load_acceptance(path)
    assert refused.value.where == f"{path}: {place}"
    assert says in str(refused.value)


def test_a_limit_judges_only_when_somebody_confirmed_it() -> None:
    proposal = Limit(
        quantity="starting-torque.starting_torque",
        unit="mN m",
        upper=0.1,
        source="catalogue 2015, page 12",
        standing="catalogue",
        trust="A",
    )
    customers = dataclasses.replace(proposal, standing="customer", trust="")
    for bare in (proposal, dataclasses.replace(proposal, trust="derived"), customers):
        told = dataclasses.replace(bare, confirmed_by="A. Example", confirmed_on="2026-11-20")
        file = Acceptance(name="N", source="S", use="any", limits=(bare, told), path="")
        assert "not confirmed" in file.doubt(bare, PART, is_simulated=True)
        assert not file.doubt(told, PART, is_simulated=False)


def test_a_demonstration_never_judges_hardware() -> None:
    acceptance = shipped_acceptance("demonstration")
    assert acceptance.use == "simulated"
    assert acceptance.limits
    for limit in acceptance.limits:
        assert limit.standing == "demonstration"
        assert not limit.is_verified
        assert not acceptance.doubt(limit, PART, is_simulated=True)
        assert "simulated rigs only" in acceptance.doubt(limit, PART, is_simulated=False)


def test_every_shipped_file_is_read_and_an_unknown_one_names_them() -> None:
    assert [shipped_acceptance(name).path for name in shipped_names()] == list(shipped_names())
    with pytest.raises(ConfigurationError, match="demonstration"):
        shipped_acceptance("nobody")


def test_the_card_says_what_a_gear_must_show(tmp_path: Path) -> None:
    path = written(tmp_path, TEXT)
    for serial, named in (("SN-1", ""), ("SN-2", "demonstration"), ("SN-3", str(path))):
        save_card(tmp_path, with_changes(None, {"serial": serial, "acceptance": named}, "A", "now"))
    assert acceptance_for(tmp_path, "SN-0") is None
    assert acceptance_for(tmp_path, "SN-1") is None
    assert acceptance_for(tmp_path, "SN-2") == shipped_acceptance("demonstration")
    assert acceptance_for(tmp_path, "SN-3") == load_acceptance(path)
    path.unlink()
    with pytest.raises(ConfigurationError, match="cannot be read"):
        acceptance_for(tmp_path, "SN-3")


def test_a_limit_is_on_the_gear_unless_it_says_another_subject(tmp_path: Path) -> None:
    both = TEXT.replace("lower = 20\n", 'lower = 20\nsubject = "motor + gear"\n')
    acceptance = load_acceptance(written(tmp_path, both))
    assert [limit.subject for limit in acceptance.limits] == ["gear", "motor + gear"]
    assert acceptance_text(acceptance).count("subject") == 1
    save_acceptance(acceptance, tmp_path / "again.toml")
    assert load_acceptance(tmp_path / "again.toml").limits == acceptance.limits
    with pytest.raises(ConfigurationError, match=r"limits\[1\]\.subject.*gear, motor \+ gear"):
        load_acceptance(written(tmp_path, both.replace("motor + gear", "motor")))


FOR_PARTS = TEXT.replace(
    'use = "any"', 'use = "any"\nparts = ["CSF-25-120", "SHG-25-120"]\nratios = [120]'
)


@pytest.mark.parametrize(
    ("part", "foreign"),
    [
        (Part("CSF-25-120", 120.0), ""),
        (Part("csf-25-120", 121.0), ""),
        (Part("CSF-25-120-2UH", 120.0), ""),
        (Part("CSF-25-1200", 120.0), "not for CSF-25-1200"),
        (Part("CSF-25", 120.0), "not for CSF-25"),
        (Part("SHG-32-100", 100.0), "not for SHG-32-100"),
        (Part("SHG-25-120", 100.0), "not for 100"),
        (Part("SHG-25-120"), "not for a ratio that nobody named"),
        (Part(), "not for a part that nobody named"),
    ],
)
def test_limits_of_one_part_judge_no_other(part: Part, foreign: str, tmp_path: Path) -> None:
    acceptance = load_acceptance(written(tmp_path, FOR_PARTS))
    said = acceptance.foreign(part)
    assert foreign in said
    assert bool(foreign) == bool(said)
    assert foreign in acceptance.doubt(acceptance.limits[0], part, is_simulated=False)
    assert not acceptance.remark


def test_a_file_for_some_parts_is_written_and_read_alike(tmp_path: Path) -> None:
    acceptance = load_acceptance(written(tmp_path, FOR_PARTS))
    assert acceptance.parts == ("CSF-25-120", "SHG-25-120")
    assert acceptance.whom == "CSF-25-120 or SHG-25-120 (ratio 120)"
    again = load_acceptance(written(tmp_path, acceptance_text(acceptance)))
    assert (again.parts, again.ratios) == (acceptance.parts, acceptance.ratios)


def test_a_file_that_names_no_part_judges_any_and_says_so(tmp_path: Path) -> None:
    acceptance = load_acceptance(written(tmp_path, TEXT))
    assert not acceptance.foreign(Part())
    assert "names no part" in acceptance.remark


@pytest.mark.parametrize(
    "line",
    [
        "parts = []",
        'parts = "CSF"',
        "parts = [3]",
        'parts = [""]',
        'ratios = ["120"]',
        "ratios = [true]",
    ],
)
def test_what_is_no_list_of_parts_is_named(line: str, tmp_path: Path) -> None:
    text = TEXT.replace('use = "any"', f'use = "any"\n{line}')
    with pytest.raises(ConfigurationError, match="no list of the gears"):
        load_acceptance(written(tmp_path, text))
