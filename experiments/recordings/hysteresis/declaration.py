"""Hysteresis loops: what comes of it, and what it asks of a recording."""

from __future__ import annotations

from experiments.contract import Deferred, Experiment, NoParameters, no_plan
from experiments.need import ANGLES, TORQUES, Need
from experiments.quantity import Quantity
from experiments.setting import Setting

NAME = "hysteresis"

QUANTITIES = (
    Quantity(
        name="branch_stiffness",
        title="stiffness of the loading branch",
        unit="N m/rad",
        definition="slope of torque over torsion beyond half the amplitude, while it is loaded",
        is_key=True,
    ),
    Quantity(
        name="secant_stiffness",
        title="secant stiffness",
        unit="N m/rad",
        definition="torque over torsion between the tips of the loop",
        is_key=True,
    ),
    Quantity(
        name="loss", title="loss per loop", unit="J", definition="area of the loop", is_key=True
    ),
    Quantity(
        name="hysteresis_loss",
        title="hysteresis loss",
        unit="rad",
        shown="arcmin",
        definition="width of the loop at no torque",
        is_key=True,
    ),
    Quantity(
        name="lost_motion",
        title="lost motion",
        unit="rad",
        shown="arcmin",
        definition="between the middles of the loop at +T and at -T",
        is_key=True,
    ),
    Quantity(name="loops", title="loops", unit="1"),
    Quantity(name="amplitude", title="amplitude of the torque", unit="N m"),
    Quantity(name="torque_of_lost_motion", title="torque of the lost motion", unit="N m"),
)

SETTINGS = (
    Setting(
        "angle",
        "torsion, output_angle, position",
        "torsion where both angles are there",
        "",
        "the input was locked: output_angle",
    ),
    Setting("torque", "channel", "output_torque", "", "the torque at the output has another name"),
    Setting(
        "at_torque",
        "number",
        "4 % of the amplitude",
        "N m",
        "the catalogue states lost motion at another torque",
    ),
)

EXPERIMENT = Experiment(
    name=NAME,
    title="Hysteresis loops",
    summary="stiffness, loss and lost motion from loops of output torque",
    parameters=NoParameters,
    plan=no_plan,
    analyse=Deferred("experiments.recordings.hysteresis.analysis:analyse"),
    asks=Need(channels=(ANGLES, ("output_torque", *TORQUES))),
    needs=(),
    has_plan=False,
    quantities=QUANTITIES,
    version=4,
    settings=SETTINGS,
)
