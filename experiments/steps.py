"""The vocabulary of plans: what a protocol can ask of a rig, one frozen step at a time.

Speeds are input speeds in rad/s, signed; angles are input angles in rad. A plan is a pure function:
no clock, no random, no feedback. Feedback lives in steps that end on a condition and carry
`at_most`, so that nominal and longest duration of a plan are known before anything moves. A step
with a `segment` is recorded as one; analysis never guesses it back.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SegmentLabel:
    """What a recorded interval is: its label ("hold", "bracket", ...), set-point (SI), direction
    (+1, -1, 0), repeat.
    """

    label: str
    setpoint: float = 0.0
    direction: int = 0
    repeat: int = 0


@dataclass(frozen=True)
class ServoOff:
    """Power stage off for a time [s]: nothing is held, the torque port shows its zero."""

    duration: float
    segment: SegmentLabel | None = None


@dataclass(frozen=True)
class Ramp:
    """Change the speed linearly from the present set-point to `speed` at `acceleration` > 0 [rad/s2]."""

    speed: float
    acceleration: float
    segment: SegmentLabel | None = None


@dataclass(frozen=True)
class SpeedStep:
    """Set the speed at once (the drive's own limits shape it) and hold it for `duration` [s], longer if
    `least_revolutions` of the input are not done by then."""

    speed: float
    duration: float
    least_revolutions: float = 0.0
    segment: SegmentLabel | None = None


@dataclass(frozen=True)
class HoldRevolutions:
    """Hold the present speed until the input has turned `revolutions` (> 0, counted by the motor encoder)."""

    revolutions: float
    at_most: float
    segment: SegmentLabel | None = None


@dataclass(frozen=True)
class HoldTime:
    """Hold the present speed (0 is standstill with the servo on) for `duration` [s]."""

    duration: float
    segment: SegmentLabel | None = None


@dataclass(frozen=True)
class Settle:
    """Hold the present speed until the mean torque of consecutive windows agrees within `tolerance` [N m], at most
    `at_most` [s]. `window` [s] is rounded up to whole input revolutions by whoever plans."""

    window: float
    tolerance: float
    at_most: float
    segment: SegmentLabel | None = None


@dataclass(frozen=True)
class MoveToAngle:
    """Bring the input to `phase` [rad] within its revolution, from one side (sign of `speed`), and stand there.

    `phase` counts from the input index mark where it is known, from the start of the run otherwise.
    """

    phase: float
    speed: float
    acceleration: float
    at_most: float
    segment: SegmentLabel | None = None


@dataclass(frozen=True)
class MoveRevolutions:
    """Turn the input by `revolutions` (signed) at |speed| with ramps and stand there."""

    revolutions: float
    speed: float
    acceleration: float
    at_most: float
    segment: SegmentLabel | None = None


@dataclass(frozen=True)
class FindIndex:
    """Turn slowly at `speed` until an index mark has passed ("input" or "output"), at most `at_most` [s]."""

    which: str
    speed: float
    at_most: float
    segment: SegmentLabel | None = None


@dataclass(frozen=True)
class TorqueRamp:
    """Torque from 0 at `rate` [N m/s] (signed) until the input has moved by `motion` [rad] or
    `limit` [N m] is reached.
    """

    rate: float
    limit: float
    motion: float
    segment: SegmentLabel | None = None


@dataclass(frozen=True)
class Prompt:
    """Ask the operator something before going on; the answer becomes an event."""

    text: str
    key: str = ""


@dataclass(frozen=True)
class Mark:
    """Write an event into the run."""

    code: str
    text: str


Step = (
    ServoOff
    | Ramp
    | SpeedStep
    | HoldRevolutions
    | HoldTime
    | Settle
    | MoveToAngle
    | MoveRevolutions
    | FindIndex
    | TorqueRamp
    | Prompt
    | Mark
)
