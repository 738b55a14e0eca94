"""Torque drift: how fast the mean of a torque channel changes while nothing else does."""

from __future__ import annotations

import numpy as np

from harmonic_rig.analyses import (
    Estimate,
    Evidence,
    Recording,
    Result,
    analysing,
    check_recording,
    check_settings,
    chosen_channel,
    require_time_base,
    solve,
    usable,
)
from harmonic_rig.protocols import EFFORTS, Experiment, NoParameters, Quantity, no_plan

NAME = "torque-drift"
QUANTITIES = (
    Quantity(
        name="drift",
        title="drift",
        unit="N m/s",
        definition="slope of the channel over time",
        is_key=True,
    ),
)


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """The slope of a channel over time, with an interval that respects autocorrelation.

    Settings: channel (the torque that is there).
    """
    check_settings(evidence.settings, ("channel",), NAME)
    require_time_base(recording, "a drift")
    channel = chosen_channel(recording, evidence.settings, "channel", EFFORTS, "a drift")
    quality = check_recording(recording, "a drift", evidence.maximum_missed_share)
    good = usable(recording)
    time, torque = recording.time()[good], recording.si(channel)[good]
    with analysing(recording.metadata.run_id):
        fit = solve(np.column_stack((np.ones_like(time), time)), torque)
    low, high = fit.interval(1)
    drift = Estimate(name="drift", value=float(fit.values[1]), unit="N m/s", low=low, high=high)
    return Result(
        run=recording.metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates={"drift": drift},
        warnings=quality.warnings,
        options={"channel": channel},
    )


EXPERIMENT = Experiment(
    name=NAME,
    title="Torque drift",
    summary="how fast the mean of a torque channel changes",
    parameters=NoParameters,
    plan=no_plan,
    analyse=analyse,
    needs=(),
    has_plan=False,
    quantities=QUANTITIES,
)
