"""The steps that every protocol shares: torque zero before and after, ramps, and the checks of its parameters.

Labels of segments, the only words by which analyses find their data:

    torque-zero-before, torque-zero-after   servo off, standstill: the zero of the torque port
    ramp, position, rest                    getting there, approaching an angle, standing with the servo on
    approach, settle                        turning, but not counted yet (wind-up after a reversal, transients)
    traverse, hold, bracket, step           what is counted: kinematic error, friction, reference speed, velocity step
    compensated                             a traverse along a table
    warm-up, torque-ramp                    running until steady, starting torque
    home-input, home-output                 index marks
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any

from experiments.errors import PlanError
from experiments.parameters import check_parameters
from experiments.steps.vocabulary import HoldTime, Ramp, SegmentLabel, ServoOff, Step
from model.gear import HarmonicDrive
from model.units import REVOLUTION

ZERO_BEFORE = "torque-zero-before"
ZERO_AFTER = "torque-zero-after"
LABELS = frozenset(
    {
        ZERO_BEFORE,
        ZERO_AFTER,
        "ramp",
        "position",
        "rest",
        "approach",
        "settle",
        "traverse",
        "compensated",
        "hold",
        "bracket",
        "step",
        "warm-up",
        "torque-ramp",
        "home-input",
        "home-output",
    }
)
"""Every label that a plan may use."""

STANDSTILL = 0.5
"""s with the servo on at zero speed before it is switched off: the rotor must not coast into the torque zero."""


def between_zeros(steps: Iterable[Step], zero_time: float) -> Iterator[Step]:
    """The steps of a protocol between two torque zeros at standstill."""
    yield ServoOff(zero_time, SegmentLabel(ZERO_BEFORE))
    yield from steps
    yield HoldTime(STANDSTILL, SegmentLabel("rest"))
    yield ServoOff(zero_time, SegmentLabel(ZERO_AFTER))


def ramp(speed: float, acceleration: float, direction: int = 0) -> Ramp:
    """A labelled ramp to `speed` [rad/s]."""
    return Ramp(speed, acceleration, SegmentLabel("ramp", speed, direction))


def stop(acceleration: float) -> Ramp:
    """A labelled ramp to standstill."""
    return ramp(0.0, acceleration)


def longest(revolutions: float, speed: float, share: float = 0.5) -> float:
    """`at_most` [s] for turning that many revolutions at `speed` [rad/s]: nominal time and a generous share."""
    return (1.0 + share) * revolutions * REVOLUTION / abs(speed) + 5.0


def whole_revolutions(speed: float, seconds: float, least: int = 1) -> int:
    """The smallest whole number of input revolutions that lasts at least `seconds` at `speed` [rad/s]."""
    return max(least, math.ceil(seconds * abs(speed) / REVOLUTION - 1e-9))


def window_of(speed: float, seconds: float) -> float:
    """A time window [s] of whole input revolutions at `speed` that is at least `seconds` long."""
    return whole_revolutions(speed, seconds) * REVOLUTION / abs(speed)


def checked(parameters: Any, expected: type[Any], name: str) -> None:
    """Raise `PlanError` unless these are the protocol's parameters, every one within its declared range."""
    if not isinstance(parameters, expected):
        raise PlanError(
            "these are the parameters of another protocol",
            where=name,
            value=type(parameters).__name__,
            limit=expected.__name__,
        )
    check_parameters(parameters, name)


def output_travel(
    gear: HarmonicDrive, mounting: str, output_revolutions: float, where: str
) -> float:
    """Input revolutions of that many output revolutions: N (circular spline fixed) or N + 1 (flexspline fixed)."""
    if mounting not in ("circular-spline-fixed", "flexspline-fixed"):
        raise PlanError(
            "no such mounting",
            where=f"{where}.mounting",
            value=repr(mounting),
            limit="circular-spline-fixed, flexspline-fixed",
        )
    return output_revolutions * gear.mounted_ratio(mounting)  # type: ignore[arg-type]
