"""What can be said of the amplifier that turns the motor: a CiA 402 drive, or one by analog reference on a coupler."""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from drivers import channel as names
from drivers.port import DriveLimits
from model.units import RPM
from rig.bench.config.objects import read_object
from rig.bench.config.parts import (
    Calibration,
    Direction,
    Milliseconds,
    NodeId,
    NotNegative,
    ObjectText,
    Part,
    Positive,
)

CIA_402, ANALOG_REFERENCE = "cia-402", "analog-reference"
"""The words for `kind`."""
_SpeedMode = Literal["cyclic velocity", "cyclic position", "profile velocity"]
_TorqueMode = Literal["cyclic torque", "profile torque"]


class AnyAmplifier(Part):
    """What is said of every amplifier: its node, its watch over this computer, its patience.

    `computer_loss_covered_by` says in words what stops the motor when the computer is lost, where neither drive nor
    coupler watches it: such a rig is not armed without.
    """

    node_id: NodeId
    eds: str = ""
    rated_torque: Positive | None = Field(default=None, alias="rated_torque_n_m")
    computer_loss_covered_by: str = ""
    heartbeat_ms: Milliseconds = 100
    computer_heartbeat_ms: Milliseconds = 50
    computer_lost_ms: Milliseconds = 250
    state_timeout_ms: Milliseconds = 5000
    sdo_timeout_ms: Milliseconds = 300

    @model_validator(mode="after")
    def _heard_in_time(self) -> AnyAmplifier:
        if self.computer_lost_ms < 2 * self.computer_heartbeat_ms:
            raise ValueError(
                f"computer_lost_ms = {self.computer_lost_ms} must be at least twice computer_heartbeat_ms = "
                f"{self.computer_heartbeat_ms}, or the drive stops at every late beat"
            )
        return self

    def settings(self) -> dict[str, Any]:
        """As the driver has it: what covers the loss of the computer is for whoever arms."""
        values = super().settings()
        del values["kind"], values["computer_loss_covered_by"]
        return values


class Drive(AnyAmplifier):
    """The servo amplifier (CiA 402). What is left away is asked of the drive.

    `torque_limit` names the object that limits torque, where it is another than 0x6072 with its unit.
    `torque_calibration` is of the torque that the drive tells (`actual_torque`).
    `computer_loss_covered_by` says in words what stops the motor when the computer is lost, for a
    drive that does not watch it itself: such a drive is not armed without.
    """

    objects: ClassVar[Mapping[str, str]] = {
        "actual_torque": "torque actual value",
        "torque_limit": "torque limit",
    }

    counts_per_revolution: NotNegative = 0.0
    velocity_unit: Positive | None = Field(default=None, alias="velocity_unit_rad_s")
    acceleration_unit: Positive | None = Field(default=None, alias="acceleration_unit_rad_s2")
    torque_unit: Positive | None = Field(default=None, alias="torque_unit_n_m")
    actual_torque: ObjectText = "0x6077:0 I16"
    torque_calibration: Calibration = Calibration()
    torque_limit: ObjectText = "0x6072:0 U16"
    torque_limit_unit: Positive | None = Field(default=None, alias="torque_limit_unit_n_m")
    speed_modes: tuple[_SpeedMode, ...] = Field(
        default=("cyclic velocity", "cyclic position", "profile velocity"), min_length=1
    )
    torque_modes: tuple[_TorqueMode, ...] = ("cyclic torque", "profile torque")
    abort_connection_option: Annotated[int, Field(strict=True, ge=-32768, le=32767)] = 3
    quick_stop_option: Annotated[int, Field(strict=True, ge=-32768, le=32767)] = 2
    fault_reaction_option: Annotated[int, Field(strict=True, ge=-32768, le=32767)] = 2
    kind: Literal["cia-402"] = "cia-402"
    latch_index: bool = True
    gains: tuple[ObjectText, ...] = ()

    @model_validator(mode="after")
    def _stops(self) -> Drive:
        if self.abort_connection_option == 0:
            raise ValueError(
                "abort_connection_option = 0 lets the drive turn on when the computer is gone; 3 is quick stop"
            )
        if read_object(self.torque_limit).index != 0x6072 and self.torque_limit_unit is None:
            raise ValueError(
                f"torque_limit = {self.torque_limit!r} needs torque_limit_unit_n_m: the torque of one count of it"
            )
        return self

    def settings(self) -> dict[str, Any]:
        """As the driver has it, with the entries of the gains read and the calibration of its torque."""
        gains = tuple(read_object(text, "servo gain") for text in self.gains)
        calibration = names.Calibration(**self.torque_calibration.settings())
        return super().settings() | {"gains": gains, "torque_calibration": calibration}


