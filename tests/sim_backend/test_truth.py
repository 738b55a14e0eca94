"""The truth that the simulated rig tells is what its counts show."""

from __future__ import annotations

import ast
import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from drivers import channel as names
from drivers.port import Command, Mode
from model.closed_loop import OFF, ClosedLoop, LoopSettings
from model.friction import friction_torque
from model.gear import HarmonicDrive
from model.kernels import loop_layout as at
from model.stiffness import drive_stiffness
from model.units import ARCSEC, RPM
from sim_backend.direct import SimulatedRig
from sim_backend.faults import OutputLoad
from sim_backend.imperfections import Imperfections
from sim_backend.individuals import individual_gear
from sim_backend.population import drawn
from sim_backend.world import World
from tests.sim_backend.rigs import GEAR, MOTOR, NO_GUARD, off, si, turn, with_only


def opened(on: Imperfections, seed: int = 5, **options: object) -> tuple[SimulatedRig, dict]:
    port = SimulatedRig(individual_gear(GEAR, seed), MOTOR, on, World.of(seed), **options)  # type: ignore[arg-type]
    truth = port.open().truth
    assert truth is not None
    return port, dict(truth)


def by_hand(own: dict, speed: float) -> float:
    """The friction torque at the input of a gear of size 25 with its output bearing, at the truth's reference."""
    decay = math.exp(-((speed / own["stribeck_velocity"]) ** own["shape"]))
    mesh = own["coulomb"] + (own["static"] - own["coulomb"]) * decay + own["viscous"] * speed
    beside = own["output_bearing_at_mesh"]
    mesh += beside["coulomb"] + beside["viscous"] * speed
    product = max(own["bearing_torque"]["viscosity"] * 1e6 * speed / RPM, 2000.0)
    factor = own["bearing_torque"]["friction_factor"]
    no_load = 0.1 * factor * product ** (2.0 / 3.0) * 53e-3**3
    return mesh * 31e-3 / (120.0 * 0.5) + no_load * (1.0 + 1.0 / 120.0)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_measurable_kinematic_error_is_found_in_the_counts(direction: float) -> None:
    port, truth = opened(Imperfections())
    turn(port, direction * 61.8, 3000)
    block = turn(port, direction * 61.8, 117_000)
    angle, output = si(port, block, names.INPUT_ANGLE), -si(port, block, names.OUTPUT_ANGLE)
    error = output - angle / 120.0
    wanted = truth["kinematic_error"]["measurable_recorded"]
    orders = [o["order"] for o in wanted]
    columns = [wave(o * angle) for o in orders for wave in (np.cos, np.sin)]
    design = np.column_stack([np.ones_like(angle), angle - angle[0], *columns])
    found = np.linalg.lstsq(design, error, rcond=None)[0]
    for k, order in enumerate(wanted):
        assert found[2 + 2 * k] == pytest.approx(order["cosine"], abs=0.05 * ARCSEC)
        assert found[3 + 2 * k] == pytest.approx(order["sine"], abs=0.05 * ARCSEC)
    assert abs(found[1]) < 1e-8


def test_a_mark_is_latched_where_the_truth_says_with_the_error_of_its_encoder() -> None:
    """Within a count: the output encoder counts down, so that it meets the far edge of its mark."""
    port, truth = opened(Imperfections(), seed=7)
    block = turn(port, 2900.0, 4000)
    encoders = truth["encoders"]
    assert encoders["output_sense"] == -1
    assert abs(encoders["input"]["index_error"]) > 2.0 * encoders["input"]["quantum"]
    for which, name, far in (
        ("input", names.INPUT_INDEX, 0.0),
        ("output", names.OUTPUT_INDEX, 1.0),
    ):
        own = encoders[which]
        latched = float(si(port, block, name)[-1])
        expected = own["index_angle"] + own["index_error"] + far * own["quantum"]
        away = math.remainder(latched - expected, 2.0 * math.pi)
        assert abs(away) <= 0.51 * own["quantum"]


