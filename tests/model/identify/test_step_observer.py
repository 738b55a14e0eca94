"""The response of the torsional mode: held by a bearing, and beside a measured speed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from model.identify.dynamics import OBSERVER, _problem, _response, _rung
from model.identify.step_fit import fit_all
from model.identify.step_problem import Shape
from model.identify.torsional_mode import TorsionModel
from model.kernels.steps import respond
from tests.model.identify.test_dynamics import EXPECTED, STATIC, step


def responding(
    model: TorsionModel,
    ideal: np.ndarray,
    interval: float,
    *,
    drag: float = 0.0,
    start: float = 0.0,
    seen: np.ndarray | None = None,
    observer: float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Angle and speed of an output that follows an input, and a measured speed where it has an observer."""
    size = len(ideal)
    angle, speed, piece = np.empty(size), np.empty(size), np.zeros(size, dtype=np.int64)
    respond(
        ideal,
        drag,
        interval,
        model.step(interval, observer),
        model.kinks,
        model.offsets,
        np.zeros(2),
        np.array([start, 0.0]),
        angle,
        speed,
        piece,
        np.zeros((0, 2)),
        ideal if seen is None else seen,
        observer,
        0.0,
    )
    return angle, speed


def test_a_bearing_holds_an_output_that_cannot_pull_free() -> None:
    model = TorsionModel(stiffness=STATIC, relaxation=1e-5, share=0.4)
    ideal = np.concatenate([np.zeros(20), np.full(180, 1e-5)])

    def end(drag: float) -> float:
        return float(np.max(np.abs(responding(model, ideal, 5e-4, drag=drag)[0])))

    assert end(1.1 * STATIC * 1e-5) < 0.02 * 1e-5
    assert end(0.0) > 1.5e-5


def test_an_observer_finds_the_motion_of_a_spring_that_has_two() -> None:
    """A spring that bends rings high or low at one and the same input; which of them is a matter of how it began."""
    natural, torque = 300.0, 300.0**2 * 1e-4
    model = TorsionModel(
        stiffness=natural**2,
        relaxation=1e-6,
        share=0.1,
        loss=2.0 * 0.01 * natural,
        second=2.0,
        third=2.0,
        torques=(torque, 2.0 * torque),
    )
    interval = 1e-4
    ideal = 1e-5 * np.sin(1.1 * natural * interval * np.arange(40_000))

    def swing(angle: np.ndarray) -> float:
        return float(np.ptp(angle[-2000:]))

    low, _ = responding(model, ideal, interval)
    high, speed = responding(model, ideal, interval, start=5e-4)
    assert swing(high) > 3.0 * swing(low)
    observer = 2.0 * OBSERVER * natural
    followed, _ = responding(model, ideal, interval, seen=speed, observer=observer)
    assert swing(followed) == pytest.approx(swing(high), rel=0.01)


def test_a_speed_that_is_a_staircase_is_not_followed() -> None:
    quick, slow = (
        _problem([step(speed, 1)[0]], EXPECTED, error_given=True)[0] for speed in (600.0, 60.0)
    )
    assert quick.observer == pytest.approx(2.0 * OBSERVER * math.sqrt(EXPECTED.stiffness))
    assert slow.observer == quick.alone.observer == 0.0


def test_what_a_rung_predicts_it_predicts_alone() -> None:
    """A damping that is far off hides behind the measured speed while it is fitted, and nowhere else."""
    data = step(1800.0, 3)[0]
    problem, noise, _ = _problem([data], EXPECTED, error_given=True)
    start = {"stiffness": math.log(STATIC), "damping": math.log(0.002), "skew": 3e-4}
    held = Shape(names=("skew",))
    found = fit_all(problem, held, start, np.zeros(2 * len(problem.basis)), noise=noise)
    row = _rung("linear", problem, found)
    (alone,) = problem.alone.normals(held, found.values, found.error)
    assert row.rms[0] == pytest.approx(alone.rms, rel=1e-9)
    assert row.rms[0] > 1.2 * found.normals[0].rms
    told, by_itself = (_response(one, found, data) for one in (problem, problem.alone))
    assert np.array_equal(told.angle, by_itself.angle)
    # The torque in the gear is that of the motion that was measured.
    assert np.std(told.acceleration) < 0.9 * np.std(by_itself.acceleration)
