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

The input ripples too, and the torque port is late: `experiments.torque.ripple`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from experiments.assumed import LOWEST_MODE
from experiments.evidence.sampling import HIGHEST_SHARE
from experiments.load import is_stated
from experiments.planning.speeds import first_resonances
from experiments.recording import Recording
from experiments.torque.ripple import port_lag, waves_of
from experiments.torque.running_torque import Hold
from model.arrays import FloatArray
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
ENOUGH = 16
"""Slow holds, in many places on the output, that tell the error."""
_TURNED = 0.02
"""Radians by which the lag or a period must turn the highest order to be looked at."""


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
        names = ["input_angle", channel] + ["output_angle"] * int(shaken[k])
        waves = waves_of(recording, hold, names, orders)
        if waves is None:
            continue
        late = waves.late(orders, speed, (lag, u), period)
        ripple.lag[k], ripple.lag_uncertainty[k] = late.lag, late.lag_uncertainty
        ripple.between[k] = late.between
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
    seen = (
        waves_of(recording, hold, ["input_angle", "output_angle"], np.array(ORDERS)) for hold in few
    )
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
