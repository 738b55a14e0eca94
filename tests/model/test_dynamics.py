"""Equation 2 with a prescribed input, against the printed equations, conservation laws, limits and other solvers."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
import scipy
from numpy.typing import NDArray

from model import dynamics, propagator
from model.dynamics import derived_speed, simulate_batch, simulate_prescribed
from model.errors import ModelError, ParameterError
from model.friction import bearing_friction_torque, friction_torque, mesh_friction_force, mesh_lever
from model.gear import Harmonic, HarmonicDrive
from model.gear_file import shipped_gear
from model.kinematic_error import series_value
from model.linear import (
    DynamicParameters,
    damping_matrix,
    dynamic_parameters,
    mass_matrix,
    modes,
    stiffness_matrix,
)
from model.units import ARCMIN, ARCSEC, RPM
from tests.model.reduced_form import reduced_response

GEAR = shipped_gear()
FRICTIONLESS = GEAR.with_values(
    dict.fromkeys(
        (
            "mesh_friction.coulomb",
            "mesh_friction.static",
            "mesh_friction.viscous",
            "bearing.friction_factor",
        ),
        0.0,
    )
)
SMOOTH = dataclasses.replace(FRICTIONLESS, kinematic_error=())
Array = NDArray[np.float64]


def rise(
    speed: float, interval: float, duration: float, tau: float = 0.005, start: float = 0.0
) -> tuple[Array, Array]:
    """Angle and speed of a smooth start to `speed`, critically damped with time constant tau."""
    time = np.arange(round(duration / interval) + 1) * interval
    x = time / tau
    omega = speed * (1.0 - np.exp(-x) * (1.0 + x))
    return start + speed * (time - 2.0 * tau + np.exp(-x) * (2.0 * tau + time)), omega


def printed_equations(
    gear: HarmonicDrive, p: DynamicParameters, speed: float, times: Array, tau: float = 0.005
) -> Array:
    """theta_o and theta_o' by a general solver on equation 2 as it is printed, for the same smooth start."""
    s, c, t = math.sin(p.tooth_angle), math.cos(p.tooth_angle), math.tan(p.tooth_angle)
    radius, tangent = p.neutral_radius, 1.0 / (p.ratio * t)
    flexspline, load = p.flexspline_inertia / radius**2, p.output_inertia / radius**2

    mesh_law, ring_law = gear.mesh_friction, gear.bearing

    def right(time: float, state: Array) -> list[float]:
        x2, y1, y2, v2, w1, w2 = state.tolist()
        x = time / tau
        omega = speed * (1.0 - math.exp(-x) * (1.0 + x))
        theta = speed * (time - 2.0 * tau + math.exp(-x) * (2.0 * tau + time))
        error = rate = 0.0
        for h in gear.kinematic_error:
            error += h.cosine * math.cos(h.order * theta) + h.sine * math.sin(h.order * theta)
            rate += (
                h.order
                * (h.sine * math.cos(h.order * theta) - h.cosine * math.sin(h.order * theta))
                * omega
            )
        mesh = mesh_law.coulomb + mesh_law.viscous * omega
        mesh += (mesh_law.static - mesh_law.coulomb) * math.exp(
            -((omega / mesh_law.stribeck_velocity) ** mesh_law.shape)
        )
        product = max(2000.0, ring_law.viscosity * 1e6 * omega * 30.0 / math.pi)
        ring = (
            0.1
            * ring_law.friction_factor
            * product ** (2.0 / 3.0)
            * ring_law.pitch_diameter**3
            / radius
        )
        x1, v1 = theta * radius * tangent, omega * radius * tangent
        wedge = p.bearing_stiffness * (x1 - x2 + error * radius / t)
        wedge += p.bearing_damping * (v1 - v2 + rate * radius / t)
        flank = p.mesh_stiffness * (x2 * s - y1 * c)
        cup = (p.cup_stiffness * (y1 - y2) + p.structural_damping * (w1 - w2)) / radius**2
        a2 = (wedge - flank * s - mesh * c) / flexspline
        a1 = (flank * c - cup - ring - mesh * s) / flexspline
        return [v2, w1, w2, a2, a1, cup / load]

    e0 = float(series_value(gear.kinematic_error, 0.0)) * radius / t
    start = [e0, e0 * t, e0 * t, 0.0, 0.0, 0.0]
    solution = scipy.integrate.solve_ivp(
        right, (0.0, times[-1]), start, method="DOP853", t_eval=times, rtol=1e-9, atol=1e-13
    )
    assert solution.success
    return solution.y[[2, 5]] / radius


