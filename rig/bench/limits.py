"""The limits of a run in tiers, each with its origin; the tightest one holds.

Three tiers: *drive* (what motor and amplifier can do), *rig* (what the gear on it bears, from its
ratings, the ratio and the load), *protocol* (what this plan needs, with room). Derivations, with N
the mounted ratio, J_i = J_m + J_wg and J_o the inertias at input and output, T_rp the gear's
repeated peak torque, s = 0.8 the share of it that set-points may reach:

    blocked output      T_m N                                   <= s T_rp      (2.23 N m x 120 = 268 N m > 167 N m)
    torque step         2 N T_m (J_o/N^2)/(J_i + J_o/N^2)       <= s T_rp      (undamped: twice the static share)
    acceleration        2 J_o alpha/N                           <= s T_rp      and  (J_i + J_o/N^2) alpha + T_f <= s T_m
    torsion             K |theta_i/N + ke - theta_o|            <= 0.95 T_rp   (ke taken as margin, K the stiffest known)
    never reached       torsion <= 0.5 of the torques of ratcheting and of buckling, where these are known

The drive holds motor torque (0x6072), speed (0x6080) and ramps (0x6083-0x6085) itself; the supervisor holds the rest.
"""  # noqa: E501

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from drivers.port import DriveLimits
from model.gear import HarmonicDrive, Mounting
from model.motor import ServoMotor
from model.units import RPM
from rig.errors import ConfigurationError

_Tier = Literal["drive", "rig", "protocol"]

MOTOR_TORQUE = "motor_torque"
INPUT_SPEED = "input_speed"
ACCELERATION = "acceleration"
DECELERATION = "deceleration"
QUICK_STOP_DECELERATION = "quick_stop_deceleration"
TORSION_TORQUE = "torsion_torque"
RMS_TORQUE = "rms_torque"
AVERAGE_SPEED = "average_speed"
HOUSING_TEMPERATURE = "housing_temperature"

UNITS: Mapping[str, str] = {
    MOTOR_TORQUE: "N m",
    INPUT_SPEED: "rad/s",
    ACCELERATION: "rad/s2",
    DECELERATION: "rad/s2",
    QUICK_STOP_DECELERATION: "rad/s2",
    TORSION_TORQUE: "N m",
    RMS_TORQUE: "N m",
    AVERAGE_SPEED: "rad/s",
    HOUSING_TEMPERATURE: "degC",
}
"""Every limited quantity and its unit; torques at the motor except the torsion torque, which is at the output."""

_SETPOINT_SHARE = 0.8
"""Share of a rating that set-points and predictions may use."""
TRIP_SHARE = 0.95
"""Share of the repeated peak torque at which the torsion of the gear trips."""
_NEVER_SHARE = 0.5
"""Share of the ratcheting and the buckling torque beyond which no torsion may go: a tooth that jumped once has
damaged the gear, and its torque is known for a unit that was mounted and lubricated as it should be."""
STEP_FACTOR = 2.0
"""Peak over static torque when a torque or an acceleration is applied at once to an undamped spring and mass."""
SPEED_ROOM = 1.25
"""A protocol may exceed its own highest set-point by this factor (overshoot) ..."""
_SPEED_ROOM_ABSOLUTE = 5.0
"""... and this much [rad/s]."""
_HOTTEST_HOUSING = 70.0
"""degC; grease and encoder of the unit."""


@dataclass(frozen=True, slots=True)
class Limit:
    """One upper limit of a magnitude: value in SI, the tier it belongs to, and where it comes from in words."""

    quantity: str
    value: float
    tier: _Tier
    origin: str
    provenance: str = "computed"

    @property
    def unit(self) -> str:
        """The unit of the value."""
        return UNITS[self.quantity]

    @property
    def doubt(self) -> str:
        """In brackets, what is said of a limit that nobody has looked up."""
        return f" ({self.provenance})" if self.provenance in ("recalled", "assumed") else ""

    def __str__(self) -> str:
        return f"{self.value:.4g} {self.unit} ({self.tier}: {self.origin})"


