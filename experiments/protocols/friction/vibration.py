"""Power that a vibrating output takes from the motor and that is no friction of the gear.

Orders of the kinematic error shake the output; near the first torsional mode the motion is many times the error. The
relative motion across the gear is x = r^2 y, r = n w/w_1, with the output's own motion y, which the output encoder
shows in the very hold whose torque is averaged. With the damping D of the gear it takes, at the input,

    T = sum over n of (D/2) (n w)^2 |x_n|^2/w + n E(x_n)/(2 pi)        D = C_b (r_g/tan(alpha_t) K/K_b')^2 + C_t

D is what the parameter set's dampers are at the output (K_b' is the bearing's stiffness there), E what hysteresis takes
per cycle: 4 T_h x where it slides, as x^3 before (Dahl), T_h = K/2 times the hysteresis loss of the ratings. Orders and
their sidebands n +- k/N beat over the output turn, so that y is taken from short blocks and squares are averaged.
Damping is known within a factor of about three, w_1 (in the fourth power) by the card's stiffness and inertia.
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
from model.stiffness import drive_stiffness
from model.units import ARCMIN, REVOLUTION

ORDERS = (1, 2, 3, 4, 5, 6)
SLIDING = 3.0 * ARCMIN
"""Torsion over which hysteresis begins to slide, assumed."""
SLOW = 0.1
"""Share of the first mode below which the highest order shakes nothing worth a look."""
ROWS = 20_000
"""Rows of a hold that are looked at, its last ones."""
TREND = 2
"""Degree of the polynomial over time that stands for the turning of the output and its own slow orders in a block."""
SEEN = 4.0
"""Mean square of an order over that of the noise from which on it is a motion."""
BLOCK_ROWS, BLOCK_REVOLUTIONS = 80, 5.0
"""A block has at least so many rows and covers at least so many input revolutions."""


def vibration_loss(recording: Recording, holds: list[Hold], gear: HarmonicDrive) -> FloatArray:
    """Input torque [N m] that the shaken output takes in each hold, by the card."""
    loss = np.zeros(len(holds))
    if not recording.has("output_angle") or not recording.metadata.gear_mounted:
        return loss
    mode, damping = math.sqrt(math.prod(first_resonances(gear))), _damping(gear)
    for k, hold in enumerate(holds):
        speed = abs(hold.torque.speed)
        if ORDERS[-1] * speed < SLOW * mode:
            continue
        for n, square in zip(ORDERS, _motion(recording, hold), strict=True):
            relative = (n * speed / mode) ** 2 * math.sqrt(square)
            loss[k] += 0.5 * damping * (n * relative) ** 2 * speed
            loss[k] += n * _hysteresis_loss(gear, relative) / REVOLUTION
    return loss


def _hysteresis_loss(gear: HarmonicDrive, motion: float) -> float:
    """What hysteresis takes in one cycle of this amplitude of torsion [rad] [J]."""
    limit = 0.5 * drive_stiffness(gear).combined_output * gear.ratings.hysteresis_loss
    share = (motion / SLIDING) ** 2
    return 4.0 * limit * motion * share / (3.0 + share)


def _damping(gear: HarmonicDrive) -> float:
    """The damping across the gear, at the output [N m s/rad]."""
    stiffness = drive_stiffness(gear)
    lever = gear.geometry.neutral_radius / math.tan(gear.geometry.tooth_angle)
    share = stiffness.combined_output / stiffness.bearing_at_output
    return gear.bearing.damping * (lever * share) ** 2 + gear.damping.structural


def _motion(recording: Recording, hold: Hold) -> FloatArray:
    """Mean squares of the amplitudes [rad2] of the orders of the output's motion in a hold, noise taken out."""
    rows = slice(max(hold.segment.start, hold.segment.stop - ROWS), hold.segment.stop)
    good = usable(recording, rows)
    angle = recording.si("input_angle", rows)[good]
    output = recording.output_angle(rows)[good]
    turns = abs(angle[-1] - angle[0]) / REVOLUTION if len(angle) else 0.0
    size = max(BLOCK_ROWS, math.ceil(BLOCK_REVOLUTIONS * len(angle) / max(turns, 1e-9)))
    blocks = len(angle) // size
    if blocks == 0:
        return np.zeros(len(ORDERS))
    shape = (blocks, size)
    turned = angle[: blocks * size].reshape(shape)
    moved = output[: blocks * size].reshape(shape)
    moved = moved - moved.mean(axis=1, keepdims=True)
    place = np.broadcast_to(np.linspace(-1.0, 1.0, size), shape)
    waves = [f(n * turned) for n in ORDERS for f in (np.cos, np.sin)]
    design = np.stack([*(place**k for k in range(TREND + 1)), *waves], axis=2)
    # Normal equations: columns are of unit size, and what aliases away is cut off.
    normal, right = design.mT @ design, design.mT @ moved[:, :, None]
    solution = np.linalg.pinv(normal, rcond=1e-6, hermitian=True) @ right
    residual = moved - (design @ solution)[:, :, 0]
    noise = 4.0 * float(np.mean(residual**2)) / size
    squares = np.sum(solution[:, TREND + 1 :, 0].reshape(blocks, -1, 2) ** 2, axis=2)
    mean = squares.mean(axis=0)
    return np.where(mean > SEEN * noise, mean - noise, 0.0)
