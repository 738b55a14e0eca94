# pyright: standard
"""No-load starting torque: the quasi-static torque at which the input begins to turn, at several
wave-generator positions.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le

from experiments.budget import budget_table, scale_line
from experiments.contract import Evidence, Experiment
from experiments.errors import AnalysisError, PlanError
from experiments.evidence import check_recording, check_settings, usable
from experiments.parameters import Help, Unit
from experiments.planning.parts import between_zeros, checked, longest, stop
from experiments.planning.shared_parameters import Acceleration, Repeats, SlowSpeed, ZeroTime
from experiments.planning.speeds import refuse_speed
from experiments.protocols.friction.bearing import COULOMB, NAMES, OutputBearing, output_bearing
from experiments.quantity import (
    OF_TORQUE_DIFFERENCES,
    Counterpart,
    Quantity,
)
from experiments.recording import Recording, Segment
from experiments.result import Plot, Result, Table, both_ways
from experiments.steps.vocabulary import (
    MoveRevolutions,
    MoveToAngle,
    SegmentLabel,
    ServoOff,
    Step,
    TorqueRamp,
)
from experiments.terms import MOTOR_AND_GEAR, Term
from experiments.torque.zero import TorqueZero, torque_zero
from model.arrays import FloatArray
from model.gear import HarmonicDrive
from model.identify.estimate import NORMAL_COVERAGE_FACTOR, BudgetLine, Estimate
from model.identify.least_squares import student_quantile
from model.units import DEGREE, REVOLUTION, RPM

NAME = "starting-torque"


_DEFINITION = (
    "quasi-static torque at which the input begins to turn, nothing on the output; motor and gear, "
    "without the bench's output bearing; mean over positions on a turn of the output"
)
_COMPARED_BY = ("part", "mounting", "torque of", "channel", "ramp")
_CATALOGUE = Counterpart(
    rating="starting_torque",
    definition="quasi-static torque at which the input begins to turn, nothing on the output",
    conditions="nothing on the output, housing at 20 °C, the unit's own grease",
)
TARGET = 0.015
TARGET_REASON = "a tenth of what catalogues state for this size at ratio 50, 0.15 N m"
QUANTITIES = (
    Quantity(
        name="starting_torque_{way}",
        title="starting torque {way}",
        unit="N m",
        shown="mN m",
        definition=_DEFINITION,
        conditions=_COMPARED_BY,
        target_uncertainty=TARGET,
        target_reason=TARGET_REASON,
        is_key=True,
        catalogue=_CATALOGUE,
        rests_on=OF_TORQUE_DIFFERENCES,
    ),
    Quantity(
        name="starting_torque",
        title="starting torque",
        heading="No-load starting torque, mean of both directions",
        axis="starting torque",
        unit="N m",
        shown="mN m",
        definition=_DEFINITION,
        conditions=_COMPARED_BY,
        target_uncertainty=TARGET,
        target_reason=TARGET_REASON,
        is_key=True,
        is_watched=True,
        catalogue=_CATALOGUE,
        rests_on=OF_TORQUE_DIFFERENCES,
    ),
    Quantity(name="ramps", title="ramps", unit="1"),
    Quantity(name="scatter_of_one_ramp", title="scatter of one ramp", unit="N m"),
    Quantity(
        name="output_bearing_torque",
        title="output bearing, subtracted",
        unit="N m",
        definition="what the bench's output bearing is taken to ask of the input",
    ),
    Quantity(name="largest_starting_torque", title="largest starting torque", unit="N m"),
    Quantity(name="smallest_starting_torque", title="smallest starting torque", unit="N m"),
)


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """What a starting-torque run can be told.

    The usual 23 positions share no factor with the orders at which motors cog (12, 24, 36, 48, 72):
    on 8 positions order 24 stands at the same phase in all of them and is read as friction.
    """

    positions: Annotated[
        int,
        Ge(2),
        Le(360),
        Unit(""),
        Help("wave-generator positions per direction, evenly over a revolution"),
    ] = 23
    repeats: Repeats = 1
    rate: Annotated[float, Gt(0.0), Le(1.0), Unit("N m/s"), Help("rate of the torque ramp")] = 0.02
    torque_limit: Annotated[
        float,
        Gt(0.0),
        Le(10.0),
        Unit("N m"),
        Help("torque at which a ramp that moves nothing ends"),
    ] = 0.4
    motion_deg: Annotated[
        float, Gt(0.0), Le(30.0), Unit("deg"), Help("input motion that ends a ramp")
    ] = 1.0
    approach_rpm: SlowSpeed = 20.0
    travel_rpm: Annotated[
        float,
        Gt(0.0),
        Le(3000.0),
        Unit("r/min"),
        Help("input speed between positions, which are spread over a turn of the output"),
    ] = 300.0
    acceleration: Acceleration = 50.0
    zero_time: ZeroTime = 3.0


RELEASE_TIME = 0.5
"""s without power before a ramp: what the servo held at standstill is let go, the torque port settles."""
LEAST_APPROACH = 1.0
"""Input revolutions in its own direction before the first ramp of a direction: the wind-up of the other is gone."""
CREEP = 0.05
"""rad of input that a position is approached with at the end, so slowly that the output comes to rest as
its own friction has wound it up; many times the wind-up itself."""
SLOWEST_CREEP = 0.02
"""rad/s."""
LEFT_BY_STOPPING = 2e-4
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
            yield _travel(p, way * max(turns[0], LEAST_APPROACH), repeat)
            for place, phase in enumerate(phases[::way]):
                if place and turns[place]:
                    yield _travel(p, way * turns[place], repeat)
                yield from _approach(p, phase, way, repeat)
                label = SegmentLabel("position", phase, way, repeat)
                yield MoveRevolutions(
                    way * CREEP / REVOLUTION, creep, gentle, 2.0 * CREEP / creep + 5.0, label
                )
                yield ServoOff(RELEASE_TIME, SegmentLabel("rest", phase, way, repeat))
                label = SegmentLabel("torque-ramp", phase, way, repeat)
                yield TorqueRamp(way * p.rate, p.torque_limit, p.motion_deg * DEGREE, label)
                yield stop(p.acceleration)


def _gentle(p: Parameters, gear: HarmonicDrive) -> tuple[float, float]:
    """Input speed [rad/s] and acceleration [rad/s2] at which the output, moving, carries no more than
    `LEFT_BY_STOPPING` past the standstill of the input: v sqrt(J_o K_1)/N^2 when it stops at once,
    a J_o/N^2 when it is braked.
    """
    inertia, ratio = gear.inertia.output, gear.ratio
    at_once = LEFT_BY_STOPPING * ratio**2 / math.sqrt(inertia * gear.ratings.stiffness_1)
    speed = min(max(at_once, SLOWEST_CREEP), p.approach_rpm * RPM)
    return speed, min(LEFT_BY_STOPPING * ratio**2 / inertia, p.acceleration)


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


FIRST_MOTION = 0.2 * DEGREE
"""Input angle that counts as motion; less is the elastic wind-up of gear and grease, or counts flickering."""
QUIET_SHARE = 0.25
"""Share of it below which the input is at rest, as far as its encoder can tell."""
LARGEST_CONDITION = 3.0
"""Of the patterns beside the mean: above it an error of the one would become one of the other."""
STUCK = 0.4 * DEGREE
"""Standstill in an approach, in angle at its mean speed, from which on it sticks and slips: the output swings when the
input stops, and is no longer wound up as far as its friction held it."""
HIGHEST_ORDER = 6
"""Orders of the input that are told from scatter, where there are positions enough."""


@dataclass(frozen=True)
class Breakaway:
    """One ramp: wave-generator position [rad], direction, torque at first motion [N m], input angle there [rad];
    how far the torque rose while it is not known whether motion had begun, half of it [N m]."""

    position: float
    direction: int
    torque: float
    angle: float
    within: float
    repeat: int = 0


@dataclass(frozen=True, kw_only=True)
class Balance:
    """What all ramps say together [N m]: friction, which has the sign of the direction, and
    asymmetry, which has not; the standard error of both, its degrees of freedom, the scatter of one ramp.

    `direction` is 0; where only one direction is there, it is that one, and the asymmetry is in the friction.
    """

    friction: float
    asymmetry: float
    error: float
    freedom: float
    scatter: float
    direction: int = 0


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """No-load starting torque by direction and position: the torque at which the input begins to turn.

    The torque is read from a straight line through the last part of the ramp before first motion,
    so that noise of the port does not enter. It is that of motor + gear: a motor tare at running
    speeds does not tell the motor's own breakaway. Settings: the bench's output bearing, as of a friction analysis.
    """
    check_settings(evidence.settings, NAMES, NAME)
    bearing = output_bearing(recording, evidence.settings)
    recording.require("starting torque", "input_angle", "torque")
    warnings = list(
        check_recording(recording, "starting torque", evidence.maximum_missed_share).warnings
    )
    zero = torque_zero(recording)
    warnings += zero.warnings
    segments = recording.labelled("torque-ramp")
    if not segments:
        raise AnalysisError("the run has no torque ramp", where=recording.metadata.run_id)
    breakaways = [_breakaway(recording, segment, zero) for segment in segments]
    ramps = [b for b in breakaways if b is not None]
    if len(ramps) < len(breakaways):
        warnings.append(
            f"{len(breakaways) - len(ramps)} of {len(breakaways)} ramps reached their limit without motion."
        )
    if not ramps:
        raise AnalysisError(
            "no ramp made the input move",
            where=recording.metadata.run_id,
            remedy="Raise the limit of the ramp.",
        )
    warnings += _approach_remarks(recording, segments)
    stuck = _stuck_share(recording)
    if stuck > 0.0:
        warnings.append(
            f"{100.0 * stuck:.0f} % of the approaches stuck and slipped: how far the output was wound up before those "
            "ramps is not known, and their torque may be too low by what the output's friction asks of the input."
        )
    balance = _balance(ramps, recording.metadata.run_id)
    estimates = _estimates(recording, ramps, balance, zero, bearing, stuck)
    warnings.append(
        "The starting torque is that of motor + gear: the motor's own breakaway is not known."
    )
    return Result(
        run=recording.metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates=estimates,
        metrics={
            **_metrics(ramps),
            "scatter_of_one_ramp": balance.scatter,
            "output_bearing_torque": _at_rest(recording, bearing)[0],
        },
        warnings=tuple(warnings),
        plots=(_plot(ramps, balance),),
        tables=(_table(ramps), budget_table(estimates.values())),
        options={"torque_is_of": "motor + gear", "output_bearing": bearing.words()},
    )


def _approach_remarks(recording: Recording, ramps: Iterable[Segment]) -> list[str]:
    """Ramps that were approached against their own direction: an older plan, or another program's."""
    approaches = recording.labelled("position")
    wrong = 0
    for ramp in ramps:
        before = [a for a in approaches if a.stop <= ramp.start]
        wrong += bool(before) and _turned(recording, before[-1]) * ramp.direction < 0.0
    if not wrong:
        return []
    return [
        f"{wrong} ramps were approached against their own direction: the gear was still wound up the other way, "
        "so that their torque is too low by up to twice what the output's friction asks of the input."
    ]