class LineBit(Part):
    """One contact: its bit in the word of inputs or outputs, and whether it is 1 when it means what it is named for."""

    mask: Annotated[int, Field(strict=True, ge=1, le=0xFFFF_FFFF)]
    active_high: bool = True


class ReferenceLines(Part):
    """The contacts of an amplifier by analog reference. `servo_on` and `alarm_reset` are outputs of the coupler;
    `alarm`, `power` (on the motor: the brake's interlock), `ready`, `reached` (speed coincidence), `turning` inputs.
    """

    servo_on: LineBit
    alarm: LineBit
    power: LineBit
    ready: LineBit
    alarm_reset: LineBit | None = None
    reached: LineBit | None = None
    turning: LineBit | None = None


class LimitsByHand(Part):
    """The limits that somebody has set in the amplifier by the maker's tool, by whom and when: they cannot be read
    back, and are typed again to arm the rig.
    """

    torque_n_m: Positive
    speed_rpm: Positive
    set_by: str = Field(min_length=1)
    date: datetime.date

    @property
    def words(self) -> str:
        """What is typed to arm the rig."""
        return f"{self.torque_n_m:g} N m {self.speed_rpm:g} r/min"

    @property
    def drive_limits(self) -> DriveLimits:
        """As the driver has them; it holds no ramps."""
        ramp = float("inf")
        return DriveLimits(self.torque_n_m, self.speed_rpm * RPM, ramp, ramp, ramp)


class ReferenceDrive(AnyAmplifier):
    """A servo amplifier by analog speed reference behind the terminals of a CiA 401 coupler.

    `speed_per_volt_rpm` is its own scale (rated speed over the volts of Pn300), `volts_per_count` the coupler's,
    `zero_volts` where the motor stands, both with their standard uncertainties, `largest_volts` what may be sent at
    most. `standstill_ms`: how long standstill is waited for before power is taken, where no contact tells it.
    """

    objects: ClassVar[Mapping[str, str]] = {
        "reference": "speed reference",
        "outputs": "digital outputs",
        "inputs": "digital inputs",
    }

    kind: Literal["analog-reference"]
    reference: ObjectText = "0x6411:1 I16"
    volts_per_count: Positive
    speed_per_volt: Positive = Field(alias="speed_per_volt_rpm")
    zero_volts: Annotated[float, Field(strict=True, allow_inf_nan=False)] = 0.0
    zero_uncertainty_volts: NotNegative = 0.0
    scale_relative_uncertainty: NotNegative = 0.0
    largest_volts: Positive = 10.0
    direction: Direction = 1
    outputs: ObjectText = "0x6200:1 U8"
    inputs: ObjectText = "0x6000:1 U8"
    standstill_ms: Milliseconds = 2000
    lines: ReferenceLines
    limits_by_hand: LimitsByHand

    def settings(self) -> dict[str, Any]:
        """As the driver has it: the scale in rad/s per volt; the rated torque is the torque monitor's business."""
        values = super().settings() | {
            "speed_per_volt": self.speed_per_volt * RPM,
            "limits_by_hand": self.limits_by_hand.drive_limits,
        }
        del values["rated_torque"]
        return values


def _kind_of(given: Any) -> str:
    """Which table a [drive] is: one that does not say it is a CiA 402 drive."""
    if isinstance(given, Mapping):
        said = given.get("kind", CIA_402)
    else:
        said = getattr(given, "kind", CIA_402)
    return str(said)


AnyDrive = Annotated[
    Annotated[Drive, Tag(CIA_402)] | Annotated[ReferenceDrive, Tag(ANALOG_REFERENCE)],
    Discriminator(_kind_of),
]
"""Every kind of amplifier, told apart by `kind`."""
