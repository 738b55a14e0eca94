"""The plant of both simulated rigs: motor, gear and load in closed loop, advanced cycle by cycle, with a snapshot.

Whoever stands in front of it (the direct rig, or virtual devices on a bus) tells it the mode of the servo loop and the
set-points that the drive received, and gets the truth of every SYNC back.
"""

from __future__ import annotations

from drivers.port import DriveLimits
from model.arrays import FloatArray
from model.closed_loop import ClosedLoop, LoopSettings, ServoLimits
from model.gear import HarmonicDrive, Mounting
from model.kernels import loop_layout as at
from model.motor import ServoMotor
from sim_backend.condition import Condition
from sim_backend.world import ThermalState

_SUBSTEP = 125e-6
"""Longest step of the simulation [s]; the servo loop runs at twice that."""


class Plant:
    """Everything that moves and warms. `load` is a torque on the output against its positive sense [N m]."""

    def __init__(
        self,
        gear: HarmonicDrive,
        motor: ServoMotor,
        condition: Condition,
        *,
        cycle_ns: int,
        mounting: Mounting,
        gear_mounted: bool,
        disc_inertia: float,
    ) -> None:
        settings = LoopSettings(mounting, gear_mounted, disc_inertia, cycle_ns * 1e-9, _SUBSTEP)
        self.loop = ClosedLoop(gear, motor, condition.deviations, settings)
        self._state = self.loop.rest(condition.start_angle)

    def advance(self, loop_mode: int, targets: FloatArray) -> FloatArray:
        """Run one cycle per target [rad/s or N m]; row k is the truth at SYNC k, before target[k] acts."""
        return self.loop.advance(self._state, loop_mode, targets)

    def write_limits(self, limits: DriveLimits) -> None:
        """The drive's limits act from now on."""
        self.loop.set_limits(
            ServoLimits(
                limits.torque,
                limits.speed,
                limits.acceleration,
                limits.deceleration,
                limits.quick_stop_deceleration,
            )
        )

    @property
    def load(self) -> float:
        """External torque on the output [N m]."""
        return float(self._state[at.LOAD])

    @load.setter
    def load(self, torque: float) -> None:
        self._state[at.LOAD] = torque

    @property
    def output_angle(self) -> float:
        """Output angle now [rad], positive when it follows a positive input."""
        state = self._state
        inverse_ratio = 1.0 / self.loop.ratio if self.loop.settings.gear_mounted else 0.0
        radius = self.loop.gear.geometry.neutral_radius
        return float(state[at.THETA] * inverse_ratio + state[at.RO] / radius - state[at.WINDUP])

    @property
    def input_speed(self) -> float:
        """Input speed now [rad/s]."""
        return float(self._state[at.W])

    @property
    def thermal_state(self) -> ThermalState:
        """How warm housing and motor are now."""
        state = self._state
        return ThermalState(housing=float(state[at.HOUSING]), motor=float(state[at.MOTOR]))

    @property
    def mean_temperatures(self) -> ThermalState:
        """How warm housing and motor were on average since the start."""
        state = self._state
        cycles = float(state[at.CYCLES])
        if not cycles:
            return self.thermal_state
        return ThermalState(
            housing=float(state[at.HOUSING_SUM]) / cycles,
            motor=float(state[at.MOTOR_SUM]) / cycles,
        )

    def snapshot(self) -> FloatArray:
        """Everything that changes, as one array."""
        return self._state.copy()

    def restore(self, snapshot: FloatArray) -> None:
        """Go back to a snapshot."""
        self._state[:] = snapshot
