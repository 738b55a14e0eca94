"""What the bench's output bearing damps of the mode is not the gear's.

    zeta_b = c_b / (2 J_o omega)

for the viscous friction c_b [N m s/rad] of the bearing; its dry friction is fitted beside the mode. The doubt of J_o is
in it. Where nobody stated J_o nothing is taken off: then it may be all of it and twice as much as by the set's J_o.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

from experiments.load import Load
from experiments.protocols.friction.bearing import VISCOUS, OutputBearing
from model.identify.estimate import BudgetLine, Estimate
from model.units import REVOLUTION

WAYS = ("", "_forward", "_reverse")
BY_LOAD = "output bearing, inertia of the output"
_UNSTATED_TIMES = 2.0 / math.sqrt(3.0)
"""Of the bearing's damping by the set's inertia: from none to twice as much, none of it taken off."""


def without_bearing(
    estimates: Mapping[str, Estimate], bearing: OutputBearing, load: Load
) -> tuple[dict[str, Estimate], float]:
    """The estimates with what the bearing damps taken off the damping ratios, and how much that is; `load` of the
    output.

    The interval of the data alone moves and stays as wide: that the bearing is known no better is the bench's.
    """
    changed, taken_off = dict(estimates), 0.0
    for way in WAYS:
        damping, frequency = (
            estimates.get(f"{name}{way}") for name in ("damping_ratio", "frequency")
        )
        if damping is None or frequency is None:
            continue
        per_viscous = 0.5 / (load.inertia * REVOLUTION * frequency.value)
        whole = float(bearing.is_subtracted) * bearing.viscous * per_viscous
        off = float(load.is_stated) * whole
        doubt = bearing.viscous_uncertainty * per_viscous
        by_load = load.relative_uncertainty * off if load.is_stated else _UNSTATED_TIMES * whole
        lines = [
            bearing.line(VISCOUS, doubt),
            load.marked(BudgetLine(BY_LOAD, "B", by_load, "of the set, beside its own doubt")),
        ]
        changed[damping.name] = dataclasses.replace(
            damping,
            value=damping.value - off,
            low=damping.low - off,
            high=damping.high - off,
            budget=(*damping.budget, *(line for line in lines if line.standard_uncertainty > 0.0)),
        )
        taken_off = taken_off or off
    return changed, taken_off
