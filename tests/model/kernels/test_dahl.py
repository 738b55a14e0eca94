"""The hysteresis element of the plant loses what its law says, however few steps its loop has."""

from __future__ import annotations

import math

import numpy as np
import pytest

from model.kernels import loop_layout as at
from model.kernels.loop_step import _dahl
from model.kernels.loop_tables import slid

LIMIT, STIFFNESS, SWING = 11.6, 13_300.0, 5e-4


def lost(steps: int, *, by_slope: bool) -> float:
    """What the fifth loop of these steps damps: the part of its torque [N m] that goes with the speed."""
    physics = np.zeros(at.PHYSICS_SIZE)
    physics[at.HYSTERESIS_LIMIT], physics[at.HYSTERESIS_STIFFNESS] = LIMIT, STIFFNESS
    physics[at.HYSTERESIS_BY_SLOPE] = by_slope
    phase = 2.0 * math.pi * np.arange(5 * steps + 1) / steps
    torsion = SWING * np.sin(phase)
    torque = np.zeros(len(torsion))
    for k, moved in enumerate(np.diff(torsion)):
        torque[k + 1] = _dahl(physics, float(torque[k]), float(moved))
    last = slice(4 * steps, 5 * steps)
    return 2.0 * float(np.mean(torque[last] * np.cos(phase[last])))


def test_a_loop_of_few_steps_loses_what_the_law_says() -> None:
    exact = lost(20_000, by_slope=False)
    assert lost(48, by_slope=False) == pytest.approx(exact, rel=5e-3)
    # As the worlds of versions 1 and 2 have it.
    assert lost(48, by_slope=True) > 1.03 * exact


@pytest.mark.parametrize("moved", [0.0, 0.01, 0.1, 0.4])
def test_what_is_left_falls_as_an_exponential_does(moved: float) -> None:
    assert slid(moved) == pytest.approx(math.exp(-moved), abs=1e-3)
    assert 0.0 < slid(1e6) < 1e-6
