"""Exact propagation of equation 2 over one sample interval, as numbers for the compiled loops.

With x' = A x + B u and u linear between samples (first-order hold, u- before and u+ after a jump at a sample),

    x[k+1] = exp(A h) x[k] + B0 u[k]+ + B1 u[k+1]-
    B1 = h phi2(A h) B ,  B0 = h (phi1(A h) - phi2(A h)) B ,  phi1(z) = (e^z - 1)/z ,  phi2(z) = (phi1(z) - 1)/z

The loops carry zeta = x - B1 u-, which needs the inputs of one sample only:

    zeta[k+1] = exp(A h) zeta[k] + (exp(A h) B1 + B0) u[k]- + B0 (u[k]+ - u[k]-) ,   y[k] = C zeta[k] + (C B1 + D) u[k]-

In modal coordinates exp(A h) is diagonal: a complex pair is one mode of double weight, a real pole one of single weight.
Where the eigenvectors are nearly dependent (critical damping) the full matrix exponential is used instead.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.linear import INPUTS, DynamicParameters, energy_forms

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

LARGEST_CONDITION = 1e5
"""Condition number of the eigenvectors (in the energy norm) above which the dense exponential is used."""

OUTPUTS = ("output_angle", "output_speed", "torsion_torque", "bearing_force")
"""Rows of `Propagator.output`: theta_o [rad], theta_o' [rad/s], cup torque [N m], F_b [N]."""

QUAD = 4
"""Modes are padded to a multiple of this, because the compiled loop advances four side by side."""


@dataclass(frozen=True)
class Propagator:
    """Parameter sets (first axis, S) over one interval: arrays with real and imaginary parts apart, m modes.

    `decay` (S, 2, m) of exp(lambda h), or `transition` (S, 6, 6) where `dense`; `gain` (S, 2, m, 5), `start` = B0 and
    `lead` = B1 of the same shape; `output` (S, 4, 2, m), `through` (S, 4, 5); `encode` (S, .., 6) complex makes modes of
    q, q' and `decode` (S, 6, ..) takes them back (real part); `lever` (S,) is r_g/tan(alpha_t).
    """

    dense: bool
    decay: Array
    transition: Array
    gain: Array
    start: Array
    lead: Array
    output: Array
    through: Array
    encode: ComplexArray
    decode: ComplexArray
    lever: Array

    def carried(self, coordinates: Array, inputs: Array) -> Array:
        """zeta (S, 2, m) that the loops carry, from q and q' (S, 6) and the inputs u- (5,) at the same sample."""
        modes = (self.encode @ coordinates[..., None])[..., 0]
        return _parts(modes, self.decay.shape[2], 1) - self.lead @ inputs

    def coordinates(self, carried: Array, inputs: Array) -> Array:
        """q and q' (S, 6) from the carried zeta (S, 2, m) and the inputs u- (5,) at the same sample."""
        modes = (carried + self.lead @ inputs)[:, :, : self.decode.shape[2]]
        return np.real((self.decode @ (modes[:, 0] + 1j * modes[:, 1])[..., None])[..., 0])

    def kick(self, static_force: float, static_torque: float) -> Array:
        """What a unit step of the sign of motion adds to zeta (S, 2, m), with F_fm and M_0 at zero speed."""
        return static_force * self.start[..., 2] + static_torque * self.start[..., 3]


def propagators(sets: Sequence[DynamicParameters], interval: float) -> list[tuple[list[int], Propagator]]:
    """The exact propagation of parameter sets over `interval` [s]: groups of places in `sets` with their arrays.

    Sets whose eigenvectors are well conditioned form one modal group, the others one dense group. A single set is
    remembered, because a run is simulated segment by segment with the same gear.
    """
    return _remembered(sets[0], interval) if len(sets) == 1 else _groups(sets, interval)


@functools.lru_cache(maxsize=32)
def _remembered(p: DynamicParameters, interval: float) -> list[tuple[list[int], Propagator]]:
    """The arrays of one set; nobody writes to them."""
    return _groups([p], interval)


def _groups(sets: Sequence[DynamicParameters], interval: float) -> list[tuple[list[int], Propagator]]:
    """The work of `propagators`."""
    systems, drives, positions, velocities = energy_forms(sets)
    poles, vectors = np.linalg.eig(systems)
    modal, inverses = _well_conditioned(vectors)
    groups: list[tuple[list[int], Propagator]] = []
    for places in (np.flatnonzero(modal).tolist(), np.flatnonzero(~modal).tolist()):
        if not places:
            continue
        chosen = [sets[i] for i in places]
        observed, through = _outputs(chosen, positions[places], velocities[places])
        form = _Form(
            drive=drives[places],
            observed=observed,
            through=through,
            coordinates=np.concatenate([positions[places], velocities[places]], axis=1),
            lever=np.array([p.radial_lever for p in chosen]),
            interval=interval,
        )
        if modal[places[0]]:
            groups.append((places, _modal(poles[places], vectors[places], inverses[places], form)))
        else:
            groups.append((places, _dense(systems[places], form)))
    return groups


@dataclass(frozen=True)
class _Form:
    """What the modal and the dense form are both made of, per set: B (6, 5), C (4, 6), D (4, 5), x to (q, q') (6, 6)."""

    drive: Array
    observed: Array
    through: Array
    coordinates: Array
    lever: Array
    interval: float


