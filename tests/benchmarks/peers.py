"""The closed loop and the prescribed-input model as one would write them for a general solver: the
peers of the benchmark.

The same equation 2, the same PI speed loop (continuous here, which favours the solver), friction smoothed by tanh.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class PeerParameters:
    """Numbers of equation 2 and of the loop, SI: see `as_array` for the order."""

    tooth_angle: float
    neutral_radius: float
    ratio: float
    mesh_stiffness: float
    bearing_stiffness: float
    bearing_damping: float
    cup_stiffness: float
    cup_damping: float
    flexspline_inertia: float
    output_inertia: float
    rotor_inertia: float
    coulomb: float
    viscous: float
    error_amplitude: float
    proportional: float
    integral_time: float
    torque_limit: float

    def as_array(self) -> FloatArray:
        return np.array([float(v) for v in self.__dict__.values()])


@numba.njit(cache=False)
def closed_loop_rhs(state: FloatArray, target: float, p: FloatArray, out: FloatArray) -> None:
    """d/dt of [theta_i, w, x2, x2', y1, y1', y2, y2', integral of the speed error]."""
    at, rg, n, km, kb, cb, kt, ct, jg, jo, jr, fc, fv, ea, kp, ti, limit = p
    s, c = math.sin(at), math.cos(at)
    wedge = rg / (n * math.tan(at))
    mg, mo = jg / rg**2, jo / rg**2
    theta, w, x2, vx2, y1, vy1, y2, vy2, integral = state
    e = ea * math.cos(2.0 * theta)
    de = -2.0 * ea * math.sin(2.0 * theta)
    fb = kb * (wedge * theta - x2 + e) + cb * (wedge * w - vx2 + de * w)
    fm = km * (x2 * s - y1 * c)
    cup = kt / rg**2 * (y1 - y2) + ct / rg**2 * (vy1 - vy2)
    error = target - w
    torque = kp * (error + integral / ti)
    held = min(max(torque, -limit), limit)
    friction = (fc + fv * abs(w)) * math.tanh(w / 0.1)
    out[0] = w
    out[1] = (held - fb * (wedge + de) - friction) / jr
    out[2] = vx2
    out[3] = (fb - fm * s) / mg
    out[4] = vy1
    out[5] = (fm * c - cup) / mg
    out[6] = vy2
    out[7] = cup / mo
    out[8] = error if held == torque else 0.0


def cvode_closed_loop(
    parameters: PeerParameters, target: float, duration: float, interval: float
) -> FloatArray:
    """Speed step from rest with SUNDIALS CVODE (BDF, rtol 1e-6), output every `interval` [s]: states (n, 9)."""
    from sksundae.cvode import CVODE  # type: ignore[import-not-found]

    p = parameters.as_array()

    def rhs(_t: float, y: FloatArray, yp: FloatArray) -> None:
        closed_loop_rhs(y, target, p, yp)

    solver = CVODE(rhs, rtol=1e-6, atol=1e-9, method="BDF", max_num_steps=100_000_000)
    found = solver.solve(np.arange(0.0, duration + 0.5 * interval, interval), np.zeros(9))
    return np.asarray(found.y)


def solve_ivp_closed_loop(
    parameters: PeerParameters, target: float, duration: float, interval: float
) -> FloatArray:
    """The same with scipy's Radau: states (n, 9)."""
    from scipy.integrate import solve_ivp

    p = parameters.as_array()

    def rhs(_t: float, y: FloatArray) -> FloatArray:
        out = np.empty(9)
        closed_loop_rhs(y, target, p, out)
        return out

    times = np.arange(0.0, duration + 0.5 * interval, interval)
    return solve_ivp(rhs, (0.0, times[-1]), np.zeros(9), "Radau", times, rtol=1e-6, atol=1e-9).y.T
