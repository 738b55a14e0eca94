"""What counting does to a kinematic error: aliases of the output lattice, slipped counts, and a
slope that must not be there.

The output encoder gives a whole number of counts per input revolution (18 000 lines x 4 / 120 =
600), so its quantisation is locked to the input angle at orders j 600. Sampled at M samples per
input revolution it appears at |j 600 - k M|. A slipped count is a step in the residual; a ratio
that is not the gear's, or counts that are lost all the time, are a slope.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from model.errors import IdentificationError
from model.identify.angle_fit import WHOLE_TURN, AngleFit, solve_angle
from model.identify.angle_regression import Basis, Cells
from model.identify.checks import Array
from model.units import ARCSEC, REVOLUTION

_GROSS_SLOPE = 1e-4
"""A slope times N above this (130 arcsec per output revolution) is not a property of any gear."""
_STEP_SIGNIFICANCE = 6.0
_MAXIMUM_STEPS = 6
APART = 8
"""Input revolutions that two steps lie apart; nearer ones could cancel."""
_WHOLE_COUNT = 0.25
"""How far from a whole number of counts a step may be, beside what its own noise explains."""
_HARMONICS = 40
"""Harmonics of the saw-tooth of a counter that are looked at."""
_LEAST_WIDTH = 0.4
"""Orders, or sidebands, over which a line that nothing modulates is spread: one."""
WANDERS = 4.0
_CURVE_ORDERS = 16
"""Output orders beside which a step must stand: a smooth curve over the output turn has no more."""


@dataclass(frozen=True)
class Alias:
    """Where harmonic `harmonic` of the counting lattice appears: order per input revolution, amplitude bound [rad]."""

    harmonic: int
    order: float
    amplitude: float


@dataclass(frozen=True)
class Slip:
    """A step in the residual: between two input angles [rad], its size [rad], as output and as input counts."""

    angle_low: float
    angle_high: float
    size: float
    standard_error: float
    output_counts: float
    input_counts: float
    is_whole: bool = True

    def sentence(self) -> str:
        """The finding in words."""
        turns = f"input revolutions {self.angle_low / REVOLUTION:.2f} and {self.angle_high / REVOLUTION:.2f}"
        text = f"A step of {self.size / ARCSEC:.3g} arcsec lies between {turns}"
        if math.isfinite(self.output_counts):
            text += f": {self.output_counts:+.2f} output counts"
        if math.isfinite(self.input_counts):
            text += f" or {self.input_counts:+.1f} input counts"
        return (
            text + ". A count slipped there; the step has been taken out before the fit, and these "
            "revolutions are left out of it."
        )


def lattice_aliases(
    samples_per_revolution: float,
    counts_per_revolution: float,
    quantum: float,
    highest_order: float,
    *,
    harmonics: int = 40,
) -> tuple[Alias, ...]:
    """Harmonics of the counting lattice that sampling folds onto the orders of a fit, strongest first.

    samples and counts per input revolution; quantum of the output count [rad]. The saw-tooth of a
    quantiser has harmonics of amplitude quantum/(pi j); a bound, because a kinematic error larger
    than the quantum spreads them.
    """
    aliases: list[Alias] = []
    for j in range(1, harmonics + 1):
        line = j * counts_per_revolution
        folds = round(line / samples_per_revolution)
        if folds == 0:
            continue
        order = abs(line - folds * samples_per_revolution)
        if order <= highest_order + 0.5:
            aliases.append(Alias(j, order, quantum / (math.pi * j)))
    return tuple(sorted(aliases, key=lambda a: -a.amplitude))


def alias_warning(aliases: tuple[Alias, ...], samples_per_revolution: float) -> str | None:
    """A sentence when the sampling sits near the counting lattice, with the speed remedy."""
    if not aliases or aliases[0].harmonic > 12:
        return None
    worst = aliases[0]
    return (
        f"Sampling at {samples_per_revolution:.1f} samples per input revolution folds harmonic "
        f"{worst.harmonic} of the output "
        f"counts onto order {worst.order:.2f} (up to {worst.amplitude / ARCSEC:.2g} arcsec): choose a speed that is "
        "incommensurate with the sampling rate."
    )


@dataclass(frozen=True)
class LockedRounding:
    """Rounding of the output's counts that sampling folds onto orders of the input: its power there.

    Harmonic j of the saw-tooth has the power (quantum/(pi j))^2/2. Its phase follows the output
    angle: over the input it is a wave of order j L, L counts per input revolution, whose frequency
    the kinematic error modulates. Sampled at M samples per revolution it lies about j L - i M, and
    spreads as the slope of the error does (a slow, wide frequency modulation: its spectrum has the
    shape of the distribution of its frequency). Only where it falls on whole orders and their
    sidebands does no line beside an order show it.
    """

    ratio: float
    order: Array
    side: Array
    power: Array
    width: Array
    side_width: Array

    @classmethod
    def of(cls, fit: AngleFit, samples_per_revolution: float, quantum: float) -> LockedRounding:
        """By the orders of a fit; `quantum` of the output's count [rad]."""
        ratio = fit.basis.ratio
        j = np.arange(1, _HARMONICS + 1, dtype=np.float64)
        line = j * REVOLUTION / quantum / ratio
        folded = line - samples_per_revolution * np.rint(line / samples_per_revolution)
        n, m = fit.basis.decomposed()
        size = np.hypot(fit.values[2::2], fit.values[3::2])
        index = REVOLUTION * j / quantum
        slope, side = (
            math.sqrt(0.5 * float(np.sum((k * size) ** 2))) for k in (np.maximum(n, 0), m)
        )
        order = np.rint(folded)
        return cls(
            ratio=ratio,
            order=order,
            side=(folded - order) * ratio,
            power=0.5 * (quantum / (math.pi * j)) ** 2,
            width=np.maximum(index * slope, _LEAST_WIDTH),
            side_width=np.maximum(index * side, _LEAST_WIDTH),
        )

    def variance(self, orders: Array) -> Array:
        """Of a cosine or sine at each order, by rounding alone [rad2], (orders,)."""
        whole = np.rint(orders)[:, None]
        part = (np.asarray(orders)[:, None] - whole) * self.ratio
        total = np.zeros(len(whole))
        for sign in (1.0, -1.0):
            near = _bell(whole - sign * self.order, self.width)
            beside = _bell(part - sign * self.side, self.side_width)
            total += (self.power * near * beside).sum(axis=1)
        return total

    def wander(self) -> float:
        """How far rounding alone moves the mean of an input revolution over the output turn, r.m.s. [rad]."""
        slow = np.arange(0.0, _CURVE_ORDERS + 1.0) / self.ratio
        return math.sqrt(float(self.variance(slow).sum()))