@pytest.mark.parametrize("structural", [0.0, 2.0])
def test_agrees_with_a_general_solver_on_the_printed_equations(structural: float) -> None:
    changes = {
        "bearing_damping": 1e3,
        "bearing_stiffness": 5e7,
        "mesh_stiffness": 5e8,
        "flexspline_inertia": 5e-5,
    }
    p = dynamic_parameters(GEAR, structural_damping=structural, **changes)
    interval, duration, speed = 1.0 / 8000.0, 0.03, 1000.0 * RPM
    angle, omega = rise(speed, interval, duration)
    times = np.arange(angle.size) * interval
    truth = printed_equations(GEAR, p, speed, times)
    found = simulate_prescribed(GEAR, angle, interval, input_speed=omega, parameters=p)
    assert np.max(np.abs(found.output_angle - truth[0])) < 0.1 * ARCSEC
    fine_angle, fine_speed = rise(speed, interval / 32, duration)
    fine = simulate_prescribed(
        GEAR, fine_angle, interval / 32, input_speed=fine_speed, parameters=p
    )
    assert np.max(np.abs(fine.output_angle[::32] - truth[0])) < 0.001 * ARCSEC
    assert np.max(np.abs(fine.output_speed[::32] - truth[1])) < 1e-4


@pytest.mark.parametrize("speed_rpm", [60.0, 1000.0, 3000.0])
def test_eight_kilohertz_is_within_a_tenth_of_an_arcsecond(speed_rpm: float) -> None:
    interval, finer = 1.0 / 8000.0, 64
    (angle, omega), (fine_angle, fine_speed) = (
        rise(speed_rpm * RPM, h, 0.3) for h in (interval, interval / finer)
    )
    coarse = simulate_prescribed(GEAR, angle, interval, input_speed=omega)
    fine = simulate_prescribed(GEAR, fine_angle, interval / finer, input_speed=fine_speed)
    assert coarse.substeps == 1
    assert np.max(np.abs(coarse.output_angle - fine.output_angle[::finer])) < 0.1 * ARCSEC


@pytest.mark.parametrize("speed_rpm", [300.0, 3000.0])
def test_measured_input_at_one_kilohertz_is_refined(speed_rpm: float) -> None:
    angle, omega = rise(speed_rpm * RPM, 1e-3, 0.3, tau=0.02)
    measured = simulate_prescribed(GEAR, angle, 1e-3, input_speed=omega)
    fine_angle, fine_speed = rise(speed_rpm * RPM, 1e-3 / 64, 0.3, tau=0.02)
    fine = simulate_prescribed(GEAR, fine_angle, 1e-3 / 64, input_speed=fine_speed)
    assert measured.substeps >= 4
    assert np.max(np.abs(measured.output_angle - fine.output_angle[::64])) < 0.1 * ARCSEC


def test_rigid_gear_follows_the_ratio() -> None:
    stiff = dynamic_parameters(
        SMOOTH, bearing_stiffness=1e12, mesh_stiffness=1e13, cup_stiffness=1e9, output_inertia=1e-4
    )
    angle, omega = rise(600.0 * RPM, 1e-4, 0.1, tau=0.01)
    found = simulate_prescribed(SMOOTH, angle, 1e-4, input_speed=omega, parameters=stiff)
    assert np.max(np.abs(found.output_angle - angle / 120.0)) < 1e-8


def test_kinematic_error_leads_the_output_when_turning_slowly() -> None:
    angle = np.linspace(0.0, 2.0 * math.pi, 20001)
    found = simulate_prescribed(FRICTIONLESS, angle, 1e-3, start="steady")
    error = series_value(GEAR.kinematic_error, angle)
    assert np.max(np.abs(found.output_angle - found.input_angle / 120.0 - error)) < 2e-4 * np.ptp(
        error
    )


def test_rest_is_free_of_transients() -> None:
    found = simulate_prescribed(GEAR, np.full(2000, 1.234), 1e-4)
    level = 1.234 / 120.0 + float(series_value(GEAR.kinematic_error, 1.234))
    assert np.max(np.abs(found.output_angle - level)) < 1e-14
    assert np.max(np.abs(found.wave_generator_torque)) < 1e-9


