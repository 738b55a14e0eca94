"""Ramps of a bare motor: what cancels, what a disc tells, and what two inertias tell together."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from model.errors import IdentificationError
from model.identify.ramp_inertia import (
    RampMean,
    ShownInertia,
    gain_of,
    lag_of,
    mean_of_ramp,
    shown_inertia,
    whole_turns,
)

RATE, INERTIA = 1000.0, 2e-4


def ramp(acceleration: float, *, hold: float = 0.4, lag: float = 0.0) -> tuple[np.ndarray, ...]:
    """Time, angle and torque of a ramp from 60 rad/s, or down to it, between two holds, with friction and cogging."""
    duration = 240.0 / abs(acceleration)
    time = np.arange(0.0, duration + 2.0 * hold, 1.0 / RATE)
    begin = 60.0 if acceleration > 0.0 else 300.0
    since = np.clip(time - hold, 0.0, duration)
    speed = begin + acceleration * since
    angle = begin * time + 0.5 * acceleration * since**2
    angle += acceleration * duration * np.maximum(time - hold - duration, 0.0)
    pushed = np.where((time >= hold) & (time < hold + duration), INERTIA * acceleration, 0.0)
    torque = pushed + 0.013 + 4e-5 * speed
    if lag:
        shown = np.empty_like(torque)
        state, share = torque[0], -math.expm1(-1.0 / RATE / lag)
        for k, one in enumerate(torque):
            state += share * (one - state)
            shown[k] = state
        torque = shown
    return time, angle, torque + 3e-3 * np.cos(24.0 * angle) + 1e-3 * np.cos(angle)


def pair(acceleration: float) -> tuple[RampMean, RampMean]:
    both = [ramp(sign * acceleration, hold=0.0) for sign in (1.0, -1.0)]
    turns = min(whole_turns(time, angle, 0.05) for time, angle, _ in both)
    assert turns > 7
    up, down = (mean_of_ramp(time, angle, [torque], 0.05, turns) for time, angle, torque in both)
    return up, down


def test_a_ramp_up_and_one_down_give_the_inertia_without_friction_and_cogging() -> None:
    pairs = [pair(acceleration) for acceleration in (300.0, 300.0, 450.0, 600.0)]
    for up, down in pairs:
        assert up.speed == pytest.approx(down.speed, rel=6e-3)
    fit = shown_inertia(pairs, 0)
    assert fit.values[0] == pytest.approx(INERTIA, rel=1e-3)


def test_a_ramp_without_a_whole_revolution_tells_nothing() -> None:
    time, angle, torque = ramp(20_000.0, hold=0.0)
    assert len(torque) < 20
    assert whole_turns(time, angle, 0.002) == 0


def test_the_lag_is_that_of_the_filter() -> None:
    none = np.mean([lag_of(*rows(a, 0.0)) for a in (600.0, -600.0)])
    late = np.mean([lag_of(*rows(a, 4e-3)) for a in (600.0, -600.0)])
    # The mean delay of a filter that steps once per row.
    assert late - none == pytest.approx(1.0 / RATE / math.expm1(1.0 / RATE / 4e-3), abs=2e-5)


def rows(acceleration: float, lag: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, slice]:
    time, angle, torque = ramp(acceleration, lag=lag)
    return time, angle, torque, slice(400, len(time) - 400)


def shown(
    inertia: float, *, gain: float = 1.02, error: float = 1e-9, disc: str = ""
) -> ShownInertia:
    return ShownInertia(
        disc=disc or f"{inertia}",
        inertia=inertia,
        inertia_uncertainty=1e-3 * inertia,
        shown=gain * (inertia + 2.6e-5),
        standard_error=error,
        degrees_of_freedom=20.0,
        levels=(gain * (inertia + 2.6e-5),) * 3,
    )


def test_two_inertias_give_the_gain_and_the_rotor() -> None:
    found = gain_of([shown(0.0), shown(2e-4)])
    assert found.gain == pytest.approx(1.02)
    assert found.rotor_inertia == pytest.approx(2.6e-5)
    # The bare rotor's inertia is nobody's statement: the disc's error is all.
    assert found.inertias == pytest.approx({"0.0": 0.0, "0.0002": 1.02e-3})
    assert found.scatter == pytest.approx(math.hypot(1e-9, 1e-9) / 2e-4)
    assert found.linearity == pytest.approx(0.0, abs=1e-12)


def test_runs_of_one_disc_share_its_error_and_two_discs_do_not() -> None:
    one = gain_of([shown(0.0), shown(2e-4, disc="A"), shown(2e-4, disc="A")])
    two = gain_of([shown(0.0), shown(2e-4, disc="A"), shown(2e-4, disc="B")])
    assert (set(one.inertias), set(two.inertias)) == ({"0.0", "A"}, {"0.0", "A", "B"})
    apart = math.hypot(*two.inertias.values())
    assert apart == pytest.approx(math.hypot(*one.inertias.values()) / math.sqrt(2.0))


def test_runs_that_do_not_agree_widen_the_scatter() -> None:
    off = dataclasses.replace(shown(2e-4), shown=shown(2e-4).shown * 1.001)
    agreed = gain_of([shown(0.0), shown(1e-4), shown(2e-4)])
    apart = gain_of([shown(0.0), shown(1e-4), off])
    assert apart.scatter > 10.0 * agreed.scatter
    assert apart.degrees_of_freedom == 1.0


@pytest.mark.parametrize("runs", [[shown(2e-4)], [shown(2e-4), shown(2e-4)]])
def test_one_inertia_is_refused(runs: list[ShownInertia]) -> None:
    with pytest.raises(IdentificationError, match="two inertias"):
        gain_of(runs)
