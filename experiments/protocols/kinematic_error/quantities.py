"""What a kinematic-error run finds: transmission accuracy, orders, the phase of figure 16, and figures of merit."""

from __future__ import annotations

from experiments.quantity import (
    OF_ANGLES,
    OF_TORQUE_DIFFERENCES,
    Counterpart,
    Quantity,
)
from model.units import ARCSEC

_COMPARED_BY = ("part", "mounting", "speed", "orders")
_CATALOGUE = Counterpart(
    rating="transmission_accuracy",
    definition="largest positive plus largest negative deviation of the output from the ideal "
    "over one complete output revolution, one direction",
    conditions="nothing on the output, low speed",
)
_ACCURACY = (
    "sum of the largest positive and the largest negative deviation of the output from the "
    "ideal over one complete output revolution, one direction; of the fitted curve, less what "
    "encoders and mounting add to a peak to peak"
)

_ACCURACY_TARGET = 12.0 * ARCSEC
_ACCURACY_REASON = "a fifth of what catalogues state, 1 arcmin: the usual share of a tolerance"

ESTIMATES = (
    Quantity(
        name="transmission_accuracy",
        title="transmission accuracy",
        unit="rad",
        shown="arcmin",
        definition=_ACCURACY,
        conditions=_COMPARED_BY,
        target_uncertainty=_ACCURACY_TARGET,
        target_reason=_ACCURACY_REASON,
        is_key=True,
        catalogue=_CATALOGUE,
        rests_on=OF_ANGLES,
    ),
    Quantity(
        name="transmission_accuracy_{way}",
        title="transmission accuracy {way}",
        heading="Transmission accuracy, {way}",
        axis="transmission accuracy",
        unit="rad",
        shown="arcmin",
        definition=_ACCURACY,
        conditions=_COMPARED_BY,
        target_uncertainty=_ACCURACY_TARGET,
        target_reason=_ACCURACY_REASON,
        is_key=True,
        is_watched=True,
        watched_members=("forward", "reverse"),
        catalogue=_CATALOGUE,
        rests_on=OF_ANGLES,
    ),
    Quantity(
        name="amplitude_{order}",
        title="order {order}, amplitude",
        heading="Kinematic error, amplitude of order {order}",
        axis="amplitude",
        unit="rad",
        shown="arcsec",
        definition="amplitude of this order of the kinematic error, cycles per input revolution; "
        "mean of both directions",
        conditions=_COMPARED_BY,
        target_uncertainty=6.0 * ARCSEC,
        target_reason="a tenth of the transmission accuracy that catalogues state, 1 arcmin; "
        "an output encoder of 5 arcsec allows it",
        is_key=True,
        key_members=("2", "1"),
        is_watched=True,
        is_alarmed=True,
        alarmed_members=("2",),
        subject="kinematic error",
        rests_on=OF_ANGLES,
    ),
    Quantity(
        name="phase_{order}",
        title="order {order}, phase",
        unit="rad",
        shown="°",
        target_uncertainty=0.5,
        target_reason="carried to another run, it takes away more than half of the order's amplitude",
        is_circular=True,
        rests_on=OF_ANGLES,
    ),
    Quantity(
        name="figure_16_phase_difference",
        title="figure 16 phase difference",
        unit="rad",
        shown="°",
        definition="phase of the friction torque less that of the kinematic error, at the order of figure 16",
        target_uncertainty=0.5,
        target_reason="tells in phase (friction that varies with the depth of mesh) from 90 degrees "
        "(reaction of the error)",
        is_key=True,
        is_circular=True,
        is_signed=True,
        rests_on=OF_ANGLES,
    ),
    Quantity(
        name="figure_16_friction_amplitude",
        title="figure 16 friction amplitude",
        unit="N m",
        rests_on=OF_TORQUE_DIFFERENCES,
    ),
    Quantity(
        name="figure_16_conservative_amplitude",
        title="figure 16 conservative amplitude",
        unit="N m",
        rests_on=OF_TORQUE_DIFFERENCES,
    ),
    Quantity(
        name="figure_16_error_amplitude",
        title="figure 16 error amplitude",
        unit="rad",
        rests_on=OF_ANGLES,
    ),
    Quantity(
        name="lost_motion",
        title="offset between the directions",
        unit="rad",
        definition="forward less reverse: wind-up by friction, and skew between the channels times speed",
        is_signed=True,
        rests_on=OF_ANGLES,
    ),
    Quantity(name="slope", title="slope", unit="rad/rad", is_signed=True, rests_on=OF_ANGLES),
    Quantity(name="ratio", title="ratio", unit="1", rests_on=OF_ANGLES),
)

METRICS = (
    Quantity(name="mse_curve_{way}", title="MSE curve {way}", unit="1"),
    Quantity(
        name="mse_left_out_{way}",
        title="MSE curve {way}, revolutions left out",
        unit="1",
        definition="every second input revolution predicted from the others, and those from it",
    ),
    Quantity(name="harmonics_{way}", title="harmonics fitted {way}", unit="1"),
    Quantity(name="mse_raw_{way}", title="MSE raw {way}", unit="1"),
    Quantity(
        name="raw_peak_to_peak_{way}", title="raw peak to peak {way}", unit="rad", shown="arcmin"
    ),
    Quantity(name="closure_{way}", title="closure {way}", unit="rad", shown="arcmin"),
    Quantity(name="residual_rms_{way}", title="residual rms {way}", unit="rad"),
    Quantity(
        name="left_over_{way}",
        title="residual above its noise {way}",
        unit="rad",
        definition="r.m.s. of what the fitted orders leave, above the noise, up to the highest order",
    ),
    Quantity(
        name="raised_by_bench_{way}",
        title="peak to peak of encoders and mounting {way}",
        unit="rad",
        definition="what they add to a peak to peak, half of what their classes make on average; taken off",
    ),
    Quantity(name="repeatability_{way}", title="repeatability {way}", unit="rad"),
    Quantity(name="input_revolutions_{way}", title="input revolutions {way}", unit="1"),
    Quantity(name="output_revolutions_{way}", title="output revolutions {way}", unit="1"),
    Quantity(name="samples_per_revolution_{way}", title="samples per revolution {way}", unit="1"),
    Quantity(name="samples_{way}", title="samples {way}", unit="1"),
    Quantity(name="condition_{way}", title="condition {way}", unit="1"),
    Quantity(name="agreement_of_directions", title="agreement of directions", unit="rad"),
    Quantity(name="mse_on_other_repeats", title="MSE on other repeats", unit="1"),
    Quantity(
        name="delay",
        title="output read after the input",
        unit="s",
        definition="by the phases of the orders in the two directions; taken out",
    ),
    Quantity(name="margin_to_first_mode", title="margin to first mode", unit="1"),
    Quantity(name="slipped_counts", title="slipped counts", unit="1"),
)

SCORES = (
    Quantity(name="mse_of_the_mean", title="MSE of the mean", unit="1"),
    Quantity(name="mse_free_phase_{traverse}", title="MSE free phase {traverse}", unit="1"),
    Quantity(name="mse_{traverse}", title="MSE {traverse}", unit="1"),
)
"""Of a given parameter set, nothing fitted. The last family would take every MSE: it stands last."""

QUANTITIES = (*ESTIMATES, *METRICS, *SCORES)
