"""What the model expects of the output: its kinematic error over the input angle, and how the error
shakes it at a speed.

    theta_o = theta_i/N + H(n theta_i') ke_n          H from equation 2 with the input turning steadily
    ripple of the output speed:  n |theta_i'| A_n |H|        torque in the gear:  J_o (n theta_i')^2 A_n |H|

with all orders taken at their crests at once. Near a resonance n theta_i' = omega_1 the damping
decides, which is the least known number of a gear: the height of a resonance is an order of
magnitude, its speed is not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.gear import HarmonicDrive, Mounting, Origin
from model.gear_file import harmonic_path
from model.kinematic_error import series_value
from model.linear import (
    damping_matrix,
    dynamic_parameters,
    input_matrix,
    mass_matrix,
    stiffness_matrix,
)
from model.units import REVOLUTION
from rig.present.preview.torque import COVERAGE, DOUBT

FloatArray = NDArray[np.float64]
ANGLES = 361


@dataclass(frozen=True)
class PredictedError:
    """The kinematic error over one input revolution: angle, value and expanded uncertainty [rad], (n,) each."""

    angle: FloatArray
    value: FloatArray
    uncertainty: FloatArray


@dataclass(frozen=True)
class OutputModel:
    """Predicts the output of one gear as it is mounted."""

    gear: HarmonicDrive
    mounting: Mounting

    def kinematic_error(self) -> PredictedError:
        """The kinematic error of the parameter set, without its constant."""
        angle = np.linspace(0.0, REVOLUTION, ANGLES)
        series = self.gear.kinematic_error
        spread = COVERAGE * math.hypot(*(self._doubt(h.order, h.amplitude) for h in series))
        return PredictedError(angle, series_value(series, angle), np.full(ANGLES, spread))

    def response(self, frequency: ArrayLike) -> FloatArray:
        """|H| of the output angle to theta_i/N + ke at angular frequencies [rad/s], of the same shape."""
        omega = np.asarray(frequency, dtype=np.float64)
        p = dynamic_parameters(self.gear, ratio=self.gear.mounted_ratio(self.mounting))
        mass, damping, stiffness, inputs = (
            mass_matrix(p),
            damping_matrix(p),
            stiffness_matrix(p),
            input_matrix(p),
        )
        s = 1j * omega.reshape(-1, 1, 1)
        drive = (inputs[:, 0] + 1j * omega.reshape(-1, 1) * inputs[:, 1])[..., None]
        moved = np.linalg.solve(mass * s**2 + damping * s + stiffness, drive)[:, 2, 0]
        return (np.abs(moved) / p.neutral_radius).reshape(omega.shape)

    def ripple(self, speed: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Amplitudes at steady input speeds [rad/s]: of the output speed [rad/s], of the torque in the gear [N m]."""
        omega = np.abs(np.asarray(speed, dtype=np.float64))
        shaking, torque = np.zeros_like(omega), np.zeros_like(omega)
        for harmonic in self.gear.kinematic_error:
            frequency = harmonic.order * omega
            moved = harmonic.amplitude * self.response(frequency)
            shaking += frequency * moved
            torque += self.gear.inertia.output * frequency**2 * moved
        return shaking, torque

    def ripple_doubt(self) -> float:
        """Relative expanded uncertainty of a ripple, from that of the kinematic error alone."""
        total = sum(h.amplitude for h in self.gear.kinematic_error)
        if total == 0.0:
            return 0.0
        return (
            COVERAGE
            * sum(self._doubt(h.order, h.amplitude) for h in self.gear.kinematic_error)
            / total
        )

    def _doubt(self, order: float, amplitude: float) -> float:
        origin = self.gear.origins.get(harmonic_path(order), Origin("assumed"))
        if origin.standard_uncertainty is not None:
            return origin.standard_uncertainty
        return DOUBT[origin.provenance] * amplitude
