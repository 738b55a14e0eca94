"""Power that a vibrating output takes from the motor and that is no friction of the gear.

Orders of the kinematic error shake the output; near the first torsional mode the motion is many times the error. The
relative motion across the gear is x = r^2 y, r = n w/w_1, with the output's own motion y, which the output encoder
shows in the very hold whose torque is averaged. With the damping D of the gear it takes, at the input,

    T = sum over n of (D/2) (n w)^2 |x_n|^2/w + n E(x_n)/(2 pi)        D = C_b (r_g/tan(alpha_t) K/K_b')^2 + C_t

D is what the parameter set's dampers are at the output (K_b' is the bearing's stiffness there), E what hysteresis takes
per cycle: 4 T_h x where it slides, as x^3 before (Dahl), T_h = K/2 times the hysteresis loss of the ratings. Orders and
their sidebands n +- k/N beat over the output turn, so that y is taken from short blocks and squares are averaged.
Damping is known within a factor of about three, w_1 (in the fourth power) by the card's stiffness and inertia.

The input ripples too, and the port lags behind the torque by an unknown part of `LAG`: the mean over angle holds the
product of both ripples, half the sum of Re(T_n conj(w_n)/w), whose phase the lag has turned.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from experiments.evidence import usable
from experiments.planning.speeds import first_resonances
from experiments.recording import Recording
from experiments.torque.running_torque import Hold
from model.arrays import ComplexArray, FloatArray
from model.gear import HarmonicDrive
from model.stiffness import drive_stiffness
from model.units import ARCMIN, REVOLUTION

ORDERS = (1, 2, 3, 4, 5, 6)
SLIDING = 3.0 * ARCMIN
"""Torsion over which hysteresis begins to slide, assumed."""
SLOW = 0.1
"""Share of the first mode below which the highest order shakes nothing worth a look."""
LAG = 1e-3
"""s by which a torque port lags, assumed; 0 to twice as much."""
TURNED = 0.02
"""Radians by which the lag must turn the highest order to be looked at."""
ROWS = 20_000
"""Rows of a hold that are looked at, its last ones."""
TREND = 2
"""Degree of the polynomial over time that stands for the turning of the output and its own slow orders in a block."""
SEEN = 4.0
"""Mean square of an order over that of the noise from which on it is a motion."""
BLOCK_ROWS, BLOCK_REVOLUTIONS = 80, 5.0
"""A block has at least so many rows and covers at least so many input revolutions."""


@dataclass(frozen=True, kw_only=True)
class Ripple:
    """What ripples do to the torque of each hold (n,) [N m]: `loss`, input torque that the shaken output takes by the
    card; `lag`, what the mean torque would change if the port's lag of `LAG` were taken out.
    """

    loss: FloatArray
    lag: FloatArray


def ripple_of(recording: Recording, holds: list[Hold], gear: HarmonicDrive, channel: str) -> Ripple:
    """The ripples of all holds at constant speed."""
    ripple = Ripple(loss=np.zeros(len(holds)), lag=np.zeros(len(holds)))
    mode, damping = math.sqrt(math.prod(first_resonances(gear))), _damping(gear)
    for k, hold in enumerate(holds):
        speed = abs(hold.torque.speed)
        names = ["input_angle", channel]
        if _is_shaken(recording) and ORDERS[-1] * speed > SLOW * mode:
            names.append("output_angle")
        if ORDERS[-1] * speed * LAG < TURNED:
            continue
        waves = _waves(recording, hold, names)
        if waves is None:
            continue
        orders = np.array(ORDERS)
        turn = np.asarray(np.exp(1j * orders * speed * LAG) - 1.0, dtype=np.complex128)
        swing = 1j * orders * waves.mean_product(0, 1, turn)
        ripple.lag[k] = hold.torque.direction * 0.5 * float(swing.real.sum())
        for n, square in zip(ORDERS, waves.squares(2) if len(names) > 2 else (), strict=False):
            relative = (n * speed / mode) ** 2 * math.sqrt(square)
            ripple.loss[k] += 0.5 * damping * (n * relative) ** 2 * speed
            ripple.loss[k] += n * _hysteresis_loss(gear, relative) / REVOLUTION
    return ripple


def _is_shaken(recording: Recording) -> bool:
    return recording.has("output_angle") and recording.metadata.gear_mounted


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


@dataclass(frozen=True)
class _Waves:
    """Complex amplitudes c (signals, blocks, orders) of Re(c exp(i n theta)) in each block, theta growing, and mean
    squares of the noise of an amplitude (signals,)."""

    amplitude: ComplexArray
    noise: FloatArray

    def squares(self, which: int) -> FloatArray:
        """Mean squares of the amplitudes of a signal over the blocks (orders,), 0 where they are noise."""
        mean = np.mean(np.abs(self.amplitude[which]) ** 2, axis=0)
        noise = self.noise[which]
        return np.where(mean > SEEN * noise, mean - noise, 0.0)

    def mean_product(self, angle: int, torque: int, turn: ComplexArray) -> ComplexArray:
        """-conj(a) T turn, in the mean over blocks (orders,).

        i n of it is the torque, turned by `turn`, times the ripple of the speed over its mean (amplitude i n a).
        """
        return -np.mean(np.conj(self.amplitude[angle]) * self.amplitude[torque], axis=0) * turn


def _waves(recording: Recording, hold: Hold, names: list[str]) -> _Waves | None:
    """The orders of some signals of a hold by blocks; None where it is too short."""
    rows = slice(max(hold.segment.start, hold.segment.stop - ROWS), hold.segment.stop)
    good = usable(recording, rows)
    angle = recording.si("input_angle", rows)[good]
    turns = abs(angle[-1] - angle[0]) / REVOLUTION if len(angle) else 0.0
    size = max(BLOCK_ROWS, math.ceil(BLOCK_REVOLUTIONS * len(angle) / max(turns, 1e-9)))
    blocks = len(angle) // size
    if blocks == 0:
        return None
    signals = [
        recording.output_angle(rows)[good] if n == "output_angle" else recording.si(n, rows)[good]
        for n in names
    ]
    moved = np.array([s[: blocks * size].reshape(blocks, size) for s in signals])
    turned = hold.torque.direction * moved[0]
    moved = moved - moved.mean(axis=2, keepdims=True)
    place = np.broadcast_to(np.linspace(-1.0, 1.0, size), turned.shape)
    waves = [f(n * turned) for n in ORDERS for f in (np.cos, np.sin)]
    design = np.stack([*(place**k for k in range(TREND + 1)), *waves], axis=2)
    # Normal equations: columns are of unit size, and what aliases away is cut off.
    right = np.moveaxis(moved, 0, 2)
    inverse = np.linalg.pinv(design.mT @ design, rcond=1e-6, hermitian=True)
    solution = inverse @ (design.mT @ right)
    residual = right - design @ solution
    noise = 4.0 * np.mean(residual**2, axis=(0, 1)) / size
    parts = np.moveaxis(solution[:, TREND + 1 :, :], 2, 0)
    return _Waves(parts[:, :, 0::2] - 1j * parts[:, :, 1::2], noise)
