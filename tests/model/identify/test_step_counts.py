"""The counts of the input ring the model and not the gear: how much, what squares make of it, what is taken off."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from model.identify.dynamics import fit_ladder
from model.identify.step_counts import left_in_band, louder_in_band, rung_up
from model.identify.step_data import StepData
from model.identify.step_fit import Solution
from model.identify.step_problem import BASIS, Problem, step_arrays
from model.identify.torsional_mode import TorsionModel
from tests.model.identify.rigs import INPUT_QUANTUM
from tests.model.identify.test_dynamics import EXPECTED, MODE, STATIC, step

FREQUENCY, DAMPING = MODE.natural_frequency, MODE.damping_ratio
LINEAR = TorsionModel(stiffness=STATIC, relaxation=1e-6, share=0.1, loss=2.0 * DAMPING * FREQUENCY)
VALUES = {"skew": 0.0}


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
        input_density=1e-3 * (data.input_quantum / data.ratio) ** 2 / 12.0,
    )


def test_what_is_rung_up_is_what_the_model_makes_of_the_counts() -> None:
    found, stated = [], []
    for seed, speed in enumerate((600.0, 1200.0, 2400.0)):
        fine, _, _ = step(speed, seed, duration=1.2, jitter=0.0)
        quantum = 64 * INPUT_QUANTUM
        error = np.random.default_rng(seed).uniform(-0.5, 0.5, len(fine.time)) * quantum
        coarse = dataclasses.replace(
            fine, input_angle=fine.input_angle + error, input_quantum=quantum
        )
        angles = []
        for data in (fine, coarse):
            problem = problem_of(data)
            arrays = problem.steps[0]
            ideal = problem.ideal(arrays, np.zeros(2 * len(BASIS)))
            tables = LINEAR.step(problem.interval)
            angles.append(problem.response(arrays, VALUES, ideal, tables)[0])
        found.append(np.var(angles[1] - angles[0]))
        problem = problem_of(coarse)
        stated.append(rung_up(problem, problem.steps[0], VALUES))
    assert np.mean(found) == pytest.approx(np.mean(stated), rel=0.25)


def test_a_mode_that_has_had_no_time_is_rung_up_less() -> None:
    short, long = (problem_of(step(600.0, 3, duration=length)[0]) for length in (0.1, 2.0))
    little, much = (rung_up(p, p.steps[0], VALUES) for p in (short, long))
    assert little < 0.8 * much
    endless = problem_of(step(600.0, 3)[0]).input_density * FREQUENCY * (0.25 / DAMPING + DAMPING)
    assert much < endless
    assert much == pytest.approx(endless, rel=0.1)


def test_least_squares_take_the_counts_of_the_input_for_damping_and_that_is_taken_off() -> None:
    speeds = (600.0, 1200.0, 2400.0, -600.0, -1200.0, -2400.0)
    steps = [coarsely(step(v, seed)[0], 24) for seed, v in enumerate(speeds)]
    fit = fit_ladder(steps, EXPECTED, error_given=True, richest="linear")
    by_squares = fit.model.mode()[1]
    told = fit.estimates["damping_ratio"]
    assert by_squares > 1.05 * DAMPING
    assert abs(told.value - DAMPING) < 0.5 * (by_squares - DAMPING)
    line = next(line for line in told.budget if line.source == "counts of the input")
    assert line.standard_uncertainty == pytest.approx(
        (by_squares - told.value) / math.sqrt(3.0), rel=0.2
    )


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
    solution: Any = SimpleNamespace(
        normals=[normal], weights=np.ones(1), values={}, square=float(residual @ residual)
    )
    problem: Any = SimpleNamespace(
        steps=(SimpleNamespace(stamps=stamps),),
        model=lambda _: LINEAR,
        swing=0.0,
        input_density=1e-3 * 0.01**2,
    )
    return cast(Problem, problem), cast(Solution, solution)


def test_what_is_left_near_the_mode_is_held_against_what_is_left_beside_it() -> None:
    assert left_in_band(*left_by(0.0)) == pytest.approx(1.0, abs=0.3)
    assert left_in_band(*left_by(1.0)) > 5.0


def test_the_noise_at_the_peak_of_the_mode_is_louder_by_its_quality() -> None:
    expected = 1.0 + 0.01**2 * (1.0 + 0.25 / DAMPING**2)
    assert louder_in_band(*left_by(0.0)) == pytest.approx(expected, rel=0.02)


def test_a_mode_that_nothing_damps_is_led_nowhere() -> None:
    problem = dataclasses.replace(
        problem_of(step(600.0, 3)[0]), model=lambda _: dataclasses.replace(LINEAR, loss=-100.0)
    )
    assert math.isnan(rung_up(problem, problem.steps[0], VALUES))


def test_numbers_that_are_no_spring_have_no_mode() -> None:
    assert all(math.isnan(x) for x in dataclasses.replace(LINEAR, loss=math.inf).mode())
    assert LINEAR.mode() == pytest.approx((math.sqrt(STATIC), DAMPING), rel=0.02)
