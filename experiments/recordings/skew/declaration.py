"""Skew between two channels: what comes of it, and what it asks of a recording."""

from __future__ import annotations

from experiments.contract import Deferred, Experiment, NoParameters, no_plan
from experiments.need import ANGLES, EFFORTS, MEASURED, SPEEDS, Need
from experiments.quantity import Quantity
from experiments.setting import Setting

NAME = "skew"

QUANTITIES = (
    Quantity(
        name="skew",
        title="delay of the second channel",
        unit="s",
        definition="by how much the second channel is later than the first",
        rests_on={},
        is_key=True,
        is_signed=True,
    ),
    Quantity(name="gain", title="second per first", unit="", is_signed=True),
    Quantity(
        name="hysteresis",
        title="hysteresis",
        unit="",
        definition="what the second channel stands off to each side by direction, at any speed",
        is_signed=True,
    ),
)

SETTINGS = (
    Setting("first", "channel", "the first of the pair that is there", "", "another pair is meant"),
    Setting(
        "second", "channel", "the second of the pair that is there", "", "another pair is meant"
    ),
    Setting(
        "longest_delay",
        "number",
        "0.5, at most a tenth of the recording",
        "s",
        "the delay may be longer",
    ),
)

EXPERIMENT = Experiment(
    name=NAME,
    title="Skew between two channels",
    summary="delay between two channels, apart from hysteresis",
    parameters=NoParameters,
    plan=no_plan,
    analyse=Deferred("experiments.recordings.skew.analysis:analyse"),
    asks=Need(channels=((*ANGLES, *SPEEDS, *EFFORTS), MEASURED)),
    needs=(),
    has_plan=False,
    quantities=QUANTITIES,
    version=4,
    settings=SETTINGS,
)