@dataclass(frozen=True)
class Limits:
    """All limits of one run. `tightest` of a quantity is the one that holds."""

    entries: tuple[Limit, ...]

    def of(self, quantity: str) -> tuple[Limit, ...]:
        """Every limit on a quantity, tightest first."""
        return tuple(
            sorted((e for e in self.entries if e.quantity == quantity), key=lambda e: e.value)
        )

    def tightest(self, quantity: str) -> Limit | None:
        """The limit that holds, or None where the quantity is not limited."""
        return next(iter(self.of(quantity)), None)

    def value(self, quantity: str) -> float:
        """The value that holds; infinite where the quantity is not limited."""
        return self._held.get(quantity, math.inf)

    @functools.cached_property
    def _held(self) -> dict[str, float]:
        """The values that hold, by quantity: they are asked for in every turn of a run."""
        return {entry.quantity: self.of(entry.quantity)[0].value for entry in self.entries}

    @property
    def of_the_rig(self) -> Limits:
        """Those that hold whatever the protocol: of drive, rig and gear."""
        return Limits(tuple(entry for entry in self.entries if entry.tier != "protocol"))

    def drive_limits(self) -> DriveLimits:
        """What is written into the drive and read back before it is armed."""
        return DriveLimits(
            torque=self.value(MOTOR_TORQUE),
            speed=self.value(INPUT_SPEED),
            acceleration=self.value(ACCELERATION),
            deceleration=self.value(DECELERATION),
            quick_stop_deceleration=self.value(QUICK_STOP_DECELERATION),
        )

    def as_json(self) -> dict[str, Any]:
        """The limits as the run file and `--json` show them: the one that holds and every tier beside it."""
        limits: dict[str, Any] = {}
        for quantity, unit in UNITS.items():
            entries = self.of(quantity)
            if entries:
                limits[quantity] = {
                    "value": entries[0].value,
                    "unit": unit,
                    "tier": entries[0].tier,
                    "tiers": [
                        {
                            "tier": e.tier,
                            "value": e.value,
                            "origin": e.origin,
                            "provenance": e.provenance,
                        }
                        for e in entries
                    ],
                }
        return limits


@dataclass(frozen=True, slots=True)
class Load:
    """What the motor turns: its inertia at the input without the output [kg m2], that at the output, and the ratio."""

    input_inertia: float
    output_inertia: float
    ratio: float

    @property
    def total_inertia(self) -> float:
        """J_i + J_o/N^2, referred to the input [kg m2]."""
        return self.input_inertia + self.output_inertia / self.ratio**2

    @property
    def output_share(self) -> float:
        """(J_o/N^2)/(J_i + J_o/N^2): the share of a motor torque that goes through the gear when nothing blocks."""
        return self.output_inertia / self.ratio**2 / self.total_inertia

    def gear_torque(self, acceleration: float) -> float:
        """Peak torque at the output [N m] when the input accelerates at once by `acceleration`
        [rad/s2]: 2 J_o alpha/N.
        """
        return STEP_FACTOR * self.output_inertia * abs(acceleration) / self.ratio


def load_of(
    gear: HarmonicDrive,
    motor: ServoMotor,
    mounting: Mounting,
    gear_mounted: bool = True,
    disc_inertia: float = 0.0,
) -> Load:
    """The load of a rig: motor, wave generator and output axis, or the bare motor with whatever
    disc a protocol has on it.
    """
    if not gear_mounted:
        return Load(motor.rotor_inertia + disc_inertia, 0.0, 1.0)
    inner = motor.rotor_inertia + gear.inertia.wave_generator
    return Load(inner, gear.inertia.output, gear.mounted_ratio(mounting))


def torsion_stiffness(gear: HarmonicDrive) -> float:
    """The stiffest that the gear may be [N m/rad]: catalogue K1, K2, K3 and the computed K_HDf.
    High is cautious here.
    """
    from model.stiffness import drive_stiffness

    r = gear.ratings
    return max(r.stiffness_1, r.stiffness_2, r.stiffness_3, drive_stiffness(gear).combined_output)


def kinematic_error_margin(gear: HarmonicDrive) -> float:
    """The largest angle between two positions that kinematic error alone can make [rad]: its peak-to-peak, at least the
    catalogue's transmission accuracy."""
    return max(
        2.0 * sum(h.amplitude for h in gear.kinematic_error), gear.ratings.transmission_accuracy
    )


def derive_limits(
    gear: HarmonicDrive,
    motor: ServoMotor,
    mounting: Mounting = "circular-spline-fixed",
    *,
    gear_mounted: bool = True,
    disc_inertia: float = 0.0,
    plan_speed: float | None = None,
    configured: Mapping[str, float] | None = None,
) -> Limits:
    """The limits of a run (measurement practice: the drive is never allowed what the gear does not bear).

    `plan_speed` is the highest speed set-point of the plan [rad/s] (protocol tier); `configured`
    adds limits of the rig by quantity (SI), from its configuration; `disc_inertia` [kg m2] is on
    the shaft of the bare motor. Raises `ConfigurationError` for an unknown quantity or a value that
    is not positive.
    """
    load = load_of(gear, motor, mounting, gear_mounted, disc_inertia)
    entries = [*_drive_tier(motor)]
    if gear_mounted:
        entries += _gear_tier(gear, load)
    entries += _configured_tier(configured or {})
    torque = min(e.value for e in entries if e.quantity == MOTOR_TORQUE)
    entries += _ramp_limits(motor, gear, load, gear_mounted, torque)
    if plan_speed is not None:
        room = SPEED_ROOM * plan_speed + _SPEED_ROOM_ABSOLUTE
        origin = (
            f"highest set-point {plan_speed / RPM:.4g} r/min x {SPEED_ROOM:g} + "
            f"{_SPEED_ROOM_ABSOLUTE / RPM:.3g} r/min"
        )
        entries.append(Limit(INPUT_SPEED, room, "protocol", origin))
    return Limits(tuple(entries))


