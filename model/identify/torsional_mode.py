"""The torsional mode as a velocity step shows it: the output on the gear's compliance, with everything in units of J_o.

    theta_o'' = k_s (u - theta_o - b) + stiffening(phi) + h + g phi' - d ,   phi = u - theta_o
    tau b' = beta/(1 - beta) (phi - b) - b ,   k_s = (K/J_o)/(1 - beta)

the reduced form of equation 2 (the modes of the flexspline lie above 6 kHz): b is the torsion of the
wave-generator bearing, which has the share beta of the compliance and the damping of equation 2, tau = C_b/K_b.
Damping in one of several springs in series stiffens it, so the mode's frequency is not sqrt(K/J_o); what is
damped beside all of them, g, does not stiffen. Beyond equation 2: the spring hardens from
K1 to K2 and K3 at the torques T1 and T2, and h is a Dahl element for the hysteresis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from model.identify.checks import Array


@dataclass(frozen=True, kw_only=True)
class TorsionModel:
    """One set of numbers of the mode: K/J_o [1/s2], tau [s], beta [1], loss g [1/s].

    `second`, `third`: K2/K1 and K3/K1; `torques`: T1/J_o and T2/J_o [rad/s2]; `hysteresis`: stiffness over J_o
    [1/s2] and limit over J_o [rad/s2] of the Dahl element, 0 for none.
    """

    stiffness: float
    relaxation: float
    share: float
    loss: float = 0.0
    second: float = 1.0
    third: float = 1.0
    torques: tuple[float, float] = (math.inf, math.inf)
    hysteresis: tuple[float, float] = (0.0, 0.0)

    @property
    def kinks(self) -> Array:
        """Torsions at which the spring hardens [rad]."""
        first = self.torques[0] / self.stiffness
        return np.array(
            [first, first + (self.torques[1] - self.torques[0]) / (self.stiffness * self.second)]
        )

    @property
    def offsets(self) -> Array:
        """Acceleration of each piece of the spring at zero torsion [rad/s2]."""
        if self.second == self.third == 1.0 or not math.isfinite(self.torques[0]):
            return np.zeros(3)
        first, second = self.kinks
        bend = (1.0 - self.second) * self.stiffness * first
        return np.array([0.0, bend, bend + (self.second - self.third) * self.stiffness * second])

    def step(self, interval: float, observer: float = 0.0) -> Array:
        """Exact steps (3, 3, 6) of the pieces of the spring: states, u at start and end, constant acceleration.

        `observer` [1/s]: how strongly a measured speed is followed, which is part of that acceleration.
        """
        tables = np.empty((3, 3, 6))
        for piece, factor in enumerate((1.0, self.second, self.third)):
            if piece and factor == 1.0:
                tables[piece] = tables[0]
            else:
                tables[piece] = self._step(interval, (factor - 1.0) * self.stiffness, observer)
        return tables

    def system(self, extra: float = 0.0) -> Array:
        """d/dt of (theta_o, theta_o', b) (3, 3) with a spring of `extra` [1/s2] beside the gear."""
        series = self.stiffness / (1.0 - self.share)
        yielding = self.share / (1.0 - self.share)
        return np.array(
            [
                [0.0, 1.0, 0.0],
                [-series - extra, -self.loss, -series],
                [-yielding / self.relaxation, 0.0, -(1.0 + yielding) / self.relaxation],
            ]
        )

    def _step(self, interval: float, extra: float, observer: float) -> Array:
        from model.kernels.steps import exponential

        whole = np.zeros((6, 6))
        system = self.system(extra)
        whole[:3, :3] = system
        whole[1, 1] -= observer
        whole[:3, 3] = -system[:, 0]
        whole[3, 4] = 1.0
        whole[1, 4] = self.loss
        whole[1, 5] = 1.0
        exact = exponential(whole * interval)[:3]
        late = exact[:, 4] / interval
        return np.column_stack([exact[:, :3], exact[:, 3] - late, late, exact[:, 5]])

    def mode(self, acceleration: float = 0.0) -> tuple[float, float]:
        """Natural frequency |pole| [rad/s] and damping ratio of the mode at a torque amplitude over J_o [rad/s2]; NaN
        for numbers so far from any spring that it has no mode.

        The Dahl element acts as the spring and the damper that do over a swing what it does.
        """
        soft, limit = self.hysteresis
        frequency, lost = math.sqrt(self.stiffness), 0.0
        if limit > 0.0 and acceleration > 0.0:
            swing = acceleration / self.secant(acceleration)
            pull = limit * math.tanh(swing * soft / limit)
            lost = 4.0 * limit * (swing - pull / soft) / (math.pi * swing**2)
            soft = pull / swing
        pole = 1j * frequency
        for _ in range(3):
            if not 0.0 < abs(pole) < math.inf:
                return math.nan, math.nan
            system = self.system(soft)
            system[1, 1] -= lost / abs(pole)
            if not np.all(np.isfinite(system)):
                return math.nan, math.nan
            poles = np.linalg.eigvals(system)
            pole = poles[int(np.argmax(poles.imag))]
        return float(abs(pole)), float(-pole.real / abs(pole))

    def secant(self, acceleration: float) -> float:
        """Secant stiffness over inertia [1/s2] between reversals at +- this torque over J_o [rad/s2].

        Between reversals at +-phi the Dahl element carries H tanh(phi s/H).
        """
        torsion = acceleration / (self.stiffness + self.hysteresis[0])
        for _ in range(40):
            torsion *= acceleration / self.carried(torsion)
        return acceleration / torsion

    def carried(self, torsion: float) -> float:
        """Torque over J_o [rad/s2] at the end of a swing to a torsion > 0, spring and Dahl element."""
        soft, limit = self.hysteresis
        pull = limit * math.tanh(torsion * soft / limit) if limit > 0.0 else 0.0
        return self.elastic(torsion) + pull

    def elastic(self, torsion: float) -> float:
        """Torque of the hardening spring over J_o at a torsion >= 0 [rad/s2]."""
        first, second = (float(kink) for kink in self.kinks)
        torque = self.stiffness * torsion
        if torsion > first:
            torque += (self.second - 1.0) * self.stiffness * (torsion - first)
        if torsion > second:
            torque += (self.third - self.second) * self.stiffness * (torsion - second)
        return torque
