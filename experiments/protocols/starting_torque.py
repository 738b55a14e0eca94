"""No-load starting torque: the quasi-static torque at which the input begins to turn, at several
wave-generator positions.
"""

from __future__ import annotations

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
from experiments.quantity import Counterpart, Quantity
from experiments.recording import Recording, Segment
from experiments.result import Plot, Result, Table, both_ways, judge_upper
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
    "quasi-static torque at which the input begins to turn, nothing on the output; mean over "
    "wave-generator positions"
)
_COMPARED_BY = ("part", "mounting", "torque of", "channel", "ramp")
_CATALOGUE = Counterpart(
    rating="starting_torque",
    definition="quasi-static torque at which the input begins to turn, nothing on the output",
    conditions="nothing on the output, housing at 20 °C, the unit's own grease",
)
TARGET = 0.01
TARGET_REASON = "a tenth of what catalogues state for this size, 0.08 to 0.15 N m"
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
    ),
    Quantity(name="ramps", title="ramps", unit="1"),
    Quantity(name="scatter_of_one_ramp", title="scatter of one ramp", unit="N m"),
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
    turns = max(round(gear.ratio / p.positions), 1)
    for repeat in range(p.repeats):
        for way in (1, -1):
            yield _travel(p, way * max(turns, LEAST_APPROACH), repeat)
            for place, phase in enumerate(_phases(p.positions)[::way]):
                if place:
                    yield _travel(p, way * turns, repeat)
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


def _phases(positions: int) -> list[float]:
    """Wave-generator angles [rad] in the order of a forward sweep."""
    step = next(
        s
        for s in range(max(round(STEP_SHARE * positions), 1), 0, -1)
        if math.gcd(s, positions) == 1
    )
    return [REVOLUTION * ((k * step) % positions) / positions for k in range(positions)]


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
HIGHEST_ORDER = 6
"""Orders of the input, and a third as many of the output, that are told from noise where there are
positions enough."""


@dataclass(frozen=True)
class Breakaway:
    """One ramp: wave-generator position [rad], direction, torque at first motion [N m], input angle there [rad];
    how far the torque rose while it is not known whether motion had begun, half of it [N m]."""

    position: float
    direction: int
    torque: float
    angle: float
    within: float


