"""Equation 2 with a prescribed input angle, propagated exactly: what the output does when the input is known.

    M q'' + C q' + K q = B u(t) ,   q = (x2, y1, y2) ,   u = (theta_i/N + ke, its rate, F_fm, M_0, T_L)

`model.linear` has the matrices, the modes and `DynamicParameters`; `model.propagator` the exact
step. Friction and kinematic error depend on the input alone, so the only approximation is how u
goes on between (fine) samples: theta_i/N + ke as the cubic through its values and rates, friction
and load as straight lines.

Torque on the input (virtual work of the wedge, with the bearing's drag on the wave generator):

    F_b = K_b (x1 - x2 + e) + C_b (x1' - x2' + e') ,   T_wg = F_b (r_g tan alpha_n + de/d theta_i) + M_0
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from model.arrays import FloatArray, quotient
from model.errors import ModelError
from model.friction import BRANCH_LIMIT, bearing_magnitude
from model.gear import HarmonicDrive
from model.kinematic_error import series_slope, series_value
from model.linear import DynamicParameters, ParameterTable, common_ratio, dynamic_parameters
from model.propagator import OUTPUTS, propagators
from model.units import ARCSEC, RPM

Start = Literal["rest", "steady"]

LONGEST_STEP = 2.5e-4
"""s; measured inputs are refined to at most this interval, so that friction is followed through a reversal."""
_SERIES_ERROR = 0.001 * ARCSEC
"""rad; the refinement keeps the interpolation error of the kinematic error below this (a resonance magnifies it)."""
BLOCK = 1 << 15
"""Fine samples handled at once, which bounds the memory of a long record."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PrescribedResponse:
    """What equation 2 answers to a prescribed input, at the samples of the input (arrays of shape (n,)).

    `input_angle`, `input_speed` as used [rad, rad/s]; `output_angle` theta_o, `output_speed`
    theta_o'; `torsion_torque` of the cup [N m at the output]; `wave_generator_torque` T_wg [N m at
    the input, motor not included]; `final_state` q and q' (6,) at the last sample; `substeps` fine
    samples per interval.
    """

    sample_interval: float
    input_angle: FloatArray
    input_speed: FloatArray
    output_angle: FloatArray
    output_speed: FloatArray
    torsion_torque: FloatArray
    wave_generator_torque: FloatArray
    final_state: FloatArray = field(repr=False)
    substeps: int = 1

    @property
    def time(self) -> FloatArray:
        """Time from the first sample [s]."""
        return np.arange(self.input_angle.size, dtype=np.float64) * self.sample_interval


@dataclass(frozen=True, slots=True)
class BatchResponse:
    """Answers of several parameter sets to one input: `output_angle` and `output_speed` of shape (sets, n)."""

    sample_interval: float
    output_angle: FloatArray
    output_speed: FloatArray
    substeps: int = 1


def simulate_prescribed(
    gear: HarmonicDrive,
    input_angle: ArrayLike,
    sample_interval: float,
    *,
    input_speed: ArrayLike | None = None,
    load_torque: ArrayLike | None = None,
    parameters: DynamicParameters | None = None,
    start: Start | ArrayLike = "rest",
    substeps: int | None = None,
    smoothing_speed: float = 0.0,
) -> PrescribedResponse:
    """Simulate equation 2 for a commanded or measured input angle (n,) sampled every `sample_interval` [s].

    `input_speed` (n,) [rad/s] is derived by fourth-order differences where it is not given; hand a
    proper estimate in for counted angles. Between samples the angle is the cubic through both,
    refined to `substeps` per interval (chosen from the kinematic error and the speed when None).
    `load_torque` (n,) or a number [N m] opposes the output. `parameters` replaces the numbers of
    equation 2 (`dynamic_parameters(gear, cup_stiffness=..)`); friction and kinematic error are the
    gear's, in the forces of equation 2 as they stand. `start` is "rest" (consistent, no transient),
    "steady" (already turning at the first speed, wound up by friction) or q and q' (6,).
    `smoothing_speed` [rad/s] replaces the sign of the friction by tanh; use it for measured speeds
    that tremble about zero.

    Raises `ModelError` for arrays that do not fit, are not finite, or an interval that is not positive.
    """
    inputs = _Inputs(
        gear,
        [parameters or dynamic_parameters(gear)],
        input_angle,
        sample_interval,
        input_speed=input_speed,
        load_torque=load_torque,
        substeps=substeps,
        smoothing=smoothing_speed,
    )
    result = np.empty((1, len(OUTPUTS), inputs.angle.size))
    final = inputs.propagate(start, result)
    output_angle, output_speed, torsion, torque = result[0]
    return PrescribedResponse(
        sample_interval=sample_interval,
        input_angle=inputs.angle,
        input_speed=inputs.speed,
        output_angle=output_angle,
        output_speed=output_speed,
        torsion_torque=torsion,
        wave_generator_torque=torque,
        final_state=final[0],
        substeps=inputs.steps,
    )


