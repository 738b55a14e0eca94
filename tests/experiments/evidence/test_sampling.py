"""Sampling: the count lattice of the output encoder, and the time axis of a recording."""

from __future__ import annotations

from dataclasses import replace

import pytest

from experiments import catalogue
from experiments.contract import Evidence
from experiments.evidence.holds import Recorded
from experiments.evidence.sampling import count_lattice, time_axis
from experiments.protocols.kinematic_error import declaration as kinematic_error_declaration
from experiments.protocols.kinematic_error import plan as kinematic_error_plan
from experiments.recording import Origin, Recording
from model.gear import HarmonicDrive
from tests.experiments.synthetic import Bench, record


def at(speed_rpm: float, bench: Bench, gear: HarmonicDrive) -> Recording:
    parameters = kinematic_error_declaration.Parameters(speed_rpm=speed_rpm)
    return record(kinematic_error_plan.plan(parameters, gear), bench, "kinematic-error")


@pytest.mark.parametrize(("speed_rpm", "severity"), [(100.0, "notes"), (92.7, "passed")])
def test_sampling_on_the_lattice_of_the_output_counts_is_said(
    speed_rpm: float, severity: str, bench: Bench, gear: HarmonicDrive
) -> None:
    kind = catalogue.load("kinematic-error")
    recorded = Recorded(at(speed_rpm, bench, gear), kind, Evidence(gear))
    found = count_lattice(recorded)
    assert found.severity == severity
    assert ("folded" in found.follows or "lattice" in found.follows) == (severity == "notes")


@pytest.mark.parametrize(
    ("origin", "severity"), [("hardware", "blocks"), ("imported", "not looked at")]
)
def test_the_stamps_of_an_import_are_not_held_against_a_rate_that_was_made_of_them(
    origin: Origin, severity: str, bench: Bench, gear: HarmonicDrive
) -> None:
    recording = at(92.7, bench, gear)
    metadata = replace(recording.metadata, sample_rate=900.0, origin=origin)
    other = replace(recording, metadata=metadata)
    recorded = Recorded(other, catalogue.load("kinematic-error"), Evidence(gear))
    assert time_axis(recorded).severity == severity