def test_reference_mark_turns_the_recorded_frame_into_that_of_the_marks() -> None:
    _, truth = opened(Imperfections())
    error = truth["kinematic_error"]
    shift = error["reference_angle"]
    for at_mark, recorded in zip(error["measurable"], error["measurable_recorded"], strict=True):
        angle = recorded["order"] * shift
        cosine = recorded["cosine"] * np.cos(angle) + recorded["sine"] * np.sin(angle)
        assert at_mark["cosine"] == pytest.approx(cosine, abs=1e-12)
        assert at_mark["amplitude"] == pytest.approx(recorded["amplitude"])


@pytest.mark.parametrize("speed_rpm", [10.0, 300.0, 2000.0])
def test_mean_torque_is_the_truths_friction(speed_rpm: float) -> None:
    # What varies over a turn of the output would need one to be averaged out.
    on = Imperfections().without("warming", "eccentricity", "output_orders", "sidebands")
    port, truth = opened(on)
    zero = np.mean(si(port, off(port, 2000), names.TORQUE))
    means = []
    for sign in (1.0, -1.0):
        turn(port, sign * speed_rpm, 2000)
        revolutions = max(1, round(speed_rpm / 60.0 * 6.0))
        cycles = round(revolutions / speed_rpm * 60_000)
        means.append(
            sign * (np.mean(si(port, turn(port, sign * speed_rpm, cycles), names.TORQUE)) - zero)
        )
    gear = by_hand(truth["friction"], speed_rpm * RPM)
    motor = truth["motor"]["coulomb"] + truth["motor"]["viscous"] * speed_rpm * RPM
    expected = (gear + motor) * (1.0 + truth["torque_port"]["scale_error"])
    assert np.mean(means) == pytest.approx(expected, rel=4e-3)


def test_friction_parameters_are_those_of_the_gear() -> None:
    _, truth = opened(Imperfections.none())
    own, gear = truth["friction"], individual_gear(GEAR, 5)
    assert own["coulomb"] == gear.mesh_friction.coulomb
    assert own["output_bearing_at_mesh"] == {"coulomb": 0.0, "viscous": 0.0}
    for speed in (0.1, 3.0, 40.0, 300.0):
        assert by_hand(own, speed) == pytest.approx(float(friction_torque(gear, speed)))


def test_the_truth_of_a_wide_gear_is_what_was_drawn_and_no_more() -> None:
    """Made again from the draws, by formulas that stand here."""
    one = drawn(GEAR, MOTOR, World(gear_seed=21, bench_seed=4, population="wide"))
    stated, gear = one.sizes.stated, one.gear
    assert stated is not None
    assert stated.deviations.thermal is not None
    heat, mesh, ratio = stated.deviations.thermal, gear.mesh_friction, gear.ratio
    on = Imperfections(sizes=one.sizes).without("run_to_run_friction")
    truth = SimulatedRig(gear, one.motor, on, World(gear_seed=21, bench_seed=4)).truth
    own = truth["friction"]
    # Drawn at 20 degC, dry parts linear and viscous ones exponential in temperature.
    assert own["at_20_degrees"] == pytest.approx(
        {n: getattr(mesh, n) for n in own["at_20_degrees"]}
    )
    start = truth["friction"]["at_start"]
    warmer = start["temperature"] - 20.0
    assert start["temperature"] == heat.housing_start == heat.ambient
    assert abs(warmer) > 1.0
    assert start["static"] == pytest.approx(mesh.static * (1.0 - heat.coulomb_per_kelvin * warmer))
    assert start["viscous"] == pytest.approx(
        mesh.viscous * math.exp(-heat.viscous_per_kelvin * warmer)
    )
    # T = F r_g/(N sin 30) at the input, and T_b/N of the output bearing.
    lever = 31e-3 / (ratio * 0.5)
    at_mesh = stated.deviations.output_coulomb / ratio / lever
    assert own["output_bearing_at_mesh"]["coulomb"] == pytest.approx(at_mesh)
    gain, constant = stated.torque_port.gain_error, stated.deviations.torque_constant_error
    assert truth["torque_port"]["scale_error"] == pytest.approx((1 + gain) / (1 + constant) - 1)
    assert truth["torque_port"]["offset"] == stated.torque_port.offset
    # The gear's own orders and no others, by amplitude; the bench's beside them.
    amplitudes = [h.amplitude for h in gear.kinematic_error]
    added = (*stated.output_orders, *stated.sidebands)
    amplitudes += [math.hypot(b.cosine, b.sine) for b in added]
    error = truth["kinematic_error"]
    assert sorted(o["amplitude"] for o in error["orders"]) == pytest.approx(sorted(amplitudes))
    orders = {round(o["order"], 9) for o in error["measurable"]}
    assert {round(k / ratio, 9) for k in range(1, 65)} | {1.0, 2.0, 4.0} <= orders
    assert len(error["eccentricity"]) == 2


