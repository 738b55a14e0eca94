"""What a friction run finds: running torque, Stribeck parameters, and figures of merit."""

from __future__ import annotations

from collections.abc import Mapping

from experiments.quantity import (
    ANGLES_IN_ITS_BUDGET,
    OF_CHANNEL_DIFFERENCES,
    Counterpart,
    Dependence,
    Quantity,
)
from experiments.shape import Shape

CATALOGUE_SPEEDS_RPM = (500.0, 1000.0, 2000.0, 3500.0)
"""Input speeds at which catalogues give the no-load running torque."""

_OF_THE_READING: Mapping[str, Dependence] = {"channel": "proportional", **ANGLES_IN_ITS_BUDGET}
"""Half-sums of the directions: what is not known of the zero is in them in full."""

_AT_REFERENCE = "_at_20_degrees"


def at_reference(name: str) -> str:
    """The name of a quantity's value at 20 degC."""
    return name + _AT_REFERENCE


ESTIMATES = (
    Quantity(
        name="running_torque_{speed}_rpm",
        title="running torque {speed} r/min",
        heading="No-load running torque at {speed} r/min",
        axis="running torque",
        unit="N m",
        shown="mN m",
        definition="torque that keeps the input turning at this speed, nothing on the output",
        conditions=("part", "mounting", "torque of", "channel"),
        target_uncertainty=0.01,
        target_reason="a tenth of what catalogues state for this size, 0.1 N m",
        is_key=True,
        is_watched=True,
        watched_members=tuple(f"{speed:.0f}" for speed in CATALOGUE_SPEEDS_RPM),
        is_alarmed=True,
        alarmed_members=("1000",),
        catalogue=Counterpart(
            rating="running_torque",
            definition="torque that keeps the input turning at a constant speed, nothing on the output",
            conditions="nothing on the output, at a stated speed and temperature (20 °C), the maker's grease "
            "in its standard quantity, ratio 100 (others are corrected for)",
        ),
        rests_on=OF_CHANNEL_DIFFERENCES,
    ),
    Quantity(
        name="coulomb",
        title="Coulomb friction",
        unit="N",
        target_uncertainty=15.0,
        target_elsewhere=0.2,
        target_reason="tells gears of one series apart: they differ by 20 % of some 70 N; "
        "about 10 mN m of torque at the input",
        is_key=True,
        rests_on=OF_CHANNEL_DIFFERENCES,
    ),
    Quantity(
        name="static",
        title="static friction",
        unit="N",
        target_uncertainty=20.0,
        target_elsewhere=0.2,
        target_reason="as of Coulomb friction, for a force a third larger",
        is_key=True,
        rests_on=OF_CHANNEL_DIFFERENCES,
    ),
    Quantity(
        name="stribeck_velocity",
        title="Stribeck velocity",
        unit="rad/s",
        target_share=0.5,
        target_reason="says within a factor of two where friction is least",
        is_key=True,
        rests_on=ANGLES_IN_ITS_BUDGET,
    ),
    Quantity(
        name="viscous",
        title="viscous friction",
        unit="N s/rad",
        target_uncertainty=0.05,
        target_elsewhere=0.3,
        target_reason="10 mN m of torque at the input at 3500 r/min and ratio 120",
        is_key=True,
        rests_on=OF_CHANNEL_DIFFERENCES,
    ),
    Quantity(
        name="shape",
        title="shape coefficient",
        unit="1",
        target_uncertainty=0.5,
        target_reason="tells an exponential (1) from a bell-shaped (2) Stribeck curve",
        rests_on=ANGLES_IN_ITS_BUDGET,
    ),
    Quantity(
        name=at_reference("running_torque_{speed}_rpm"),
        title="running torque {speed} r/min at 20 °C",
        unit="N m",
        shown="mN m",
        definition="the same brought to 20 °C, with the uncertainty of the temperature coefficients",
        rests_on=OF_CHANNEL_DIFFERENCES,
    ),
    *(
        Quantity(
            name=at_reference(name),
            title=f"{title} at 20 °C",
            unit=unit,
            definition="brought to 20 °C, with the uncertainty of the temperature coefficient",
            rests_on=OF_CHANNEL_DIFFERENCES,
        )
        for name, title, unit in (
            ("coulomb", "Coulomb friction", "N"),
            ("static", "static friction", "N"),
            ("viscous", "viscous friction", "N s/rad"),
        )
    ),
    Quantity(
        name="offset",
        title="offset",
        unit="N m",
        definition="half-sum of the directions, extrapolated to standstill: rest of the torque zero",
        is_signed=True,
        rests_on=_OF_THE_READING,
    ),
    Quantity(
        name="asymmetry",
        title="asymmetry",
        unit="N m s/rad",
        definition="growth of the half-sum of the directions with speed",
        is_signed=True,
        rests_on=OF_CHANNEL_DIFFERENCES,
    ),
)

