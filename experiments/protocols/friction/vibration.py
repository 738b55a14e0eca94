"""Power that a vibrating output takes from the motor and that is no friction of the gear.

Orders of the kinematic error shake the output; near the first torsional mode the motion is many times the error. The
relative motion across the gear is x = r^2 y, r = n w/w_1, with the output's own motion y, which the output encoder
shows in the very hold whose torque is averaged. With the damping D = 2 zeta w_1 J_o it takes, at the input,

    T = sum over n of (D/2) (n w)^2 |x_n|^2/w

Only the factor is uncertain: damping within a factor of about three, w_1 (in the fourth power) by the card's stiffness
and inertia. It is one factor for all holds of a run, so the fit learns it where holds differ.
"""

from __future__ import annotations

import math

import numpy as np

from experiments.evidence import usable
from experiments.planning.speeds import first_resonances
from experiments.recording import Recording
from experiments.torque.running_torque import Hold
from model.arrays import FloatArray
from model.gear import HarmonicDrive

ORDERS = (1, 2, 3, 4, 5, 6)
DAMPING = 0.02
"""Damping ratio of the first mode that the loss is estimated with."""
SLOW = 0.1
"""Share of the first mode below which the highest order shakes nothing worth a look."""
ROWS = 5_000
"""Rows of a hold that are looked at, its last ones."""
TREND = 3
"""Degree of the polynomial over time that stands for the turning of the output and its own slow orders."""


def vibration_loss(recording: Recording, holds: list[Hold], gear: HarmonicDrive) -> FloatArray:
    """Input torque [N m] that the shaken output takes in each hold, at the card's first mode and `DAMPING`."""
    loss = np.zeros(len(holds))
    if not recording.has("output_angle") or not recording.metadata.gear_mounted:
        return loss
    mode = math.sqrt(math.prod(first_resonances(gear)))
    for k, hold in enumerate(holds):
        speed = abs(hold.torque.speed)
        if ORDERS[-1] * speed < SLOW * mode:
            continue
        motion = _motion(recording, hold)
        for n, y in zip(ORDERS, motion, strict=True):
            relative = (n * speed / mode) ** 2 * y
            loss[k] += DAMPING * mode * gear.inertia.output * (n * relative) ** 2 * speed
    return loss


def _motion(recording: Recording, hold: Hold) -> FloatArray:
    """Amplitudes [rad] of the orders of the output's motion in a hold, noise taken out."""
    rows = slice(max(hold.segment.start, hold.segment.stop - ROWS), hold.segment.stop)
    good = usable(recording, rows)
    time = recording.time(rows)[good]
    angle = recording.si("input_angle", rows)[good]
    output = recording.output_angle(rows)[good]
    if len(time) < 4 * (2 * len(ORDERS) + TREND + 1):
        return np.zeros(len(ORDERS))
    place = np.linspace(-1.0, 1.0, len(time)) if time[-1] <= time[0] else time - time.mean()
    place = place / max(float(np.abs(place).max()), 1e-12)
    waves = [f(n * angle) for n in ORDERS for f in (np.cos, np.sin)]
    design = np.column_stack([place**k for k in range(TREND + 1)] + waves)
    moved = output - output.mean()
    # Normal equations: columns are of unit size, and what aliases away is cut off.
    solution = np.linalg.lstsq(design.T @ design, design.T @ moved, rcond=1e-6)[0]
    residual = moved - design @ solution
    noise = 4.0 * float(residual @ residual) / len(residual) ** 2
    pairs = solution[TREND + 1 :].reshape(-1, 2)
    return np.sqrt(np.maximum(np.sum(pairs**2, axis=1) - noise, 0.0))
