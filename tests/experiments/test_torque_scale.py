"""The protocol torque-scale: what it asks for, and what it refuses."""

from __future__ import annotations

import math
from dataclasses import asdict

import pytest

from experiments.errors import PlanError
from experiments.protocols.torque_scale.declaration import Parameters
from experiments.protocols.torque_scale.disc import disc_of, ring
from experiments.protocols.torque_scale.plan import plan
from experiments.steps.vocabulary import Prompt, Ramp
from model.gear import HarmonicDrive

BY_MASS = {"mass": 0.5, "diameter_mm": 60.0, "bore_mm": 14.0}


def test_ramps_go_up_and_down_both_ways_and_the_disc_is_consented_to(gear: HarmonicDrive) -> None:
    steps = list(plan(Parameters(repeats=2, **BY_MASS), gear))
    (prompt,) = [step for step in steps if isinstance(step, Prompt)]
    assert "disc of 0.0002372 kg m2" in prompt.consent
    ramps = [step for step in steps if isinstance(step, Ramp)]
    assert {step.acceleration for step in ramps} == set(Parameters().accelerations)
    for sign in (1, -1):
        highest = [step for step in ramps if step.speed == sign * max(s.speed for s in ramps)]
        assert len(highest) == 2 * len(Parameters().accelerations)


def test_disc_and_hub_are_rings_on_one_bore() -> None:
    assert ring(0.5, 0.06, 0.014) == pytest.approx(0.5 * (0.06**2 + 0.014**2) / 8.0)
    both = disc_of({**BY_MASS, "hub_mass": 0.1, "hub_diameter_mm": 30.0})
    assert both.inertia == pytest.approx(ring(0.5, 0.06, 0.014) + ring(0.1, 0.03, 0.014))
    assert both.stated_uncertainty == 0.0
    stated = disc_of({"inertia": 2e-4, "inertia_uncertainty": 4e-7, "certificate": "4711"})
    assert stated.stated_uncertainty == 2e-7
    assert "4711" in stated.words
    assert disc_of(asdict(Parameters())).inertia == Parameters().disc_inertia == 0.0
    assert math.isclose(Parameters(**BY_MASS).disc_inertia, ring(0.5, 0.06, 0.014))


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"accelerations": (200.0, 400.0)}, "accelerations"),
        ({"accelerations": (200.0, 200.0, 400.0)}, "accelerations"),
        ({"highest_rpm": 600.0}, "highest_rpm"),
        ({"highest_rpm": 9000.0}, "highest_rpm"),
        ({"inertia": 2e-4, "mass": 0.5}, "stated twice"),
    ],
)
def test_what_tells_no_scale_is_refused_before_it_runs(
    gear: HarmonicDrive, values: dict[str, object], named: str
) -> None:
    with pytest.raises(PlanError, match=named):
        plan(Parameters(**values), gear)  # type: ignore[arg-type]
