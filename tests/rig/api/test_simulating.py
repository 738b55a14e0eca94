"""What the model answers to an input."""

from __future__ import annotations

import numpy as np
import pytest

import rig
from model.dynamics import simulate_prescribed
from model.linear import dynamic_parameters, modes
from model.units import REVOLUTION, RPM
from rig.errors import ConfigurationError


def test_a_step_of_the_speed_ends_at_the_speed_over_the_ratio() -> None:
    gear = rig.gear()
    run = rig.simulate(gear, speed_rpm=600.0, duration=2.0, rate=5000.0)
    late = run.time > 1.5
    mean = np.polyfit(run.time[late], run["output_angle"][late], 1)[0]
    assert mean == pytest.approx(600.0 * RPM / 120.0, rel=2e-3)
    assert run["output_speed"].max() > 1.3 * mean
    before = run.time <= 0.05
    assert np.all(run["input_speed"][before] == 0.0)
    assert (run.metadata.origin, run.channels["torque"]) == ("simulated", "N m")


def test_it_rings_with_the_mode_of_the_gear() -> None:
    gear = rig.gear()
    run = rig.simulate(gear, speed_rpm=600.0, duration=0.4)
    ringing = run["output_speed"] - 600.0 * RPM / 120.0
    rows = run.time > 0.05
    spectrum = np.abs(np.fft.rfft(ringing[rows] * np.hanning(rows.sum())))
    frequency = np.argmax(spectrum) * 10_000.0 / rows.sum()
    first = (
        min(
            mode.damped_frequency
            for mode in modes(dynamic_parameters(gear))
            if mode.damping_ratio < 1.0
        )
        / REVOLUTION
    )
    assert frequency == pytest.approx(first, abs=10_000.0 / rows.sum())


def test_any_motion_is_equation_2() -> None:
    gear, angle = rig.gear(), 5.0 * (1.0 - np.cos(np.linspace(0.0, 6.0, 3001)))
    run = rig.simulate(gear, input_angle=angle, rate=2000.0, load_torque=3.0)
    answer = simulate_prescribed(gear, angle, 1.0 / 2000.0, load_torque=3.0)
    assert np.array_equal(run["output_angle"], answer.output_angle)
    assert np.array_equal(run["torque"], answer.wave_generator_torque)


def test_an_input_must_be_given_and_only_one() -> None:
    with pytest.raises(ConfigurationError, match="speed_rpm or input_angle"):
        rig.simulate(rig.gear())
    with pytest.raises(ConfigurationError, match="speed_rpm or input_angle"):
        rig.simulate(rig.gear(), speed_rpm=60.0, input_angle=np.zeros(10))
    with pytest.raises(ConfigurationError, match="a duration > 0 s"):
        rig.simulate(rig.gear(), speed_rpm=60.0, duration=0.0)
