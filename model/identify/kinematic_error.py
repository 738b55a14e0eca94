"""The kinematic error of a gear from a slow run: linear least squares, streamed (equations 15, 16 and 22).

    ke(theta_i) = theta_o - theta_i/N ,   y = a_0 + s theta_i + sum_v (a_v cos v theta_i + b_v sin v theta_i)

theta_o counts positive in the direction in which an ideal gear turns its output when theta_i grows;
positive = the output leads. One accumulator takes one direction; `fit_traverses` fits several in
one basis that follows their data; `model.identify.directions` puts two directions together.

Transmission accuracy is the peak-to-peak of the fitted curve over one output revolution, one
direction (catalogue definition), up to a stated order; raw peak-to-peak and the 360-degree closure
stand beside it. The slope s must be zero: a significant slope is reported as what it is (wrong
ratio, lost counts, slip), never as a parameter of the gear.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from model.angle_certificate import CREST
from model.arrays import quotient
from model.errors import IdentificationError
from model.identify import polar, torsion
from model.identify.angle_fit import WHOLE_TURN, AngleFit, solve_angle
from model.identify.angle_regression import AngleRegression, Basis, Cells, standard_basis
from model.identify.checks import Array, channels, positive
from model.identify.counting import (
    WANDERS,
    LockedRounding,
    Slip,
    alias_warning,
    find_slips,
    lattice_aliases,
    refuse_wrong_ratio,
    slope_sentence,
)
from model.identify.encoders import SLOWEST_SIDEBAND, Encoders
from model.identify.estimate import BudgetLine, Distribution, Estimate
from model.identify.order_estimate import OrderEstimate
from model.identify.order_search import followed, in_orders_of_all
from model.identify.transmission import (
    left_over,
    measured_curve,
    raised_by,
    repeatability,
    transmission_accuracy,
)
from model.kinematic_error import normalised_mse
from model.units import ARCSEC, REVOLUTION

HIGHEST_ORDER = 12
"""Input orders that are fitted unless somebody says otherwise."""
CHUNK = 32768
"""Samples that are taken at a time: their values stay in the processor's cache."""
_EXPECTED_ORDER = 6
"""Highest input order that a gear is expected to have."""
_SLOPE_SIGNIFICANCE = 4.0
"""Standard errors above which a slope is called significant."""
_TOO_NEAR = "too near the first torsional mode"


