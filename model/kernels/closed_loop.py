"""The compiled closed loop: servo, rotor, wedge, mesh, output, and everything that makes a real one worse.

`run` takes equal steps, `advance` whole SYNC cycles of them. The linear part of a substep is exact (one of the matrix
exponential, first-order hold on the wedge's error, constant torques); friction is an exact scalar prox on the rotor and
one on the output. A step in which the rotor or the output begins or ceases to stick, or the rotor speeds through the
steep part of the Stribeck curve, is taken again in `FINE` parts, so that it happens where it belongs and not at the
step's end. What a step does is in `loop_step`, where each number lies in `loop_layout`.
"""

from __future__ import annotations

import math

from model.arrays import FloatArray
from model.kernels import loop_layout as at
from model.kernels.loop_step import (
    Heat,
    Pace,
    Place,
    Tables,
    Warmth,
    constants,
    creeps,
    latch,
    put_into,
    step,
    taken_from,
    warmed,
    warmth_of,
    write_row,
)
from model.kernels.loop_tables import compiled


@compiled
def _servo_reference(state: FloatArray, servo: FloatArray, mode: int, target: float) -> None:
    """One servo period: the filtered torque reference of the drive from its set-point; carries ramp and integral."""
    limit = servo[at.TORQUE_LIMIT]
    speed = state[at.W]
    if mode == at.OFF:
        state[at.FILTER], state[at.INTEGRAL], state[at.RAMP] = 0.0, 0.0, speed
        return
    if mode == at.TORQUE:
        # The drive's own speed limit: a stiff proportional controller that can only take torque away.
        room = servo[at.GUARD_GAIN]
        upper = min(limit, max(room * (servo[at.SPEED_LIMIT] - speed), -limit))
        lower = max(-limit, min(room * (-servo[at.SPEED_LIMIT] - speed), limit))
        wanted = min(max(target, lower), upper)
        state[at.RAMP] = speed
        state[at.INTEGRAL] = wanted / servo[at.GAIN]
    else:
        goal, slower = 0.0, servo[at.RATE_QUICK_STOP]
        if mode == at.SPEED:
            goal = min(max(target, -servo[at.SPEED_LIMIT]), servo[at.SPEED_LIMIT])
            slower = servo[at.RATE_DOWN]
        ramp = state[at.RAMP]
        if goal >= ramp:
            reached = ramp + servo[at.RATE_UP] if ramp >= 0.0 else min(0.0, ramp + slower)
            ramp = min(goal, reached)
        else:
            reached = ramp - servo[at.RATE_UP] if ramp <= 0.0 else max(0.0, ramp - slower)
            ramp = max(goal, reached)
        state[at.RAMP] = ramp
        difference = ramp - speed
        summed = state[at.INTEGRAL] + servo[at.INTEGRAL_STEP] * difference
        wanted = servo[at.GAIN] * (difference + summed)
        if abs(wanted) > limit:
            wanted = math.copysign(limit, wanted)
            if wanted * difference < 0.0:
                state[at.INTEGRAL] = summed
        else:
            state[at.INTEGRAL] = summed
    state[at.FILTER] += servo[at.FILTER_STEP] * (wanted - state[at.FILTER])


