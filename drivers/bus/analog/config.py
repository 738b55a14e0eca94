"""What has to be known of an amplifier by analog reference: it tells nothing itself.

    speed = speed per volt * (V - V0),   V = counts * volts per count

A SERVOPACK with 6.00 V at rated speed (Pn300) and 3000 r/min has 500 r/min per volt.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar, Final

from drivers.bus.cia301 import I16, U8, ObjectRef
from drivers.bus.dictionary.eds import DeviceDescription
from drivers.bus.status_lines import Line, StatusLines
from drivers.errors import DriverError
from drivers.port import DriveLimits

_NO_LIMITS: Final = DriveLimits(math.inf, math.inf, math.inf, math.inf, math.inf)
"""Nobody has said which limits the amplifier holds."""


@dataclass(frozen=True, kw_only=True)
class ReferenceConfig:
    """An amplifier behind the terminals of a CiA 401 coupler.

    `reference` is the analog output (0x6411) with its `volts_per_count`; `speed_per_volt` [rad/s per V]; `zero_volts`
    is where the motor stands, known to a standard uncertainty of `zero_uncertainty_volts`, the scale to
    `scale_relative_uncertainty`; beyond +-`largest_volts` nothing is sent. `outputs` (0x6200) has the lines `servo_on`
    and, where it is wired, `alarm_reset`; `inputs` (0x6000) those of `lines`; `turning` tells that the motor turns
    (only while the computer has no encoder in the cycle: at bringing up and closing). `limits_by_hand` are the limits
    that somebody has set by the maker's tool. Times in ms.
    """

    has_quick_stop: ClassVar[bool] = False
    reads_limits_back: ClassVar[bool] = False

    node_id: int
    speed_per_volt: float
    volts_per_count: float
    servo_on: Line
    lines: StatusLines
    alarm_reset: Line | None = None
    turning: Line | None = None
    zero_volts: float = 0.0
    zero_uncertainty_volts: float = 0.0
    scale_relative_uncertainty: float = 0.0
    largest_volts: float = 10.0
    direction: int = 1
    reference: ObjectRef = field(
        default_factory=lambda: ObjectRef(0x6411, 1, I16, "speed reference")
    )
    outputs: ObjectRef = field(default_factory=lambda: ObjectRef(0x6200, 1, U8, "digital outputs"))
    inputs: ObjectRef = field(default_factory=lambda: ObjectRef(0x6000, 1, U8, "digital inputs"))
    limits_by_hand: DriveLimits = _NO_LIMITS
    description: DeviceDescription | None = None
    heartbeat_ms: int = 100
    computer_heartbeat_ms: int = 50
    computer_lost_ms: int = 250
    state_timeout_ms: int = 5000
    standstill_ms: int = 2000
    sdo_timeout_ms: int = 300

    def __post_init__(self) -> None:
        for name, value in (
            ("volts_per_count", self.volts_per_count),
            ("speed_per_volt", self.speed_per_volt),
            ("largest_volts", self.largest_volts),
        ):
            if not (math.isfinite(value) and value > 0.0):
                raise DriverError(
                    f"{name} must be positive", where="speed reference", value=value, limit="> 0"
                )
        if not abs(self.zero_volts) < self.largest_volts:
            raise DriverError(
                "the voltage of standstill is beyond what may be sent",
                where="speed reference, zero_volts",
                value=f"{self.zero_volts:g} V",
                limit=f"within +-{self.largest_volts:g} V",
            )
        for entry, most in ((self.outputs, 4), (self.inputs, 2)):
            kind = entry.value_type
            if kind.is_float or not 0 < kind.size <= most:
                raise DriverError(
                    "contacts are bits of an integer",
                    where=str(entry),
                    value=kind.name,
                    limit=f"an integer of at most {8 * most} bits",
                )
        self._require_lines()

    def _require_lines(self) -> None:
        """Raise `DriverError` where two lines are one contact, or one is no bit of its word."""
        wired = [line for line in (self.servo_on, self.alarm_reset) if line is not None]
        read = [*self.lines.lines, *([self.turning] if self.turning is not None else [])]
        for entry, lines in ((self.outputs, wired), (self.inputs, read)):
            masks = [line.mask for line in lines]
            top = 1 << 8 * entry.value_type.size
            fits = all(0 < mask < top and mask & (mask - 1) == 0 for mask in masks)
            if not fits or len(set(masks)) != len(masks):
                raise DriverError(
                    "every line is one bit of its word, and none is two lines",
                    where=str(entry),
                    value=", ".join(f"0x{mask:X}" for mask in masks),
                    limit=f"different single bits below 0x{top:X}",
                )

    @property
    def zero_count(self) -> int:
        """The count at which the motor stands."""
        return round(self.zero_volts / self.volts_per_count)

    @property
    def largest_count(self) -> int:
        """The largest count, either way, that may be sent."""
        kind = self.reference.value_type
        return min(
            math.floor(self.largest_volts / self.volts_per_count), 2 ** (8 * kind.size - 1) - 1
        )

    @property
    def idle_outputs(self) -> int:
        """The word of outputs with the servo off and nothing reset."""
        return self.word(servo_on=False)

    def word(self, *, servo_on: bool, resets: bool = False) -> int:
        """The word of outputs that says this."""
        word = self.servo_on.put(0, servo_on)
        return word if self.alarm_reset is None else self.alarm_reset.put(word, resets)
