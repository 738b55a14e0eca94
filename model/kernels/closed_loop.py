"""The compiled closed loop: servo, rotor, wedge, mesh, output, and everything that makes a real one worse.

`run` takes equal steps, `advance` whole SYNC cycles of them. The linear part of a substep is exact (one of the matrix
exponential, first-order hold on the wedge's error, constant torques); friction is an exact scalar prox on the rotor and
one on the output. A step in which the rotor or the output begins or ceases to stick, or the rotor speeds through the
steep part of the Stribeck curve, is taken again in `FINE` parts, so that it happens where it belongs and not at the
step's end. The whole state is one array, so that a copy of it is a snapshot. Indices are named here and used by
`model.closed_loop`.
"""

from __future__ import annotations

import math

from model.arrays import FloatArray
from model.kernels.loop_tables import cogging_at, compiled, error_at, friction_at

# State. W..UO are the linear part: speeds absolute, displacements relative to the rigid gear (x2 - lambda theta, ...).
(
    W,
    R2,
    V2,
    R1,
    U1,
    RO,
    UO,
    THETA,
    ERROR,
    SLOPE,
    INTEGRAL,
    FILTER,
    TICK,
    RAMP,
    PORT,
    FRICTION,
    WINDUP,
    HYSTERESIS,
    TORSION,
    HOUSING,
    MOTOR,
    ACCELERATION,
    OUTPUT_ACCELERATION,
    OUTPUT_FRICTION,
    LOAD,
    WEDGE,
    EXTRA,
    FORCE,
    SWITCHED,
    CYCLES,
    HOUSING_SUM,
    MOTOR_SUM,
    GEAR_HEAT,
    MOTOR_HEAT,
) = range(34)
STATE_SIZE = 34

# Physics.
(
    H,
    LAMBDA,
    INVERSE_RATIO,
    RADIUS,
    TANGENT,
    K_B,
    C_B,
    ERROR_TURNS,
    ERROR_POINTS,
    FRICTION_SCALE,
    FRICTION_LAST,
    MOTOR_COULOMB,
    MOTOR_VISCOUS,
    BEARING_LOW,
    DEPTH,
    KINK_1,
    KINK_2,
    EXTRA_2,
    EXTRA_3,
    HYSTERESIS_STIFFNESS,
    HYSTERESIS_LIMIT,
    OUTPUT_COULOMB,
    OUTPUT_VISCOUS,
    PORT_STEP,
    TORQUE_FACTOR,
    TORQUE_PER_KELVIN,
    COULOMB_PER_KELVIN,
    VISCOUS_PER_KELVIN,
    MOTOR_PER_KELVIN,
    AMBIENT,
    HOUSING_REFERENCE,
    MOTOR_REFERENCE,
    HOUSING_STEP,
    MOTOR_STEP,
    HOUSING_LOSS,
    MOTOR_LOSS,
    COUPLING,
    COPPER,
    COGGING_POINTS,
    ELASTIC,
    CUP,
    OUTPUT_PER_KELVIN,
    PORT_STEP_FINE,
    CREEP,
    LATCH,
    PLAY,
    SPRING,
) = range(47)
PHYSICS_SIZE = 47

# Servo: gains and limits that a drive can be told; rates are per servo period.
(
    GAIN,
    INTEGRAL_STEP,
    FILTER_STEP,
    PERIOD_STEPS,
    TORQUE_LIMIT,
    SPEED_LIMIT,
    RATE_UP,
    RATE_DOWN,
    RATE_QUICK_STOP,
    GUARD_GAIN,
) = range(10)
SERVO_SIZE = 10

OFF, SPEED, TORQUE, QUICK_STOP = 0, 1, 2, 3

# Columns of a row: what is true at a SYNC instant, before this cycle's set-point acts; the output `LATCH` later.
(
    ROW_INPUT_ANGLE,
    ROW_INPUT_SPEED,
    ROW_INPUT_ACCELERATION,
    ROW_OUTPUT_ANGLE,
    ROW_OUTPUT_SPEED,
    ROW_OUTPUT_ACCELERATION,
    ROW_TORQUE_REFERENCE,
    ROW_PORT_TORQUE,
    ROW_FRICTION,
    ROW_WEDGE_TORQUE,
    ROW_WINDUP_TORQUE,
    ROW_SPEED_REFERENCE,
    ROW_HOUSING,
    ROW_MOTOR,
) = range(14)
ROW_SIZE = 14

