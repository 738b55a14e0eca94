"""What the steps leave while they ring says whether their mode is told."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from experiments.protocols.velocity_steps.quantities import ESTIMATES
from model.identify.step_estimates import RINGS_ON, STATED, WANTED, _ringing_left, _Told
from model.identify.step_fit import Problem, Solution


def left_by(ringing: float, last: float = 2.0) -> tuple[Problem, Solution]:
    """Two steps whose residual is noise, `ringing` times as large in the first quarter of a second."""
    random = np.random.default_rng(4)
    stamps = np.arange(-0.1, last, 1e-3)
    normals = [
        SimpleNamespace(
            residual=random.normal(size=len(stamps)) * np.where(stamps < 0.25, ringing, 1.0)
        )
        for _ in range(2)
    ]
    steps = (SimpleNamespace(stamps=stamps),) * 2
    solution: Any = SimpleNamespace(normals=normals, weights=np.array([1.0, 0.5]))
    return cast(Problem, SimpleNamespace(steps=steps)), cast(Solution, solution)


@pytest.mark.parametrize("ringing", [1.0, 1.5, 3.0])
def test_what_is_left_while_the_steps_ring_is_held_against_what_is_left_later(
    ringing: float,
) -> None:
    assert _ringing_left(*left_by(ringing)) == pytest.approx(ringing, rel=0.1)
    # Nothing later to compare with is no reproach.
    assert _ringing_left(*left_by(ringing, last=0.3)) == 1.0


def test_a_mode_that_leaves_a_ringing_is_weak_and_doubt_of_the_law_is_in_the_statistical_part() -> (
    None
):
    size = len(STATED)
    doubt = ("choice of the rung", "to the next richer rung", np.full(size, 0.02))
    ones = np.ones(size)

    def told(ringing: float, *lines: tuple[str, str, np.ndarray]) -> _Told:
        return _Told(ones, 0.01 * ones, 3.0 * ones, lines, ringing)

    assert told(1.0).estimate(0).identifiable == "yes"
    weak = told(1.01 * RINGS_ON).estimate(0)
    assert weak.identifiable == "weakly"
    assert "ring" in weak.note
    alone, doubted = told(1.0).estimate(0), told(1.0, doubt).estimate(0)
    assert doubted.high - doubted.low > 1.3 * (alone.high - alone.low)
    assert [line.source for line in doubted.budget][1:] == ["choice of the rung"]


def test_a_damping_ratio_is_told_within_its_own_target() -> None:
    """Its target is absolute: 0.01, however large it is."""
    size = len(STATED)
    index = [name for name, _ in STATED].index("damping_ratio")

    def verdict(damping: float, error: float) -> str:
        centre = np.full(size, np.log(damping))
        told = _Told(centre, np.full(size, error / damping), np.full(size, 50.0), (), 1.0)
        return told.estimate(index).identifiable

    assert [verdict(0.02, e) for e in (0.004, 0.01, 0.04)] == ["yes", "weakly", "no"]
    assert [verdict(0.1, e) for e in (0.004, 0.01, 0.04)] == ["yes", "weakly", "no"]
    (quantity,) = [q for q in ESTIMATES if q.name == "damping_ratio"]
    assert WANTED["damping_ratio"] == quantity.target_uncertainty
