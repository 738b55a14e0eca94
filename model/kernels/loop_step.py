"""The parts of a step: each becomes part of the loop, and what they hand to each other are tuples, in registers."""

from __future__ import annotations

import math
from typing import NamedTuple

from model.arrays import FloatArray

# isort: off
# By name: an index that is a module's attribute may be negative for all that numba knows, and a step takes 5 % longer.
from model.kernels.loop_layout import (
    ACCELERATION, AMBIENT, BEARING_LOW, COGGING_POINTS, COPPER, COULOMB_PER_KELVIN, COUPLING, CREEP, CUP, CYCLES,
    C_B, DEPTH, ELASTIC, ERROR, ERROR_POINTS, ERROR_TURNS, EXTRA, EXTRA_2, EXTRA_3, FILTER, FORCE, FRICTION,
    FRICTION_LAST, FRICTION_SCALE, GEAR_HEAT, HOUSING, HOUSING_LOSS, HOUSING_REFERENCE, HOUSING_STEP, HOUSING_SUM,
    HYSTERESIS, HYSTERESIS_BY_SLOPE, HYSTERESIS_LIMIT, HYSTERESIS_STIFFNESS, INVERSE_RATIO, KINK_1, KINK_2, K_B,
    LAMBDA, MOTOR, MOTOR_COULOMB, MOTOR_HEAT, MOTOR_LOSS, MOTOR_PER_KELVIN, MOTOR_REFERENCE, MOTOR_STEP, MOTOR_SUM,
    MOTOR_VISCOUS,
    OUTPUT_ACCELERATION, OUTPUT_COULOMB, OUTPUT_FRICTION, OUTPUT_PER_KELVIN, OUTPUT_VISCOUS, PLAY, R1, R2, RADIUS,
    RAMP, RO, ROW_FRICTION, ROW_HOUSING, ROW_INPUT_ACCELERATION, ROW_INPUT_ANGLE, ROW_INPUT_SPEED, ROW_MOTOR,
    ROW_OUTPUT_ACCELERATION, ROW_OUTPUT_ANGLE, ROW_OUTPUT_SPEED, ROW_PORT_TORQUE, ROW_SPEED_REFERENCE,
    ROW_TORQUE_REFERENCE, ROW_WEDGE_TORQUE, ROW_WINDUP_TORQUE, SLOPE, SPRING, STEADY, STEP_OUTPUT, STEP_TORQUE,
    TANGENT, THETA, TORQUE_FACTOR, TORQUE_PER_KELVIN, TORSION, U1, UO, V2, VISCOUS_PER_KELVIN, W, WEDGE, WINDUP,
)  # fmt: skip

# isort: on
from model.kernels.loop_tables import cogging_at, compiled, error_at, friction_at, inlined, slid


class Tables(NamedTuple):
    """What is looked up. Without `cogging` the published model with its servo turns: what only a worse rig has is not
    compiled into it.
    """

    error: FloatArray
    friction: FloatArray
    cogging: FloatArray | None


class Pace(NamedTuple):
    """A step: its length [s], the lead of the wedge's force in it, the share of the port's lag; how many of them a row
    has; whether it is whole, or a part of one.
    """

    length: float
    lead: float
    port_step: float
    substeps: int
    whole: bool


class Place(NamedTuple):
    """How far the loop has come."""

    row: int
    substep: int


class _Constants(NamedTuple):
    """What stays while a call lasts, out of its arrays: a loop that reads it there takes half as long again."""

    length: float
    lead: float
    port_step: float
    per_step: float
    lift: float
    per_lift: float
    inverse_ratio: float
    radius: float
    per_radius: float
    tangent: float
    k_b: float
    c_b: float
    turns: float
    points: float
    friction_scale: float
    last_friction: int
    bearing_low: float
    depth: float
    creep: float
    motor_coulomb: float
    motor_viscous: float
    rotor: float
    per_rotor: float
    per_output: float
    cogging: float
    elastic: bool
    hysteretic: bool
    output_friction: bool
    warming: bool


class Motion(NamedTuple):
    """The linear part of the state, the input angle, and how both speeds changed in the last step."""

    w: float
    r2: float
    v2: float
    r1: float
    u1: float
    ro: float
    uo: float
    theta: float
    acceleration: float
    output_acceleration: float


