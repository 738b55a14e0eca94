"""Lines of uncertainty budgets that protocols share: torque scale, temperature; and budgets as a table."""

from __future__ import annotations

from collections.abc import Iterable

from experiments.recording import Recording
from experiments.result import Table
from model.identify.estimate import BudgetLine, Cause, Estimate

ASSUMED_SCALE = 0.03
"""Relative standard uncertainty of a torque port without a certificate: torque constant by
tolerance and temperature (5 % of
rectangular bounds, k = 1)."""


def torque_scale_uncertainty(recording: Recording, channel: str = "torque") -> tuple[float, str]:
    """Relative standard uncertainty of the torque scale, and where it comes from."""
    relative = recording.signals[channel].calibration.scale_relative_uncertainty
    if relative > 0.0:
        return relative, "calibration of the channel"
    return ASSUMED_SCALE, "no calibration: torque constant within 5 %, rectangular"


def scale_line(recording: Recording, torque: float, channel: str = "torque") -> BudgetLine:
    """The torque scale as a line of the budget of a torque [N m], or of anything proportional to one."""
    relative, source = torque_scale_uncertainty(recording, channel)
    return BudgetLine("torque scale", "B", relative * abs(torque), source, Cause.TORQUE_SCALE)


def budget_table(estimates: Iterable[Estimate]) -> Table:
    """Every estimate's budget, one line each, with the combined and the expanded uncertainty at its end."""
    rows: list[tuple[float | int | str, ...]] = []
    for estimate in estimates:
        if not estimate.budget:
            continue
        for line in estimate.budget:
            rows.append(
                (
                    estimate.name,
                    line.source,
                    line.kind,
                    line.standard_uncertainty,
                    estimate.unit,
                    line.note,
                )
            )
        rows.append(
            (estimate.name, "combined", "", estimate.standard_uncertainty, estimate.unit, "")
        )
        rows.append(
            (
                estimate.name,
                f"expanded, k = {estimate.coverage_factor:.2f}",
                "",
                estimate.expanded_uncertainty,
                estimate.unit,
                "",
            )
        )
    columns = ("quantity", "contribution", "type", "standard uncertainty", "unit", "remark")
    return Table("budget", "Uncertainty budget", columns, tuple(rows))
