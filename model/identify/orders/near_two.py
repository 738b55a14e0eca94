"""A line near order 2 without one at 2: three things that look alike, and what tells them apart.

The mesh of a harmonic drive turns at 2 (1 + 1/N) per revolution of the wave generator; a ratio N that
is one too small or too large (N and N + 1, by the mounting) moves order 2 there; and so may sampling
move a high order. A speed that changed tells an alias, a second angle the ratio, and so does the line
at 4: the ratio moves it too.
"""

from __future__ import annotations

import math

from model.identify.orders.fit import Order, OrdersFit

NEAR = 0.5
"""Orders about 2 in which a line needs explaining."""
CERTAIN = 3.0
"""Standard uncertainties within which two orders may be one."""
WHOLE = 1e-9


def near_two(fit: OrdersFit, ratio: float, measured_ratio: float = math.nan) -> str | None:
    """What a line near order 2 may be, with what is ruled out and why; None where there is no such line.

    `ratio` is the stated one, `measured_ratio` that of two angles of this recording; NaN where there is none.
    """
    near = [o for o in fit.orders if abs(o.order - 2.0) < NEAR and abs(o.order - 2.0) > WHOLE]
    if not near:
        return None
    line, whole = near[0], fit.order(2.0)
    if whole is not None:
        return _larger_beside(line, whole, fit, ratio)
    words = "; ".join(
        [_mesh(line, fit, ratio), _ratio(line, fit, ratio, measured_ratio), _alias(line, fit)]
    )
    return f"Order {line.name} stands near 2 and none at 2. It may be one of three: {words}."


def _larger_beside(line: Order, whole: Order, fit: OrdersFit, ratio: float) -> str | None:
    """What a larger line beside one at 2 may be, where its own multiple is there and none of 2; else None.

    With a ratio of one tooth too many the mesh, 2 (1 + 1/N), comes to stand at 2, and order 2 beside it.
    """
    if line.mean.amplitude <= whole.mean.amplitude or fit.order(4.0) is not None:
        return None
    near = 0.1 * _resolution(fit)
    multiple = next(
        (
            other
            for share in (2.0, 0.5)
            for other in fit.orders
            if abs(other.order - share * line.order)
            <= near + CERTAIN * math.hypot(other.line.uncertainty, share * line.line.uncertainty)
        ),
        None,
    )
    if multiple is None:
        return None
    return (
        f"Order {line.name} is larger than that at 2, and {multiple.name} goes with it: "
        f"{_of_a_wrong_ratio(line, ratio)}. What stands at 2 may be the mesh then."
    )


def _of_a_wrong_ratio(line: Order, ratio: float) -> str:
    text = f"order 2 of a gear whose ratio is {0.5 * line.order:.5g} times the one that made this angle"
    if math.isfinite(ratio):
        text += f" ({0.5 * line.order * ratio:.5g} for {ratio:g}; N and N ± 1 by the mounting)"
    return text


def _mesh(line: Order, fit: OrdersFit, ratio: float) -> str:
    if not math.isfinite(ratio):
        return "the mesh, 2 (1 + 1/N), if N is " + _of_mesh(line.order)
    mesh = 2.0 * (1.0 + 1.0 / ratio)
    text = f"the mesh, 2 (1 + 1/N) = {mesh:.6g}"
    off = CERTAIN * line.line.uncertainty + 0.1 * _resolution(fit)
    return text + (" (ruled out: it stands elsewhere)" if abs(line.order - mesh) > off else "")


def _of_mesh(order: float) -> str:
    return f"{2.0 / (order - 2.0):.4g}" if order > 2.0 else "below zero (ruled out)"


def _ratio(line: Order, fit: OrdersFit, ratio: float, measured: float) -> str:
    text = _of_a_wrong_ratio(line, ratio)
    if (
        math.isfinite(measured)
        and math.isfinite(ratio)
        and abs(measured / ratio - 1.0) < 0.2 / ratio
    ):
        return text + f" (ruled out: both angles of the recording turn as 1 to {measured:.6g})"
    if fit.order(4.0) is not None:
        return text + " (ruled out: there is a line at 4, which a wrong ratio would move too)"
    return text


def _alias(line: Order, fit: OrdersFit) -> str:
    other = fit.samples.window.alias_of(line.order)
    if other is None:
        return "an alias of a whole order (ruled out: none looks like it at these samples)"
    return f"an alias of order {other}"


def _resolution(fit: OrdersFit) -> float:
    return min(1.0 / max(fit.samples.revolutions(d), 1e-6) for d in fit.samples.directions)