class Mesh(NamedTuple):
    """The wedge's error [m], its slope, its force a step ago and its torque; the friction's torque and wind-up."""

    error: float
    slope: float
    force: float
    torque: float
    friction: float
    windup: float


class Spring(NamedTuple):
    """What is parallel to the gear: its torque, the hysteresis element's share of it, the torsion [rad]."""

    torque: float
    hysteresis: float
    torsion: float


class Drag(NamedTuple):
    """The output bearing: its friction [N m], and whether it holds the output."""

    torque: float
    held: bool


class Heat(NamedTuple):
    """What friction has warmed since the SYNC [J], and how warm both stores are [degC]."""

    gear: float
    motor: float
    housing_temperature: float
    motor_temperature: float


class Warmth(NamedTuple):
    """By which factor warmth changes dry, viscous, bearing, output and motor friction, and the torque constant."""

    dry: float
    viscous: float
    bearing: float
    output: float
    motor: float
    torque: float


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
def _dahl(physics: FloatArray, torque: float, moved: float) -> float:
    """The torque of the hysteresis element after a movement: dT = sigma (1 - T sgn(d)/T_h) d (Dahl 1968), solved; by
    its slope at the start a loop of 50 steps in which it slides damps 5 % too much.
    """
    limit = physics[HYSTERESIS_LIMIT]
    if physics[HYSTERESIS_BY_SLOPE] > 0.0:
        pull = 1.0 - math.copysign(torque / limit, torque * moved)
        return min(max(torque + physics[HYSTERESIS_STIFFNESS] * moved * pull, -limit), limit)
    end = math.copysign(limit, moved)
    return end + (torque - end) * slid(physics[HYSTERESIS_STIFFNESS] * abs(moved) / limit)


@inlined
def constants(
    physics: FloatArray, matrix: FloatArray, pace: Pace, cogging_table: FloatArray | None
) -> _Constants:
    """The constants of a call of `run`."""
    lift, radius = physics[LAMBDA], physics[RADIUS]
    rotor = matrix[8 * STEP_TORQUE]
    cogging, elastic, hysteretic, output_friction, warming = 0.0, False, False, False, False
    if cogging_table is not None:
        cogging = physics[COGGING_POINTS]
        elastic, hysteretic = physics[ELASTIC] > 0.0, physics[HYSTERESIS_LIMIT] > 0.0
        output_friction = physics[OUTPUT_COULOMB] > 0.0 or physics[OUTPUT_VISCOUS] > 0.0
        warming = physics[HOUSING_STEP] > 0.0
    return _Constants(
        pace.length,
        pace.lead,
        pace.port_step,
        1.0 / pace.length,
        lift,
        1.0 / lift if lift > 0.0 else 0.0,
        physics[INVERSE_RATIO],
        radius,
        1.0 / radius,
        physics[TANGENT],
        physics[K_B],
        physics[C_B],
        physics[ERROR_TURNS],
        physics[ERROR_POINTS],
        physics[FRICTION_SCALE],
        int(physics[FRICTION_LAST]),
        physics[BEARING_LOW],
        physics[DEPTH],
        physics[CREEP],
        physics[MOTOR_COULOMB],
        physics[MOTOR_VISCOUS],
        rotor,
        1.0 / rotor,
        1.0 / matrix[8 * STEP_OUTPUT + UO],
        cogging,
        elastic,
        hysteretic,
        output_friction,
        warming,
    )


@inlined
def warmth_of(physics: FloatArray, heat: Heat) -> Warmth:
    """What the temperatures at a SYNC do until the next one."""
    warmer = heat.housing_temperature - physics[HOUSING_REFERENCE]
    motor_warmer = heat.motor_temperature - physics[MOTOR_REFERENCE]
    thinner = math.exp(-physics[VISCOUS_PER_KELVIN] * warmer * (1.0 / 3.0))
    bearing = thinner * thinner
    return Warmth(
        1.0 - physics[COULOMB_PER_KELVIN] * warmer,
        bearing * thinner,
        bearing,
        1.0 - physics[OUTPUT_PER_KELVIN] * warmer,
        1.0 - physics[MOTOR_PER_KELVIN] * motor_warmer,
        physics[TORQUE_FACTOR] * (1.0 - physics[TORQUE_PER_KELVIN] * motor_warmer),
    )


