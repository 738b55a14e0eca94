"""No-load running torque and friction: what a run does."""

from __future__ import annotations

from collections.abc import Iterator

from experiments.errors import PlanError
from experiments.planning.parts import (
    between_zeros,
    checked,
    longest,
    ramp,
    stop,
    whole_revolutions,
    window_of,
)
from experiments.planning.speeds import (
    clear_of_resonances,
    incommensurate,
    log_speeds,
    near_resonance,
    refuse_speed,
    resonance_speeds,
)
from experiments.protocols.friction.declaration import NAME, Parameters
from experiments.steps.vocabulary import (
    HoldRevolutions,
    HoldTime,
    Mark,
    MoveRevolutions,
    SegmentLabel,
    Settle,
    Step,
)
from model.gear import HarmonicDrive
from model.units import DEGREE, RPM

_GOLDEN_STEP = 0.6180339887498949
"""Output revolutions between the start positions of successive speeds: neighbouring speeds lie far
apart on the output, any
number of positions is spread evenly, and none repeats."""

WIND_UP = 30.0 * DEGREE
"""Input angle of the set-point within which friction winds the gear up after a reversal (hysteresis of 1 arcmin is
2 degrees at the input), and a speed loop builds up the torque that breaks a sticking gear loose (16 degrees were seen).
"""


def plan(parameters: Parameters, gear: HarmonicDrive) -> Iterator[Step]:
    """Torque zero; at every speed a new start position, both directions, settle, whole revolutions; torque zero."""
    checked(parameters, Parameters, NAME)
    speeds = sweep_speeds(parameters, gear)
    for name in ("bracket_rpm", "move_rpm"):
        refuse_speed(getattr(parameters, name), gear, f"{NAME}.{name}")
    return between_zeros(_sweeps(parameters, gear, speeds), parameters.zero_time)


def sweep_speeds(p: Parameters, gear: HarmonicDrive, name: str = NAME) -> tuple[float, ...]:
    """The input speeds [rad/s], ascending: as given or log-spaced, then moved off SYNC ratios and resonances.

    `name` of the protocol stands in refusals.
    """
    if not p.speeds_rpm and p.highest_rpm < p.lowest_rpm:
        raise PlanError(
            "the highest speed is below the lowest",
            where=f"{name}.highest_rpm",
            value=f"{p.highest_rpm:g} r/min",
            limit=f">= {p.lowest_rpm:g} r/min",
        )
    wanted, where = sorted(p.speeds_rpm), f"{name}.speeds_rpm"
    if not wanted:
        wanted = log_speeds(p.lowest_rpm, p.highest_rpm, p.points)
        where = f"{name}.highest_rpm"
    for rpm in wanted:
        refuse_speed(rpm, gear, where)
    low, high = wanted[0] * RPM, wanted[-1] * RPM
    resonances = resonance_speeds(gear)
    moved = (
        clear_of_resonances(rpm * RPM, resonances, p.resonance_band, low, high) for rpm in wanted
    )
    ceiling = gear.ratings.maximum_input_speed
    return tuple(incommensurate(w, p.sync_rate, p.measure_time, ceiling=ceiling) for w in moved)


def _sweeps(p: Parameters, gear: HarmonicDrive, speeds: tuple[float, ...]) -> Iterator[Step]:
    resonances = resonance_speeds(gear)
    for speed in speeds:
        order = near_resonance(speed, resonances, p.resonance_band)
        if order is not None:
            text = (
                f"{speed / RPM:.4g} r/min lies where order {order:g} meets the first torsional mode"
            )
            yield Mark("near-resonance", text)
    position = 0
    ways = [speeds, speeds[::-1]][: 1 + p.up_and_down]
    for sweep, ordered in enumerate(ways * p.repeats):
        yield from _bracket(p, sweep)
        for index, speed in enumerate(ordered):
            yield _start_position(p, gear, position)
            position += 1
            for direction in (1, -1):
                yield from constant_speed(p, direction * speed, "hold", sweep)
            if (index + 1) % p.bracket_every == 0 or index + 1 == len(ordered):
                yield from _bracket(p, sweep)


def _bracket(p: Parameters, sweep: int) -> Iterator[Step]:
    reference = incommensurate(p.bracket_rpm * RPM, p.sync_rate, p.measure_time)
    for direction in (1, -1):
        yield from constant_speed(p, direction * reference, "bracket", sweep)


def _start_position(p: Parameters, gear: HarmonicDrive, position: int) -> Step:
    """A move by a golden part of the output revolution, forward or back so that the output stays within one."""
    here, there = ((_GOLDEN_STEP * k) % 1.0 for k in (position, position + 1))
    turns = (there - here) * gear.ratio
    speed = p.move_rpm * RPM
    return MoveRevolutions(
        turns, speed, p.acceleration, longest(abs(turns), speed) + 5.0, SegmentLabel("position")
    )


def constant_speed(p: Parameters, setpoint: float, label: str, repeat: int) -> Iterator[Step]:
    """One point: ramp, settle, whole revolutions at a constant signed speed [rad/s], stop."""
    direction, speed = (1 if setpoint > 0.0 else -1), abs(setpoint)
    yield ramp(setpoint, p.acceleration, direction)
    settle = SegmentLabel("settle", setpoint, direction, repeat)
    window = window_of(speed, p.settle_time)
    if window > 2.0 * p.settle_time:
        # A revolution takes longer than any transient: waiting for equal whole turns would double the run for nothing.
        yield HoldTime(max(2.0 * p.settle_time, WIND_UP / speed), settle)
    else:
        yield Settle(window, p.settle_tolerance, 6.0 * window, settle)
    turns = whole_revolutions(speed, p.measure_time)
    yield HoldRevolutions(
        turns, longest(turns, speed), SegmentLabel(label, setpoint, direction, repeat)
    )
    yield stop(p.acceleration)
