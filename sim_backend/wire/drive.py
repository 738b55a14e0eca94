"""A simulated servo amplifier by CiA 402 in front of the plant's motor.

Units on the wire, the same counts as the direct rig's drive: velocities 0.001 r/min (0x60A9),
torques 0.1 % of the rated torque (0x6076, mN m), positions in encoder counts (0x608F), the motor's
speed limit 0x6080 in r/min, ramps 0x6083 to 0x6085 in (r/min)/s (0x60AA). A synchronous controlword
acts from its SYNC on and shows in the statusword of the next one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from drivers.drive_state import FOLLOWS_BIT, STATUSWORD_OF, DriveState
from drivers.port import DriveLimits, Mode
from model.units import RPM
from sim_backend.position_loop import PositionLoop
from sim_backend.servo_drive import SPEED_COUNT, TORQUE_COUNT_OF_RATED
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
    entry,
)
from sim_backend.wire.pdo import Send
from sim_backend.wire.slave import (
    COMMUNICATION,
    HEARTBEAT_ERROR,
    NmtState,
    PdoPlan,
    Slave,
    standard_entries,
)
from sim_backend.wire.state_machine import (
    DISABLE_VOLTAGE,
    ENABLE,
    FAULT_RESET_BIT,
    HALT_BIT,
    QUICK_STOP,
    TRANSITIONS,
    command_of,
)

_SI_UNIT_MILLI_RPM = 0xFDB44700
"""0x60A9: prefix 10^-3, revolutions, per minute."""
_SI_UNIT_RPM_PER_SECOND = 0x00C00300
"""0x60AA: revolutions per minute, per second."""
PROFILE_VELOCITY, PROFILE_TORQUE, CYCLIC_POSITION, CYCLIC_VELOCITY, CYCLIC_TORQUE = 3, 4, 8, 9, 10
MODES = {
    PROFILE_VELOCITY: Mode.SPEED,
    CYCLIC_POSITION: Mode.SPEED,
    CYCLIC_VELOCITY: Mode.SPEED,
    PROFILE_TORQUE: Mode.TORQUE,
    CYCLIC_TORQUE: Mode.TORQUE,
}
SUPPORTED = sum(1 << (mode - 1) for mode in MODES)
_LIMIT_OBJECTS = frozenset({0x6072, 0x6080, 0x6083, 0x6084, 0x6085})
SLOW_DOWN, STAY_SLOW_DOWN, STAY = 1, 5, 6
QUICK_STOP_OPTIONS = (0, SLOW_DOWN, 2, STAY_SLOW_DOWN, STAY)
"""0x605A: 0 power off, 1 profile deceleration, 2 quick stop deceleration, then power off; 5 and 6 the same and stay."""
STANDSTILL = 0.05 * RPM
"""Speed below which a ramp is over [rad/s]."""
PROBE_ON, PROBE_CONTINUOUS, PROBE_ZERO_IMPULSE, PROBE_POSITIVE = 0x0001, 0x0002, 0x0004, 0x0010
"""Bits of the touch probe function 0x60B8; bits 2 and 3 are the source, 1 the encoder's zero impulse."""
_PROBE_STORED = 0x0002
INTERLOCK = 0x0000_0008
"""Bit 3 of the digital inputs: the guard is closed."""
FOLLOWING_ERROR = 0x8611
"""Error code of a drive whose shaft stays further behind its target position than 0x6065 for longer than 0x6066."""
_SYNC_CONTROLLER = 0x8700
"""Error code of a drive that faults because its SYNC stayed away."""
_FOLLOWING_BIT = 0x2000
"""Bit 13 of the statusword in cyclic position."""
_DRIVE_ERROR = 0x20
"""Bit 5 of the error register: device profile specific."""


@dataclass(frozen=True, kw_only=True)
class DriveDevice:
    """What the drive is built with: counts per motor revolution, rated torque [N m] and speed limit [rad/s], gains."""

    counts_per_revolution: int
    rated_torque: float
    peak_torque: float
    maximum_speed: float
    ramp: float = 1e5
    speed_gain: float = 40.0
    integral_time: float = 0.020
    cycle_ns: int = 1_000_000
    serial_number: int = 1


