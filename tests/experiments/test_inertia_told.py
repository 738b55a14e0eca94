"""When an inertia from the torque of the ringing is told: by the torque, and by a mode that the steps tell."""

import math
from dataclasses import replace

import numpy as np
import pytest

from experiments.evidence.inertia import inertia_of_the_input
from experiments.protocols.velocity_steps.inertia import AGAINST_CARDS, _bench_lines, _estimate
from experiments.tares.motor_heat import motor_heat
from model.gear import HarmonicDrive
from model.identify.estimate import BudgetLine, Estimate, Identifiable
from model.identify.step_inertia import InertiaFit
from tests.experiments.test_analyses_without_plan import foreign, stating


def told(value: float, mode: Identifiable) -> Estimate:
    """An inertia [kg m2] with a standard uncertainty of 0.001, which rests on such a mode."""
    ratio = Estimate(
        name="stiffness_over_inertia",
        value=1e5,
        unit="1/s2",
        low=9e4,
        high=1.1e5,
        identifiable=mode,
        note="the rungs differ",
    )
    own = [BudgetLine("scatter", "A", 0.001)]
    return _estimate("output_inertia", "kg m2", value, own, [], ratio)


@pytest.mark.parametrize("mode", ["no", "weakly"])
def test_an_inertia_is_not_told_where_its_mode_is_not(mode: Identifiable) -> None:
    found = told(0.1, mode)
    assert found.identifiable == "weakly"
    assert found.note == "it rests on the mode, and the rungs differ"


def test_an_inertia_is_told_by_its_torque_and_its_mode() -> None:
    assert (told(0.1, "yes").identifiable, told(0.1, "yes").note) == ("yes", "")
    assert told(0.003, "yes").identifiable == "weakly"
    assert told(0.001, "yes").identifiable == "no"


@pytest.mark.parametrize(
    ("gain", "is_said"), [(1.0, False), (0.95, False), (0.75, True), (1.3, True)]
)
def test_a_torque_that_contradicts_the_inertia_of_the_cards_is_a_line(
    gear: HarmonicDrive, gain: float, is_said: bool
) -> None:
    time = np.arange(0.0, 1.0, 1e-2)
    run = stating(foreign(time, torque=(time, "N m")), "torque", scale_relative_uncertainty=0.005)
    run = replace(run, metadata=replace(run.metadata, gear=gear, process={"motor": "SGMJV-02"}))
    inner = inertia_of_the_input(run, gear)
    assert inner is not None
    values = {"input_inertia": gain * inner[0], "output_inertia": gain * 0.5}
    small = dict.fromkeys(values, 1e-8)
    found = InertiaFit(
        values=values, errors=small, freedom=small, smoothing=small, skew=small, residual=0.0
    )
    lines = _bench_lines(run, found, gain * 0.5, motor_heat(run, math.nan))
    told = [line for line in lines if line.source == AGAINST_CARDS]
    assert bool(told) is is_said
    # As far as the number may be off, within U.
    assert all(1.96 * line.standard_uncertainty > abs(gain - 1.0) * 0.5 * gain for line in told)
