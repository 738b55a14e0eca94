"""No-load starting torque: the quasi-static torque at which the input begins to turn, at several
wave-generator positions.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le

from experiments.budget import budget_table, scale_line
from experiments.contract import Evidence, Experiment
from experiments.errors import AnalysisError, PlanError
from experiments.evidence import check_recording, check_settings, usable
from experiments.parameters import Help, Unit
from experiments.planning.parts import between_zeros, checked, stop
from experiments.planning.shared_parameters import Acceleration, Repeats, SlowSpeed, ZeroTime
from experiments.planning.speeds import refuse_speed
from experiments.quantity import Counterpart, Quantity
from experiments.recording import Recording, Segment
from experiments.result import Plot, Result, Table, both_ways, judge_upper
from experiments.steps.vocabulary import HoldTime, MoveToAngle, SegmentLabel, Step, TorqueRamp
from experiments.terms import MOTOR_AND_GEAR, Term
from experiments.torque.zero import TorqueZero, torque_zero
from model.gear import HarmonicDrive
from model.identify.estimate import BudgetLine, Estimate
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
QUANTITIES = (
    Quantity(
        name="starting_torque_{way}",
        title="starting torque {way}",
        unit="N m",
        shown="mN m",
        definition=_DEFINITION,
        conditions=_COMPARED_BY,
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
        is_key=True,
        is_watched=True,
        catalogue=_CATALOGUE,
    ),
    Quantity(name="ramps", title="ramps", unit="1"),
    Quantity(name="largest_starting_torque", title="largest starting torque", unit="N m"),
    Quantity(name="smallest_starting_torque", title="smallest starting torque", unit="N m"),
)


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """What a starting-torque run can be told."""

    positions: Annotated[
        int, Ge(1), Le(360), Unit(""), Help("wave-generator positions, evenly over a revolution")
    ] = 8
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
    ] = 3.0
    approach_rpm: SlowSpeed = 10.0
    acceleration: Acceleration = 50.0
    zero_time: ZeroTime = 3.0


def plan(parameters: Parameters, gear: HarmonicDrive) -> Iterator[Step]:
    """Torque zero; at every position forward and reverse a slow torque ramp, ended by first motion; torque zero."""
    checked(parameters, Parameters, NAME)
    refuse_speed(parameters.approach_rpm, gear, f"{NAME}.approach_rpm")
    peak = gear.ratings.repeated_peak_torque / gear.ratio
    if parameters.torque_limit > peak:
        raise PlanError(
            "the torque of the ramp could exceed the gear's repeated peak torque at the output",
            where=f"{NAME}.torque_limit",
            value=f"{parameters.torque_limit:g} N m",
            limit=f"<= {peak:.3g} N m (ratings.repeated_peak_torque / ratio)",
            remedy="Lower the limit of the ramp.",
        )
    return between_zeros(_ramps(parameters), parameters.zero_time)


def _ramps(p: Parameters) -> Iterator[Step]:
    slow = p.approach_rpm * RPM
    at_most = 5.0 * REVOLUTION / slow + 10.0
    for repeat in range(p.repeats):
        for index in range(p.positions):
            phase = REVOLUTION * index / p.positions
            for direction in (1, -1):
                yield MoveToAngle(
                    phase,
                    slow,
                    p.acceleration,
                    at_most,
                    SegmentLabel("position", phase, direction, repeat),
                )
                yield HoldTime(0.3, SegmentLabel("rest", phase, direction, repeat))
                label = SegmentLabel("torque-ramp", phase, direction, repeat)
                yield TorqueRamp(direction * p.rate, p.torque_limit, p.motion_deg * DEGREE, label)
                yield stop(p.acceleration)


FIRST_MOTION = 0.2 * DEGREE
"""Input angle that counts as motion; less is the elastic wind-up of gear and grease, or counts flickering."""


@dataclass(frozen=True)
class Breakaway:
    """One ramp: wave-generator position [rad], direction, torque at first motion [N m] and its standard error."""

    position: float
    direction: int
    torque: float
    standard_error: float


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
    estimates = _estimates(recording, ramps, zero)
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
        metrics=_metrics(ramps),
        warnings=tuple(warnings),
        verdicts=tuple(verdicts),
        plots=(_plot(ramps),),
        tables=(_table(ramps), budget_table(estimates.values())),
        options={"torque_is_of": "motor + gear"},
    )


def _breakaway(recording: Recording, segment: Segment, zero: TorqueZero) -> Breakaway | None:
    good = usable(recording, segment)
    angle = recording.si("input_angle", segment)[good]
    time = recording.time(segment)[good]
    if len(angle) < 20:
        return None
    torque = recording.si("torque", segment)[good] - zero.at(time)
    threshold = max(FIRST_MOTION, 3.0 * recording.signals["input_angle"].quantum)
    moved = np.flatnonzero(np.abs(angle - angle[:5].mean()) > threshold)
    if not len(moved) or moved[0] < 10:
        return None
    at = int(moved[0])
    # First motion is an acceleration from rest: the break-away lies before the threshold by the
    # time it takes to get there.
    back = max(at - max(at // 3, 10), 0)
    quiet = np.flatnonzero(np.abs(angle[back:at] - angle[back]) <= 0.25 * threshold)
    stop = back + int(quiet[-1]) + 1 if len(quiet) else at
    start = max(stop - max(stop // 2, 10), 0)
    x = time[start:stop] - time[stop - 1]
    line, covariance = (
        np.polyfit(x, torque[start:stop], 1, cov=True)
        if stop - start > 4
        else (np.array([0.0, torque[at]]), np.eye(2))
    )
    return Breakaway(
        segment.setpoint, segment.direction, float(line[1]), math.sqrt(float(covariance[1, 1]))
    )


def _estimates(
    recording: Recording, ramps: list[Breakaway], zero: TorqueZero
) -> dict[str, Estimate]:
    """Mean over positions, each direction; half-difference of the directions, in which the torque zero cancels."""
    estimates: dict[str, Estimate] = {}
    means: dict[int, tuple[float, float]] = {}
    for direction, name in ((1, "starting_torque_forward"), (-1, "starting_torque_reverse")):
        values = np.array([b.torque for b in ramps if b.direction == direction])
        if not len(values):
            continue
        error = (
            float(values.std(ddof=1)) / math.sqrt(len(values))
            if len(values) > 1
            else ramps[0].standard_error
        )
        means[direction] = (float(values.mean()), error)
        half = student_quantile(len(values) - 1) * error
        budget = (
            BudgetLine("between positions", "A", error),
            zero.budget(),
            scale_line(recording, values.mean()),
        )
        estimates[name] = Estimate(
            name=name,
            value=float(values.mean()),
            unit="N m",
            low=float(values.mean()) - half,
            high=float(values.mean()) + half,
            budget=budget,
        )
    if len(means) == 2:
        value = 0.5 * (means[1][0] - means[-1][0])
        error = 0.5 * math.hypot(means[1][1], means[-1][1])
        half = (
            student_quantile(min(sum(b.direction == d for b in ramps) for d in (1, -1)) - 1) * error
        )
        budget = (BudgetLine("between positions", "A", error), scale_line(recording, value))
        estimates["starting_torque"] = Estimate(
            name="starting_torque",
            value=value,
            unit="N m",
            low=value - half,
            high=value + half,
            identifiable="yes",
            note="motor + gear",
            budget=budget,
        )
    return estimates


def _metrics(ramps: list[Breakaway]) -> dict[str, float]:
    return {
        "ramps": float(len(ramps)),
        "largest_starting_torque": max(abs(b.torque) for b in ramps),
        "smallest_starting_torque": min(abs(b.torque) for b in ramps),
    }


def _plot(ramps: list[Breakaway]) -> Plot:
    direction, position, torque, error = np.array(
        [(b.direction, b.position, abs(b.torque), b.standard_error) for b in ramps]
    ).T
    y, spread = torque * 1e3, 1.96e3 * error
    series = both_ways(direction, position / DEGREE, y, low=y - spread, high=y + spread)
    return Plot(
        name="starting-torque",
        title="No-load starting torque over wave-generator position",
        x_label="wave-generator angle [deg]",
        y_label="starting torque, motor + gear [mN m]",
        series=tuple(series),
    )


def _table(ramps: list[Breakaway]) -> Table:
    rows = tuple((b.position / DEGREE, b.direction, b.torque, b.standard_error) for b in ramps)
    columns = ("position [deg]", "direction", "torque [N m]", "standard error [N m]")
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
    version=2,
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
