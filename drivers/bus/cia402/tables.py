"""The tables of CiA 402 (IEC 61800-7-201): objects, modes, transitions, error codes."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from typing import Final

from drivers.bus.cia301 import I8, I16, I32, U8, U16, U32, ObjectRef
from drivers.bus.cia402.stop_words import DISABLE_VOLTAGE
from drivers.drive_state import DriveState

ERROR_CODE: Final = ObjectRef(0x603F, 0, U16, "error code")
ABORT_OPTION: Final = ObjectRef(0x6007, 0, I16, "abort connection option code")
CONTROLWORD: Final = ObjectRef(0x6040, 0, U16, "controlword")
STATUSWORD: Final = ObjectRef(0x6041, 0, U16, "statusword")
QUICK_STOP_OPTION: Final = ObjectRef(0x605A, 0, I16, "quick stop option code")
FAULT_REACTION: Final = ObjectRef(0x605E, 0, I16, "fault reaction option code")
MODE: Final = ObjectRef(0x6060, 0, I8, "mode of operation")
MODE_DISPLAY: Final = ObjectRef(0x6061, 0, I8, "mode of operation display")
POSITION: Final = ObjectRef(0x6064, 0, I32, "position actual value")
VELOCITY: Final = ObjectRef(0x606C, 0, I32, "velocity actual value")
TARGET_TORQUE: Final = ObjectRef(0x6071, 0, I16, "target torque")
MAX_TORQUE: Final = ObjectRef(0x6072, 0, U16, "max torque")
RATED_CURRENT: Final = ObjectRef(0x6075, 0, U32, "motor rated current")
RATED_TORQUE: Final = ObjectRef(0x6076, 0, U32, "motor rated torque")
TORQUE: Final = ObjectRef(0x6077, 0, I16, "torque actual value")
TARGET_POSITION: Final = ObjectRef(0x607A, 0, I32, "target position")
FOLLOWING_WINDOW: Final = ObjectRef(0x6065, 0, U32, "following error window")
FOLLOWING_TIMEOUT: Final = ObjectRef(0x6066, 0, U16, "following error time out")
POSITION_RANGE: Final = (
    ObjectRef(0x607B, 1, I32, "position range limit, least"),
    ObjectRef(0x607B, 2, I32, "position range limit, greatest"),
)
POSITION_LIMITS: Final = (
    ObjectRef(0x607D, 1, I32, "software position limit, least"),
    ObjectRef(0x607D, 2, I32, "software position limit, greatest"),
)
MAX_PROFILE_VELOCITY: Final = ObjectRef(0x607F, 0, U32, "max profile velocity")
MAX_MOTOR_SPEED: Final = ObjectRef(0x6080, 0, U32, "max motor speed")
ACCELERATION: Final = ObjectRef(0x6083, 0, U32, "profile acceleration")
DECELERATION: Final = ObjectRef(0x6084, 0, U32, "profile deceleration")
QUICK_STOP_DECELERATION: Final = ObjectRef(0x6085, 0, U32, "quick stop deceleration")
TORQUE_SLOPE: Final = ObjectRef(0x6087, 0, U32, "torque slope")
ENCODER_INCREMENTS: Final = ObjectRef(0x608F, 1, U32, "encoder increments")
ENCODER_REVOLUTIONS: Final = ObjectRef(
    0x608F, 2, U32, "motor revolutions of the encoder increments"
)
GEAR_MOTOR: Final = ObjectRef(0x6091, 1, U32, "gear ratio, motor revolutions")
GEAR_SHAFT: Final = ObjectRef(0x6091, 2, U32, "gear ratio, shaft revolutions")
FEED: Final = ObjectRef(0x6092, 1, U32, "feed constant, feed")
FEED_REVOLUTIONS: Final = ObjectRef(0x6092, 2, U32, "feed constant, shaft revolutions")
POSITION_FACTOR: Final = ObjectRef(0x6093, 1, U32, "position factor, numerator")
POSITION_DIVISOR: Final = ObjectRef(0x6093, 2, U32, "position factor, divisor")
VELOCITY_ENCODER_FACTOR: Final = ObjectRef(0x6094, 1, U32, "velocity encoder factor, numerator")
VELOCITY_ENCODER_DIVISOR: Final = ObjectRef(0x6094, 2, U32, "velocity encoder factor, divisor")
VELOCITY_FACTOR: Final = ObjectRef(0x6096, 1, U32, "velocity factor, numerator")
VELOCITY_DIVISOR: Final = ObjectRef(0x6096, 2, U32, "velocity factor, divisor")
VELOCITY_UNIT: Final = ObjectRef(0x60A9, 0, U32, "SI unit velocity")
ACCELERATION_UNIT: Final = ObjectRef(0x60AA, 0, U32, "SI unit acceleration")
_POSITION_OFFSET: Final = ObjectRef(0x60B0, 0, I32, "position offset")
_VELOCITY_OFFSET: Final = ObjectRef(0x60B1, 0, I32, "velocity offset")
_TORQUE_OFFSET: Final = ObjectRef(0x60B2, 0, I16, "torque offset")
OFFSETS: Final = (_POSITION_OFFSET, _VELOCITY_OFFSET, _TORQUE_OFFSET)
"""What a drive adds to its set-points in the cyclic modes."""
TOUCH_PROBE: Final = ObjectRef(0x60B8, 0, U16, "touch probe function")
TOUCH_PROBE_STATUS: Final = ObjectRef(0x60B9, 0, U16, "touch probe status")
TOUCH_PROBE_POSITION: Final = ObjectRef(0x60BA, 0, I32, "touch probe 1 positive edge")
INTERPOLATION_TIME: Final = ObjectRef(0x60C2, 1, U8, "interpolation time period")
INTERPOLATION_EXPONENT: Final = ObjectRef(0x60C2, 2, I8, "interpolation time exponent")
POSITIVE_TORQUE_LIMIT: Final = ObjectRef(0x60E0, 0, U16, "positive torque limit")
NEGATIVE_TORQUE_LIMIT: Final = ObjectRef(0x60E1, 0, U16, "negative torque limit")
TARGET_VELOCITY: Final = ObjectRef(0x60FF, 0, I32, "target velocity")
SUPPORTED_MODES: Final = ObjectRef(0x6502, 0, U32, "supported drive modes")
GAINS: Final[tuple[tuple[int, str], ...]] = (
    (0x60F6, "torque control parameter"),
    (0x60F9, "velocity control parameter"),
    (0x60FB, "position control parameter"),
)
"""Records of servo gains whose sub-objects are the manufacturer's."""

