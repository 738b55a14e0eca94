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
from model.gear import HarmonicDrive, Origin
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.run.start import RunRequest, run_request
from rig.runfile.read import close_recording, open_run
from tests.adversarial.acts import Honest, in_memory

SHORT: dict[str, dict[str, Any]] = {
    "friction": {"points": 6, "highest_rpm": 1200.0, "lowest_rpm": 5.0, "bracket_every": 3},
    "motor-tare": {"points": 6, "lowest_rpm": 5.0, "highest_rpm": 1200.0},
    "kinematic-error": {"speed_rpm": 118.3},
    "velocity-steps": {"speeds_rpm": (120.0, 300.0, 1200.0, 1800.0), "repeats": 1},
    "starting-torque": {"positions": 4},
}
LIMITS = {
    "ratings.running_torque": 0.06,
    "ratings.transmission_accuracy": 1e-4,
    "ratings.starting_torque": 0.03,
}
"""Verified limits that the simulated gear breaks: an act that hides it would make a PASS of a FAIL."""
SETTINGS = {"friction": {"genetic": False}}


def verified(gear: HarmonicDrive) -> HarmonicDrive:
    """The gear with limits that somebody can be held to."""
    return gear.with_values(LIMITS, Origin("catalogue", "data sheet of the test"))


@pytest.fixture(scope="session")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Recording]:
    """One short run of each protocol, all of one gear on one bench."""
    folder = tmp_path_factory.mktemp("honest")

    def run(protocol: str) -> Recording:
        request = RunRequest(
            protocol=protocol,
            gear=shipped_gear(),
            motor=shipped_motor(),
            output=Path(folder),
            values=SHORT[protocol],
            gear_serial="A1",
            operator="test",
            seed=5,
        )
        recording = open_run(run_request(request).path)
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
        gear = verified(shipped_gear())
        evidence = Evidence(gear, settings=dict(SETTINGS.get(kind, {})))
        if catalogue.load(kind).takes_tare:
            evidence = dataclasses.replace(evidence, tare=tare, tare_recording=runs["motor-tare"])
        return Honest(kind, recording, evidence)

    return of
