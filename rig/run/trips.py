"""The trips: every cause, what it means, how the rig is made safe, and what the operator does next. One table."""

from __future__ import annotations

import math
from dataclasses import dataclass

from drivers.port import MISSED_CYCLES, STALE_DATA
from rig.run.make_safe import Action

OVER_SPEED = "over_speed"
OVER_SPEED_OUTPUT = "over_speed_output"
OVER_TORQUE = "over_torque"
OVERLOAD = "overload"
TORSION_TORQUE = "torsion_torque"
DISAGREEMENT = "input_output_disagreement"
TRAVEL = "travel"
OVER_TEMPERATURE = "over_temperature"
GUARD_OPEN = "guard_open"
DRIVE_FAULT = "drive_fault"
UNEXPECTED_STATE = "unexpected_state"
FOLLOWING_ERROR = "following_error"
SIGNAL_ERROR = "signal_error"
COUNT_JUMP = "count_jump"
LOST_COUNTS = "lost_counts"
TORQUE_PORT = "torque_port"
TORQUE_DISAGREEMENT = "torque_disagreement"
TORQUE_FROZEN = "torque_frozen"
TORQUE_ZERO = "torque_zero"
SLIP = "slip"
CREEP = "creep"
THERMOMETER = "thermometer"
TIME_BASE = "time_base"
BUS_LOST = "bus_lost"
DEVICE_ERROR = "device_error"
DISK_SPACE = "disk_space"
EMERGENCY = "emcy"
_HEARTBEAT_LOST = "heartbeat_lost"
BOOT_UP = "boot_up"
_NOT_OPERATIONAL = "not_operational"
_DRIVE_STATE = "drive_state"
_DRIVE_MODE = "drive_mode"
_DRIVE_FOLLOWING = "drive_following"
_DRIVE_NOT_FOLLOWING = "drive_not_following"
FOREIGN_SYNC = "foreign_sync"
FOREIGN_TPDO = "foreign_tpdo"
FOREIGN_COMMAND = "foreign_command"
FAULT = "fault"
LATE_TURN = "late_turn"
MAKE_SAFE_FAILED = "make_safe_failed"

SESSION_ERRORS = frozenset({"preflight", "step-failed", "recorder", "exception", "latch"})
"""Codes with which a session says that the program or the run failed; its other errors are causes of trips."""

DEVICE_CAUSES = frozenset(
    {
        EMERGENCY,
        _HEARTBEAT_LOST,
        BOOT_UP,
        _NOT_OPERATIONAL,
        _DRIVE_STATE,
        _DRIVE_MODE,
        _DRIVE_FOLLOWING,
        _DRIVE_NOT_FOLLOWING,
        FOREIGN_SYNC,
        FOREIGN_TPDO,
        FOREIGN_COMMAND,
        FAULT,
        BUS_LOST,
    }
)
"""Causes that a port reports by itself, with an event that says what happened."""


@dataclass(frozen=True, slots=True)
class TripRule:
    """What a trip is in words, how the rig is made safe, and what the operator does next."""

    what: str
    action: Action
    remedy: str