def test_load_winds_the_gear_up_by_its_stiffness() -> None:
    p = dynamic_parameters(SMOOTH)
    found = simulate_prescribed(SMOOTH, np.zeros(500), 1e-4, load_torque=10.0)
    assert found.output_angle == pytest.approx(-10.0 / p.combined_stiffness, rel=1e-9)
    assert found.torsion_torque == pytest.approx(10.0, rel=1e-8)
    assert found.wave_generator_torque == pytest.approx(10.0 / 120.0, rel=1e-8)
    stepped = np.where(np.arange(20000) < 10, 0.0, 10.0)
    settled = simulate_prescribed(SMOOTH, np.zeros(20000), 1e-4, load_torque=stepped)
    assert settled.output_angle[-1] == pytest.approx(-10.0 / p.combined_stiffness, rel=1e-6)


def test_mean_torque_is_the_friction_torque() -> None:
    gear = dataclasses.replace(GEAR, kinematic_error=())
    speed = 1000.0 * RPM
    found = simulate_prescribed(
        gear, speed * np.arange(8000) / 8000.0, 1.0 / 8000.0, start="steady"
    )
    torque = found.wave_generator_torque[-1000:].mean()
    assert torque == pytest.approx(float(friction_torque(gear, speed)), rel=1e-6)
    assert torque - float(bearing_friction_torque(gear, speed)) == pytest.approx(0.044573, abs=1e-6)
    assert torque - float(bearing_friction_torque(gear, speed)) == pytest.approx(
        float(bearing_friction_torque(gear, speed)) / gear.ratio
        + mesh_lever(gear, "energy") * float(mesh_friction_force(gear, speed)),
        rel=1e-6,
    )


def stored_energy(gear: HarmonicDrive, p: DynamicParameters, theta: float, state: Array) -> float:
    """Kinetic and elastic energy of equation 2 at q, q' and the wedge's place [J]."""
    q, v = state[:3], state[3:]
    wedge = p.radial_lever * (theta / p.ratio + float(series_value(gear.kinematic_error, theta)))
    s, c = math.sin(p.tooth_angle), math.cos(p.tooth_angle)
    elastic = (
        p.bearing_stiffness * (wedge - q[0]) ** 2 + p.mesh_stiffness * (q[0] * s - q[1] * c) ** 2
    )
    elastic += p.cup_stiffness / p.neutral_radius**2 * (q[1] - q[2]) ** 2
    return 0.5 * float(v @ mass_matrix(p) @ v + elastic)


def test_no_energy_is_created() -> None:
    """Without losses the work of T_wg, which needs de/d theta_i, is what the gear stores."""
    large = dataclasses.replace(
        FRICTIONLESS, kinematic_error=(Harmonic(2.0, 3.0 * ARCMIN, ARCMIN),)
    )
    p = dynamic_parameters(large, bearing_damping=0.0)
    interval = 1e-6
    angle, omega = rise(1500.0 * RPM, interval, 0.03)
    found = simulate_prescribed(large, angle, interval, input_speed=omega, parameters=p)
    work = scipy.integrate.simpson(found.wave_generator_torque * omega, dx=interval)
    stored = stored_energy(large, p, angle[-1], found.final_state)
    assert work == pytest.approx(stored, rel=1e-7)


def test_damping_only_takes_energy() -> None:
    p = dynamic_parameters(FRICTIONLESS, structural_damping=2.0)
    state = np.array([0.0, 1e-6, 1e-4, 0.0, 0.0, 0.0])
    energies = []
    for _ in range(50):
        energies.append(stored_energy(SMOOTH, p, 0.0, state))
        state = simulate_prescribed(
            SMOOTH, np.zeros(20), 1e-4, parameters=p, start=state
        ).final_state
    assert np.all(np.diff(energies) < 0.0)


