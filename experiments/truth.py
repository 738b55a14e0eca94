"""What a simulated rig knows of itself beside what an analysis found: for demonstrations and coverage, never for analyses.

The truth is the mapping that a simulated rig writes into its run file. Found and true values are made comparable here: the
torque port reads (1 + scale error) times the true torque, both encoders stand in what is measured of the kinematic error, and
phases of the truth count from the recorded input angle, those of a result from its index marks.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.errors import AnalysisError
from experiments.result import Result, Table
from model.identify.estimate import Estimate
from model.kinematic_error import basis_orders
from model.units import RPM

COLUMNS = (
    "quantity", "found", "low", "high", "expanded uncertainty", "truth", "unit", "in the 95 % interval", "within U",
)  # fmt: skip


@dataclass(frozen=True)
class TruthRow:
    """One identified quantity beside its true value, in the same unit and frame."""

    estimate: Estimate
    truth: float

    @property
    def difference(self) -> float:
        """Found minus true; on the circle for phases."""
        away = self.estimate.value - self.truth
        return math.remainder(away, 2.0 * math.pi) if self.estimate.name.startswith("phase") else away

    @property
    def covered(self) -> bool:
        """Whether the truth lies in the 95 % interval (type A)."""
        truth = self.estimate.value - self.difference
        return self.estimate.low <= truth <= self.estimate.high

    @property
    def within(self) -> bool:
        """Whether the truth lies within U (k = 2), type B included, or in the interval where that is wider."""
        return self.covered or abs(self.difference) <= self.estimate.expanded_uncertainty


def truth_of(metadata_process: Mapping[str, Any]) -> Mapping[str, Any]:
    """The truth that the process record of a run carries; `AnalysisError` where there is none."""
    truth = metadata_process.get("truth")
    if not isinstance(truth, Mapping):
        raise AnalysisError(
            "the run carries no truth", where="process.truth", remedy="Only runs of the simulated rig know theirs."
        )
    return truth


def truth_rows(result: Result, truth: Mapping[str, Any]) -> tuple[TruthRow, ...]:
    """Every estimate of a result whose true value the rig knows."""
    finder = _FINDERS.get(result.kind)
    if finder is None:
        return ()
    known = dict(finder(result, truth))
    return tuple(TruthRow(e, known[name]) for name, e in result.estimates.items() if name in known)


def truth_table(result: Result, truth: Mapping[str, Any]) -> Table:
    """Found beside true, one line per quantity."""
    rows = tuple(
        (
            r.estimate.name, r.estimate.value, r.estimate.low, r.estimate.high, r.estimate.expanded_uncertainty,
            r.estimate.value - r.difference, r.estimate.unit, "yes" if r.covered else "no", "yes" if r.within else "no",
        )
        for r in truth_rows(result, truth)
    )  # fmt: skip
    note = (
        "Truth as the instruments can see it: with both encoders' errors, and with the scale error of the torque port "
        "where torque enters. Friction parameters of the truth hold at its reference temperature."
    )
    return Table("truth", f"Found and true: {result.kind}", COLUMNS, rows, note)


def _scale(truth: Mapping[str, Any]) -> float:
    return 1.0 + float(truth.get("torque_port", {}).get("scale_error", 0.0))


def _friction(result: Result, truth: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    known = truth.get("friction", {})
    if result.options.get("torque_is_of") != "gear":
        return
    scale = _scale(truth)
    if known.get("torque_balance") == result.options.get("torque_balance"):
        for name, value in known.get("measurable", {}).items():
            yield name, float(value) * (scale if name in ("coulomb", "static", "viscous") else 1.0)
    curve = known.get("torque_curve")
    if curve:
        for name in result.estimates:
            if name.startswith("running_torque_"):
                speed = float(name.removeprefix("running_torque_").removesuffix("_rpm")) * RPM
                yield name, scale * float(np.interp(speed, curve["speed"], curve["measurable"]))


def _tare(result: Result, truth: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    motor, scale = truth.get("motor", {}), _scale(truth)
    for name in ("coulomb", "viscous"):
        if name in motor:
            yield f"motor_{name}", scale * float(motor[name])


def _kinematic_error(result: Result, truth: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    known = truth.get("kinematic_error", {})
    ratio = float(result.options.get("ratio", math.nan))
    reference = float(result.options.get("phase_reference_angle", 0.0))
    labels = {
        round(o.order, 9): o.label
        for o in basis_orders(ratio, range(1, int(result.options.get("highest_order", 12)) + 1))
    }
    for entry in known.get("measurable", ()):
        label = labels.get(round(float(entry["order"]), 9))
        if label is None:
            continue
        phase = math.atan2(entry["sine"], entry["cosine"]) - entry["order"] * reference
        yield f"amplitude_{label}", float(entry["amplitude"])
        yield f"phase_{label}", math.remainder(phase, 2.0 * math.pi)
    if "measurable_peak_to_peak" in known:
        for name in ("transmission_accuracy", "transmission_accuracy_forward", "transmission_accuracy_reverse"):
            yield name, float(known["measurable_peak_to_peak"])


def _steps(result: Result, truth: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    for name, value in truth.get("dynamics", {}).items():
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            yield name, float(value)


_FINDERS = {
    "friction": _friction,
    "motor-tare": _tare,
    "kinematic-error": _kinematic_error,
    "velocity-steps": _steps,
}
