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

from model.angle_certificate import CERTIFIED_ORDERS, CREST
from model.errors import IdentificationError
from model.identify import polar, torsion
from model.identify.angle_regression import (
    WHOLE_TURN,
    AngleFit,
    AngleRegression,
    Basis,
    Cells,
    solve_angle,
    standard_basis,
)
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
from model.identify.estimate import BudgetLine, Cause, Distribution, Estimate
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
_SLOWEST_SIDEBAND = 0.5
"""Order from which one belongs to an input order; below, to the output."""
_SLOPE_SIGNIFICANCE = 4.0
"""Standard errors above which a slope is called significant."""
OUTPUT_ENCODER_ORDERS, MOTOR_ENCODER_ORDERS = (1, 2, 3, 4, 5, 6, 7, 8), (1, 2, 4)
"""Orders of an encoder's own revolution over which the variance of its curve is spread in equal shares: a scale's
eccentricity and waviness; a motor encoder's eccentricity, ovality and four-fold error."""
MOTOR_REST, MOTOR_REST_SHARE = (3, 5, 6, 7, 8), 0.2
"""Other orders of a motor encoder, and the share of its class that they have together: a class bounds the whole curve,
and no encoder has three orders only."""
_UNSAID_ORDERS = OUTPUT_ENCODER_ORDERS
"""Orders of a motor encoder of which nobody says anything: a resolver has those of its poles."""
_TOO_NEAR = "too near the first torsional mode"
FINE_ORDERS, FINE_SHARE = range(9, 65), 0.2
"""Orders of an output encoder's own revolution that no certificate takes out, and the share of its class that they have
together: marks of the scale, balls of its bearing. They meet a gear's input orders where N is below 65."""