@inlined
def warmed(physics: FloatArray, heat: Heat, reference: float, duration: float) -> Heat:
    """Both stores a cycle later: friction and copper loss in, what goes to the room and from one to the other out."""
    housing, motor = heat.housing_temperature, heat.motor_temperature
    copper = physics[COPPER] * reference * reference * duration
    exchanged = physics[COUPLING] * (motor - housing) * duration
    housing_heat = (
        heat.gear + exchanged - physics[HOUSING_LOSS] * (housing - physics[AMBIENT]) * duration
    )
    motor_heat = heat.motor + (
        copper - exchanged - physics[MOTOR_LOSS] * (motor - physics[AMBIENT]) * duration
    )
    return Heat(
        heat.gear,
        motor_heat,
        housing + physics[HOUSING_STEP] * housing_heat,
        motor + physics[MOTOR_STEP] * motor_heat,
    )


@inlined
def write_row(
    rows: FloatArray, k: int, state: FloatArray, physics: FloatArray, motion: Motion, mesh: Mesh, spring: Spring,
    heat: Heat, port: float, per_radius: float,
) -> None:  # fmt: skip
    """What is true at a SYNC; the output's columns follow when it is latched."""
    rows[k, ROW_INPUT_ANGLE] = motion.theta
    rows[k, ROW_INPUT_SPEED] = motion.w
    rows[k, ROW_INPUT_ACCELERATION] = motion.acceleration
    rows[k, ROW_TORQUE_REFERENCE] = state[FILTER]
    rows[k, ROW_PORT_TORQUE] = port
    rows[k, ROW_FRICTION] = mesh.friction
    rows[k, ROW_WEDGE_TORQUE] = mesh.torque
    rows[k, ROW_WINDUP_TORQUE] = physics[CUP] * (motion.r1 - motion.ro) * per_radius + spring.torque
    rows[k, ROW_SPEED_REFERENCE] = state[RAMP]
    rows[k, ROW_HOUSING] = heat.housing_temperature
    rows[k, ROW_MOTOR] = heat.motor_temperature
    state[CYCLES] += 1.0
    state[HOUSING_SUM] += heat.housing_temperature
    state[MOTOR_SUM] += heat.motor_temperature


@inlined
def latch(rows: FloatArray, k: int, c: _Constants, motion: Motion, mesh: Mesh, rest: float) -> None:
    """The output's columns of a row, `rest` [s] into the step that begins."""
    rate = motion.uo * c.per_radius
    turn = rest * (rate + 0.5 * rest * motion.output_acceleration)
    rows[k, ROW_OUTPUT_ANGLE] = (
        motion.theta * c.inverse_ratio + motion.ro * c.per_radius - mesh.windup + turn
    )
    rows[k, ROW_OUTPUT_SPEED] = rate + rest * motion.output_acceleration
    rows[k, ROW_OUTPUT_ACCELERATION] = motion.output_acceleration


@inlined
def creeps(c: _Constants, motion: Motion) -> bool:
    """Whether the rotor speeds through the steep part of the Stribeck curve."""
    creeping = 0.0 < abs(motion.w) < c.creep
    return creeping and c.length * abs(motion.acceleration) > STEADY * abs(motion.w)


@inlined
def _stretched(
    c: _Constants, physics: FloatArray, motion: Motion, mesh: Mesh, spring: Spring
) -> Spring:
    """The parallel spring in the middle of the step: a torque from its start would take damping away."""
    rate = (c.lift + mesh.slope) * motion.w * c.tangent - motion.uo
    now = (mesh.error * c.tangent - motion.ro + 0.5 * c.length * rate) * c.per_radius
    extra, pulled = _hardened(physics, now), spring.hysteresis
    if c.hysteretic:
        pulled = _dahl(physics, spring.hysteresis, now - spring.torsion)
        extra += pulled
    return Spring(extra, pulled, now)


@inlined
def _cogging(table: FloatArray | None, points: float, angle: float) -> float:
    """The cogging torque; a table that is not there is none (numba leaves a branch away by an argument's type only)."""
    if table is None:
        return 0.0
    return cogging_at(table, points, angle)


