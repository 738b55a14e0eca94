"""Campaign plans: those that ship can be walked, and a wrong file is refused by name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from experiments import catalogue
from experiments.parameters import make_parameters
from experiments.recording import RunMetadata
from experiments.steps.vocabulary import Prompt
from model.gear_file import shipped_gear
from rig.analysis.causes import which_mounting
from rig.analysis.learnt_encoder import stated_angle
from rig.bench.backends.order import Order, WorldChoice
from rig.bench.backends.simulated import world_of
from rig.errors import ConfigurationError
from rig.trial.campaign.plan import load_plan, shipped_names, shipped_plan

GOOD = """
format = "campaign-1"
name = "mine"

[[protocol]]
name = "friction"
values = { points = 12 }
"""


def test_the_shipped_plans_name_protocols_and_begin_with_the_motor_alone() -> None:
    assert shipped_names() == ("acceptance", "incoming", "reversal")
    for name in shipped_names():
        plan = shipped_plan(name)
        assert plan.name == name
        assert (plan.stages[0].protocol == "motor-tare") == (name != "reversal")
        assert {stage.protocol for stage in plan.stages} <= set(catalogue.names())
    acceptance = [stage.protocol for stage in shipped_plan("acceptance").stages]
    assert acceptance.index("kinematic-error") < acceptance.index("velocity-steps")


def test_a_reversal_mounts_the_gear_anew_at_three_angles_and_asks_for_it() -> None:
    protocol, seen = catalogue.load("kinematic-error"), set[tuple[int, float | None]]()
    for stage in shipped_plan("reversal").stages:
        parameters = make_parameters(protocol.parameters, stage.values, protocol.name)
        (prompt,) = [s for s in protocol.plan(parameters, shipped_gear()) if isinstance(s, Prompt)]
        assert f"at {stage.values['mounted_at_deg']:g} degrees" in prompt.consent
        order = Order(protocol=stage.protocol, gear=shipped_gear(), values=stage.values)
        world = world_of(order)
        seen.add((world.mount, world.mount_turn))
        # Made again by its own record, it is not turned once more.
        again = replace(order, world=WorldChoice(mount=world.mount, mount_turn=world.mount_turn))
        assert world_of(again).mount == world.mount
        run = RunMetadata(
            run_id="", origin="hardware", experiment="", parameters=dict(stage.values)
        )
        assert stated_angle(run) == pytest.approx(world.mount_turn)
        assert which_mounting(run) == f"at {stage.values['mounted_at_deg']:g} degrees"
    assert len({mount for mount, _ in seen}) == len({turn for _, turn in seen}) == 3


def test_a_plan_of_ones_own(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(GOOD)
    plan = load_plan(path)
    assert (plan.name, plan.title) == ("mine", "mine")
    assert plan.stages[0].values == {"points": 12}
    other = tmp_path / "other.toml"
    other.write_text(GOOD.replace("12", "13"))
    assert load_plan(other).sha256 != plan.sha256
    other.write_text(GOOD.replace("mine", "yours"))
    assert load_plan(other).sha256 == plan.sha256


@pytest.mark.parametrize(
    ("found", "instead", "words"),
    [
        ("campaign-1", "campaign-9", ("format", "campaign-9", "campaign-1")),
        ('"friction"', '"fiction"', ("protocol 1: name", "fiction", "friction")),
        ("points = 12", "pionts = 12", ("pionts", "points")),
        ("points = 12", "points = 1000000", ("points", "1000000")),
        ("[[protocol]]", "[[protocols]]", ("protocols",)),
        ('name = "mine"', "name = 3", ("name", "3")),
        ("values", "colour", ("colour", "values")),
        ("{ points = 12 }", "12", ("values", "12")),
    ],
)
def test_a_wrong_plan_is_refused_by_name(
    tmp_path: Path, found: str, instead: str, words: tuple[str, ...]
) -> None:
    path = tmp_path / "wrong.toml"
    assert found in GOOD
    path.write_text(GOOD.replace(found, instead))
    with pytest.raises(ConfigurationError) as refused:
        load_plan(path)
    for word in (str(path), *words):
        assert word in str(refused.value)


def test_an_empty_plan_and_an_unknown_name(tmp_path: Path) -> None:
    path = tmp_path / "empty.toml"
    path.write_text('format = "campaign-1"\nname = "empty"\n')
    with pytest.raises(ConfigurationError, match="at least one protocol"):
        load_plan(path)
    with pytest.raises(ConfigurationError, match="acceptance, incoming"):
        shipped_plan("nothing")
    with pytest.raises(ConfigurationError, match="cannot be read"):
        load_plan(tmp_path / "nowhere.toml")
