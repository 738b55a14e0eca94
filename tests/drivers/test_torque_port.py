"""The torque port: scale, zero, range ends, and its disagreement with the drive's own torque."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.cia401 import cross_check, servo_off_zero, torque_input, with_zero
from drivers.cia406 import CounterConfig
from drivers.errors import DriverError


def test_one_volt_is_rated_torque() -> None:
    channel = torque_input(0.637).as_channel()
    assert channel.to_si(np.array([3200]))[0] == pytest.approx(0.637)
    half = torque_input(0.637, volts_per_rated_torque=2.0).as_channel()
    assert half.to_si(np.array([3200]))[0] == pytest.approx(0.3185)


def test_the_zero_is_taken_servo_off_and_subtracted() -> None:
    rng = np.random.default_rng(3)
    analog = torque_input(0.637)
    counts = np.rint(64 + rng.normal(0, 2, 2000)).astype(np.int64)  # 20 mV
    usable = np.ones(2000, dtype=bool)
    usable[100] = False
    counts[100] = 30000
    zero = servo_off_zero(counts, usable, analog)
    assert zero.volts == pytest.approx(0.020, abs=4 * zero.standard_error)
    assert zero.cycles == 1999
    zeroed = with_zero(analog, zero)
    torque = zeroed.as_channel().to_si(np.delete(counts, 100))
    assert abs(torque.mean()) < 1e-12
    assert zeroed.calibration.offset_uncertainty == pytest.approx(zero.standard_error * 0.637)
    with pytest.raises(DriverError, match="too few"):
        servo_off_zero(counts[:10], usable[:10], analog)


def test_range_ends_and_open_lines_are_saturated() -> None:
    analog = torque_input(0.637, full_scale=10.24)
    counts = np.array([0, 20000, 32767, -32768, -32700, 32500])
    assert analog.saturated(counts).tolist() == [False, False, True, True, True, True]
    pulled = torque_input(0.637, open_level=-5.0)
    assert pulled.saturated(np.array([-16000, 0])).tolist() == [True, False]


def test_agreement_and_disagreement() -> None:
    rng = np.random.default_rng(5)
    drive = np.linspace(-0.3, 0.3, 500)
    good = np.ones(500, dtype=bool)
    agrees = cross_check(drive + rng.normal(0, 1e-3, 500), drive, good)
    assert agrees.slope == pytest.approx(1.0, abs=5e-3)
    assert not agrees.disagrees(5e-3, 0.02)
    assert cross_check(drive * 1.1, drive, good).disagrees(5e-3, 0.02)
    assert cross_check(drive + 0.02, drive, good).disagrees(5e-3, 0.02)
    steady = cross_check(np.full(500, 0.1) + rng.normal(0, 1e-3, 500), np.full(500, 0.1), good)
    assert math.isnan(steady.slope)
    assert not steady.disagrees(5e-3, 0.02)


@given(st.lists(st.tuples(st.floats(), st.floats(), st.booleans()), max_size=20))
def test_any_numbers_are_checked_without_an_exception(rows: list[tuple[float, float, bool]]) -> None:
    port, drive, usable = (
        (np.array(c) for c in zip(*rows, strict=True)) if rows else (np.empty(0), np.empty(0), np.empty(0, bool))
    )
    keep = usable.astype(bool) & (np.abs(port) < 1e100) & (np.abs(drive) < 1e100)
    assert cross_check(port, drive, keep).cycles <= len(rows)


def test_wrong_scales_are_refused() -> None:
    for rated, volts in ((0.0, 1.0), (0.637, 0.0), (math.nan, 1.0)):
        with pytest.raises(DriverError, match="must be positive"):
            torque_input(rated, volts_per_rated_torque=volts)


def test_the_largest_step_of_a_counter() -> None:
    config = CounterConfig(lines=18000, multiplication=4, largest_speed=2 * math.pi)
    assert config.largest_step(1_000_000) == 73
    assert CounterConfig().largest_step(1_000_000) == 0