METRICS = (
    Quantity(name="points", title="points", unit="1"),
    Quantity(name="slowest_speed", title="slowest speed", unit="rad/s", shown="r/min"),
    Quantity(name="chi_square", title="chi square", unit="1"),
    Quantity(name="freedom", title="degrees of freedom of the fit", unit="1"),
    Quantity(
        name="birge",
        title="scatter over stated noise (expected 1)",
        unit="1",
        definition="square root of reduced chi-square",
    ),
    Quantity(name="residual_rms", title="residual rms", unit="N m"),
    Quantity(name="relative_rms", title="relative rms", unit="1"),
    Quantity(name="bracket_drift", title="bracket drift", unit="1"),
    Quantity(name="reproducibility", title="reproducibility", unit="1"),
    Quantity(name="torque_zero_drift", title="torque zero drift", unit="N m"),
    Quantity(
        name="friction_over_output_order_{order}",
        title="friction over output order {order}",
        unit="1",
    ),
    Quantity(
        name="scatter_of_points",
        title="scatter of points",
        unit="1",
        definition="relative standard deviation of a point that is measured again",
    ),
    Quantity(
        name="stribeck_dip",
        title="Stribeck dip",
        unit="1",
        definition="(F_s - F_c)/F_c; negative where friction rises from rest",
    ),
    Quantity(
        name="dip_by_chance",
        title="dip by chance",
        unit="1",
        definition="probability that points of a straight line over speed would look as bent",
    ),
    Quantity(
        name="bearing_torque_factor",
        title="bearing torque factor",
        unit="1",
        definition="no-load torque of the wave generator's bearing over that of the parameter set",
    ),
    Quantity(
        name="output_bearing_subtracted",
        title="output bearing subtracted",
        unit="N",
        definition="what the bench's output bearing was taken for in Coulomb friction",
    ),
    Quantity(
        name="output_bearing_viscous_subtracted",
        title="output bearing subtracted, viscous",
        unit="N s/rad",
        definition="what the bench's output bearing was taken for in viscous friction",
    ),
    Quantity(name="dry_friction_per_kelvin", title="dry friction per kelvin", unit="1/K"),
    Quantity(name="viscous_friction_per_kelvin", title="viscous friction per kelvin", unit="1/K"),
    Quantity(name="housing_temperature", title="housing temperature", unit="°C"),
    Quantity(name="housing_temperature_span", title="housing temperature span", unit="K"),
    Quantity(
        name="genetic_chi_square_excess",
        title="genetic chi square excess",
        unit="1",
        definition="how far the paper's genetic search stays behind variable projection",
    ),
    Quantity(name="genetic_evaluations", title="genetic evaluations", unit="1"),
    Quantity(name="genetic_coulomb", title="genetic coulomb", unit="N"),
    Quantity(name="genetic_static", title="genetic static", unit="N"),
    Quantity(name="genetic_stribeck_velocity", title="genetic stribeck velocity", unit="rad/s"),
    Quantity(name="genetic_shape", title="genetic shape", unit="1"),
    Quantity(name="genetic_viscous", title="genetic viscous", unit="N s/rad"),
)

SCORES = (
    Quantity(name="mse", title="MSE (22)", unit="1"),
    Quantity(name="mean_residual", title="mean residual", unit="N m"),
    Quantity(name="skill_against_mean", title="skill against mean", unit="1"),
    Quantity(name="skill_against_straight_line", title="skill against straight line", unit="1"),
)
"""Of a given parameter set, nothing fitted."""

QUANTITIES = (*ESTIMATES, *METRICS, *SCORES)

CURVE = Shape(
    title="friction over speed",
    numbers=5,
    names=(
        *("coulomb", "static", "stribeck_velocity", "shape", "viscous"),
        *(at_reference(name) for name in ("coulomb", "static", "viscous")),
    ),
    labels=("hold", "bracket"),
    needs_repeats=True,
)
"""The Stribeck curve through the holds, reference speed included."""
