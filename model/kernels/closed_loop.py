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

# isort: off
# By name: an index that is a module's attribute may be negative for all that numba knows, and a step takes 5 % longer.
from model.kernels.loop_layout import (
    FILTER, FILTER_STEP, FINE, FORCE, GAIN, GUARD_GAIN, H, INTEGRAL, INTEGRAL_STEP, LATCH, LOAD, OFF, PERIOD_STEPS,
    PORT, PORT_STEP, PORT_STEP_FINE, RAMP, RATE_DOWN, RATE_QUICK_STOP, RATE_UP, SPEED, SPEED_LIMIT,
    STEP_MATRIX_SIZE, SWITCHED, TICK, TORQUE, TORQUE_FACTOR, TORQUE_LIMIT, W,
)  # fmt: skip

# isort: on
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
    limit = servo[TORQUE_LIMIT]
    speed = state[W]
    if mode == OFF:
        state[FILTER], state[INTEGRAL], state[RAMP] = 0.0, 0.0, speed
        return
    if mode == TORQUE:
        # The drive's own speed limit: a stiff proportional controller that can only take torque away.
        room = servo[GUARD_GAIN]
        upper = min(limit, max(room * (servo[SPEED_LIMIT] - speed), -limit))
        lower = max(-limit, min(room * (-servo[SPEED_LIMIT] - speed), limit))
        wanted = min(max(target, lower), upper)
        state[RAMP] = speed
        state[INTEGRAL] = wanted / servo[GAIN]
    else:
        goal, slower = 0.0, servo[RATE_QUICK_STOP]
        if mode == SPEED:
            goal = min(max(target, -servo[SPEED_LIMIT]), servo[SPEED_LIMIT])
            slower = servo[RATE_DOWN]
        ramp = state[RAMP]
        if goal >= ramp:
            reached = ramp + servo[RATE_UP] if ramp >= 0.0 else min(0.0, ramp + slower)
            ramp = min(goal, reached)
        else:
            reached = ramp - servo[RATE_UP] if ramp <= 0.0 else max(0.0, ramp - slower)
            ramp = max(goal, reached)
        state[RAMP] = ramp
        difference = ramp - speed
        summed = state[INTEGRAL] + servo[INTEGRAL_STEP] * difference
        wanted = servo[GAIN] * (difference + summed)
        if abs(wanted) > limit:
            wanted = math.copysign(limit, wanted)
            if wanted * difference < 0.0:
                state[INTEGRAL] = summed
        else:
            state[INTEGRAL] = summed
    state[FILTER] += servo[FILTER_STEP] * (wanted - state[FILTER])


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
    warmth = Warmth(1.0, 1.0, 1.0, 1.0, 1.0, physics[TORQUE_FACTOR])
    next_state = state[:8].copy()
    latch_step = int(physics[LATCH] / c.length) if whole else -1
    port, since, tick = state[PORT], state[SWITCHED], int(state[TICK])
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
                latch(rows, k, c, motion, mesh, physics[LATCH] - latch_step * c.length)
            if tick == 0:
                state[W] = motion.w
                _servo_reference(state, servo, mode, target)
                tick = int(servo[PERIOD_STEPS])
            tick -= 1
            w, reference = motion.w, state[FILTER]
            if whole and creeps(c, motion):
                again = True
                break
            stepped = step(
                c, physics, tables, matrix, next_state, warmth, motion, mesh, spring, drag, heat, reference,
                state[LOAD],
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
                heat = warmed(physics, heat, state[FILTER], substeps * c.length)
            k, n = k + 1, 0
    put_into(state, motion, mesh, spring, drag, heat)
    state[PORT], state[SWITCHED], state[TICK] = port, since, tick
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
    whole, part, lag = physics[H], physics[H] / FINE, physics[PORT_STEP_FINE]
    tables = Tables(error_table, friction_table, cogging_table)
    matrix = matrices[:STEP_MATRIX_SIZE].copy()
    part_matrix = matrices[STEP_MATRIX_SIZE:].copy()
    pace = Pace(whole, 0.25, physics[PORT_STEP], substeps, True)
    # The force of the whole step before leads the first part.
    first_pace = Pace(part, 0.25 / FINE, lag, 1, False)
    part_pace = Pace(part, 0.25, lag, FINE - 1, False)
    start = Place(0, 0)
    place = start
    while True:
        place = run(state, physics, servo, matrix, pace, tables, mode, targets, rows, place)
        if place.row == rows.shape[0]:
            return
        # In parts, so that what happens within the step happens where it belongs; the servo waits.
        tick = state[TICK]
        state[TICK] = 2.0 * FINE
        run(state, physics, servo, part_matrix, first_pace, tables, mode, targets, rows[:1], start)
        force = state[FORCE]
        run(state, physics, servo, part_matrix, part_pace, tables, mode, targets, rows[:1], start)
        state[FORCE], state[TICK] = force, tick
        place = Place(place.row, place.substep + 1)
