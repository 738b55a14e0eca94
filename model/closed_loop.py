"""The rig's closed loop: servo, motor, wedge, gear and load in one compiled simulation, with
friction that truly sticks.

(2)   the three masses of the gear, here with the rotor as a fourth; propagated exactly per step (matrix exponential,
      first-order hold on e), in coordinates relative to the rigid gear so that no angle grows
(17)  e = ke r_g/tan(alpha_t)
      T_wg = F_b (r_g tan(alpha_n) + de/dtheta_i) + friction        F_b = K_b (x1 - x2 + e) + C_b (x1' - x2' + e')
      (J_m + J_wg) theta_i'' = T_m - T_wg - T_motor friction
      T_ref = J_tot 2 pi K_v (eps + (1/T_i) int eps dt)             with torque limit, torque filter and anti-windup

Friction is lumped on the rotor: eq (19) applied to x2 and y1 with the sign of a *state* theta_i'
chatters at any step size, because the rotor answers a mesh force only through the elastic chain. On
the rotor the friction torque acts on the speed whose sign it takes, so one scalar equation gives
exact stick: the speed is 0.0 at a hold. The wind-up that the friction leaves in the output (theta_f
of the reduced form) is added to the output angle as a static lag.

Whatever a real rig has and equation 2 has not is a `Deviations`; the default is the published model
with its servo. Equations 2 and 17 of Zou et al. 2015; the reaction torque by virtual work; the
servo as the usual speed loop of an AC drive.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from model import friction, loop_tables
from model.arrays import FloatArray
from model.errors import ModelError
from model.gear import Harmonic, HarmonicDrive, Mounting
from model.kernels import closed_loop as kernel
from model.kernels import loop_layout as at
from model.kinematic_error import series_slope, series_value
from model.linear import DynamicParameters, dynamic_parameters
from model.motor import ServoMotor

CREEP = 4.0
"""Stribeck velocities below which a speed creeps: friction is steep there."""

OFF, SPEED, TORQUE, QUICK_STOP = at.OFF, at.SPEED, at.TORQUE, at.QUICK_STOP
"""What the servo is told: power stage off, speed set-points [rad/s], torque set-points [N m], ramp down and hold."""


@dataclass(frozen=True)
class Servo:
    """The drive's speed loop: K_v [Hz], T_i [s], torque filter [s], period of the loop [s]."""

    speed_gain: float = 40.0
    integral_time: float = 0.020
    torque_filter_time: float = 0.001
    period: float = 250e-6


@dataclass(frozen=True)
class ServoLimits:
    """What the drive never exceeds: torque [N m], speed [rad/s], acceleration and decelerations
    [rad/s2], motor side.
    """

    torque: float
    speed: float
    acceleration: float = 1e6
    deceleration: float = 1e6
    quick_stop_deceleration: float = 1e6


@dataclass(frozen=True, kw_only=True)
class Thermal:
    """Two lumped heat stores, housing (with the grease) and motor, and what warming does to
    friction and torque constant.

    Temperatures in degC, capacities in J/K, conductances to the room and between them in W/K, copper loss in W/(N m)^2.
    Friction parameters are those at `reference`. Coulomb friction falls by `coulomb_per_kelvin` of itself per kelvin,
    viscous friction as exp(-viscous_per_kelvin dT), the bearing's no-load torque as that to 2/3 (equation 18).
    """

    ambient: float = 22.0
    housing_start: float = 22.0
    motor_start: float = 22.0
    reference: float = 22.0
    housing_capacity: float = 900.0
    motor_capacity: float = 350.0
    housing_conductance: float = 1.6
    motor_conductance: float = 0.9
    coupling: float = 0.5
    copper_loss: float = 55.0
    coulomb_per_kelvin: float = 0.002
    viscous_per_kelvin: float = 0.03
    motor_friction_per_kelvin: float = 0.004
    torque_constant_per_kelvin: float = 0.0010


