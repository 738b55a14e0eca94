"""A campaign looked after by another program: what it is told, and how each run on hardware is armed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import VirtualClock
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench.backends.order import Order
from rig.commands.campaign_callbacks import program_callbacks, typed_by
from rig.run.remote import RemoteOperator
from rig.run.stop import StopRequest
from rig.trial.campaign.journal import DoneStage
from rig.trial.campaign.plan import CampaignPlan, Stage
from rig.trial.campaign.walk import Walk, walk

DONE = DoneStage(index=0, protocol="home", run="00001-home-SN.h5", outcome="COMPLETED")


@pytest.fixture
def walked(tmp_path: Path) -> Walk:
    request = Order(
        protocol="home",
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=tmp_path,
        serial="SN-7",
    )
    stages = (Stage("home"), Stage("motor-tare"))
    return walk(CampaignPlan(name="two", title="Two", stages=stages, path="two"), request)


def remote() -> tuple[RemoteOperator, StopRequest, list[dict[str, Any]]]:
    lines: list[dict[str, Any]] = []
    stop = StopRequest()
    return (
        RemoteOperator(stop, lambda line: lines.append(json.loads(line)), VirtualClock()),
        stop,
        lines,
    )


def test_the_stages_are_told_as_they_come_and_go(walked: Walk) -> None:
    operator, stop, lines = remote()
    report: Any = type("Report", (), {"as_json": lambda self: {"run": "00001-home-SN"}})()
    with program_callbacks(walked, operator, stop, listens=False) as crew:
        crew.begun(0, walked.stages[0])
        crew.ended(DONE, report)
        crew.standing(DONE)
    assert [line["kind"] for line in lines] == ["campaign", "stage", "stage", "stage"]
    assert [stage["protocol"] for stage in lines[0]["stages"]] == ["home", "motor-tare"]
    assert lines[0]["stages"][0]["nominal"] == walked.stages[0].planned.nominal
    assert [line["state"] for line in lines[1:]] == ["begun", "ended", "counts"]
    assert lines[2]["report"] == {"run": "00001-home-SN"}


@pytest.mark.parametrize(
    ("index", "expected", "gear"),
    [(0, "SN-7", "with gear SN-7 mounted"), (1, "NO GEAR", "with the gear off")],
)
def test_every_run_on_hardware_is_typed_by_what_is_typed(
    walked: Walk, index: int, expected: str, gear: str
) -> None:
    operator, stop, lines = remote()
    one = walked.stages[index]
    operator.take("answer  something ")
    order = replace(one.order, backend="hardware")
    typed = typed_by(operator, stop, order, one.planned)
    # What was typed is taken as it is: whether it arms is decided where the run is armed.
    assert typed == "something"
    (prompt,) = lines
    assert f"Type {expected} to arm" in prompt["text"]
    assert gear in prompt["text"]
    assert prompt["consent"] == ""


def test_a_stop_arms_nothing_and_a_simulated_rig_asks_nothing(walked: Walk) -> None:
    operator, stop, lines = remote()
    one = walked.stages[0]
    assert typed_by(operator, stop, one.order, one.planned) == ""
    assert lines == []
    stop.stop()
    order = replace(one.order, backend="hardware")
    assert typed_by(operator, stop, order, one.planned) == ""
