"""The kinematic error of a gear from a slow run: linear least squares, streamed (equations 15, 16 and 22).

    ke(theta_i) = theta_o - theta_i/N ,   y = a_0 + s theta_i + sum_v (a_v cos v theta_i + b_v sin v theta_i)

theta_o counts positive in the direction in which an ideal gear turns its output when theta_i grows;
positive = the output leads. One accumulator takes one direction; `model.identify.directions` puts
two directions together.

Transmission accuracy is the peak-to-peak of the fitted curve over one output revolution, one
direction (catalogue definition), up to a stated order; raw peak-to-peak and the 360-degree closure
stand beside it. The slope s must be zero: a significant slope is reported as what it is (wrong
ratio, lost counts, slip), never as a parameter of the gear.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from model.errors import IdentificationError
from model.identify.angle_regression import (
    AngleFit,
    AngleRegression,
    Basis,
    Sums,
    solve_angle,
    standard_basis,
)
from model.identify.checks import Array, channels, positive
from model.identify.counting import (
    WHOLE_TURN,
    Slip,
    alias_warning,
    find_slips,
    lattice_aliases,
    refuse_wrong_ratio,
    slope_sentence,
)
from model.identify.estimate import BudgetLine, Cause, Estimate
from model.identify.transmission import measured_curve, repeatability, transmission_accuracy
from model.kinematic_error import normalised_mse
from model.units import ARCSEC, REVOLUTION

SLOPE_SIGNIFICANCE = 4.0
"""Standard errors above which a slope is called significant."""


@dataclass(frozen=True)
class Encoders:
    """What the two encoders can do: size of one count [rad] and standard uncertainty of their position [rad].

    Quanta are of the counts as recorded (after multiplication). Accuracies include eccentricity of
    the scale; they cannot be told from the gear's own output order 1 and input orders 1 and 2, so
    they enter the budget (type B).
    """

    output_quantum: float = math.nan
    input_quantum: float = math.nan
    output_accuracy: float = 0.0
    input_accuracy: float = 0.0


@dataclass(frozen=True, kw_only=True)
class OrderEstimate:
    """One order of the kinematic error: a cos + b sin = amplitude cos(v theta - phase), with 95 % intervals.

    `significant`: the amplitude is larger than the noise explains (99 % level).
    """

    order: float
    label: str
    cosine: Estimate
    sine: Estimate
    amplitude: Estimate
    phase: Estimate
    significant: bool


@dataclass(frozen=True, kw_only=True)
class KinematicErrorFit:
    """The kinematic error of one direction, fitted, with what is needed to judge and to plot it.

    estimates: transmission_accuracy, slope, ratio, and amplitude_v, phase_v of the significant
    orders. orders: all orders. metrics [SI]: mse_curve, mse_raw (equation 22), raw_peak_to_peak,
    closure, residual_rms, repeatability, input_revolutions, output_revolutions, samples,
    samples_per_revolution, condition. Arrays: input_angle (c,) over one input revolution with
    measured_curve and fitted_curve; output_curve over one output revolution at output_curve_angle
    [input angle, rad]; block_angle, block_residual: mean residual per whole revolution.
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
    block_angle: Array
    block_residual: Array
    regression: AngleFit

    @property
    def basis(self) -> Basis:
        return self.regression.sums.basis

    def order(self, order: float) -> OrderEstimate:
        """The estimate of one order; raises if the basis lacks it."""
        return self.orders[(self.basis.index(order) - 2) // 2]


def edges(input_angle: ArrayLike, output_angle: ArrayLike) -> tuple[Array, Array]:
    """Only the instants at which the output count changes: midpoints of both angles around each change, shape (m,).

    Half way between two counts the output is known to a fraction of a count; everything in between is redundant.
    """
    theta_i, theta_o = channels(2, input_angle=input_angle, output_angle=output_angle)
    at = np.flatnonzero(np.diff(theta_o) != 0.0)
    if at.size == 0:
        raise IdentificationError(
            "never changes",
            where="output_angle",
            value=theta_o[0],
            remedy="Check the output encoder.",
        )
    return 0.5 * (theta_i[at] + theta_i[at + 1]), 0.5 * (theta_o[at] + theta_o[at + 1])


class KinematicErrorAccumulator:
    """Takes blocks of (input angle, output angle) of one steady stretch in one direction; memory does not grow.

    `ratio` is that of the mounting (N with the circular spline fixed, N + 1 with the flexspline
    fixed); `output_angle` counts positive as an ideal output turns. `edge_triggered` keeps only the
    samples at which the output count changes.
    """

    def __init__(
        self,
        ratio: float,
        *,
        basis: Basis | None = None,
        encoders: Encoders | None = None,
        edge_triggered: bool = False,
    ) -> None:
        self.ratio = positive("ratio", ratio)
        self.encoders = Encoders() if encoders is None else encoders
        self.edge_triggered = edge_triggered
        self._regression = AngleRegression(standard_basis(ratio) if basis is None else basis)
        self._carry: tuple[float, float] | None = None
        self._samples = 0

    def add(self, input_angle: ArrayLike, output_angle: ArrayLike) -> None:
        """Add a block of samples, in order of time; the cutting into blocks changes nothing."""
        if np.size(input_angle) == 0 and np.size(output_angle) == 0:
            return
        theta_i, theta_o = channels(1, input_angle=input_angle, output_angle=output_angle)
        self._samples += len(theta_i)
        if not self.edge_triggered:
            self._regression.add(theta_i, theta_o - theta_i / self.ratio)
            return
        if self._carry is not None:
            theta_i, theta_o = (
                np.append(self._carry[0], theta_i),
                np.append(self._carry[1], theta_o),
            )
        self._carry = (float(theta_i[-1]), float(theta_o[-1]))
        if np.any(np.diff(theta_o) != 0.0):
            theta_i, theta_o = edges(theta_i, theta_o)
            self._regression.add(theta_i, theta_o - theta_i / self.ratio)

    def fit(self, *, accuracy_order: float | None = None) -> KinematicErrorFit:
        """The fit of all samples so far; `accuracy_order`: highest order of the transmission
        accuracy (all by default).
        """
        return _finish(
            self._regression.sums(),
            self.encoders,
            accuracy_order,
            self._samples,
            self.edge_triggered,
        )


def _finish(
    sums: Sums, encoders: Encoders, accuracy_order: float | None, samples: int, edge_triggered: bool
) -> KinematicErrorFit:
    ratio = sums.basis.ratio
    first, _ = solve_angle(sums)
    refuse_wrong_ratio(ratio, first.values[1] / sums.trend_scale, sums.revolutions / ratio)
    slips, cleaned = find_slips(
        sums, first, output_quantum=encoders.output_quantum, input_quantum=encoders.input_quantum
    )
    fit, notes = solve_angle(cleaned) if slips else solve_angle(sums)
    warnings = [slip.sentence() for slip in slips] + notes
    highest = max(sums.basis.orders) if accuracy_order is None else accuracy_order
    estimates, sentences = _slope(fit, encoders)
    warnings += sentences
    accuracy, angle, curve = transmission_accuracy(fit, highest)
    accuracy = accuracy.with_budget(_encoder_budget(fit, accuracy, encoders))
    if sentences:
        accuracy = replace(
            accuracy, identifiable="no", note="the kinematic error does not close: see the slope"
        )
    elif cleaned.revolutions < WHOLE_TURN * ratio:
        accuracy = replace(accuracy, identifiable="no", note="needs one complete output revolution")
    orders = tuple(_order(fit, k, encoders) for k in range(len(sums.basis.orders)))
    estimates = {"transmission_accuracy": accuracy, **estimates}
    for order in orders:
        if order.significant:
            estimates[f"amplitude_{order.label}"], estimates[f"phase_{order.label}"] = (
                order.amplitude,
                order.phase,
            )
    bins, measured, fitted = measured_curve(fit)
    if not edge_triggered:
        per_turn = samples / max(sums.revolutions, 1e-9)
        warnings += _sampling_warnings(per_turn, ratio, encoders, max(sums.basis.orders))
    return KinematicErrorFit(
        ratio=ratio,
        direction=sums.direction,
        accuracy_order=highest,
        estimates=estimates,
        orders=orders,
        metrics=_metrics(fit, measured, fitted, samples),
        warnings=tuple(warnings),
        slips=slips,
        input_angle=bins,
        measured_curve=measured,
        fitted_curve=fitted,
        output_curve_angle=angle,
        output_curve=curve,
        block_angle=sums.first_angle
        + sums.direction
        * (np.arange(len(first.block_residual), dtype=np.float64) + 0.5)
        * sums.length,
        block_residual=first.block_residual,
        regression=fit,
    )


def _metrics(fit: AngleFit, measured: Array, fitted: Array, samples: int) -> dict[str, float]:
    sums = fit.sums
    mean = float(sums.right[:, 0].sum()) / sums.count
    raw_variance = sums.sum_square / sums.count - mean**2
    varies = float(np.var(measured)) > 0.0
    return {
        "mse_curve": normalised_mse(measured, fitted) if varies else math.nan,
        "mse_raw": 100.0 * fit.residual_variance / raw_variance if raw_variance > 0.0 else math.nan,
        "raw_peak_to_peak": sums.highest - sums.lowest,
        "closure": float(fit.values[1]),
        "residual_rms": math.sqrt(fit.residual_variance),
        "repeatability": repeatability(fit),
        "input_revolutions": sums.revolutions,
        "output_revolutions": sums.revolutions / sums.basis.ratio,
        "samples": float(samples),
        "samples_per_revolution": samples / max(sums.revolutions, 1e-9),
        "condition": fit.condition,
    }


def _slope(fit: AngleFit, encoders: Encoders) -> tuple[dict[str, Estimate], list[str]]:
    """Slope and ratio with their intervals, and a sentence when the slope is significant and matters."""
    scale, ratio = fit.sums.trend_scale, fit.sums.basis.ratio
    closure, error = float(fit.values[1]), math.sqrt(max(float(fit.covariance[1, 1]), 0.0))
    half = fit.quantile() * error
    slope = Estimate(
        name="slope",
        value=closure / scale,
        unit="rad/rad",
        low=(closure - half) / scale,
        high=(closure + half) / scale,
    )
    seen = 1.0 / (1.0 / ratio + slope.value)
    spread = ratio**2 * half / scale
    estimates = {
        "slope": slope,
        "ratio": Estimate(
            name="ratio", value=seen, unit="1", low=seen - spread, high=seen + spread
        ),
    }
    quantum = encoders.output_quantum if math.isfinite(encoders.output_quantum) else 2.0 * ARCSEC
    matters = abs(closure) > max(0.1 * quantum, 0.5 * ARCSEC)
    turns = fit.sums.revolutions / ratio
    if abs(closure) > SLOPE_SIGNIFICANCE * error and matters and turns >= WHOLE_TURN:
        return estimates, [
            slope_sentence(ratio, closure, encoders.output_quantum, encoders.input_quantum)
        ]
    return estimates, []


def _order(fit: AngleFit, index: int, encoders: Encoders) -> OrderEstimate:
    at = 2 + 2 * index
    order, label = fit.sums.basis.orders[index], fit.sums.basis.labels[index]
    a, b = float(fit.values[at]), float(fit.values[at + 1])
    block = fit.covariance[at : at + 2, at : at + 2]
    t = fit.quantile()
    half_a, half_b = t * math.sqrt(max(block[0, 0], 0.0)), t * math.sqrt(max(block[1, 1], 0.0))
    size = math.hypot(a, b)
    left_out = not fit.used[at]
    radial, tangential = _polar_errors(a, b, block)
    determinant = float(block[0, 0] * block[1, 1] - block[0, 1] ** 2)
    distance = 0.0
    if determinant > 0.0:
        distance = float(np.array([a, b]) @ np.linalg.solve(block, [a, b]))
    significant = distance > 9.21
    verdict = "no" if left_out else "yes" if significant else "weakly"
    note = "left out of this fit" if left_out else "" if significant else "not above the noise"
    phase = math.atan2(b, a)
    turn = min(t * tangential / size, math.pi) if size > 0.0 else math.pi
    accuracy = _encoder_accuracy(order, fit.sums.basis.ratio, encoders)
    lines = [BudgetLine("residual, blocks of whole revolutions", "A", radial)]
    if accuracy > 0.0:
        lines.append(
            BudgetLine(
                "encoder accuracy at this order",
                "B",
                accuracy,
                "cannot be told from the gear",
                Cause.BOTH_ENCODERS,
            )
        )
    amplitude = Estimate(
        name=f"amplitude_{label}",
        value=size,
        unit="rad",
        low=max(size - t * radial, 0.0),
        high=size + t * radial,
        identifiable=verdict,
        note=note,
        budget=tuple(lines),
    )
    amplitude = above_encoders(amplitude)
    verdict, note = amplitude.identifiable, amplitude.note
    return OrderEstimate(
        order=order,
        label=label,
        cosine=Estimate(
            name=f"cosine_{label}",
            value=a,
            unit="rad",
            low=a - half_a,
            high=a + half_a,
            identifiable=verdict,
            note=note,
        ),
        sine=Estimate(
            name=f"sine_{label}",
            value=b,
            unit="rad",
            low=b - half_b,
            high=b + half_b,
            identifiable=verdict,
            note=note,
        ),
        amplitude=amplitude,
        phase=Estimate(
            name=f"phase_{label}",
            value=phase,
            unit="rad",
            low=phase - turn,
            high=phase + turn,
            identifiable=verdict,
            note=note,
            budget=phase_budget(amplitude, tangential),
        ),
        significant=significant and not left_out,
    )


def above_encoders(amplitude: Estimate) -> Estimate:
    """The amplitude of an order, told "weakly" where the encoders alone may make all of it."""
    of_encoders = any(line.kind == "B" for line in amplitude.budget)
    if (
        amplitude.identifiable != "yes"
        or not of_encoders
        or amplitude.expanded_uncertainty < amplitude.value
    ):
        return amplitude
    return replace(amplitude, identifiable="weakly", note="not above what the encoders may add")


def phase_budget(amplitude: Estimate, tangential: float) -> tuple[BudgetLine, ...]:
    """The budget of a phase [rad]: standard error across the phasor, and what encoders add to the
    order, over its amplitude.

    No line exceeds that of a phase of which nothing is known.
    """
    if not amplitude.value > 0.0:
        return ()
    lines = [BudgetLine("residual, blocks of whole revolutions", "A", tangential)]
    lines += [line for line in amplitude.budget if line.kind == "B"]
    unknown = math.pi / math.sqrt(3.0)
    return tuple(
        replace(e, standard_uncertainty=min(e.standard_uncertainty / amplitude.value, unknown))
        for e in lines
    )


def _polar_errors(a: float, b: float, block: Array) -> tuple[float, float]:
    """Standard errors along and across the direction of (a, b)."""
    size = math.hypot(a, b)
    along = np.array([a, b]) / size if size > 0.0 else np.array([1.0, 0.0])
    across = np.array([-along[1], along[0]])
    return math.sqrt(max(float(along @ block @ along), 0.0)), math.sqrt(
        max(float(across @ block @ across), 0.0)
    )


def _encoder_accuracy(order: float, ratio: float, encoders: Encoders) -> float:
    """Type B standard uncertainty that the encoders put on one order [rad at the output]."""
    if abs(order * ratio - 1.0) < 1e-6 or abs(order * ratio - 2.0) < 1e-6:
        return encoders.output_accuracy
    if order in (1.0, 2.0):
        return encoders.input_accuracy / ratio
    return 0.0


def _encoder_budget(fit: AngleFit, accuracy: Estimate, encoders: Encoders) -> list[BudgetLine]:
    spread = 0.5 * (accuracy.high - accuracy.low) / max(fit.quantile(), 1.0)
    lines = [BudgetLine("residual, blocks of whole revolutions", "A", spread)]
    if encoders.output_accuracy > 0.0:
        lines.append(
            BudgetLine(
                "output encoder, eccentricity of the scale",
                "B",
                math.sqrt(2.0) * encoders.output_accuracy,
                "cannot be told from the gear's output order 1 without re-clocking the encoder",
                Cause.OUTPUT_ENCODER,
            )
        )
    if encoders.input_accuracy > 0.0:
        u = math.sqrt(2.0) * encoders.input_accuracy / fit.sums.basis.ratio
        lines.append(
            BudgetLine(
                "motor encoder, once and twice per revolution",
                "B",
                u,
                "cannot be told from orders 1 and 2",
                Cause.MOTOR_ENCODER,
            )
        )
    return lines


def _sampling_warnings(
    per_turn: float, ratio: float, encoders: Encoders, highest: float
) -> list[str]:
    if not math.isfinite(encoders.output_quantum):
        return []
    counts = REVOLUTION / encoders.output_quantum / ratio
    alias = alias_warning(
        lattice_aliases(per_turn, counts, encoders.output_quantum, highest), per_turn
    )
    return [] if alias is None else [alias]


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
    """MSE (22) of `fit` on the averaged curve of another run (same basis, same index mark, same
    gear); offsets are free.
    """
    if fit.basis.orders != other.basis.orders or fit.ratio != other.ratio:
        raise IdentificationError(
            "the two fits differ in basis or ratio",
            where="basis",
            remedy="Fit both with the same orders.",
        )
    bins, measured, _ = measured_curve(other.regression)
    sums = other.regression.sums
    counts = sums.bin_basis[:, 0]
    filled = counts > 0
    values = fit.regression.values.copy()
    values[:2] = 0.0
    predicted = (sums.bin_basis[filled] @ values) / counts[filled]
    predicted += np.mean(measured) - np.mean(predicted)
    return KinematicErrorScore(normalised_mse(measured, predicted), bins, measured, predicted)
