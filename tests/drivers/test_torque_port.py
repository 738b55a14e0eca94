"""The torque port: scale, zero, range ends."""

from __future__ import annotations

import math

import numpy as np
import pytest

from drivers.cia401 import torque_input
from drivers.cia406 import CounterConfig
from drivers.errors import DriverError


def test_one_volt_is_rated_torque() -> None:
    channel = torque_input(0.637).as_channel()
    assert channel.to_si(np.array([3200]))[0] == pytest.approx(0.637)
    half = torque_input(0.637, volts_per_rated_torque=2.0).as_channel()
    assert half.to_si(np.array([3200]))[0] == pytest.approx(0.3185)


def test_range_ends_and_open_lines_are_saturated() -> None:
    analog = torque_input(0.637, full_scale=10.24)
    counts = np.array([0, 20000, 32767, -32768, -32700, 32500])
    assert analog.saturated(counts).tolist() == [False, False, True, True, True, True]
    pulled = torque_input(0.637, open_level=-5.0)
    assert pulled.saturated(np.array([-16000, 0])).tolist() == [True, False]


def test_wrong_scales_are_refused() -> None:
    for rated, volts in ((0.0, 1.0), (0.637, 0.0), (math.nan, 1.0)):
        with pytest.raises(DriverError, match="must be positive"):
            torque_input(rated, volts_per_rated_torque=volts)


def test_the_largest_step_of_a_counter() -> None:
    config = CounterConfig(lines=18000, multiplication=4, largest_speed=2 * math.pi)
    assert config.largest_step(1_000_000) == 73
    assert CounterConfig().largest_step(1_000_000) == 0