@inlined
def _friction_limits(
    c: _Constants, table: FloatArray, warmth: Warmth, motion: Motion, mesh: Mesh
) -> tuple[float, float, float]:
    """The friction torque [N m] that gear and motor have to offer in the middle of the step, and the wind-up of it."""
    w, acceleration = motion.w, motion.acceleration
    speed = max(abs(w) + math.copysign(0.5 * c.length * acceleration, w * acceleration), 0.0)
    dry, viscous, bearing, wound = friction_at(table, c.friction_scale, c.last_friction, speed)
    sliding = 1.0 + mesh.slope * c.per_lift
    gear = (
        sliding * (warmth.dry * dry * (1.0 + c.depth * mesh.error) + warmth.viscous * viscous)
        + warmth.dry * c.bearing_low
        + warmth.bearing * bearing
    )
    return gear, warmth.motor * (c.motor_coulomb + c.motor_viscous * speed), wound


@inlined
def _propagate(
    next_state: FloatArray, matrix: FloatArray, motion: Motion, errors: tuple[float, float],
    output_torque: float,
) -> None:  # fmt: skip
    """The linear part a step later, as if no torque were on the rotor: it is there before that torque is known."""
    w, r2, v2, r1 = motion.w, motion.r2, motion.v2, motion.r1
    u1, ro, uo = motion.u1, motion.ro, motion.uo
    e0, e1 = errors
    # Not a constant, so that the loop becomes SIMD instead of being unrolled.
    for i in range(next_state.size):
        next_state[i] = (
            ((w * matrix[i] + r2 * matrix[8 + i]) + (v2 * matrix[16 + i] + r1 * matrix[24 + i]))
            + ((u1 * matrix[32 + i] + ro * matrix[40 + i]) + (uo * matrix[48 + i] + e0 * matrix[64 + i]))
        ) + (output_torque * matrix[80 + i] + e1 * matrix[72 + i])  # fmt: skip


@inlined
def _add_torque(next_state: FloatArray, matrix: FloatArray, row: int, torque: float) -> None:
    """The same with a constant torque in the step."""
    for i in range(next_state.size):
        next_state[i] += torque * matrix[8 * row + i]


@inlined
def _dragged(c: _Constants, next_state: FloatArray, matrix: FloatArray, most: float) -> Drag:
    """The output bearing's friction, at most so much: an exact prox as on the rotor."""
    torque = next_state[UO] * c.per_output
    held = abs(torque) <= most
    if not held:
        torque = math.copysign(most, torque)
    _add_torque(next_state, matrix, STEP_OUTPUT, -torque)
    if held:
        next_state[UO] = 0.0
    return Drag(torque, held)


@inlined
def taken_from(state: FloatArray) -> tuple[Motion, Mesh, Spring, Drag, Heat]:
    """What a step changes, out of the state."""
    return (
        Motion(
            state[W], state[R2], state[V2], state[R1], state[U1], state[RO], state[UO],
            state[THETA], state[ACCELERATION], state[OUTPUT_ACCELERATION],
        ),
        Mesh(state[ERROR], state[SLOPE], state[FORCE], state[WEDGE], state[FRICTION], state[WINDUP]),
        Spring(state[EXTRA], state[HYSTERESIS], state[TORSION]),
        Drag(state[OUTPUT_FRICTION], state[UO] == 0.0),
        Heat(state[GEAR_HEAT], state[MOTOR_HEAT], state[HOUSING], state[MOTOR]),
    )  # fmt: skip


@inlined
def put_into(
    state: FloatArray, motion: Motion, mesh: Mesh, spring: Spring, drag: Drag, heat: Heat
) -> None:
    """The same back into the state."""
    state[W], state[R2], state[V2], state[R1] = motion.w, motion.r2, motion.v2, motion.r1
    state[U1], state[RO], state[UO], state[THETA] = motion.u1, motion.ro, motion.uo, motion.theta
    state[ACCELERATION] = motion.acceleration
    state[OUTPUT_ACCELERATION] = motion.output_acceleration
    state[ERROR], state[SLOPE], state[FORCE] = mesh.error, mesh.slope, mesh.force
    state[WEDGE], state[FRICTION], state[WINDUP] = mesh.torque, mesh.friction, mesh.windup
    state[EXTRA], state[HYSTERESIS], state[TORSION] = (
        spring.torque,
        spring.hysteresis,
        spring.torsion,
    )
    state[OUTPUT_FRICTION] = drag.torque
    state[GEAR_HEAT], state[MOTOR_HEAT] = heat.gear, heat.motor
    state[HOUSING], state[MOTOR] = heat.housing_temperature, heat.motor_temperature


