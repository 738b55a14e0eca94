"""Honest short runs of the simulated rig, made once and kept in memory: the acts break copies of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from experiments import catalogue
from experiments.contract import Evidence
from experiments.recording import Recording
from experiments.result import Result
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.analysis.judging import GearVerdict, StoredResult, judge_run
from rig.bench.backends.order import Order
from rig.gears.acceptance import Acceptance, Limit
from rig.run.start import run_order
from rig.runfile.read import close_recording, open_run
from tests.adversarial.acts import Honest, in_memory, tare_reading

SHORT: dict[str, dict[str, Any]] = {
    "friction": {"points": 6, "highest_rpm": 1200.0, "lowest_rpm": 5.0, "bracket_every": 3},
    "motor-tare": {"points": 6, "lowest_rpm": 5.0, "highest_rpm": 1200.0},
    "kinematic-error": {"speed_rpm": 118.3},
    "velocity-steps": {"speeds_rpm": (120.0, 300.0, 1200.0, 1800.0), "repeats": 1},
    "starting-torque": {"positions": 4},
}
LIMITS = (
    ("friction.running_torque_{speed}_rpm", 0.06, "N m"),
    ("kinematic-error.transmission_accuracy", 1e-4, "rad"),
    ("starting-torque.starting_torque", 0.03, "N m"),
)
"""Limits that the simulated gear breaks: an act that hides it would make a PASS of a FAIL."""
ACCEPTANCE = Acceptance(
    name="test",
    source="data sheet of the test",
    use="any",
    limits=tuple(
        Limit(
            quantity=quantity,
            unit=unit,
            source="data sheet of the test",
            standing="customer",
            upper=upper,
            confirmed_by="A. Example",
            confirmed_on="2026-11-01",
            subject="motor + gear" if quantity.startswith("starting-torque") else "gear",
        )
        for quantity, upper, unit in LIMITS
    ),
    path="test.toml",
)


def judged(result: Result, recording: Recording) -> GearVerdict:
    """What the result of a recording is worth by those limits."""
    m = recording.metadata
    return judge_run(StoredResult(result, m.origin, m.outcome), ACCEPTANCE)


@pytest.fixture(scope="session")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Recording]:
    """One short run of each protocol, all of one gear on one bench."""
    folder = tmp_path_factory.mktemp("honest")

    def run(protocol: str) -> Recording:
        request = Order(
            protocol=protocol,
            gear=shipped_gear(),
            motor=shipped_motor(),
            folder=Path(folder),
            values=SHORT[protocol],
            serial="A1",
            operator="test",
            seed=5,
        )
        recording = open_run(run_order(request).path)
        try:
            return in_memory(recording)
        finally:
            close_recording(recording)

    return {protocol: run(protocol) for protocol in SHORT}


@pytest.fixture(scope="session")
def tare(runs: dict[str, Recording]) -> Result:
    return catalogue.load("motor-tare").analyse(runs["motor-tare"], Evidence(shipped_gear()))


@pytest.fixture(scope="session")
def honest(runs: dict[str, Recording], tare: Result) -> Callable[[str], Honest]:
    """The honest run of a kind with the evidence that it is analysed by."""

    def of(kind: str) -> Honest:
        recording = runs[kind]
        evidence = Evidence(shipped_gear())
        if catalogue.load(kind).takes_tare:
            evidence = dataclasses.replace(
                evidence,
                tare=tare,
                tare_recording=runs["motor-tare"],
                other_tares=(tare_reading(tare, 1.003), tare_reading(tare, 0.998)),
            )
        elif kind == "motor-tare":
            others = (tare_reading(tare, 1.003), tare_reading(tare, 0.998))
            evidence = dataclasses.replace(evidence, other_tares=others)
        return Honest(kind, recording, evidence)

    return of
