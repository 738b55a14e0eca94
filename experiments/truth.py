"""What a simulated rig knows of itself beside what an analysis found: for demonstrations and
coverage, never for analyses.

The truth is the mapping that a simulated rig writes into its run file. Found and true values are
made comparable here: the torque port reads (1 + scale error) times the true torque, both encoders
stand in what is measured of the kinematic error, and phases of the truth over the recorded input
angle are turned to the marks from which a result counts.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.errors import AnalysisError
from experiments.protocols.friction.plots import FIT_TABLE
from experiments.result import Result
from model.arrays import FloatArray
from model.friction import bearing_lever, bearing_magnitude, mesh_lever
from model.gear import HarmonicDrive
from model.identify.estimate import Estimate
from model.identify.stribeck import NAMES, fit_stribeck
from model.kinematic_error import basis_orders
from model.units import RPM


@dataclass(frozen=True)
class TruthRow:
    """One identified quantity beside its true value, in the same unit and frame."""

    estimate: Estimate
    truth: float

    @property
    def difference(self) -> float:
        """Found minus true; on the circle for phases."""
        away = self.estimate.value - self.truth
        return (
            math.remainder(away, 2.0 * math.pi) if self.estimate.name.startswith("phase") else away
        )

    @property
    def covered(self) -> bool:
        """Whether the truth lies in the 95 % interval (type A)."""
        truth = self.estimate.value - self.difference
        return self.estimate.low <= truth <= self.estimate.high

    @property
    def within(self) -> bool:
        """Whether the truth lies within U (95 %), type B included, or in the interval where that is wider."""
        return self.covered or abs(self.difference) <= self.estimate.expanded_uncertainty


def truth_of(metadata_process: Mapping[str, Any]) -> Mapping[str, Any]:
    """The truth that the process record of a run carries; `AnalysisError` where there is none."""
    truth = metadata_process.get("truth")
    if not isinstance(truth, Mapping):
        raise AnalysisError(
            "the run carries no truth",
            where="process.truth",
            remedy="Only runs of the simulated rig know theirs.",
        )
    return truth


def truth_rows(
    result: Result, truth: Mapping[str, Any], gear: HarmonicDrive | None = None
) -> tuple[TruthRow, ...]:
    """Every estimate of a result whose true value the rig knows.

    `gear` is the parameter set that the analysis leaned on. With it the truth of a friction run is
    what a perfect fit would have found: with the output bearing's friction and at the temperature of the
    run, in the form of equation 19 beside the bearing friction that the set states. Without it the
    truth holds at the reference temperature.
    """
    finder = _FINDERS.get(result.kind)
    if finder is None:
        return ()
    truths = dict(finder(result, truth, gear))
    return tuple(
        TruthRow(dataclasses.replace(e, name=name), truths[name])
        for name, e in result.estimates.items()
        if name in truths
    )


def _scale(truth: Mapping[str, Any]) -> float:
    return 1.0 + float(truth.get("torque_port", {}).get("scale_error", 0.0))


def _friction(
    result: Result, truth: Mapping[str, Any], gear: HarmonicDrive | None
) -> Iterator[tuple[str, float]]:
    """Parameters and running torques of the gear as the port shows them at the temperature of the run."""
    friction = truth.get("friction", {})
    balance = result.options.get("torque_balance")
    if result.options.get("torque_is_of") != "gear" or friction.get("torque_balance") != balance:
        return
    scale = _scale(truth)
    table = next((t for t in result.tables if t.name == FIT_TABLE), None)
    if gear is None or table is None:
        for name, value in friction.get("measurable", {}).items():
            yield name, float(value) * (scale if name in ("coulomb", "static", "viscous") else 1.0)
        return
    warmer = _warmer(result, truth)
    points = np.array([[float(v) for v in row[:3]] for row in table.rows])
    speed, error = points[:, 0] * RPM, points[:, 2]
    torque = scale * _true_torque(friction, truth.get("thermal", {}), gear, speed, warmer)
    low = gear.options.low_speed_branch
    drag = bearing_lever(gear, balance) * bearing_magnitude(
        gear.bearing, speed, low_speed_branch=low
    )
    force = (torque - drag) / mesh_lever(gear, balance)
    # The errors of the run as weights: where equation 18 does not hold, the best parameters depend on them.
    fit = fit_stribeck(speed, force, error / mesh_lever(gear, balance))
    yield from zip(NAMES, (float(v) for v in fit.values), strict=True)
    for name in result.estimates:
        if name.startswith("running_torque_"):
            at = np.array([float(name.removeprefix("running_torque_").removesuffix("_rpm")) * RPM])
            yield (
                name,
                scale
                * float(_true_torque(friction, truth.get("thermal", {}), gear, at, warmer)[0]),
            )


def _warmer(result: Result, truth: Mapping[str, Any]) -> float:
    """How much warmer than the truth's reference the points were [K]; 0 where nothing warms or nobody looked."""
    reference = truth.get("thermal", {}).get("reference")
    housing = result.metrics.get("housing_temperature", math.nan)
    offset = float(truth.get("thermometer", {}).get("housing_offset", 0.0))
    return (
        housing - offset - float(reference)
        if reference is not None and math.isfinite(housing)
        else 0.0
    )


