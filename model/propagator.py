"""Exact propagation of equation 2 over one sample interval, as numbers for the compiled loops.

x' = A x + B u is integrated exactly for inputs that between samples follow

    psi, the ideal output angle    the cubic through its values and its rates at both samples
    friction and load torque       a straight line (first-order hold), with a step at a sample where the motion turns

so that, with u- and u+ before and after a step at a sample and moments I_p of the interval h,

    x[k+1] = exp(A h) x[k] + B0 u[k]+ + B1 u[k+1]- ,     I_p = integral over t of exp(A (h - t)) (t/h)^p B

    straight line   B0 = I_0 - I_1 ,  B1 = I_1
    cubic           B0, B1 = the Hermite polynomials and their derivatives with (t/h)^p replaced by I_p

The loops carry zeta = x - B1 u-, which needs the inputs of one sample only:

    zeta[k+1] = exp(A h) zeta[k] + (exp(A h) B1 + B0) u[k]- + B0 (u[k]+ - u[k]-) ,   y[k] = C zeta[k] + (C B1 + D) u[k]-

In modal coordinates exp(A h) is diagonal: a complex pair is one mode of double weight, a real pole
one of single weight. Where the eigenvectors are nearly dependent (critical damping) the full matrix
exponential is used instead.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.arrays import ComplexArray, FloatArray
from model.linear import INPUTS, DynamicParameters, ParameterTable, energy_forms

LARGEST_CONDITION = 1e5
"""Condition number of the eigenvectors (in the energy norm) above which the dense exponential is used."""

OUTPUTS = ("output_angle", "output_speed", "torsion_torque", "bearing_force")
"""Rows of `Propagator.output`: theta_o [rad], theta_o' [rad/s], cup torque [N m], F_b [N]."""

_QUAD = 4
"""Modes are padded to a multiple of this, because the compiled loop advances four side by side."""


@dataclass(frozen=True, kw_only=True)
class Propagator:
    """Parameter sets (first axis, S) over one interval: arrays with real and imaginary parts apart, m modes.

    `decay` (S, 2, m) of exp(lambda h), or `transition` (S, 6, 6) where `dense`; `gain` (S, 2, m,
    5), `start` = B0 and `lead` = B1 of the same shape; `output` (S, 4, 2, m), `through` (S, 4, 5);
    `encode` (S, .., 6) complex makes modes of q, q' and `decode` (S, 6, ..) takes them back (real
    part); `lever` (S,) is r_g/tan(alpha_t).
    """

    dense: bool
    decay: FloatArray
    transition: FloatArray
    gain: FloatArray
    start: FloatArray
    lead: FloatArray
    output: FloatArray
    through: FloatArray
    encode: ComplexArray
    decode: ComplexArray
    lever: FloatArray

    def carried(self, coordinates: FloatArray, inputs: FloatArray) -> FloatArray:
        """zeta (S, 2, m) that the loops carry, from q and q' (S, 6) and the inputs u- (5,) at the same sample."""
        modes = (self.encode @ coordinates[..., None])[..., 0]
        return _parts(modes, self.decay.shape[2], 1) - self.lead @ inputs

    def coordinates(self, carried: FloatArray, inputs: FloatArray) -> FloatArray:
        """q and q' (S, 6) from the carried zeta (S, 2, m) and the inputs u- (5,) at the same sample."""
        modes = (carried + self.lead @ inputs)[:, :, : self.decode.shape[2]]
        return np.real((self.decode @ (modes[:, 0] + 1j * modes[:, 1])[..., None])[..., 0])

    def kick(self, static_force: float, static_torque: float) -> FloatArray:
        """What a unit step of the sign of motion adds to zeta (S, 2, m), with F_fm and M_0 at zero speed."""
        return static_force * self.start[..., 2] + static_torque * self.start[..., 3]


def propagators(
    sets: Sequence[DynamicParameters], interval: float
) -> list[tuple[list[int], Propagator]]:
    """The exact propagation of parameter sets over `interval` [s]: groups of places in `sets` with their arrays.

    Sets whose eigenvectors are well conditioned form one modal group, the others one dense group. A single set is
    remembered, because a run is simulated segment by segment with the same gear.
    """
    return _remembered(sets[0], interval) if len(sets) == 1 else _groups(sets, interval)


@functools.lru_cache(maxsize=32)
def _remembered(p: DynamicParameters, interval: float) -> list[tuple[list[int], Propagator]]:
    """The arrays of one set; nobody writes to them."""
    return _groups([p], interval)


def _groups(
    sets: Sequence[DynamicParameters], interval: float
) -> list[tuple[list[int], Propagator]]:
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
    """What the modal and the dense form are both made of, per set: B (6, 5), C (4, 6), D (4, 5), x
    to (q, q') (6, 6).
    """

    drive: FloatArray
    observed: FloatArray
    through: FloatArray
    coordinates: FloatArray
    lever: FloatArray
    interval: float


def _well_conditioned(vectors: NDArray[Any]) -> tuple[NDArray[np.bool_], NDArray[Any]]:
    """Which sets of eigenvectors can be inverted safely, and their inverses (of the identity for the others)."""
    good = np.ones(len(vectors), dtype=bool)
    try:
        inverses = np.linalg.inv(vectors)
    except np.linalg.LinAlgError:
        good = np.linalg.cond(vectors) < LARGEST_CONDITION
        inverses = np.linalg.inv(np.where(good[:, None, None], vectors, np.eye(6)))
    size = np.sqrt(
        np.sum(np.abs(vectors) ** 2, axis=(1, 2)) * np.sum(np.abs(inverses) ** 2, axis=(1, 2))
    )
    return good & (size < LARGEST_CONDITION), inverses


