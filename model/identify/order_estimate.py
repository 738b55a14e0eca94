"""One order of a kinematic error as estimates, with what encoders and mounting may add to it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from model.identify import polar
from model.identify.angle_fit import AngleFit
from model.identify.checks import Array
from model.identify.encoders import Encoders
from model.identify.estimate import BudgetLine, Estimate


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

    @classmethod
    def of(
        cls, fit: AngleFit, index: int, encoders: Encoders, line: BudgetLine, refusal: str
    ) -> OrderEstimate:
        """The order at this place of a fit; `line` is of the torsional correction, `refusal` why it is not told."""
        at = 2 + 2 * index
        order, label = fit.basis.orders[index], fit.basis.labels[index]
        block = fit.covariance[at : at + 2, at : at + 2]
        found = polar.polar(
            label, fit.values[at : at + 2], block, fit.freedom, "rad", doubts(fit.doubt, at, line)
        )
        bench, bound = (
            encoders.at_order(order, fit.basis.ratio),
            encoders.bound(order, fit.basis.ratio),
        )
        unsaid = encoders.unsaid_at(order)
        amplitude, phase = with_bench(found, bench, bound, unsaid)
        if not fit.used[at] or refusal:
            reason = refusal or "left out of this fit"
            amplitude = replace(amplitude, identifiable="no", note=reason)
            phase = replace(phase, identifiable="no", note=reason)
        halves = [fit.quantile() * math.sqrt(max(block[k, k], 0.0)) for k in (0, 1)]
        cosine, sine = (
            Estimate.about(
                f"{part}_{label}",
                float(value),
                half,
                "rad",
                identifiable=amplitude.identifiable,
                note=amplitude.note,
            )
            for part, value, half in zip(
                ("cosine", "sine"), fit.values[at : at + 2], halves, strict=True
            )
        )
        return cls(
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