def test_free_decay_has_the_frequency_and_damping_of_the_first_mode() -> None:
    p = dynamic_parameters(SMOOTH)
    first = modes(p)[0]
    shape = np.linalg.solve(stiffness_matrix(p), [0.0, 0.0, 1.0])
    start = np.concatenate([1e-4 * shape / shape[2], np.zeros(3)])
    interval = 1e-4
    found = simulate_prescribed(
        SMOOTH, np.zeros(3000), interval, parameters=p, start=start
    ).output_angle
    crossing = np.flatnonzero((found[:-1] < 0.0) & (found[1:] >= 0.0))
    exact = crossing + found[crossing] / (found[crossing] - found[crossing + 1])
    period = (exact[-1] - exact[0]) / (exact.size - 1) * interval
    assert 2.0 * math.pi / period == pytest.approx(first.damped_frequency, rel=1e-4)
    peaks = [found[a:b].max() for a, b in itertools.pairwise(crossing)]
    decay = math.log(peaks[0] / peaks[-1]) / (len(peaks) - 1) / period
    assert decay == pytest.approx(1.0 / first.time_constant, rel=1e-2)


@pytest.mark.parametrize("speed_rpm", [60.0, 3000.0])
def test_reduced_form_agrees(speed_rpm: float) -> None:
    p = dynamic_parameters(GEAR, bearing_damping=1e3)
    interval = 1.0 / 8000.0
    angle, omega = rise(speed_rpm * RPM, interval, 0.5, tau=0.02)
    full = simulate_prescribed(GEAR, angle, interval, input_speed=omega, parameters=p)
    output_angle, output_speed = reduced_response(GEAR, p, angle, omega, interval)
    assert np.max(np.abs(output_angle - full.output_angle)) < 2.5e-6
    assert np.max(np.abs(output_speed - full.output_speed)) < 2e-3


@pytest.mark.parametrize("damping", [0.0, 1e3, 4.3e4, 1e7])
def test_modal_and_dense_propagation_agree(damping: float, monkeypatch: pytest.MonkeyPatch) -> None:
    p = dynamic_parameters(GEAR, bearing_damping=damping)
    interval = 1e-4
    angle, omega = rise(1000.0 * RPM, interval, 0.1)
    modal = simulate_prescribed(
        GEAR, angle, interval, input_speed=omega, parameters=p, load_torque=1.0
    )
    assert not propagator.propagators([p], interval)[0][1].dense
    monkeypatch.setattr(propagator, "LARGEST_CONDITION", 0.0)
    propagator._remembered.cache_clear()
    dense = simulate_prescribed(
        GEAR, angle, interval, input_speed=omega, parameters=p, load_torque=1.0
    )
    assert propagator.propagators([p], interval)[0][1].dense
    propagator._remembered.cache_clear()
    for name in (
        "output_angle",
        "output_speed",
        "torsion_torque",
        "wave_generator_torque",
        "final_state",
    ):
        one, other = getattr(modal, name), getattr(dense, name)
        assert np.max(np.abs(one - other)) < 1e-8 * max(1.0, np.max(np.abs(one))), name


def critically_damped() -> DynamicParameters:
    """A set whose fast pair of poles has just met on the real axis, so that the eigenvectors nearly coincide."""
    p = dynamic_parameters(GEAR)
    low, high = 1e3, 4e4
    for _ in range(200):
        middle = 0.5 * (low + high)
        real = any(m.damped_frequency == 0.0 for m in modes(p.replaced(bearing_damping=middle)))
        low, high = (low, middle) if real else (middle, high)
    return p.replaced(bearing_damping=high)


def test_critical_damping_falls_back_to_the_dense_exponential() -> None:
    critical = critically_damped()
    interval = 1e-4
    angle, omega = rise(1000.0 * RPM, interval, 0.1)
    assert propagator.propagators([critical], interval)[0][1].dense
    found = simulate_prescribed(GEAR, angle, interval, input_speed=omega, parameters=critical)
    neighbours = [
        critical.replaced(bearing_damping=critical.bearing_damping * f) for f in (0.999, 1.001)
    ]
    batch = simulate_batch(
        GEAR, [neighbours[0], critical, neighbours[1]], angle, interval, input_speed=omega
    )
    assert np.array_equal(batch.output_angle[1], found.output_angle)
    between = 0.5 * (batch.output_angle[0] + batch.output_angle[2])
    assert np.max(np.abs(between - found.output_angle)) < 1e-9