TRIPS: dict[str, TripRule] = {
    OVER_SPEED: TripRule(
        "the input turns too fast",
        Action.QUICK_STOP,
        "Check the speed loop's gains and the drive's speed limit.",
    ),
    OVER_SPEED_OUTPUT: TripRule(
        "the output turns faster than the input limit allows",
        Action.QUICK_STOP,
        "Check the motor encoder: the drive may be running on a wrong speed.",
    ),
    OVER_TORQUE: TripRule(
        "the motor torque is above its limit",
        Action.ZERO_TORQUE,
        "Something blocks, or the drive does not hold its torque limit: turn the gear by hand, read 0x6072 back.",
    ),
    OVERLOAD: TripRule(
        "the mean square of the motor torque is above its rating",
        Action.QUICK_STOP,
        "Let the motor cool; lower the load.",
    ),
    TORSION_TORQUE: TripRule(
        "the torsion of the gear says that its torque nears the repeated peak",
        Action.ZERO_TORQUE,
        "Find what holds the output; inspect the gear before going on.",
    ),
    DISAGREEMENT: TripRule(
        "input and output angle disagree beyond the compliance of the gear",
        Action.QUICK_STOP,
        "Check ratio and mounting, lines and direction of both encoders, and the output coupling.",
    ),
    TRAVEL: TripRule(
        "the input has left the travel of the plan",
        Action.QUICK_STOP,
        "Check the direction of the motor encoder.",
    ),
    GUARD_OPEN: TripRule(
        "the guard was opened while the drive was on",
        Action.QUICK_STOP,
        "Close the guard; find out who opened it and why.",
    ),
    OVER_TEMPERATURE: TripRule(
        "the gear housing is too hot", Action.QUICK_STOP, "Let it cool down."
    ),
    DRIVE_FAULT: TripRule(
        "the drive reports a fault",
        Action.ZERO_TORQUE,
        "Read the drive's error code, remove the cause, acknowledge by name.",
    ),
    UNEXPECTED_STATE: TripRule(
        "the drive has left operation enabled by itself",
        Action.QUICK_STOP,
        "Check enable input, emergency stop and bus; the drive may have seen its safe torque off.",
    ),
    _DRIVE_MODE: TripRule(
        "somebody else has changed the drive's mode of operation",
        Action.QUICK_STOP,
        "Find the other master or the tool on the bus and take it off.",
    ),
    FOREIGN_COMMAND: TripRule(
        "somebody else commands the drive",
        Action.QUICK_STOP,
        "Find the other master or program on the bus and take it off; only one may send to the drive.",
    ),
    FOREIGN_SYNC: TripRule(
        "somebody else sends SYNC: the samples are not ours any more",
        Action.QUICK_STOP,
        "Find the other SYNC producer (a second master, or a node with 0x1005 bit 30) and take it off.",
    ),
    FOREIGN_TPDO: TripRule(
        "process data come twice in one cycle: somebody else sends with a node's COB-ID",
        Action.QUICK_STOP,
        "Look for two nodes with one node-ID and for a program that sends process data; check the bus for errors that "
        "make frames come twice.",
    ),
    _DRIVE_FOLLOWING: TripRule(
        "the shaft is further behind its target position than the drive allows (0x6065)",
        Action.QUICK_STOP,
        "Something blocks, a limit in the drive is too low, or the position loop is badly tuned.",
    ),
    _DRIVE_NOT_FOLLOWING: TripRule(
        "the drive does not follow its target position any more (statusword bit 12)",
        Action.QUICK_STOP,
        "Somebody halted it, or a limit of its own holds it: look with its tool.",
    ),
    FOLLOWING_ERROR: TripRule(
        "the speed does not follow its set-point",
        Action.QUICK_STOP,
        "Something blocks, a limit in the drive is too low, or the speed loop is badly tuned.",
    ),
    STALE_DATA: TripRule(
        "complete cycles have stopped arriving",
        Action.QUICK_STOP,
        "Check cables, supply and heartbeats of the nodes, and the bus load: the answers did not come later either.",
    ),
    MISSED_CYCLES: TripRule(
        "too large a share of the cycles is incomplete, late or lost",
        Action.QUICK_STOP,
        "Lower the SYNC rate or the bus load, stop other programs on this computer; look for a node that does not "
        "answer in time.",
    ),
    SIGNAL_ERROR: TripRule(
        "a device says that its own signal is not valid",
        Action.QUICK_STOP,
        "Check encoder signals, cable and supply.",
    ),
    COUNT_JUMP: TripRule(
        "an encoder count moved further than the gear can turn in a cycle",
        Action.QUICK_STOP,
        "Check shielding and wrap modulus of that counter.",
    ),
    LOST_COUNTS: TripRule(
        "an encoder has lost counts: its index mark lies elsewhere",
        Action.QUICK_STOP,
        "Check encoder signals, shielding, lines and multiplication; the angles of this run cannot be used.",
    ),
    TORQUE_PORT: TripRule(
        "the torque port is saturated or open",
        Action.QUICK_STOP,
        "Check the cable of the monitor port and its range.",
    ),
    TORQUE_DISAGREEMENT: TripRule(
        "torque port and drive disagree about the torque",
        Action.QUICK_STOP,
        "Check volts per rated torque, the gain of the monitor and the cable.",
    ),
    TORQUE_FROZEN: TripRule(
        "the torque port stands on one count while the drive's torque changes",
        Action.QUICK_STOP,
        "Check the monitor's cable and the analogue module: it sends one value again and again.",
    ),
    TORQUE_ZERO: TripRule(
        "torque port and drive have moved apart since the run began",
        Action.QUICK_STOP,
        "The port's zero drifts: check its cable, shield and supply, let the module warm up, take a new zero.",
    ),
    SLIP: TripRule(
        "input and output have slipped: they stand twisted with no torque that would do it",
        Action.QUICK_STOP,
        "Check couplings, clamping screws and both encoders' lines; the angles before and after do not fit together.",
    ),
    CREEP: TripRule(
        "the input creeps while it is commanded to stand",
        Action.QUICK_STOP,
        "Check the drive's speed offset and where it takes its set-point from.",
    ),
    THERMOMETER: TripRule(
        "the thermometer of the gear housing reads what cannot be",
        Action.QUICK_STOP,
        "Check the sensor and its line: without it nobody sees the housing's heat.",
    ),
    TIME_BASE: TripRule(
        "the time stamps do not follow the SYNC period",
        Action.QUICK_STOP,
        "Check the adapter's clock.",
    ),
    BUS_LOST: TripRule(
        "the rig does not answer any more", Action.QUICK_STOP, "Check adapter, cable and supply."
    ),
    DEVICE_ERROR: TripRule(
        "a device did not do what it must",
        Action.QUICK_STOP,
        "Look at the device that the message names.",
    ),
    EMERGENCY: TripRule(
        "a device sent an emergency message",
        Action.QUICK_STOP,
        "Look the code up in the device's manual, remove the cause.",
    ),
    _HEARTBEAT_LOST: TripRule(
        "the heartbeat of a node has stayed away",
        Action.QUICK_STOP,
        "Check supply and cable of the node.",
    ),
    BOOT_UP: TripRule(
        "a node has restarted in the middle of the run",
        Action.QUICK_STOP,
        "Check its supply: it has lost its configuration and its counts.",
    ),
    _NOT_OPERATIONAL: TripRule(
        "a node has left OPERATIONAL, and not by our word",
        Action.QUICK_STOP,
        "Look for another master on the bus; check the node.",
    ),
    _DRIVE_STATE: TripRule(
        "the drive has left operation enabled by itself",
        Action.QUICK_STOP,
        "Check enable input, emergency stop and bus; the drive may have seen its safe torque off.",
    ),
    FAULT: TripRule(
        "the drive reports a fault",
        Action.ZERO_TORQUE,
        "Read the drive's error code, remove the cause.",
    ),
    LATE_TURN: TripRule(
        "the loop that turns the rig came too late",
        Action.QUICK_STOP,
        "Stop other programs on this computer; use longer blocks or a lower SYNC rate.",
    ),
    DISK_SPACE: TripRule(
        "the disk is nearly full", Action.QUICK_STOP, "Free space or choose another folder."
    ),
    MAKE_SAFE_FAILED: TripRule(
        "the rig could not be brought to a verified standstill",
        Action.ZERO_TORQUE,
        "Press the emergency stop. Do not touch the rig before it stands and is disconnected.",
    ),
}
"""Every cause of a trip: how it ends and what it means. The first cause is latched."""

UNKNOWN_RULE = TripRule(
    "a device has told of trouble",
    Action.QUICK_STOP,
    "Look at the events of the run for what the device said.",
)
"""For causes that a port names and this table does not know."""


def rule_of(cause: str) -> TripRule:
    """The rule of a cause; a cautious one for a cause that only the port knows."""
    return TRIPS.get(cause, UNKNOWN_RULE)


@dataclass(frozen=True, slots=True)
class Trip:
    """A latched trip: cause, row, the value found, the limit that it broke and its unit."""

    cause: str
    row: int
    value: float
    limit: float
    unit: str = ""
    detail: str = ""

    @property
    def action(self) -> Action:
        """How the rig is made safe."""
        return rule_of(self.cause).action

    def __str__(self) -> str:
        rule = rule_of(self.cause)
        unit = f" {self.unit}" if self.unit else ""
        text = f"TRIPPED {self.cause}: {rule.what}"
        if not math.isnan(self.value):
            text += f"; value {self.value:.4g}{unit}, limit {self.limit:.4g}{unit}"
        text += f", row {self.row}"
        return f"{text} ({self.detail}). {rule.remedy}" if self.detail else f"{text}. {rule.remedy}"
