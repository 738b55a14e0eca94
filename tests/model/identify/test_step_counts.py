"""Counts of both encoders drive the model and not the gear: what squares make of it, what is taken off."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from model.identify.dynamics import fit_ladder
from model.identify.step_counts import led_away, left_in_band
from model.identify.step_data import StepData
from model.identify.step_fit import Solution, fit_all
from model.identify.step_problem import BASIS, Problem, Shape, step_arrays
from model.identify.torsional_mode import TorsionModel
from tests.model.identify.rigs import INPUT_QUANTUM
from tests.model.identify.test_dynamics import EXPECTED, MODE, STATIC, step

FREQUENCY, DAMPING = MODE.natural_frequency, MODE.damping_ratio
LINEAR = TorsionModel(stiffness=STATIC, relaxation=1e-6, share=0.1, loss=2.0 * DAMPING * FREQUENCY)
OBSERVES = 0.1 * FREQUENCY


def linear(values: Mapping[str, float]) -> TorsionModel:
    """One spring, damped beside it."""
    stiffness = math.exp(values["stiffness"])
    loss = 2.0 * math.exp(values["damping"]) * math.sqrt(stiffness)
    return dataclasses.replace(LINEAR, stiffness=stiffness, loss=loss)


def coarsely(data: StepData, times: int) -> StepData:
    """The same step by an input encoder of so many times fewer lines."""
    quantum = times * INPUT_QUANTUM
    counted = (np.floor(data.input_angle / quantum) + 0.5) * quantum
    return dataclasses.replace(data, input_angle=counted, input_quantum=quantum)


def problem_of(data: StepData) -> Problem:
    return Problem(
        steps=(step_arrays(data, 1e-4, BASIS),),
        basis=BASIS,
        error_width=1e-4,
        model=lambda _: LINEAR,
    )


def test_squares_take_counts_for_damping_and_that_is_taken_off() -> None:
    """Of the input's, which ring the model, and of the output's, which its observer follows."""
    speeds = (600.0, 1200.0, 2400.0, -600.0, -1200.0, -2400.0)
    steps = [coarsely(step(v, seed)[0], 24) for seed, v in enumerate(speeds)]
    fit = fit_ladder(steps, EXPECTED, error_given=True, richest="linear")
    by_squares = fit.model.mode()[1]
    told = fit.estimates["damping_ratio"]
    assert by_squares > 1.05 * DAMPING
    assert abs(told.value - DAMPING) < 0.75 * (by_squares - DAMPING)
    line = next(line for line in told.budget if line.source == "counts of both encoders")
    assert line.standard_uncertainty == pytest.approx(
        (by_squares - told.value) / math.sqrt(3.0), rel=0.2
    )


def test_a_gear_that_is_counted_anew_is_the_one_that_was_fitted() -> None:
    """Without counts its steps lead nowhere: what they lead to is theirs alone."""
    data = dataclasses.replace(step(1200.0, 3)[0], output_quantum=1e-12, input_quantum=1e-12)
    problem = dataclasses.replace(problem_of(data), model=linear, observer=OBSERVES)
    shape = Shape(names=("stiffness", "damping", "skew"))
    start = {"stiffness": math.log(STATIC), "damping": math.log(DAMPING), "skew": 3e-4}
    fitted = fit_all(problem, shape, start, np.zeros(2 * len(BASIS)), noise=1e-6)
    assert led_away(problem, fitted)[:, :2] == pytest.approx(0.0, abs=2e-3)
    coarse = dataclasses.replace(data, output_quantum=3e-5)
    counted = dataclasses.replace(problem, steps=(step_arrays(coarse, 1e-4, BASIS),))
    assert np.ptp(led_away(counted, fitted)[:, 1]) > 5e-3


@pytest.mark.parametrize("away", [1e4, -1e4, 4.0, math.inf])
def test_a_direction_that_leads_out_of_all_springs_is_left_out(
    monkeypatch: pytest.MonkeyPatch, away: float
) -> None:
    """To first order; the analysis of both goes on."""
    steps = [step(v, seed)[0] for seed, v in enumerate((1200.0, 2400.0, -1200.0, -2400.0))]
    whole = Solution.left_out

    def left_out(self: Solution, group: Sequence[int]) -> np.ndarray:
        change = whole(self, group)
        return change if len(group) == 1 else np.full_like(change, away)

    monkeypatch.setattr(Solution, "left_out", left_out)
    found = fit_ladder(steps, EXPECTED, error_given=True, richest="linear").estimates
    assert found["damping_ratio"].value == pytest.approx(DAMPING, rel=0.1)
    assert not [name for name in found if name.endswith(("forward", "reverse"))]


def left_by(line: float) -> tuple[Problem, Solution]:
    """A step whose residual is noise and a line at the mode."""
    random = np.random.default_rng(4)
    stamps = np.arange(0.0, 1.5, 1e-3)
    residual = random.normal(size=len(stamps)) + line * np.cos(FREQUENCY * stamps)
    normal = SimpleNamespace(residual=residual, count=len(stamps))
    solution: Any = SimpleNamespace(normals=[normal], weights=np.ones(1), values={}, noise=1.0)
    problem: Any = SimpleNamespace(
        steps=(SimpleNamespace(stamps=stamps),),
        model=lambda _: LINEAR,
        swing=0.0,
        observer=0.0,
    )
    return cast(Problem, problem), cast(Solution, solution)


def test_what_is_left_near_the_mode_is_held_against_what_is_left_beside_it() -> None:
    ratio, hidden = left_in_band(*left_by(0.0))
    assert ratio == pytest.approx(1.0, abs=0.3)
    # Of the few samples that tell the mode chance hides as many squares as twice the root of their number, and more.
    assert 10.0 < hidden < 40.0
    rung, found = left_in_band(*left_by(1.0))
    assert rung > 5.0
    # The line has half a square of the noise in each of 1500 samples.
    assert found == pytest.approx(750.0 + hidden, rel=0.1)


def test_numbers_that_are_no_spring_have_no_mode() -> None:
    assert all(math.isnan(x) for x in dataclasses.replace(LINEAR, loss=math.inf).mode())
    assert LINEAR.mode() == pytest.approx((math.sqrt(STATIC), DAMPING), rel=0.02)
