"""Two directions together: the kinematic error proper, wind-up and skew, and the phase of friction against error.

The mean of forward and reverse is the kinematic error (a function of the input angle alone); their
half difference is what changes sign with the direction: wind-up by friction, backlash, and skew
between the channels times speed.

Figure 16: the half difference of the *torque* of both directions over the input angle is friction;
the half sum is conservative (cogging, and the reaction of the error's own slope). The phase between
the friction's order 2 and that of the kinematic error says whether both have their extremes at the
same angle.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from model.errors import IdentificationError
from model.identify import polar
from model.identify.angle_fit import AngleFit
from model.identify.angle_regression import Basis
from model.identify.checks import Array
from model.identify.estimate import BudgetLine, Distribution, Estimate
from model.identify.kinematic_error import KinematicErrorFit, expected_labels
from model.identify.least_squares import student_quantile
from model.identify.order_estimate import OrderEstimate, doubts, with_bench
from model.identify.transmission import curve_over_output
from model.units import DEGREE

_PhaseVerdict = Literal["in phase", "not in phase", "cannot tell"]
ALIKE = 0.5
"""Half difference of the directions over their mean up to which an order that nobody expects is the gear's."""
_LAG_LINE = BudgetLine("lag of the torque port", "B", 0.0, "filters and settling, taken as none")
"""Of amplitudes and phases of a torque over the angle."""
_IN_PHASE = 30.0 * DEGREE
"""Largest phase difference [rad] at which two extremes are still called the same place."""


@dataclass(frozen=True, kw_only=True)
class CombinedKinematicError:
    """Forward and reverse of one gear: mean curve (kinematic error) and half difference (wind-up and skew).

    cosine, sine, and their covariance (2k, 2k) of the mean, in the order of `orders`; estimates: amplitude_v, phase_v,
    transmission_accuracy_forward/reverse, lost_motion; metrics: agreement [rms of the half difference, rad].
    """

    ratio: float
    orders: tuple[float, ...]
    labels: tuple[str, ...]
    cosine: Array
    sine: Array
    covariance: Array
    freedom: float
    estimates: dict[str, Estimate]
    metrics: dict[str, float]
    warnings: tuple[str, ...]
    input_angle: Array
    forward: Array
    reverse: Array
    mean: Array


def combine(forward: KinematicErrorFit, reverse: KinematicErrorFit) -> CombinedKinematicError:
    """The kinematic error of a gear from one fit of each direction; both must share basis, ratio and index mark."""
    forward, reverse = _as_a_pair(forward, reverse)
    ahead, back = forward.regression, reverse.regression
    mean = 0.5 * (ahead.values + back.values)
    half = 0.5 * (ahead.values - back.values)
    covariance = 0.25 * (ahead.covariance + back.covariance)[2:, 2:]
    basis = forward.basis
    estimates = {
        f"transmission_accuracy_{way}": _beside_mean(fit, mean)
        for way, fit in (("forward", forward), ("reverse", reverse))
    }
    estimates["lost_motion"] = _lost_motion(forward, reverse)
    estimates |= _orders_of_both(forward, reverse, mean, half, covariance)
    angle = np.linspace(0.0, 2.0 * math.pi, 720, endpoint=False)
    curves = [_whole_orders(basis, values, angle) for values in (ahead.values, back.values)]
    warnings = [f"forward: {w}" for w in forward.warnings] + [
        f"reverse: {w}" for w in reverse.warnings
    ]
    return CombinedKinematicError(
        ratio=forward.ratio,
        orders=basis.orders,
        labels=basis.labels,
        cosine=mean[2::2],
        sine=mean[3::2],
        covariance=covariance,
        freedom=ahead.freedom + back.freedom,
        estimates=estimates,
        metrics={"agreement": float(np.sqrt(0.5 * np.sum(half[2:] ** 2)))},
        warnings=tuple(warnings),
        input_angle=angle,
        forward=curves[0],
        reverse=curves[1],
        mean=0.5 * (curves[0] + curves[1]),
    )


def _orders_of_both(
    forward: KinematicErrorFit,
    reverse: KinematicErrorFit,
    mean: Array,
    half: Array,
    covariance: Array,
) -> dict[str, Estimate]:
    """Amplitude and phase of the mean (p,) at expected orders and at those that both directions have alike."""
    ahead, back = forward.regression, reverse.regression
    doubt = None
    if ahead.doubt is not None and back.doubt is not None:
        doubt = 0.5 * (ahead.doubt + back.doubt)
    estimates: dict[str, Estimate] = {}
    expected = expected_labels(forward.ratio)
    for k, label in enumerate(forward.basis.labels):
        at = 2 + 2 * k
        seen = forward.orders[k].significant or reverse.orders[k].significant
        if not (seen or (label in expected and ahead.used[at] and back.used[at])):
            continue
        order = polar.polar(
            label,
            mean[at : at + 2],
            covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2],
            ahead.freedom + back.freedom,
            "rad",
            doubts(doubt, at, forward.torsion),
        )
        # What is a function of the input angle alone is in both directions alike; folded rounding is not.
        alike = np.hypot(*half[at : at + 2]) < ALIKE * np.hypot(*mean[at : at + 2])
        if label not in expected and not (alike and order.significant):
            continue
        amplitude, phase = _of_bench(order, forward.orders[k])
        estimates[f"amplitude_{label}"] = amplitude
        if seen:
            estimates[f"phase_{label}"] = phase
    return estimates


