"""Engaged zone, tooth pair, cup, bearing and their sum, against tables, closed forms and independent integrals."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import scipy

from model.errors import ParameterError
from model.gear import HarmonicDrive
from model.gear_file import shipped_gear
from model.geometry import engaged_zone, wedge_angle, wedge_lift
from model.stiffness import (
    bearing_load,
    bearing_stiffness,
    cup_stiffness,
    drive_stiffness,
    elliptic_integrals,
    hertz_contact,
    kraemer_damping,
)
from model.tooth import contact_compliance, pair_compliance, tooth_compliance

GEAR = shipped_gear()


def with_options(gear: HarmonicDrive, **options: object) -> HarmonicDrive:
    return dataclasses.replace(gear, options=dataclasses.replace(gear.options, **options))


def test_wedge_angle() -> None:
    assert math.degrees(wedge_angle(GEAR)) == pytest.approx(0.826936, abs=5e-7)
    assert wedge_lift(GEAR) == pytest.approx(4.474464e-4, rel=1e-6)


@pytest.mark.parametrize(
    ("modules", "teeth"),
    [
        (1.02, 7.5),
        (1.05, 11.8),
        (1.10, 16.3),
        (1.20, 22.2),
        (1.30, 26.3),
        (1.50, 31.9),
        (1.70, 35.6),
    ],
)
def test_engaged_teeth_table(modules: float, teeth: float) -> None:
    gear = GEAR.with_values({"geometry.radial_deformation": modules * GEAR.geometry.module})
    zone = engaged_zone(gear)
    assert zone.teeth == pytest.approx(teeth, abs=0.05)
    half = 0.5 * gear.geometry.flexspline_diameter
    ellipse = (zone.x / (half - gear.geometry.radial_deformation)) ** 2
    ellipse += (zone.y / (half + gear.geometry.radial_deformation)) ** 2
    assert ellipse == pytest.approx(1.0, rel=1e-12)
    assert math.hypot(zone.x, zone.y) == pytest.approx(
        0.5 * gear.geometry.circular_spline_diameter, rel=1e-14
    )


def test_engaged_zone_vanishes_at_one_module_and_is_refused_there() -> None:
    module = GEAR.geometry.module
    almost = GEAR.with_values({"geometry.radial_deformation": module * (1.0 + 1e-9)})
    assert engaged_zone(almost).teeth < 0.01
    with pytest.raises(ParameterError, match=r"geometry\.radial_deformation.*equation 4"):
        GEAR.with_values({"geometry.radial_deformation": module})


def test_which_lobes_count() -> None:
    both = engaged_zone(GEAR).teeth
    assert engaged_zone(with_options(GEAR, engaged_zone="leading-one-lobe")).teeth == pytest.approx(
        0.5 * both
    )
    assert engaged_zone(with_options(GEAR, engaged_zone="both-halves")).teeth == pytest.approx(
        2.0 * both
    )


def test_tooth_compliance_published_and_by_energy() -> None:
    published, energy = (
        tooth_compliance(GEAR),
        tooth_compliance(with_options(GEAR, bending="energy")),
    )
    assert published.bending == pytest.approx(0.97e-11, rel=1e-3)
    assert energy.bending == pytest.approx(3.60e-11, rel=5e-3)
    assert published.shear == energy.shear == pytest.approx(49e-11, rel=1e-2)
    assert published.total == pytest.approx(5.55e-10, rel=2e-3)
    assert energy.total == pytest.approx(5.82e-10, rel=2e-3)


def test_bending_by_energy_is_the_integral_of_the_strain_energy() -> None:
    gear = with_options(GEAR.with_values({"tooth.slices": 4000}), bending="energy")
    tooth, beta = gear.tooth, gear.geometry.tooth_angle
    reach = tooth.height - tooth.force_depth
    half_at_force = 0.5 * tooth.root_width - reach * math.tan(beta)

    def density(z: float) -> float:
        moment = (reach - z) * math.cos(beta) - half_at_force * math.sin(beta)
        half = 0.5 * tooth.root_width - z * math.tan(beta)
        return moment**2 / (gear.material.youngs_modulus * tooth.width * (2.0 * half) ** 3 / 12.0)

    integral, _ = scipy.integrate.quad(density, 0.0, reach)
    assert tooth_compliance(gear).bending == pytest.approx(integral, rel=1e-6)


def test_twenty_slices_are_enough() -> None:
    fine = tooth_compliance(GEAR.with_values({"tooth.slices": 2000}))
    assert tooth_compliance(GEAR).total == pytest.approx(fine.total, rel=2e-4)


def test_root_flexibility_is_a_switch() -> None:
    soft = tooth_compliance(with_options(GEAR, root_flexibility=True))
    assert tooth_compliance(GEAR).root == 0.0
    assert soft.root > 0.0
    assert soft.total - soft.root == pytest.approx(tooth_compliance(GEAR).total)


def test_contact_laws() -> None:
    assert contact_compliance(GEAR, 20.0) == pytest.approx(2.66e-9, rel=5e-3)
    stiffer = [
        contact_compliance(with_options(GEAR, contact=law), 20.0)
        for law in ("lundberg", "yang-sun")
    ]
    assert stiffer[0] == pytest.approx(contact_compliance(GEAR, 20.0), rel=0.8)
    assert stiffer[1] == pytest.approx(4.0 * 0.91 / (math.pi * 206e9 * 0.01), rel=1e-12)
    assert contact_compliance(GEAR, 40.0) == pytest.approx(
        2.0**-0.1 * contact_compliance(GEAR, 20.0), rel=1e-12
    )
    with pytest.raises(ParameterError, match="pair_load"):
        contact_compliance(GEAR, 0.0)
    assert sum(pair_compliance(GEAR).shares().values()) == pytest.approx(1.0)


def test_cup_is_a_shaft_and_a_sheared_disc() -> None:
    cup = cup_stiffness(GEAR.cup, GEAR.material)
    assert cup.cylinder == pytest.approx(3.25e5, rel=2e-3)
    assert cup.bottom == pytest.approx(6.7e4, rel=2e-3)
    clamped = dataclasses.replace(GEAR.cup, bottom_hole_diameter=0.037)
    assert cup_stiffness(clamped, GEAR.material).bottom == pytest.approx(3.2e5, rel=2e-2)
    radii = (0.5 * GEAR.cup.bottom_hole_diameter, 0.5 * GEAR.cup.inner_diameter)
    factor = 2.0 * math.pi * GEAR.material.shear_modulus * GEAR.cup.bottom_thickness
    twist, _ = scipy.integrate.quad(lambda r: 1.0 / (factor * r**3), *radii)
    assert cup.bottom == pytest.approx(1.0 / twist, rel=1e-9)
    assert cup.total < min(cup.cylinder, cup.bottom)


@pytest.mark.parametrize("squared", [0.0, 1e-6, 0.3, 0.9, 0.999999])
def test_elliptic_integrals(squared: float) -> None:
    first, second = elliptic_integrals(squared)
    assert first == pytest.approx(scipy.special.ellipk(squared), rel=1e-14)
    assert second == pytest.approx(scipy.special.ellipe(squared), rel=1e-14)


def test_ellipse_ratio_solves_its_equation() -> None:
    for ring in ("inner", "outer"):
        contact = hertz_contact(GEAR.bearing, ring)
        squared = contact.ellipse_ratio**2
        first, second = (
            scipy.special.ellipk(1.0 - 1.0 / squared),
            scipy.special.ellipe(1.0 - 1.0 / squared),
        )
        gamma, f = (
            GEAR.bearing.ball_diameter / GEAR.bearing.pitch_diameter,
            GEAR.bearing.groove_ratio,
        )
        rolling = 2.0 * gamma / (1.0 - gamma) if ring == "inner" else -2.0 * gamma / (1.0 + gamma)
        difference = (1.0 / f + rolling) / (4.0 - 1.0 / f + rolling)
        assert ((squared + 1.0) * second - 2.0 * first) / (
            (squared - 1.0) * second
        ) == pytest.approx(difference, rel=1e-9)


def test_two_contacts_at_100_newton() -> None:
    approach = sum(
        hertz_contact(GEAR.bearing, ring).approach(100.0, GEAR.material)
        for ring in ("inner", "outer")
    )
    assert approach == pytest.approx(5.80e-6, abs=0.01e-6)
    palmgren = 4.36e-4 * 100.0 ** (2.0 / 3.0) / 4.7625 ** (1.0 / 3.0) * 1e-3
    assert approach == pytest.approx(palmgren, rel=0.05)


@pytest.mark.parametrize(
    ("load", "stiffness"),
    [(50.0, 6.2e7), (100.0, 7.8e7), (261.0, 1.08e8), (600.0, 1.42e8), (1250.0, 1.8e8)],
)
def test_bearing_stiffness_table(load: float, stiffness: float) -> None:
    found = bearing_stiffness(GEAR.bearing, GEAR.material, load)
    assert found.total == pytest.approx(stiffness, rel=1e-2)
    assert found.load_deflection == pytest.approx(7.15e9, rel=1e-3)
    slope = 1e-4 * load
    above, below = (
        bearing_stiffness(GEAR.bearing, GEAR.material, load + d).deflection for d in (slope, -slope)
    )
    assert found.total == pytest.approx(2.0 * slope / (above - below), rel=1e-6)


def test_bearing_load_at_the_first_breakpoint() -> None:
    assert bearing_load(GEAR, GEAR.ratings.torque_1) == pytest.approx(261.0, rel=2e-3)
    low, high = kraemer_damping(1.08e8)
    assert (low, high) == pytest.approx((270.0, 2700.0))
    with pytest.raises(ParameterError, match="radial_load"):
        bearing_stiffness(GEAR.bearing, GEAR.material, -1.0)


def test_ring_factor_softens_the_bearing() -> None:
    soft = GEAR.with_values({"bearing.ring_factor": 0.5})
    assert drive_stiffness(soft).bearing.total == pytest.approx(
        0.5 * drive_stiffness(GEAR).bearing.total
    )


def test_combined_stiffness_is_the_statics_of_equation_2() -> None:
    stiffness, radius = drive_stiffness(GEAR), GEAR.geometry.neutral_radius
    s, c = math.sin(GEAR.geometry.tooth_angle), math.cos(GEAR.geometry.tooth_angle)
    mesh, cup = stiffness.mesh, stiffness.cup.total / radius**2
    matrix = np.array(
        [
            [stiffness.bearing.total + mesh * s * s, -mesh * s * c, 0.0],
            [-mesh * s * c, mesh * c * c + cup, -cup],
            [0.0, -cup, cup],
        ]
    )
    deflection = np.linalg.solve(matrix, [0.0, 0.0, 1.0 / radius])[2] / radius
    assert stiffness.combined_output == pytest.approx(1.0 / deflection, rel=1e-11)
    assert stiffness.combined_input == pytest.approx(stiffness.combined_output / 120.0**2)
    assert sum(stiffness.shares().values()) == pytest.approx(1.0)
    assert stiffness.shares()["mesh"] < 0.02
    ratings = GEAR.ratings
    assert ratings.stiffness_1 < stiffness.combined_output < ratings.stiffness_3