def _well_conditioned(vectors: NDArray[Any]) -> tuple[NDArray[np.bool_], NDArray[Any]]:
    """Which sets of eigenvectors can be inverted safely, and their inverses (of the identity for the others)."""
    good = np.ones(len(vectors), dtype=bool)
    try:
        inverses = np.linalg.inv(vectors)
    except np.linalg.LinAlgError:
        good = np.linalg.cond(vectors) < LARGEST_CONDITION
        inverses = np.linalg.inv(np.where(good[:, None, None], vectors, np.eye(6)))
    size = np.sqrt(np.sum(np.abs(vectors) ** 2, axis=(1, 2)) * np.sum(np.abs(inverses) ** 2, axis=(1, 2)))
    return good & (size < LARGEST_CONDITION), inverses


def _modal(poles: NDArray[Any], vectors: NDArray[Any], inverse: NDArray[Any], form: _Form) -> Propagator:
    """The diagonal form; poles of the lower half plane are dropped and their partners counted twice."""
    sets = len(poles)
    rank = np.argsort(np.where(np.imag(poles) >= 0.0, np.abs(poles), np.inf), axis=1)
    kept = int(np.max(np.sum(np.imag(poles) >= 0.0, axis=1)))
    rank = rank[:, :kept]
    row = np.arange(sets)[:, None]
    modes = -(-kept // QUAD) * QUAD
    poles = poles[row, rank].astype(np.complex128)
    weight = np.where(np.imag(poles) > 0.0, 2.0, np.where(np.imag(poles) == 0.0, 1.0, 0.0))
    inverse = inverse[row, rank] * (weight > 0.0)[:, :, None]
    weighted = np.swapaxes(np.swapaxes(vectors, 1, 2)[row, rank] * weight[:, :, None], 1, 2)
    z = poles * form.interval
    whole = np.expm1(z) / poles
    late = (whole - form.interval) / z
    drive = inverse @ form.drive
    lead, start = late[..., None] * drive, (whole - late)[..., None] * drive
    decay = np.exp(z)
    output = form.observed @ weighted
    return Propagator(
        dense=False,
        decay=_parts(decay, modes, 1),
        transition=np.zeros((sets, 6, 6)),
        gain=_parts(decay[..., None] * lead + start, modes, 1),
        start=_parts(start, modes, 1),
        lead=_parts(lead, modes, 1),
        output=_parts(output, modes, 2),
        through=form.through + np.real(output @ lead),
        encode=(inverse @ np.linalg.inv(form.coordinates)).astype(np.complex128),
        decode=(form.coordinates @ weighted).astype(np.complex128),
        lever=form.lever,
    )


def _dense(systems: Array, form: _Form) -> Propagator:
    """The same with the matrix exponential of the augmented system (Van Loan), six real "modes" padded to eight."""
    import scipy

    sets, n, inputs = form.drive.shape
    augmented = np.zeros((sets, n + 2 * inputs, n + 2 * inputs))
    augmented[:, :n, :n], augmented[:, :n, n : n + inputs] = systems * form.interval, form.drive * form.interval
    augmented[:, n : n + inputs, n + inputs :] = np.eye(inputs)
    exponential = scipy.linalg.expm(augmented)
    transition, whole = exponential[:, :n, :n], exponential[:, :n, n : n + inputs]
    lead = exponential[:, :n, n + inputs :]
    start = whole - lead
    return Propagator(
        dense=True,
        decay=np.zeros((sets, 2, 8)),
        transition=np.ascontiguousarray(transition),
        gain=_parts(transition @ lead + start, 8, 1),
        start=_parts(start, 8, 1),
        lead=_parts(lead, 8, 1),
        output=_parts(form.observed, 8, 2),
        through=form.through + form.observed @ lead,
        encode=np.linalg.inv(form.coordinates).astype(np.complex128),
        decode=form.coordinates.astype(np.complex128),
        lever=form.lever,
    )


def _outputs(sets: Sequence[DynamicParameters], position: Array, velocity: Array) -> tuple[Array, Array]:
    """C (S, 4, 6) and D (S, 4, 5) of the outputs named in `OUTPUTS`."""
    observed, through = np.empty((len(sets), len(OUTPUTS), 6)), np.zeros((len(sets), len(OUTPUTS), len(INPUTS)))
    for k, p in enumerate(sets):
        q, v, radius = position[k], velocity[k], p.neutral_radius
        observed[k, 0], observed[k, 1] = q[2] / radius, v[2] / radius
        observed[k, 2] = (p.cup_stiffness * (q[1] - q[2]) + p.structural_damping * (v[1] - v[2])) / radius
        observed[k, 3] = -p.bearing_stiffness * q[0] - p.bearing_damping * v[0]
        through[k, 3, 0] = p.bearing_stiffness * p.radial_lever
        through[k, 3, 1] = p.bearing_damping * p.radial_lever
    return observed, through


def _parts(values: NDArray[Any], modes: int, axis: int) -> Array:
    """Real and imaginary parts along a new axis before `axis` (1 or 2), which is padded with zeros to `modes`."""
    parts = np.zeros((*values.shape[:axis], 2, modes, *values.shape[axis + 1 :]))
    used = values.shape[axis]
    if axis == 1:
        parts[:, 0, :used], parts[:, 1, :used] = np.real(values), np.imag(values)
    else:
        parts[:, :, 0, :used], parts[:, :, 1, :used] = np.real(values), np.imag(values)
    return parts
