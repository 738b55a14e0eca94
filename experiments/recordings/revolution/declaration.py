"""Fourier series per revolution: what comes of it, and what it asks of a recording."""

from __future__ import annotations

from experiments.contract import Deferred, Experiment, NoParameters, no_plan
from experiments.need import ANGLES, MEASURED, Need
from experiments.quantity import (
    OF_CHANNEL_DIFFERENCES,
    Quantity,
)
from experiments.setting import Setting

NAME = "revolution"

QUANTITIES = (
    Quantity(
        name="forward_amplitude_{order}",
        title="order {order} forward, amplitude",
        unit="",
        rests_on=OF_CHANNEL_DIFFERENCES,
    ),
    Quantity(
        name="reverse_amplitude_{order}",
        title="order {order} reverse, amplitude",
        unit="",
        rests_on=OF_CHANNEL_DIFFERENCES,
    ),
    Quantity(
        name="amplitude_{order}",
        title="order {order}, amplitude",
        unit="",
        rests_on=OF_CHANNEL_DIFFERENCES,
    ),
    Quantity(
        name="phase_{order}", title="order {order}, phase", unit="rad", shown="°", is_circular=True
    ),
    Quantity(name="mean", title="mean", unit="", is_signed=True, rests_on=OF_CHANNEL_DIFFERENCES),
    Quantity(
        name="friction",
        title="friction",
        unit="",
        definition="half the difference of the directions",
        rests_on=OF_CHANNEL_DIFFERENCES,
    ),
    Quantity(
        name="direction_shift",
        title="direction shift",
        unit="rad",
        definition="angle by which the series of the directions are shifted",
        is_signed=True,
    ),
    Quantity(name="residual_rms", title="residual rms", unit=""),
    Quantity(name="samples", title="samples", unit="1"),
    Quantity(name="candidates", title="candidates", unit="1"),
    Quantity(name="revolutions", title="revolutions", unit="1"),
)

SETTINGS = (
    Setting(
        "channel", "channel", "the torque, force or current that is there", "", "there are several"
    ),
    Setting("angle", "input_angle, position", "the one that is there", "", "both are there"),
    Setting(
        "highest_order", "whole number", "200", "", "fewer rows in a revolution, or teeth beyond it"
    ),
)

EXPERIMENT = Experiment(
    name=NAME,
    title="Fourier series per revolution",
    summary="Fourier series of a channel per revolution, both ways",
    parameters=NoParameters,
    plan=no_plan,
    analyse=Deferred("experiments.recordings.revolution.analysis:analyse"),
    asks=Need(channels=(ANGLES, MEASURED), time=False, revolutions=True),
    needs=(),
    has_plan=False,
    cuts_gaps=True,
    quantities=QUANTITIES,
    version=6,
    settings=SETTINGS,
)
"""Version 3: the estimator of the order spectrum; directions that differ apart, lines between whole orders fitted.
Version 4: an interval that holds zero is called so, whatever the quantity.
Version 6: no slope beside the orders of an output angle of a stated ratio.
"""