def spring(gear: HarmonicDrive, factor: float) -> float:
    """K_HDf of the nominal springs at this ratio, times their factor [N m/rad]."""
    return factor * drive_stiffness(gear).combined_output


def test_the_truth_of_the_steps_is_the_drawn_spring_and_hysteresis_at_a_quarter_of_t1() -> None:
    """Secant by integrating Dahl's equation over swings; mode by the one mass that the spring carries."""
    one = drawn(GEAR, MOTOR, World(gear_seed=33, bench_seed=4, population="wide"))
    assert one.sizes.stated is not None
    have = one.sizes.stated.deviations
    dynamics = SimulatedRig(
        one.gear, one.motor, Imperfections(sizes=one.sizes), World(gear_seed=33, bench_seed=4)
    ).truth["dynamics"]
    stiffness = spring(one.gear, 1.0)
    swing = dynamics["torsion_amplitude"]
    # Dahl 1968: dT = sigma (1 - T/T_h sgn dx) dx, swung until it repeats.
    sigma, torque, work = have.hysteresis_stiffness * stiffness, 0.0, 0.0
    steps = np.diff(swing * np.sin(np.linspace(0.0, 2.0 * np.pi, 2001)))
    for _ in range(60):
        work, largest = 0.0, 0.0
        for step in steps:
            before = torque
            torque += (
                sigma * (1.0 - torque / have.hysteresis_torque * math.copysign(1.0, step)) * step
            )
            work += 0.5 * (before + torque) * step
            largest = max(largest, torque)
    assert stiffness * swing + largest == pytest.approx(14.0 / 4.0, rel=1e-3)
    assert dynamics["torque_amplitude"] == 14.0 / 4.0
    secant = (14.0 / 4.0) / swing
    inertia = one.gear.inertia.output
    assert dynamics["stiffness_over_inertia"] == pytest.approx(secant / inertia, rel=1e-9)
    assert dynamics["resonance"] == pytest.approx(
        math.sqrt(secant / inertia) / (2.0 * math.pi), rel=5e-3
    )
    # What the swing loses, and the bearing's damper over the share of the spring's torque that it carries.
    lost = work / (2.0 * math.pi * secant * swing**2)
    omega = 2.0 * math.pi * dynamics["resonance"]
    lever = 31e-3 / math.tan(math.radians(30.0))
    own = drive_stiffness(one.gear).bearing.total * lever**2
    viscous = 43_000.0 * lever**2 * (stiffness / own) ** 2 * omega / (2.0 * secant)
    assert dynamics["damping_ratio"] == pytest.approx(lost + viscous, rel=0.03)
    assert dynamics["damping_ratio_with_output_bearing"] == dynamics["damping_ratio"]