TOUCH_PROBE_ON_INDEX: Final = 0x0015 | 0x0002
"""Touch probe 1 on, continuous, triggered by the encoder's zero impulse, positive edge."""


class OperationMode(IntEnum):
    """Modes of operation (0x6060); its bit in 0x6502 is the mode's number minus one."""

    PROFILE_POSITION = 1
    VELOCITY = 2
    PROFILE_VELOCITY = 3
    PROFILE_TORQUE = 4
    HOMING = 6
    INTERPOLATED_POSITION = 7
    CYCLIC_POSITION = 8
    CYCLIC_VELOCITY = 9
    CYCLIC_TORQUE = 10


FOLLOWING_ERROR_BIT: Final = 0x2000
"""Statusword bit 13 in cyclic position: the shaft is further behind than 0x6065 allows."""
REMOTE_BIT: Final = 0x0200
"""Statusword bit 9: the drive obeys the controlword; clear while a panel or a tool holds it."""

SHUTDOWN, SWITCH_ON, ENABLE, FAULT_RESET = 0x06, 0x07, 0x0F, 0x80

TO_ENABLED: Final[Mapping[DriveState, int]] = {
    DriveState.SWITCH_ON_DISABLED: SHUTDOWN,
    DriveState.READY: SWITCH_ON,
    DriveState.SWITCHED_ON: ENABLE,
    DriveState.ENABLED: ENABLE,
    DriveState.QUICK_STOP: DISABLE_VOLTAGE,
}
"""Controlword that leads from each state one step towards operation enabled (transitions 2, 3, 4 and 12)."""
TO_SWITCHED_ON: Final[Mapping[DriveState, int]] = {
    DriveState.SWITCH_ON_DISABLED: SHUTDOWN,
    DriveState.READY: SWITCH_ON,
    DriveState.ENABLED: SWITCH_ON,
    DriveState.QUICK_STOP: DISABLE_VOLTAGE,
}
"""Controlword that leads one step towards switched on: where targets are set before they act."""
ERROR_CODES: Final[Mapping[int, str]] = {
    0x0000: "no error",
    0x2110: "short circuit or earth leakage on the input side",
    0x2211: "continuous over-current inside the device, no. 1",
    0x2212: "continuous over-current inside the device, no. 2",
    0x2213: "over-current in the ramp function",
    0x2214: "over-current in the sequence",
    0x2220: "continuous over-current inside the device",
    0x2230: "short circuit or earth leakage inside the device",
    0x2240: "earth leakage inside the device",
    0x2250: "short circuit inside the device",
    0x2310: "continuous over-current on the output side",
    0x2311: "continuous over-current on the output side, no. 1",
    0x2312: "continuous over-current on the output side, no. 2",
    0x2320: "short circuit or earth leakage on the output side",
    0x2330: "earth leakage on the output side",
    0x2340: "short circuit on the output side",
    0x2350: "load level fault (I2t, thermal state)",
    0x2351: "load level warning (I2t, thermal state)",
    0x3110: "mains over-voltage",
    0x3120: "mains under-voltage",
    0x3130: "phase failure",
    0x3210: "DC link over-voltage",
    0x3211: "DC link over-voltage, no. 1",
    0x3220: "DC link under-voltage",
    0x3221: "DC link under-voltage, no. 1",
    0x3230: "load error",
    0x3310: "output over-voltage",
    0x3331: "field circuit interrupted",
    0x4110: "ambient temperature too high",
    0x4210: "device temperature too high",
    0x4310: "drive temperature too high",
    0x4410: "supply temperature too high",
    0x5100: "supply",
    0x5110: "supply low voltage",
    0x5111: "supply of 15 V missing",
    0x5112: "supply of 24 V low",
    0x5200: "control",
    0x5300: "operating unit",
    0x5400: "power section",
    0x5410: "output stages",
    0x5430: "input stages",
    0x5441: "contact 1 (E-stop, STO)",
    0x5442: "contact 2 (E-stop, STO)",
    0x5500: "data storage",
    0x5530: "non-volatile data memory",
    0x6010: "software reset (watchdog)",
    0x6310: "loss of parameters",
    0x6320: "parameter error",
    0x7100: "power",
    0x7110: "brake chopper",
    0x7120: "motor",
    0x7121: "motor blocked",
    0x7122: "motor error or commutation malfunction",
    0x7180: "motor overspeed",
    0x7200: "measurement circuit",
    0x7300: "sensor",
    0x7301: "tacho fault",
    0x7303: "resolver 1 fault",
    0x7305: "incremental sensor 1 fault",
    0x7306: "incremental sensor 2 fault",
    0x7310: "speed",
    0x7320: "position",
    0x7400: "computation circuit",
    0x7500: "communication",
    0x8130: "life guard or heartbeat error",
    0x8311: "excess torque",
    0x8312: "difficult start-up",
    0x8331: "torque fault",
    0x8400: "velocity speed controller",
    0x8480: "velocity speed control error",
    0x8500: "position controller",
    0x8611: "following error",
    0x8612: "reference limit",
    0x8700: "sync controller",
    0x8A00: "synchronisation error",
}
"""Error codes of 0x603F and of EMCY in words."""
