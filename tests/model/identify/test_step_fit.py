"""The problem of velocity steps and its search: the input between its samples, the bearing, slopes, starts."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from model.identify import step_estimates, step_fit
from model.identify.dynamics import fit_ladder
from model.identify.step_data import step_data
from model.identify.step_problem import (
    BASIS,
    LARGEST_SKEW,
    STEPS,
    Problem,
    Shape,
    step_arrays,
)
from model.identify.step_rungs import models_of, shapes_of
from model.identify.step_search import LIMITS, SLIDING, WORTH, climb
from tests.model.identify.test_dynamics import EXPECTED, step


def test_a_skew_at_its_bound_is_pulled_by_what_is_looked_at() -> None:
    blind: Any = SimpleNamespace(normals=lambda *where, **how: ())
    goal = step_fit._Goal(
        problem=blind,
        shape=Shape(names=("stiffness", "skew")),
        noise=1.0,
        weights=np.empty(0),
        centre=np.zeros(2),
        penalty=np.array([0.0, 1.0]),
    )
    here = step_fit._Place(np.zeros(2), {"stiffness": 0.0, "skew": 0.0}, 0.0)
    there = goal._place(here, np.array([1.0, 4.0 * LARGEST_SKEW]))
    assert there.values["skew"] == there.vector[1] == LARGEST_SKEW
    assert there.cost == pytest.approx(LARGEST_SKEW**2)


@pytest.mark.parametrize("share", [0.25, 0.33, 0.4])
def test_the_input_oscillates_between_its_samples_as_far_as_at_them(share: float) -> None:
    """It rings with the output, up to 0.4 of the sampling rate; what is lost of it moves the mode."""
    time = np.arange(400) / 1000.0

    def angle(at: np.ndarray) -> np.ndarray:
        return 100.0 * at + 0.2 * np.sin(2.0 * math.pi * 1000.0 * share * at)

    data = step_data(
        time, angle(time), angle(time) / 50.0, 50.0, output_quantum=1e-6, input_quantum=1e-6
    )
    fine = step_arrays(data, 1e-4, BASIS)
    inside = (fine.fine > 0.05) & (fine.fine < 0.35)
    away = fine.rigid - angle(fine.fine) / 50.0
    away -= away[inside].mean()
    # Of 0.2/50 rad a cubic spline loses up to a fifth.
    assert np.max(np.abs(away[inside])) < 0.03 * 0.2 / 50.0


def test_a_count_at_the_end_of_a_step_is_a_count_between_the_samples() -> None:
    time = np.arange(200) / 1000.0
    angle = 100.0 * time
    for place in (0, 1, 2, -1):
        counted = angle.copy()
        counted[place] += 1e-3
        plain, one = (
            step_arrays(
                step_data(time, row, angle / 50.0, 50.0, output_quantum=1e-6, input_quantum=1e-6),
                1e-4,
                BASIS,
            ).rigid
            for row in (angle, counted)
        )
        away = one - plain
        assert np.ptp(away) < 1.5e-3 / 50.0


def test_a_gear_softer_than_its_card_has_a_softer_bearing() -> None:
    """The bearing keeps its share of the compliance, so that C_b/K_b goes as 1/K."""
    model = models_of(EXPECTED)
    loss = math.log(0.2)
    same, soft = (
        model({"stiffness": math.log(factor * EXPECTED.stiffness), "damping": loss})
        for factor in (1.0, 0.5)
    )
    assert same.relaxation == pytest.approx(EXPECTED.relaxation)
    assert soft.relaxation == pytest.approx(2.0 * EXPECTED.relaxation)


def test_a_slope_is_that_of_both_sides() -> None:
    """A sample that sticks on one side of where the search stands is half a jump, not one over the step."""
    shape = Shape(names=("bearing", "soft", "damping"), prior={"bearing": (0.0, 5.0)})
    problem: Any = SimpleNamespace(interval=1e-4, _at=lambda values: (values, np.empty(0)))
    here = {"bearing": 1.0, "soft": 10.0, "damping": -3.0}
    moved = Problem._moved(problem, shape, here)
    for one, step_size in zip(moved, (0.1, STEPS["soft"], STEPS["damping"]), strict=True):
        assert one.behind is not None
        assert one.ahead[0][one.name] == pytest.approx(here[one.name] + step_size)
        assert one.behind[0][one.name] == pytest.approx(here[one.name] - step_size)
        assert one.by == 2.0 * step_size
    # A bearing that drives the output is no neighbour of one without friction.
    (free, *_) = Problem._moved(problem, shape, {**here, "bearing": 0.0})
    assert free.behind is None
    assert free.by == free.ahead[0]["bearing"] == pytest.approx(0.1)


@pytest.mark.parametrize(("below", "starts"), [(1000.0, len(SLIDING)), (1.0 + WORTH / 2.0, 1)])
def test_a_hysteresis_is_searched_from_all_its_starts_and_from_a_spring_as_bent_as_the_card_says(
    monkeypatch: pytest.MonkeyPatch, below: float, starts: int
) -> None:
    """The hardening spring below it lies in a valley of its own, where the search ends with costs that look well.

    Where that spring explains the steps as well as the first start with an element, there is none to search for.
    """
    from model.identify import step_search

    begun: list[tuple[str, dict[str, float]]] = []
    monkeypatch.setattr(
        step_search,
        "fit_all",
        lambda problem, shape, values, error, **how: one_of(shape, values, error),
    )

    def one_of(shape: Shape, values: dict[str, float], error: np.ndarray) -> Any:
        return SimpleNamespace(
            shape=shape,
            values=values,
            error=error,
            weights=np.ones(1),
            noise=1.0,
            normals=(),
            samples=100_000,
            robust_cost=lambda: below if shape.names[-1] == "kink" else 1.0,
        )

    def settled(
        problem: Problem, shape: Shape, values: dict[str, float], error: np.ndarray, noise: float
    ) -> Any:
        begun.append((shape.names[-1], dict(values)))
        bent = (
            {**values, "second": 3.0, "third": 3.0, "kink": 3.0} if "second" in values else values
        )
        # A cost that is explained at once: nothing but the rule asks for another start.
        return one_of(shape, bent, error)

    monkeypatch.setattr(step_search, "_settled", settled)
    monkeypatch.setattr(step_search, "_first_look", lambda *about: [40.0])
    long: Any = SimpleNamespace(basis=BASIS, steps=[SimpleNamespace(stamps=np.empty(100_000))])
    answers = climb(long, EXPECTED, 1e-6, "hysteresis", 1e-3)
    slid = [values for last, values in begun if last == "limit"]
    _, added = shapes_of(EXPECTED, 40.0)
    assert len(slid) == starts
    for values, (share, _) in zip(slid, SLIDING, strict=False):
        assert {name: values[name] for name in added["hardening"]} == added["hardening"]
        assert values["limit"] == added["hysteresis"]["limit"] + min(LIMITS)
        assert values["soft"] == pytest.approx(math.log(share * EXPECTED.stiffness))
    # The hardening spring is begun again where the element left off, stiffer by it: the same for the smallest swings.
    last, values = begun[-1]
    assert last == "kink"
    above = answers["hysteresis"][0].values
    assert math.exp(values["stiffness"]) == pytest.approx(
        math.exp(above["stiffness"]) + math.exp(above["soft"])
    )
    assert len(answers["hardening"]) == 1 + sum(last == "kink" for last, _ in begun[:-1])


def test_a_hysteresis_that_is_not_explained_is_searched_to_the_last_start(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from model.identify import step_search

    begun: list[dict[str, float]] = []

    def one_of(values: dict[str, float], cost: float) -> Any:
        return SimpleNamespace(
            shape=shape,
            values=values,
            error=None,
            weights=None,
            noise=1.0,
            normals=(),
            samples=100,
            robust_cost=lambda: cost,
        )

    def settled(problem: Any, shape: Shape, values: dict[str, float], *rest: Any) -> Any:
        begun.append(values)
        return one_of(values, 1e6 / min(len(begun), 7) - len(begun))

    monkeypatch.setattr(step_search, "_settled", settled)
    monkeypatch.setattr(
        step_search, "fit_all", lambda problem, shape, values, *rest, **how: one_of(values, 1e5)
    )
    long: Any = SimpleNamespace(steps=[SimpleNamespace(stamps=np.empty(100_000))])
    shape = Shape(names=("stiffness", "second", "soft"))
    starts = [({"soft": float(place)}, np.empty(0)) for place in range(8)]
    found = step_search._answers(long, shape, starts, 1.0, 2, math.inf)
    assert [values["soft"] for values in begun] == list(range(8))
    # The best of them, and those that cost hardly more, are fitted to the end.
    assert [one.values["soft"] for one in found] == [7.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0, 0.0]
    assert [one.robust_cost() == 1e5 for one in found] == [True, True] + 6 * [False]


def test_the_law_is_asked_from_the_calmest_steps_on(monkeypatch: pytest.MonkeyPatch) -> None:
    steps = [step(v, seed)[0] for seed, v in enumerate((1200.0, 2400.0, -1200.0, -2400.0))]
    asked: list[np.ndarray] = []

    def calmest(solution: Any, reading: Any, swings: np.ndarray) -> float:
        asked.append(swings)
        return 1.0

    monkeypatch.setattr(step_estimates, "damped_at", calmest)
    fit = fit_ladder(steps, EXPECTED, error_given=True, richest="linear")
    (swings,) = asked
    assert swings == pytest.approx([fit.model.carried(float(one)) for one in fit.transient])
