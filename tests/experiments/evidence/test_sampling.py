"""Count lattice: a speed at which the samples repeat on the counts of the output encoder is told."""

from __future__ import annotations

import pytest

from experiments import catalogue
from experiments.contract import Evidence
from experiments.evidence.holds import Recorded
from experiments.evidence.sampling import count_lattice
from experiments.protocols.kinematic_error import protocol as kinematic_error
from experiments.recording import Recording
from model.gear import HarmonicDrive
from tests.experiments.synthetic import Bench, record


def at(speed_rpm: float, bench: Bench, gear: HarmonicDrive) -> Recording:
    parameters = kinematic_error.Parameters(speed_rpm=speed_rpm)
    return record(kinematic_error.plan(parameters, gear), bench, "kinematic-error")


@pytest.mark.parametrize(("speed_rpm", "outcome"), [(100.0, "widened"), (92.7, "ok")])
def test_sampling_on_the_lattice_of_the_output_counts_is_said(
    speed_rpm: float, outcome: str, bench: Bench, gear: HarmonicDrive
) -> None:
    kind = catalogue.load("kinematic-error")
    recorded = Recorded(at(speed_rpm, bench, gear), kind, Evidence(gear))
    found = count_lattice(recorded)
    assert found.outcome == outcome
    assert ("folded" in found.words or "lattice" in found.words) == (outcome == "widened")