def _bell(distance: Array, width: Array) -> Array:
    density: Array = np.exp(-0.5 * (distance / width) ** 2) / (math.sqrt(2.0 * math.pi) * width)
    return density


def _noise_per_sample(fit: AngleFit) -> float:
    """Effective noise of one sample from turn to turn, robust against the steps that are sought [value squared].

    The larger one of what the residual changes from one revolution to the next, and of what it is:
    rounding that is locked to the input wanders slowly.
    """
    counts = np.maximum(fit.row_count, 1.0)
    changes = np.diff(fit.row_residual) * np.sqrt(0.5 * np.minimum(counts[1:], counts[:-1]))
    levels = fit.row_residual * np.sqrt(counts)
    sizes = (1.4826 * float(np.median(np.abs(scaled))) for scaled in (changes, levels))
    return max(max(sizes) ** 2, float(np.finfo(float).tiny))


def _suffix_sums(values: Array) -> Array:
    """Sums from each row on, along the last axis."""
    total: Array = np.cumsum(values[..., ::-1], axis=-1)[..., ::-1]
    return total


@dataclass(frozen=True)
class _Steps:
    """Unit steps that begin with each row: X'h (p, rows) over the used columns, and h'h (rows,)."""

    column: Array
    count: Array

    @classmethod
    def of(cls, fit: AngleFit) -> _Steps:
        rows = fit.cells.regressors.row_sums(fit.basis, fit.used[2::2])
        return cls(_suffix_sums(rows), _suffix_sums(fit.row_count))

    def information(self, fit: AngleFit, at: list[int]) -> Array:
        """Information (k, k) about the sizes of steps at these rows that the orders leave."""
        part = np.ix_(fit.used, fit.used)
        cross = self.column[:, at]
        gram = self.count[np.maximum.outer(at, at)]
        left: Array = gram - cross.T @ fit.inverse[part] @ cross
        return left