@compiled
def run(
    state: FloatArray, physics: FloatArray, servo: FloatArray, matrix: FloatArray, pace: Pace, tables: Tables,
    mode: int, targets: FloatArray, rows: FloatArray, begun: Place,
) -> Place:  # fmt: skip
    """Steps of one length from a place on; the place at which it left off.

    Whole steps end at one that has to be taken in parts, which is left undone, or behind the last row. Parts of one
    write no row, ask no servo and settle no heat. `pace` and `matrix` are the same for all steps of a call: a loop in
    which they could change takes half as long again.
    """
    substeps, whole = pace.substeps, pace.whole
    c = constants(physics, matrix, pace, tables.cogging)
    motion, mesh, spring, drag, heat = taken_from(state)
    warmth = Warmth(1.0, 1.0, 1.0, 1.0, 1.0, physics[at.TORQUE_FACTOR])
    next_state = state[:8].copy()
    latch_step = int(physics[at.LATCH] / c.length) if whole else -1
    port, since, tick = state[at.PORT], state[at.SWITCHED], int(state[at.TICK])
    k, n, again = begun.row, begun.substep, False
    while k < rows.shape[0] and not again:
        if whole and n == 0:
            write_row(rows, k, state, physics, motion, mesh, spring, heat, port, c.per_radius)
            heat = Heat(0.0, 0.0, heat.housing_temperature, heat.motor_temperature)
        if c.warming:
            warmth = warmth_of(physics, heat)
        target = targets[k]
        while n < substeps:
            if n == latch_step:
                latch(rows, k, c, motion, mesh, physics[at.LATCH] - latch_step * c.length)
            if tick == 0:
                state[at.W] = motion.w
                _servo_reference(state, servo, mode, target)
                tick = int(servo[at.PERIOD_STEPS])
            tick -= 1
            w, reference = motion.w, state[at.FILTER]
            if whole and creeps(c, motion):
                again = True
                break
            stepped = step(
                c, physics, tables, matrix, next_state, warmth, motion, mesh, spring, drag, heat, reference,
                state[at.LOAD],
            )  # fmt: skip
            turned, again = stepped[5], whole and stepped[6]
            if again:
                break
            motion, mesh, spring, drag, heat = stepped[:5]
            # A rotor that lets go does so where its step begins.
            if turned:
                since = 0.0
            if not turned or w == 0.0:
                since += c.length
            port += c.port_step * (reference - port)
            n += 1
        if not again:
            if c.warming and whole:
                heat = warmed(physics, heat, state[at.FILTER], substeps * c.length)
            k, n = k + 1, 0
    put_into(state, motion, mesh, spring, drag, heat)
    state[at.PORT], state[at.SWITCHED], state[at.TICK] = port, since, tick
    return Place(k, n)


@compiled
def advance(
    state: FloatArray,
    physics: FloatArray,
    servo: FloatArray,
    matrices: FloatArray,
    error_table: FloatArray,
    friction_table: FloatArray,
    cogging_table: FloatArray | None,
    mode: int,
    targets: FloatArray,
    substeps: int,
    rows: FloatArray,
) -> None:
    """Run one SYNC cycle of `substeps` per row of `rows` (n, ROW_SIZE), filled with what is true at each SYNC.

    `targets` (n,) acts from its row on; `error_table` (points, 4) holds cubic pieces of e over one period of the wedge;
    `friction_table` (points, 4) mesh dry, mesh viscous, bearing, wind-up over sqrt(|w|); `cogging_table` (points + 2,)
    the cogging torque, or None where nothing but the published model acts. `matrices` holds that of a step and that of
    one of its `FINE` parts.
    """
    whole, part, lag = physics[at.H], physics[at.H] / at.FINE, physics[at.PORT_STEP_FINE]
    tables = Tables(error_table, friction_table, cogging_table)
    matrix = matrices[: at.STEP_MATRIX_SIZE].copy()
    part_matrix = matrices[at.STEP_MATRIX_SIZE :].copy()
    pace = Pace(whole, 0.25, physics[at.PORT_STEP], substeps, True)
    # The force of the whole step before leads the first part.
    first_pace = Pace(part, 0.25 / at.FINE, lag, 1, False)
    part_pace = Pace(part, 0.25, lag, at.FINE - 1, False)
    start = Place(0, 0)
    place = start
    while True:
        place = run(state, physics, servo, matrix, pace, tables, mode, targets, rows, place)
        if place.row == rows.shape[0]:
            return
        # In parts, so that what happens within the step happens where it belongs; the servo waits.
        tick = state[at.TICK]
        state[at.TICK] = 2.0 * at.FINE
        run(state, physics, servo, part_matrix, first_pace, tables, mode, targets, rows[:1], start)
        force = state[at.FORCE]
        run(state, physics, servo, part_matrix, part_pace, tables, mode, targets, rows[:1], start)
        state[at.FORCE], state[at.TICK] = force, tick
        place = Place(place.row, place.substep + 1)
