"""Order spectrum: what comes of it, and what it asks of a recording."""

from __future__ import annotations

from experiments.contract import Deferred, Experiment, NoParameters, no_plan
from experiments.need import MEASURED, TURNING, Need
from experiments.quantity import (
    Quantity,
)
from experiments.setting import Setting

NAME = "order-spectrum"

QUANTITIES = (
    Quantity(
        name="forward_amplitude_{order}",
        title="order {order} forward, amplitude",
        unit="",
    ),
    Quantity(
        name="reverse_amplitude_{order}",
        title="order {order} reverse, amplitude",
        unit="",
    ),
    Quantity(
        name="amplitude_{order}",
        title="order {order}, amplitude",
        unit="",
    ),
    Quantity(name="revolutions_{way}", title="revolutions {way}", unit="1"),
)

SETTINGS = (
    Setting(
        "channel",
        "channel",
        "kinematic_error where both angles are there, else the torque",
        "",
        "another channel's orders are asked for",
    ),
    Setting(
        "angle",
        "input_angle, output_angle, nominal_angle",
        "the first that is there",
        "",
        "orders of the output are asked for",
    ),
    Setting("highest_order", "number", "64", "", "orders beyond it are looked for"),
)

EXPERIMENT = Experiment(
    name=NAME,
    title="Order spectrum",
    summary="order spectrum of a channel over an angle",
    parameters=NoParameters,
    plan=no_plan,
    analyse=Deferred("experiments.recordings.order_spectrum.analysis:analyse"),
    asks=Need(channels=(TURNING, MEASURED), revolutions=True),
    needs=(),
    has_plan=False,
    cuts_gaps=True,
    quantities=QUANTITIES,
    version=7,
    settings=SETTINGS,
)
"""Version 3: one least squares at the samples' own angles, orders refined between lines, directions apart.
Version 6: no slope beside the orders of the kinematic error of a stated ratio.
Version 7: an order whose amplitude changes with speed is one line, at the middle speed; its sidelobes are none.
"""