def _scan(fit: AngleFit, steps: _Steps, refused: list[int]) -> tuple[int, float]:
    """The row at which one step explains most of the residual, and its significance in standard errors."""
    part = np.ix_(fit.used, fit.used)
    column, counts = steps.column[:, 1:], steps.count[1:]
    suffix = _suffix_sums(fit.row_residual * fit.row_count)[1:]
    information = counts - np.einsum("ib,ij,jb->b", column, fit.inverse[part], column)
    usable = information > np.maximum(1e-4 * counts, 0.5 * np.median(fit.row_count))
    for b in refused:
        usable[max(b - APART, 0) : b + APART] = False
    if not usable.any():
        return -1, 0.0
    score = np.where(usable, np.abs(suffix) / np.sqrt(np.where(usable, information, 1.0)), 0.0)
    best = int(np.argmax(score))
    return best + 1, float(score[best]) / math.sqrt(_noise_per_sample(fit))


def find_slips(
    fit: AngleFit,
    *,
    output_quantum: float = math.nan,
    input_quantum: float = math.nan,
    wander: float = 0.0,
) -> tuple[tuple[Slip, ...], Cells]:
    """Steps of whole counts that every later revolution keeps, and the cells with the steps taken out.

    One by one: the revolution at which a step explains most; the two revolutions beside it are left
    out (the step lies somewhere in them), all sizes are estimated together with the parameters of
    the fit, taken out, and the search goes on. A step is a slip only where it stands out beside a
    smooth curve over the output turn and `WANDERS` times what rounding alone moves the residual
    there (`wander` [rad]), and is a whole number of counts.
    """
    taken: list[int] = []
    cleaned, now = fit.cells, fit
    slips: tuple[Slip, ...] = ()
    refused: list[int] = []
    curve = _basis_of_curve(fit.basis)
    steps = _Steps.of(fit)
    while len(refused) < _MAXIMUM_STEPS and fit.cells.rows - 2 * len(taken) >= 8:
        at, score = _scan(now, steps, refused)
        if at < 0 or score < _STEP_SIGNIFICANCE:
            break
        refused.append(at)
        trial = sorted([*taken, at])
        without = fit.cells.without_rows([k for b in trial for k in (b - 1, b)])
        found = _sizes(without, curve, trial, _noise_per_sample(now), output_quantum, input_quantum)
        if not all(slip.is_whole and abs(slip.size) > WANDERS * wander for slip in found):
            continue
        taken, slips, cleaned = trial, found, without
        for b, slip in zip(trial, found, strict=True):
            cleaned = cleaned.shifted(b, slip.size)
        now, _ = solve_angle(cleaned, fit.basis)
        steps = _Steps.of(now)
    return slips, cleaned


def _basis_of_curve(basis: Basis) -> Basis:
    """The basis with all the output orders that a smooth curve over the output turn may have."""
    highest = min(_CURVE_ORDERS, math.ceil(basis.ratio / 4.0) - 1)
    return basis.united(Basis(basis.ratio, tuple(k / basis.ratio for k in range(1, highest + 1))))


