"""What a starting-torque run finds."""

from __future__ import annotations

from experiments.quantity import OF_TORQUE_DIFFERENCES, Counterpart, Quantity

AT_REFERENCE = "starting_torque_at_20_degrees"
"""The name of the value that is brought to 20 degC."""
_DEFINITION = (
    "quasi-static torque at which the input begins to turn, nothing on the output; motor and gear, "
    "without the bench's output bearing; mean over positions on a turn of the output"
)
_COMPARED_BY = ("part", "mounting", "torque of", "channel", "ramp")
_CATALOGUE = Counterpart(
    rating="starting_torque",
    definition="quasi-static torque at which the input begins to turn, nothing on the output",
    conditions="nothing on the output, housing at 20 °C, the unit's own grease",
)
TARGET = 0.015
_TARGET_REASON = "a tenth of what catalogues state for this size at ratio 50, 0.15 N m"
QUANTITIES = (
    Quantity(
        name="starting_torque_{way}",
        title="starting torque {way}",
        unit="N m",
        shown="mN m",
        definition=_DEFINITION,
        conditions=_COMPARED_BY,
        target_uncertainty=TARGET,
        target_reason=_TARGET_REASON,
        is_key=True,
        catalogue=_CATALOGUE,
        is_above_zero=True,
        rests_on=OF_TORQUE_DIFFERENCES,
    ),
    Quantity(
        name="starting_torque",
        title="starting torque",
        heading="No-load starting torque, mean of both directions",
        axis="starting torque",
        unit="N m",
        shown="mN m",
        definition=_DEFINITION,
        conditions=_COMPARED_BY,
        target_uncertainty=TARGET,
        target_reason=_TARGET_REASON,
        is_key=True,
        is_watched=True,
        catalogue=_CATALOGUE,
        is_above_zero=True,
        rests_on=OF_TORQUE_DIFFERENCES,
    ),
    Quantity(
        name=AT_REFERENCE,
        title="starting torque at 20 °C",
        unit="N m",
        shown="mN m",
        definition="brought to 20 °C, with the uncertainty of the temperature coefficient",
        is_above_zero=True,
        rests_on=OF_TORQUE_DIFFERENCES,
    ),
    Quantity(name="ramps", title="ramps", unit="1"),
    Quantity(name="housing_temperature", title="housing temperature", unit="°C"),
    Quantity(name="scatter_of_one_ramp", title="scatter of one ramp", unit="N m"),
    Quantity(
        name="output_bearing_torque",
        title="output bearing, subtracted",
        unit="N m",
        definition="what the bench's output bearing is taken to ask of the input",
    ),
    Quantity(name="largest_starting_torque", title="largest starting torque", unit="N m"),
    Quantity(name="smallest_starting_torque", title="smallest starting torque", unit="N m"),
)