def _provenance(item: HarmonicDrive | ServoMotor, path: str) -> str:
    origin = item.origins.get(path)
    return origin.provenance if origin else "assumed"


def _drive_tier(motor: ServoMotor) -> Iterable[Limit]:
    yield Limit(
        MOTOR_TORQUE,
        motor.peak_torque,
        "drive",
        f"peak torque of {motor.name}",
        _provenance(motor, "peak_torque"),
    )
    yield Limit(
        RMS_TORQUE,
        motor.rated_torque,
        "drive",
        f"rated torque of {motor.name}",
        _provenance(motor, "rated_torque"),
    )
    yield Limit(
        INPUT_SPEED,
        motor.maximum_speed,
        "drive",
        f"maximum speed of {motor.name}",
        _provenance(motor, "maximum_speed"),
    )


def _gear_tier(gear: HarmonicDrive, load: Load) -> Iterable[Limit]:
    peak = gear.ratings.repeated_peak_torque
    provenance = _provenance(gear, "ratings.repeated_peak_torque")
    allowed = _SETPOINT_SHARE * peak
    words = f"{_SETPOINT_SHARE:g} x repeated peak {peak:g} N m"
    yield Limit(
        MOTOR_TORQUE,
        allowed / load.ratio,
        "rig",
        f"{words}, output blocked, ratio {load.ratio:g}",
        provenance,
    )
    step = allowed / (STEP_FACTOR * load.ratio * load.output_share)
    inertia = f"J_o = {load.output_inertia:g} kg m2"
    yield Limit(MOTOR_TORQUE, step, "rig", f"{words}, torque step with {inertia}", provenance)
    yield Limit(
        TORSION_TORQUE,
        TRIP_SHARE * peak,
        "rig",
        f"{TRIP_SHARE:g} x repeated peak {peak:g} N m",
        provenance,
    )
    for name in ("ratcheting_torque", "buckling_torque"):
        never = getattr(gear.ratings, name)
        if never is not None:
            words_never = f"{_NEVER_SHARE:g} x {name.replace('_', ' ')} {never:g} N m"
            origin = _provenance(gear, f"ratings.{name}")
            yield Limit(TORSION_TORQUE, _NEVER_SHARE * never, "rig", words_never, origin)
    alpha = allowed * load.ratio / (STEP_FACTOR * load.output_inertia)
    for quantity in (ACCELERATION, DECELERATION, QUICK_STOP_DECELERATION):
        yield Limit(
            quantity, alpha, "rig", f"{words}, ramp applied at once with {inertia}", provenance
        )
    speed = gear.ratings.maximum_input_speed
    provenance = _provenance(gear, "ratings.maximum_input_speed")
    yield Limit(INPUT_SPEED, speed, "rig", f"maximum input speed of {gear.name}", provenance)
    average = gear.ratings.average_input_speed
    provenance = _provenance(gear, "ratings.average_input_speed")
    yield Limit(AVERAGE_SPEED, average, "rig", f"average input speed of {gear.name}", provenance)
    yield Limit(HOUSING_TEMPERATURE, _HOTTEST_HOUSING, "rig", "grease and encoder", "assumed")


def _ramp_limits(
    motor: ServoMotor, gear: HarmonicDrive, load: Load, gear_mounted: bool, torque: float
) -> Iterable[Limit]:
    """Ramps that the limited motor torque can follow: what friction leaves of it, over the inertia."""
    friction = motor.coulomb_friction + motor.viscous_friction * motor.rated_speed
    if gear_mounted:
        friction += gear.ratings.running_torque
    words = f"motor torque limit {torque:.3g} N m over {load.total_inertia:.3g} kg m2"
    usable = _SETPOINT_SHARE * torque
    driving = max(usable - friction, 0.1 * usable) / load.total_inertia
    yield Limit(ACCELERATION, driving, "drive", f"{words}, friction {friction:.2g} N m taken off")
    yield Limit(DECELERATION, driving, "drive", f"{words}, friction {friction:.2g} N m taken off")
    yield Limit(QUICK_STOP_DECELERATION, usable / load.total_inertia, "drive", words)


def _configured_tier(configured: Mapping[str, float]) -> Iterable[Limit]:
    for quantity, value in configured.items():
        if quantity not in UNITS:
            raise ConfigurationError(
                "no such limit",
                where=f"limits.{quantity}",
                remedy="Known: " + ", ".join(UNITS) + ".",
            )
        if not (math.isfinite(value) and value > 0.0):
            raise ConfigurationError(
                "a limit must be a positive number",
                where=f"limits.{quantity}",
                value=value,
                limit=f"> 0 {UNITS[quantity]}",
            )
        yield Limit(quantity, value, "rig", "configuration of the rig", "measured")
