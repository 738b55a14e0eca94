"""A simulated servo amplifier by CiA 402 in front of the plant's motor.

Velocities on the wire are in 0.001 r/min (0x60A9 says so), torques in 0.1 % of the rated torque, positions in encoder
counts, profile accelerations in 0.001 r/min per second.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from drivers.drive_state import STATUSWORD_OF, DriveState
from drivers.port import DriveLimits, Mode
from sim_backend.wire.dictionary import (
    I8,
    I16,
    I32,
    U8,
    U16,
    U32,
    Abort,
    AbortError,
    Entry,
    Number,
    array,
)
from sim_backend.wire.pdo import Send
from sim_backend.wire.slave import NmtState, PdoPlan, Slave, standard_entries

RPM = 2.0 * math.pi / 60.0
VELOCITY_UNIT = 1e-3 * RPM
"""rad/s per increment of 0x60FF, 0x606C, 0x6080; rad/s2 per increment of the profile accelerations."""
SI_UNIT_MILLI_RPM = 0xFDB44700
"""0x60A9: prefix 10^-3, revolutions per minute."""
PROFILE_VELOCITY, PROFILE_TORQUE, CYCLIC_VELOCITY, CYCLIC_TORQUE = 3, 4, 9, 10
MODES = {
    PROFILE_VELOCITY: Mode.SPEED,
    CYCLIC_VELOCITY: Mode.SPEED,
    PROFILE_TORQUE: Mode.TORQUE,
    CYCLIC_TORQUE: Mode.TORQUE,
}
SUPPORTED = sum(1 << (mode - 1) for mode in MODES)

SHUTDOWN, SWITCH_ON, ENABLE, DISABLE_VOLTAGE, QUICK_STOP = "shutdown", "switch on", "enable", "disable voltage", "quick stop"

S = DriveState
TRANSITIONS: dict[tuple[DriveState, str], DriveState] = {
    (S.SWITCH_ON_DISABLED, SHUTDOWN): S.READY,
    (S.READY, SWITCH_ON): S.SWITCHED_ON,
    (S.READY, ENABLE): S.SWITCHED_ON,
    (S.READY, DISABLE_VOLTAGE): S.SWITCH_ON_DISABLED,
    (S.READY, QUICK_STOP): S.SWITCH_ON_DISABLED,
    (S.SWITCHED_ON, SHUTDOWN): S.READY,
    (S.SWITCHED_ON, ENABLE): S.ENABLED,
    (S.SWITCHED_ON, DISABLE_VOLTAGE): S.SWITCH_ON_DISABLED,
    (S.SWITCHED_ON, QUICK_STOP): S.SWITCH_ON_DISABLED,
    (S.ENABLED, SHUTDOWN): S.READY,
    (S.ENABLED, SWITCH_ON): S.SWITCHED_ON,
    (S.ENABLED, DISABLE_VOLTAGE): S.SWITCH_ON_DISABLED,
    (S.ENABLED, QUICK_STOP): S.QUICK_STOP,
    (S.QUICK_STOP, DISABLE_VOLTAGE): S.SWITCH_ON_DISABLED,
    (S.QUICK_STOP, ENABLE): S.ENABLED,
}
"""CiA 402-2 power drive state machine: (state, command) -> state. Everything else leaves the state as it is."""


def command_of(controlword: int) -> str:
    """The command that a controlword's bits 0-3 stand for (CiA 402-2, table of command coding)."""
    if not controlword & 0x02:
        return DISABLE_VOLTAGE
    if not controlword & 0x04:
        return QUICK_STOP
    if not controlword & 0x01:
        return SHUTDOWN
    return ENABLE if controlword & 0x08 else SWITCH_ON


@dataclass(frozen=True)
class DriveDevice:
    """What the drive is built with: counts per motor revolution, rated torque and speed in SI, and its serial number."""

    counts_per_revolution: int
    rated_torque: float
    rated_speed: float
    peak_torque: float
    serial_number: int = 1