def _modal(
    poles: NDArray[Any], vectors: NDArray[Any], inverse: NDArray[Any], form: _Form
) -> Propagator:
    """The diagonal form; poles of the lower half plane are dropped and their partners counted twice."""
    sets = len(poles)
    rank = np.argsort(np.where(np.imag(poles) >= 0.0, np.abs(poles), np.inf), axis=1)
    upper = int(np.max(np.sum(np.imag(poles) >= 0.0, axis=1)))
    rank = rank[:, :upper]
    row = np.arange(sets)[:, None]
    modes = -(-upper // _QUAD) * _QUAD
    poles = poles[row, rank].astype(np.complex128)
    weight = np.where(np.imag(poles) > 0.0, 2.0, np.where(np.imag(poles) == 0.0, 1.0, 0.0))
    inverse = inverse[row, rank] * (weight > 0.0)[:, :, None]
    weighted = np.swapaxes(np.swapaxes(vectors, 1, 2)[row, rank] * weight[:, :, None], 1, 2)
    drive = inverse @ form.drive
    z = (poles * form.interval).astype(np.complex128)
    start, lead = _hold([m[..., None] * drive for m in _moments(z, form.interval)], form.interval)
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


def _dense(systems: FloatArray, form: _Form) -> Propagator:
    """The same with matrix exponentials, six real "modes" padded to eight.

    The moments are blocks of the exponential of a chain of integrators behind A h (Van Loan).
    """
    import scipy  # pyright: ignore[reportMissingTypeStubs]

    sets, n, _ = form.drive.shape
    chain = np.zeros((sets, 5 * n, 5 * n))
    chain[:, :n, :n] = systems * form.interval
    for link in range(4):
        chain[:, link * n : (link + 1) * n, (link + 1) * n : (link + 2) * n] = np.eye(n)
    blocks = scipy.linalg.expm(chain)[:, :n]
    transition = blocks[:, :, :n]
    factors = (form.interval * math.factorial(p) for p in range(4))
    moments = [
        f * blocks[:, :, (p + 1) * n : (p + 2) * n] @ form.drive for p, f in enumerate(factors)
    ]
    start, lead = _hold(moments, form.interval)
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


def _moments(z: ComplexArray, interval: float) -> list[ComplexArray]:
    """I_0 .. I_3 for a diagonal A with z = lambda h: upwards by parts, or by the series where that would cancel."""
    up = [interval * np.expm1(z) / z]
    for p in range(1, 4):
        up.append((p * up[-1] - interval) / z)
    small = np.abs(z) < 0.5
    if not small.any():
        return up
    tame = np.where(small, z, 0.0)
    series = np.zeros_like(z)
    for k in range(12, -1, -1):
        series = series * tame + 6.0 / math.factorial(k + 4)
    down = [interval * series]
    for p in (3, 2, 1):
        down.append((tame * down[-1] + interval) / p)
    return [np.where(small, low, high) for low, high in zip(reversed(down), up, strict=True)]


def _hold(moments: Sequence[NDArray[Any]], interval: float) -> tuple[NDArray[Any], NDArray[Any]]:
    """B0 and B1 (S, m, 5) from the moments I_0 .. I_3, each (S, m, 5), in the order of `model.linear.INPUTS`."""
    zero, one, two, three = moments
    start, lead = zero - one, one.copy()
    angle, rate = 0, 1
    rise = (
        3.0 * two[..., angle]
        - 2.0 * three[..., angle]
        + 6.0 * (one[..., rate] - two[..., rate]) / interval
    )
    lead[..., 0] = rise
    start[..., 0] = zero[..., angle] - rise
    start[..., 1] = interval * (one[..., angle] - 2.0 * two[..., angle] + three[..., angle])
    start[..., 1] += zero[..., rate] - 4.0 * one[..., rate] + 3.0 * two[..., rate]
    lead[..., 1] = (
        interval * (three[..., angle] - two[..., angle])
        + 3.0 * two[..., rate]
        - 2.0 * one[..., rate]
    )
    return start, lead


def _outputs(
    sets: Sequence[DynamicParameters], position: FloatArray, velocity: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """C (S, 4, 6) and D (S, 4, 5) of the outputs named in `OUTPUTS`."""
    table = ParameterTable.of(sets)
    radius = table["neutral_radius"][:, None]
    observed = np.empty((len(sets), len(OUTPUTS), 6))
    through = np.zeros((len(sets), len(OUTPUTS), len(INPUTS)))
    observed[:, 0], observed[:, 1] = position[:, 2] / radius, velocity[:, 2] / radius
    twist = table["cup_stiffness"][:, None] * (position[:, 1] - position[:, 2])
    twist += table["structural_damping"][:, None] * (velocity[:, 1] - velocity[:, 2])
    observed[:, 2] = twist / radius
    observed[:, 3] = -table["bearing_stiffness"][:, None] * position[:, 0]
    observed[:, 3] -= table["bearing_damping"][:, None] * velocity[:, 0]
    through[:, 3] = table.inputs()[:, 0]
    through[:, 3, 2:] = 0.0
    return observed, through


def _parts(values: NDArray[Any], modes: int, axis: int) -> FloatArray:
    """Real and imaginary parts along a new axis before `axis` (1 or 2), which is padded with zeros to `modes`."""
    parts = np.zeros((*values.shape[:axis], 2, modes, *values.shape[axis + 1 :]))
    used = values.shape[axis]
    if axis == 1:
        parts[:, 0, :used], parts[:, 1, :used] = np.real(values), np.imag(values)
    else:
        parts[:, :, 0, :used], parts[:, :, 1, :used] = np.real(values), np.imag(values)
    return parts