def _true_torque(
    friction: Mapping[str, Any],
    thermal: Mapping[str, Any],
    gear: HarmonicDrive,
    speed: FloatArray,
    warmer: float,
) -> FloatArray:
    """Friction torque at the input of the true gear with its output bearing [N m], `warmer` than
    the reference by so many K.

    Dry parts fall by `coulomb_per_kelvin` of themselves per kelvin, viscous ones as exp(-viscous_per_kelvin dT), the
    bearing's speed-dependent part as that to 2/3.
    """
    dry = 1.0 - float(thermal.get("coulomb_per_kelvin", 0.0)) * warmer
    thin = math.exp(-float(thermal.get("viscous_per_kelvin", 0.0)) * warmer)
    bearing = dataclasses.replace(
        gear.bearing,
        friction_factor=float(friction["bearing_friction_factor"]),
        viscosity=float(friction["viscosity"]),
    )
    own, seen = friction, friction["measurable"]
    lever = mesh_lever(gear, friction["torque_balance"])
    decay = np.exp(-((speed / own["stribeck_velocity"]) ** own["shape"]))
    mesh = (
        dry * (own["coulomb"] + (own["static"] - own["coulomb"]) * decay)
        + thin * own["viscous"] * speed
    )
    output = (seen["coulomb"] - own["coulomb"]) + (seen["viscous"] - own["viscous"]) * speed
    still = bearing_magnitude(bearing, 0.0)
    moving = bearing_magnitude(bearing, speed) - still
    drag = bearing_lever(gear, friction["torque_balance"]) * (
        dry * still + thin ** (2.0 / 3.0) * moving
    )
    return lever * (mesh + output) + drag


def _tare(
    result: Result, truth: Mapping[str, Any], gear: HarmonicDrive | None
) -> Iterator[tuple[str, float]]:
    motor, scale = truth.get("motor", {}), _scale(truth)
    for name in ("coulomb", "viscous"):
        if name in motor:
            yield f"motor_{name}", scale * float(motor[name])


def _kinematic_error(
    result: Result, truth: Mapping[str, Any], gear: HarmonicDrive | None
) -> Iterator[tuple[str, float]]:
    error = truth.get("kinematic_error", {})
    ratio = float(result.options.get("ratio", math.nan))
    reference = float(result.options.get("phase_reference_angle", 0.0))
    labels = {
        round(o.order, 9): o.label
        for o in basis_orders(ratio, range(1, int(result.options.get("highest_order", 12)) + 1))
    }
    recorded = "measurable_recorded" in error
    for entry in error["measurable_recorded"] if recorded else error.get("measurable", ()):
        label = labels.get(round(float(entry["order"]), 9))
        if label is None:
            continue
        phase = math.atan2(entry["sine"], entry["cosine"]) - (
            entry["order"] * reference if recorded else 0.0
        )
        yield f"amplitude_{label}", float(entry["amplitude"])
        yield f"phase_{label}", math.remainder(phase, 2.0 * math.pi)
    if "measurable_peak_to_peak" in error:
        for name in (
            "transmission_accuracy",
            "transmission_accuracy_forward",
            "transmission_accuracy_reverse",
        ):
            yield name, float(error["measurable_peak_to_peak"])


def _steps(
    result: Result, truth: Mapping[str, Any], gear: HarmonicDrive | None
) -> Iterator[tuple[str, float]]:
    """K/J_o and frequency for small amplitudes: with the stiffness of the hysteresis element before it slides."""
    dynamics = truth.get("dynamics", {})
    if "stiffness_over_inertia" not in dynamics:
        return
    share = 1.0 + float(dynamics.get("hysteresis", {}).get("stiffness_share", 0.0))
    ratio = share * float(dynamics["stiffness_over_inertia"])
    for suffix in ("", "_forward", "_reverse"):
        yield f"stiffness_over_inertia{suffix}", ratio
        yield f"frequency{suffix}", math.sqrt(ratio) / (2.0 * math.pi)
    if "output_inertia" in dynamics:
        yield "output_inertia", float(dynamics["output_inertia"])
        yield "output_stiffness", ratio * float(dynamics["output_inertia"])


_FINDERS = {
    "friction": _friction,
    "motor-tare": _tare,
    "kinematic-error": _kinematic_error,
    "velocity-steps": _steps,
}