# Rows of the step matrix: the seven linear states, then the inputs; eight columns: the states and
# the increment of theta.
STEP_TORQUE, STEP_ERROR_START, STEP_ERROR_END, STEP_OUTPUT = 7, 8, 9, 10
_STEP_SIZE = 88
FINE = 64
"""Parts in which a step is taken again. The step array holds the matrix of a step, then that of a part."""
STEADY = 0.05
"""Share of itself by which a creeping speed may change within a step: friction is taken in its middle."""


@compiled
def _servo_reference(state: FloatArray, servo: FloatArray, mode: int, target: float) -> None:
    """One servo period: the filtered torque reference of the drive from its set-point; carries ramp and integral."""
    limit = servo[TORQUE_LIMIT]
    speed = state[W]
    if mode == TORQUE:
        # The drive's own speed limit: a stiff proportional controller that can only take torque away.
        room = servo[GUARD_GAIN]
        upper = min(limit, max(room * (servo[SPEED_LIMIT] - speed), -limit))
        lower = max(-limit, min(room * (-servo[SPEED_LIMIT] - speed), limit))
        wanted = min(max(target, lower), upper)
        state[RAMP] = speed
        state[INTEGRAL] = wanted / servo[GAIN]
    else:
        goal = min(max(target, -servo[SPEED_LIMIT]), servo[SPEED_LIMIT]) if mode == SPEED else 0.0
        ramp = state[RAMP]
        slower = servo[RATE_DOWN] if mode == SPEED else servo[RATE_QUICK_STOP]
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
def _hardened(physics: FloatArray, torsion: float) -> float:
    """Torque beyond the linear stiffness at a torsion of the gear: none within the play, K2 above T1, K3 above T2."""
    size, extra = abs(torsion), 0.0
    if physics[PLAY] > 0.0:
        extra = -physics[SPRING] * min(size, physics[PLAY])
        size -= physics[PLAY]
    if size > physics[KINK_1]:
        extra += physics[EXTRA_2] * (size - physics[KINK_1])
        if size > physics[KINK_2]:
            extra += physics[EXTRA_3] * (size - physics[KINK_2])
    return extra if torsion > 0.0 else -extra


@compiled
def dahl(physics: FloatArray, torque: float, moved: float) -> float:
    """The torque of the hysteresis element after a movement: dT = sigma (1 - T sgn(d)/T_h) d (Dahl 1968)."""
    limit = physics[HYSTERESIS_LIMIT]
    pull = 1.0 - math.copysign(torque / limit, torque * moved)
    return min(max(torque + physics[HYSTERESIS_STIFFNESS] * moved * pull, -limit), limit)


