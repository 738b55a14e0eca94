"""Shared recordings: made once, read by many tests."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from experiments.contract import Evidence
from experiments.protocols.compensated_error import declaration as compensated_error_declaration
from experiments.protocols.compensated_error import plan as compensated_error_plan
from experiments.protocols.friction import declaration as friction_declaration
from experiments.protocols.friction import plan as friction_plan
from experiments.protocols.kinematic_error import declaration as kinematic_error_declaration
from experiments.protocols.kinematic_error import plan as kinematic_error_plan
from experiments.protocols.motor_tare import analysis as motor_tare
from experiments.protocols.motor_tare import declaration as motor_tare_declaration
from experiments.protocols.motor_tare import plan as motor_tare_plan
from experiments.protocols.torque_scale import declaration as torque_scale_declaration
from experiments.protocols.torque_scale import plan as torque_scale_plan
from experiments.recording import ArraySource, Recording
from experiments.result import Result
from model.compensation import table_of_set
from model.compensation_file import compensation_text
from model.gear import Harmonic, HarmonicDrive
from model.gear_file import shipped_gear
from model.units import ARCSEC
from tests.experiments.synthetic import Bench, record

SERIES = (
    Harmonic(1.0 / 120.0, 3.0 * ARCSEC, 1.0 * ARCSEC),
    Harmonic(1.0, 5.0 * ARCSEC, 2.0 * ARCSEC),
    Harmonic(2.0, 15.0 * ARCSEC, -6.0 * ARCSEC),
    Harmonic(2.0 * (1.0 + 1.0 / 120.0), 2.0 * ARCSEC, 1.0 * ARCSEC),
    Harmonic(4.0, 3.0 * ARCSEC, 0.0),
)


@pytest.fixture(scope="session")
def gear() -> HarmonicDrive:
    return shipped_gear()


@pytest.fixture(scope="session")
def bench(gear: HarmonicDrive) -> Bench:
    """A bench with kinematic error, cogging, and friction that varies with the angle, in phase with
    the error's order 2.
    """
    depth = (Harmonic(2.0, 3e-3, -1.2e-3),)
    return Bench(
        gear=gear,
        error=SERIES,
        depth=depth,
        cogging=(Harmonic(24.0, 2e-3, 0.0), Harmonic(2.0, 0.0, 1e-3)),
    )


@pytest.fixture(scope="session")
def kinematic_error_run(bench: Bench, gear: HarmonicDrive) -> Recording:
    return record(
        kinematic_error_plan.plan(kinematic_error_declaration.Parameters(speed_rpm=92.7), gear),
        bench,
        "kinematic-error",
    )


@pytest.fixture(scope="session")
def friction_parameters() -> friction_declaration.Parameters:
    return friction_declaration.Parameters(lowest_rpm=4.0, points=14)


@pytest.fixture(scope="session")
def friction_run(
    bench: Bench, gear: HarmonicDrive, friction_parameters: friction_declaration.Parameters
) -> Recording:
    return record(friction_plan.plan(friction_parameters, gear), bench, "friction")


@pytest.fixture(scope="session")
def tare_run(bench: Bench, gear: HarmonicDrive) -> Recording:
    parameters = motor_tare_declaration.Parameters(lowest_rpm=4.0, points=14)
    bare = dataclasses.replace(bench, mounted=False, seed=9)
    return record(
        motor_tare_plan.plan(parameters, gear), bare, "motor-tare", run_id="synthetic-tare"
    )


@pytest.fixture(scope="session")
def compensated_error_run(bench: Bench, gear: HarmonicDrive) -> Recording:
    """The whole orders of the bench's own error are taken out; its sidebands are left."""
    whole = tuple(h for h in SERIES if h.order == round(h.order))
    table = table_of_set(dataclasses.replace(gear, kinematic_error=whole), "circular-spline-fixed")
    parameters = compensated_error_declaration.Parameters(
        table=compensation_text(table), speeds_rpm=(130.0, 180.0, 240.0)
    )
    given = dataclasses.asdict(parameters)
    plan = compensated_error_plan.plan(parameters, gear)
    return record(plan, bench, "compensated-error", parameters=given)


@pytest.fixture(scope="session")
def torque_scale_run(bench: Bench, gear: HarmonicDrive) -> Recording:
    """A disc on the bare shaft: 1.05 of the torque that accelerates it is shown."""
    parameters = torque_scale_declaration.Parameters(inertia=2e-4, repeats=2, dwell_time=0.3)
    bare = dataclasses.replace(bench, mounted=False, seed=9)
    given = dataclasses.asdict(parameters)
    run = record(torque_scale_plan.plan(parameters, gear), bare, "torque-scale", parameters=given)
    assert isinstance(run.source, ArraySource)
    angle, time = run.si("input_angle"), run.time()
    speed = np.gradient(angle, time)
    smooth = np.convolve(speed, np.ones(9) / 9.0, "same")
    pushed = 1.05 * 2.26e-4 * np.gradient(smooth, time) / run.signals["torque"].scale
    arrays = {
        **run.source.arrays,
        "torque": run.source.arrays["torque"] + np.round(pushed).astype(int),
    }
    return dataclasses.replace(run, source=dataclasses.replace(run.source, arrays=arrays))


@pytest.fixture(scope="session")
def tare(tare_run: Recording, gear: HarmonicDrive) -> Result:
    return motor_tare.analyse(tare_run, Evidence(gear))
