"""How friction changes with temperature, from a gear's runs at different temperatures."""

from __future__ import annotations

import math

import numpy as np
import pytest

from experiments.protocols.friction.coefficients import per_kelvin
from experiments.protocols.friction.influences import RUN_TO_RUN
from experiments.protocols.friction.quantities import QUANTITIES
from experiments.protocols.friction.temperature import ASSUMED
from experiments.result import Result
from model.identify.estimate import BudgetLine, Estimate

DRY, VISCOUS, MAGNETS = -0.008, -0.031, -1e-3


def run(number: int, temperature: float, error: float, away: float = 0.0) -> Result:
    """The friction of a gear as a port with warm magnets shows it; `away` in standard errors (relative `error`)."""
    warmer = temperature - 20.0
    shown = (1.0 + away * error) / (1.0 + MAGNETS * warmer)

    def estimate(name: str, value: float) -> Estimate:
        half = 1.96 * error * value
        return Estimate(
            name=name,
            value=shown * value,
            unit="N",
            low=shown * value - half,
            high=shown * value + half,
            identifiable="yes",
            budget=(
                BudgetLine("scatter between revolutions and points", "A", error * value),
                BudgetLine("torque scale", "B", 0.05 * value),
                BudgetLine(RUN_TO_RUN, "B", 0.0),
            ),
        )

    forces = (
        estimate("coulomb", 40.0 * (1.0 + DRY * warmer)),
        estimate("viscous", 0.2 * math.exp(VISCOUS * warmer)),
    )
    return Result(
        run=f"run {number}",
        kind="friction",
        quantities=QUANTITIES,
        estimates={e.name: e for e in forces},
        metrics={"housing_temperature": temperature},
        options={"torque_is_of": "gear"},
    )


def test_runs_at_different_temperatures_tell_both_coefficients() -> None:
    learnt = per_kelvin([run(k, t, 1e-3) for k, t in enumerate((16.0, 21.0, 27.0, 31.0))])
    for name, truth in (("dry", DRY), ("viscous", VISCOUS)):
        value, expanded = learnt[f"{name}_per_kelvin"]
        assert abs(value - truth) < 0.3 * expanded
        # What the magnets make of it is known within 0.03 % per kelvin: that is what is left.
        assert expanded == pytest.approx(6e-4, rel=0.1)
    assert "run 0, run 1, run 2, run 3" in learnt["per_kelvin_source"]
    assert "16.0 to 31.0 °C" in learnt["per_kelvin_source"]


def test_runs_at_one_temperature_tell_none() -> None:
    assert per_kelvin([]) == {}
    assert per_kelvin([run(1, 15.0, 1e-3)]) == {}
    assert per_kelvin([run(1, 20.1, 1e-3), run(2, 20.9, 1e-3)]) == {}


def test_what_two_poor_runs_say_hardly_moves_what_is_assumed() -> None:
    learnt = per_kelvin([run(1, 19.0, 0.05), run(2, 21.0, 0.05)])
    for part, assumed in ASSUMED.items():
        value, expanded = learnt[f"{part}_per_kelvin"]
        assert value == pytest.approx(assumed.value, abs=0.2 * assumed.standard_uncertainty)
        assert 1.8 * assumed.standard_uncertainty < expanded < 2.0 * assumed.standard_uncertainty


def test_the_interval_holds_the_truth_and_grows_with_the_scatter() -> None:
    """Twice as wide a scatter as the runs say of themselves is believed, not they."""
    random = np.random.default_rng(11)
    held = {1.0: 0, 2.0: 0}
    for _ in range(100):
        for more in held:
            runs = [
                run(k, t, 4e-3, more * random.standard_normal())
                for k, t in enumerate((16.0, 19.0, 23.0, 26.0, 29.0, 32.0))
            ]
            value, expanded = per_kelvin(runs)["viscous_per_kelvin"]
            held[more] += abs(value - VISCOUS) <= expanded
    assert held[1.0] >= 92
    assert held[2.0] >= 85
