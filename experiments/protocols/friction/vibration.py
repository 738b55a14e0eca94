"""Power that a vibrating output takes from the motor and that is no friction of the gear.

Orders of the kinematic error shake the output; near the first torsional mode the motion is many times the error. The
relative motion across the gear is x = r^2 y, r = n w/w_1, with the output's own motion y, which the output encoder
shows in the very hold whose torque is averaged; above the mode x = y + e, with the kinematic error e that slow holds
show: there y is small, and w_1 falls out. With the damping D of the gear it takes, at the input,

    T = sum over n of (D/2) (n w)^2 |x_n|^2/w + n E(x_n)/(2 pi)        D = C_b (r_g/tan(alpha_t) K/K_b')^2 + C_t

D is what the parameter set's dampers are at the output (K_b' is the bearing's stiffness there), E what hysteresis takes
per cycle: 4 T_h x where it slides, as x^3 before (Dahl), T_h = K/2 times the hysteresis loss of the ratings. Orders and
their sidebands n +- k/N beat over the output turn, so that y is taken from short blocks and squares are averaged.
Damping is known within a factor of about three, w_1 (in the fourth power) by the card's stiffness and inertia. Where
nobody stated the inertia, w_1 is the lowest that is assumed, and the loss lies between none and what follows from it.

The input ripples too, and the port lags behind the torque by an unknown part of `LAG`: the mean over angle holds the
product of both ripples, half the sum of Re(T_n conj(w_n)/w); a first-order lag t hides i n w t T_n of T_n. The sum of
trapezoids over angle holds only a share sin(b)/b of that product, b = n w times the sampling period: at a quarter of
the rate a third is missing. A speed loop takes power from ripples (T_n opposes w_n): the mean came out too large.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from experiments.assumed import LOWEST_MODE
from experiments.evidence import usable
from experiments.evidence.sampling import HIGHEST_SHARE
from experiments.load import is_stated
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
SLOW, STILL = 0.1, 0.3
"""Shares of the first mode below which the highest order shakes nothing worth a look, and moves as the error does."""
STIFFNESS, HIGHEST_PEAK = 0.4, 10.0
"""Relative half-width of the stiffness of a gear about its card's; torsion over error at a resonance that sampling
hides."""
_FOLDED = (0.05, 0.45)
"""Turns per sample between which an alias shows the amplitude of what folds there."""
_SPLIT = 2.0
"""Two orders that fold to one place share what stands there."""
LAG = 1e-3
"""s by which a torque port lags where its bench has not measured it, assumed; 0 to twice as much."""
LAG_RELATIVE = 1.0 / math.sqrt(3.0)
"""Relative standard uncertainty of that."""
_TURNED = 0.02
"""Radians by which the lag or a period must turn the highest order to be looked at."""
ROWS = 20_000
"""Rows of a hold that are looked at, its last ones."""
_TREND = 2
"""Degree of the polynomial over time that stands for the turning of the output and its own slow orders in a block."""
SEEN = 4.0
"""Mean square of an order over that of the noise from which on it is a motion."""
BLOCK_ROWS, BLOCK_REVOLUTIONS = 80, 5.0
"""A block has at least so many rows and covers so many input revolutions, all of a shorter hold, but one at least."""
LEAST_REVOLUTIONS, ENOUGH = 0.95, 16
"""Input revolutions that a hold needs, and slow holds, in many places on the output, that tell the error."""
_REVOLUTION_ROWS = 200
"""Rows per input revolution that are enough."""


@dataclass(frozen=True)
class Ripple:
    """What ripples do to the torque of each hold (n,) [N m], positive where it opposes the motion as friction does.

    `loss`, input torque that the shaken output takes by the card; `lag`, what the mean torque would change if the
    port's lag (`port_lag`) were taken out, `lag_uncertainty` its standard uncertainty; `between`, what it would change
    if ripples were integrated exactly between the samples; `unseen`, half-width of the loss by orders that sampling
    hides.
    """

    loss: FloatArray
    lag: FloatArray
    lag_uncertainty: FloatArray
    between: FloatArray
    unseen: FloatArray


def port_lag(recording: Recording, channel: str) -> tuple[float, float, str]:
    """How late a torque is shown [s], the standard uncertainty of that, and where both are from."""
    known = recording.signals[channel].calibration
    if known.lag is None or known.lag_uncertainty is None:
        return LAG, LAG_RELATIVE * LAG, f"{1e3 * LAG:g} ms, 0 to twice as much"
    return known.lag, known.lag_uncertainty, f"{1e3 * known.lag:.3g} ms, learnt on this bench"


def ripple_of(recording: Recording, holds: list[Hold], gear: HarmonicDrive, channel: str) -> Ripple:
    """The ripples of all holds at constant speed."""
    ripple = Ripple(*np.zeros((5, len(holds))))
    lag, u, _ = port_lag(recording, channel)
    orders, period = np.array(ORDERS), 1.0 / recording.metadata.sample_rate
    is_known = is_stated(recording, gear)
    mode = _mode(gear) if is_known else LOWEST_MODE
    shaken = [
        _is_shaken(recording) and orders[-1] * abs(h.torque.speed) > SLOW * mode for h in holds
    ]
    error = _at_rest(recording, holds, mode, gear) if any(shaken) else np.zeros(len(orders))
    for k, hold in enumerate(holds):
        speed = abs(hold.torque.speed)
        if orders[-1] * speed * max(abs(lag), period) < _TURNED:
            continue
        waves = _waves(
            recording, hold, ["input_angle", channel] + ["output_angle"] * int(shaken[k])
        )
        if waves is None:
            continue
        swing = 0.5j * orders * waves.mean_product(0, 1)
        per_second = float((1j * swing * orders * speed).real.sum())
        ripple.lag[k], ripple.lag_uncertainty[k] = lag * per_second, u * per_second
        # np.sinc has pi in it; what a sum of trapezoids is short of.
        missing = 1.0 - np.sinc(orders * speed * period / math.pi)
        ripple.between[k] = float((swing * missing).real.sum())
        if shaken[k]:
            turns = orders * speed * period / REVOLUTION
            torsion = _sampled(turns, orders * speed / mode, np.sqrt(waves.squares(2)), error)
            loss = 0.5 * _damping(gear) * (orders * torsion) ** 2 * speed
            loss += orders * _hysteresis_loss(gear, torsion) / REVOLUTION
            low, high = loss.sum(axis=1)
            if not is_known:
                low = 0.0
            ripple.loss[k], ripple.unseen[k] = 0.5 * (low + high), 0.5 * (high - low)
    return ripple


def _mode(gear: HarmonicDrive) -> float:
    """The first mode [rad/s] of a gear whose load is stated."""
    mode = math.sqrt(math.prod(first_resonances(gear)))
    # At small amplitudes hysteresis is a spring beside the gear's own.
    return mode * math.sqrt(1.0 + 0.5 * gear.ratings.hysteresis_loss / SLIDING)


def _sampled(
    turns: FloatArray, ratio: FloatArray, motion: FloatArray, error: FloatArray
) -> FloatArray:
    """Least and largest amplitude of the torsion as in `_torsion`, of orders that turn so many times between samples.

    What sampling hides is not identified, but it is no more than what stands at its alias, where that neither stands
    still nor alternates.
    """
    hidden, folded = turns >= HIGHEST_SHARE, np.abs(turns - np.round(turns))
    found = _torsion(ratio, np.where(hidden, math.nan, motion), error)
    shown = hidden & (folded > _FOLDED[0]) & (folded < _FOLDED[1])
    most = np.where(shown, _SPLIT * _torsion(ratio, motion, error), math.inf)
    return np.minimum(found, most)


def _torsion(ratio: FloatArray, motion: FloatArray, error: FloatArray) -> FloatArray:
    """Least and largest amplitude of the torsion (2, orders) at multiples `ratio` of the first mode, from that of the
    output's own motion (NaN where sampling hides it) and of the kinematic error [rad].

    Below the mode the motion's inertia tells it; above, where little moves, the error is what the torsion takes up, in
    antiphase to the motion. A hidden motion is what a stiffness within `STIFFNESS` allows.
    """
    square = ratio**2
    above = np.clip(square * motion, error, motion + error)
    seen = np.where(square < 1.0, square * motion, above)
    moved = square[:, None] / np.linspace(1.0 - STIFFNESS, 1.0 + STIFFNESS, 17)
    peak = moved / np.maximum(np.abs(1.0 - moved), moved / HIGHEST_PEAK)
    hidden = error * np.array([peak.min(axis=1), peak.max(axis=1)])
    return np.where(np.isfinite(motion), seen, hidden)


def _at_rest(
    recording: Recording, holds: list[Hold], mode: float, gear: HarmonicDrive
) -> FloatArray:
    """Amplitudes of the kinematic error (orders,) [rad]: the output's own motion where nothing shakes it, and where no
    hold is that slow what the catalogue's transmission accuracy leaves to each order.
    """
    still = [h for h in holds if ORDERS[-1] * abs(h.torque.speed) < STILL * mode]
    few = still[:: 1 + len(still) // ENOUGH]
    seen = (_waves(recording, hold, ["input_angle", "output_angle"]) for hold in few)
    squares = [waves.squares(1) for waves in seen if waves is not None]
    if not squares:
        return np.full(len(ORDERS), 0.5 * gear.ratings.transmission_accuracy / len(ORDERS))
    return np.sqrt(np.mean(squares, axis=0))


def _is_shaken(recording: Recording) -> bool:
    return recording.has("output_angle") and recording.metadata.gear_mounted


def _hysteresis_loss(gear: HarmonicDrive, torsion: FloatArray) -> FloatArray:
    """What hysteresis takes per cycle of each of these amplitudes of torsion [rad] [J], which all move it at once."""
    limit = 0.5 * drive_stiffness(gear).combined_output * gear.ratings.hysteresis_loss
    share = np.sum(torsion**2, axis=1, keepdims=True) / SLIDING**2
    return 4.0 * limit * torsion * share / (3.0 + share)


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

    def mean_product(self, angle: int, torque: int) -> ComplexArray:
        """-conj(a) T, in the mean over blocks (orders,).

        i n of it is the torque times the ripple of the speed over its mean (amplitude i n a).
        """
        return -np.mean(np.conj(self.amplitude[angle]) * self.amplitude[torque], axis=0)


def _waves(recording: Recording, hold: Hold, names: list[str]) -> _Waves | None:
    """The orders of some signals of a hold by blocks; None where it is too short."""
    rows = slice(max(hold.segment.start, hold.segment.stop - ROWS), hold.segment.stop)
    per_turn = REVOLUTION * recording.metadata.sample_rate / abs(hold.torque.speed)
    good = np.flatnonzero(usable(recording, rows))[:: max(1, int(per_turn / _REVOLUTION_ROWS))]
    angle = recording.si("input_angle", rows)[good]
    turns = abs(angle[-1] - angle[0]) / REVOLUTION if len(angle) else 0.0
    if turns < LEAST_REVOLUTIONS:
        return None
    size = max(BLOCK_ROWS, math.ceil(min(BLOCK_REVOLUTIONS / turns, 1.0) * len(angle)))
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
    design = np.stack([*(place**k for k in range(_TREND + 1)), *waves], axis=2)
    # Normal equations: columns are of unit size, and what aliases away is cut off.
    right = np.moveaxis(moved, 0, 2)
    inverse = np.linalg.pinv(design.mT @ design, rcond=1e-6, hermitian=True)
    solution = inverse @ (design.mT @ right)
    residual = right - design @ solution
    noise = 4.0 * np.mean(residual**2, axis=(0, 1)) / size
    parts = np.moveaxis(solution[:, _TREND + 1 :, :], 2, 0)
    return _Waves(parts[:, :, 0::2] - 1j * parts[:, :, 1::2], noise)