def _drive_entries(node_id: int, device: DriveDevice) -> list[Entry]:
    """Every object that the simulated drive really has."""
    peak = math.floor(device.peak_torque / (TORQUE_COUNT_OF_RATED * device.rated_torque) + 1e-6)
    fastest, ramp = (
        math.floor(device.maximum_speed / RPM + 1e-6),
        math.floor(device.ramp / RPM + 1e-6),
    )
    return [
        *standard_entries(node_id, 0x0002_0192, "Simulated servo amplifier", 0x402, device.serial_number),
        entry(0x6007, 0, "Abort connection option code", I16, "rw", 1, low=0, high=3),
        entry(0x603F, 0, "Error code", U16, "ro", 0, mappable="t"),
        entry(0x6040, 0, "Controlword", U16, "rw", 0, mappable="r"),
        entry(0x6041, 0, "Statusword", U16, "ro", STATUSWORD_OF[DriveState.SWITCH_ON_DISABLED], mappable="t"),
        entry(0x605A, 0, "Quick stop option code", I16, "rw", 2, low=QUICK_STOP_OPTIONS[0], high=QUICK_STOP_OPTIONS[-1]),  # noqa: E501
        entry(0x605E, 0, "Fault reaction option code", I16, "rw", 2, low=0, high=2),
        entry(0x6060, 0, "Modes of operation", I8, "rw", 0, mappable="r"),
        entry(0x6061, 0, "Modes of operation display", I8, "ro", 0, mappable="t"),
        entry(0x6064, 0, "Position actual value", I32, "ro", 0, mappable="t"),
        entry(0x606C, 0, "Velocity actual value", I32, "ro", 0, mappable="t"),
        entry(0x6065, 0, "Following error window", U32, "rw", device.counts_per_revolution // 4),
        entry(0x6066, 0, "Following error time out", U16, "rw", 50),
        entry(0x6071, 0, "Target torque", I16, "rw", 0, mappable="r"),
        entry(0x6072, 0, "Max torque", U16, "rw", peak, mappable="r"),
        entry(0x6076, 0, "Motor rated torque", U32, "ro", round(1000.0 * device.rated_torque)),
        entry(0x6077, 0, "Torque actual value", I16, "ro", 0, mappable="t"),
        entry(0x607A, 0, "Target position", I32, "rw", 0, mappable="r"),
        *array(0x607B, "Position range limit", (("min", I32, "rw", 0), ("max", I32, "rw", 0))),
        *array(0x607D, "Software position limit", (("min", I32, "rw", 0), ("max", I32, "rw", 0))),
        entry(0x6080, 0, "Max motor speed", U32, "rw", fastest),
        entry(0x6083, 0, "Profile acceleration", U32, "rw", ramp, low=1),
        entry(0x6084, 0, "Profile deceleration", U32, "rw", ramp, low=1),
        entry(0x6085, 0, "Quick stop deceleration", U32, "rw", ramp, low=1),
        *array(0x608F, "Position encoder resolution", (
            ("encoder increments", U32, "const", device.counts_per_revolution), ("motor revolutions", U32, "const", 1),
        )),
        *array(0x6091, "Gear ratio", (
            ("motor shaft revolutions", U32, "const", 1), ("driving shaft revolutions", U32, "const", 1),
        )),
        entry(0x60A9, 0, "SI unit velocity", U32, "ro", _SI_UNIT_MILLI_RPM),
        entry(0x60AA, 0, "SI unit acceleration", U32, "ro", _SI_UNIT_RPM_PER_SECOND),
        entry(0x60B0, 0, "Position offset", I32, "rw", 0, mappable="r"),
        entry(0x60B1, 0, "Velocity offset", I32, "rw", 0, mappable="r"),
        # Its current loop takes no torque that is fed forward.
        entry(0x60B2, 0, "Torque offset", I16, "rw", 0, mappable="r", low=0, high=0),
        entry(0x60B8, 0, "Touch probe function", U16, "rw", 0, mappable="r"),
        entry(0x60B9, 0, "Touch probe status", U16, "ro", 0, mappable="t"),
        entry(0x60BA, 0, "Touch probe 1 positive edge", I32, "ro", 0, mappable="t"),
        *array(0x60C2, "Interpolation time period", (("value", U8, "rw", 1), ("index", I8, "rw", -3))),
        entry(0x60F4, 0, "Following error actual value", I32, "ro", 0, mappable="t"),
        *array(0x60F9, "Velocity control parameter set", (
            ("gain in 0.1 Hz", U16, "ro", round(10.0 * device.speed_gain)),
            ("integral time in 0.01 ms", U16, "ro", round(1e5 * device.integral_time)),
        )),
        entry(0x60FD, 0, "Digital inputs", U32, "ro", INTERLOCK, mappable="t"),
        entry(0x60FF, 0, "Target velocity", I32, "rw", 0, mappable="r"),
        entry(0x6502, 0, "Supported drive modes", U32, "ro", SUPPORTED),
    ]  # fmt: skip


_DRIVE_PDOS = (
    # Set-points act at once until a master ties them to the SYNC, as CiA 402 has its default RPDOs.
    PdoPlan(1, transmit=False, mapping=(0x60400010, 0x60FF0020, 0x60600008), transmission=255),
    PdoPlan(2, transmit=False, mapping=(0x60710010,), transmission=255),
    PdoPlan(1, transmit=True, mapping=(0x60410010, 0x60640020, 0x60770010)),
    PdoPlan(2, transmit=True, mapping=(0x606C0020, 0x603F0010, 0x60610008), transmission=10),
    PdoPlan(3, transmit=True, mapping=(0x60B90010, 0x60BA0020), exists=False),
    PdoPlan(4, transmit=True, mapping=(), exists=False),
)


class Drive(Slave):
    """The servo amplifier as a node: its state machine decides what the plant is told to do.

    `ignores_quick_stop`: it says QUICK STOP ACTIVE and goes on with its last set-point;
    `ignores_stop`: it stays enabled and goes on whatever it is told;
    `ignores_targets`: it holds still and says that it does not follow its target position.
    """

    def __init__(self, node_id: int, device: DriveDevice, send: Send) -> None:
        self.device = device
        self.drive_state = DriveState.SWITCH_ON_DISABLED
        self.ignores_quick_stop = self.ignores_stop = self.ignores_targets = False
        self.limits_changed = True
        self._is_torque_off = False
        self._controlword = 0
        self._followed = (Mode.SPEED, 0.0)
        self._shown: int | None = None
        self._mark = self._armed_at = (0, 0)
        self._stored: tuple[int, int] | None = None
        self._position = self._true = 0
        self._mirror = (1, 0)
        self._position_loop = PositionLoop(device.counts_per_revolution, device.cycle_ns)
        self._cycles_behind = 0
        self._torque_count = TORQUE_COUNT_OF_RATED * device.rated_torque
        super().__init__(node_id, _drive_entries(node_id, device), _DRIVE_PDOS, send)
        d = self.dictionary
        d.on_write(0x6040, 0, lambda value: self._control(int(value)))
        d.on_write(0x605A, 0, self._check_quick_stop_option)
        d.on_write(0x6060, 0, self._check_mode)
        d.on_write(0x60B8, 0, lambda value: self._arm_probe(int(value)))
        d.on_read(0x6041, 0, self._statusword)
        d.on_read(0x6061, 0, lambda: d.value(0x6060))
        d.on_change(self._on_change)

    # What the plant is told ---------------------------------------------------------------------------------------

    def demand(self) -> tuple[Mode, float]:
        """What the plant is to do from this SYNC on: mode and set-point [rad/s or N m]."""
        state = self.drive_state
        if state is DriveState.ENABLED:
            if not (self.ignores_stop and command_of(self._controlword) != ENABLE):
                self._followed = self._setpoint()
            return (Mode.OFF, 0.0) if self._is_torque_off else self._followed
        if state is DriveState.QUICK_STOP:
            if self.ignores_quick_stop:
                return self._followed
            slow = self.dictionary.number(0x605A) in (SLOW_DOWN, STAY_SLOW_DOWN)
            return (Mode.SPEED if slow else Mode.QUICK_STOP), 0.0
        if state is DriveState.FAULT_REACTION:
            slow = self.dictionary.number(0x605E) == SLOW_DOWN
            return (Mode.SPEED if slow else Mode.QUICK_STOP), 0.0
        return Mode.OFF, 0.0

    def limits(self) -> DriveLimits:
        """The limits that its objects hold, in SI."""
        number = self.dictionary.number
        return DriveLimits(
            torque=number(0x6072) * self._torque_count,
            speed=number(0x6080) * RPM,
            acceleration=number(0x6083) * RPM,
            deceleration=number(0x6084) * RPM,
            quick_stop_deceleration=number(0x6085) * RPM,
        )

    def latch(self) -> None:
        self._shown = self._statusword()

    def send_synchronous(self) -> None:
        super().send_synchronous()
        self._shown = None

    def take(self, position: int, torque: int, index: int, seen: int, speed: float) -> None:
        """What was latched at this SYNC: counts, torque [0.1 %], count at the index mark, whether
        seen, speed [rad/s].
        """
        store = self.dictionary.store
        self._true = position
        sense, origin = self._mirror
        position, index = sense * position + origin, sense * index + origin
        self._position = position
        store(0x6064, 0, _wrap_i32(position))
        store(0x606C, 0, _wrap_i32(round(speed / SPEED_COUNT)))
        store(0x6077, 0, max(-32768, min(32767, torque)))
        self._mark = (seen & 1, index)
        self._store_probe()
        if self.drive_state is DriveState.FAULT_REACTION and abs(speed) < STANDSTILL:
            self._go(DriveState.FAULT)
        elif self.drive_state is DriveState.QUICK_STOP and self._ends_quick_stop(speed):
            self._go(DriveState.SWITCH_ON_DISABLED)

    # What happens to it -------------------------------------------------------------------------------------------

    def reverse(self) -> None:
        """Two lines of its encoder are swapped: it counts the other way from where it is."""
        self._mirror = (-self._mirror[0], self._position + self._mirror[0] * self._true)

    def fault(self, code: int, register: int = _DRIVE_ERROR, *, coasts: bool = False) -> None:
        """Something has failed: emergency, fault reaction (none for a fault of the power stage: it
        `coasts`), then fault.
        """
        if self.drive_state in (DriveState.FAULT, DriveState.FAULT_REACTION):
            return
        self.dictionary.store(0x603F, 0, code)
        powered = self.drive_state in (DriveState.ENABLED, DriveState.QUICK_STOP)
        reacts = powered and not coasts and self.dictionary.number(0x605E) != 0
        self._go(DriveState.FAULT_REACTION if reacts else DriveState.FAULT)
        self.emergency(code, register)

    def safe_torque_off(self, is_off: bool) -> None:
        """The hardwired stop: torque is gone at once, whatever software wants; no voltage at the
        power stage meanwhile.
        """
        self._is_torque_off = is_off
        if is_off and self.drive_state not in (DriveState.FAULT, DriveState.FAULT_REACTION):
            self._go(DriveState.SWITCH_ON_DISABLED)

    def open_guard(self, is_open: bool) -> None:
        """The contact of the guard, seen in the digital inputs; the drive itself does nothing about it."""
        self.dictionary.store(0x60FD, 0, 0 if is_open else INTERLOCK)

    def ignore_lost_master(self) -> None:
        """It does nothing by itself when the communication fails (0x6007)."""
        self.dictionary.store(0x6007, 0, 0)

    def on_heartbeat_lost(self, producer: int) -> None:
        self._connection_lost()

    def on_sync_lost(self) -> None:
        self._connection_lost(_SYNC_CONTROLLER)

    def on_nmt(self, state: NmtState) -> None:
        if state is NmtState.STOPPED:
            self._connection_lost()

    def on_reset(self, application: bool) -> None:
        if not application:
            self._connection_lost()
            return
        self._controlword = 0
        self.limits_changed = True
        self._store_probe()
        self.drive_state = DriveState.SWITCH_ON_DISABLED

    def _ends_quick_stop(self, speed: float) -> bool:
        """Whether the ramp is over and the option code does not let the drive stay (transition 12)."""
        stays = self.ignores_quick_stop or self.dictionary.number(0x605A) >= STAY_SLOW_DOWN
        return abs(speed) < STANDSTILL and not stays

    def _connection_lost(self, code: int = HEARTBEAT_ERROR) -> None:
        """0x6007: 0 nothing, 1 fault, 2 disable voltage, 3 quick stop."""
        option = self.dictionary.number(0x6007)
        if self.drive_state not in (DriveState.ENABLED, DriveState.QUICK_STOP) or option == 0:
            return
        if option == 1:
            self.fault(code, COMMUNICATION)
        elif option == 2:
            self._go(DriveState.SWITCH_ON_DISABLED)
        else:
            self._step(QUICK_STOP)

    # Objects ------------------------------------------------------------------------------------------------------

    def _setpoint(self) -> tuple[Mode, float]:
        mode = MODES.get(self.dictionary.number(0x6060), Mode.OFF)
        halts = self._controlword & HALT_BIT
        if mode is Mode.TORQUE:
            return mode, 0.0 if halts else self.dictionary.number(0x6071) * self._torque_count
        if mode is Mode.SPEED and self._is_by_position and self._follows:
            return mode, self._follow_position()
        if mode is Mode.SPEED and not halts and not self._is_by_position:
            return mode, self.dictionary.number(0x60FF) * SPEED_COUNT
        return Mode.SPEED, 0.0

    @property
    def _is_by_position(self) -> bool:
        return self.dictionary.number(0x6060) == CYCLIC_POSITION

    @property
    def _follows(self) -> bool:
        """Whether it goes after its target position: halted, or out of use, it holds still."""
        return not (self._controlword & HALT_BIT or self.ignores_targets)

    def _follow_position(self) -> float:
        """The speed by which it goes after its target position, offset included; too far behind it is a fault."""
        number = self.dictionary.number
        speed = self._position_loop.demand(
            number(0x607A) + number(0x60B0), _wrap_i32(self._position)
        )
        error, window = self._position_loop.error, number(0x6065)
        self.dictionary.store(0x60F4, 0, error)
        self._cycles_behind = self._cycles_behind + 1 if abs(error) > window else 0
        if self._cycles_behind * self.device.cycle_ns > number(0x6066) * 1_000_000:
            self._cycles_behind = 0
            self.fault(FOLLOWING_ERROR)
        return speed + number(0x60B1) * SPEED_COUNT

    def _control(self, controlword: int) -> None:
        rises = controlword & FAULT_RESET_BIT and not self._controlword & FAULT_RESET_BIT
        self._controlword = controlword
        if self.drive_state is DriveState.FAULT:
            if rises:
                self.dictionary.store(0x603F, 0, 0)
                self._go(DriveState.SWITCH_ON_DISABLED)
                self.recover()
        elif not controlword & FAULT_RESET_BIT:
            self._step(command_of(controlword))

    def _step(self, command: str) -> None:
        state, option = self.drive_state, self.dictionary.number(0x605A)
        target = TRANSITIONS.get((state, command))
        if target is None or (self.ignores_stop and state is DriveState.ENABLED):
            return
        if target is DriveState.QUICK_STOP and option == 0:
            target = DriveState.SWITCH_ON_DISABLED
        if state is DriveState.QUICK_STOP and command == ENABLE and option < STAY_SLOW_DOWN:
            return
        if (
            self._is_torque_off
            and command != DISABLE_VOLTAGE
            and target is not DriveState.SWITCH_ON_DISABLED
        ):
            return
        self._go(target)

    def _go(self, state: DriveState) -> None:
        if state is not self.drive_state:
            if state is DriveState.ENABLED:
                self._position_loop.begin(self.dictionary.number(0x607A))
            self.drive_state = state
            self.value_changed(0x6041)

    def _check_mode(self, value: Number) -> None:
        if int(value) != 0 and int(value) not in MODES:
            raise AbortError(Abort.VALUE)

    def _check_quick_stop_option(self, value: Number) -> None:
        if int(value) not in QUICK_STOP_OPTIONS:
            raise AbortError(Abort.VALUE)

    def _on_change(self, index: int, sub: int) -> None:
        if index in _LIMIT_OBJECTS:
            self.limits_changed = True

    def _statusword(self) -> int:
        if self._shown is not None:
            return self._shown
        word = STATUSWORD_OF[self.drive_state]
        if self.drive_state is DriveState.ENABLED and self._is_by_position and self._follows:
            word |= FOLLOWS_BIT
        if self._cycles_behind:
            word |= _FOLLOWING_BIT
        return word & ~0x0010 if self._is_torque_off else word

    # The latch of the encoder's index mark ------------------------------------------------------------------------

    def _arm_probe(self, function: int) -> None:
        self._armed_at = self._mark
        self._stored = None
        self._store_probe(function)

    def _store_probe(self, function: int | None = None) -> None:
        """Touch probe 1: a mark that passes after it was switched on is stored, every one or only the first."""
        function = self.dictionary.number(0x60B8) if function is None else function
        is_on = (
            function & PROBE_ON
            and function & 0x000C == PROBE_ZERO_IMPULSE
            and function & PROBE_POSITIVE
        )
        has_passed = self._mark != self._armed_at and self._mark[0]
        if is_on and has_passed and (self._stored is None or function & PROBE_CONTINUOUS):
            self._stored = self._mark
        stored = self._stored if is_on else None
        status = (PROBE_ON if function & PROBE_ON else 0) | (_PROBE_STORED if stored else 0)
        self.dictionary.store(0x60B9, 0, status)
        self.dictionary.store(0x60BA, 0, _wrap_i32(stored[1]) if stored else 0)


def _wrap_i32(value: int) -> int:
    """A count as the 32-bit signed counter of a device shows it."""
    return (value + 0x8000_0000) % 0x1_0000_0000 - 0x8000_0000