def test_batch_is_the_single_simulation() -> None:
    p = dynamic_parameters(GEAR)
    sets = [
        p.replaced(cup_stiffness=f * p.cup_stiffness, output_inertia=g * 0.1, structural_damping=d)
        for f, g, d in [(1.0, 1.0, 0.0), (0.7, 2.0, 2.0), (1.3, 0.3, 5.0)]
    ]
    sets.append(p.replaced(bearing_damping=1e3))
    angle, omega = rise(600.0 * RPM, 1e-3, 0.2)
    batch = simulate_batch(GEAR, sets, angle, 1e-3, input_speed=omega, load_torque=0.5)
    assert batch.output_angle.shape == batch.output_speed.shape == (4, angle.size)
    for place, one in enumerate(sets):
        single = simulate_prescribed(
            GEAR, angle, 1e-3, input_speed=omega, parameters=one, load_torque=0.5
        )
        assert batch.output_angle[place] == pytest.approx(single.output_angle, abs=1e-14)
        assert batch.output_speed[place] == pytest.approx(single.output_speed, abs=1e-11)
        assert batch.substeps == single.substeps


@pytest.mark.parametrize("block", [1, 37, 1000])
def test_block_length_changes_nothing(block: int, monkeypatch: pytest.MonkeyPatch) -> None:
    angle, omega = rise(300.0 * RPM, 1e-3, 0.15)
    angle[60:90], omega[60:90] = angle[60], 0.0
    whole = simulate_prescribed(GEAR, angle, 1e-3, input_speed=omega, load_torque=np.sin(angle))
    monkeypatch.setattr(dynamics, "BLOCK", block)
    parts = simulate_prescribed(GEAR, angle, 1e-3, input_speed=omega, load_torque=np.sin(angle))
    assert np.array_equal(parts.output_angle, whole.output_angle)
    assert np.array_equal(parts.wave_generator_torque, whole.wave_generator_torque)
    assert np.array_equal(parts.final_state, whole.final_state)


def test_final_state_carries_on() -> None:
    angle, omega = rise(300.0 * RPM, 1e-4, 0.1)
    whole = simulate_prescribed(GEAR, angle, 1e-4, input_speed=omega)
    first = simulate_prescribed(GEAR, angle[:501], 1e-4, input_speed=omega[:501])
    rest = simulate_prescribed(
        GEAR, angle[500:], 1e-4, input_speed=omega[500:], start=first.final_state
    )
    assert rest.output_angle == pytest.approx(whole.output_angle[500:], abs=1e-12)


def test_friction_appears_at_once_when_motion_begins() -> None:
    """The jump of the friction at the onset is not smeared over the first interval: the interval does not matter."""
    gear = dataclasses.replace(GEAR, kinematic_error=())
    coarse, fine = (rise(60.0 * RPM, h, 0.05) for h in (5e-4, 5e-4 / 64))
    a = simulate_prescribed(gear, coarse[0], 5e-4, input_speed=coarse[1], substeps=1)
    b = simulate_prescribed(gear, fine[0], 5e-4 / 64, input_speed=fine[1], substeps=1)
    wind_up = np.max(np.abs(b.output_angle - b.input_angle / 120.0))
    assert np.max(np.abs(a.output_angle - b.output_angle[::64])) < 0.03 * wind_up
    assert wind_up > 2.0 * ARCSEC


def test_reversed_motion_is_the_mirror_image() -> None:
    gear = dataclasses.replace(GEAR, kinematic_error=())
    angle, omega = rise(300.0 * RPM, 1e-4, 0.1)
    forward = simulate_prescribed(gear, angle, 1e-4, input_speed=omega)
    reverse = simulate_prescribed(gear, -angle, 1e-4, input_speed=-omega)
    assert reverse.output_angle == pytest.approx(-forward.output_angle, abs=1e-15)
    assert reverse.wave_generator_torque == pytest.approx(-forward.wave_generator_torque, abs=1e-10)


def test_smoothed_sign_calms_a_trembling_speed() -> None:
    rng = np.random.default_rng(5)
    trembling = 1e-3 * rng.standard_normal(2000)
    at_rest = np.zeros(2000)
    rough = simulate_prescribed(SMOOTH_FRICTION, at_rest, 1e-3, input_speed=trembling, substeps=8)
    calm = simulate_prescribed(
        SMOOTH_FRICTION, at_rest, 1e-3, input_speed=trembling, substeps=8, smoothing_speed=0.5
    )
    assert np.std(calm.output_angle) < 0.05 * np.std(rough.output_angle)