def _as_a_pair(
    one: KinematicErrorFit, other: KinematicErrorFit
) -> tuple[KinematicErrorFit, KinematicErrorFit]:
    """The forward and the reverse one of two fits. Raises `IdentificationError` where they are none."""
    if one.direction == other.direction:
        raise IdentificationError(
            "are both of the same direction",
            where="forward, reverse",
            remedy="Give one fit of each direction.",
        )
    if one.basis.orders != other.basis.orders or one.ratio != other.ratio:
        raise IdentificationError(
            "differ in basis or ratio",
            where="forward, reverse",
            remedy="Fit both with the same orders.",
        )
    return (other, one) if one.direction < 0.0 else (one, other)


def _of_bench(mean: polar.Polar, forward: OrderEstimate) -> tuple[Estimate, Estimate]:
    """Amplitude and phase of the mean of both directions with what the bench puts on the order: it is the same in
    both, the mean does not lessen it; and what one direction cannot tell, both cannot.
    """
    amplitude, phase = with_bench(mean, forward.bench, forward.bound, forward.unsaid)
    if forward.amplitude.identifiable != "no":
        return amplitude, phase
    note = forward.amplitude.note
    return (
        replace(amplitude, identifiable="no", note=note),
        replace(phase, identifiable="no", note=note),
    )


def _beside_mean(fit: KinematicErrorFit, mean: Array) -> Estimate:
    """The transmission accuracy of one direction with what friction adds to it in that direction alone.

    Wind-up varies with the friction over the mesh: it changes sign with the direction, so that the
    mean of both is without it. The gear's own error lies between the two.
    """
    accuracy = fit.estimates["transmission_accuracy"]
    _, both = curve_over_output(replace(fit.regression, values=mean), fit.accuracy_order)
    away = float(np.ptp(both)) - float(np.ptp(fit.output_curve))
    line = BudgetLine(
        "friction in one direction, by the mean of both",
        "B",
        abs(away) / math.sqrt(3.0),
        distribution=Distribution.RECTANGULAR,
    )
    return replace(
        accuracy.with_budget([line]),
        low=max(accuracy.low + min(away, 0.0), 0.0),
        high=accuracy.high + max(away, 0.0),
    )


def _lost_motion(forward: KinematicErrorFit, reverse: KinematicErrorFit) -> Estimate:
    """Offset between the directions: wind-up by friction plus skew times speed, forward minus reverse [rad]."""
    ahead, back = forward.regression, reverse.regression
    middle = 0.5 * (ahead.cells.first_angle + ahead.cells.last_angle)
    value, variance = 0.0, 0.0
    for fit, sign in ((ahead, 1.0), (back, -1.0)):
        weights = np.array([1.0, (middle - fit.cells.first_angle) / fit.cells.trend_scale])
        value += sign * float(weights @ fit.values[:2])
        variance += float(weights @ fit.covariance[:2, :2] @ weights)
    freedom, error = min(ahead.freedom, back.freedom), math.sqrt(max(variance, 0.0))
    half = student_quantile(freedom) * error
    note = "wind-up by friction and skew between the channels together; runs at several speeds tell them apart"
    line = BudgetLine(polar.RESIDUAL, "A", error, degrees_of_freedom=freedom)
    return Estimate.about(
        "lost_motion", value, half, "rad", (line,), identifiable="weakly", note=note
    )


def _whole_orders(basis: Basis, values: Array, angle: Array) -> Array:
    total = np.zeros_like(angle)
    for k, order in enumerate(basis.orders):
        if abs(order - round(order)) < 1e-9:
            total += values[2 + 2 * k] * np.cos(order * angle) + values[3 + 2 * k] * np.sin(
                order * angle
            )
    return total


@dataclass(frozen=True, kw_only=True)
class PhaseRelation:
    """Figure 16: does the friction torque have its extremes where the kinematic error has them?

    estimates: phase_difference [rad, torque minus error at `order`, in (-pi, pi]], friction_amplitude and
    conservative_amplitude [N m], error_amplitude [rad]. input_angle with friction_torque and
    kinematic_error: curves over one input revolution without their means.
    """

    order: float
    verdict: _PhaseVerdict
    sentence: str
    estimates: dict[str, Estimate]
    input_angle: Array
    friction_torque: Array
    kinematic_error: Array


