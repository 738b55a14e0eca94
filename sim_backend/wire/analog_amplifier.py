"""A simulated SERVOPACK by analog reference behind the terminals of a CiA 401 coupler.

    output 1  servo-on (/S-ON)            input 1  alarm (ALM: 1 while there is none)
    output 2  alarm reset (/ALM-RST)      input 2  power on the motor (/BK: 1 while the brake would be open)
    reference V-REF, 16 bits over 10 V    input 3  ready (/S-RDY)        input 5  rotation detected (/TGON)
                                          input 4  speed coincidence (/V-CMP)      input 6  the guard's contact

The amplifier knows volts: its reference has an offset and a gain of its own (`ReferenceDevice`) and a filter. It holds
the limits that somebody has set by its tool. Whoever has lost alarm or hard wire base block must take servo-on away
before it switches on again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from drivers.drive_state import DriveState
from drivers.port import DriveLimits, Mode
from model.units import RPM
from sim_backend.wire.dictionary import I16, I32, U8, Entry, array
from sim_backend.wire.pdo import Send
from sim_backend.wire.slave import NmtState, PdoPlan, Slave, standard_entries

SERVO_ON, ALARM_RESET = 0x01, 0x02
"""Bits of the outputs."""
NO_ALARM, POWER, READY, COINCIDENCE, ROTATION, GUARD = 0x01, 0x02, 0x04, 0x08, 0x10, 0x20
"""Bits of the inputs."""
VOLTS_PER_COUNT = 10.0 / 32768.0
STANDSTILL = 0.05 * RPM
"""Speed below which a fault's ramp is over [rad/s]."""


@dataclass(frozen=True, kw_only=True)
class ReferenceDevice:
    """What the amplifier is and how it was set: V at rated speed (Pn300), the reference's own offset [V] and relative
    gain error after it was adjusted (Fn009), its filter [s] (Pn307), widths of coincidence (Pn503) and of rotation
    (Pn502) [rad/s], and its limits.
    """

    limits: DriveLimits
    rated_speed: float = 3000.0 * RPM
    rated_volts: float = 6.0
    offset_volts: float = 2e-4
    gain_error: float = 2e-3
    filter_time: float = 4e-4
    coincidence: float = 10.0 * RPM
    rotation: float = 20.0 * RPM
    serial_number: int = 1

    @property
    def speed_per_volt(self) -> float:
        """The nominal scale [rad/s per V]."""
        return self.rated_speed / self.rated_volts


def coupler_entries(node_id: int, serial: int) -> list[Entry]:
    """Every object that the simulated coupler really has."""
    return [
        *standard_entries(node_id, 0x000B_0191, "Simulated coupler", 0x403, serial),
        *array(0x6000, "Read input 8-bit", [("inputs 1 to 8", U8, "ro", NO_ALARM)], mappable="t"),
        *array(0x6200, "Write output 8-bit", [("outputs 1 to 8", U8, "rw", 0)], mappable="r"),
        *array(0x6206, "Error mode output 8-bit", [("outputs 1 to 8", U8, "rw", 0xFF)]),
        *array(0x6207, "Error value output 8-bit", [("outputs 1 to 8", U8, "rw", 0)]),
        *array(0x6411, "Write analogue output 16-bit", [("output 1", I16, "rw", 0)], mappable="r"),
        *array(0x6443, "Analogue output error mode", [("output 1", U8, "rw", 1)]),
        *array(0x6444, "Analogue output error value integer", [("output 1", I32, "rw", 0)]),
    ]


COUPLER_PDOS = (
    PdoPlan(1, transmit=False, mapping=(0x62000108,), transmission=255),
    PdoPlan(2, transmit=False, mapping=(0x64110110,), transmission=255),
    PdoPlan(1, transmit=True, mapping=(0x60000108,)),
)