@dataclass(frozen=True, kw_only=True)
class Balance:
    """What all ramps say together: friction [N m], which has the sign of the direction; asymmetry,
    which has not; their covariance [(N m)^2] with its degrees of freedom; scatter of one ramp [N m].

    `asymmetry` is 0 and not known where there is one direction only.
    """

    friction: float
    asymmetry: float
    covariance: FloatArray
    freedom: float
    scatter: float

    def torque(self, direction: int) -> tuple[float, float]:
        """Mean torque of one direction and its standard error [N m]."""
        weights = np.array([direction, 1.0])
        return (
            direction * self.friction + self.asymmetry,
            math.sqrt(float(weights @ self.covariance @ weights)),
        )


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """No-load starting torque by direction and position: the torque at which the input begins to turn.

    The torque is read from a straight line through the last part of the ramp before first motion,
    so that noise of the port does not enter. It is that of motor + gear: a motor tare at running
    speeds does not tell the motor's own breakaway.
    """
    check_settings(evidence.settings, (), NAME)
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
    balance = _balance(ramps, recording.metadata.ratio, recording.metadata.run_id)
    estimates = _estimates(recording, ramps, balance, zero)
    verdicts = []
    if "starting_torque" in estimates:
        origin = evidence.gear.value("ratings.starting_torque")
        definition = (
            "quasi-static torque at which the input begins to turn, nothing on the "
            "output; mean of both directions"
        )
        verdicts.append(
            judge_upper(
                "no-load starting torque",
                definition,
                estimates["starting_torque"],
                origin.value,
                origin.origin.provenance,
                origin.origin.source,
            )
        )
    warnings.append(
        "The starting torque is that of motor + gear: the motor's own breakaway is not known."
    )
    return Result(
        run=recording.metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates=estimates,
        metrics={**_metrics(ramps), "scatter_of_one_ramp": balance.scatter},
        warnings=tuple(warnings),
        verdicts=tuple(verdicts),
        plots=(_plot(ramps, balance),),
        tables=(_table(ramps), budget_table(estimates.values())),
        options={"torque_is_of": "motor + gear"},
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
    return Breakaway(segment.setpoint, segment.direction, float(level), rest, within)


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


def _balance(ramps: list[Breakaway], ratio: float, run: str) -> Balance:
    """Least squares over all ramps: friction and asymmetry, each with its pattern over input and output angle.

    A pattern is no scatter: over evenly spread positions it cancels in the mean, so it is taken out
    of the residual, as far as the positions tell it from the mean.
    """
    direction = np.array([b.direction for b in ramps], dtype=np.float64)
    both = len(set(direction)) == 2
    design = _design(ramps, ratio, direction, both)
    freedom = len(ramps) - design.shape[1]
    if freedom < 1:
        raise AnalysisError(
            "too few ramps moved the input to tell their scatter",
            where=run,
            value=len(ramps),
            limit=f">= {design.shape[1] + 1}",
            remedy="Raise the limit of the ramp, or take more positions.",
        )
    torque = np.array([b.torque for b in ramps])
    values, _, _, _ = np.linalg.lstsq(design, torque)
    residual = torque - design @ values
    variance = float(residual @ residual) / freedom
    covariance = np.zeros((2, 2))
    place = slice(0, 2 if both else 1)
    covariance[place, place] = variance * np.linalg.inv(design.T @ design)[place, place]
    return Balance(
        friction=float(values[0]),
        asymmetry=float(values[1]) if both else 0.0,
        covariance=covariance,
        freedom=float(freedom),
        scatter=math.sqrt(variance),
    )


def _design(ramps: list[Breakaway], ratio: float, direction: FloatArray, both: bool) -> FloatArray:
    """Columns of the balance: friction, asymmetry, then the waves of each; as many orders as the positions tell."""
    angle = np.array([b.angle for b in ramps])
    least = int(min((direction == d).sum() for d in set(direction)))
    highest = min(HIGHEST_ORDER, max(0, (least - 5) // 3))
    inner = [float(n) for n in range(1, highest + 1)]
    outer = [k / ratio for k in range(1, highest // 3 + 1)]
    design = np.empty((0, 0))
    for orders in ([*inner, *outer], inner, []):
        waves = [math.sqrt(2.0) * f(n * angle) for n in orders for f in (np.cos, np.sin)]
        base = [np.ones(len(ramps)), *waves]
        pairs = [(direction * c, c) if both else (direction * c,) for c in base]
        design = np.column_stack([column for pair in pairs for column in pair])
        if np.linalg.cond(design) <= LARGEST_CONDITION:
            break
    return design


def _estimates(
    recording: Recording, ramps: list[Breakaway], balance: Balance, zero: TorqueZero
) -> dict[str, Estimate]:
    """Mean over positions, each direction; half-difference of the directions, in which the torque zero cancels."""
    estimates: dict[str, Estimate] = {}
    directions = {b.direction for b in ramps}
    factor = student_quantile(balance.freedom)
    # The same laws of motion are laid through all ramps, so that their error does not average.
    moment = float(np.mean([b.within for b in ramps])) / math.sqrt(3.0)

    def add(name: str, value: float, error: float, *lines: BudgetLine) -> None:
        half = math.hypot(factor * error, NORMAL_COVERAGE_FACTOR * moment)
        budget = (
            BudgetLine("between ramps", "A", error, degrees_of_freedom=balance.freedom),
            BudgetLine("moment of first motion", "A", moment, "law of motion; rectangular"),
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

    for direction, way in ((1, "forward"), (-1, "reverse")):
        if direction in directions:
            add(f"starting_torque_{way}", *balance.torque(direction), zero.budget())
    if len(directions) == 2:
        add("starting_torque", balance.friction, math.sqrt(float(balance.covariance[0, 0])))
    return estimates


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
    version=3,
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
