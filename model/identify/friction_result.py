"""The friction of a gear as it was fitted: parameters, and what is computed from them with its budget."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from model.friction import TorqueBalance
from model.identify.checks import Array
from model.identify.common_errors import CommonError, Stated
from model.identify.estimate import BudgetLine, Cause, Estimate
from model.identify.least_squares import student_quantile
from model.identify.running_torque import FrictionPoints, RunningTorque
from model.identify.stribeck import NAMES, StribeckFit

Subject = Literal["gear", "motor + gear"]
SCATTER = "scatter between revolutions and points"


@dataclass(frozen=True, kw_only=True)
class FrictionFit:
    """Friction of a gear (or of motor and gear together), fitted, with what is needed to judge and to plot it.

    estimates: coulomb, static, stribeck_velocity, shape, viscous, and offset, asymmetry of the
    torque (half sums). metrics: chi_square, freedom, birge, residual_rms [N m], relative_rms,
    bracket_drift, points, slowest_speed. speed, torque, standard_error, fitted (n,): friction at
    the input [N m], tare subtracted, and what the points say of their common errors too; tare (n,);
    curve_speed, curve_torque for plots. force, force_error (n,) [N] and columns (n, m) are what the
    curve was fitted to. `common`: the errors that the points share, `shared` (m,)
    what they say of the fitted ones, in standard uncertainties.
    """

    subject: Subject
    torque_balance: TorqueBalance
    estimates: dict[str, Estimate]
    metrics: dict[str, float]
    warnings: tuple[str, ...]
    speed: Array
    torque: Array
    standard_error: Array
    tare: Array
    fitted: Array
    offset: Array
    offset_error: Array
    curve_speed: Array
    curve_torque: Array
    stribeck: StribeckFit
    holds: tuple[RunningTorque, ...]
    points: FrictionPoints
    force: Array
    force_error: Array
    columns: Array | None
    common: tuple[CommonError, ...]
    lever: float

    @property
    def shared(self) -> dict[str, float]:
        """What the data say of each fitted common error (its first part), in its standard uncertainty."""
        first = np.cumsum([0, *(c.columns.shape[1] for c in self._fitted)])
        return {
            c.source: float(self.stribeck.common[k])
            for c, k in zip(self._fitted, first, strict=False)
        }

    @property
    def _fitted(self) -> tuple[CommonError, ...]:
        return tuple(c for c in self.common if c.is_fitted)

    def parts_of(self, source: str) -> Array:
        """What the data say of all parts of one fitted common error, in its standard uncertainty; empty without it."""
        first = 0
        for one in self._fitted:
            width = one.columns.shape[1]
            if one.source == source:
                return self.stribeck.common[first : first + width]
            first += width
        return np.empty(0)

    def shown_of(self, sources: Collection[str]) -> Array:
        """What these fitted common errors did to each hold, as far as the data tell [N m]."""
        total = np.zeros(len(self.holds))
        for one in self._fitted:
            if one.source in sources:
                total += one.columns @ self.parts_of(one.source)
        return total

    def told(self, source: str) -> float:
        """The share (0 to 1) of a common error that the fit gives back where it is there: 1 - 1/(1 + what it knew
        before over what the points alone say, as variances).
        """
        first = 0
        for one in self._fitted:
            if one.source == source:
                column = self.points.mean_of(one.columns)[:, 0] / self.lever
                return float(self.stribeck.common_gain[first] @ column)
            first += one.columns.shape[1]
        return 0.0

    def derived(
        self,
        name: str,
        unit: str,
        measurand: Callable[[Array, Mapping[str, float]], float],
        stated: Mapping[str, Stated] | None = None,
    ) -> Estimate:
        """An estimate of something computed from the five parameters and the common errors (as in `shared`).

        An error that is `stated` is taken as stated, not as the fit has it: its doubt is its own line, no part of the
        scatter of points.
        """
        stated = stated or {}
        values = self.stribeck.values
        shared = {**self.shared, **{source: one.value for source, one in stated.items()}}
        value = measurand(values, shared)
        slope = np.empty(5)
        for k in range(5):
            step = np.zeros(5)
            step[k] = max(1e-4 * abs(float(values[k])), 1e-9)
            slope[k] = measurand(values + step, shared) - measurand(values - step, shared)
            slope[k] /= 2.0 * step[k]
        by_common = np.zeros(len(self.stribeck.common))
        first = 0
        for one in self._fitted:
            up, down = ({**shared, one.source: shared[one.source] + z} for z in (1.0, -1.0))
            by_common[first] = 0.5 * (measurand(values, up) - measurand(values, down))
            first += one.columns.shape[1]
        lines = self.budget_lines(slope, by_common, stated)
        inside = sum(b.standard_uncertainty**2 for b, c in lines if c is None or c.is_fitted)
        half = student_quantile(self.stribeck.freedom) * math.sqrt(inside)
        return Estimate.about(name, value, half, unit, tuple(b for b, _ in lines))

    def budget_lines(
        self, slope: Array, by_common: Array, stated: Mapping[str, Stated]
    ) -> list[tuple[BudgetLine, CommonError | None]]:
        """The budget of slope . parameters + by_common . common errors, by propagation of each error."""
        fit, error = self.stribeck, self.force_error
        learnt = [
            one.source not in stated for one in self._fitted for _ in range(one.columns.shape[1])
        ]
        row = slope @ fit.gain + (by_common * learnt) @ fit.common_gain
        scatter = math.sqrt(fit.scale) * float(np.linalg.norm(row * error))
        lines: list[tuple[BudgetLine, CommonError | None]] = [
            (BudgetLine(SCATTER, "A", scatter, degrees_of_freedom=float(fit.freedom)), None)
        ]
        first = 0
        for one in self.common:
            change = row @ self.points.mean_of(one.columns) / self.lever
            if one.is_fitted:
                change = change - by_common[first : first + len(change)]
                first += len(change)
            given = stated.get(one.source, Stated(source=one.note))
            line = BudgetLine(
                one.source,
                one.kind,
                given.uncertainty * float(np.linalg.norm(change)),
                given.source,
                one.cause,
                one.degrees_of_freedom,
                assumed=one.assumed,
                distribution=one.distribution,
            )
            lines.append((line, one))
        return [(b, c) for b, c in lines if c is None or b.standard_uncertainty > 0.0]

    def shared_by_cause(self) -> dict[Cause, Array]:
        """Change (5,) of the parameters for one standard uncertainty of each error that has a cause."""
        return {
            c.cause: self.stribeck.gain @ self.points.mean_of(c.effect) / self.lever
            for c in self.common
            if c.cause is not None
        }

    @property
    def parameters(self) -> dict[str, float]:
        """`mesh_friction.*` values for `HarmonicDrive.with_values`."""
        return {f"mesh_friction.{name}": self.estimates[name].value for name in NAMES}