def _sizes(
    cells: Cells,
    basis: Basis,
    rows: list[int],
    noise: float,
    output_quantum: float,
    input_quantum: float,
) -> tuple[Slip, ...]:
    """The steps that begin with these rows, all sizes estimated together with a smooth curve."""
    fit, _ = solve_angle(cells, basis)
    information = _Steps.of(fit).information(fit, rows) + np.eye(len(rows))
    suffix = _suffix_sums(fit.row_residual * fit.row_count)[rows]
    sizes = np.linalg.solve(information, suffix)
    spread = np.diag(np.linalg.inv(information))
    # Steps that the curve takes up leave no information: whatever size they get, it is worth nothing.
    errors = np.sqrt(noise * np.where(spread > 0.0, spread, math.inf))
    return tuple(
        _slip(cells, b, float(size), float(error), output_quantum, input_quantum)
        for b, size, error in zip(rows, sizes, errors, strict=True)
    )


def _slip(
    cells: Cells, row: int, size: float, error: float, output_quantum: float, input_quantum: float
) -> Slip:
    counts = size / output_quantum
    whole = round(counts) if math.isfinite(counts) else 0
    of_output = bool(whole) and abs(counts - whole) < _WHOLE_COUNT
    if of_output:
        size = whole * output_quantum
    of_input = -size * cells.ratio / input_quantum
    scatter = error * cells.ratio / input_quantum
    of_input_too = abs(of_input) > 1.0 - _WHOLE_COUNT and (
        abs(of_input - round(of_input)) < _WHOLE_COUNT + 2.0 * scatter
    )
    counted = of_output or of_input_too or not math.isfinite(of_input)
    is_whole = abs(size) > _STEP_SIGNIFICANCE * error and counted
    edges = [cells.first_angle + cells.direction * (row + k) * REVOLUTION for k in (-1, 1)]
    return Slip(min(edges), max(edges), size, error, counts, of_input, is_whole=is_whole)


def ratio_from_slope(ratio: float, slope: float) -> float:
    """The ratio that the two encoders show: 1/(1/N + slope)."""
    seen = 1.0 / ratio + slope
    return math.inf if seen == 0.0 else 1.0 / seen


def refuse_wrong_ratio(ratio: float, slope: float, output_revolutions: float) -> None:
    """Raise when the slope says that ratio, sign or lines are wrong: no kinematic error can be taken from such data.

    Below one output revolution the gear's own output orders look like a slope, so ten times as much is allowed.
    """
    limit = _GROSS_SLOPE if output_revolutions >= WHOLE_TURN else 10.0 * _GROSS_SLOPE
    if abs(slope) * ratio <= limit:
        return
    seen = ratio_from_slope(ratio, slope)
    if abs(seen + ratio) < 0.02 * ratio:
        remedy = (
            "The sign of the output angle is reversed: it counts positive opposite to the "
            "input when the circular spline "
            "is fixed."
        )
    elif abs(abs(seen) - ratio) < 1.5:
        remedy = f"The nearest whole ratio is {round(seen)}: check which spline is fixed and the gear's ratio."
    else:
        remedy = (
            f"That is {seen / ratio:.4g} times the stated ratio: check lines and "
            "multiplication of both encoders, and the "
            "gear's ratio."
        )
    raise IdentificationError(
        "the encoders show another ratio than the one stated (slope of the kinematic error)",
        where="ratio",
        value=f"stated {ratio:g}, seen {seen:.6g}",
        limit=f"slope times ratio within ±{limit:g}",
        remedy=remedy,
    )


def slope_sentence(
    ratio: float, closure: float, output_quantum: float, input_quantum: float
) -> str:
    """What a significant slope means, in counts; `closure` is the error left after one output revolution [rad]."""
    text = (
        f"The kinematic error does not close: {closure / ARCSEC:.3g} arcsec per output revolution (ratio seen "
        f"{ratio_from_slope(ratio, closure / (REVOLUTION * ratio)):.7g} instead of {ratio:g})"
    )
    parts: list[str] = []
    if math.isfinite(output_quantum):
        parts.append(f"{closure / output_quantum:.2f} output counts per output revolution")
    if math.isfinite(input_quantum):
        parts.append(f"{-closure / input_quantum:.2f} input counts per input revolution")
    counts = f", which is {' or '.join(parts)}" if parts else ""
    return (
        f"{text}{counts}: counts are lost, or a coupling slips, or the part drifts. Do not "
        "use the transmission accuracy."
    )