def phase_relation(
    error: CombinedKinematicError,
    torque_forward: AngleFit,
    torque_reverse: AngleFit,
    *,
    order: float = 2.0,
    torque_lag_angle: tuple[float, float] = (0.0, 0.0),
) -> PhaseRelation:
    """Phase difference between friction torque and kinematic error at one order, with 95 % interval and verdict.

    The torques are `fit_over_angle` of the torque channel of each direction over the same input
    angle. `torque_lag_angle`: value and standard uncertainty of the torque's lag times input speed
    [rad of input angle]; the lag turns the phase of each direction the opposite way.
    """
    if torque_forward.cells.direction < 0.0:
        torque_forward, torque_reverse = torque_reverse, torque_forward
    torques = (torque_forward, torque_reverse)
    at = int(np.argmin(np.abs(np.array(error.orders) - order)))
    e_block = error.covariance[2 * at : 2 * at + 2, 2 * at : 2 * at + 2]
    freedom = min(torque_forward.freedom, torque_reverse.freedom, error.freedom)
    label = error.labels[at]
    of_friction, of_wedge = _torques_at(order, label, torques, torque_lag_angle, freedom)
    of_error = polar.polar(
        label, np.array([error.cosine[at], error.sine[at]]), e_block, freedom, "rad"
    )
    difference = _phase_difference(
        of_friction.phase, error.estimates.get(f"phase_{label}", of_error.phase)
    )
    value = difference.value
    half = min(difference.expanded_uncertainty, math.pi)
    verdict = _phase_verdict(value, half)
    angle = np.linspace(0.0, 2.0 * math.pi, 720, endpoint=False)
    curves = [_whole_orders(torque_forward.basis, fit.values, angle) for fit in torques]
    return PhaseRelation(
        order=order,
        verdict=verdict,
        sentence=_phase_sentence(label, value, half, verdict),
        estimates={
            "phase_difference": difference,
            "friction_amplitude": of_friction.amplitude,
            "conservative_amplitude": of_wedge.amplitude,
            # The very number that stands among the orders, with all that the bench may add.
            "error_amplitude": error.estimates.get(f"amplitude_{label}", of_error.amplitude),
        },
        input_angle=angle,
        friction_torque=0.5 * (curves[0] - curves[1]),
        kinematic_error=error.mean,
    )


def _torques_at(
    order: float,
    label: str,
    torques: tuple[AngleFit, AngleFit],
    lag_angle: tuple[float, float],
    freedom: float,
) -> tuple[polar.Polar, polar.Polar]:
    """The friction torque and the conservative one at an order, from the torques forward and reverse."""
    (ahead, block_a), (back, block_b) = (fit.complex_amplitude(order) for fit in torques)
    lag, lag_error = lag_angle
    ahead, back = ahead * cmath.exp(1j * order * lag), back * cmath.exp(-1j * order * lag)
    friction, conservative = 0.5 * (ahead - back), 0.5 * (ahead + back)
    block = 0.25 * (block_a + block_b)
    # A lag that is not known turns each direction its own way: it mixes friction and what is conservative.
    turn = 1j * order * lag_error

    def at_order(torque: complex, other: complex) -> polar.Polar:
        doubt = ((_LAG_LINE, _vector(turn * other)),)
        return polar.polar(label, _vector(torque), block, freedom, "N m", doubt)

    return at_order(friction, conservative), at_order(conservative, friction)


def _vector(amplitude: complex) -> Array:
    """Cosine and sine of a complex amplitude."""
    return np.array([amplitude.real, -amplitude.imag])


def _phase_difference(torque: Estimate, error: Estimate) -> Estimate:
    """The phase of the friction torque less that of the error [rad], with all that either is uncertain by."""
    value = math.remainder(torque.value - error.value, 2.0 * math.pi)
    half = min(math.hypot(*(0.5 * (one.high - one.low) for one in (torque, error))), math.pi)
    lines = [
        replace(
            line, source=f"{line.source} ({what})" if line.source == polar.RESIDUAL else line.source
        )
        for what, one in (("torque", torque), ("error", error))
        for line in one.budget
    ]
    found = Estimate.about("phase_difference", value, half, "rad", tuple(lines))
    if found.expanded_uncertainty < 0.5 * math.pi:
        return found
    note = "the friction torque or the error at this order is not above what is uncertain of it"
    return replace(found, identifiable="no", note=note)


def _phase_verdict(difference: float, half: float) -> _PhaseVerdict:
    if abs(difference) + half <= _IN_PHASE:
        return "in phase"
    if abs(difference) - half > _IN_PHASE:
        return "not in phase"
    return "cannot tell"


def _phase_sentence(label: str, difference: float, half: float, verdict: _PhaseVerdict) -> str:
    digits = (half < 10.0 * DEGREE) + (half < DEGREE)
    number = (
        f"{difference / DEGREE:.{digits}f} ± {half / DEGREE:.{digits}f} degrees of order {label}"
    )
    if verdict == "in phase":
        return f"Friction torque and kinematic error have their extremes near the same angle: {number} apart."
    if verdict == "not in phase":
        return f"Friction torque and kinematic error do not have their extremes at the same angle: {number} apart."
    return (
        f"The data cannot tell whether friction torque and kinematic error are in phase: {number}."
    )