@compiled
def run(
    state: FloatArray, physics: FloatArray, servo: FloatArray, matrix: FloatArray, pace: tuple[float, float, float],
    tables: tuple[FloatArray, FloatArray], cogging_table: FloatArray | None, mode: int, targets: FloatArray,
    substeps: int, rows: FloatArray, first: int, begun: int, whole: bool,
) -> tuple[int, int]:  # fmt: skip
    """Steps of one length from substep `begun` of row `first` on; the row and the substep at which it left off.

    Whole steps (`whole`) end at one that has to be taken in parts, which is left undone, or behind the last row. Parts
    of one write no row, ask no servo and settle no heat. `pace`: the length of a step, the lead of the wedge's force in
    it, and the share of the port's lag. They and `matrix` are the same for all steps of a call: a loop in which they
    could change takes half as long again. Without a `cogging_table` the published model with its servo turns: what only
    a worse rig has is not compiled into it.
    """
    h, lead, port_step = pace
    error_table, friction_table = tables
    lift, inverse_ratio, radius = physics[LAMBDA], physics[INVERSE_RATIO], physics[RADIUS]
    tangent, k_b, c_b = physics[TANGENT], physics[K_B], physics[C_B]
    turns, points = physics[ERROR_TURNS], physics[ERROR_POINTS]
    last_friction = int(physics[FRICTION_LAST])
    period = int(servo[PERIOD_STEPS])
    next_state = state[:8].copy()
    # Not a constant, so that the loops over it become SIMD instead of being unrolled.
    width = next_state.size
    cogging, elastic, hysteretic, output_friction, warming = 0.0, False, False, False, False
    if cogging_table is not None:
        cogging = physics[COGGING_POINTS]
        elastic, hysteretic = physics[ELASTIC] > 0.0, physics[HYSTERESIS_LIMIT] > 0.0
        output_friction = physics[OUTPUT_COULOMB] > 0.0 or physics[OUTPUT_VISCOUS] > 0.0
        warming = physics[HOUSING_STEP] > 0.0
    dry_factor, viscous_factor, bearing_factor, motor_factor = 1.0, 1.0, 1.0, 1.0
    torque_factor, output_factor = physics[TORQUE_FACTOR], 1.0
    per_radius, per_step = 1.0 / radius, 1.0 / h
    per_lift = 1.0 / lift if lift > 0.0 else 0.0
    rotor, per_output = matrix[8 * STEP_TORQUE], 1.0 / matrix[8 * STEP_OUTPUT + UO]
    per_rotor = 1.0 / rotor
    bearing_low, depth, creep = physics[BEARING_LOW], physics[DEPTH], physics[CREEP]
    motor_coulomb, motor_viscous = physics[MOTOR_COULOMB], physics[MOTOR_VISCOUS]
    friction_scale = physics[FRICTION_SCALE]
    latch_step = int(physics[LATCH] / h) if whole else -1
    latch_rest = physics[LATCH] - latch_step * h
    w, r2, v2, r1 = state[W], state[R2], state[V2], state[R1]
    u1, ro, uo, theta = state[U1], state[RO], state[UO], state[THETA]
    e0, slope0, force_before, friction = state[ERROR], state[SLOPE], state[FORCE], state[FRICTION]
    acceleration, output_acceleration = state[ACCELERATION], state[OUTPUT_ACCELERATION]
    port, extra, hysteresis, torsion = state[PORT], state[EXTRA], state[HYSTERESIS], state[TORSION]
    windup, wedge = state[WINDUP], state[WEDGE]
    since, output_drag = state[SWITCHED], state[OUTPUT_FRICTION]
    gear_heat, motor_heat = state[GEAR_HEAT], state[MOTOR_HEAT]
    housing, motor, tick = state[HOUSING], state[MOTOR], int(state[TICK])
    was_held = uo == 0.0
    k, n, again = first, begun, False
    while k < rows.shape[0] and not again:
        if whole and n == 0:
            rows[k, ROW_INPUT_ANGLE] = theta
            rows[k, ROW_INPUT_SPEED] = w
            rows[k, ROW_INPUT_ACCELERATION] = acceleration
            rows[k, ROW_TORQUE_REFERENCE] = state[FILTER]
            rows[k, ROW_PORT_TORQUE] = port
            rows[k, ROW_FRICTION] = friction
            rows[k, ROW_WEDGE_TORQUE] = wedge
            rows[k, ROW_WINDUP_TORQUE] = physics[CUP] * (r1 - ro) * per_radius + extra
            rows[k, ROW_SPEED_REFERENCE] = state[RAMP]
            rows[k, ROW_HOUSING] = housing
            rows[k, ROW_MOTOR] = motor
            state[CYCLES] += 1.0
            state[HOUSING_SUM] += housing
            state[MOTOR_SUM] += motor
            gear_heat, motor_heat = 0.0, 0.0
        if warming:
            warmer = housing - physics[HOUSING_REFERENCE]
            motor_warmer = motor - physics[MOTOR_REFERENCE]
            thinner = math.exp(-physics[VISCOUS_PER_KELVIN] * warmer * (1.0 / 3.0))
            dry_factor = 1.0 - physics[COULOMB_PER_KELVIN] * warmer
            bearing_factor = thinner * thinner
            viscous_factor = bearing_factor * thinner
            output_factor = 1.0 - physics[OUTPUT_PER_KELVIN] * warmer
            motor_factor = 1.0 - physics[MOTOR_PER_KELVIN] * motor_warmer
            torque_factor = physics[TORQUE_FACTOR] * (
                1.0 - physics[TORQUE_PER_KELVIN] * motor_warmer
            )
        target = targets[k]
        while n < substeps:
            if n == latch_step:
                rate = uo * per_radius
                turn = latch_rest * (rate + 0.5 * latch_rest * output_acceleration)
                rows[k, ROW_OUTPUT_ANGLE] = theta * inverse_ratio + ro * per_radius - windup + turn
                rows[k, ROW_OUTPUT_SPEED] = rate + latch_rest * output_acceleration
                rows[k, ROW_OUTPUT_ACCELERATION] = output_acceleration
            if tick == 0:
                if mode == OFF:
                    state[FILTER] = 0.0
                    state[INTEGRAL] = 0.0
                    state[RAMP] = w
                else:
                    state[W] = w
                    _servo_reference(state, servo, mode, target)
                tick = period
            tick -= 1
            reference = state[FILTER]
            if whole and 0.0 < abs(w) < creep and h * abs(acceleration) > STEADY * abs(w):
                again = True
                break
            # The wedge's error where the rotor will be, so that one look-up serves both ends of the hold.
            e1, slope1 = error_at(error_table, turns, points, theta + h * w)
            force = k_b * (e0 - r2) + c_b * ((lift + slope0) * w - v2)
            torque = torque_factor * reference - (slope0 + slope1) * (
                0.5 * force + lead * (force - force_before)
            )
            output_torque = -state[LOAD]
            pulled, now = hysteresis, torsion
            if elastic:
                # In the middle of the step: a torque from its start would take damping away.
                rate = (lift + slope0) * w * tangent - uo
                now = (e0 * tangent - ro + 0.5 * h * rate) * per_radius
                extra = _hardened(physics, now)
                if hysteretic:
                    pulled = dahl(physics, hysteresis, now - torsion)
                    extra += pulled
                output_torque += extra
                torque -= extra * (inverse_ratio + slope0 * tangent * per_radius)
            reaction = torque_factor * reference - torque + lift * force
            if cogging_table is not None and cogging > 0:
                torque += cogging_at(cogging_table, cogging, theta + 0.5 * h * w)
            speed = max(abs(w) + math.copysign(0.5 * h * acceleration, w * acceleration), 0.0)
            dry, viscous, bearing, wound = friction_at(
                friction_table, friction_scale, last_friction, speed
            )
            sliding = 1.0 + slope0 * per_lift
            gear_part = (
                sliding * (dry_factor * dry * (1.0 + depth * e0) + viscous_factor * viscous)
                + dry_factor * bearing_low
                + bearing_factor * bearing
            )
            motor_part = motor_factor * (motor_coulomb + motor_viscous * speed)
            bound = gear_part + motor_part
            for i in range(width):
                next_state[i] = (
                    (
                        (w * matrix[i] + r2 * matrix[8 + i])
                        + (v2 * matrix[16 + i] + r1 * matrix[24 + i])
                    )
                    + (
                        (u1 * matrix[32 + i] + ro * matrix[40 + i])
                        + (uo * matrix[48 + i] + e0 * matrix[64 + i])
                    )
                ) + (
                    (torque * matrix[56 + i] + output_torque * matrix[80 + i]) + e1 * matrix[72 + i]
                )
            free = next_state[0]
            stuck = abs(free) <= rotor * bound
            holding = free * per_rotor if stuck else math.copysign(bound, free)
            for i in range(width):
                next_state[i] -= holding * matrix[56 + i]
            drag, held = 0.0, False
            if output_friction:
                most = output_factor * (physics[OUTPUT_COULOMB] + physics[OUTPUT_VISCOUS] * abs(uo))
                drag = next_state[UO] * per_output
                held = abs(drag) <= most
                if not held:
                    drag = math.copysign(most, drag)
                for i in range(width):
                    next_state[i] -= drag * matrix[80 + i]
                if held:
                    next_state[UO] = 0.0
            after = 0.0 if stuck else next_state[0]
            turned = w * after <= 0.0 and (w != 0.0 or after != 0.0)
            # What holds the rotor has nearly reached what it can: it may let go before the step's end.
            yields = stuck and abs(holding) + abs(holding - friction) > bound
            if whole and (turned or yields or (output_friction and held != was_held)):
                again = True
                break
            if turned:
                # A rotor that lets go does so where its step begins.
                since = 0.0 if w != 0.0 else h
            else:
                since += h
            force_before, friction, wedge = force, holding, reaction
            hysteresis, torsion, was_held, output_drag = pulled, now, held, drag
            moved_angle = 0.0 if stuck and w == 0.0 else next_state[7]
            share = friction / bound if bound > 0.0 else 0.0
            windup = wound * share
            gear_heat += share * gear_part * moved_angle
            motor_heat += share * motor_part * moved_angle
            acceleration = 0.0 if after == 0.0 else (after - w) * per_step
            output_acceleration = (next_state[UO] - uo) * per_step * per_radius
            theta += moved_angle
            w, r2, v2, r1 = after, next_state[1], next_state[2], next_state[3]
            u1, ro, uo = next_state[4], next_state[5], next_state[6]
            e0, slope0 = e1, slope1
            port += port_step * (reference - port)
            n += 1
        if not again:
            if warming and whole:
                duration = substeps * h
                copper = physics[COPPER] * state[FILTER] * state[FILTER] * duration
                exchanged = physics[COUPLING] * (motor - housing) * duration
                housing_heat = (
                    gear_heat
                    + exchanged
                    - physics[HOUSING_LOSS] * (housing - physics[AMBIENT]) * duration
                )
                motor_heat += (
                    copper - exchanged - physics[MOTOR_LOSS] * (motor - physics[AMBIENT]) * duration
                )
                housing += physics[HOUSING_STEP] * housing_heat
                motor += physics[MOTOR_STEP] * motor_heat
            k, n = k + 1, 0
    state[W], state[R2], state[V2], state[R1] = w, r2, v2, r1
    state[U1], state[RO], state[UO], state[THETA] = u1, ro, uo, theta
    state[ERROR], state[SLOPE], state[FORCE], state[FRICTION] = e0, slope0, force_before, friction
    state[ACCELERATION], state[OUTPUT_ACCELERATION] = acceleration, output_acceleration
    state[PORT], state[EXTRA], state[HYSTERESIS], state[TORSION] = port, extra, hysteresis, torsion
    state[WINDUP], state[WEDGE] = windup, wedge
    state[SWITCHED], state[OUTPUT_FRICTION] = since, output_drag
    state[GEAR_HEAT], state[MOTOR_HEAT] = gear_heat, motor_heat
    state[HOUSING], state[MOTOR], state[TICK] = housing, motor, tick
    return k, n


