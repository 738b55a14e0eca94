"""What a velocity-step run finds: the torsional mode, inertia and stiffness behind it, and figures of merit."""

from __future__ import annotations

from experiments.quantity import (
    OF_ANGLES,
    OF_TORQUE_DIFFERENCES,
    Quantity,
)

NAME = "velocity-steps"

_STIFFNESS_REASON = "half of the 20 % by which the stiffness of gears of one series differs"
_DAMPING_REASON = "half of the 2 % that such gears have"
_FREQUENCY_REASON = "as far as speeds are kept clear of resonances"

ESTIMATES = (
    Quantity(
        name="stiffness_over_inertia",
        title="secant stiffness over inertia K/J_o",
        unit="1/s2",
        definition="torque over torsion between reversals at +-T1/4 at the output, over the output's inertia",
        conditions=("part", "mounting"),
        target_share=0.1,
        target_reason=_STIFFNESS_REASON,
        is_key=True,
        is_watched=True,
        is_alarmed=True,
        rests_on=OF_ANGLES,
    ),
    Quantity(
        name="stiffness_over_inertia_{way}",
        title="stiffness over inertia {way}",
        unit="1/s2",
        target_share=0.1,
        target_reason=_STIFFNESS_REASON,
        is_key=True,
        rests_on=OF_ANGLES,
    ),
    Quantity(
        name="mode_squared",
        title="square of the mode's angular frequency",
        unit="1/s2",
        definition="(2 pi f_1)^2 of the pole from input to output angle; damping raises it above K/J_o",
        target_share=0.1,
        target_reason=_STIFFNESS_REASON,
        rests_on=OF_ANGLES,
    ),
    Quantity(
        name="damping_ratio",
        title="damping ratio",
        unit="1",
        definition="of the first torsional mode, at a torque amplitude of T1/4, without what the bench's bearing damps",
        target_uncertainty=0.01,
        target_reason=_DAMPING_REASON,
        is_key=True,
        rests_on=OF_ANGLES,
    ),
    Quantity(
        name="damping_ratio_{way}",
        title="damping ratio {way}",
        unit="1",
        target_uncertainty=0.01,
        target_reason=_DAMPING_REASON,
        is_key=True,
        rests_on=OF_ANGLES,
    ),
    Quantity(
        name="frequency",
        title="frequency",
        unit="Hz",
        definition="of the first torsional mode, at a torque amplitude of T1/4 at the output",
        target_share=0.05,
        target_reason=_FREQUENCY_REASON,
        is_key=True,
        rests_on=OF_ANGLES,
    ),
    Quantity(
        name="frequency_{way}",
        title="frequency {way}",
        unit="Hz",
        target_share=0.05,
        target_reason=_FREQUENCY_REASON,
        rests_on=OF_ANGLES,
    ),
    Quantity(
        name="output_inertia",
        title="output inertia",
        unit="kg m2",
        target_share=0.1,
        target_reason="checks a stated inertia before stiffness is computed from it",
        rests_on=OF_TORQUE_DIFFERENCES,
    ),
    Quantity(
        name="input_inertia", title="input inertia", unit="kg m2", rests_on=OF_TORQUE_DIFFERENCES
    ),
    Quantity(
        name="output_stiffness",
        title="output stiffness",
        unit="N m/rad",
        definition="K/J_o times the inertia from torque: secant, at a torque amplitude of T1/4",
        target_share=0.2,
        target_reason="catalogues state stiffness as a mean with a scatter of 20 to 30 %",
        rests_on=OF_TORQUE_DIFFERENCES,
    ),
)

METRICS = (
    Quantity(name="steps", title="steps", unit="1"),
    Quantity(name="resolvable_steps", title="resolvable steps", unit="1"),
    Quantity(name="median_skill", title="median skill", unit="1"),
    Quantity(name="median_skill_rigid", title="median skill rigid", unit="1"),
    Quantity(name="median_skill_speed", title="median skill speed", unit="1"),
    Quantity(name="median_skill_speed_rigid", title="median skill speed rigid", unit="1"),
    Quantity(name="median_mse_speed", title="median MSE speed", unit="1"),
    Quantity(name="left_out_{rung}", title="left by {rung} on steps left out", unit="rad"),
    Quantity(name="torque_amplitude", title="torque amplitude", unit="N m"),
    Quantity(name="largest_torque", title="largest torque in the gear", unit="N m"),
    Quantity(name="skew", title="skew of the encoders", unit="s"),
    Quantity(
        name="output_bearing_damping_subtracted",
        title="damping of the output bearing, subtracted",
        unit="1",
    ),
)

SCORES = (
    Quantity(name="frequency_of_the_set", title="frequency of the set", unit="Hz"),
    Quantity(name="damping_of_the_set", title="damping of the set", unit="1"),
)
"""Of a given parameter set, nothing fitted."""

QUANTITIES = (*ESTIMATES, *METRICS, *SCORES)
