"""Where each number of the compiled closed loop lies in its arrays: state, physics, servo, step matrix and row.

The whole state is one array, so that a copy of it is a snapshot.
"""

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
    HYSTERESIS_BY_SLOPE,
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
) = range(48)
PHYSICS_SIZE = 48

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
STEP_MATRIX_SIZE = 88
FINE = 64
"""Parts in which a step is taken again. The step array holds the matrix of a step, then that of a part."""
STEADY = 0.05
"""Share of itself by which a creeping speed may change within a step: friction is taken in its middle."""