def test_stiffness_over_inertia_is_the_ringing_of_the_output() -> None:
    """A load taken off the output: the rotor is held by friction, and the output rings at sqrt(K/J_o)."""
    on = with_only("hysteresis", "hardening")
    port, truth = opened(on, faults=[OutputLoad(100, 2.0, cycles=2900)])
    port.exchange(Command(Mode.SPEED, np.zeros(3000)), 3000, NO_GUARD)
    ringing = si(port, turn(port, 0.0, 300), names.OUTPUT_ANGLE)
    ringing = ringing - np.mean(ringing[-50:])
    spectrum = np.abs(np.fft.rfft(ringing * np.hanning(300), 1 << 16))
    frequency = np.argmax(spectrum) * 1000.0 / (1 << 16)
    assert frequency == pytest.approx(truth["dynamics"]["resonance"], rel=5e-3)


def test_switches_seeds_and_sizes_are_named() -> None:
    _, truth = opened(Imperfections().without("warming"))
    assert truth["imperfections"]["warming"] is False
    assert set(truth["imperfections"]) == set(Imperfections.names())
    assert truth["sizes"]["output_lines"] == 18000


@pytest.mark.parametrize("seed", [2, 3])
def test_the_truths_mode_is_what_the_plant_rings_with(seed: int) -> None:
    """The rotor held by a stiff brake, the output pushed: period and decay of the swing that is T1/4 high."""
    one = drawn(GEAR, MOTOR, World(gear_seed=seed, bench_seed=4, population="wide"))
    assert one.sizes.stated is not None
    gear = dataclasses.replace(one.gear, kinematic_error=())
    on = Imperfections(sizes=one.sizes).without("output_bearing_friction", "sidebands")
    world = World(gear_seed=seed, bench_seed=4)
    dynamics = SimulatedRig(gear, one.motor, on, world).truth["dynamics"]
    have = dataclasses.replace(one.sizes.stated.deviations, output_coulomb=0.0, cogging=())
    brake = dataclasses.replace(MOTOR, coulomb_friction=3.0)
    loop = ClosedLoop(gear, brake, have, LoopSettings(cycle=125e-6))
    state = loop.rest()
    push = 1.15 * dynamics["torsion_amplitude"] * 2.0 * math.pi * dynamics["resonance"]
    state[at.UO] = push * gear.geometry.neutral_radius
    rows = loop.advance(state, OFF, np.zeros(round(15.0 / dynamics["resonance"] / 125e-6)))
    speed, angle = rows[:, at.ROW_OUTPUT_SPEED], rows[:, at.ROW_OUTPUT_ANGLE]
    turns = np.flatnonzero(speed[:-1] * speed[1:] < 0.0)
    times = 125e-6 * (turns + speed[turns] / (speed[turns] - speed[turns + 1]))
    swings = 0.5 * np.abs(np.diff(angle[turns]))
    nearest = int(np.argmin(np.abs(swings / dynamics["torsion_amplitude"] - 1.0)))
    k = min(max(nearest, 2), 8)
    assert swings[k] == pytest.approx(dynamics["torsion_amplitude"], rel=0.1)
    period = (times[k + 3] - times[k - 1]) / 2.0
    assert 1.0 / period == pytest.approx(dynamics["resonance"], rel=2e-3)
    decay = math.log(swings[k - 2] / swings[k + 2]) / (4.0 * math.pi)
    assert decay == pytest.approx(dynamics["damping_ratio"], rel=0.05)


def test_no_code_of_an_analysis_makes_the_truth() -> None:
    """Whatever `sim_backend.truth` imports, by itself and through others, is no identification and no experiment."""
    root, seen = Path(__file__).parents[2], set()
    waiting = ["sim_backend.truth"]
    while waiting:
        name = waiting.pop()
        path = root / (name.replace(".", "/") + ".py")
        if name in seen or not path.exists():
            continue
        seen.add(name)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                waiting += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    assert "model.closed_loop" in seen
    assert not [name for name in seen if name.startswith(("model.identify", "experiments", "rig"))]
