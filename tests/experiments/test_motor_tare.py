"""The torque of a bare motor whose cogging shakes its speed, behind a port that is late; and what it is at 20 °C."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from experiments.contract import Evidence
from experiments.protocols.motor_tare import analysis as motor_tare
from experiments.recording import ArraySource, Recording
from model.gear import HarmonicDrive
from model.identify.estimate import NORMAL_COVERAGE_FACTOR
from model.units import RPM
from tests.experiments.test_starting_torque import warm

SLOTS, COGGING, RIPPLE = 24, 2e-2, 0.2
"""Order and amplitude [N m] of the cogging, and by how much the servo lets it shake the speed [rad/s]."""
SLOW, FAST = 20.0 * RPM, 200.0 * RPM
LAG = 1e-3


def shaken(run: Recording, lag: float) -> Recording:
    """The slower holds of a tare with cogging in speed and torque, the torque shown `lag` [s] late, which is stated."""
    assert isinstance(run.source, ArraySource)
    arrays = {name: values.copy() for name, values in run.source.arrays.items()}
    angle, torque = run.signals["input_angle"], run.signals["torque"]
    for hold in run.labelled("hold"):
        speed = abs(hold.setpoint)
        if not SLOW < speed < FAST:
            continue
        rows = slice(hold.start, hold.stop)
        place = hold.direction * run.si("input_angle", rows)
        phase, late = SLOTS * place, SLOTS * (place - speed * lag)
        # A quarter turn apart: at the same instant they have no mean power.
        twist = RIPPLE / (SLOTS * speed) * np.sin(phase)
        shown = -COGGING * np.sin(late)
        for name, signal, more in (
            ("input_angle", angle, hold.direction * twist),
            ("torque", torque, hold.direction * shown),
        ):
            counts = arrays[name][rows] + np.round(more / signal.scale)
            arrays[name][rows] = counts.astype(arrays[name].dtype)
    known = dataclasses.replace(torque.calibration, lag=lag, lag_uncertainty=1e-5)
    return dataclasses.replace(
        run,
        signals={**run.signals, "torque": dataclasses.replace(torque, calibration=known)},
        source=dataclasses.replace(run.source, arrays=arrays),
    )


def test_a_late_port_makes_no_friction_of_the_cogging(
    tare_run: Recording, gear: HarmonicDrive
) -> None:
    coulomb = [
        motor_tare.analyse(shaken(tare_run, lag), Evidence(gear)).estimates["motor_coulomb"].value
        for lag in (0.0, LAG)
    ]
    assert coulomb[1] == pytest.approx(coulomb[0], abs=2e-6)


def test_a_lag_that_nobody_measured_is_in_the_interval(
    tare_run: Recording, gear: HarmonicDrive
) -> None:
    unsaid = shaken(tare_run, LAG)
    torque = unsaid.signals["torque"]
    assumed = dataclasses.replace(torque.calibration, lag=None, lag_uncertainty=None)
    unsaid = dataclasses.replace(
        unsaid,
        signals={**unsaid.signals, "torque": dataclasses.replace(torque, calibration=assumed)},
    )
    stated, unstated = (
        motor_tare.analyse(run, Evidence(gear)).estimates["motor_coulomb"]
        for run in (shaken(tare_run, LAG), unsaid)
    )
    assert unstated.high - unstated.low > 1.02 * (stated.high - stated.low)


def test_what_brings_a_tare_to_20_degrees_is_in_its_interval(
    tare_run: Recording, gear: HarmonicDrive
) -> None:
    tare = motor_tare.analyse(warm(tare_run, 30.0), Evidence(gear))
    own, cold = (tare.estimates[f"motor_coulomb{end}"] for end in ("", "_at_20_degrees"))
    (line,) = (one for one in cold.budget if one.source == "temperature of the motor")
    brought = cold.value / own.value * 0.5 * (own.high - own.low)
    converted = NORMAL_COVERAGE_FACTOR * line.standard_uncertainty
    assert converted > 0.0
    assert 0.5 * (cold.high - cold.low) == pytest.approx(math.hypot(brought, converted))