def drive_entries(node_id: int, device: DriveDevice) -> list[Entry]:
    """Every object that the simulated drive really has."""
    peak = round(1000.0 * device.peak_torque / device.rated_torque)
    fastest = round(2.0 * device.rated_speed / VELOCITY_UNIT)
    ramp = round(1e5 / VELOCITY_UNIT)
    gear = (("motor shaft revolutions", U32, "rw", 1), ("driving shaft revolutions", U32, "rw", 1))
    return [
        *standard_entries(node_id, 0x0002_0192, "Simulated servo amplifier", 0x402, device.serial_number),
        Entry(0x6007, 0, "Abort connection option code", I16, "rw", 1, low=0, high=3),
        Entry(0x603F, 0, "Error code", U16, "ro", 0, "t"),
        Entry(0x6040, 0, "Controlword", U16, "rw", 0, "r"),
        Entry(0x6041, 0, "Statusword", U16, "ro", 0, "t"),
        Entry(0x605A, 0, "Quick stop option code", I16, "rw", 2, low=0, high=6),
        Entry(0x605E, 0, "Fault reaction option code", I16, "rw", 2, low=0, high=2),
        Entry(0x6060, 0, "Modes of operation", I8, "rw", 0, "r"),
        Entry(0x6061, 0, "Modes of operation display", I8, "ro", 0, "t"),
        Entry(0x6064, 0, "Position actual value", I32, "ro", 0, "t"),
        Entry(0x606C, 0, "Velocity actual value", I32, "ro", 0, "t"),
        Entry(0x6071, 0, "Target torque", I16, "rw", 0, "r"),
        Entry(0x6072, 0, "Max torque", U16, "rw", peak, "r", high=peak),
        Entry(0x6076, 0, "Motor rated torque", U32, "ro", round(1000.0 * device.rated_torque)),
        Entry(0x6077, 0, "Torque actual value", I16, "ro", 0, "t"),
        Entry(0x6080, 0, "Max motor speed", U32, "rw", fastest, high=fastest),
        Entry(0x6083, 0, "Profile acceleration", U32, "rw", ramp, low=1),
        Entry(0x6084, 0, "Profile deceleration", U32, "rw", ramp, low=1),
        Entry(0x6085, 0, "Quick stop deceleration", U32, "rw", ramp, low=1),
        *array(0x608F, "Position encoder resolution", (
            ("encoder increments", U32, "const", device.counts_per_revolution), ("motor revolutions", U32, "const", 1),
        )),
        *array(0x6091, "Gear ratio", gear),  # type: ignore[arg-type]
        Entry(0x60A9, 0, "SI unit velocity", U32, "ro", SI_UNIT_MILLI_RPM),
        *array(0x60BA, "Latched index position", (("motor encoder", I32, "ro", 0),), mappable="t"),
        Entry(0x60FF, 0, "Target velocity", I32, "rw", 0, "r"),
        Entry(0x6502, 0, "Supported drive modes", U32, "ro", SUPPORTED),
        Entry(0x2010, 0, "Index marks seen", U8, "ro", 0, "t"),
        *array(0x60F9, "Velocity control parameter set", (
            ("gain [0.1 Hz]", U16, "rw", 400), ("integral time [0.01 ms]", U16, "rw", 2000),
        )),
    ]  # fmt: skip


DRIVE_PDOS = (
    PdoPlan(1, transmit=False, mapping=(0x60400010, 0x60FF0020, 0x60600008)),
    PdoPlan(2, transmit=False, mapping=(0x60710010,)),
    PdoPlan(1, transmit=True, mapping=(0x60410010, 0x60640020, 0x60770010)),
    PdoPlan(2, transmit=True, mapping=(0x606C0020, 0x603F0010, 0x60610008), transmission=10),
)