@inlined
def _torques(
    c: _Constants, physics: FloatArray, tables: Tables, motion: Motion, mesh: Mesh, spring: Spring,
    motor_torque: float, load: float,
) -> tuple[float, float, Mesh, Spring]:  # fmt: skip
    """What drives rotor and output in a step [N m], friction apart; wedge and spring at its end."""
    w, theta, e0, slope0 = motion.w, motion.theta, mesh.error, mesh.slope
    # The wedge's error where the rotor will be, so that one look-up serves both ends of the hold.
    e1, slope1 = error_at(tables.error, c.turns, c.points, theta + c.length * w)
    force = c.k_b * (e0 - motion.r2) + c.c_b * ((c.lift + slope0) * w - motion.v2)
    torque = motor_torque - (slope0 + slope1) * (0.5 * force + c.lead * (force - mesh.force))
    output_torque = -load
    if c.elastic:
        spring = _stretched(c, physics, motion, mesh, spring)
        output_torque += spring.torque
        torque -= spring.torque * (c.inverse_ratio + slope0 * c.tangent * c.per_radius)
    reaction = motor_torque - torque + c.lift * force
    if c.cogging > 0:
        torque += _cogging(tables.cogging, c.cogging, theta + 0.5 * c.length * w)
    return (
        torque,
        output_torque,
        Mesh(e1, slope1, force, reaction, mesh.friction, mesh.windup),
        spring,
    )


@inlined
def step(
    c: _Constants, physics: FloatArray, tables: Tables, matrix: FloatArray, next_state: FloatArray, warmth: Warmth,
    motion: Motion, mesh: Mesh, spring: Spring, drag: Drag, heat: Heat, reference: float, load: float,
) -> tuple[Motion, Mesh, Spring, Drag, Heat, bool, bool]:  # fmt: skip
    """One step: all that it changes, whether the rotor turned round or let go, and whether what happened within it
    wants it taken in parts.
    """
    w, before = motion.w, mesh.friction
    torque, output_torque, after, spring = _torques(
        c, physics, tables, motion, mesh, spring, warmth.torque * reference, load
    )
    gear_limit, motor_limit, wound = _friction_limits(c, tables.friction, warmth, motion, mesh)
    bound = gear_limit + motor_limit
    _propagate(next_state, matrix, motion, (mesh.error, after.error), output_torque)
    free = next_state[0] + c.rotor * torque
    stuck = abs(free) <= c.rotor * bound
    friction = free * c.per_rotor if stuck else math.copysign(bound, free)
    _add_torque(next_state, matrix, STEP_TORQUE, torque - friction)
    was_held = drag.held
    if c.output_friction:
        most = physics[OUTPUT_COULOMB] + physics[OUTPUT_VISCOUS] * abs(motion.uo)
        drag = _dragged(c, next_state, matrix, warmth.output * most)
    speed = 0.0 if stuck else next_state[0]
    turned = w * speed <= 0.0 and (w != 0.0 or speed != 0.0)
    # What holds the rotor has nearly reached what it can: it may let go before the step's end.
    yields = stuck and abs(friction) + abs(friction - before) > bound
    moved = 0.0 if stuck and w == 0.0 else next_state[7]
    share = friction / bound if bound > 0.0 else 0.0
    motion = Motion(
        speed, next_state[1], next_state[2], next_state[3], next_state[4], next_state[5], next_state[6],
        motion.theta + moved,
        0.0 if speed == 0.0 else (speed - w) * c.per_step,
        (next_state[UO] - motion.uo) * c.per_step * c.per_radius,
    )  # fmt: skip
    mesh = Mesh(after.error, after.slope, after.force, after.torque, friction, wound * share)
    if c.warming:
        heat = Heat(
            heat.gear + share * gear_limit * moved,
            heat.motor + share * motor_limit * moved,
            heat.housing_temperature,
            heat.motor_temperature,
        )
    parts = turned or yields or (c.output_friction and drag.held != was_held)
    return motion, mesh, spring, drag, heat, turned, parts