def _stuck_share(recording: Recording) -> float:
    """The share of the approaches that stuck and slipped."""
    approaches = [a for a in recording.labelled("position") if a.stop - a.start > 2]
    return float(np.mean([_rest_angle(recording, a) > STUCK for a in approaches] or [0.0]))


def _rest_angle(recording: Recording, segment: Segment) -> float:
    """The longest standstill in an approach as angle at its mean speed [rad]."""
    time, angle = recording.time(segment), recording.si("input_angle", segment)
    travelled = np.maximum.accumulate(np.abs(angle - angle[0]))
    moving = time[np.flatnonzero(np.diff(travelled, prepend=-1.0) > 0.0)]
    rests = np.diff(moving, append=time[-1])
    return float(rests.max() * travelled[-1] / (time[-1] - time[0]))


def _turned(recording: Recording, segment: Segment) -> float:
    angle = recording.si("input_angle", segment)
    return float(angle[-1] - angle[0])


def _breakaway(recording: Recording, segment: Segment, zero: TorqueZero) -> Breakaway | None:
    good = usable(recording, segment)
    angle = recording.si("input_angle", segment)[good]
    time = recording.time(segment)[good]
    if len(angle) < 20:
        return None
    torque = recording.si("torque", segment)[good] - zero.at(time)
    threshold = max(FIRST_MOTION, 3.0 * recording.signals["input_angle"].quantum)
    rest = float(angle[:5].mean())
    moved = np.abs(angle - rest)
    beyond = np.flatnonzero(moved > threshold)
    if not len(beyond) or beyond[0] < 10:
        return None
    upto = beyond[0] + 1
    first, within = _first_motion(time[:upto], moved[:upto], threshold)
    stop = int(np.searchsorted(time, first, side="right"))
    start = max(stop - max(stop // 2, 10), 0)
    slope, level = np.polyfit(time[start:stop] - first, torque[start:stop], 1)
    within *= abs(float(slope))
    return Breakaway(
        segment.setpoint, segment.direction, float(level), rest, within, segment.repeat
    )


def _first_motion(time: FloatArray, moved: FloatArray, threshold: float) -> tuple[float, float]:
    """When motion began [s], and within what [s] that is known.

    What has come loose gains angle with the square of time where a step of the torque has set it
    free, with its cube where the torque rises evenly. A straight line through the roots goes back
    to the moment of rest; it lies between those of the two laws.
    """
    quiet = int(np.flatnonzero(moved <= QUIET_SHARE * threshold)[-1])
    still = float(time[quiet])
    later, angle = time[quiet + 1 :] - still, moved[quiet + 1 :]
    if len(angle) < 3 or angle[-1] <= angle[0]:
        half = 0.5 * float(time[quiet + 1] - still)
        return still + half, half
    begins = []
    for power in (2.0, 3.0):
        slope, level = np.polyfit(later, angle ** (1.0 / power), 1)
        begins.append(float(min(max(-level / slope, -2.0 * later[-1]), 0.0)))
    return still + 0.5 * sum(begins), 0.5 * abs(begins[0] - begins[1])


def _balance(ramps: list[Breakaway], run: str) -> Balance:
    """Friction and asymmetry: half-difference and half-sum of the directions, in the mean over the positions.

    A pattern over the angle is no scatter: over evenly spread positions it cancels in the mean. That
    of the friction stands in the half-differences, so scatter is taken from the half-sums, in which
    the low orders of the cogging are fitted.
    """
    reverse = {(b.position, b.repeat): b for b in ramps if b.direction < 0}
    pairs = [
        (b, reverse[b.position, b.repeat])
        for b in ramps
        if b.direction > 0 and (b.position, b.repeat) in reverse
    ]
    if not pairs:
        return _one_direction(ramps, run)
    friction, asymmetry = (
        np.array([0.5 * (a.torque + sign * b.torque) for a, b in pairs]) for sign in (-1.0, 1.0)
    )
    design = _waves(np.array([a.angle for a, _ in pairs]))
    freedom = _freedom(len(pairs), design.shape[1], run)
    values, _, _, _ = np.linalg.lstsq(design, asymmetry)
    residual = asymmetry - design @ values
    variance = float(residual @ residual) / freedom
    return Balance(
        friction=float(friction.mean()),
        asymmetry=float(asymmetry.mean()),
        error=math.sqrt(variance / len(pairs)),
        freedom=float(freedom),
        scatter=math.sqrt(2.0 * variance),
    )


def _one_direction(ramps: list[Breakaway], run: str) -> Balance:
    """The mean of what moved in one direction alone: there a pattern and scatter are not told apart."""
    direction = ramps[0].direction
    torque = np.array([direction * b.torque for b in ramps if b.direction == direction])
    freedom = _freedom(len(torque), 1, run)
    scatter = float(torque.std(ddof=1))
    return Balance(
        friction=float(torque.mean()),
        asymmetry=0.0,
        error=scatter / math.sqrt(len(torque)),
        freedom=float(freedom),
        scatter=scatter,
        direction=direction,
    )


def _freedom(count: int, parameters: int, run: str) -> int:
    if count <= parameters:
        raise AnalysisError(
            "too few ramps moved the input to tell their scatter",
            where=run,
            value=f"{count} positions",
            limit=f">= {parameters + 1}",
            remedy="Raise the limit of the ramp, or take more positions.",
        )
    return count - parameters


def _waves(angle: FloatArray) -> FloatArray:
    """Columns 1, cos n x, sin n x (n, p) of as many orders as the positions tell from the mean."""
    highest = min(HIGHEST_ORDER, max(0, (len(angle) - 5) // 3))
    one = np.ones((len(angle), 1))
    orders = np.arange(1, highest + 1)
    phase = angle[:, None] * orders
    design = np.hstack([one, math.sqrt(2.0) * np.cos(phase), math.sqrt(2.0) * np.sin(phase)])
    return design if np.linalg.cond(design) <= LARGEST_CONDITION else one


def _estimates(
    recording: Recording,
    ramps: list[Breakaway],
    balance: Balance,
    zero: TorqueZero,
    bearing: OutputBearing,
    stuck: float,
) -> dict[str, Estimate]:
    """Mean over positions of each direction, and of both, in which the torque zero cancels."""
    estimates: dict[str, Estimate] = {}
    factor = student_quantile(balance.freedom)
    # The same laws of motion are laid through all ramps, so that their error does not average.
    moment = float(np.mean([b.within for b in ramps])) / math.sqrt(3.0)
    turning, unknown = _at_rest(recording, bearing)
    held = bearing.coulomb + 2.0 * bearing.coulomb_uncertainty
    lost = stuck * _at_input(recording, held) / math.sqrt(3.0)

    def add(way: str, sign: float, value: float, error: float, *lines: BudgetLine) -> None:
        name = f"starting_torque{way}"
        value -= sign * turning
        half = math.hypot(factor * error, NORMAL_COVERAGE_FACTOR * math.hypot(moment, lost))
        budget = (
            BudgetLine("between ramps", "A", error, degrees_of_freedom=balance.freedom),
            BudgetLine("moment of first motion", "A", moment, "law of motion; rectangular"),
            *[BudgetLine("wind-up lost by stick-slip", "A", lost, "rectangular")] * (lost > 0.0),
            bearing.line(COULOMB, unknown),
            *lines,
            scale_line(recording, value),
        )
        estimates[name] = Estimate(
            name=name,
            value=value,
            unit="N m",
            low=value - half,
            high=value + half,
            note="motor + gear",
            budget=budget,
        )

    ways = {1: "_forward", -1: "_reverse"}
    if balance.direction:
        sign = balance.direction
        add(ways[sign], sign, sign * balance.friction, balance.error, zero.budget())
        return estimates
    for sign, way in ways.items():
        value = sign * balance.friction + balance.asymmetry
        add(way, sign, value, math.sqrt(2.0) * balance.error, zero.budget())
    add("", 1.0, balance.friction, balance.error)
    return estimates


def _at_rest(recording: Recording, bearing: OutputBearing) -> tuple[float, float]:
    """What the output bearing asks of the input before it turns and is taken off, and its standard uncertainty [N m];
    0 where the ratio is not known.
    """
    taken = bearing.coulomb if bearing.is_subtracted else 0.0
    return _at_input(recording, taken), _at_input(recording, bearing.coulomb_uncertainty)


def _at_input(recording: Recording, torque: float) -> float:
    """A torque of the output as the input feels it [N m]; 0 where the ratio is not known."""
    ratio = recording.metadata.ratio
    return torque / ratio if math.isfinite(ratio) and ratio > 0.0 else 0.0


def _metrics(ramps: list[Breakaway]) -> dict[str, float]:
    return {
        "ramps": float(len(ramps)),
        "largest_starting_torque": max(abs(b.torque) for b in ramps),
        "smallest_starting_torque": min(abs(b.torque) for b in ramps),
    }


def _plot(ramps: list[Breakaway], balance: Balance) -> Plot:
    direction, position, torque = np.array(
        [(b.direction, b.position, abs(b.torque)) for b in ramps]
    ).T
    y, spread = torque * 1e3, 1.96e3 * balance.scatter
    series = both_ways(direction, position / DEGREE, y, low=y - spread, high=y + spread)
    return Plot(
        name="starting-torque",
        title="No-load starting torque over wave-generator position",
        x_label="wave-generator angle [deg]",
        y_label="starting torque, motor + gear [mN m]",
        series=tuple(series),
    )


def _table(ramps: list[Breakaway]) -> Table:
    rows = tuple((b.position / DEGREE, b.direction, b.torque) for b in ramps)
    columns = ("position [deg]", "direction", "torque [N m]")
    return Table("starting-torque", "Starting torque per ramp", columns, rows)


EXPERIMENT = Experiment(
    name=NAME,
    title="No-load starting torque",
    summary="slow torque ramps at several wave-generator positions, ended by first motion",
    parameters=Parameters,
    plan=plan,
    analyse=analyse,
    needs=("input_angle", "torque"),
    quantities=QUANTITIES,
    version=5,
    live=("speed", "starting points", "torque"),
    setpoint="position",
    terms=(
        Term(
            "No-load starting torque",
            "Quasi-static torque at which the input begins to turn, with nothing on the output.",
        ),
        MOTOR_AND_GEAR,
    ),
)
