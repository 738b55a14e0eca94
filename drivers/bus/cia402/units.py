"""What a CiA 402 drive's numbers are in SI: rated torque, counts per revolution, units of velocity and acceleration.

The configuration holds; the drive is asked for what it leaves open, its answer is judged
(`plausible`), and contradictions are events. What neither says is NaN, its `Question` is kept, and
using it is an error that says the question.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from drivers.bus.cia301 import ObjectRef
from drivers.bus.cia402 import plausible
from drivers.bus.cia402 import tables as obj
from drivers.bus.cia402.plausible import Question
from drivers.bus.device import RemoteDevice
from drivers.bus.sdo import SdoAbortError

_SAME: Final = 0.02
"""Two per cent: a rated torque is rounded on nameplates and in objects."""
_MICRO: Final = 1000.0
"""uN m where the standard has mN m."""
_CONSEQUENCES: Final[Mapping[tuple[int, int], str]] = {
    obj.RATED_TORQUE.key: "the rated torque must stand in the configuration",
    obj.FEED.key: "counts per revolution must stand in the configuration",
    obj.FEED_REVOLUTIONS.key: "counts per revolution must stand in the configuration",
    obj.ENCODER_INCREMENTS.key: "counts per revolution must stand in the configuration",
    obj.ENCODER_REVOLUTIONS.key: "counts per revolution must stand in the configuration",
    obj.GEAR_MOTOR.key: "no electronic gear",
    obj.GEAR_SHAFT.key: "no electronic gear",
    obj.VELOCITY_UNIT.key: "the velocity unit must stand in the configuration",
    obj.VELOCITY_ENCODER_FACTOR.key: "the velocity unit must stand in the configuration",
    obj.VELOCITY_ENCODER_DIVISOR.key: "the velocity unit must stand in the configuration",
    obj.ACCELERATION_UNIT.key: "the unit of its ramps must stand in the configuration",
}
"""What the rig loses where the drive lacks the object; others are asked for evidence only."""


@dataclass(frozen=True, kw_only=True)
class Configured:
    """What the configuration says of the drive's units; None or 0: the drive is asked.

    `motor_torque` [N m] is the rated torque of the motor that the rig's description names.
    """

    rated_torque: float | None = None
    counts_per_revolution: float = 0.0
    velocity_unit: float | None = None
    acceleration_unit: float | None = None
    motor_torque: float | None = None


@dataclass(frozen=True, kw_only=True)
class Units:
    """A drive's numbers in SI, NaN (counts: 0) where nobody says, and the questions that are open then.

    `torque_limit_unit` [N m] is that of one count of 0x6072: of the rated torque and of 0x6076 the
    larger, so that the limit holds whichever is right.
    """

    rated_torque: float
    counts_per_revolution: float
    velocity_unit: float
    acceleration_unit: float
    torque_limit_unit: float
    questions: tuple[Question, ...]

    def question(self, entry: str) -> Question | None:
        """The open question that a word of the description answers."""
        return next((asked for asked in self.questions if asked.entry == entry), None)


def read_units(device: RemoteDevice, configured: Configured, vendor_id: int = 0) -> Units:
    """Ask the drive for its units, judge its answers, and hold the configuration against them."""
    given = _given_keys(configured)

    def read(entry: ObjectRef) -> float | None:
        consequence = _CONSEQUENCES.get(entry.key)
        if consequence is not None and entry.key not in given:
            return device.read_optional(entry, consequence)
        with contextlib.suppress(SdoAbortError):
            return device.read(entry)
        return None

    stated = plausible.read_statement(read, vendor_id=vendor_id)
    questions: list[Question] = []
    own_torque = plausible.rated_torque(stated, configured.motor_torque)
    _compare_torque(device, stated.rated_torque, own_torque, configured.rated_torque)
    torque = _settled(configured.rated_torque, own_torque, questions)
    counts = _counts(device, stated, configured.counts_per_revolution, questions)
    own_velocity = plausible.velocity_unit(stated, counts)
    own_acceleration = plausible.acceleration_unit(stated, counts)
    for name, own, said in (
        ("velocity-unit", own_velocity, configured.velocity_unit),
        ("acceleration-unit", own_acceleration, configured.acceleration_unit),
    ):
        _compare_unit(device, name, own, said)
    velocity = _settled(configured.velocity_unit, own_velocity, questions)
    acceleration = _settled(configured.acceleration_unit, own_acceleration, questions)
    for question in questions:
        code = question.entry.removesuffix("_n_m").removesuffix("_rad_s").removesuffix("_rad_s2")
        if question.entry != "counts_per_revolution":
            device.bus.emit("warning", code.replace("_", "-"), device.where, str(question))
    return Units(
        rated_torque=torque,
        counts_per_revolution=counts,
        velocity_unit=velocity,
        acceleration_unit=acceleration,
        torque_limit_unit=_torque_limit_unit(torque, own_torque),
        questions=tuple(questions),
    )


def _given_keys(configured: Configured) -> set[tuple[int, int]]:
    """The objects that the configuration makes needless: that they are not there costs nothing."""
    given: set[tuple[int, int]] = set()
    if configured.rated_torque:
        given.add(obj.RATED_TORQUE.key)
    if configured.velocity_unit:
        given |= {
            obj.VELOCITY_UNIT.key,
            obj.VELOCITY_ENCODER_FACTOR.key,
            obj.VELOCITY_ENCODER_DIVISOR.key,
        }
    if configured.acceleration_unit:
        given.add(obj.ACCELERATION_UNIT.key)
    return given


def _settled(configured: float | None, own: float | Question, questions: list[Question]) -> float:
    """The configuration's value, else the drive's; NaN and its question where neither says."""
    if configured:
        return configured
    if isinstance(own, Question):
        questions.append(own)
        return math.nan
    return own


def _counts(
    device: RemoteDevice,
    stated: plausible.Statement,
    configured: float,
    questions: list[Question],
) -> float:
    """Counts of 0x6064 per motor revolution; 0: unknown."""
    own = plausible.counts_per_revolution(stated)
    if isinstance(own, Question):
        if not configured:
            questions.append(own)
        return configured
    if configured and abs(own - configured) > 1e-9 * configured:
        device.bus.emit(
            "warning",
            "counts-per-revolution",
            device.where,
            f"the drive says {own:g} counts per revolution, the configuration {configured:g}; "
            "the configuration holds",
        )
    return configured or own


def _compare_torque(
    device: RemoteDevice, raw: int | None, own: float | Question, configured: float | None
) -> None:
    """Say where 0x6076 and the configuration differ, and what follows."""
    if not raw or not configured or abs(raw * 1e-3 - configured) <= _SAME * configured:
        return
    says = f"0x6076 says {raw * 1e-3:g} N m, the configuration {configured:g} N m; "
    if isinstance(own, Question) or _is_micro(own, configured):
        why = "no motor of this rig has what the drive says"
        if _is_micro(raw * 1e-3, configured):
            why = "that is the same in uN m, a thousandth of the standard's unit"
        text = f"{says}{why}: the configuration holds, for the torque limit as well"
    else:
        text = (
            f"{says}torque is read by the configuration, and the torque limit is written so that "
            "it holds by either"
        )
    device.bus.emit("warning", "rated-torque", device.where, text)


def _compare_unit(
    device: RemoteDevice, code: str, own: float | Question, configured: float | None
) -> None:
    if not configured or isinstance(own, Question) or abs(own - configured) <= 1e-3 * configured:
        return
    device.bus.emit(
        "warning",
        code,
        device.where,
        f"the drive states {own:.6g} per count for its {code.replace('-', ' ')} (SI), the configuration "
        f"{configured:.6g}; the configuration holds",
    )


def _torque_limit_unit(torque: float, own: float | Question) -> float:
    """N m per count of 0x6072: the drive may reckon by another rated torque than the configuration's."""
    if not torque > 0.0 or isinstance(own, Question) or _is_micro(own, torque):
        return torque / 1000.0
    return max(torque, own) / 1000.0


def _is_micro(stated: float, configured: float) -> bool:
    """Whether the drive's rated torque is the configuration's in a thousandth of the standard's unit."""
    return abs(stated / _MICRO - configured) <= _SAME * configured
