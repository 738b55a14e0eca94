"""What the steps leave while they ring says whether their mode is told."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from experiments.protocols.velocity_steps.quantities import ESTIMATES
from model.errors import IdentificationError
from model.identify import dynamics, step_estimates
from model.identify.step_estimates import (
    BY_LAW,
    BY_RUNG,
    DAMPING,
    FREQUENCY,
    FROM_BELOW,
    NO_HYSTERESIS,
    RINGS_ON,
    STATED,
    WANTED,
    WIDEST,
    Reading,
    _ringing_left,
    _rung_answer,
    _RungAnswer,
    _standard_error,
    _weighed_damping,
    damped_at,
    ran_away,
    ringing,
)
from model.identify.step_fit import Solution
from model.identify.step_problem import Problem
from model.units import RPM


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

    def told(ringing: float, *lines: tuple[str, str, np.ndarray]) -> _RungAnswer:
        return _RungAnswer(ones, 0.01 * ones, 3.0 * ones, lines, ringing)

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
        told = _RungAnswer(centre, np.full(size, error / damping), np.full(size, 50.0), (), 1.0)
        return told.estimate(index).identifiable

    assert [verdict(0.02, e) for e in (0.004, 0.01, 0.04)] == ["yes", "weakly", "no"]
    assert [verdict(0.1, e) for e in (0.004, 0.01, 0.04)] == ["yes", "weakly", "no"]
    (quantity,) = [q for q in ESTIMATES if q.name == "damping_ratio"]
    assert WANTED["damping_ratio"] == quantity.target_uncertainty


def test_what_is_left_near_the_mode_leaves_its_damping_open_before_its_frequency() -> None:
    size = len(STATED)
    centre = np.full(size, np.log(0.02))
    names = ("frequency", "damping_ratio")
    index = [[name for name, _ in STATED].index(name) for name in names]

    def called(left: float) -> list[str]:
        told = _RungAnswer(centre, np.full(size, 0.01), np.full(size, 50.0), (), 1.0, left)
        return [told.estimate(at).identifiable for at in index]

    assert called(1.1) == ["yes", "yes"]
    assert called(1.5) == ["yes", "weakly"]
    assert called(2.5) == ["weakly", "weakly"]


RUNGS = ("linear", "hardening", "hysteresis")


def reading(
    damping: float = 0.02,
    frequency: float = 40.0,
    error: float = 0.01,
    hidden: float = 1e9,
    cost: float = 900.0,
) -> Reading:
    """What a rung says, everything known to the same share."""
    size = len(STATED)
    centre = np.zeros(size)
    centre[DAMPING], centre[FREQUENCY] = np.log(damping), np.log(frequency)
    errors, many = np.full(size, error), np.full(size, 1000.0)
    return Reading(
        centre=centre,
        error=errors,
        freedom=many,
        counts=np.zeros(size),
        left=1.0,
        hidden=hidden,
        cost=cost,
        numbers=lambda vector: vector,
    )


def weighed(
    costs: tuple[float, ...],
    dampings: tuple[float, ...],
    samples: int = 1000,
    where_it_rings: float = 1.0,
) -> tuple[_RungAnswer, _RungAnswer]:
    """The chosen rung (the first) with the worst neighbour as its line, and the same with all rungs by their cost; so
    many times the damping of the last where the steps ring.
    """
    readings = {name: reading(z) for name, z in zip(RUNGS, dampings, strict=False)}
    answers: Any = {
        name: [SimpleNamespace(robust_cost=lambda cost=cost: cost, samples=samples, values={})]
        for name, cost in zip(readings, costs, strict=True)
    }
    first = readings[RUNGS[0]]
    lines = tuple(
        (source, "of the chosen rung", np.ones(len(STATED))) for source in (BY_RUNG, NO_HYSTERESIS)
    )
    told = _RungAnswer(first.centre, first.error, first.freedom, lines, 1.0)
    mode = SimpleNamespace(mode=lambda swung: (40.0, where_it_rings * dampings[-1]))
    problem: Any = SimpleNamespace(model=lambda values: mode)
    return told, _weighed_damping(told, problem, answers, readings, 1.0)


@pytest.mark.parametrize(
    ("hidden", "share"), [(10.0, 0.1), (250.0, 0.5), (1000.0, 1.0), (5000.0, 1.0)]
)
def test_beyond_the_richest_rung_stands_what_may_be_hidden(hidden: float, share: float) -> None:
    """What the last rung changed by gaining 1000 squares, another one changes by the root of those that it may gain."""
    readings = {
        "hardening": reading(frequency=40.0, cost=1900.0),
        "hysteresis": reading(frequency=40.0 * np.exp(0.02), hidden=hidden),
    }
    model = SimpleNamespace(hysteresis=(1.0, 1.0))
    problem: Any = SimpleNamespace(model=lambda values: model, steps=())
    solution: Any = SimpleNamespace(values={}, normals=(), weights=())
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(step_estimates, "_lines", lambda model, centre: [])
        said = _rung_answer(problem, solution, readings, "hysteresis", [(FROM_BELOW, "hardening")])
    (moved,) = [line for source, _, line in said.lines if source == BY_RUNG]
    assert moved[FREQUENCY] == pytest.approx(share * 0.02 / np.sqrt(3.0))


def test_the_damping_is_that_of_all_rungs_and_a_refused_one_says_nothing_of_it() -> None:
    _, alike = weighed((900.0, 900.0, 900.0), (0.02, 0.02, 0.02 * np.exp(0.3)))
    damping = alike.estimate(DAMPING)
    assert np.log(damping.value / 0.02) == pytest.approx(0.1)
    (line,) = [b for b in damping.budget if b.source == BY_RUNG]
    # Two at 0 and one at 0.3 scatter by 0.1 sqrt 2 about their mean.
    assert line.standard_uncertainty / damping.value == pytest.approx(0.1 * np.sqrt(2.0))
    assert damping.budget[0].standard_uncertainty / damping.value == pytest.approx(0.01)
    assert NO_HYSTERESIS not in {b.source for b in damping.budget}
    _, refused = weighed((980.0, 900.0, 900.0), (0.08, 0.02, 0.02))
    assert refused.estimate(DAMPING).value == pytest.approx(0.02)
    assert refused.estimate(DAMPING).expanded_uncertainty < 0.0005


def test_between_the_swing_of_the_steps_and_the_one_that_is_stated_there_is_only_the_law() -> None:
    _, far = weighed((900.0, 900.0, 900.0), (0.02, 0.02, 0.02), where_it_rings=np.exp(0.3))
    damping = far.estimate(DAMPING)
    (line,) = [b for b in damping.budget if b.source == BY_LAW]
    # A third of the evidence is that of the hysteresis.
    assert line.standard_uncertainty / damping.value == pytest.approx(0.1 / np.sqrt(3.0))
    assert BY_LAW not in {b.source for b in far.estimate(FREQUENCY).budget}


@pytest.mark.parametrize(
    ("errors", "calmest"), [((0.1, 0.5, 0.5, 0.5), 1), ((2.0, 2.0, 0.1, 0.1), 3), ((2.0,) * 4, 4)]
)
def test_the_law_is_asked_for_from_the_calmest_steps_on_that_tell_the_damping(
    errors: tuple[float, ...], calmest: int
) -> None:
    """They swing by 1, 2, 4 and 8; of a damping of 0.02 within 0.01 a relative error of a quarter is enough."""
    swings = np.array([8.0, 1.0, 4.0, 2.0])

    def covariance(without: tuple[int, ...] = ()) -> np.ndarray:
        told = sum(
            error**-2.0
            for error, place in zip(errors, (1, 3, 2, 0), strict=True)
            if place not in without
        )
        return np.eye(len(STATED)) / told

    size = len(STATED)
    solution: Any = SimpleNamespace(
        covariance=covariance, vector=np.zeros(size), shape=SimpleNamespace(names=("",) * size)
    )
    assert damped_at(solution, reading(damping=0.02), swings) == pytest.approx(
        ringing(np.sort(swings)[:calmest])
    )


def test_a_hysteresis_that_explains_less_than_the_spring_it_holds_was_searched_in_vain() -> None:
    told, same = weighed((900.0, 880.0, 900.0), (0.02, 0.03, 0.04))
    assert same is told
    _, well = weighed((900.0, 895.0, 900.0), (0.02, 0.03, 0.04))
    assert well is not told


@pytest.mark.parametrize(
    ("speeds", "counts"), [((60.0, 120.0, 250.0), True), ((60.0, 120.0), False)]
)
def test_a_speed_that_says_most_does_not_hide_behind_its_own_weight(
    speeds: tuple[float, ...], counts: bool
) -> None:
    """Its steps pull nothing where all agree with it; without them the others lead elsewhere."""
    targets = [sign * rpm * RPM for rpm in speeds for sign in (1.0, -1.0)]
    steps = [SimpleNamespace(data=SimpleNamespace(target=target)) for target in targets]
    solution: Any = SimpleNamespace(
        covariance=lambda: np.array([[1e-8]]),
        influence=lambda: np.zeros((len(steps), 1)),
        left_out=lambda group: np.array([0.3 if 0 in group else 0.0]),
    )
    problem = Problem(steps=cast(Any, steps), basis=(), error_width=1.0, model=cast(Any, None))
    error, _ = _standard_error(problem, solution, np.array([[1.0]]), 1.0)
    # 0.3 of three speeds: sqrt(2/3 (0.2^2 + 2 0.1^2)).
    assert error[0] == pytest.approx(0.2 if counts else 1e-4, rel=1e-3)


def test_frequency_and_stiffness_keep_the_worst_neighbour() -> None:
    told, by_evidence = weighed((900.0, 900.0, 900.0), (0.02, 0.03, 0.04))
    for index in set(range(len(STATED))) - {DAMPING}:
        assert by_evidence.estimate(index) == told.estimate(index)


@pytest.mark.parametrize(
    ("costs", "samples"), [((900.0, 900.0, 900.0), 700), ((900.0, 900.0), 1000)]
)
def test_rungs_that_may_all_be_wrong_are_not_weighed(
    costs: tuple[float, ...], samples: int
) -> None:
    """More than 1.1 times the noise of counting is left, or the hysteresis was left out."""
    told, same = weighed(costs, (0.02, 0.03, 0.04)[: len(costs)], samples)
    assert same is told


def test_a_search_that_ran_away_is_no_rung() -> None:
    good, low = reading(), reading(frequency=2.4)
    wide = reading(error=1.01 * WIDEST / 1.96)
    assert ran_away(good, 1e-3) == ""
    assert "2.4 Hz" in ran_away(low, 1e-3)
    assert "401 Hz" in ran_away(reading(frequency=401.0), 1e-3)
    assert "within 51 %" in ran_away(wide, 1e-3)

    def sound(**rungs: Reading) -> Any:
        answers: Any = dict(rungs)
        return answers, rungs, dynamics._without_runaways(answers, rungs, 1e-3)

    answers, readings, said = sound(linear=low, hardening=good)
    assert list(answers) == list(readings) == ["hardening"]
    assert len(said) == 1
    assert said[0].startswith("The linear rung is not used")
    with pytest.raises(IdentificationError, match=r"2\.4 Hz.*51 %"):
        sound(linear=low, hardening=wide)
