"""The definitions by which a report's quantities are to be read, and what a rig of this kind cannot measure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

PAPER = (
    "Zou, Tao, Jiang, Mei, Wu: A harmonic drive model considering geometry and internal "
    "interaction. Proc IMechE Part C: "
    "Journal of Mechanical Engineering Science (2015), DOI 10.1177/0954406215621097"
)

DEFINITIONS: tuple[tuple[str, tuple[str, ...], str], ...] = (
    (
        "Kinematic error",
        ("kinematic-error", "velocity-steps"),
        "Difference between the output angle and the input angle divided by the ratio, as a "
        "function of the input angle. "
        "Positive means that the output leads in the direction of travel.",
    ),
    (
        "Transmission accuracy",
        ("kinematic-error",),
        "Sum of the largest positive and the largest negative deviation of the output from the ideal over one complete "
        "output revolution, one direction. It is taken from the fitted curve up to the stated "
        "order; the raw peak-to-peak, "
        "which holds quantisation and noise, stands beside it.",
    ),
    (
        "Normalised mean square error (MSE)",
        ("kinematic-error", "velocity-steps"),
        "Equation 22: 100 times the mean squared deviation of the fit over the variance of "
        "the measured curve. 100 is no "
        "better than the mean, below 5 is good, below 1 is excellent. It is computed on the "
        "curve averaged per bin of the "
        "input angle; the value on raw samples is given where it was computed.",
    ),
    (
        "No-load running torque",
        ("friction", "warm-up"),
        "Torque that keeps the input turning at a defined constant speed with nothing on the "
        "output, averaged over whole "
        "wave-generator revolutions.",
    ),
    (
        "No-load starting torque",
        ("starting-torque",),
        "Quasi-static torque at which the input begins to turn, with nothing on the output.",
    ),
    (
        "Motor + gear",
        ("friction", "warm-up", "starting-torque"),
        "The torque monitor shows the friction of motor and gear together. Only a tare (the same motor with the gear "
        "removed) separates them; without it the results are those of the pair.",
    ),
    (
        "Friction parameters",
        ("friction",),
        "Parameters of the Stribeck curve of the tooth mesh, equation 19: Coulomb friction F_c, static friction F_s, "
        "Stribeck velocity v_s, shape σ, viscous coefficient c_v. Their size depends on the "
        "torque balance by which the "
        "mesh force is referred to the input; the balance used is named in the provenance.",
    ),
    (
        "Dynamic stiffness over inertia, K/J",
        ("velocity-steps",),
        "Square of the frequency of the pole from input to output angle. A stiffness taken from it is dynamic and for "
        "small signals; it is not the static torsional stiffness of the catalogue.",
    ),
    (
        "Skill",
        ("velocity-steps",),
        "One minus the squared error of the model over that of a null model (a rigid gear; a "
        "rigid gear with the kinematic "
        "error). Zero is no better than the null model, one is perfect.",
    ),
    (
        "Identifiable",
        (),
        "Whether the data can tell the parameter at all: “yes”; “weakly”, where the interval is wide or rests on an "
        "assumption; “no”, where the number must not be used.",
    ),
    (
        "Uncertainty",
        (),
        "U is the expanded uncertainty with coverage factor k = 2, from the budget: type A "
        "from the scatter of the data, "
        "type B from elsewhere (scales, zeros, encoders, tare). The 95 % interval holds the statistical part alone.",
    ),
    (
        "Verdict",
        (),
        "PASS and FAIL where the limit lies outside value ± U, MARGINAL where it lies inside. "
        "A limit that is only assumed "
        "or recalled from memory gives “no verified limit”, never PASS or FAIL.",
    ),
)
"""Term, the kinds of fit that need it (none: every report), definition."""

NOT_MEASURED = (
    "Hysteresis loss, lost motion, static torsional stiffness, back-driving torque and "
    "efficiency under load: they need a "
    "locked input or a driven output with an output-torque sensor.",
    "The eccentricity of the output encoder apart from the gear's own error once per output revolution, and the motor "
    "encoder's errors once and twice per revolution apart from the gear's input orders 1 and 2: only their sums are "
    "measured. A second run with an encoder re-clocked would separate them.",
    "The stiffnesses of tooth mesh, bearing and cup one by one: only their combination shows at the output.",
)
"""What no analysis of these runs can give, whatever the data."""


def definitions_for(kinds: Iterable[str]) -> tuple[tuple[str, str], ...]:
    """The definitions that a report on these kinds of fit needs."""
    present = set(kinds)
    return tuple(
        (term, text) for term, needed, text in DEFINITIONS if not needed or present & set(needed)
    )


PAPER_FIGURES: Mapping[str, tuple[str, str]] = {
    "9": ("friction torque at the input over speed", "friction"),
    "12": ("kinematic error over the input angle", "kinematic-error"),
    "13": ("fitted kinematic error and its orders", "kinematic-error"),
    "16": ("friction torque and kinematic error over the wave-generator angle", "kinematic-error"),
    "17": ("measured and fitted friction torque, both directions", "friction"),
    "19": ("output speed after velocity steps, simulated and measured", "velocity-steps"),
}
"""The paper's figures: what each shows, and the protocol whose run it is made from."""
