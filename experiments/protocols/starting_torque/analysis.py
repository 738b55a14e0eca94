"""No-load starting torque: the quasi-static torque at which the input begins to turn, at several
wave-generator positions.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from experiments.budget import budget_table
from experiments.contract import Evidence
from experiments.errors import AnalysisError
from experiments.evidence import check_settings, quality_remarks
from experiments.protocols.friction.bearing import output_bearing
from experiments.protocols.starting_torque.balance import Balance, balanced
from experiments.protocols.starting_torque.breakaway import (
    Breakaway,
    Unused,
    approach_remarks,
    breakaway_of,
    stuck_share,
)
from experiments.protocols.starting_torque.declaration import NAME, SETTINGS
from experiments.protocols.starting_torque.estimates import at_rest, conditions_of, estimates_of
from experiments.protocols.starting_torque.quantities import QUANTITIES
from experiments.recording import Recording, Segment
from experiments.result import Plot, Result, Series, Table, both_ways
from experiments.setting import names_of
from experiments.torque.zero import TorqueZero, torque_zero
from model.identify.estimate import Estimate
from model.units import DEGREE

_LARGEST_DOUBTFUL = 0.25
"""Share of the ramps that may have ended by something else than motion."""


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """No-load starting torque by direction and position: the torque at which the input begins to turn; at the run's own
    temperature, and at 20 degC beside it.

    The torque is read from a straight line through the last part of the ramp before first motion,
    so that noise of the port does not enter. It is that of motor + gear: a motor tare at running
    speeds does not tell the motor's own breakaway. Settings: the bench's output bearing, as of a friction analysis;
    dry_per_kelvin: value and U of the coefficient of dry friction [1/K], with per_kelvin_source.
    """
    check_settings(evidence.settings, names_of(SETTINGS), NAME)
    bearing = output_bearing(recording, evidence.settings)
    recording.require("starting torque", "input_angle", "torque")
    warnings = quality_remarks(recording, "starting torque", evidence)
    zero = torque_zero(recording)
    warnings += zero.warnings
    segments = recording.labelled("torque-ramp")
    if not segments:
        raise AnalysisError("the run has no torque ramp", where=recording.metadata.run_id)
    ramps, remarks = _ramps(recording, segments, zero)
    warnings += [*remarks, *approach_remarks(recording, segments)]
    stuck = stuck_share(recording)
    warnings += _stuck_remark(stuck)
    balance = balanced(ramps, recording.metadata.run_id)
    known = conditions_of(recording, segments, evidence.settings, zero, bearing, stuck)
    estimates = estimates_of(recording, ramps, balance, known)
    warnings.append(
        "The starting torque is that of motor + gear: the motor's own breakaway is not known."
    )
    warmth = {"housing_temperature": known.housing} if known.law.is_known else {}
    return Result(
        run=recording.metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates=estimates,
        metrics={
            **_metrics(ramps),
            "scatter_of_one_ramp": balance.scatter,
            "output_bearing_torque": at_rest(recording, bearing)[0],
            **warmth,
        },
        warnings=tuple(warnings),
        plots=(_plot(ramps, balance, estimates["starting_torque"]),),
        tables=(_table(ramps), budget_table(estimates.values())),
        options={"torque_is_of": "motor + gear", "output_bearing": bearing.words()},
    )


def _stuck_remark(share: float) -> list[str]:
    """What is to be said where a share of the approaches stuck and slipped."""
    if not share > 0.0:
        return []
    return [
        f"{100.0 * share:.0f} % of the approaches stuck and slipped: how far the output was wound up before those "
        "ramps is not known, and their torque may be too low by what the output's friction asks of the input."
    ]


def _ramps(
    recording: Recording, segments: tuple[Segment, ...], zero: TorqueZero
) -> tuple[list[Breakaway], list[str]]:
    """The ramps that tell a breakaway, and what is to be said of the others."""
    found = [breakaway_of(recording, segment, zero) for segment in segments]
    ramps = [b for b in found if isinstance(b, Breakaway)]
    unused = Counter(b for b in found if isinstance(b, Unused))
    doubtful = unused[Unused.JUMPED] + unused[Unused.ALONE]
    if doubtful > _LARGEST_DOUBTFUL * len(found):
        raise AnalysisError(
            "too many ramps were ended by something that is no motion of the gear",
            where=recording.metadata.run_id,
            value=", ".join(f"{n} {why}" for why, n in unused.items()),
            limit=f"<= {100.0 * _LARGEST_DOUBTFUL:g} % of {len(found)} ramps",
            remedy="Look at both encoders, their cables and couplings; then run it again.",
        )
    if not ramps:
        raise AnalysisError(
            "no ramp made the input move",
            where=recording.metadata.run_id,
            remedy="Raise the limit of the ramp.",
        )
    return ramps, [
        f"{n} of {len(found)} ramps {why} and were left out." for why, n in unused.items()
    ]


def _metrics(ramps: list[Breakaway]) -> dict[str, float]:
    return {
        "ramps": float(len(ramps)),
        "largest_starting_torque": max(abs(b.torque) for b in ramps),
        "smallest_starting_torque": min(abs(b.torque) for b in ramps),
    }


def _plot(ramps: list[Breakaway], balance: Balance, mean: Estimate) -> Plot:
    """The torque of every ramp, and the number that the run is worth beside them."""
    direction, position, torque = np.array(
        [(b.direction, b.position, abs(b.torque)) for b in ramps]
    ).T
    y, spread = torque * 1e3, 1.96e3 * balance.scatter
    series = both_ways(direction, position / DEGREE, y, low=y - spread, high=y + spread)
    ends = np.array([position.min(), position.max()]) / DEGREE
    value, u = 1e3 * mean.value, 1e3 * mean.expanded_uncertainty
    series.append(Series(label="starting torque", x=ends, y=np.full(2, value), group=2))
    off = float(torque.mean()) * 1e3 - value
    return Plot(
        name="starting-torque",
        title="No-load starting torque over wave-generator position",
        x_label="wave-generator angle [deg]",
        y_label="starting torque, motor + gear [mN m]",
        series=tuple(series),
        note=f"The line is the starting torque, {value:.3g} ± {u:.2g} mN m: the mean of both directions, "
        f"{off:+.2g} mN m of it taken off for the output bearing and other places. "
        "Good where both ways and all places lie near it.",
    )


def _table(ramps: list[Breakaway]) -> Table:
    rows = tuple((b.position / DEGREE, b.direction, b.torque) for b in ramps)
    columns = ("position [deg]", "direction", "torque [N m]")
    return Table("starting-torque", "Starting torque per ramp", columns, rows)