def simulate_batch(
    gear: HarmonicDrive,
    sets: Sequence[DynamicParameters],
    input_angle: ArrayLike,
    sample_interval: float,
    *,
    input_speed: ArrayLike | None = None,
    load_torque: ArrayLike | None = None,
    start: Start = "rest",
    substeps: int | None = None,
    smoothing_speed: float = 0.0,
) -> BatchResponse:
    """Simulate equation 2 for several parameter sets and one input, side by side; arguments as `simulate_prescribed`.

    The sets share the ratio, and the friction and kinematic error of the gear. A set without a well-conditioned modal
    form is propagated on its own. Raises `ModelError` as `simulate_prescribed`, `ParameterError` for an empty batch.
    """
    inputs = _Inputs(
        gear,
        sets,
        input_angle,
        sample_interval,
        input_speed=input_speed,
        load_torque=load_torque,
        substeps=substeps,
        smoothing=smoothing_speed,
    )
    result = np.empty((len(sets), 2, inputs.angle.size))
    inputs.propagate(start, result)
    return BatchResponse(sample_interval, result[:, 0], result[:, 1], inputs.steps)


class _Inputs:
    """The inputs of equation 2 over a record, refined block by block, and the compiled loops over them."""

    def __init__(
        self,
        gear: HarmonicDrive,
        sets: Sequence[DynamicParameters],
        input_angle: ArrayLike,
        interval: float,
        *,
        input_speed: ArrayLike | None,
        load_torque: ArrayLike | None,
        substeps: int | None,
        smoothing: float,
    ) -> None:
        self.angle, self.speed, self.load = _checked_input(
            input_angle, interval, input_speed, load_torque
        )
        self.gear, self.interval, self.sets = gear, interval, sets
        self.ratio = float(common_ratio(self.sets))
        self.steps = _substeps(gear, self.speed, interval, substeps)
        series = gear.kinematic_error
        self.series = np.array(
            [[h.order for h in series], [h.cosine for h in series], [h.sine for h in series]]
        )
        mesh, bearing = gear.mesh_friction, gear.bearing
        drag = 0.1 * bearing.friction_factor * bearing.pitch_diameter**3
        least = BRANCH_LIMIT if gear.options.low_speed_branch else 0.0
        self.friction = np.array(
            [
                mesh.coulomb,
                mesh.static - mesh.coulomb,
                mesh.stribeck_velocity,
                mesh.shape,
                mesh.viscous,
                drag,
                bearing.viscosity * 1e6 / RPM,
                least,
                smoothing,
            ]
        )
        self.static_force = mesh.static
        self.static_torque = float(
            bearing_magnitude(bearing, 0.0, low_speed_branch=gear.options.low_speed_branch)
        )

    def at_sample(self, index: int) -> FloatArray:
        """The inputs u- (5,) at a sample, friction by the compiled law that the loops use (none at zero speed)."""
        from model.kernels.propagation import friction_signals

        theta, omega = float(self.angle[index]), float(self.speed[index])
        series = self.gear.kinematic_error
        ideal = theta / self.ratio + float(series_value(series, theta))
        rate = (1.0 / self.ratio + float(series_slope(series, theta))) * omega
        rows = np.empty((3, 1))
        friction_signals(np.array([omega]), 0.0, 0.0, self.friction, rows[0], rows[1], rows[2])
        return np.array(
            [ideal, rate, rows[0, 0], rows[1, 0], self.load[index] if self.load.size else 0.0]
        )

    def blocks(self):
        """Fine angle, speed and load of each block, the speeds next to it, and where its samples belong.

        The last block holds the last sample alone. Yields (angle, speed, load, before, after, first sample index).
        """
        from model.kernels.propagation import refine

        coarse = max(1, BLOCK // self.steps)
        last = self.angle.size - 1
        before = 0.0
        for begin in range(0, last, coarse):
            end = min(begin + coarse, last)
            load = self.load[begin : end + 1]
            if self.steps == 1:
                angle, speed, fine_load = self.angle[begin:end], self.speed[begin:end], load[:-1]
            else:
                count = (end - begin) * self.steps
                angle, speed = np.empty(count), np.empty(count)
                fine_load = np.empty(count if load.size else 0)
                span = slice(begin, end + 1)
                refine(
                    self.angle[span],
                    self.speed[span],
                    self.interval,
                    load,
                    self.steps,
                    angle,
                    speed,
                    fine_load,
                )
            yield angle, speed, fine_load, before, self.speed[end], begin
            before = speed[-1]
        yield self.angle[last:], self.speed[last:], self.load[last:], before, 0.0, last

    def propagate(self, start: Start | ArrayLike, result: FloatArray) -> FloatArray:
        """Fill `result` (sets, outputs, n) with the first outputs of every set; returns q and q'
        (sets, 6) at the end.
        """
        from model.kernels import propagation

        sets, first, last = self.sets, self.at_sample(0), self.angle.size - 1
        states = _start_states(sets, start, first)
        outputs = result.shape[1]
        for places, step in propagators(sets, self.interval / self.steps):
            kick = step.kick(self.static_force, self.static_torque)
            carried = step.carried(states[places], first)
            observed = np.ascontiguousarray(step.output[:, :outputs])
            through = np.ascontiguousarray(step.through[:, :outputs])
            whole = len(places) == len(sets)
            target = result if whole else np.empty((len(places), *result.shape[1:]))
            for angle, speed, load, before, after, index in self.blocks():
                if index == last:
                    states[places] = step.coordinates(carried, self.at_sample(last))
                propagation.propagate(
                    angle,
                    speed,
                    before,
                    after,
                    load,
                    self.ratio,
                    self.series,
                    self.friction,
                    step.lever,
                    step.dense,
                    step.decay,
                    step.transition,
                    step.gain,
                    kick,
                    observed,
                    through,
                    carried,
                    self.steps,
                    index,
                    target,
                )
            if not whole:
                result[places] = target
        return states


def _start_states(
    sets: Sequence[DynamicParameters], start: Start | ArrayLike, inputs: FloatArray
) -> FloatArray:
    """q and q' (S, 6) at the first sample: given, at rest without friction, or turning steadily and wound up by it."""
    if not isinstance(start, str):
        state = np.asarray(start, dtype=np.float64).ravel()
        if state.shape != (6,) or not np.isfinite(state).all():
            raise ModelError(
                "is no state of the drive",
                where="start",
                value=f"{state.size} numbers",
                limit="6: q and q'",
            )
        return np.tile(state, (len(sets), 1))
    if start not in ("rest", "steady"):
        raise ModelError(
            "is no way to start", where="start", value=start, limit='"rest", "steady" or q and q\''
        )
    table = ParameterTable.of(sets)
    active = [0, 4] if start == "rest" else [0, 2, 3, 4]
    force = table.inputs()[:, :, active] @ inputs[active]
    states = np.zeros((len(sets), 6))
    states[:, :3] = np.linalg.solve(table.stiffness(), force[..., None])[..., 0]
    if start == "steady":
        states[:, 3] = table.radial_lever * inputs[1]
        states[:, 4] = states[:, 5] = table["neutral_radius"] * inputs[1]
    return states


def _checked_input(
    input_angle: ArrayLike,
    interval: object,
    input_speed: ArrayLike | None,
    load_torque: ArrayLike | None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Angle, speed and load (empty for none) as contiguous arrays of one length; refused where they do not fit."""
    angle = _loose(input_angle)
    if angle.ndim != 1 or angle.size < 2:
        raise ModelError(
            "needs an input angle",
            where="input_angle",
            value=f"shape {angle.shape}",
            limit="(n,), n >= 2",
        )
    if not (isinstance(interval, (int, float)) and math.isfinite(interval) and interval > 0.0):
        raise ModelError(
            "is no sample interval", where="sample_interval", value=interval, limit="> 0 s"
        )
    speed = derived_speed(angle, interval) if input_speed is None else _loose(input_speed)
    load = np.empty(0)
    if load_torque is not None:
        load = _loose(np.broadcast_to(np.asarray(load_torque, dtype=np.float64), angle.shape))
    for name, array in (("input_angle", angle), ("input_speed", speed), ("load_torque", load)):
        if array.shape != angle.shape and not (name == "load_torque" and array.size == 0):
            raise ModelError(
                "does not fit the input angle",
                where=name,
                value=f"shape {array.shape}",
                limit=str(angle.shape),
            )
        if not np.isfinite(array).all():
            where = f"{name}[{int(np.flatnonzero(~np.isfinite(array))[0])}]"
            raise ModelError(
                "is not finite", where=where, remedy="Cut or fill the hole before the simulation."
            )
    return angle, speed, load


def _loose(values: ArrayLike) -> FloatArray:
    """A contiguous array that may be written: the compiled loops know one kind of array only."""
    return np.require(values, np.float64, ["C_CONTIGUOUS", "WRITEABLE"])


def derived_speed(angle: FloatArray, interval: float) -> FloatArray:
    """theta_i' (n,) by central differences of fourth order, of lower order next to the ends [rad/s].

    The first and the last are differences of two angles, so that a start from rest has the sign of the motion.
    """
    speed = np.gradient(angle, interval)
    if angle.size >= 5:
        speed[2:-2] = (8.0 * (angle[3:-1] - angle[1:-3]) - (angle[4:] - angle[:-4])) / (
            12.0 * interval
        )
    return speed


def _substeps(gear: HarmonicDrive, speed: FloatArray, interval: float, given: int | None) -> int:
    """Fine samples per interval: so many that the interpolation of the kinematic error stays within `_SERIES_ERROR`.

    The cubic through values and rates of a sinusoid of amplitude A and frequency w is wrong by A (w h)^4/384.
    """
    if given is not None:
        if given != int(given) or given < 1:
            raise ModelError(
                "is no number of substeps",
                where="substeps",
                value=given,
                limit="a whole number >= 1",
            )
        return int(given)
    fourth = (
        sum(h.amplitude * h.order**4 for h in gear.kinematic_error)
        * float(np.max(np.abs(speed))) ** 4
    )
    longest = min(LONGEST_STEP, quotient(384.0 * _SERIES_ERROR, fourth, math.inf) ** 0.25)
    return max(1, math.ceil(interval / longest - 1e-9))