@dataclass(frozen=True)
class Encoders:
    """What the two encoders can do: size of one count [rad] and the class of each [rad].

    Quanta are of the counts as recorded (after multiplication). An accuracy is that of a data
    sheet: a bound on the whole curve of errors over one revolution of the encoder, eccentricity of
    the scale included. The curve cannot be told from the gear's own output orders and input orders,
    so it enters the budget (type B): with a rectangular distribution as a whole (u = a/sqrt 3),
    and at single orders with equal shares of that variance, output encoder orders 1 to 8, motor
    encoder orders 1, 2 and 4; the output encoder's orders 9 to 64 share a fifth of its class. Where its
    certificate's curve was taken out, the certificate's standard uncertainty (0: it was not) stands in place of the
    class of orders 1 to 8: any one order may carry all of it.
    Eccentricities are of the gear's seat, amplitudes at the output once per output and once per input
    revolution. A class that is assumed, because nobody stated one, has the words of its line in `..._unsaid`.
    """

    output_quantum: float = math.nan
    input_quantum: float = math.nan
    output_accuracy: float = 0.0
    input_accuracy: float = 0.0
    output_eccentricity: float = 0.0
    input_eccentricity: float = 0.0
    output_certified: float = 0.0
    input_certified: float = 0.0
    output_unsaid: str = ""
    input_unsaid: str = ""

    @property
    def unsaid(self) -> bool:
        """Whether the class of one of them is assumed."""
        return bool(self.output_unsaid or self.input_unsaid)

    @property
    def stated(self) -> Encoders:
        """What somebody said of them."""
        return replace(
            self,
            output_accuracy=0.0 if self.output_unsaid else self.output_accuracy,
            input_accuracy=0.0 if self.input_unsaid else self.input_accuracy,
        )

    def unsaid_at(self, order: float) -> str:
        """Why an order of the output's turn is not the gear's alone: nobody stated the output encoder; "" else."""
        if not self.output_unsaid or order > _SLOWEST_SIDEBAND:
            return ""
        return "an order of the output's turn, and nobody stated the output encoder"

    def unsaid_raise(self, raised: float) -> BudgetLine:
        """What encoders of an assumed class may make of a peak-to-peak, of which nothing is taken off [rad]."""
        kind, note = (
            ("output encoder", self.output_unsaid)
            if self.output_unsaid
            else ("motor encoder", self.input_unsaid)
        )
        u = max(raised, 0.0) / math.sqrt(3.0)
        return BudgetLine("peak-to-peak raised by encoders", "B", u, note, assumed=kind)

    def at_order(self, order: float, ratio: float) -> tuple[BudgetLine, ...]:
        """What they may add to one order of the kinematic error, per component of the vector [rad at the output]."""
        lines = [
            *_certified("output encoder", self.output_certified, order * ratio),
            *_certified("motor encoder", self.input_certified / ratio, order),
        ]
        if not self.output_certified:
            own = order * ratio
            lines += _share(
                "output encoder",
                self.output_accuracy,
                own,
                OUTPUT_ENCODER_ORDERS,
                self.output_unsaid,
            )
        if not self.input_certified:
            lines += _share(
                "motor encoder",
                self.input_accuracy / ratio,
                order,
                self._motor_orders,
                self.input_unsaid,
            )
        if not (self.input_certified or self.input_unsaid):
            rest = MOTOR_REST_SHARE * self.input_accuracy / ratio
            lines += _share("motor encoder", rest, order, MOTOR_REST, "")
        finely = FINE_SHARE * self.output_accuracy
        lines += _share(
            "output encoder", finely, order * ratio, tuple(FINE_ORDERS), self.output_unsaid
        )
        for once, eccentricity in (
            (1.0 / ratio, self.output_eccentricity),
            (1.0, self.input_eccentricity),
        ):
            if abs(order - once) < 1e-9 and eccentricity > 0.0:
                lines.append(
                    BudgetLine(
                        "eccentricity of the mounting",
                        "B",
                        eccentricity / math.sqrt(2.0),
                        "a wave of any phase; other when the gear is taken off and refitted",
                    )
                )
        return tuple(lines)

    @property
    def _motor_orders(self) -> tuple[int, ...]:
        """Orders over which the variance of the motor encoder's curve is spread."""
        return _UNSAID_ORDERS if self.input_unsaid else MOTOR_ENCODER_ORDERS

    def waves(self, ratio: float) -> dict[float, float]:
        """Standard uncertainty of a cosine or sine at every order to which they may add [rad]."""
        motor = CERTIFIED_ORDERS if self.input_certified else self._motor_orders
        orders = [k / ratio for k in OUTPUT_ENCODER_ORDERS] + [float(k) for k in motor]
        return {
            order: math.hypot(
                *(line.standard_uncertainty for line in self._shared.at_order(order, ratio))
            )
            for order in orders
        }

    @property
    def _shared(self) -> Encoders:
        """All orders at once: together they have no more than what a certificate says of the curve."""
        share = 1.0 / math.sqrt(len(CERTIFIED_ORDERS))
        return replace(
            self,
            output_certified=share * self.output_certified,
            input_certified=share * self.input_certified,
        )

    def output_wave(self, order: float, ratio: float) -> float:
        """Standard uncertainty of a cosine or sine of one order by the output encoder, where all orders are taken
        together [rad].
        """
        lines = self._shared.at_order(order, ratio)
        return math.hypot(
            *(one.standard_uncertainty for one in lines if one.cause is Cause.OUTPUT_ENCODER)
        )

    def bound(self, order: float, ratio: float) -> float:
        """What they can add to one order at most: an encoder's order is no larger than its class, or than the
        expanded uncertainty of its certificate [rad].
        """
        output = 2.0 * self.output_certified or self.output_accuracy
        if order * ratio > FINE_ORDERS[0] - 0.5:
            output = FINE_SHARE * self.output_accuracy
        motor = 2.0 * self.input_certified or self.input_accuracy
        if not (self.input_certified or self.input_unsaid) and round(order) in MOTOR_REST:
            motor = MOTOR_REST_SHARE * self.input_accuracy
        total = 0.0
        for line in self.at_order(order, ratio):
            if line.cause is Cause.OUTPUT_ENCODER:
                total += output
            elif line.cause is Cause.MOTOR_ENCODER:
                total += motor / ratio
            else:
                total += math.sqrt(2.0) * line.standard_uncertainty
        return total

    def of_curve(self, ratio: float) -> tuple[BudgetLine, ...]:
        """What they may add to the peak-to-peak of the kinematic error [rad]."""
        rectangle = 1.0 / math.sqrt(3.0)
        output = self.output_accuracy * rectangle
        output_note = (
            self.output_unsaid
            or "its class; cannot be told from the gear without turning the gear on the encoder"
        )
        motor = self.input_accuracy / ratio * rectangle
        motor_note = self.input_unsaid or "its class over the ratio"
        shapes = [
            Distribution.NORMAL if certified else Distribution.RECTANGULAR
            for certified in (self.output_certified, self.input_certified)
        ]
        if self.output_certified:
            output = math.sqrt(2.0) * self.output_certified
            output_note = "its certificate, at two places of the curve"
        if self.input_certified:
            motor = math.sqrt(2.0) * self.input_certified / ratio
            motor_note = "its certificate, at two places of the curve, over the ratio"
        lines = (
            BudgetLine(
                "output encoder, whole curve",
                "B",
                output,
                output_note,
                Cause.OUTPUT_ENCODER,
                assumed="output encoder" if self.output_unsaid else "",
                distribution=shapes[0],
            ),
            BudgetLine(
                "motor encoder, whole curve",
                "B",
                motor,
                motor_note,
                Cause.MOTOR_ENCODER,
                assumed="motor encoder" if self.input_unsaid else "",
                distribution=shapes[1],
            ),
            BudgetLine(
                "eccentricity of the mounting",
                "B",
                math.hypot(self.output_eccentricity, self.input_eccentricity),
                "waves of any phase, at two places of the curve",
            ),
        )
        return tuple(line for line in lines if line.standard_uncertainty > 0.0)