@compiled
def advance(
    state: FloatArray,
    physics: FloatArray,
    servo: FloatArray,
    step: FloatArray,
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
    the cogging torque, or None where nothing but the published model acts. `step` is the matrix of a step and that of
    one of its `FINE` parts.
    """
    whole, part, lag = physics[H], physics[H] / FINE, physics[PORT_STEP_FINE]
    tables = (error_table, friction_table)
    matrix, part_matrix = step[:_STEP_SIZE].copy(), step[_STEP_SIZE:].copy()
    pace, part_pace = (whole, 0.25, physics[PORT_STEP]), (part, 0.25, lag)
    # The force of the whole step before leads the first part.
    first_pace = (part, 0.25 / FINE, lag)
    row, done = 0, 0
    while True:
        row, done = run(
            state, physics, servo, matrix, pace, tables, cogging_table, mode, targets, substeps, rows, row, done, True
        )  # fmt: skip
        if row == rows.shape[0]:
            return
        # In parts, so that what happens within the step happens where it belongs; the servo waits.
        tick = state[TICK]
        state[TICK] = 2.0 * FINE
        run(
            state, physics, servo, part_matrix, first_pace, tables, cogging_table, mode, targets, 1, rows[:1],
            0, 0, False,
        )  # fmt: skip
        force = state[FORCE]
        run(
            state, physics, servo, part_matrix, part_pace, tables, cogging_table, mode, targets, FINE - 1, rows[:1],
            0, 0, False,
        )  # fmt: skip
        state[FORCE], state[TICK] = force, tick
        done += 1
