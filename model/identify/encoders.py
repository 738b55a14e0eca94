"""What the two encoders can add to a kinematic error, at one order and on its whole curve, by class or certificate."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from model.angle_certificate import CERTIFIED_ORDERS
from model.identify.estimate import BudgetLine, Cause, Distribution

SLOWEST_SIDEBAND = 0.5
"""Order from which one belongs to an input order; below, to the output."""
OUTPUT_ENCODER_ORDERS, MOTOR_ENCODER_ORDERS = (1, 2, 3, 4, 5, 6, 7, 8), (1, 2, 4)
"""Orders of an encoder's own revolution over which the variance of its curve is spread in equal shares: a scale's
eccentricity and waviness; a motor encoder's eccentricity, ovality and four-fold error."""
_ECCENTRIC = (1,)
"""The order that an eccentric scale makes: its amplitude may be anything from nothing to the class."""
MOTOR_REST, MOTOR_REST_SHARE = (3, 5, 6, 7, 8), 0.2
"""Other orders of a motor encoder, and the share of its class that they have together: a class bounds the whole curve,
and no encoder has three orders only."""
_CAUSES = {"output encoder": Cause.OUTPUT_ENCODER, "motor encoder": Cause.MOTOR_ENCODER}
_UNSAID_ORDERS = OUTPUT_ENCODER_ORDERS
"""Orders of a motor encoder of which nobody says anything: a resolver has those of its poles."""
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
    encoder orders 1, 2 and 4, but for the output encoder's order 1, which may have all of the class;
    the output encoder's orders 9 to 64 share a fifth of its class. Where its certificate's curve
    was taken out, the certificate's standard uncertainty (0: it was not) stands in place of the
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
        if not self.output_unsaid or order > SLOWEST_SIDEBAND:
            return ""
        return "an order of the output's turn, and nobody stated the output encoder"

    def unsaid_raise(self, raised: float) -> BudgetLine:
        """What encoders of an assumed class may make of a peak-to-peak, of which nothing is taken off [rad]."""
        kind, note = "motor encoder", self.input_unsaid
        if self.output_unsaid:
            kind, note = "output encoder", self.output_unsaid
        u = max(raised, 0.0) / math.sqrt(3.0)
        return BudgetLine("peak-to-peak raised by encoders", "B", u, note, assumed=kind)

    def at_order(
        self, order: float, ratio: float, *, together: bool = False
    ) -> tuple[BudgetLine, ...]:
        """What they may add to one order of the kinematic error, per component of the vector [rad at the output].

        `together`: of all orders at once, which have no more than the whole curve has; else any one order may have all
        of a certificate's uncertainty, and the first, which an eccentric scale makes, all of the output's class.
        """
        part = 1.0 / math.sqrt(len(CERTIFIED_ORDERS)) if together else 1.0
        lines = [
            *_certified("output encoder", part * self.output_certified, order * ratio),
            *_certified("motor encoder", part * self.input_certified / ratio, order),
        ]
        own = order * ratio
        slow = OUTPUT_ENCODER_ORDERS if together or abs(own - 1.0) > 1e-6 else _ECCENTRIC
        if not self.output_certified:
            unsaid = self.output_unsaid
            lines += _share("output encoder", self.output_accuracy, own, slow, unsaid)
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
        lines += _share("output encoder", finely, own, tuple(FINE_ORDERS), self.output_unsaid)
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
                *(one.standard_uncertainty for one in self.at_order(order, ratio, together=True))
            )
            for order in orders
        }

    def output_wave(self, order: float, ratio: float) -> float:
        """Standard uncertainty of a cosine or sine of one order by the output encoder, where all orders are taken
        together [rad].
        """
        lines = self.at_order(order, ratio, together=True)
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
    note = "its certificate, whose curve is taken out; all of its uncertainty may be at one order"
    return [BudgetLine(f"{what} at this order", "B", standard_uncertainty, note, _CAUSES[what])]


def _share(
    what: str, half_width: float, order: float, orders: tuple[int, ...], unsaid: str
) -> list[BudgetLine]:
    """The part of an encoder's class that one of its orders has, as a budget line; none for a class of 0.

    `unsaid`: the words of a class that is assumed.
    """
    if not half_width > 0.0 or min(abs(order - own) for own in orders) > 1e-6:
        return []
    note = f"its class, equal shares of its orders {', '.join(map(str, orders))}"
    if len(orders) == len(FINE_ORDERS):
        note = f"{FINE_SHARE:g} of its class, equal shares of its orders 9 to 64"
    if orders == MOTOR_REST:
        note = f"{MOTOR_REST_SHARE:g} of its class, equal shares of its orders 3 and 5 to 8"
    if orders == _ECCENTRIC:
        note = "its class: an eccentric scale may have all of it here, from none to the whole"
    note += "; cannot be told from the gear"
    u = half_width / math.sqrt(3.0 * max(len(orders), 2))
    line = BudgetLine(f"{what} at this order", "B", u, note, _CAUSES[what])
    return [replace(line, note=unsaid, assumed=what) if unsaid else line]