@dataclass(frozen=True, kw_only=True)
class Deviations:
    """What a rig has and equation 2 has not. The default is none of it.

    kinematic_error      orders added to the gear's own series [rad over theta_i]
    friction_windup      the static lag theta_f that friction leaves in the output
    mesh_depth           relative modulation of the mesh friction in phase with the kinematic error (figure 16), 0..1
    hardening            stiffness grows beyond T1 and T2 in the catalogue's proportions K2/K1, K3/K1
    hysteresis_torque, hysteresis_stiffness   a Dahl element parallel to the gear: its limit [N m] and its stiffness
                         as a fraction of K_HDf
    hysteresis_by_slope  the element is stepped by its slope, as the worlds of versions 1 and 2 have it
    backlash             torsion from end to end within which the spring gives no torque [rad]
    output_coulomb, output_viscous            friction of the bench's output bearing [N m], [N m s/rad]
    output_per_kelvin    share by which both fall per kelvin of the housing above the thermal reference
    motor_friction       the motor's own Coulomb and viscous friction
    cogging              orders of the motor's cogging torque over theta_i, amplitudes in N m
    torque_constant_error   relative excess of the true motor torque over the reference
    port_lag             time constant of the torque monitor [s]
    output_latch         how long after SYNC the output is latched [s], within the SYNC period
    thermal              housing and motor that warm; None: every temperature stays at 22 degC
    """

    kinematic_error: tuple[Harmonic, ...] = ()
    friction_windup: bool = False
    mesh_depth: float = 0.0
    hardening: bool = False
    hysteresis_torque: float = 0.0
    hysteresis_stiffness: float = 0.0
    hysteresis_by_slope: bool = False
    backlash: float = 0.0
    output_coulomb: float = 0.0
    output_viscous: float = 0.0
    output_per_kelvin: float = 0.0
    motor_friction: bool = True
    cogging: tuple[Harmonic, ...] = ()
    torque_constant_error: float = 0.0
    port_lag: float = 0.0
    output_latch: float = 0.0
    thermal: Thermal | None = None

    @property
    def acts_in_each_step(self) -> bool:
        """Whether the compiled loop has more to look at in each step than the published model."""
        parallel = self.hardening or self.hysteresis_torque > 0.0 or self.backlash > 0.0
        output = self.output_coulomb > 0.0 or self.output_viscous > 0.0
        return parallel or output or bool(self.cogging) or self.thermal is not None


@dataclass(frozen=True)
class LoopSettings:
    """How the loop is put together: mounting, gear on the motor or not, tare disc [kg m2], SYNC period and step [s]."""

    mounting: Mounting = "circular-spline-fixed"
    gear_mounted: bool = True
    disc_inertia: float = 0.0
    cycle: float = 1e-3
    step: float = 125e-6
    servo: Servo = field(default_factory=Servo)


def _followed(step: float, lag: float) -> float:
    """Which share of a change a lag of first order [s] has followed after a step of time [s]; all of it without one."""
    return -math.expm1(-step / lag) if lag > 0.0 else 1.0


