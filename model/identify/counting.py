"""What counting does to a kinematic error: aliases of the output lattice, slipped counts, and a
slope that must not be there.

The output encoder gives a whole number of counts per input revolution (18 000 lines x 4 / 120 =
600), so its quantisation is locked to the input angle at orders j 600. Sampled at M samples per
input revolution it appears at |j 600 - k M|. A slipped count is a step in the residual; a ratio
that is not the gear's, or counts that are lost all the time, are a slope.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from model.errors import IdentificationError
from model.identify.angle_regression import AngleFit, Sums, solve_angle
from model.units import ARCSEC, REVOLUTION

GROSS_SLOPE = 1e-4
"""A slope times N above this (130 arcsec per output revolution) is not a property of any gear."""
WHOLE_TURN = 0.98
"""Output revolutions from which output orders and slope can be told apart."""
STEP_SIGNIFICANCE = 6.0
MAXIMUM_STEPS = 6


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

    def sentence(self) -> str:
        """The finding in words."""
        turns = f"input revolutions {self.angle_low / REVOLUTION:.2f} and {self.angle_high / REVOLUTION:.2f}"
        text = f"A step of {self.size / ARCSEC:.3g} arcsec lies between {turns}"
        if math.isfinite(self.output_counts):
            text += f": {self.output_counts:+.2f} output counts"
        if math.isfinite(self.input_counts):
            text += f" or {self.input_counts:+.1f} input counts"
        return text + ". A count slipped there; the step has been taken out before the fit."


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
    aliases = []
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
    worst = aliases[0] if aliases else None
    if worst is None or worst.harmonic > 12:
        return None
    return (
        f"Sampling at {samples_per_revolution:.1f} samples per input revolution folds harmonic "
        f"{worst.harmonic} of the output "
        f"counts onto order {worst.order:.2f} (up to {worst.amplitude / ARCSEC:.2g} arcsec): choose a speed that is "
        "incommensurate with the sampling rate."
    )


def _noise_per_sample(sums: Sums, scores: np.ndarray) -> float:
    """Effective noise of one sample from block to block, robust against the steps that are sought [value squared]."""
    counts = np.maximum(sums.normal[:, 0, 0], 1.0)
    scaled = np.diff(scores[:, 0] / counts) * np.sqrt(0.5 * np.minimum(counts[1:], counts[:-1]))
    return float(max((1.4826 * np.median(np.abs(scaled))) ** 2, np.finfo(float).tiny))


def _step_columns(sums: Sums, at: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """X'h (p, k) and h'h (k, k) of unit steps that begin with the given blocks."""
    column = np.cumsum(sums.normal[::-1, 0, :], axis=0)[::-1]
    counts = np.cumsum(sums.normal[::-1, 0, 0])[::-1]
    gram = np.array([[counts[max(i, j)] for j in at] for i in at])
    return column[at].T, gram


def _scan(sums: Sums, fit: AngleFit, taken: list[int]) -> tuple[int, float]:
    """The block boundary at which one step explains most of the residual, and its significance in standard errors."""
    column = np.cumsum(sums.normal[::-1, 0, :], axis=0)[::-1][1:]
    counts = np.cumsum(sums.normal[::-1, 0, 0])[::-1][1:]
    suffix = np.cumsum(fit.scores[::-1, 0])[::-1][1:]
    information = counts - np.einsum("bi,ij,bj->b", column, fit.inverse, column)
    usable = information > np.maximum(1e-4 * counts, 0.5 * np.median(sums.normal[:, 0, 0]))
    for b in taken:
        usable[max(b - 3, 0) : b + 2] = False
    if not usable.any():
        return -1, 0.0
    score = np.where(usable, np.abs(suffix) / np.sqrt(np.where(usable, information, 1.0)), 0.0)
    best = int(np.argmax(score))
    return best + 1, float(score[best]) / math.sqrt(_noise_per_sample(sums, fit.scores))


def find_slips(
    sums: Sums, fit: AngleFit, *, output_quantum: float = math.nan, input_quantum: float = math.nan
) -> tuple[tuple[Slip, ...], Sums]:
    """Steps in the residual, and the sums with the steps taken out (whole output counts where a quantum says so).

    One by one: the boundary of blocks at which a step explains most; the two blocks beside it are
    dropped (the step lies somewhere in them), all sizes are estimated together with the parameters
    of the fit, taken out, and the search goes on.
    """
    taken: list[int] = []
    cleaned, now = sums, fit
    slips: tuple[Slip, ...] = ()
    refused: list[int] = []
    while len(refused) < MAXIMUM_STEPS and len(fit.scores) - 2 * len(taken) >= 8:
        at, score = _scan(cleaned, now, refused)
        if at < 0 or score < STEP_SIGNIFICANCE:
            break
        refused.append(at)
        if not _is_local(now, at):
            continue
        taken = sorted([*taken, at])
        remaining = _without_blocks(sums, taken)
        sizes, errors = _step_sizes(remaining, fit, taken, _noise_per_sample(cleaned, now.scores))
        slips = tuple(
            _slip(sums, b, float(size), float(error), output_quantum, input_quantum)
            for b, size, error in zip(taken, sizes, errors, strict=True)
        )
        cleaned = remaining
        for b, slip in zip(taken, slips, strict=True):
            cleaned = _shifted(cleaned, b, slip.size)
        now, _ = solve_angle(cleaned)
    return slips, cleaned


def _is_local(fit: AngleFit, block: int) -> bool:
    """Whether the residual really jumps there: three blocks before against three after, beyond a
    drift and the noise.
    """
    residual, full = (
        fit.block_residual,
        fit.block_count > 0.5 * np.median(fit.block_count[fit.block_count > 0]),
    )
    before = residual[max(block - 4, 0) : block - 1][full[max(block - 4, 0) : block - 1]]
    after = residual[block + 1 : block + 4][full[block + 1 : block + 4]]
    if len(before) < 2 or len(after) < 2:
        return False
    jump = abs(float(after.mean() - before.mean()))
    drift = max(abs(float(before[-1] - before[0])), abs(float(after[-1] - after[0])))
    steps = np.diff(residual[full])
    noise = 1.4826 * float(np.median(np.abs(steps - np.median(steps))))
    return jump > 4.0 * drift and jump > 5.0 * noise / math.sqrt(3.0)


def _slip(
    sums: Sums, block: int, size: float, error: float, output_quantum: float, input_quantum: float
) -> Slip:
    counts = size / output_quantum
    whole = round(counts) if math.isfinite(counts) else 0
    if whole and abs(counts - whole) < 0.25:
        size = whole * output_quantum
    edges = [sums.first_angle + sums.direction * (block + k) * sums.length for k in (-1, 1)]
    return Slip(
        min(edges), max(edges), size, error, counts, -size * sums.basis.ratio / input_quantum
    )


def _without_blocks(sums: Sums, boundaries: list[int]) -> Sums:
    """Drop the two blocks beside each boundary: the step lies somewhere in them."""
    normal, right, square = sums.normal.copy(), sums.right.copy(), sums.square.copy()
    lost_square = 0.0
    for b in boundaries:
        for k in (b - 1, b):
            if len(normal) - len(boundaries) * 2 >= 4:
                lost_square += float(square[k])
                normal[k], right[k], square[k] = 0.0, 0.0, 0.0
    weight = float(normal[:, 0, 0].sum())
    share = weight / max(sums.count, 1)
    within = max(sums.sum_square - sums.between_square, 0.0) * share
    between = sums.between_square - lost_square
    return replace(
        sums,
        normal=normal,
        right=right,
        square=square,
        count=round(weight),
        between_square=between,
        sum_square=between + within,
    )


def _step_sizes(
    sums: Sums, fit: AngleFit, boundaries: list[int], noise: float
) -> tuple[np.ndarray, np.ndarray]:
    used = fit.used
    cross, gram = _step_columns(sums, boundaries)
    total = sums.normal.sum(axis=0)[np.ix_(used, used)]
    scale = np.sqrt(np.diag(total))
    inverse = np.linalg.pinv(total / np.outer(scale, scale), hermitian=True) / np.outer(
        scale, scale
    )
    right = np.array([sums.right[b:, 0].sum() for b in boundaries])
    information = gram - cross[used].T @ inverse @ cross[used]
    sizes = np.linalg.solve(
        information, right - cross[used].T @ inverse @ sums.right.sum(axis=0)[used]
    )
    return sizes, np.sqrt(noise * np.diag(np.linalg.inv(information)))


def _shifted(sums: Sums, block: int, size: float) -> Sums:
    """The sums with `size` subtracted from every value from `block` on; the bins lose their common share."""
    right, square = sums.right.copy(), sums.square.copy()
    counts = sums.normal[block:, 0, 0]
    change = -2.0 * size * right[block:, 0] + size**2 * counts
    right[block:] -= size * sums.normal[block:, 0, :]
    square[block:] += change
    share = counts.sum() / max(sums.normal[:, 0, 0].sum(), 1.0)
    return replace(
        sums,
        right=right,
        square=square,
        sum_square=sums.sum_square + float(change.sum()),
        between_square=sums.between_square + float(change.sum()),
        bin_value=sums.bin_value - size * share * sums.bin_basis[:, 0],
    )


def ratio_from_slope(ratio: float, slope: float) -> float:
    """The ratio that the two encoders show: 1/(1/N + slope)."""
    seen = 1.0 / ratio + slope
    return math.inf if seen == 0.0 else 1.0 / seen


def refuse_wrong_ratio(ratio: float, slope: float, output_revolutions: float) -> None:
    """Raise when the slope says that ratio, sign or lines are wrong: no kinematic error can be taken from such data.

    Below one output revolution the gear's own output orders look like a slope, so ten times as much is allowed.
    """
    limit = GROSS_SLOPE if output_revolutions >= WHOLE_TURN else 10.0 * GROSS_SLOPE
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
    parts = []
    if math.isfinite(output_quantum):
        parts.append(f"{closure / output_quantum:.2f} output counts per output revolution")
    if math.isfinite(input_quantum):
        parts.append(f"{-closure / input_quantum:.2f} input counts per input revolution")
    counts = f", which is {' or '.join(parts)}" if parts else ""
    return (
        f"{text}{counts}: counts are lost, or a coupling slips, or the part drifts. Do not "
        "use the transmission accuracy."
    )
