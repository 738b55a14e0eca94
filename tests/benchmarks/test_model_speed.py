"""How fast the model turns, as a multiple of real time and of general solvers in the same run; one core."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from model import closed_loop
from model.closed_loop import ClosedLoop, LoopSettings
from model.dynamics import dynamic_parameters, simulate_batch, simulate_prescribed
from model.gear import HarmonicDrive
from model.gear_file import shipped_gear
from model.motor import ServoMotor, shipped_motor
from model.units import ARCSEC, RPM
from tests.benchmarks.conftest import Note
from tests.benchmarks.peers import PeerParameters, cvode_closed_loop, solve_ivp_closed_loop

RATE = 8000.0
TARGET = 1000.0 * RPM


@pytest.fixture(scope="module")
def gear() -> HarmonicDrive:
    return shipped_gear()


@pytest.fixture(scope="module")
def motor() -> ServoMotor:
    return shipped_motor()


def step_angle(duration: float, rate: float, time_constant: float = 5e-3) -> np.ndarray:
    """Input angle of a smooth step to 1000 r/min."""
    t = np.arange(0.0, duration, 1.0 / rate)
    return TARGET * (t - time_constant * (1.0 - np.exp(-t / time_constant)))


def best(benchmark: Any) -> float:
    """Shortest run [s]: on a shared machine the least disturbed one."""
    return float(benchmark.stats.stats.min)


def peer_parameters(gear: HarmonicDrive, motor: ServoMotor) -> PeerParameters:
    p = dynamic_parameters(gear)
    rotor = motor.rotor_inertia + gear.inertia.wave_generator
    gain = (rotor + gear.inertia.output / gear.ratio**2) * 2.0 * math.pi * 40.0
    return PeerParameters(
        tooth_angle=p.tooth_angle,
        neutral_radius=p.neutral_radius,
        ratio=gear.ratio,
        mesh_stiffness=p.mesh_stiffness,
        bearing_stiffness=p.bearing_stiffness,
        bearing_damping=p.bearing_damping,
        cup_stiffness=p.cup_stiffness,
        cup_damping=p.structural_damping,
        flexspline_inertia=gear.inertia.flexspline,
        output_inertia=p.output_inertia,
        rotor_inertia=rotor,
        coulomb=0.07,
        viscous=1e-4,
        error_amplitude=0.3 / 60.0 * math.pi / 180.0 * p.neutral_radius / math.tan(p.tooth_angle),
        proportional=gain,
        integral_time=0.02,
        torque_limit=motor.peak_torque,
    )


def test_closed_loop(benchmark: Any, gear: HarmonicDrive, motor: ServoMotor, note: Note) -> None:
    loop = ClosedLoop(gear, motor, settings=LoopSettings(cycle=1.0 / RATE, step=1.0 / RATE))
    seconds = 2.0
    targets = np.full(int(seconds * RATE), TARGET)
    rows = np.empty((len(targets), closed_loop.at.ROW_SIZE))
    loop.advance(loop.rest(), closed_loop.SPEED, targets[:10])
    benchmark.pedantic(
        lambda: loop.advance(loop.rest(), closed_loop.SPEED, targets, rows),
        rounds=30,
        warmup_rounds=2,
    )
    ours = seconds / best(benchmark)
    note("closed loop at 8 kHz, all channels kept", ours, "x real time", ">= 2000")

    import time

    peer = peer_parameters(gear, motor)
    for name, solve, span, aim in (
        ("CVODE", cvode_closed_loop, 0.1, ">= 3000"),
        ("solve_ivp Radau", solve_ivp_closed_loop, 0.05, ""),
    ):
        solve(peer, TARGET, 1e-3, 1e-3)
        times = []
        for _ in range(3):
            start = time.perf_counter()
            solve(peer, TARGET, span, 1.0 / RATE)
            times.append(time.perf_counter() - start)
        theirs = span / min(times)
        note(f"closed loop against {name} ({theirs:.3g} x real time)", ours / theirs, "x", aim)
    assert np.isfinite(rows).all()


def test_prescribed_input(benchmark: Any, gear: HarmonicDrive, note: Note) -> None:
    seconds = 2.0
    angle = step_angle(seconds, RATE)
    found = benchmark.pedantic(
        lambda: simulate_prescribed(gear, angle, 1.0 / RATE), rounds=20, warmup_rounds=2
    )
    note("prescribed input at 8 kHz", seconds / best(benchmark), "x real time", ">= 1200")
    fine = simulate_prescribed(gear, step_angle(seconds, 16 * RATE), 1.0 / (16 * RATE))
    error = float(np.max(np.abs(found.output_angle - fine.output_angle[::16]))) / ARCSEC
    note(
        "its largest error of the output angle against a 16 times finer input",
        error,
        "arcsec",
        "< 0.1",
    )
    assert error < 0.1


def test_batch(benchmark: Any, gear: HarmonicDrive, note: Note) -> None:
    sets = [dynamic_parameters(gear, cup_stiffness=k) for k in np.linspace(4e4, 7e4, 64)]
    angle = step_angle(1.0, RATE)
    benchmark.pedantic(
        lambda: simulate_batch(gear, sets, angle, 1.0 / RATE), rounds=20, warmup_rounds=2
    )
    note(
        "batch of 64 parameter sets at 8 kHz",
        len(sets) / best(benchmark),
        "rig-seconds/s",
        ">= 5000",
    )
    assert benchmark.stats is not None
