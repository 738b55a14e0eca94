"""What an analysis lets its user choose is declared once, and what it refuses is everything else."""

from __future__ import annotations

import math
from importlib import import_module

import pytest

from experiments import catalogue
from experiments.contract import Deferred, Evidence
from experiments.errors import SettingError
from experiments.evidence.table import SETTINGS as OF_THE_CHECKS
from experiments.recording import Recording
from experiments.setting import EVERY_KIND, Setting, names_of
from experiments.tares.same_rig import AGE_LIMIT
from model.gear import HarmonicDrive
from rig import main


@pytest.mark.parametrize("kind", catalogue.kinds())
def test_each_says_what_it_takes_and_when_it_is_used(kind: str) -> None:
    settings = catalogue.load(kind).settings
    assert len(set(names_of(settings))) == len(settings)
    for one in settings:
        assert one.takes, one.name
        assert len(one.when.split()) >= 3, f"{kind}.{one.name}: when would somebody use it?"


@pytest.mark.parametrize(
    "kind", [kind for kind in catalogue.kinds() if catalogue.load(kind).settings]
)
def test_an_analysis_checks_what_is_declared(kind: str) -> None:
    module = import_module(catalogue.entry(kind).module.replace(".declaration", ".analysis"))
    assert catalogue.load(kind).settings == module.SETTINGS
    declared = import_module(catalogue.entry(kind).module).EXPERIMENT
    assert isinstance(declared.analyse, Deferred)


def test_those_of_the_checks_belong_to_every_kind() -> None:
    assert names_of(EVERY_KIND) == OF_THE_CHECKS
    assert float(EVERY_KIND[0].default) == AGE_LIMIT


@pytest.mark.parametrize("kind", ["motion", "friction", "home"])
def test_the_help_of_a_kind_lists_its_settings(
    kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main.run(["fit", kind, "--help"])
    assert not ended.value.code
    shown = capsys.readouterr().out
    for one in (*catalogue.load(kind).settings, *EVERY_KIND):
        assert one.name in shown
    assert "--tare" not in shown


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("balance", "publishd"),
        ("bracket_limit", "3%"),
        ("bracket_limit", -1),
        ("bracket_refusal", math.nan),
        ("chi_square_limit", ""),
        ("chi_square_limit", -1),
        ("seed", 1.5),
        ("seed", True),
        ("genetic", "yes"),
        ("output_bearing_date", "yesterday"),
        ("tare_age_limit", "long"),
    ],
)
def test_a_value_that_a_setting_cannot_have_is_refused_by_name(
    name: str, value: object, friction_run: Recording, gear: HarmonicDrive
) -> None:
    evidence = Evidence(gear, settings={name: value})
    words = "no such balance" if name == "balance" else "it can't have this value"
    with pytest.raises(SettingError, match=f"friction.{name}: {words}"):
        catalogue.load("friction").analyse(friction_run, evidence)


@pytest.mark.parametrize(
    ("takes", "good"),
    [("whole number", 4.0), ("number", -2), ("a, b", "b"), ("channel, none", "torque_2")],
)
def test_what_it_takes_it_takes(takes: str, good: object) -> None:
    one = Setting("it", takes, "")
    assert one.is_taken(good)
    assert one.is_taken(None), "a setting that is None is not given"