SMOOTH_FRICTION = dataclasses.replace(GEAR, kinematic_error=())


def test_general_shape_and_single_branch_are_the_friction_law() -> None:
    options = dataclasses.replace(GEAR.options, low_speed_branch=False)
    gear = dataclasses.replace(
        GEAR.with_values({"mesh_friction.shape": 0.7}), options=options, kinematic_error=()
    )
    for speed in (0.3, 20.0, -200.0):
        found = simulate_prescribed(gear, speed * np.arange(4000) * 1e-4, 1e-4, start="steady")
        assert found.wave_generator_torque[-500:].mean() == pytest.approx(
            float(friction_torque(gear, speed)), rel=1e-5
        )


def test_order_meets_the_resonance() -> None:
    """A slow sweep is largest where twice the input speed is the first frequency."""
    p = dynamic_parameters(FRICTIONLESS)
    only_second = dataclasses.replace(FRICTIONLESS, kinematic_error=(Harmonic(2.0, 1e-5, 0.0),))
    first = modes(p)[0]
    speeds = np.linspace(0.9, 1.1, 21) * 0.5 * first.damped_frequency
    sizes = []
    for speed in speeds:
        angle = speed * np.arange(8000) / 8000.0
        found = simulate_prescribed(only_second, angle, 1.0 / 8000.0, start="steady")
        sizes.append(np.ptp((found.output_angle - found.input_angle / 120.0)[-2000:]))
    assert speeds[int(np.argmax(sizes))] == pytest.approx(0.5 * first.damped_frequency, rel=0.011)
    assert max(sizes) == pytest.approx(2e-5 / (2.0 * first.damping_ratio), rel=0.05)


def test_derived_speed_is_of_fourth_order() -> None:
    errors = []
    for interval in (1e-2, 5e-3):
        time = np.arange(0.0, 1.0, interval)
        errors.append(
            np.max(
                np.abs(derived_speed(np.sin(5.0 * time), interval) - 5.0 * np.cos(5.0 * time))[2:-2]
            )
        )
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.05)
    assert derived_speed(np.array([0.0, 2.0]), 0.5) == pytest.approx([4.0, 4.0])


def test_damping_matrix_couples_the_cup_only() -> None:
    matrix = damping_matrix(dynamic_parameters(GEAR, structural_damping=3.0))
    assert matrix @ np.array([0.0, 1.0, 1.0]) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"input_angle": [0.0]}, "input_angle"),
        ({"input_angle": np.zeros((2, 2))}, "input_angle"),
        ({"input_angle": [0.0, math.nan, 1.0]}, r"input_angle\[1\]"),
        ({"sample_interval": 0.0}, "sample_interval"),
        ({"sample_interval": math.inf}, "sample_interval"),
        ({"input_speed": np.zeros(5)}, "input_speed"),
        ({"load_torque": [0.0, math.inf, 0.0]}, r"load_torque\[1\]"),
        ({"start": "anyhow"}, "start"),
        ({"start": [1.0, 2.0]}, "start"),
        ({"substeps": 0}, "substeps"),
        ({"substeps": 1.5}, "substeps"),
    ],
)
def test_bad_input_is_refused(changes: dict[str, object], says: str) -> None:
    arguments: dict[str, object] = {"input_angle": np.zeros(3), "sample_interval": 1e-3} | changes
    with pytest.raises(ModelError, match=says):
        simulate_prescribed(GEAR, **arguments)  # type: ignore[arg-type]


def test_batches_share_one_ratio() -> None:
    p = dynamic_parameters(GEAR)
    with pytest.raises(ParameterError, match="mixes ratios"):
        simulate_batch(GEAR, [p, p.replaced(ratio=100.0)], np.zeros(4), 1e-3)
    with pytest.raises(ParameterError, match="at least one"):
        simulate_batch(GEAR, [], np.zeros(4), 1e-3)


def test_arrays_that_may_not_be_written_are_accepted() -> None:
    angle = np.linspace(0.0, 1.0, 50)
    angle.setflags(write=False)
    found = simulate_prescribed(GEAR, angle, 1e-3, load_torque=2)
    assert np.isfinite(found.output_angle).all()
    assert found.time[-1] == pytest.approx(0.049)
