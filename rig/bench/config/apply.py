"""What a configuration says of gear, motor and limits, as the plan of a run takes it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from model.errors import ModelError
from model.gear import HarmonicDrive, Origin
from model.gear_file import load_gear, shipped_gear
from model.motor import ServoMotor, load_motor, shipped_motor
from model.units import RPM
from rig.bench import limits as lim
from rig.bench.config.drives import ReferenceDrive
from rig.bench.config.load import load_configuration
from rig.bench.config.schema import Ratings, RigConfiguration
from rig.errors import ConfigurationError

LIMITED: Mapping[str, tuple[str, float]] = {
    "motor_torque_n_m": (lim.MOTOR_TORQUE, 1.0),
    "rms_torque_n_m": (lim.RMS_TORQUE, 1.0),
    "torsion_torque_n_m": (lim.TORSION_TORQUE, 1.0),
    "input_speed_rpm": (lim.INPUT_SPEED, RPM),
    "average_speed_rpm": (lim.AVERAGE_SPEED, RPM),
    "acceleration_rad_s2": (lim.ACCELERATION, 1.0),
    "deceleration_rad_s2": (lim.DECELERATION, 1.0),
    "quick_stop_deceleration_rad_s2": (lim.QUICK_STOP_DECELERATION, 1.0),
    "housing_temperature_deg_c": (lim.HOUSING_TEMPERATURE, 1.0),
}
"""Word of the configuration: the quantity that it limits, and the factor to SI."""

RATED: Mapping[str, tuple[str, float]] = {
    "repeated_peak_torque_n_m": ("repeated_peak_torque", 1.0),
    "momentary_peak_torque_n_m": ("momentary_peak_torque", 1.0),
    "maximum_input_speed_rpm": ("maximum_input_speed", RPM),
    "average_input_speed_rpm": ("average_input_speed", RPM),
}
"""Word of the configuration: the rating that it replaces, and the factor to SI."""


@dataclass(frozen=True)
class ConfiguredRig:
    """A configuration read, with the gear and the motor that it names and its limits by quantity (SI)."""

    path: Path
    configuration: RigConfiguration
    gear: HarmonicDrive
    motor: ServoMotor
    limits: Mapping[str, float]

    @property
    def output_bearing(self) -> dict[str, Any]:
        """The bench's output bearing as run files carry it; empty where the file says nothing."""
        own = self.configuration.output_bearing
        if own is None:
            return {}
        return {
            "coulomb": own.friction_n_m,
            "coulomb_u": own.uncertainty_n_m,
            "viscous": own.viscous_n_m_s,
            "viscous_u": own.viscous_uncertainty_n_m_s,
            "source": f"{own.source}, {own.date}",
        }


def configured_rig(path: str | Path) -> ConfiguredRig:
    """Everything that a plan needs of a configuration. Raises `ConfigurationError` with file, path,
    value and reason.
    """
    path = Path(path)
    configuration = load_configuration(path)
    rig, folder = configuration.rig, path.parent
    try:
        gear = (
            load_gear(folder / rig.gear) if rig.gear.endswith(".toml") else shipped_gear(rig.gear)
        )
        if rig.motor.endswith(".toml"):
            motor = load_motor(folder / rig.motor)
        else:
            motor = shipped_motor(rig.motor)
        gear = with_ratings(gear, configuration.ratings)
    except ModelError as error:
        raise ConfigurationError(
            f"the parameter sets that it names cannot be used: {error}", where=str(path)
        ) from error
    return ConfiguredRig(path, configuration, gear, motor, configured_limits(configuration))


def limits_by_hand(path: Path | None) -> str:
    """The limits that somebody has set in a drive that does not tell them, in the words in which they are confirmed
    when the rig is armed; empty where the drive tells them, and where no file describes a rig: none can be armed then.
    """
    if path is None or not path.is_file():
        return ""
    drive = load_configuration(path).drive
    return drive.limits_by_hand.words if isinstance(drive, ReferenceDrive) else ""


def configured_limits(configuration: RigConfiguration) -> dict[str, float]:
    """Limits by quantity in SI; those that were set in the amplifier by hand are among them."""
    limits = {
        quantity: factor * value
        for word, (quantity, factor) in LIMITED.items()
        if (value := getattr(configuration.limits, word)) is not None
    }
    drive = configuration.drive
    if isinstance(drive, ReferenceDrive):
        held = drive.limits_by_hand.drive_limits
        for quantity, value in ((lim.MOTOR_TORQUE, held.torque), (lim.INPUT_SPEED, held.speed)):
            limits[quantity] = min(value, limits.get(quantity, value))
    return limits


def with_ratings(gear: HarmonicDrive, ratings: Ratings) -> HarmonicDrive:
    """The gear with the ratings of its nameplate. Raises `ParameterError` where they contradict each other."""
    given = {
        name: factor * value
        for word, (name, factor) in RATED.items()
        if (value := getattr(ratings, word)) is not None
    }
    if not given:
        return gear
    origin = Origin("catalogue", ratings.source)
    origins = {**gear.origins, **{f"ratings.{name}": origin for name in given}}
    return dataclasses.replace(
        gear, ratings=dataclasses.replace(gear.ratings, **given), origins=MappingProxyType(origins)
    )
