"""What a velocity-step run finds: the torsional mode, inertia and stiffness behind it, and figures of merit."""

from __future__ import annotations

from experiments.quantity import Quantity

ESTIMATES = (
    Quantity(
        name="stiffness_over_inertia",
        title="secant stiffness over inertia K/J_o",
        unit="1/s2",
        definition="torque over torsion between reversals at +-T1/4 at the output, over the output's inertia",
        is_key=True,
    ),
    Quantity(
        name="stiffness_over_inertia_{way}",
        title="stiffness over inertia {way}",
        unit="1/s2",
        is_key=True,
    ),
    Quantity(
        name="mode_squared",
        title="square of the mode's angular frequency",
        unit="1/s2",
        definition="(2 pi f_1)^2 of the pole from input to output angle; damping raises it above K/J_o",
    ),
    Quantity(
        name="damping_ratio",
        title="damping ratio",
        unit="1",
        definition="of the first torsional mode, at a torque amplitude of T1/4",
        is_key=True,
    ),
    Quantity(name="damping_ratio_{way}", title="damping ratio {way}", unit="1", is_key=True),
    Quantity(
        name="frequency",
        title="frequency",
        unit="Hz",
        definition="of the first torsional mode, at a torque amplitude of T1/4 at the output",
        is_key=True,
    ),
    Quantity(name="frequency_{way}", title="frequency {way}", unit="Hz"),
    Quantity(name="output_inertia", title="output inertia", unit="kg m2"),
    Quantity(name="input_inertia", title="input inertia", unit="kg m2"),
    Quantity(
        name="output_stiffness",
        title="output stiffness",
        unit="N m/rad",
        definition="K/J_o times the inertia from torque: secant, at a torque amplitude of T1/4",
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
)

SCORES = (
    Quantity(name="frequency_of_the_set", title="frequency of the set", unit="Hz"),
    Quantity(name="damping_of_the_set", title="damping of the set", unit="1"),
)
"""Of a given parameter set, nothing fitted."""

QUANTITIES = (*ESTIMATES, *METRICS, *SCORES)