@dataclass(frozen=True, kw_only=True)
class KinematicErrorFit:
    """The kinematic error of one direction, fitted, with what is needed to judge and to plot it.

    estimates: transmission_accuracy, slope, ratio, amplitude_v of the expected and the significant
    orders, phase_v of the significant ones. orders: all orders. metrics [SI]: mse_curve, mse_raw
    (equation 22) with harmonics, raw_peak_to_peak, closure, residual_rms, left_over,
    raised_by_bench, repeatability, input_revolutions, output_revolutions, samples,
    samples_per_revolution, condition. Arrays: input_angle (c,) over
    one input revolution with measured_curve and fitted_curve; output_curve over one output
    revolution at output_curve_angle [input angle, rad]. delay [s]: output behind input, corrected; speed: of the
    input [rad/s].
    """

    ratio: float
    direction: float
    accuracy_order: float
    estimates: dict[str, Estimate]
    orders: tuple[OrderEstimate, ...]
    metrics: dict[str, float]
    warnings: tuple[str, ...]
    slips: tuple[Slip, ...]
    input_angle: Array
    measured_curve: Array
    fitted_curve: Array
    output_curve_angle: Array
    output_curve: Array
    regression: AngleFit
    torsion: BudgetLine = torsion.BY_SET
    speed: float = 0.0
    delay: float = 0.0

    @property
    def basis(self) -> Basis:
        return self.regression.basis

    def order(self, order: float) -> OrderEstimate:
        """The estimate of one order; raises if the basis lacks it."""
        return self.orders[(self.basis.index(order) - 2) // 2]


def edges(table: Array) -> Array:
    """Only the instants at which the output count changes: midpoints around each change, (rows, m).

    Row 0 of `table` (rows, n) is the input angle, row 1 the output angle, others go along.

    Half way between two counts the output is known to a fraction of a count; everything in between is redundant.
    """
    at = np.flatnonzero(np.diff(table[1]) != 0.0)
    middle: Array = 0.5 * (table[:, at] + table[:, at + 1])
    return middle


class KinematicErrorAccumulator:
    """Takes blocks of (input angle, output angle) of one steady stretch in one direction; memory does not grow.

    `ratio` is that of the mounting (N with the circular spline fixed, N + 1 with the flexspline
    fixed); `output_angle` counts positive as an ideal output turns. `basis` fixes the orders;
    without one they follow the data from `standard_basis` on. `edge_triggered` keeps only the
    samples at which the output count changes. `beside` is how many further values go along with
    each sample (time, torque), to be fitted over the same angle.
    """

    def __init__(
        self,
        ratio: float,
        *,
        basis: Basis | None = None,
        encoders: Encoders | None = None,
        edge_triggered: bool = False,
        highest_order: int = HIGHEST_ORDER,
        beside: int = 0,
    ) -> None:
        self.ratio = positive("ratio", ratio)
        self.encoders = encoders or Encoders()
        self.edge_triggered = edge_triggered
        self.highest_order = highest_order
        self.follows_data = basis is None
        self.basis = basis or standard_basis(ratio, highest_order)
        self.samples = 0
        self._regression = AngleRegression(ratio, 1 + beside)
        self._carry: Array | None = None

    def add(self, input_angle: ArrayLike, output_angle: ArrayLike, *beside: ArrayLike) -> None:
        """Add a block of samples, in order of time; the cutting into blocks changes nothing."""
        if np.size(input_angle) == 0 and np.size(output_angle) == 0:
            return
        named = {"input_angle": input_angle, "output_angle": output_angle}
        named |= {f"value {k}": value for k, value in enumerate(beside)}
        theta_i, theta_o, *others = channels(1, **named)
        self.samples += len(theta_i)
        if self.edge_triggered:
            table = np.array([theta_i, theta_o, *others])
            whole = table if self._carry is None else np.hstack([self._carry, table])
            self._carry = whole[:, -1:].copy()
            theta_i, theta_o, *others = edges(whole)
            if not len(theta_i):
                return
        for start in range(0, len(theta_i), CHUNK):
            part = slice(start, start + CHUNK)
            error = theta_o[part] - theta_i[part] / self.ratio
            self._regression.take(theta_i[part], np.array([error, *(o[part] for o in others)]))

    def cells(self) -> Cells:
        """The sums so far."""
        return self._regression.cells()

    def fit(self, *, accuracy_order: float | None = None) -> KinematicErrorFit:
        """The fit of all samples so far; `accuracy_order`: highest order of the transmission
        accuracy (all by default).
        """
        return fit_traverses([self], accuracy_order=accuracy_order)[0]


def fit_traverses(
    accumulators: Sequence[KinematicErrorAccumulator],
    *,
    accuracy_order: float | None = None,
    spring: torsion.Spring | None = None,
    time: int | None = None,
) -> list[KinematicErrorFit]:
    """The fits of several traverses of one gear, in one basis that follows the data of all.

    `spring` takes the torsional amplification out; `time` is the number of the value beside the
    angles that is the time of the samples [s], from which speed, input ripple and the output's
    delay follow.
    """
    cleaned = [_without_slips(one) for one in accumulators]
    fits = [one.fit for one in cleaned]
    rounding = [one.rounding for one in cleaned]
    if accumulators[0].follows_data:
        fits = in_orders_of_all(fits, max(one.highest_order for one in accumulators), rounding)
    fits = [_with_rounding(fit, locked) for fit, locked in zip(fits, rounding, strict=True)]
    seen = [torsion.traverse(fit, None if time is None else 1 + time) for fit in fits]
    spring = spring and spring.seen_in(seen)
    ahead = next((s for s in seen if s.fit.cells.direction > 0.0), None)
    back = next((s for s in seen if s.fit.cells.direction < 0.0), None)
    delay = 0.0
    if ahead is not None and back is not None:
        delay = torsion.delay_between(ahead, back, spring)[0]
    return [
        _finish(one, clean, raw, spring, delay, accuracy_order)
        for one, clean, raw in zip(accumulators, cleaned, seen, strict=True)
    ]


def _rounding(one: KinematicErrorAccumulator, fit: AngleFit) -> LockedRounding | None:
    """The output count's rounding where every sample counts; edges know the angle to a fraction of a count."""
    if one.edge_triggered or not one.encoders.output_quantum > 0.0:
        return None
    per_turn = (one.samples - 1) / max(fit.cells.revolutions, 1e-9)
    return LockedRounding.of(fit, per_turn, one.encoders.output_quantum)


def _wander(rounding: LockedRounding | None) -> float:
    return 0.0 if rounding is None else rounding.wander()


def _with_rounding(fit: AngleFit, rounding: LockedRounding | None) -> AngleFit:
    """The fit with what rounding locked to the input angle may add to its orders in its covariance."""
    if rounding is None:
        return fit
    variance = rounding.variance(np.array(fit.basis.orders)) * fit.used[2::2]
    added = np.concatenate([[0.0, 0.0], np.repeat(variance, 2)])
    return replace(fit, covariance=fit.covariance + np.diag(added))


@dataclass(frozen=True)
class _Cleaned:
    """A fit of one traverse with slipped counts taken out, and what has to be said."""

    fit: AngleFit
    notes: list[str]
    slips: tuple[Slip, ...]
    rounding: LockedRounding | None


def _without_slips(one: KinematicErrorAccumulator) -> _Cleaned:
    cells = one.cells()
    first, notes = solve_angle(cells, one.basis)
    refuse_wrong_ratio(
        one.ratio, first.values[1] / cells.trend_scale, cells.revolutions / one.ratio
    )
    rounding = _rounding(one, first)
    if one.follows_data:
        # A slip is a step of whole revolutions: sidebands are fitted before it is looked for, output orders are not.
        first = followed(first, one.highest_order, rounding, slowest=SLOWEST_SIDEBAND)
        rounding = _rounding(one, first)
    slips, cleaned = find_slips(
        first,
        output_quantum=one.encoders.output_quantum,
        input_quantum=one.encoders.input_quantum,
        wander=_wander(rounding),
    )
    if slips:
        first, notes = solve_angle(cleaned, first.basis)
    return _Cleaned(first, notes, slips, rounding)


def _finish(
    one: KinematicErrorAccumulator,
    clean: _Cleaned,
    raw: torsion.Traverse,
    spring: torsion.Spring | None,
    delay: float,
    accuracy_order: float | None,
) -> KinematicErrorFit:
    """What is to be said of one traverse; its curve over the input is the one that the encoders show."""
    fit = torsion.corrected(raw, spring, delay)
    cells, ratio, encoders = fit.cells, fit.basis.ratio, one.encoders
    highest = max(fit.basis.orders) if accuracy_order is None else accuracy_order
    slope, sentences = _slope(fit, encoders, WANDERS * _wander(clean.rounding))
    warnings = [*(slip.sentence() for slip in clean.slips), *clean.notes, *sentences]
    near, amplified = torsion.too_near(raw, spring), torsion.line_of(spring)
    orders = tuple(
        OrderEstimate.of(fit, k, encoders, amplified, _TOO_NEAR if near[k] else "")
        for k in range(len(fit.basis.orders))
    )
    accuracy, angle, curve, extra = _accuracy(fit, highest, encoders, amplified)
    is_near = any(o.significant and n for o, n in zip(orders, near, strict=True))
    accuracy = _judged(accuracy, fit, closes=not sentences, is_near=is_near)
    bins, measured, fitted = measured_curve(raw.fit)
    if not one.edge_triggered:
        per_turn = one.samples / max(cells.revolutions, 1e-9)
        warnings += _sampling_warnings(per_turn, ratio, encoders, max(fit.basis.orders))
    return KinematicErrorFit(
        ratio=ratio,
        direction=cells.direction,
        accuracy_order=highest,
        estimates={"transmission_accuracy": accuracy, **slope, **_of_orders(orders, fit)},
        orders=orders,
        metrics=_metrics(raw.fit, measured, fitted, one.samples) | extra,
        warnings=tuple(warnings),
        slips=clean.slips,
        input_angle=bins,
        measured_curve=measured,
        fitted_curve=fitted,
        output_curve_angle=angle,
        output_curve=curve,
        regression=fit,
        torsion=amplified,
        speed=raw.speed,
        delay=delay,
    )


def _judged(accuracy: Estimate, fit: AngleFit, *, closes: bool, is_near: bool) -> Estimate:
    """The transmission accuracy, refused where the fit cannot tell it."""
    if not closes:
        reason = "the kinematic error does not close: see the slope"
    elif fit.cells.revolutions < WHOLE_TURN * fit.basis.ratio:
        reason = "needs one complete output revolution"
    elif is_near:
        reason = f"an order is {_TOO_NEAR}"
    else:
        return accuracy
    return replace(accuracy, identifiable="no", note=reason)


def _accuracy(
    fit: AngleFit, highest: float, encoders: Encoders, amplified: BudgetLine
) -> tuple[Estimate, Array, Array, dict[str, float]]:
    """The gear's transmission accuracy, the curve that it is of, and what the fit leaves and encoders add to it.

    `amplified` is the line of what the first mode leaves open.
    """
    ratio = fit.basis.ratio
    accuracy, angle, curve = transmission_accuracy(fit, highest, amplified)
    raised = raised_by(angle, curve, encoders.stated.waves(ratio))
    accuracy = _of_gear(accuracy, encoders.of_curve(ratio), raised)
    if encoders.unsaid:
        more = raised_by(angle, curve, encoders.waves(ratio)) - raised
        accuracy = accuracy.with_budget([encoders.unsaid_raise(more)])
    rest = left_over(fit, highest)
    if rest > 0.0:
        line = BudgetLine(
            "residual that the fitted orders leave",
            "B",
            2.0 * CREST * rest / math.sqrt(3.0),
            f"a curve of that r.m.s. above the noise reaches {CREST:g} times it, on either side",
            distribution=Distribution.RECTANGULAR,
        )
        accuracy = accuracy.with_budget([line])
    return accuracy, angle, curve, {"left_over": rest, "raised_by_bench": 0.5 * raised}


def _of_orders(orders: Sequence[OrderEstimate], fit: AngleFit) -> dict[str, Estimate]:
    """Amplitudes of the expected and the significant orders, phases of the significant ones."""
    estimates: dict[str, Estimate] = {}
    expected = expected_labels(fit.basis.ratio)
    for order, used in zip(orders, fit.used[2::2], strict=True):
        if order.significant or (used and order.label in expected):
            estimates[f"amplitude_{order.label}"] = order.amplitude
        if order.significant:
            estimates[f"phase_{order.label}"] = order.phase
    return estimates


def expected_labels(ratio: float) -> tuple[str, ...]:
    """The orders of which every result speaks: one that is not there is "below X", which is an answer."""
    return standard_basis(ratio, _EXPECTED_ORDER).labels


def _of_gear(accuracy: Estimate, bench: tuple[BudgetLine, ...], raised: float) -> Estimate:
    """The gear's transmission accuracy: the peak-to-peak of what the encoders show, less what they make of it.

    A slow curve of the bench under the gear's fast one adds its own peak-to-peak, whatever its
    phase: an error with a sign. Where the class of an encoder is all that is stated the curve lies
    between none and one as large as the class, with `raised` on average: half of that is taken off
    the value, and off both ends of its interval.
    """
    if not raised > 0.0:
        return accuracy.with_budget(bench)
    share = 0.5 * raised
    line = BudgetLine(
        "peak-to-peak raised by encoders and mounting, corrected",
        "B",
        share / math.sqrt(3.0),
        f"{share / ARCSEC:.2g} arcsec taken off: between nothing and twice that, by Monte Carlo of their classes",
        distribution=Distribution.RECTANGULAR,
    )
    value, low, high = (max(x - share, 0.0) for x in (accuracy.value, accuracy.low, accuracy.high))
    return replace(
        accuracy.with_budget([*bench, line]),
        value=value,
        low=low,
        high=high,
        note=f"{share / ARCSEC:.2g} arcsec of encoders and mounting taken off",
    )


def _metrics(fit: AngleFit, measured: Array, fitted: Array, samples: int) -> dict[str, float]:
    cells = fit.cells
    mean = float((cells.count * cells.mean[0]).sum()) / cells.samples
    raw_variance = float(cells.square[0]) / cells.samples - mean**2
    varies = float(np.var(measured)) > 0.0
    return {
        "mse_curve": normalised_mse(measured, fitted) if varies else math.nan,
        "mse_raw": quotient(100.0 * fit.residual_variance, raw_variance),
        "harmonics": float(fit.used[2::2].sum()),
        "raw_peak_to_peak": float(cells.highest[0] - cells.lowest[0]),
        "closure": float(fit.values[1]),
        "residual_rms": math.sqrt(fit.residual_variance),
        "repeatability": repeatability(fit),
        "input_revolutions": cells.revolutions,
        "output_revolutions": cells.revolutions / fit.basis.ratio,
        "samples": float(samples),
        "samples_per_revolution": samples / max(cells.revolutions, 1e-9),
        "condition": fit.condition,
    }


def _slope(
    fit: AngleFit, encoders: Encoders, wander: float
) -> tuple[dict[str, Estimate], list[str]]:
    """Slope and ratio with their intervals, and a sentence when the slope is significant and matters."""
    scale, ratio = fit.cells.trend_scale, fit.basis.ratio
    closure, error = float(fit.values[1]), math.sqrt(max(float(fit.covariance[1, 1]), 0.0))
    half = fit.quantile() * error
    line = BudgetLine(polar.RESIDUAL, "A", error / scale, degrees_of_freedom=fit.freedom)
    slope = Estimate(
        name="slope",
        value=closure / scale,
        unit="rad/rad",
        low=(closure - half) / scale,
        high=(closure + half) / scale,
        budget=(line,),
    )
    seen = 1.0 / (1.0 / ratio + slope.value)
    spread = ratio**2 * half / scale
    of_ratio = replace(line, standard_uncertainty=ratio**2 * line.standard_uncertainty)
    estimates = {
        "slope": slope,
        "ratio": Estimate.about("ratio", seen, spread, "1", (of_ratio,)),
    }
    quantum = encoders.output_quantum if math.isfinite(encoders.output_quantum) else 2.0 * ARCSEC
    matters = abs(closure) > max(0.1 * quantum, 0.5 * ARCSEC, wander)
    turns = fit.cells.revolutions / ratio
    if abs(closure) > _SLOPE_SIGNIFICANCE * error and matters and turns >= WHOLE_TURN:
        return estimates, [
            slope_sentence(ratio, closure, encoders.output_quantum, encoders.input_quantum)
        ]
    return estimates, []


def _sampling_warnings(
    per_turn: float, ratio: float, encoders: Encoders, highest: float
) -> list[str]:
    if not math.isfinite(encoders.output_quantum):
        return []
    counts = REVOLUTION / encoders.output_quantum / ratio
    alias = alias_warning(
        lattice_aliases(per_turn, counts, encoders.output_quantum, highest), per_turn
    )
    return list(filter(None, (alias,)))


@dataclass(frozen=True)
class KinematicErrorScore:
    """A fitted curve on a run that it was not fitted to: MSE (22) on the averaged curve, and both
    curves over one turn.
    """

    mse: float
    input_angle: Array
    measured: Array
    predicted: Array


def score_kinematic_error(fit: KinematicErrorFit, other: KinematicErrorFit) -> KinematicErrorScore:
    """MSE (22) of `fit` on the averaged curve of another run (same index mark, same gear);
    offsets are free.
    """
    if fit.ratio != other.ratio:
        raise IdentificationError("the two fits differ in ratio", where="ratio")
    bins, measured, _ = measured_curve(other.regression)
    series = other.regression.cells.series(fit.basis, fit.regression.values)
    predicted: Array = other.regression.cells.per_place(series)[1][0]
    predicted = predicted + np.mean(measured - predicted)
    return KinematicErrorScore(normalised_mse(measured, predicted), bins, measured, predicted)
