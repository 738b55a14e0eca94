"""A table of friction over speed as a recording: the law that its points ask for, and the others beside it.

coulomb            F = F_c sgn v + F_0
coulomb-viscous    F = (F_c + c_v |v|) sgn v + F_0
stribeck           F = {F_c + (F_s - F_c) exp[-(|v|/v_s)^sigma] + c_v |v|} sgn v + F_0

One row is one point; there is no time in it. How wrong points and presliding are told from friction
stands in `model.identify.friction_curve`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from experiments.budget import budget_table, scale_line
from experiments.contract import Evidence
from experiments.errors import AnalysisError, analysing
from experiments.evidence import check_settings, usable
from experiments.need import EFFORTS, SPEEDS
from experiments.recording import Recording
from experiments.recordings.channels import chosen_channel
from experiments.recordings.friction_curve.declaration import NAME, QUANTITIES, SETTINGS
from experiments.recordings.motion_channels import number
from experiments.result import Covariance, Plot, Result, Series, Table, both_ways, residual_panel
from experiments.setting import names_of
from experiments.shape import Shape, Standing
from model.arrays import BoolArray, FloatArray
from model.errors import WordedError
from model.identify.estimate import BudgetLine, Estimate, Identifiable, open_ends
from model.identify.friction_curve import CurveFit, LawFit, fit_curve
from model.identify.friction_points import LAWS, CurvePoints, Law, curve_points
from model.identify.least_squares import student_quantile

_SPEED_UNITS = ("rad/s", "m/s")


CHANCE = 0.05
"""Of points on a straight line to look as bent, above which they do not bend."""

_LARGEST_WRONG = 0.25
"""Share of the points left out above which nothing is called identified."""

_LARGEST_SCATTER = 3.0
"""Times the stated uncertainties by which points may scatter about the curve."""

CURVE_POINTS = 300


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """The friction law of a table of speed and effort.

    Settings: law (auto, coulomb, coulomb-viscous, stribeck); speed, effort and uncertainty (channel
    names); direction (both, forward, reverse, each); least_speed below which no point is taken.
    """
    settings = evidence.settings
    check_settings(settings, names_of(SETTINGS), NAME)
    table = _Table.of(recording, settings)
    fits: dict[str, CurveFit] = {}
    for suffix, rows in _parts(table, str(settings.get("direction", "both"))).items():
        with analysing(recording.metadata.run_id):
            fits[suffix] = _fit(table, rows, settings)
    estimates: dict[str, Estimate] = {}
    for suffix, fit in fits.items():
        estimates |= {
            name + suffix: replace(e, name=name + suffix)
            for name, e in _standing(fit).weakly(_estimates(recording, table, fit)).items()
        }
    first = next(iter(fits.values()))
    names = tuple(n for n in first.chosen.names if n in estimates)
    return Result(
        run=recording.metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates=estimates,
        metrics=_metrics(table, fits),
        warnings=(
            *(
                text
                for fit in fits.values()
                for text in (*_remarks(table, fit), *_standing(fit).warnings)
            ),
            *_two_ways(table, settings),
        ),
        plots=(_plot(table, fits),),
        tables=(_laws(fits), budget_table(estimates.values())),
        options={
            "law": {suffix.strip("_") or "both": fit.chosen.law for suffix, fit in fits.items()},
            "effort": table.effort_name,
            "uncertainty": "stated" if table.error is not None else "from the scatter",
        },
        covariance=_covariance(first.chosen, names),
    )


def _two_ways(table: _Table, settings: Mapping[str, Any]) -> tuple[str, ...]:
    """A sentence where both directions were fitted by one law and each has a Coulomb friction of its own."""
    if settings.get("direction", "both") != "both":
        return ()
    found: list[tuple[float, float]] = []
    for rows in _parts(table, "each").values():
        try:
            law = _fit(table, rows, settings).chosen
        except WordedError:
            # Too few points of one way: nothing can be said.
            return ()
        place = law.names.index("coulomb")
        low, high = law.ends[place].tolist()
        found.append((float(law.values[place]), 0.5 * (high - low)))
    (forward, of_forward), (reverse, of_reverse) = found
    apart = abs(abs(forward) - abs(reverse))
    if not apart > math.hypot(of_forward, of_reverse):
        return ()
    unit = table.effort_unit
    return (
        f"The directions differ: Coulomb friction {abs(forward):.3g} {unit} forward and {abs(reverse):.3g} {unit} "
        "reverse, by more than their U: --set direction=each.",
    )


def _standing(fit: CurveFit) -> Standing:
    """The law that was taken on the points that were used."""
    names = fit.chosen.names
    curve = Shape(title=f"the law {fit.chosen.law}", numbers=len(names), names=names)
    return Standing(curve, int(fit.used.sum()), fit.points[fit.used].speeds)


def _covariance(law: LawFit, names: tuple[str, ...]) -> Covariance | None:
    """Of the parameters of the law that was taken, and which of them stopped at a bound."""
    return Covariance(names, law.covariance, at_bound=law.at_bound) if len(names) > 1 else None


class _Table:
    """The columns of the table, with their names and units."""

    def __init__(
        self,
        speed: FloatArray,
        effort: FloatArray,
        error: FloatArray | None,
        names: tuple[str, str],
        units: tuple[str, str],
    ) -> None:
        self.speed, self.effort, self.error = speed, effort, error
        self.speed_name, self.effort_name = names
        self.speed_unit, self.effort_unit = units

    @classmethod
    def of(cls, recording: Recording, settings: Mapping[str, Any]) -> _Table:
        speed = chosen_channel(recording, settings, "speed", SPEEDS, "a friction curve")
        usual = (*EFFORTS, "output_torque")
        effort = chosen_channel(recording, settings, "effort", usual, "a friction curve")
        unit = recording.signals[speed].unit
        if unit not in _SPEED_UNITS:
            raise AnalysisError(
                "is not a speed",
                where=f"{NAME}.speed: {speed}",
                value=f"unit {unit or 'none'}",
                limit=" or ".join(_SPEED_UNITS),
                remedy="Correct the map of the import.",
            )
        wanted = settings.get("uncertainty", f"{effort}_uncertainty")
        if "uncertainty" in settings:
            recording.require("the uncertainty of the points", str(wanted))
        good = usable(recording)
        error = recording.si(str(wanted))[good] if recording.has(str(wanted)) else None
        return cls(
            recording.si(speed)[good],
            recording.si(effort)[good],
            error,
            (speed, effort),
            (unit, recording.signals[effort].unit),
        )


def _parts(table: _Table, direction: str) -> dict[str, BoolArray]:
    """Rows by the ending of the names of their parameters."""
    forward, reverse = table.speed > 0.0, table.speed < 0.0
    if direction == "each":
        return {"_forward": forward, "_reverse": reverse}
    rows = {"both": np.ones(len(table.speed), dtype=bool), "forward": forward, "reverse": reverse}
    return {"": rows[direction]}


def _fit(table: _Table, rows: BoolArray, settings: Mapping[str, Any]) -> CurveFit:
    word = settings.get("law", LAWS[0])
    law: Law = next(law for law in LAWS if law == word)
    least = number(settings, "least_speed", NAME, 0.0)
    error = None if table.error is None else table.error[rows]
    points, at_rest = curve_points(table.speed[rows], table.effort[rows], error, least)
    return fit_curve(points, has_errors=error is not None, law=law, at_rest=at_rest)


def _estimates(recording: Recording, table: _Table, fit: CurveFit) -> dict[str, Estimate]:
    """The parameters of the chosen law with intervals and budget."""
    law = fit.chosen
    units = {
        "viscous": f"{table.effort_unit} s/{table.speed_unit.removesuffix('/s')}",
        "stribeck_velocity": table.speed_unit,
        "shape": "1",
    }
    k = student_quantile(law.freedom)
    estimates: dict[str, Estimate] = {}
    for place, name in enumerate(law.names):
        value, (low, high) = float(law.values[place]), law.ends[place].tolist()
        closed = math.isfinite(low) and math.isfinite(high)
        u = (high - low) / (2.0 * k) if closed else math.inf
        verdict, note = _verdict(fit, name, closed)
        low, high = open_ends(low, high)
        lines = [BudgetLine("scatter of the points", "A", u, degrees_of_freedom=law.freedom)]
        beside = _next_law(fit, name)
        if beside > 0.0:
            lines.append(
                BudgetLine(
                    "choice of the law", "B", beside, "difference to the law nearest in evidence"
                )
            )
        if name not in ("stribeck_velocity", "shape"):
            lines.append(scale_line(recording, value, table.effort_name))
        estimates[name] = Estimate(
            name=name,
            value=value,
            unit=units.get(name, table.effort_unit),
            low=low,
            high=high,
            identifiable=verdict,
            note=note,
            budget=tuple(lines),
        )
    return estimates


def _verdict(fit: CurveFit, name: str, closed: bool) -> tuple[Identifiable, str]:
    """Whether the points decide a parameter, and why not."""
    law = fit.chosen
    left_out = 1.0 - fit.used.sum() / len(fit.points)
    if not closed:
        return "no", "the profile of the likelihood does not close: the points do not bound it"
    if law.value("coulomb") <= 0.0 or (name != "offset" and law.value(name) < 0.0):
        return "no", "negative or no Coulomb friction, which is not physical"
    if name in ("stribeck_velocity", "shape", "static") and law.chance > CHANCE:
        return "no", "the points do not bend at low speed"
    if name in law.at_bound:
        return "weakly", "stopped at its bound"
    if left_out > _LARGEST_WRONG:
        return "weakly", f"{100.0 * left_out:.0f} % of the points had to be left out"
    return "yes", ""


def _next_law(fit: CurveFit, name: str) -> float:
    """What a law that the points support nearly as well makes of a parameter: u of the choice."""
    near = [
        law
        for law in fit.laws
        if law is not fit.chosen and name in law.names and law.bic - fit.chosen.bic < 10.0
    ]
    # Evidence e^(-BIC/2) weighs the difference: a law that the points refute adds nothing.
    return max(
        (
            abs(law.value(name) - fit.chosen.value(name))
            * math.exp(-0.25 * max(law.bic - fit.chosen.bic, 0.0))
            for law in near
        ),
        default=0.0,
    )


def _metrics(table: _Table, fits: Mapping[str, CurveFit]) -> dict[str, float]:
    every = list(fits.values())
    used = sum(int(fit.used.sum()) for fit in every)
    error = 1.0 if table.error is None else float(np.median(table.error))
    return {
        "points": float(used),
        "wrong_points": float(sum(fit.wrong for fit in every)),
        "least_speed": max(fit.presliding_below for fit in every),
        "hold_out_error": error * max(fit.chosen.hold_out for fit in every),
        "scatter": error * max(fit.scatter for fit in every),
    }


def _remarks(table: _Table, fit: CurveFit) -> list[str]:
    """What a reader must know of the points and the law."""
    law = fit.chosen
    remarks: list[str] = []
    if fit.at_rest:
        remarks.append(
            f"{fit.at_rest} points at rest or below least_speed are no sliding friction."
        )
    if fit.presliding_below > 0.0:
        remarks.append(
            f"Points below {fit.presliding_below:.3g} {table.speed_unit} lie on no curve over speed (presliding, or "
            "stick and slip) and were left out."
        )
    if fit.wrong:
        remarks.append(
            f"{fit.wrong} points lie far from the curve of the others and were left out."
        )
    if table.error is not None and fit.scatter > _LARGEST_SCATTER:
        remarks.append(
            f"The points scatter {fit.scatter:.2g} times as much as their uncertainties say: these, or the law, are "
            "wrong; the intervals are as wide as the scatter."
        )
    if law.law == "stribeck" and law.value("static") < law.value("coulomb"):
        remarks.append("No Stribeck dip: friction rises from rest (static below Coulomb friction).")
    if not fit.points.both_ways:
        remarks.append("One direction only: an offset of the effort is part of Coulomb friction.")
    return remarks


def _laws(fits: Mapping[str, CurveFit]) -> Table:
    """Every law beside the one that was taken."""
    every = [(suffix, fit, law) for suffix, fit in fits.items() for law in fit.laws]
    names = list(dict.fromkeys(name for _, _, law in every for name in law.names))
    rows = tuple(
        (
            suffix.strip("_") or "all",
            law.law,
            "taken" if law is fit.chosen else "",
            law.bic,
            law.hold_out,
            *(law.value(name) if name in law.names else "" for name in names),
        )
        for suffix, fit, law in every
    )
    columns = ("points", "law", "", "BIC", "error of points not seen", *names)
    return Table("laws", "Laws of friction on these points", columns, rows)


def _plot(table: _Table, fits: Mapping[str, CurveFit]) -> Plot:
    """Points, curve and what is left of them."""
    series: list[Series] = []
    for group, fit in enumerate(fits.values()):
        points, law = fit.points, fit.chosen
        signed = points.way * points.speed
        series += _points_of(points, fit.used, law, table.error is not None)
        for way in sorted({float(w) for w in points.way}):
            fastest = float(points.speed[points.way == way].max())
            slowest = float(points.speed[points.way == way].min())
            speed = np.geomspace(slowest, fastest, CURVE_POINTS)
            series.append(
                Series(label=law.law, x=way * speed, y=way * law.curve(speed, way), group=2 + group)
            )
        out = ~fit.used
        if out.any():
            y = (points.way * points.friction)[out]
            series.append(Series(label="left out", x=signed[out], y=y, style="points", role="null"))
    return Plot(
        name="friction-curve",
        title="Friction over speed",
        x_label=f"{table.speed_name} [{table.speed_unit}]",
        y_label=f"{table.effort_name} [{table.effort_unit}]",
        series=tuple(series),
        note="The points of the table with their errors, and the fitted law. Good where the points below lie on zero "
        "within their bars.",
        panels=(residual_panel(table.effort_unit),),
    )


def _points_of(points: CurvePoints, used: BoolArray, law: LawFit, has_errors: bool) -> list[Series]:
    """The points used, with their errors, and their residuals below."""
    kept = points[used]
    x, y = kept.way * kept.speed, kept.way * kept.friction
    bars = {"low": y - 2.0 * kept.error, "high": y + 2.0 * kept.error} if has_errors else {}
    left = kept.way * (kept.friction - law.curve(kept.speed, kept.way))
    return [
        *both_ways(kept.way, x, y, **bars),
        *(replace(s, panel=1) for s in both_ways(kept.way, x, left)),
    ]
