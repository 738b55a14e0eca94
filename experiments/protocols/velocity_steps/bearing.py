"""What the bench's output bearing damps of the mode is not the gear's.

    zeta_b = c_b / (2 J_o omega)

for the viscous friction c_b [N m s/rad] of the bearing; its dry friction is fitted beside the mode.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from experiments.protocols.friction.bearing import VISCOUS, OutputBearing
from model.identify.estimate import Estimate
from model.units import REVOLUTION

WAYS = ("", "_forward", "_reverse")


def without_bearing(
    estimates: Mapping[str, Estimate], bearing: OutputBearing, inertia: float
) -> tuple[dict[str, Estimate], float]:
    """The estimates with what the bearing damps taken off the damping ratios, and how much that is; `inertia` of the
    output [kg m2] by the gear's card.

    The interval of the data alone moves and stays as wide: that the bearing is known no better is the bench's.
    """
    changed, taken_off = dict(estimates), 0.0
    for way in WAYS:
        damping, frequency = (
            estimates.get(f"{name}{way}") for name in ("damping_ratio", "frequency")
        )
        if damping is None or frequency is None:
            continue
        per_viscous = 0.5 / (inertia * REVOLUTION * frequency.value)
        off = float(bearing.is_subtracted) * bearing.viscous * per_viscous
        doubt = bearing.viscous_uncertainty * per_viscous
        line = bearing.line(VISCOUS, doubt)
        changed[damping.name] = dataclasses.replace(
            damping,
            value=damping.value - off,
            low=damping.low - off,
            high=damping.high - off,
            budget=(*damping.budget, *([line] if doubt > 0.0 else [])),
        )
        taken_off = taken_off or off
    return changed, taken_off
