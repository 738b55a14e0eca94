"""Draws: the mean and covariance that were asked for, nothing negative that can't be, the same again by the seed."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest

from model.friction import friction_torque
from model.gear_file import shipped_gear
from rig.errors import ConfigurationError
from rig.exchange.identified import of_set
from rig.exchange.samples import drawn, table_text
from tests.rig.exchange.known import known_gear

COUNT = 10_000


def test_mean_and_covariance_of_ten_thousand() -> None:
    gear = known_gear()
    values = drawn(gear, COUNT, seed=1).values
    numbers = {one.name: one.value for one in gear.parameters}
    mean = np.array([numbers[name] for name in gear.uncertain])
    error = np.sqrt(np.diag(gear.covariance))
    assert np.all(np.abs(values.mean(axis=0) - mean) < 4.0 * error / np.sqrt(COUNT))
    away = (np.cov(values.T) - gear.covariance) / np.outer(error, error)
    assert np.abs(away).max() < 0.05
    is_positive = [one.is_positive for one in gear.parameters if one.name in gear.uncertain]
    assert values[:, is_positive].min() > 0.0


def test_a_wide_number_stays_positive_with_its_own_mean() -> None:
    gear = known_gear()
    place = gear.uncertain.index("bearing.damping")
    value = next(one.value for one in gear.parameters if one.name == "bearing.damping")
    covariance = gear.covariance.copy()
    covariance[place, place] = (0.8 * value) ** 2
    values = drawn(replace(gear, covariance=covariance), COUNT, seed=2).values[:, place]
    assert values.min() > 0.0
    assert values.mean() == pytest.approx(value, abs=4 * 0.8 * value / np.sqrt(COUNT))
    # A normal of that width would lie below nothing in a tenth of the draws.
    assert np.mean(values < 0.2 * value) < 0.1


def test_a_draw_outside_of_what_a_set_may_hold_is_drawn_again() -> None:
    gear = known_gear()
    place = gear.uncertain.index("mesh_friction.shape")
    covariance = gear.covariance.copy()
    covariance[place, place] = 9.0
    values = drawn(replace(gear, covariance=covariance), 2000, seed=5).values
    assert values.shape[0] == 2000
    assert 0.1 <= values[:, place].min() < 0.12
    assert values[:, place].max() <= 10.0
    covariance[place, place] = 1e9
    with pytest.raises(ConfigurationError, match="outside"):
        drawn(replace(gear, covariance=covariance), 2000, seed=5)


def test_a_row_is_a_gear_and_the_table_reads_back() -> None:
    gear = known_gear()
    samples = drawn(gear, 3, seed=3)
    again = drawn(gear, 3, seed=3)
    np.testing.assert_array_equal(samples.values, again.values)
    assert not np.array_equal(samples.values, drawn(gear, 3, seed=4).values)
    lines = table_text(samples).splitlines()
    assert lines[0].startswith("# 3 draws, seed 3")
    head, *rows = csv.reader(lines[1:])
    assert head[0] == "mesh_friction.coulomb [N]"
    np.testing.assert_array_equal(np.array(rows, dtype=float), samples.values)
    # A name is the path of a gear's number.
    made = gear.gear.with_values({samples.names[0]: float(samples.values[0, 0])})
    assert made.mesh_friction.coulomb == samples.values[0, 0]
    assert friction_torque(made, 100.0) != friction_torque(gear.gear, 100.0)


def test_nothing_to_draw_and_no_such_distribution_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="nothing to draw"):
        drawn(of_set(shipped_gear()), 10, seed=0)
    with pytest.raises(ConfigurationError, match="no draws"):
        drawn(known_gear(), 0, seed=0)
    gear = known_gear()
    covariance = gear.covariance.copy()
    i, j = (gear.uncertain.index(f"mesh_friction.{name}") for name in ("coulomb", "static"))
    covariance[i, j] = covariance[j, i] = 2.0 * np.sqrt(covariance[i, i] * covariance[j, j])
    with pytest.raises(ConfigurationError, match="no distribution"):
        drawn(replace(gear, covariance=covariance), 10, seed=0)