def _certified(what: str, standard_uncertainty: float, order: float) -> list[BudgetLine]:
    """What is left of an encoder's curve at one of its orders after its certificate; none without a certificate."""
    near = min(abs(order - own) for own in CERTIFIED_ORDERS)
    if not standard_uncertainty > 0.0 or near > 1e-6:
        return []
    cause = Cause.OUTPUT_ENCODER if what.startswith("output") else Cause.MOTOR_ENCODER
    note = "its certificate, whose curve is taken out; all of its uncertainty may be at one order"
    return [BudgetLine(f"{what} at this order", "B", standard_uncertainty, note, cause)]


def _share(
    what: str, half_width: float, order: float, orders: tuple[int, ...], unsaid: str
) -> list[BudgetLine]:
    """The part of an encoder's class that one of its orders has, as a budget line; none for a class of 0.

    `unsaid`: the words of a class that is assumed.
    """
    if not half_width > 0.0 or min(abs(order - own) for own in orders) > 1e-6:
        return []
    cause = Cause.OUTPUT_ENCODER if what.startswith("output") else Cause.MOTOR_ENCODER
    note = f"its class, equal shares of its orders {', '.join(map(str, orders))}"
    if len(orders) == len(FINE_ORDERS):
        note = f"{FINE_SHARE:g} of its class, equal shares of its orders 9 to 64"
    if orders == MOTOR_REST:
        note = f"{MOTOR_REST_SHARE:g} of its class, equal shares of its orders 3 and 5 to 8"
    note += "; cannot be told from the gear"
    u = half_width / math.sqrt(3.0 * len(orders))
    line = BudgetLine(f"{what} at this order", "B", u, note, cause)
    return [replace(line, note=unsaid, assumed=what) if unsaid else line]


@dataclass(frozen=True, kw_only=True)
class OrderEstimate:
    """One order of the kinematic error: a cos + b sin = amplitude cos(v theta - phase), with 95 % intervals.

    `significant`: the amplitude is larger than the noise explains (99.99 % level). `bench`: what encoders
    and mounting may add, `bound`: what they can add at most [rad]. `unsaid`: why it can't be the gear's alone
    while nobody states an encoder; "" where it can.
    """

    order: float
    label: str
    bench: tuple[BudgetLine, ...]
    bound: float
    unsaid: str
    cosine: Estimate
    sine: Estimate
    amplitude: Estimate
    phase: Estimate
    significant: bool


