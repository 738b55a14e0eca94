"""The servo motor that turns the wave generator, as a frozen parameter set in SI.

Only what the rig's simulation, the plans and the reports need: ratings, rotor inertia, its own
friction (what the torque port shows besides the gear), and the torque constant. Numbers live in
`model/motors/*.toml`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

from model import quantities
from model.errors import ParameterError
from model.gear import Origin
from model.sections import Section, quantity

FORMAT = "servo-motor-1"
"""The value of `format` in the files of a motor."""


@dataclass(frozen=True, kw_only=True)
class ServoMotor(Section):
    """One servo motor; torques and speeds at its shaft, friction of motor and seal alone (gear removed)."""

    section = "motor"
    name: str
    rated_torque: float = quantity("N m", "rated torque", symbol="T_rated", above=0.0, high=1e3)
    peak_torque: float = quantity(
        "N m", "instantaneous peak torque", symbol="T_peak", above=0.0, high=1e4
    )
    rated_speed: float = quantity("rad/s", "rated speed", symbol="n_rated", above=0.0, high=1e4)
    maximum_speed: float = quantity("rad/s", "maximum speed", symbol="n_max", above=0.0, high=1e4)
    rotor_inertia: float = quantity(
        "kg m2", "inertia of the rotor", symbol="J_m", above=0.0, high=1.0
    )
    coulomb_friction: float = quantity(
        "N m", "Coulomb friction of motor and seal", symbol="T_c,m", low=0.0, high=10.0
    )
    viscous_friction: float = quantity(
        "N m s/rad", "viscous friction of motor and seal", symbol="c_m", low=0.0, high=1.0
    )
    torque_constant: float = quantity(
        "N m/A", "torque per current (r.m.s.)", symbol="K_T", above=0.0, high=100.0
    )
    rated_current: float = quantity(
        "A", "rated current (r.m.s.)", symbol="I_rated", above=0.0, high=1e3
    )
    peak_current: float = quantity(
        "A", "instantaneous peak current (r.m.s.)", symbol="I_peak", above=0.0, high=1e4
    )
    origins: Mapping[str, Origin] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        Section.__post_init__(self)
        for smaller, larger in (("rated_torque", "peak_torque"), ("rated_speed", "maximum_speed")):
            if getattr(self, larger) < getattr(self, smaller):
                limit = f">= motor.{smaller} = {getattr(self, smaller):g}"
                self._refuse(larger, limit, "is too small")

    def stated_friction(self) -> dict[str, Any]:
        """What this card states of the motor's own friction, as run files keep it: `coulomb` [N m], `viscous`
        [N m s/rad], each with its standard uncertainty (None where none is stated), and the source.
        """
        coulomb, viscous = (
            self.origins.get(f"{part}_friction", Origin("assumed"))
            for part in ("coulomb", "viscous")
        )
        return {
            "coulomb": self.coulomb_friction,
            "coulomb_u": coulomb.standard_uncertainty,
            "viscous": self.viscous_friction,
            "viscous_u": viscous.standard_uncertainty,
            "source": coulomb.source,
        }


def shipped_motor(name: str = "sgmjv-02") -> ServoMotor:
    """A motor that comes with the program; raises `ParameterError` for an unknown name, listing those there are."""
    return motor_from_mapping(quantities.read_shipped("motor", name), f"{name}.toml")


def load_motor(path: str | Path) -> ServoMotor:
    """The motor of a parameter file; raises `ParameterError` with file, path of the value, value and allowed range."""
    return motor_from_mapping(quantities.read_toml(path), str(path))


def save_motor(motor: ServoMotor, path: str | Path) -> None:
    """Write a parameter file that reads back to exactly this motor."""
    quantities.write_text(_motor_to_toml(motor), path)


def _motor_to_toml(motor: ServoMotor) -> str:
    """The motor as the text of a parameter file."""
    lines = [
        "# Parameters of a servo motor. Every line holds value, unit, provenance and source.",
        f"format = {quantities.quote(FORMAT)}",
        f"name = {quantities.quote(motor.name)}",
        "",
        "[motor]",
        *quantities.section_lines(motor, motor.origins),
    ]
    return "\n".join(lines) + "\n"


def motor_from_mapping(mapping: Mapping[str, Any], where: str) -> ServoMotor:
    """The motor of plain data (a parsed TOML file)."""
    try:
        if not quantities.is_table(mapping) or mapping.get("format") != FORMAT:
            remedy = "Is this the parameter file of a motor?"
            raise ParameterError(
                "is not the format of a motor", where="format", limit=f'"{FORMAT}"', remedy=remedy
            )
        quantities.check_keys(mapping, ("format", "name", "motor"), "")
        name = mapping.get("name")
        if not isinstance(name, str) or not name.strip():
            raise ParameterError(
                "is not a name", where="name", value=quantities.shorten(name), limit="text"
            )
        arguments, origins = quantities.read_section(ServoMotor, mapping.get("motor", {}), "motor")
        return ServoMotor(name=name, **arguments, origins=MappingProxyType(origins))
    except ParameterError as error:
        raise quantities.within(error, where) from error
