"""When an inertia from the torque of the ringing is told: by the torque, and by a mode that the steps tell."""

import pytest

from experiments.protocols.velocity_steps.inertia import _estimate
from model.identify.estimate import BudgetLine, Estimate, Identifiable


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
