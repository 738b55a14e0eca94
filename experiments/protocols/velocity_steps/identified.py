"""The gear that rings as a run of velocity steps did, and the torsional mode that equation 2 gives a gear."""

from __future__ import annotations

import numpy as np

from experiments.errors import AnalysisError
from experiments.protocols.velocity_steps.quantities import NAME
from experiments.result import Result
from model.gear import HarmonicDrive, Origin
from model.identify.estimate import Estimate
from model.linear import Mode, dynamic_parameters, modes
from model.stiffness import drive_stiffness

ROUNDS = 4
"""Damping moves the mode a little, and the inertia moves the damping ratio: both settle within a few rounds."""


def identified(result: Result, gear: HarmonicDrive) -> HarmonicDrive:
    """The gear with the output inertia that the run tells, and the damping that makes its mode die away as in the run.

    J_o is that of the torque in the steps that ring, where it answered. Angles alone tell K/J_o and not K: then J_o is
    computed from the set's own stiffness, so that equation 2 rings as the run did, and is not called identified. The
    radial damping C_b is that which gives the damping ratio; where no C_b does, the structural damping C_t takes the
    rest. A damping ratio that the run does not tell leaves the set's own.
    """
    if result.kind != NAME:
        raise AnalysisError(
            "is the result of another protocol", where=result.run, value=result.kind, limit=NAME
        )
    weighed = result.estimates.get("output_inertia")
    if weighed is not None and weighed.identifiable == "yes":
        return _with_damping(_with_weighed_inertia(gear, weighed, result), result)
    for _ in range(ROUNDS):
        gear = _with_damping(_with_ringing_inertia(gear, result), result)
    return gear


def _with_weighed_inertia(gear: HarmonicDrive, weighed: Estimate, result: Result) -> HarmonicDrive:
    """The gear with the J_o of the torque: its interval holds nothing of the set's stiffness."""
    stiffness = result.estimates["output_stiffness"]
    source = (
        f"run {result.run}: torque of the steps that ring; with it K is {stiffness.value:.4g} +- "
        f"{stiffness.expanded_uncertainty:.2g} N m/rad, the set's {drive_stiffness(gear).combined_output:.4g}"
    )
    origin = Origin("identified", source, weighed.standard_uncertainty)
    return gear.with_values({"inertia.output": weighed.value}, origin)


def _with_ringing_inertia(gear: HarmonicDrive, result: Result) -> HarmonicDrive:
    """The gear with the J_o that gives its mode the frequency of the run's, at the set's own stiffness."""
    squared = result.estimates["mode_squared"].value
    inertia = gear.inertia.output * torsional_mode(gear).natural_frequency ** 2 / squared
    source = (
        f"run {result.run}: K/J_o from the mode's {squared:.6g} 1/s2 with the set's own stiffness "
        f"{drive_stiffness(gear).combined_output:.5g} N m/rad, whose error is that of J_o"
    )
    return gear.with_values({"inertia.output": inertia}, Origin("computed", source))


def _with_damping(gear: HarmonicDrive, result: Result) -> HarmonicDrive:
    """The gear with the damping that gives its mode the damping ratio of the run's, where the run tells it."""
    damping = result.estimates["damping_ratio"]
    if damping.identifiable != "yes":
        return gear
    path, value = _damping_for(gear, damping.value)
    source = f"run {result.run}: damping ratio {damping.value:.4g} of the first mode"
    spread = damping.standard_uncertainty / damping.value * value if damping.value > 0.0 else None
    return gear.with_values({path: value}, Origin("identified", source, spread))


def torsional_mode(gear: HarmonicDrive) -> Mode:
    """The lowest mode of equation 2 that oscillates: the output on the gear's compliance."""
    return min(
        (m for m in modes(dynamic_parameters(gear)) if m.damping_ratio < 1.0),
        key=lambda m: m.natural_frequency,
    )


def _damping_for(gear: HarmonicDrive, wanted: float) -> tuple[str, float]:
    """The parameter and its value that give the first mode this damping ratio: C_b by bisection, else C_t."""

    def ratio_of(path: str, value: float) -> float:
        return torsional_mode(gear.with_values({path: value})).damping_ratio

    trials = np.geomspace(10.0, 1e6, 41)
    ratios = np.array([ratio_of("bearing.damping", float(c)) for c in trials])
    top = int(np.argmax(ratios))
    path, low, high = "damping.structural", 0.0, 1e3
    if ratios[top] >= wanted >= ratios[0]:
        path, low, high = "bearing.damping", float(trials[0]), float(trials[top])
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if ratio_of(path, middle) < wanted else (low, middle)
    return path, 0.5 * (low + high)
