"""Lines of uncertainty budgets that protocols share: torque scale, temperature; and budgets as a table."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np

from experiments.assumed import (
    CURRENT,
    THERMOMETER,
    TIME_BASE,
    TORQUE_SCALE,
    TORQUE_ZERO,
    Assumed,
)
from experiments.recording import Recording
from experiments.result import Table
from model.identify.estimate import BudgetLine, Cause, Estimate

_SECONDS = re.compile(r"(?<![A-Za-z])s(\d*)(?![A-Za-z0-9])")
SCALE = "torque scale"
GAIN = "gain of the channel"
"""The line of a scale in ampere, volt or counts: of a torque nobody spoke."""
STATED = "calibration of the channel"
PAIR = ("torque", "drive_torque")
"""Torque port, and the torque that the drive reports."""
_ONE_INSTRUMENT = "the drive's torque is the same instrument"
"""Of the scale of two channels that are no witness of each other."""
TORQUES = ("N m", "N")
"""Units of channels that are a torque or a force, and not what drives one."""


def torque_scale_uncertainty(
    recording: Recording, channel: str = "torque"
) -> tuple[float, Assumed | None]:
    """Relative standard uncertainty of the torque scale, and what is assumed where nobody states it."""
    signal = recording.signals[channel]
    relative = signal.calibration.scale_relative_uncertainty
    if relative is not None:
        return relative, None
    row = TORQUE_SCALE if signal.unit in TORQUES else CURRENT
    return row.standard_uncertainty, row


def is_one_instrument(recording: Recording) -> bool:
    """Whether torque port and drive share sensor and constant: unless both name another one, since a drive's port and
    its own word commonly show one current. Then they are wrong together, and neither bears witness of the other.
    """
    if not recording.has(*PAIR):
        return False
    port, drive = (recording.signals[name].calibration.sensor for name in PAIR)
    return not (port and drive and port != drive)


def stated_note(recording: Recording, channel: str = "torque") -> str:
    """What the line of a scale that somebody stated says of itself."""
    shared = channel in PAIR and is_one_instrument(recording)
    return f"{STATED}; {_ONE_INSTRUMENT}" if shared else STATED


def scale_line(recording: Recording, torque: float, channel: str = "torque") -> BudgetLine:
    """The torque scale as a line of the budget of a torque [N m], or of anything proportional to one."""
    relative, assumed = torque_scale_uncertainty(recording, channel)
    source = SCALE if recording.signals[channel].unit in TORQUES else GAIN
    if assumed is not None:
        return assumed.line(source, relative * torque, Cause.TORQUE_SCALE)
    note = stated_note(recording, channel)
    return BudgetLine(source, "B", relative * abs(torque), note, Cause.TORQUE_SCALE)


def zero_uncertainty(recording: Recording, channel: str = "torque") -> tuple[float, Assumed | None]:
    """Standard uncertainty of the zero of a torque that was not read with the servo off, and what is assumed of it."""
    stated = recording.signals[channel].calibration.offset_uncertainty
    if stated is not None:
        return stated, None
    largest = max(
        (
            float(np.abs(recording.si(channel, rows)).max(initial=0.0))
            for rows in recording.blocks()
        ),
        default=0.0,
    )
    return TORQUE_ZERO.standard_uncertainty * largest, TORQUE_ZERO


def thermometer_uncertainty(
    recording: Recording, channel: str = "housing_temperature"
) -> tuple[float, Assumed | None]:
    """Standard uncertainty of a temperature that was recorded [K], and what is assumed where nobody states it."""
    stated = recording.signals[channel].calibration.offset_uncertainty
    if stated is not None:
        return stated, None
    return THERMOMETER.standard_uncertainty, THERMOMETER


def _time_exponent(unit: str) -> int:
    """The power with which a number in this unit goes with the length of a second; an inertia is torque times s2."""
    if unit in ("kg m2", "kg"):
        return 2
    if unit == "Hz":
        return -1
    above, _, below = unit.partition("/")
    powers = [sum(int(n or 1) for n in _SECONDS.findall(part)) for part in (above, below)]
    return powers[0] - powers[1]


def timed(estimate: Estimate, recording: Recording) -> Estimate:
    """The estimate with what a rate that somebody said leaves open; as it is where rows carry stamps."""
    power = _time_exponent(estimate.unit)
    if recording.metadata.time_base != "nominal" or not power:
        return estimate
    line = TIME_BASE.line("time base", power * TIME_BASE.standard_uncertainty * estimate.value)
    if estimate.budget:
        return estimate.with_budget((line,))
    own = BudgetLine("statistical part", "A", estimate.standard_uncertainty)
    return estimate.with_budget((own, line))


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
