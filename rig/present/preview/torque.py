"""The torque at the input that the model expects of a gear, quasi-statically, with the uncertainty of its parameters.

    T = sgn(theta_i') (T_f(|theta_i'|) + T_c,m + c_m |theta_i'|) + (J_i + J_o/N^2) theta_i''          (20) and the motor's own

    U = 2 sqrt( sum over p of (dT/dp u_p)^2 )        p: F_c, F_s, v_s, sigma, c_v, f_0, nu_0, T_c,m, c_m, J_wg, J_m, J_o,
                                                     and the warmth of the grease

The parameters are taken as independent; u_p is the standard uncertainty that the parameter set
states, or, where it states none, a share of the value by where the number comes from (`DOUBT`). At
standstill with the servo on, friction holds whatever torque is left: anything within the static
friction.
"""  # noqa: E501

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from experiments.protocols.friction.temperature import ASSUMED
from model.friction import BRANCH_LIMIT, bearing_lever, bearing_magnitude, mesh_lever
from model.gear import HarmonicDrive, Origin
from model.motor import ServoMotor
from model.units import RPM
from rig.bench.limits import STEP_FACTOR, Load

FloatArray = NDArray[np.float64]

COVERAGE = 2.0
"""k of the expanded uncertainty: about 95 %."""
DOUBT: Mapping[str, float] = {
    "measured": 0.03,
    "identified": 0.05,
    "catalogue": 0.1,
    "published": 0.15,
    "computed": 0.15,
    "recalled": 0.2,
    "assumed": 0.3,
}
"""Relative standard uncertainty of a parameter that states none, by its provenance."""
WARMTH = 2.0
"""K, standard uncertainty of the grease's temperature about that at which the parameters hold."""
_TREMBLE = 1e-6
"""rad/s that counts as turning: the least speed at which the friction curve is read."""
_LARGEST_EXPONENT = 700.0
"""exp(-700) is nothing, and still a number."""
_MESH = ("coulomb", "static", "stribeck_velocity", "shape", "viscous")


@dataclass(frozen=True)
class PredictedTorque:
    """Values and expanded uncertainties (95 %), arrays of one shape [N m]."""

    value: FloatArray
    uncertainty: FloatArray

    @property
    def low(self) -> FloatArray:
        """Lower edge of the band."""
        return self.value - self.uncertainty

    @property
    def high(self) -> FloatArray:
        """Upper edge of the band."""
        return self.value + self.uncertainty


