"""The gear that rings as a run of velocity steps did, and the torsional mode that equation 2 gives a gear."""

from __future__ import annotations

import numpy as np

from experiments.errors import AnalysisError
from experiments.protocols.velocity_steps.quantities import NAME
from experiments.result import Result
from model.gear import HarmonicDrive, Origin
from model.linear import Mode, dynamic_parameters, modes
from model.stiffness import drive_stiffness


def identified(result: Result, gear: HarmonicDrive) -> HarmonicDrive:
    """The gear with the output inertia and the damping that make equation 2 ring as the run did.

    The run tells the mode, not K: the stiffness of the set stays, and J_o follows from it. The radial
    damping C_b is that which gives the damping ratio; where no C_b does, the structural damping C_t
    takes the rest.
    """
    if result.kind != NAME:
        raise AnalysisError(
            "is the result of another protocol", where=result.run, value=result.kind, limit=NAME
        )
    ratio, damping = result.estimates["mode_squared"], result.estimates["damping_ratio"]
    path, value = "bearing.damping", gear.bearing.damping
    for _ in range(4):
        # Damping moves the mode a little, and the inertia moves the damping ratio: both settle within a few rounds.
        mode = torsional_mode(gear)
        gear = gear.with_values(
            {"inertia.output": gear.inertia.output * mode.natural_frequency**2 / ratio.value}
        )
        path, value = _damping_for(gear, damping.value)
        gear = gear.with_values({path: value})
    stiffness = drive_stiffness(gear).combined_output
    source = (
        f"run {result.run}: K/J_o from the mode's {ratio.value:.6g} 1/s2 with the set's own stiffness "
        f"{stiffness:.5g} N m/rad"
    )
    spread = ratio.standard_uncertainty / ratio.value * gear.inertia.output
    gear = gear.with_values(
        {"inertia.output": gear.inertia.output}, Origin("identified", source, spread)
    )
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
    path = "bearing.damping" if ratios[top] >= wanted >= ratios[0] else "damping.structural"
    low, high = (float(trials[0]), float(trials[top])) if path == "bearing.damping" else (0.0, 1e3)
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if ratio_of(path, middle) < wanted else (low, middle)
    return path, 0.5 * (low + high)
