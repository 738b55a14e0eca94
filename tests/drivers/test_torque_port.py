"""The torque port: scale, zero, range ends."""

from __future__ import annotations

import math

import numpy as np
import pytest

from drivers.bus.cia401 import torque_input
from drivers.bus.motor_encoder import MotorEncoder
from drivers.counting import largest_step
from drivers.errors import DriverError
from tests.drivers.can_bench import close, setup


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


def test_the_largest_step_of_an_encoder_follows_from_its_greatest_speed() -> None:
    assert largest_step(72_000, 2 * math.pi, 1_000_000) == 73
    for unknown in (0.0, math.nan, math.inf):
        with pytest.raises(DriverError, match="greatest speed"):
            MotorEncoder(largest_speed=unknown)


def test_a_counter_without_a_speed_of_its_own_turns_no_faster_than_the_motor() -> None:
    made = setup()
    try:
        made.rig.open()
        steps = {c.channel.name: c.largest_step for c in made.rig.nodes.columns}
        assert steps["input_angle"] == largest_step(8192 * 4, 400.0, 1_000_000)
        assert steps["output_angle"] == largest_step(18000 * 4, 400.0, 1_000_000)
    finally:
        close(made)
