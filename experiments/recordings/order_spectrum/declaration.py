"""Order spectrum: what comes of it, and what it asks of a recording."""

from __future__ import annotations

from experiments.contract import Deferred, Experiment, NoParameters, no_plan
from experiments.need import ANGLES, MEASURED, Need
from experiments.quantity import (
    Quantity,
)

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

EXPERIMENT = Experiment(
    name=NAME,
    title="Order spectrum",
    summary="order spectrum of a channel over an angle",
    parameters=NoParameters,
    plan=no_plan,
    analyse=Deferred("experiments.recordings.order_spectrum.analysis:analyse"),
    asks=Need(channels=(ANGLES, MEASURED), revolutions=True),
    needs=(),
    has_plan=False,
    cuts_gaps=True,
    quantities=QUANTITIES,
    version=6,
)
"""Version 3: one least squares at the samples' own angles, orders refined between lines, directions apart.
Version 6: no slope beside the orders of the kinematic error of a stated ratio.
"""