class ClosedLoop:
    """The closed loop of one motor and one gear (or the bare motor), ready to be advanced.

    Holds only what does not change while it turns; what does is the state array that `rest` makes
    and `advance` changes in place (a copy of it is a snapshot). `series` is the kinematic error
    that acts, `parameters` the numbers of equation 2, `inertia` what the motor turns [kg m2],
    `time_step` the exact step [s].
    """

    def __init__(
        self,
        gear: HarmonicDrive,
        motor: ServoMotor,
        deviations: Deviations | None = None,
        settings: LoopSettings | None = None,
    ) -> None:
        self.gear, self.motor = gear, motor
        self.deviations = deviations or Deviations()
        self.settings = settings or LoopSettings()
        self.ratio = gear.mounted_ratio(self.settings.mounting)
        self.parameters: DynamicParameters = dynamic_parameters(gear, ratio=self.ratio)
        self.substeps = max(1, round(self.settings.cycle / self.settings.step))
        self.time_step = self.settings.cycle / self.substeps
        mounted = self.settings.gear_mounted
        self.series: tuple[Harmonic, ...] = ()
        wave_generator, output = 0.0, 0.0
        if mounted:
            self.series = (*gear.kinematic_error, *self.deviations.kinematic_error)
            wave_generator = gear.inertia.wave_generator
            output = gear.inertia.output / self.ratio**2
        self.rotor_inertia = motor.rotor_inertia + wave_generator
        self.rotor_inertia += self.settings.disc_inertia
        self.inertia = self.rotor_inertia + output
        system = loop_tables.linear_system(self.parameters, self.rotor_inertia, coupled=mounted)
        self._step = np.concatenate(
            [
                loop_tables.step_matrix(system, length)
                for length in (self.time_step, self.time_step / at.FINE)
            ]
        )
        self._error, self._period = loop_tables.error_table(
            self.series, self.ratio, self.parameters.radial_lever
        )
        self._highest_speed = 2.0 * motor.maximum_speed
        self._friction = loop_tables.friction_table(
            gear, self.parameters, self._highest_speed, windup=self.deviations.friction_windup
        )
        if not mounted:
            self._friction[:] = 0.0
        worse = self.deviations.acts_in_each_step
        self._cogging = loop_tables.cogging_table(self.deviations.cogging) if worse else None
        self._physics = self._make_physics()
        self._servo = np.zeros(at.SERVO_SIZE)
        self.set_limits(ServoLimits(motor.peak_torque, motor.maximum_speed))

    def rest(self, angle: float = 0.0) -> FloatArray:
        """The state of standstill at an input angle [rad], unwound, servo off, cold."""
        state = np.zeros(at.STATE_SIZE)
        state[at.THETA] = angle
        if self.settings.gear_mounted:
            lever, tangent = self.parameters.radial_lever, math.tan(self.parameters.tooth_angle)
            error = lever * float(series_value(self.series, angle))
            state[at.ERROR] = state[at.R2] = error
            state[at.SLOPE] = lever * float(series_slope(self.series, angle))
            state[at.R1] = state[at.RO] = tangent * error
        thermal = self.deviations.thermal or Thermal()
        state[at.HOUSING], state[at.MOTOR] = thermal.housing_start, thermal.motor_start
        return state

    def set_limits(self, limits: ServoLimits) -> None:
        """Tell the drive its limits; they act from the next servo period on."""
        servo, values = self.settings.servo, self._servo
        steps = max(1, round(servo.period / self.time_step))
        period = steps * self.time_step
        # Tuned once, on the bare rotor or with its gear: nobody tunes it anew for a disc.
        tuned = self.inertia - self.settings.disc_inertia
        values[at.GAIN] = tuned * 2.0 * math.pi * servo.speed_gain
        values[at.INTEGRAL_STEP] = period / servo.integral_time
        values[at.FILTER_STEP] = _followed(period, servo.torque_filter_time)
        values[at.PERIOD_STEPS] = steps
        values[at.TORQUE_LIMIT], values[at.SPEED_LIMIT] = limits.torque, limits.speed
        values[at.RATE_UP] = limits.acceleration * period
        values[at.RATE_DOWN] = limits.deceleration * period
        values[at.RATE_QUICK_STOP] = limits.quick_stop_deceleration * period
        values[at.GUARD_GAIN] = values[at.GAIN]

    def advance(
        self, state: FloatArray, mode: int, targets: FloatArray, rows: FloatArray | None = None
    ) -> FloatArray:
        """Advance the state over one SYNC cycle per target; row k is what is true at SYNC k, before target[k] acts.

        `rows` (n, ROW_SIZE) is filled and returned; its columns are the ROW_ names of `model.kernels.closed_loop`.
        """
        if rows is None:
            rows = np.empty((len(targets), at.ROW_SIZE))
        kernel.advance(
            state,
            self._physics,
            self._servo,
            self._step,
            self._error,
            self._friction,
            self._cogging,
            mode,
            targets,
            self.substeps,
            rows,
        )
        return rows

    def _make_physics(self) -> FloatArray:
        """The scalar constants of the kernel."""
        p = np.zeros(at.PHYSICS_SIZE)
        motor, extra, parameters = self.motor, self.deviations, self.parameters
        p[at.H], p[at.RADIUS] = self.time_step, parameters.neutral_radius
        p[at.TANGENT] = math.tan(parameters.tooth_angle)
        p[at.K_B], p[at.C_B] = parameters.bearing_stiffness, parameters.bearing_damping
        p[at.CUP] = parameters.cup_stiffness
        p[at.ERROR_TURNS] = 1.0 / (2.0 * math.pi * self._period)
        p[at.ERROR_POINTS] = len(self._error) - 1
        if self.settings.gear_mounted:
            p[at.INVERSE_RATIO] = 1.0 / self.ratio
            p[at.LAMBDA] = parameters.radial_lever / self.ratio
            still = loop_tables.bearing_drag(self.gear, np.zeros(1))
            p[at.BEARING_LOW] = friction.bearing_lever(self.gear) * float(still[0])
            p[at.DEPTH] = extra.mesh_depth / max(self._largest_error(), 1e-12)
            p[at.OUTPUT_COULOMB] = extra.output_coulomb
            p[at.OUTPUT_VISCOUS] = extra.output_viscous / parameters.neutral_radius
            p[at.OUTPUT_PER_KELVIN] = extra.output_per_kelvin
            p[at.CREEP] = CREEP * self.gear.mesh_friction.stribeck_velocity
            self._fill_elastic(p)
        if extra.motor_friction:
            p[at.MOTOR_COULOMB] = motor.coulomb_friction
            p[at.MOTOR_VISCOUS] = motor.viscous_friction
        for place, step in (
            (at.PORT_STEP, self.time_step),
            (at.PORT_STEP_FINE, self.time_step / at.FINE),
        ):
            p[place] = _followed(step, extra.port_lag)
        if not 0.0 <= extra.output_latch < self.settings.cycle:
            raise ModelError(
                "the output cannot be latched when the next SYNC has come",
                where="output_latch",
                value=f"{extra.output_latch * 1e3:.3f} ms",
                limit=f"< {self.settings.cycle * 1e3:g} ms",
                remedy="Take a lower sampling rate, or a bench with less skew.",
            )
        p[at.LATCH] = extra.output_latch
        p[at.TORQUE_FACTOR] = 1.0 + extra.torque_constant_error
        p[at.FRICTION_SCALE] = loop_tables.FRICTION_POINTS / math.sqrt(self._highest_speed)
        p[at.FRICTION_LAST] = loop_tables.FRICTION_POINTS - 1
        p[at.COGGING_POINTS] = loop_tables.COGGING_POINTS if extra.cogging else 0
        self._fill_thermal(p)
        return p

    def _fill_elastic(self, p: FloatArray) -> None:
        """Hardening, hysteresis and play, parallel to the gear between rotor and output."""
        ratings, extra = self.gear.ratings, self.deviations
        stiffness = self.parameters.combined_stiffness
        p[at.KINK_1] = p[at.KINK_2] = math.inf
        if extra.hardening:
            second = stiffness * ratings.stiffness_2 / ratings.stiffness_1
            third = stiffness * ratings.stiffness_3 / ratings.stiffness_1
            p[at.KINK_1] = ratings.torque_1 / stiffness
            p[at.KINK_2] = p[at.KINK_1] + (ratings.torque_2 - ratings.torque_1) / second
            p[at.EXTRA_2], p[at.EXTRA_3] = second - stiffness, third - second
        p[at.HYSTERESIS_LIMIT] = extra.hysteresis_torque
        p[at.HYSTERESIS_BY_SLOPE] = extra.hysteresis_by_slope
        p[at.HYSTERESIS_STIFFNESS] = extra.hysteresis_stiffness * stiffness
        p[at.PLAY], p[at.SPRING] = 0.5 * extra.backlash, stiffness
        parallel = extra.hardening or extra.hysteresis_torque > 0.0 or extra.backlash > 0.0
        p[at.ELASTIC] = float(parallel)

    def _fill_thermal(self, p: FloatArray) -> None:
        """Heat stores and sensitivities; without `thermal` the stores are infinite."""
        heat = self.deviations.thermal
        if heat is None:
            return
        p[at.TORQUE_PER_KELVIN] = heat.torque_constant_per_kelvin
        p[at.COULOMB_PER_KELVIN] = heat.coulomb_per_kelvin
        p[at.VISCOUS_PER_KELVIN] = heat.viscous_per_kelvin
        p[at.MOTOR_PER_KELVIN] = heat.motor_friction_per_kelvin
        p[at.AMBIENT] = heat.ambient
        p[at.HOUSING_REFERENCE] = p[at.MOTOR_REFERENCE] = heat.reference
        p[at.HOUSING_STEP] = 1.0 / heat.housing_capacity
        p[at.MOTOR_STEP] = 1.0 / heat.motor_capacity
        p[at.HOUSING_LOSS] = heat.housing_conductance
        p[at.MOTOR_LOSS] = heat.motor_conductance
        p[at.COUPLING], p[at.COPPER] = heat.coupling, heat.copper_loss

    def _largest_error(self) -> float:
        """Largest |e| of the acting series [m]."""
        angle = np.linspace(0.0, 2.0 * math.pi, 720, endpoint=False)
        return (
            float(np.max(np.abs(series_value(self.series, angle)))) * self.parameters.radial_lever
        )
