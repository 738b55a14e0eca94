"""A complete parameter set of a servo motor of which the nameplate is known, and what contradicts itself in one.

No table of motors comes with the program: what is not stated is scaled from the shipped SGMJV-02 by
similarity and marked as assumed. With the rated torque T of two motors of one build,

    peak torque ~ T      friction ~ T      inertia ~ T^(5/3)  (T ~ L^3, J ~ L^5)
    rated current = T/K_T, peak current = peak torque/K_T; speeds and K_T as of the pattern
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from types import MappingProxyType

from model.catalogue.contradictions import Contradiction
from model.errors import ParameterError
from model.gear import Origin
from model.motor import ServoMotor, shipped_motor

PATTERN = "sgmjv-02"
"""The shipped motor whose proportions are taken."""
_POWERS = {
    "peak_torque": 1.0,
    "coulomb_friction": 1.0,
    "viscous_friction": 1.0,
    "rotor_inertia": 5.0 / 3.0,
    "rated_speed": 0.0,
    "maximum_speed": 0.0,
}
"""Power of the rated torque with which each number grows among motors of one build."""

NAMEPLATE = (
    "rated_torque",
    "peak_torque",
    "rated_speed",
    "maximum_speed",
    "rotor_inertia",
    "torque_constant",
    "rated_current",
    "peak_current",
)
"""What a motor's plate or data sheet says."""


def motor_named(name: str, stated: Mapping[str, float], origin: Origin) -> ServoMotor:
    """The motor of a name with what its plate says [SI]. Raises `ParameterError` without the rated torque."""
    if not name.strip():
        raise ParameterError("is no name", where="name", value=repr(name), limit="text")
    if "rated_torque" not in stated:
        raise ParameterError(
            "has to be stated: everything else is scaled by it",
            where="motor.rated_torque",
            remedy='Read it from the plate: --set rated_torque="0.637 N m".',
        )
    pattern = shipped_motor(PATTERN)
    values = dict(stated)
    origins = dict.fromkeys(stated, origin)
    share = stated["rated_torque"] / pattern.rated_torque

    def assume(field: str, value: float, words: str) -> None:
        if field not in values:
            values[field] = value if value == getattr(pattern, field) else float(f"{value:.5g}")
            origins[field] = Origin("assumed", words)

    for field, power in _POWERS.items():
        how = f"times {share:.4g}^{power:.3g}, by rated torque" if power else "as it stands"
        assume(field, getattr(pattern, field) * share**power, f"{pattern.name} {how}")
    if "rated_current" in values:
        constant, words = values["rated_torque"] / values["rated_current"], "rated torque/current"
    else:
        constant, words = pattern.torque_constant, f"as of {pattern.name}"
    assume("torque_constant", constant, words)
    for field, torque in (("rated_current", "rated_torque"), ("peak_current", "peak_torque")):
        assume(field, values[torque] / values["torque_constant"], f"{torque} over torque constant")
    return ServoMotor(name=name.strip(), **values, origins=MappingProxyType(origins))


def open_questions(motor: ServoMotor) -> tuple[str, ...]:
    """Of the plate's values those that are only assumed or recalled."""
    return tuple(
        name for name in NAMEPLATE if motor.origins[name].provenance in ("assumed", "recalled")
    )


def motor_contradictions(motor: ServoMotor) -> tuple[Contradiction, ...]:
    """Everything in a motor's set that cannot be true together."""
    return tuple(_contradictions(motor))


def _contradictions(motor: ServoMotor) -> Iterator[Contradiction]:
    units = {f.name: f.metadata["unit"] for f in dataclasses.fields(motor) if f.metadata}
    for name, field, low, high, of, remedy in _proportions(motor):
        value, unit = getattr(motor, field), units[field]
        if not low <= value / of <= high:
            yield Contradiction(
                name,
                f"motor.{field}",
                f"{value:.4g} {unit}",
                f"{low * of:.4g} to {high * of:.4g} {unit}",
                remedy,
            )
    friction = motor.coulomb_friction + motor.viscous_friction * motor.rated_speed
    if friction > 0.3 * motor.rated_torque:
        yield Contradiction(
            "friction against rated torque",
            "motor.coulomb_friction",
            f"{friction:.4g} N m at rated speed",
            f"<= {0.3 * motor.rated_torque:.4g} N m, a third of the rated torque",
            "Check the units of Coulomb and viscous friction.",
        )


def _proportions(motor: ServoMotor) -> tuple[tuple[str, str, float, float, float, str], ...]:
    """What lies between two multiples of something else: name, number, multiples, what of, and what to check."""
    law = shipped_motor(PATTERN)
    inertia = (
        law.rotor_inertia * (motor.rated_torque / law.rated_torque) ** _POWERS["rotor_inertia"]
    )
    return (
        (
            "torque constant against rated current",
            "rated_torque",
            0.75,
            1.25,
            motor.torque_constant * motor.rated_current,
            "T = K_T I: check whether currents are r.m.s. or peak values, a factor of 1.41.",
        ),
        (
            "torque constant against peak current",
            "peak_torque",
            0.6,
            1.25,
            motor.torque_constant * motor.peak_current,
            "T = K_T I, less where iron saturates: check r.m.s. or peak, a factor of 1.41.",
        ),
        (
            "peak against rated torque",
            "peak_torque",
            1.2,
            6.0,
            motor.rated_torque,
            "Servo motors have 2 to 4 times: check both.",
        ),
        (
            "maximum against rated speed",
            "maximum_speed",
            1.0,
            3.0,
            motor.rated_speed,
            "Check whether one of the two is in rad/s.",
        ),
        (
            "rotor's inertia against rated torque",
            "rotor_inertia",
            0.1,
            10.0,
            inertia,
            "Check its unit: data sheets print 1e-4 kg m2 = kg cm2.",
        ),
    )
