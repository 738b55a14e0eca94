"""Friction over speed from a table: what comes of it, and what it asks of a recording."""

from __future__ import annotations

from collections.abc import Mapping

from experiments.contract import Deferred, Experiment, NoParameters, no_plan
from experiments.need import EFFORTS, SPEEDS, Need
from experiments.quantity import Dependence, Quantity
from experiments.setting import Setting

NAME = "friction-curve"

_OF_FORCES: Mapping[str, Dependence] = {"effort": "difference"}

_OF_SPEEDS: Mapping[str, Dependence] = {"speed": "difference"}

_OF_SLOPES: Mapping[str, Dependence] = {**_OF_FORCES, **_OF_SPEEDS}

QUANTITIES = (
    Quantity(name="coulomb", title="Coulomb friction", unit="", is_key=True, rests_on=_OF_FORCES),
    Quantity(name="viscous", title="viscous friction", unit="", is_key=True, rests_on=_OF_SLOPES),
    Quantity(name="static", title="static friction", unit="", is_key=True, rests_on=_OF_FORCES),
    Quantity(
        name="stribeck_velocity",
        title="Stribeck velocity",
        unit="",
        is_key=True,
        rests_on=_OF_SPEEDS,
    ),
    Quantity(name="shape", title="Stribeck shape", unit="1", rests_on={}),
    Quantity(
        name="offset",
        title="offset",
        unit="",
        definition="Half the sum of both directions: zero of the effort, or a friction that differs each way.",
        is_signed=True,
        rests_on={"effort": "proportional"},
    ),
    Quantity(name="coulomb_{way}", title="Coulomb friction {way}", unit="", rests_on=_OF_FORCES),
    Quantity(name="viscous_{way}", title="viscous friction {way}", unit="", rests_on=_OF_SLOPES),
    Quantity(name="static_{way}", title="static friction {way}", unit="", rests_on=_OF_FORCES),
    Quantity(
        name="stribeck_velocity_{way}",
        title="Stribeck velocity {way}",
        unit="",
        rests_on=_OF_SPEEDS,
    ),
    Quantity(name="shape_{way}", title="Stribeck shape {way}", unit="1", rests_on={}),
    Quantity(name="points", title="points", unit="1"),
    Quantity(name="wrong_points", title="points left out as wrong", unit="1"),
    Quantity(name="least_speed", title="speed below which no point is taken", unit=""),
    Quantity(name="hold_out_error", title="error of points not seen", unit=""),
    Quantity(name="scatter", title="scatter about the curve", unit=""),
)

SETTINGS = (
    Setting(
        "law",
        "auto, coulomb, coulomb-viscous, stribeck",
        "auto",
        "",
        "the law is known, or auto takes one too many terms",
    ),
    Setting("speed", "channel", "the speed that is there", "", "there are several"),
    Setting(
        "effort", "channel", "the torque, force or current that is there", "", "there are several"
    ),
    Setting(
        "uncertainty",
        "channel",
        "EFFORT_uncertainty where it is there",
        "",
        "another column holds the uncertainty of the points",
    ),
    Setting(
        "direction", "both, forward, reverse, each", "both", "", "the two directions differ: each"
    ),
    Setting(
        "least_speed",
        "number",
        "0",
        "rad/s or m/s",
        "points near standstill are no friction at speed",
    ),
)

EXPERIMENT = Experiment(
    name=NAME,
    title="Friction over speed from a table",
    summary="friction law of a table of speed and torque: Coulomb, viscous, Stribeck",
    parameters=NoParameters,
    plan=no_plan,
    analyse=Deferred("experiments.recordings.friction_curve.analysis:analyse"),
    asks=Need(channels=(SPEEDS, EFFORTS), time=False, is_table=True),
    needs=(),
    gear_mounted=False,
    has_plan=False,
    quantities=QUANTITIES,
    version=4,
    settings=SETTINGS,
)
