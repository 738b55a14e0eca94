"""Ripples of torque and speed: what a sum over samples is short of, and how far a shaken gear twists."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from experiments.protocols.friction import vibration
from experiments.recording import ArraySource, Recording
from experiments.torque.running_torque import measured_holds
from experiments.torque.zero import torque_zero
from model.arrays import FloatArray
from model.gear import HarmonicDrive, Origin
from model.units import ARCSEC

SPEED, RATE = 70.0, 250.0
"""rad/s, Hz: the fifth order stands at 0.22 of the rate."""
ORDER, TWIST, BRAKING = 5, 2e-3, 0.02
"""A ripple of the input angle [rad], and the torque by which a speed loop opposes its speed [N m s/rad]."""
ROWS = 600


@pytest.fixture(params=[1.0, -1.0], ids=["forward", "reverse"])
def rippling(request: pytest.FixtureRequest, friction_run: Recording) -> Recording:
    """One hold whose speed ripples and whose torque brakes the ripple; 50 mN m of friction."""
    source, way = friction_run.source, float(request.param)
    assert isinstance(source, ArraySource)
    time = np.arange(ROWS) / RATE
    phase = ORDER * SPEED * time
    swing = TWIST * ORDER * SPEED * np.cos(phase)
    angle = way * (SPEED * time + TWIST * np.sin(phase))
    arrays = {name: values[:ROWS].copy() for name, values in source.arrays.items()}
    for name, values in (("input_angle", angle), ("torque", way * (0.05 - BRAKING * swing))):
        signal = friction_run.signals[name]
        arrays[name] = np.round((values - signal.offset) / signal.gain).astype(arrays[name].dtype)
    hold = dataclasses.replace(
        friction_run.labelled("hold")[0], index=0, start=0, stop=ROWS, direction=int(way)
    )
    metadata = dataclasses.replace(
        friction_run.metadata, sample_rate=RATE, gear_mounted=False, ratio=math.nan
    )
    return dataclasses.replace(
        friction_run,
        metadata=metadata,
        segments=(hold,),
        source=dataclasses.replace(source, arrays=arrays, times=(1e9 * time).astype(np.int64)),
    )


def test_what_samples_miss_of_a_rippling_torque_is_put_back(
    rippling: Recording, gear: HarmonicDrive
) -> None:
    holds, _ = measured_holds(rippling, rippling.segments, torque_zero(rippling))
    ripple = vibration.ripple_of(rippling, holds, gear, "torque")
    # Power that the loop takes from the ripple, over the mean speed.
    braked = 0.5 * BRAKING * (TWIST * ORDER * SPEED) ** 2 / SPEED
    angle = ORDER * SPEED / RATE
    share = math.sin(angle) / angle
    (hold,) = holds
    friction = hold.torque.direction * hold.torque.torque
    assert friction == pytest.approx(0.05 - share * braked, abs=1e-5)
    put_back = friction + ripple.between[0]
    assert put_back == pytest.approx(0.05 - braked, abs=1e-5)


def test_above_the_mode_the_torsion_is_the_error_and_below_what_the_motion_asks_for() -> None:
    error = np.full(5, 10.0 * ARCSEC)
    ratio = np.array([0.3, 0.8, 1.5, 4.0, 20.0])
    motion = error / np.abs(1.0 - ratio**2)
    exact = error * ratio**2 / np.abs(1.0 - ratio**2)

    def torsion(mode: float, seen: FloatArray = motion) -> tuple[FloatArray, FloatArray]:
        low, high = vibration._torsion(ratio / mode, seen, error)
        return low, high

    for found in torsion(1.0):
        np.testing.assert_allclose(found, exact)
    # A mode that is a fifth off matters below it alone.
    for found in torsion(1.2):
        np.testing.assert_allclose(found[3:], exact[3:], rtol=0.1)
    # A motion that sampling hides lies between what the softest and the stiffest gear make of it.
    low, high = torsion(1.1, np.full(5, math.nan))
    assert (low <= exact * 1.001).all()
    assert (high >= exact * 0.999).all()
    # Far above the mode it is known all the same.
    assert high[4] / low[4] < 1.01
    # Far below it follows the stiffness: m/(1 - m) of the error, m the square of the ratio over the stiffness.
    soft, stiff = ((ratio[0] / 1.1) ** 2 / (1.0 + way * vibration.STIFFNESS) for way in (-1.0, 1.0))
    assert (low[0], high[0]) == pytest.approx(
        (error[0] * stiff / (1.0 - stiff), error[0] * soft / (1.0 - soft))
    )


def test_what_sampling_hides_is_no_more_than_its_alias_shows() -> None:
    error, ratio = np.full(5, 10.0 * ARCSEC), np.full(5, 0.9)
    turns = np.array([0.3, 0.7, 0.49, 1.02, 1.3])
    quiet = np.full(5, 1.0 * ARCSEC)
    low, high = vibration._sampled(turns, ratio, quiet, error)
    seen = 0.81 * quiet
    np.testing.assert_allclose(low[0], seen[0])
    np.testing.assert_allclose(high[0], seen[0])
    np.testing.assert_allclose(high[[1, 4]], 2.0 * seen[[1, 4]])
    # An alias that alternates or stands still shows nothing: the stiffness alone bounds the motion, near resonance.
    assert (high[[2, 3]] > 5.0 * error[[2, 3]]).all()
    assert (low <= high).all()
    # A loud alias bounds nothing beyond what the stiffness does.
    _, loud = vibration._sampled(turns, ratio, np.full(5, 1e3 * ARCSEC), error)
    np.testing.assert_allclose(loud[1:], high[2])


def test_without_a_slow_hold_the_cards_accuracy_bounds_the_error(
    rippling: Recording, gear: HarmonicDrive
) -> None:
    amplitudes = vibration._at_rest(rippling, [], 100.0, gear)
    # As peak-to-peak of all orders together no more than the catalogue says.
    assert float(amplitudes.min()) > 0.0
    assert 2.0 * float(amplitudes.sum()) == pytest.approx(gear.ratings.transmission_accuracy)


def test_the_loss_of_a_gear_whose_load_nobody_stated_may_be_none(
    rippling: Recording, gear: HarmonicDrive
) -> None:
    def ripple(origin: str, whose: HarmonicDrive) -> vibration.Ripple:
        metadata = dataclasses.replace(
            rippling.metadata, origin=origin, gear_mounted=True, process={}
        )
        run = dataclasses.replace(rippling, metadata=metadata)
        holds, _ = measured_holds(run, run.segments, torque_zero(run))
        return vibration.ripple_of(run, holds, whose, "torque")

    unstated, simulated = ripple("hardware", gear), ripple("simulated", gear)
    assert unstated.loss[0] > 0.0
    assert unstated.unseen[0] == pytest.approx(unstated.loss[0])
    # By its own mode nothing shakes this output.
    assert simulated.loss[0] == 0.0
    own = gear.with_values({"inertia.output": gear.inertia.output}, Origin("measured", "its card"))
    stated = ripple("hardware", own)
    assert (stated.loss[0], stated.unseen[0]) == (simulated.loss[0], simulated.unseen[0])
