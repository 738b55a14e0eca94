"""Matrices, modes, closed forms and resonances of equation 2."""

from __future__ import annotations

import math

import numpy as np
import pytest

from model.errors import ParameterError
from model.gear_file import shipped_gear
from model.linear import (
    DynamicParameters,
    damping_matrix,
    dynamic_parameters,
    energy_forms,
    mass_matrix,
    modes,
    resonance_speeds,
    stiffness_matrix,
    torsional_mode,
    undamped_frequencies,
)
from model.stiffness import drive_stiffness
from model.units import RPM
from tests.model.reduced_form import reduced_damping

GEAR = shipped_gear()
NOMINAL = DynamicParameters(
    ratio=120.0,
    tooth_angle=math.radians(30.0),
    neutral_radius=31.5e-3,
    bearing_stiffness=5e7,
    bearing_damping=1e3,
    mesh_stiffness=5e8,
    cup_stiffness=2e4,
    structural_damping=0.0,
    flexspline_inertia=5e-5,
    output_inertia=0.1,
)


def test_parameters_of_a_gear() -> None:
    p = dynamic_parameters(GEAR, output_inertia=0.05)
    stiffness = drive_stiffness(GEAR)
    assert (p.cup_stiffness, p.bearing_stiffness) == (stiffness.cup.total, stiffness.bearing.total)
    assert p.output_inertia == 0.05
    assert p.combined_stiffness == pytest.approx(stiffness.combined_output, rel=1e-12)


@pytest.mark.parametrize(
    "name", ["cup_stiffness", "output_inertia", "bearing_damping", "tooth_angle"]
)
@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf])
def test_impossible_parameters_are_refused(name: str, value: float) -> None:
    with pytest.raises(ParameterError, match=rf"dynamics\.{name}"):
        NOMINAL.replaced(**{name: value})


def test_modes_of_the_nominal_set() -> None:
    """65.3 Hz with a damping ratio of 4.64e-4, 4624 Hz with 0.25, 16226 Hz with 0.026; radius 31.5 mm inferred."""
    found = modes(NOMINAL)
    assert [m.natural_frequency / (2.0 * math.pi) for m in found] == pytest.approx(
        [65.3, 4624.0, 16226.0], rel=5e-3
    )
    assert [m.damping_ratio for m in found] == pytest.approx([4.64e-4, 0.25, 0.026], rel=2e-2)


@pytest.mark.parametrize(
    ("change", "frequency", "ratio"),
    [
        ({"bearing_damping": 1e4}, 65.3, 4.6e-3),
        ({"bearing_stiffness": 1e7}, 54.2, 6.6e-3),
        ({"mesh_stiffness": 1e9}, 66.0, 4.8e-4),
        ({"cup_stiffness": 1e5}, 114.0, 2.5e-3),
        ({"output_inertia": 0.5}, 29.2, 2.1e-4),
        ({"structural_damping": 1.0}, 65.3, 9.1e-3),
        ({"structural_damping": 5.0}, 65.3, 4.4e-2),
    ],
)
def test_torsional_mode_over_the_parameters(
    change: dict[str, float], frequency: float, ratio: float
) -> None:
    p = NOMINAL.replaced(**change)
    first = modes(p)[0]
    assert first.natural_frequency / (2.0 * math.pi) == pytest.approx(frequency, rel=1e-2)
    assert first.damping_ratio == pytest.approx(ratio, rel=3e-2)


def test_closed_forms_of_frequency_and_damping() -> None:
    first = modes(NOMINAL)[0]
    combined = NOMINAL.combined_stiffness
    frequency = math.sqrt(combined / NOMINAL.output_inertia)
    share = combined / (NOMINAL.bearing_stiffness * NOMINAL.radial_lever**2)
    assert first.natural_frequency == pytest.approx(frequency, rel=2e-4)
    assert first.damping_ratio == pytest.approx(0.5 * frequency * 1e3 / 5e7 * share, rel=2e-3)
    assert reduced_damping(NOMINAL) == pytest.approx(
        2.0 * first.damping_ratio * frequency * 0.1, rel=2e-3
    )


def test_frequencies_and_damping_of_the_default_gear() -> None:
    """Reference figures were computed with K_m = 3.98e9 and K_b = 1.08e8."""
    p = dynamic_parameters(GEAR, mesh_stiffness=3.98e9, bearing_stiffness=1.08e8)
    assert undamped_frequencies(p) == pytest.approx([680.6, 4.779e4, 3.127e5], rel=3e-3)
    lightly = modes(p.replaced(bearing_damping=1.08e3))
    assert [m.damping_ratio for m in lightly] == pytest.approx([5.1e-4, 0.20, 0.011], rel=4e-2)
    speeds = {
        r.order: r.input_speed / RPM
        for r in resonance_speeds(p.replaced(bearing_damping=1e3), (1, 2, 4))
    }
    assert [speeds[n] for n in (1.0, 2.0, 4.0)] == pytest.approx([6501.0, 3251.0, 1625.0], rel=1e-3)
    assert modes(dynamic_parameters(GEAR))[0].damping_ratio == pytest.approx(0.02, rel=0.05)


def test_damping_by_the_bearing_has_a_maximum() -> None:
    p = dynamic_parameters(GEAR)
    ratios = {}
    for damping in (1e4, 1.8e5, 1e7):
        first = torsional_mode(p.replaced(bearing_damping=damping))
        assert first is not None
        ratios[damping] = first.damping_ratio
    assert ratios[1.8e5] == pytest.approx(0.042, rel=0.05)
    assert ratios[1e4] < ratios[1.8e5] > ratios[1e7]


def test_no_damping_leaves_an_infinite_time_constant() -> None:
    for mode in modes(NOMINAL.replaced(bearing_damping=0.0)):
        assert mode.damping_ratio == 0.0
        assert mode.time_constant == math.inf


def test_energy_form_is_equation_2() -> None:
    p = NOMINAL.replaced(structural_damping=2.0)
    system, _, position, velocity = (a[0] for a in energy_forms([p]))
    rng = np.random.default_rng(1)
    x = rng.standard_normal(6)
    q, v = position @ x, velocity @ x
    assert velocity @ (system @ x) == pytest.approx(
        np.linalg.solve(mass_matrix(p), -damping_matrix(p) @ v - stiffness_matrix(p) @ q), rel=1e-9
    )
    assert position @ (system @ x) == pytest.approx(v, rel=1e-9)
    energy = 0.5 * v @ mass_matrix(p) @ v + 0.5 * q @ stiffness_matrix(p) @ q
    assert 0.5 * x @ x == pytest.approx(energy, rel=1e-9)


def test_corners_of_the_parameter_box_are_stable() -> None:
    rng = np.random.default_rng(7)
    for _ in range(100):
        factors = 10.0 ** rng.uniform(-1.0, 1.0, 6)
        names = (
            "bearing_stiffness",
            "bearing_damping",
            "mesh_stiffness",
            "cup_stiffness",
            "flexspline_inertia",
        )
        p = NOMINAL.replaced(
            **{n: f * getattr(NOMINAL, n) for n, f in zip(names, factors, strict=False)}
        )
        assert all(m.damping_ratio > 0.0 for m in modes(p))
