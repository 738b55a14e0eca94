"""The truth that the simulated rig tells is what its counts show."""

from __future__ import annotations

import numpy as np
import pytest

from drivers import channel as names
from drivers.port import Command, Mode
from model.friction import friction_torque
from model.units import ARCSEC, RPM
from sim_backend.direct import SimulatedRig
from sim_backend.faults import OutputLoad
from sim_backend.imperfections import Imperfections, individual_gear
from sim_backend.world import World
from tests.sim_backend.rigs import GEAR, MOTOR, NO_GUARD, off, si, turn, with_only


def opened(on: Imperfections, seed: int = 5, **options: object) -> tuple[SimulatedRig, dict]:
    port = SimulatedRig(individual_gear(GEAR, seed), MOTOR, on, World.of(seed), **options)  # type: ignore[arg-type]
    truth = port.open().truth
    assert truth is not None
    return port, dict(truth)


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
    port, truth = opened(Imperfections().without("warming"))
    zero = np.mean(si(port, off(port, 2000), names.TORQUE))
    means = []
    for sign in (1.0, -1.0):
        turn(port, sign * speed_rpm, 2000)
        revolutions = max(1, round(speed_rpm / 60.0 * 6.0))
        cycles = round(revolutions / speed_rpm * 60_000)
        means.append(
            sign * (np.mean(si(port, turn(port, sign * speed_rpm, cycles), names.TORQUE)) - zero)
        )
    curve = truth["friction"]["torque_curve"]
    gear = np.interp(speed_rpm * RPM, curve["speed"], curve["measurable"])
    motor = truth["motor"]["coulomb"] + truth["motor"]["viscous"] * speed_rpm * RPM
    expected = (gear + motor) * (1.0 + truth["torque_port"]["scale_error"])
    assert np.mean(means) == pytest.approx(expected, rel=4e-3)


def test_friction_parameters_are_those_of_the_gear() -> None:
    _, truth = opened(Imperfections.none())
    friction, gear = truth["friction"], individual_gear(GEAR, 5)
    assert friction["coulomb"] == gear.mesh_friction.coulomb
    assert friction["measurable"]["coulomb"] == friction["coulomb"]
    own = friction_torque(gear, np.array(friction["torque_curve"]["speed"]))
    assert np.allclose(friction["torque_curve"]["gear"], own)


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
