"""What would heal a fit of motion: a residual that follows the position names the load that was left out."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from experiments.recordings.motion_channels import RecordedMotion
from model.arrays import quotient
from model.identify.motion_result import MotionFit

_EXPLAINED = 0.5
"""Share of the residual's variance from which on a load over the position is named."""
_LARGE = 0.05
"""Share of the effort's size that a residual must have to be worth a sentence."""
_HARMONICS = 8
_LEAST_ANGLE = 0.5
"""rad; over less a load looks like an offset."""


def load_remedy(motion: RecordedMotion, fit: MotionFit, turn: float) -> str:
    """A sentence where the residual goes with the angle; `turn` is the load's angle per position. "" where it does not.

    residual = a cos(phi) + b sin(phi) for the weight of a lever, up to cos(8 phi), sin(8 phi) for others.
    """
    if motion.position_unit != "rad" or not motion.is_position:
        return ""
    recording = motion.recording
    times, places = recording.time(), recording.si(motion.place)
    good = np.isfinite(places)
    angle = turn * np.interp(fit.time, times[good], places[good])
    residual = fit.measured - fit.predicted
    size = float(np.std(fit.measured))
    if np.ptp(angle) < _LEAST_ANGLE or not float(np.std(residual)) > _LARGE * size > 0.0:
        return ""
    for orders, setting in ((1, "gravity"), (_HARMONICS, f"harmonics:{_HARMONICS}")):
        share = _explained(residual, angle, orders)
        if share >= _EXPLAINED:
            what = "as the weight of a lever does" if orders == 1 else f"in orders 1 to {orders}"
            return (
                f"The residual follows the angle {what} ({100.0 * share:.0f} % of its variance): "
                f"--set load={setting}."
            )
    return ""


def _explained(residual: NDArray[np.float64], angle: NDArray[np.float64], orders: int) -> float:
    """Share of a residual's variance that goes with orders 1 to `orders` of the angle, on the half not fitted to."""
    phases = np.outer(angle, np.arange(1, orders + 1))
    design = np.column_stack((np.ones_like(angle), np.cos(phases), np.sin(phases)))
    half = len(residual) // 2
    if half < 4 * design.shape[1]:
        return 0.0
    shares: list[float] = []
    for fitted, held in ((slice(0, half), slice(half, None)), (slice(half, None), slice(0, half))):
        values, *_ = np.linalg.lstsq(design[fitted], residual[fitted])
        left = residual[held] - design[held] @ values
        whole = float(np.var(residual[held]))
        shares.append(1.0 - quotient(float(np.mean(left**2)), whole, 1.0))
    return min(shares) if all(map(math.isfinite, shares)) else 0.0
