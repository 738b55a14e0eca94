"""Compensated error: what a run does."""

from __future__ import annotations

from collections.abc import Iterator

from experiments.errors import PlanError
from experiments.planning.parts import between_zeros, checked, longest, output_travel, ramp, stop
from experiments.planning.speeds import quiet_speed, refuse_speed
from experiments.protocols.compensated_error.declaration import NAME, Parameters
from experiments.steps.vocabulary import FollowTable, HoldRevolutions, SegmentLabel, Step
from model.compensation import CompensationTable, table_of_set
from model.compensation_file import compensation_from
from model.errors import ModelError
from model.gear import HarmonicDrive
from model.kinematic_error import output_sign

LEAST_SPEEDS = 3
"""So that it is seen where a table stops helping."""
FADE = 1.5
"""Input revolutions between the approach and a traverse along the table; in the first of them it is faded in."""
_ROOM = 0.1
"""Share of a traverse's time that it may take longer."""


def plan(parameters: Parameters, gear: HarmonicDrive) -> Iterator[Step]:
    """Torque zero; at every speed a whole output turn each way without the table and the same with it; torque zero."""
    checked(parameters, Parameters, NAME)
    if len(set(parameters.speeds_rpm)) < LEAST_SPEEDS:
        raise PlanError(
            "too few speeds: where the table stops helping would not be seen",
            where=f"{NAME}.speeds_rpm",
            value=", ".join(f"{s:g}" for s in parameters.speeds_rpm),
            limit=f">= {LEAST_SPEEDS} different ones",
        )
    for speed in parameters.speeds_rpm:
        refuse_speed(speed, gear, f"{NAME}.speeds_rpm")
    table = table_of(parameters, gear)
    return between_zeros(_turns(parameters, gear, table), parameters.zero_time)


def table_of(parameters: Parameters, gear: HarmonicDrive) -> CompensationTable:
    """The table that is driven by: the series of the parameter set where none is named. Raises `PlanError` for one that
    is none, and for one of another ratio or mounting.
    """
    table = _named(parameters)
    if table is None:
        # What the parameter set says of its gear: enough to plan by, and proved or refused as any other.
        return table_of_set(gear, parameters.mounting)  # type: ignore[arg-type]
    ratio = gear.mounted_ratio(parameters.mounting)  # type: ignore[arg-type]
    wrong = {
        "mounting": (table.mounting, parameters.mounting),
        "ratio": (table.ratio, ratio),
        "sense": (table.sense, round(output_sign(parameters.mounting))),  # type: ignore[arg-type]
    }
    for name, (its, mounted) in wrong.items():
        if its != mounted:
            raise PlanError(
                "is a table for another",
                where=f"{NAME}.table.{name}",
                value=its,
                limit=f"{mounted}, as the gear is mounted",
                remedy="Make a table from runs of this gear, as it is mounted.",
            )
    return table


def _named(parameters: Parameters) -> CompensationTable | None:
    """The table that the parameters name; None for none. Raises `PlanError` for a content that is no table."""
    if not parameters.table:
        return None
    try:
        table = compensation_from(parameters.table, f"{NAME}.table")
        for direction in (1.0, -1.0):
            _ = table.of(direction)
    except ModelError as error:
        raise PlanError(
            error.what, where=error.where, value=error.value, limit=error.limit, remedy=error.remedy
        ) from None
    return table


def refuse_gear(parameters: Parameters, serial: str) -> None:
    """Raise `PlanError` for a table that was made of another gear."""
    table = _named(parameters)
    if table is not None and table.gear != serial:
        raise PlanError(
            "is a table of another gear",
            where=f"{NAME}.table",
            value=repr(table.gear),
            limit=f"{serial!r}, which is mounted",
            remedy="Make a table from runs of this gear: rig compensate RUN... --output FILE.",
        )


def _turns(p: Parameters, gear: HarmonicDrive, table: CompensationTable) -> Iterator[Step]:
    travel = output_travel(gear, p.mounting, 1.0, NAME)
    for repeat in range(p.repeats):
        for rpm in p.speeds_rpm:
            speed = quiet_speed(
                rpm, gear, p.mounting, p.sync_rate, p.output_counts, f"{NAME}.speeds_rpm"
            )
            for is_compensated in (False, True):
                for direction in (1, -1):
                    setpoint = direction * speed
                    yield ramp(setpoint, p.acceleration, direction)
                    approach = SegmentLabel("approach", setpoint, direction, repeat)
                    at_most = longest(p.approach_revolutions, speed)
                    counted = longest(travel, speed, _ROOM)
                    # The drive has settled before a table is laid on it: how far it lags is part of where it is.
                    yield HoldRevolutions(p.approach_revolutions, at_most, approach)
                    if is_compensated:
                        fading = longest(FADE, speed)
                        yield FollowTable(FADE, setpoint, table, fading, 1.0, approach)
                        label = SegmentLabel("compensated", setpoint, direction, repeat)
                        yield FollowTable(travel, setpoint, table, counted, 0.0, label)
                    else:
                        label = SegmentLabel("traverse", setpoint, direction, repeat)
                        yield HoldRevolutions(travel, counted, label)
                    yield stop(p.acceleration)
