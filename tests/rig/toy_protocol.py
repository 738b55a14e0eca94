"""A protocol that nobody but its test knows: one file, and one line of the catalogue (`ENTRY`).

Its quantities are chosen to catch whoever guesses: "backlash" is no arcminute by its name, "static"
is no friction, "dwell_rate" is shown in r/min though its name speaks of no speed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Gt, Le

from experiments.catalogue import Entry
from experiments.contract import Evidence, Experiment
from experiments.errors import AnalysisError
from experiments.parameters import Help, Unit
from experiments.planning.parts import between_zeros, checked, longest, ramp, stop
from experiments.quantity import ANGLES_IN_ITS_BUDGET, Quantity
from experiments.recording import Recording
from experiments.result import Plot, Result, Series
from experiments.steps.vocabulary import HoldRevolutions, SegmentLabel, Step
from experiments.terms import PaperFigure, Term
from model.gear import HarmonicDrive
from model.identify.estimate import BudgetLine, Estimate
from model.units import ARCSEC, RPM

NAME = "toy"
ENTRY = Entry(NAME, __name__, "a turn each way, and what is lost between them")

QUANTITIES = (
    Quantity(
        name="backlash",
        title="play of the toy",
        unit="rad",
        shown="arcsec",
        definition="what the output loses between the ways",
        conditions=("part", "pace"),
        is_key=True,
        is_watched=True,
        rests_on=ANGLES_IN_ITS_BUDGET,
    ),
    Quantity(
        name="static",
        title="static wind-up",
        unit="rad",
        shown="arcmin",
        rests_on=ANGLES_IN_ITS_BUDGET,
    ),
    Quantity(
        name="twist_{way}",
        title="twist {way}",
        unit="rad",
        shown="°",
        is_circular=True,
        rests_on=ANGLES_IN_ITS_BUDGET,
    ),
    Quantity(name="dwell_rate", title="rate of dwelling", unit="rad/s", shown="r/min"),
)


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """What a toy run can be told."""

    pace_rpm: Annotated[float, Gt(0.0), Le(300.0), Unit("r/min"), Help("pace of the toy")] = 120.0
    acceleration: Annotated[float, Gt(0.0), Le(2000.0), Unit("rad/s2"), Help("of the input")] = (
        200.0
    )


def plan(parameters: Parameters, gear: HarmonicDrive) -> Iterator[Step]:
    """Torque zero; two revolutions each way; torque zero."""
    checked(parameters, Parameters, NAME)
    return between_zeros(_turns(parameters), 0.5)


def _turns(p: Parameters) -> Iterator[Step]:
    speed = p.pace_rpm * RPM
    for direction in (1, -1):
        yield ramp(direction * speed, p.acceleration, direction)
        label = SegmentLabel("hold", direction * speed, direction)
        yield HoldRevolutions(2.0, longest(2.0, speed), label)
        yield stop(p.acceleration)


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """Numbers of which only the names and the units matter, the same for every run of one pace."""
    rows = sum(segment.stop - segment.start for segment in recording.labelled("hold"))
    if not rows:
        raise AnalysisError("the toy was not turned", where=recording.metadata.run_id)
    pace = float(recording.metadata.parameters.get("pace_rpm", Parameters.pace_rpm))
    curve = Series(label="play", x=np.arange(3.0), y=np.array([0.0, 40.0, 0.0]))
    return Result(
        run=recording.metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates={e.name: e for e in toy_estimates()},
        metrics={"dwell_rate": pace * RPM},
        plots=(
            Plot(
                name="toy-play",
                title="Play of the toy over time",
                x_label="time [s]",
                y_label="play [arcsec]",
                series=(curve,),
                figure="99",
            ),
        ),
        options={"pace": f"{pace:g}"},
    )


def toy_estimates(backlash: float = 40.0 * ARCSEC) -> tuple[Estimate, ...]:
    """Play, wind-up and twist, each known to two seconds of arc."""
    values = {"static": 90.0 * ARCSEC, "backlash": backlash, "twist_forward": 0.5}
    return tuple(
        Estimate(
            name=name,
            value=value,
            unit="rad",
            low=value - 2.0 * ARCSEC,
            high=value + 2.0 * ARCSEC,
            budget=(BudgetLine("scatter of the toy", "A", ARCSEC),),
        )
        for name, value in values.items()
    )


EXPERIMENT = Experiment(
    name=NAME,
    title="Play of a toy",
    summary=ENTRY.summary,
    parameters=Parameters,
    plan=plan,
    analyse=analyse,
    quantities=QUANTITIES,
    live=("speed", "torque"),
    terms=(Term("Play", "What a toy loses when it turns back."),),
    figures=(PaperFigure(99, "the play of a toy"),),
)
