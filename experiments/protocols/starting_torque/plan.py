"""No-load starting torque: what a run does."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

from experiments.errors import PlanError
from experiments.planning.parts import between_zeros, checked, longest, stop
from experiments.planning.speeds import refuse_speed
from experiments.protocols.starting_torque.declaration import NAME, Parameters
from experiments.steps.vocabulary import (
    MoveRevolutions,
    MoveToAngle,
    SegmentLabel,
    ServoOff,
    Step,
    TorqueRamp,
)
from model.gear import HarmonicDrive
from model.units import DEGREE, REVOLUTION, RPM

_RELEASE_TIME = 0.5
"""s without power before a ramp: what the servo held at standstill is let go, the torque port settles."""

_LEAST_APPROACH = 1.0
"""Input revolutions in its own direction before the first ramp of a direction: the wind-up of the other is gone."""

CREEP = 0.05
"""rad of input that a position is approached with at the end, so slowly that the output comes to rest as
its own friction has wound it up; many times the wind-up itself."""

_SLOWEST_CREEP = 0.02
"""rad/s."""

_LEFT_BY_STOPPING = 2e-4
"""N m at the input that the moving output may take out of the wind-up when the input comes to rest."""

STEP_SHARE = 0.43
"""Share of the positions between one ramp and the next.

With each ramp the output is a share 1/positions of its turn further. At about this step no sideband
n +- k/N of a low order stands at the same phase in all ramps.
"""


def plan(parameters: Parameters, gear: HarmonicDrive) -> Iterator[Step]:
    """Torque zero; a torque ramp at every position, first forward over a turn of the output, then
    reverse; torque zero.

    Every position is approached in the direction of its ramp, and so slowly at the end that the
    output comes to rest wound up by its own friction. Then the power is off for a moment, and the
    torque rises from zero until the input moves.
    """
    checked(parameters, Parameters, NAME)
    for name in ("approach_rpm", "travel_rpm"):
        refuse_speed(getattr(parameters, name), gear, f"{NAME}.{name}")
    peak = gear.ratings.repeated_peak_torque / gear.ratio
    if parameters.torque_limit > peak:
        raise PlanError(
            "the torque of the ramp could exceed the gear's repeated peak torque at the output",
            where=f"{NAME}.torque_limit",
            value=f"{parameters.torque_limit:g} N m",
            limit=f"<= {peak:.3g} N m (ratings.repeated_peak_torque / ratio)",
            remedy="Lower the limit of the ramp.",
        )
    return between_zeros(_ramps(parameters, gear), parameters.zero_time)


def _ramps(p: Parameters, gear: HarmonicDrive) -> Iterator[Step]:
    creep, gentle = _gentle(p, gear)
    phases, turns = _places(p.positions, gear.ratio)
    for repeat in range(p.repeats):
        for way in (1, -1):
            yield _travel(p, way * max(turns[0], _LEAST_APPROACH), repeat)
            for place, phase in enumerate(phases[::way]):
                if place and turns[place]:
                    yield _travel(p, way * turns[place], repeat)
                yield from _approach(p, phase, way, repeat)
                label = SegmentLabel("position", phase, way, repeat)
                yield MoveRevolutions(
                    way * CREEP / REVOLUTION, creep, gentle, 2.0 * CREEP / creep + 5.0, label
                )
                yield ServoOff(_RELEASE_TIME, SegmentLabel("rest", phase, way, repeat))
                label = SegmentLabel("torque-ramp", phase, way, repeat)
                yield TorqueRamp(way * p.rate, p.torque_limit, p.motion_deg * DEGREE, label)
                yield stop(p.acceleration)


def _gentle(p: Parameters, gear: HarmonicDrive) -> tuple[float, float]:
    """Input speed [rad/s] and acceleration [rad/s2] at which the output, moving, carries no more than
    `_LEFT_BY_STOPPING` past the standstill of the input: v sqrt(J_o K_1)/N^2 when it stops at once,
    a J_o/N^2 when it is braked.
    """
    inertia, ratio = gear.inertia.output, gear.ratio
    at_once = _LEFT_BY_STOPPING * ratio**2 / math.sqrt(inertia * gear.ratings.stiffness_1)
    speed = min(max(at_once, _SLOWEST_CREEP), p.approach_rpm * RPM)
    return speed, min(_LEFT_BY_STOPPING * ratio**2 / inertia, p.acceleration)


def _places(positions: int, ratio: float) -> tuple[list[float], list[int]]:
    """Wave-generator angles [rad] in the order of a forward sweep, and the whole input revolutions before each.

    Together they take the output once round, in equal shares.
    """
    step = next(
        s
        for s in range(max(round(STEP_SHARE * positions), 1), 0, -1)
        if math.gcd(s, positions) == 1
    )
    phases = [REVOLUTION * ((k * step) % positions) / positions for k in range(positions)]
    ends = [round(k * max(ratio - step, 0.0) / positions) for k in range(positions + 1)]
    return phases, [b - a for a, b in itertools.pairwise(ends)]


def _travel(p: Parameters, revolutions: float, repeat: int) -> Step:
    """On to the next angle of the output."""
    speed = p.travel_rpm * RPM
    label = SegmentLabel("approach", speed, int(math.copysign(1, revolutions)), repeat)
    at_most = longest(abs(revolutions), speed) + 2.0 * speed / p.acceleration
    return MoveRevolutions(revolutions, speed, p.acceleration, at_most, label)


def _approach(p: Parameters, phase: float, way: int, repeat: int) -> Iterator[Step]:
    """To the angle at which creeping begins, from the direction of the ramp."""
    slow = p.approach_rpm * RPM
    at_most = 5.0 * REVOLUTION / slow + 10.0
    label = SegmentLabel("approach", way * slow, way, repeat)
    yield MoveToAngle(phase - way * CREEP, way * slow, p.acceleration, at_most, label)