@dataclass(frozen=True, kw_only=True)
class KinematicErrorFit:
    """The kinematic error of one direction, fitted, with what is needed to judge and to plot it.

    estimates: transmission_accuracy, slope, ratio, amplitude_v of the expected and the significant
    orders, phase_v of the significant ones. orders: all orders. metrics [SI]: mse_curve, mse_raw
    (equation 22) with harmonics, raw_peak_to_peak, closure, residual_rms, left_over,
    raised_by_bench, repeatability, input_revolutions, output_revolutions, samples,
    samples_per_revolution, condition. Arrays: input_angle (c,) over
    one input revolution with measured_curve and fitted_curve; output_curve over one output
    revolution at output_curve_angle [input angle, rad]; block_angle, block_residual: mean residual
    per input revolution. delay [s]: output behind input, corrected; speed: of the input [rad/s].
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
        self.encoders = Encoders() if encoders is None else encoders
        self.edge_triggered = edge_triggered
        self.highest_order = highest_order
        self.follows_data = basis is None
        self.basis = standard_basis(ratio, highest_order) if basis is None else basis
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
    spring = None if spring is None else spring.seen_in(seen)
    ahead = next((s for s in seen if s.fit.cells.direction > 0.0), None)
    back = next((s for s in seen if s.fit.cells.direction < 0.0), None)
    delay = (
        torsion.delay_between(ahead, back, spring)[0]
        if ahead is not None and back is not None
        else 0.0
    )
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
        first = followed(first, one.highest_order, rounding, slowest=_SLOWEST_SIDEBAND)
        rounding = _rounding(one, first)
    slips, cleaned = find_slips(
        first,
        output_quantum=one.encoders.output_quantum,
        input_quantum=one.encoders.input_quantum,
        wander=0.0 if rounding is None else rounding.wander(),
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
    warnings = [slip.sentence() for slip in clean.slips] + clean.notes
    highest = max(fit.basis.orders) if accuracy_order is None else accuracy_order
    wander = 0.0 if clean.rounding is None else clean.rounding.wander()
    estimates, sentences = _slope(fit, encoders, WANDERS * wander)
    warnings += sentences
    near, amplified = torsion.too_near(raw, spring), torsion.line_of(spring)
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
    orders = tuple(
        _order(fit, k, encoders, amplified, _TOO_NEAR if near[k] else "")
        for k in range(len(fit.basis.orders))
    )
    reason = ""
    if sentences:
        reason = "the kinematic error does not close: see the slope"
    elif cells.revolutions < WHOLE_TURN * ratio:
        reason = "needs one complete output revolution"
    elif any(o.significant and n for o, n in zip(orders, near, strict=True)):
        reason = f"an order is {_TOO_NEAR}"
    if reason:
        accuracy = replace(accuracy, identifiable="no", note=reason)
    estimates = {"transmission_accuracy": accuracy, **estimates}
    expected = expected_labels(ratio)
    for order, used in zip(orders, fit.used[2::2], strict=True):
        if order.significant or (used and order.label in expected):
            estimates[f"amplitude_{order.label}"] = order.amplitude
        if order.significant:
            estimates[f"phase_{order.label}"] = order.phase
    bins, measured, fitted = measured_curve(raw.fit)
    if not one.edge_triggered:
        per_turn = one.samples / max(cells.revolutions, 1e-9)
        warnings += _sampling_warnings(per_turn, ratio, encoders, max(fit.basis.orders))
    return KinematicErrorFit(
        ratio=ratio,
        direction=cells.direction,
        accuracy_order=highest,
        estimates=estimates,
        orders=orders,
        metrics=_metrics(raw.fit, measured, fitted, one.samples)
        | {"left_over": rest, "raised_by_bench": 0.5 * raised},
        warnings=tuple(warnings),
        slips=clean.slips,
        input_angle=bins,
        measured_curve=measured,
        fitted_curve=fitted,
        output_curve_angle=angle,
        output_curve=curve,
        block_angle=cells.first_angle
        + cells.direction * (np.arange(cells.rows, dtype=np.float64) + 0.5) * REVOLUTION,
        block_residual=fit.row_residual,
        regression=fit,
        torsion=amplified,
        speed=raw.speed,
        delay=delay,
    )


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
        "mse_raw": 100.0 * fit.residual_variance / raw_variance if raw_variance > 0.0 else math.nan,
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
        "ratio": Estimate(
            name="ratio",
            value=seen,
            unit="1",
            low=seen - spread,
            high=seen + spread,
            budget=(of_ratio,),
        ),
    }
    quantum = encoders.output_quantum if math.isfinite(encoders.output_quantum) else 2.0 * ARCSEC
    matters = abs(closure) > max(0.1 * quantum, 0.5 * ARCSEC, wander)
    turns = fit.cells.revolutions / ratio
    if abs(closure) > _SLOPE_SIGNIFICANCE * error and matters and turns >= WHOLE_TURN:
        return estimates, [
            slope_sentence(ratio, closure, encoders.output_quantum, encoders.input_quantum)
        ]
    return estimates, []


def _order(
    fit: AngleFit, index: int, encoders: Encoders, line: BudgetLine, refusal: str
) -> OrderEstimate:
    at = 2 + 2 * index
    order, label = fit.basis.orders[index], fit.basis.labels[index]
    block = fit.covariance[at : at + 2, at : at + 2]
    found = polar.polar(
        label, fit.values[at : at + 2], block, fit.freedom, "rad", doubts(fit.doubt, at, line)
    )
    bench, bound = encoders.at_order(order, fit.basis.ratio), encoders.bound(order, fit.basis.ratio)
    unsaid = encoders.unsaid_at(order)
    amplitude, phase = with_bench(found, bench, bound, unsaid)
    if not fit.used[at] or refusal:
        reason = refusal or "left out of this fit"
        amplitude = replace(amplitude, identifiable="no", note=reason)
        phase = replace(phase, identifiable="no", note=reason)
    halves = [fit.quantile() * math.sqrt(max(block[k, k], 0.0)) for k in (0, 1)]
    cosine, sine = (
        Estimate(
            name=f"{part}_{label}",
            value=float(value),
            unit="rad",
            low=float(value) - half,
            high=float(value) + half,
            identifiable=amplitude.identifiable,
            note=amplitude.note,
        )
        for part, value, half in zip(
            ("cosine", "sine"), fit.values[at : at + 2], halves, strict=True
        )
    )
    return OrderEstimate(
        order=order,
        label=label,
        bench=bench,
        bound=bound,
        unsaid=unsaid,
        cosine=cosine,
        sine=sine,
        amplitude=amplitude,
        phase=phase,
        significant=found.significant and bool(fit.used[at]),
    )


def doubts(doubt: Array | None, at: int, line: BudgetLine) -> tuple[tuple[BudgetLine, Array], ...]:
    """The torsional correction as a shared error of one order's vector."""
    if doubt is None or not doubt[at : at + 2].any():
        return ()
    return ((line, doubt[at : at + 2]),)


def with_bench(
    found: polar.Polar, lines: tuple[BudgetLine, ...], bound: float, unsaid: str = ""
) -> tuple[Estimate, Estimate]:
    """Amplitude and phase with what the bench may add; "weakly" where that alone may make all of it, or where nobody
    says what it adds (`unsaid`).
    """
    amplitude = found.amplitude.with_budget(lines)
    phase = found.phase.with_budget(polar.over_amplitude(lines, amplitude.value))
    loud = bool(lines) and amplitude.value <= max(amplitude.expanded_uncertainty, bound)
    if amplitude.identifiable == "yes" and (loud or unsaid):
        note = unsaid or "not distinguishable from what encoders and mounting may add"
        return (
            replace(amplitude, identifiable="weakly", note=note),
            replace(phase, identifiable="weakly", note=note),
        )
    return amplitude, phase


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