class AnalogAmplifier(Slave):
    """The coupler as a node, with the amplifier behind it: what the plant is told follows from volts and contacts.

    `ignores_quick_stop`: the reference hangs at what it was when it is taken back; `ignores_stop`: it stays on and goes
    on whatever it is told. `added_volts` and `is_cut`: what becomes of the reference on its way.
    """

    def __init__(self, node_id: int, device: ReferenceDevice, cycle_ns: int, send: Send) -> None:
        self.device = device
        self.ignores_quick_stop = self.ignores_stop = False
        self.limits_changed = True
        self._kept = math.exp(-cycle_ns * 1e-9 / device.filter_time)
        self._is_powered = self._is_torque_off = self._is_guard_open = False
        self._waits_for_off = self._is_reacting = self._is_resetting = False
        self._alarm = 0
        self._speed = self._reference = 0.0
        self._shown: int | None = None
        self.added_volts, self.is_cut = 0.0, False
        self._stuck: dict[int, bool] = {}
        entries = coupler_entries(node_id, device.serial_number)
        super().__init__(node_id, entries, COUPLER_PDOS, send)
        self.dictionary.on_read(0x6000, 1, self._inputs)
        self.dictionary.on_change(self._on_change)

    # What the plant is told ---------------------------------------------------------------------------------------

    @property
    def drive_state(self) -> DriveState:
        """Where the amplifier is, in the words of CiA 402."""
        if self._alarm:
            return DriveState.FAULT_REACTION if self._is_reacting else DriveState.FAULT
        return DriveState.ENABLED if self._is_powered else DriveState.SWITCH_ON_DISABLED

    def demand(self) -> tuple[Mode, float]:
        """What the plant is to do from this SYNC on: mode and set-point [rad/s]."""
        if self._is_reacting:
            return Mode.QUICK_STOP, 0.0
        if not self._is_powered:
            self._reference = 0.0
            return Mode.OFF, 0.0
        wanted = self._wanted()
        hangs = self.ignores_stop or (
            self.ignores_quick_stop and abs(wanted) < abs(self._reference)
        )
        if not hangs:
            self._reference = wanted + (self._reference - wanted) * self._kept
        return Mode.SPEED, self._reference

    def _wanted(self) -> float:
        """The speed that stands at its terminals [rad/s]."""
        volts = self.dictionary.number(0x6411, 1) * VOLTS_PER_COUNT + self.device.offset_volts
        volts = self.device.offset_volts if self.is_cut else volts + self.added_volts
        return volts * self.device.speed_per_volt * (1.0 + self.device.gain_error)

    def limits(self) -> DriveLimits:
        """What somebody has set by its tool."""
        return self.device.limits

    def take(self, speed: float) -> None:
        """The motor's speed at this SYNC [rad/s]."""
        self._speed = speed
        if self._is_reacting and abs(speed) < STANDSTILL:
            self._is_reacting = self._is_powered = False

    def latch(self) -> None:
        self._shown = self._inputs()

    def send_synchronous(self) -> None:
        super().send_synchronous()
        self._shown = None

    # What happens to it -------------------------------------------------------------------------------------------

    def fault(self, code: int, register: int = 0, *, coasts: bool = False) -> None:
        """An alarm: it stops the motor by zero speed, or lets it coast, and tells it by its contact alone."""
        if self._alarm:
            return
        self._alarm = code
        self._is_reacting = self._is_powered and not coasts
        self._is_powered = self._is_reacting
        self._waits_for_off = True
        self.value_changed(0x6000, 1)

    def safe_torque_off(self, is_off: bool) -> None:
        """The hard wire base block: power is gone at once, and comes back only by servo-on taken away and given."""
        self._is_torque_off = is_off
        if is_off:
            self._is_powered = self._is_reacting = False
            self._waits_for_off = True
        self.value_changed(0x6000, 1)

    def open_guard(self, is_open: bool) -> None:
        """The contact of the guard, seen in the inputs."""
        self._is_guard_open = is_open
        self.value_changed(0x6000, 1)

    def stick(self, bit: int, says: bool | None) -> None:
        """A contact says the same for ever, or (None) what is true again."""
        if says is None:
            self._stuck.pop(bit, None)
        else:
            self._stuck[bit] = says

    def ignore_lost_master(self) -> None:
        """Its outputs stay as they are when the communication fails."""
        for index in (0x6206, 0x6443):
            self.dictionary.store(index, 1, 0)

    def on_heartbeat_lost(self, producer: int) -> None:
        self._to_error_values()

    def on_sync_lost(self) -> None:
        self._to_error_values()

    def on_nmt(self, state: NmtState) -> None:
        if state is NmtState.STOPPED:
            self._to_error_values()

    def on_reset(self, application: bool) -> None:
        self._switch()

    def _to_error_values(self) -> None:
        """CiA 401: outputs whose error mode says so take their error value when the communication has failed."""
        d = self.dictionary
        mode, value = d.number(0x6206, 1), d.number(0x6207, 1)
        d.store(0x6200, 1, d.number(0x6200, 1) & ~mode | value & mode)
        if d.number(0x6443, 1):
            d.store(0x6411, 1, d.number(0x6444, 1) >> 16)
        self._switch()

    # Contacts -----------------------------------------------------------------------------------------------------

    def _on_change(self, index: int, sub: int) -> None:
        if index == 0x6200:
            self._switch()

    def _switch(self) -> None:
        """Servo-on and alarm reset act as soon as they stand at the terminals."""
        outputs = self.dictionary.number(0x6200, 1)
        is_on, resets = bool(outputs & SERVO_ON), bool(outputs & ALARM_RESET)
        if resets and not self._is_resetting and not is_on and not self._is_reacting:
            self._alarm = 0
        self._is_resetting = resets
        if not is_on:
            self._waits_for_off = False
        before = self._is_powered
        if self._is_reacting:
            # An alarm's own stop is not cut short.
            return
        may = not (self._alarm or self._is_torque_off or self._waits_for_off)
        self._is_powered = may and (is_on or (before and self.ignores_stop))
        if self._is_powered is not before:
            self.value_changed(0x6000, 1)

    def _inputs(self) -> int:
        if self._shown is not None:
            return self._shown
        device = self.device
        reached = self._is_powered and abs(self._speed - self._wanted()) < device.coincidence
        says = {
            NO_ALARM: not self._alarm,
            POWER: self._is_powered,
            READY: not (self._alarm or self._is_torque_off),
            COINCIDENCE: reached,
            ROTATION: abs(self._speed) > device.rotation,
            GUARD: not self._is_guard_open,
            **self._stuck,
        }
        return sum(bit for bit, is_on in says.items() if is_on)