@dataclass(frozen=True)
class TorqueModel:
    """Predicts the input torque of one rig: its gear (where one is mounted), its motor, what both turn.

    `disc_inertia` [kg m2] is the part of the load that a protocol has on the bare motor as a disc.
    """

    gear: HarmonicDrive
    motor: ServoMotor
    load: Load
    gear_mounted: bool = True
    disc_inertia: float = 0.0

    def running(self, speed: ArrayLike) -> PredictedTorque:
        """Magnitude of the torque that keeps the input turning at constant speeds [rad/s] of either sign."""
        omega = np.maximum(np.abs(np.asarray(speed, dtype=np.float64)), _TREMBLE)
        value, variance = np.zeros_like(omega), np.zeros_like(omega)
        for torque, doubt in self._friction(omega):
            value += torque
            variance += doubt**2
        return PredictedTorque(value, COVERAGE * np.sqrt(variance))

    def starting(self) -> PredictedTorque:
        """Torque at which the input begins to turn: the static friction of mesh, bearing and motor."""
        return self.running(0.0)

    def torque(
        self, speed: ArrayLike, acceleration: ArrayLike, direction: ArrayLike
    ) -> PredictedTorque:
        """Torque at signed speeds and accelerations; `direction` (+1, -1, 0) says which way it turns where the speed is
        passing zero; 0 is standstill."""
        friction = self.running(speed)
        sense = np.sign(np.asarray(direction, dtype=np.float64))
        alpha = np.asarray(acceleration, dtype=np.float64)
        inertia, doubt = self.inertia()
        value = sense * friction.value + inertia * alpha
        turning = np.hypot(friction.uncertainty, COVERAGE * doubt * alpha)
        standing = friction.value + friction.uncertainty
        return PredictedTorque(value, np.where(sense == 0.0, standing, turning))

    def inertia(self) -> tuple[float, float]:
        """What the motor turns, referred to the input [kg m2], and its standard uncertainty."""
        doubts = [_doubt(self.motor.origins.get("rotor_inertia"), self.motor.rotor_inertia)]
        if self.gear_mounted:
            inertia = self.gear.inertia
            doubts.append(self._gear_doubt("inertia.wave_generator", inertia.wave_generator))
            doubts.append(self.output_inertia_doubt() / self.load.ratio**2)
        doubts.append(DOUBT["measured"] * self.disc_inertia)
        return self.load.total_inertia, float(np.sqrt(np.sum(np.square(doubts))))

    def ringing(self, acceleration: ArrayLike) -> FloatArray:
        """Half-width of what the gear's spring makes of accelerations [rad/s2] that are there at once [N m].

        Rigid, the output takes its share alpha J_o/N^2 of the torque at once. Behind an undamped
        spring that share is alpha J_o/N^2 (1 - cos w t): anything from nothing, where a ramp ends
        before the spring is wound, to twice itself, the factor of the limits (`STEP_FACTOR`).
        """
        share = self.load.output_inertia / self.load.ratio**2
        return (STEP_FACTOR - 1.0) * share * np.abs(np.asarray(acceleration, dtype=np.float64))

    def output_inertia_doubt(self) -> float:
        """Standard uncertainty of J_o [kg m2]."""
        return self._gear_doubt("inertia.output", self.gear.inertia.output)

    def _friction(self, omega: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Contributions to the running torque, and the standard uncertainties that each parameter makes; speeds > 0."""
        motor = self.motor
        nothing = np.zeros_like(omega)
        doubt = _doubt(motor.origins.get("coulomb_friction"), motor.coulomb_friction)
        yield np.full_like(omega, motor.coulomb_friction), np.full_like(omega, doubt)
        doubt = _doubt(motor.origins.get("viscous_friction"), motor.viscous_friction)
        yield motor.viscous_friction * omega, doubt * omega
        if not self.gear_mounted:
            return
        drag, *drag_doubts = self._bearing(omega)
        mesh, *mesh_doubts = self._mesh(omega)
        yield drag + mesh, abs(ASSUMED["viscous"].value) * WARMTH * (drag + mesh)
        for one in (*drag_doubts, *mesh_doubts):
            yield nothing, one

    def _bearing(self, omega: FloatArray) -> tuple[FloatArray, ...]:
        gear, bearing = self.gear, self.gear.bearing
        branch = gear.options.low_speed_branch
        drag = bearing_lever(gear) * bearing_magnitude(bearing, omega, low_speed_branch=branch)
        factor = _relative(gear.origins.get("bearing.friction_factor"), bearing.friction_factor)
        if branch:
            rising = bearing.viscosity * 1e6 * omega / RPM > BRANCH_LIMIT
        else:
            rising = np.ones_like(omega, dtype=bool)
        viscosity = _relative(gear.origins.get("bearing.viscosity"), bearing.viscosity)
        return drag, drag * factor, np.where(rising, 2.0 / 3.0 * viscosity * drag, 0.0)

    def _mesh(self, omega: FloatArray) -> tuple[FloatArray, ...]:
        mesh, lever = self.gear.mesh_friction, mesh_lever(self.gear)
        ratio = omega / mesh.stribeck_velocity
        power = np.minimum(ratio**mesh.shape, _LARGEST_EXPONENT)
        decay = np.exp(-power)
        fall = (mesh.static - mesh.coulomb) * decay
        slopes = {
            "coulomb": 1.0 - decay,
            "static": decay,
            "stribeck_velocity": fall * mesh.shape * power / mesh.stribeck_velocity,
            "shape": -fall * power * np.log(ratio),
            "viscous": omega,
        }
        force = mesh.coulomb + fall + mesh.viscous * omega
        doubts = (
            lever
            * np.abs(slopes[name])
            * self._gear_doubt(f"mesh_friction.{name}", getattr(mesh, name))
            for name in _MESH
        )
        return lever * force, *doubts

    def _gear_doubt(self, path: str, value: float) -> float:
        return _doubt(self.gear.origins.get(path), value)


def _doubt(origin: Origin | None, value: float) -> float:
    """Standard uncertainty of a parameter: as stated, else by provenance."""
    origin = origin or Origin("assumed")
    if origin.standard_uncertainty is not None:
        return origin.standard_uncertainty
    return DOUBT[origin.provenance] * abs(value)


def _relative(origin: Origin | None, value: float) -> float:
    return _doubt(origin, value) / abs(value) if value else 0.0