class Drive(Slave):
    """The servo amplifier as a node: its state machine decides what the plant is told to do."""

    def __init__(self, node_id: int, device: DriveDevice, send: Send) -> None:
        super().__init__(node_id, drive_entries(node_id, device), DRIVE_PDOS, send)
        self.device = device
        self.drive_state = DriveState.SWITCH_ON_DISABLED
        self.obeys_quick_stop = True
        self._is_torque_off = False
        self._last_controlword = 0
        self._speed = 0.0
        d = self.dictionary
        d.on_write(0x6040, 0, lambda value: self._control(int(value)))
        d.on_write(0x6060, 0, self._check_mode)
        d.on_read(0x6041, 0, self._statusword)
        d.on_read(0x6061, 0, lambda: d.value(0x6060))

    def demand(self) -> tuple[Mode, float]:
        """What the plant is to do from this SYNC on: mode and set-point in SI."""
        if self.drive_state in (DriveState.QUICK_STOP, DriveState.FAULT_REACTION):
            return (Mode.QUICK_STOP, 0.0) if self.obeys_quick_stop else self._setpoint()
        if self.drive_state is not DriveState.ENABLED or self._is_torque_off:
            return Mode.OFF, 0.0
        return self._setpoint()

    def limits(self) -> DriveLimits:
        """The limits that the drive holds, in SI."""
        d = self.dictionary
        return DriveLimits(
            torque=d.number(0x6072) * 1e-3 * self.device.rated_torque,
            speed=d.number(0x6080) * VELOCITY_UNIT,
            acceleration=d.number(0x6083) * VELOCITY_UNIT,
            deceleration=d.number(0x6084) * VELOCITY_UNIT,
            quick_stop_deceleration=d.number(0x6085) * VELOCITY_UNIT,
        )

    def take(self, position: int, speed: float, torque_permille: int, index: int, seen: int) -> None:
        """The values latched at this SYNC: counts (unwrapped), speed [rad/s], torque [0.1 %], latched index, seen."""
        store = self.dictionary.store
        store(0x6064, 0, wrap_i32(position))
        store(0x606C, 0, wrap_i32(round(speed / VELOCITY_UNIT)))
        store(0x6077, 0, max(-32768, min(32767, torque_permille)))
        store(0x60BA, 1, wrap_i32(index))
        store(0x2010, 0, seen & 1)
        self._speed = speed
        if self.drive_state is DriveState.FAULT_REACTION and abs(speed) < 1.0 * RPM:
            self._go(DriveState.FAULT)
        stays = self.dictionary.number(0x605A) in (5, 6)
        if self.drive_state is DriveState.QUICK_STOP and not stays and abs(speed) < 0.05 * RPM and self.obeys_quick_stop:
            self._go(DriveState.SWITCH_ON_DISABLED)

    def fault(self, code: int, register: int = 0x21) -> None:
        """Something in the drive has failed: emergency message, fault reaction, then fault."""
        self.dictionary.store(0x603F, 0, code)
        powered = self.drive_state in (DriveState.ENABLED, DriveState.QUICK_STOP)
        reacts = powered and self.dictionary.number(0x605E) != 0
        self._go(DriveState.FAULT_REACTION if reacts else DriveState.FAULT)
        self.emergency(code, register)

    def safe_torque_off(self, is_off: bool) -> None:
        """The hardwired stop: torque is gone at once, whatever software wants."""
        self._is_torque_off = is_off
        if is_off:
            self._go(DriveState.SWITCH_ON_DISABLED)

    def on_heartbeat_lost(self, producer: int) -> None:
        self._connection_lost()

    def on_nmt(self, state: NmtState) -> None:
        if state is not NmtState.OPERATIONAL and self.drive_state is DriveState.ENABLED:
            self._connection_lost()

    def on_reset(self) -> None:
        self._last_controlword = 0
        self._go(DriveState.SWITCH_ON_DISABLED)

    def _connection_lost(self) -> None:
        """0x6007: 0 nothing, 1 fault, 2 disable voltage, 3 quick stop."""
        option = self.dictionary.number(0x6007)
        if self.drive_state is not DriveState.ENABLED or option == 0:
            return
        if option == 1:
            self.fault(0x8130, 0x11)
        else:
            self._go(DriveState.QUICK_STOP if option == 3 else DriveState.SWITCH_ON_DISABLED)

    def _setpoint(self) -> tuple[Mode, float]:
        mode = MODES.get(self.dictionary.number(0x6060), Mode.OFF)
        if mode is Mode.TORQUE:
            return mode, self.dictionary.number(0x6071) * 1e-3 * self.device.rated_torque
        if mode is Mode.SPEED:
            return mode, self.dictionary.number(0x60FF) * VELOCITY_UNIT
        return Mode.SPEED, 0.0

    def _control(self, controlword: int) -> None:
        rising_reset = controlword & 0x80 and not self._last_controlword & 0x80
        self._last_controlword = controlword
        if self.drive_state is DriveState.FAULT:
            if rising_reset:
                self.dictionary.store(0x603F, 0, 0)
                self._go(DriveState.SWITCH_ON_DISABLED)
                self.emergency(0)
            return
        if controlword & 0x80:
            return
        command = command_of(controlword)
        target = TRANSITIONS.get((self.drive_state, command))
        if target is DriveState.READY and self._is_torque_off:
            return
        if target is DriveState.QUICK_STOP and self.dictionary.number(0x605A) == 0:
            target = DriveState.SWITCH_ON_DISABLED
        if target is not None:
            self._go(target)

    def _go(self, state: DriveState) -> None:
        if state is not self.drive_state:
            self.drive_state = state
            self.value_changed(0x6041)

    def _check_mode(self, value: Number) -> None:
        if int(value) != 0 and int(value) not in MODES:
            raise AbortError(Abort.VALUE)

    def _statusword(self) -> int:
        word = STATUSWORD_OF[self.drive_state]
        if self._is_torque_off:
            word &= ~0x0010
        if self.state is not NmtState.OPERATIONAL:
            word &= ~0x0200
        return word


def wrap_i32(value: int) -> int:
    """A count as the 32-bit signed counter of a device shows it."""
    return (value + 0x8000_0000) % 0x1_0000_0000 - 0x8000_0000
