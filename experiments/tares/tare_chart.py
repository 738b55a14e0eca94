"""The bench's tares as a chart: what each says of the motor, in the order in which they were taken."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from experiments.result import Plot, Result, Series
from experiments.tares.tare import tare_of
from experiments.tares.tare_witness import as_warm
from model.identify.estimate import NORMAL_COVERAGE_FACTOR
from model.units import RPM

NAME = "tares"


def tare_chart(tare: Result, others: Sequence[Result]) -> Plot | None:
    """Friction of the motor at the slowest and the fastest speed of a tare, by it and by the bench's others, each
    brought to its temperature, with U of what they do not share; None where there is no other.

    Runs are numbered as they are made: the order of their names is that of time.
    """
    own = tare_of(tare)
    if own is None:
        return None
    speed = own.speed[[0, -1]]
    every = {one.run: one for one in (*others, tare)}
    found = {
        run: seen for run in sorted(every) if (seen := as_warm(every[run], tare, speed)) is not None
    }
    if len(found) < 2:
        return None
    torque = np.array([seen[0] for seen in found.values()])
    u = NORMAL_COVERAGE_FACTOR * np.sqrt(np.array([seen[1] for seen in found.values()]))
    place = np.arange(1.0, len(found) + 1.0)
    series = [
        Series(
            label=f"{abs(at) / RPM:.4g} r/min",
            x=place,
            y=1e3 * torque[:, k],
            low=1e3 * (torque[:, k] - u[:, k]),
            high=1e3 * (torque[:, k] + u[:, k]),
            style="points",
            group=k,
        )
        for k, at in enumerate(speed.tolist())
    ]
    return Plot(
        name=NAME,
        title="The bench's tares",
        x_label="tare, in the order of the runs",
        y_label="friction of the bare motor [mN m]",
        series=tuple(series),
        note="Each tare of this bench in its turn. Good where all of one speed lie within their bars. "
        "At the temperature of this one, with U of what they do not share: "
        + ", ".join(f"{n} {run}" for n, run in enumerate(found, start=1))
        + ".",
    )
