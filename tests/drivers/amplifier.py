"""A servo amplifier by CiA 402 for somebody else's CANopen stack, in front of the simulated plant.

The stack is a base class beside it (durand's, CANopenNode's): NMT, SDO, process data, heartbeats and emergency messages
are the stack's, what they mean to a motor is here. Nothing of it is shared with the drivers or with the simulated
drive: state machine, option codes and units are read anew from CiA 402, and where the standard leaves a choice it is
another one. Speeds are in increments/s (0x60A9), ramps in increments/s2 (0x60AA), positions wrap soon after the start.
It makes one transition at a time, the power stage and the brake take their time, and its control loop takes a
synchronous set-point up one period after its SYNC.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from enum import Enum
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from durand.object_dictionary import Record, Variable
from durand.services.nmt import StateEnum

from drivers.drive_state import DriveState
from drivers.port import DriveLimits, Mode
from model.units import REVOLUTION, RPM
from sim_backend.wire.drive import DriveDevice
from tests.drivers.durand_node import I8, I16, I32, U8, U16, U32, Timer, Timers


class Power(Enum):
    """The states of CiA 402, by the bits of the statusword that tell them."""

    NOT_READY = 0x00
    DISABLED = 0x40
    READY = 0x21
    ON = 0x23
    ENABLED = 0x27
    QUICK_STOP = 0x07
    REACTION = 0x0F
    FAULT = 0x08


POWERED = frozenset({Power.ENABLED, Power.QUICK_STOP, Power.REACTION})
LASTS = {Power.ON: 4e-3, Power.ENABLED: 15e-3}
"""s that a state takes to reach: the intermediate circuit, the brake."""
VOLTAGE, REMOTE, TARGET_REACHED, FOLLOWS = 0x0010, 0x0200, 0x0400, 0x1000
PROFILE_POSITION, PROFILE_VELOCITY = 1, 3
CYCLIC_POSITION, CYCLIC_VELOCITY, CYCLIC_TORQUE = 8, 9, 10
SUPPORTED = 0b11_1010_0101
"""PP, PV, HM, CSP, CSV, CST, as amplifiers of several makers have it."""
CURRENT_PER_TORQUE = 2.5
"""A per N m: the motor has a rated current as well."""
STANDSTILL = 0.05
"""rad/s."""
GUARD_CLOSED = 0x0000_0008
START_COUNT = 0x7FFF_F000
"""Position at power-on: an eighth of a revolution before the end of its range."""
SECOND_ORDER = 0x00B5_5700
"""0x60AA: increments per square second."""
LIMITS = (0x6072, 0x6080, 0x6083, 0x6084, 0x6085)
PULL = 60.0
"""rad/s of speed per rad that the shaft is off its target position."""


class Amplifier:
    """The amplifier as a device on a `WireBench`: what that asks of its own drive, this one answers.

    To be mixed with a node, which brings `od`, `timers`, `emergency` and `synchronise`, calls `build`, `on_nmt` and
    `on_heartbeat_lost`, and is made with a node-ID and a function that sends.
    """

    stack_name = b""

    if TYPE_CHECKING:
        od: Any
        timers: Timers
        emergency: Callable[..., None]
        synchronise: Callable[[], None]

    def __init__(
        self, node_id: int, device: DriveDevice, send: Callable[[int, bytes], None]
    ) -> None:
        self.device = device
        self.power = Power.DISABLED
        self.word = 0
        self.words: list[int] = []
        self.ignores_quick_stop = self.ignores_stop = self.limits_changed = False
        self._is_torque_off = False
        self._next: tuple[Power, Timer] | None = None
        self._last = (Mode.OFF, 0.0)
        self._aim = 0
        self._origin: int | None = None
        self._position, self._sense = 0, 1
        self._count = REVOLUTION / device.counts_per_revolution
        super().__init__(node_id, send)  # type: ignore[call-arg]
        self.dictionary = Objects(self)

    def build(self) -> None:
        device, od = self.device, self.od
        ramp = min(round(1e5 / self._count), (1 << 32) - 1)
        peak = math.floor(1000.0 * device.peak_torque / device.rated_torque)
        milli = round(1000.0 * device.rated_torque)
        for index, kind, access, value in (
            (0x6007, I16, "rw", 1), (0x603F, U16, "ro", 0), (0x6040, U16, "rw", 0), (0x6041, U16, "ro", 0),
            (0x605A, I16, "rw", 2), (0x605E, I16, "rw", 2), (0x6060, I8, "rw", PROFILE_POSITION),
            (0x6061, I8, "ro", PROFILE_POSITION), (0x6064, I32, "ro", 0), (0x606C, I32, "ro", 0),
            (0x6071, I16, "rw", 0), (0x6072, U16, "rw", peak), (0x6075, U32, "ro", round(CURRENT_PER_TORQUE * milli)),
            (0x6076, U32, "ro", milli), (0x6077, I16, "ro", 0), (0x607A, I32, "rw", 0),
            (0x607F, U32, "rw", 0xFFFF_FFFF), (0x6080, U32, "rw", round(device.maximum_speed / RPM)),
            (0x6081, U32, "rw", 0), (0x6083, U32, "rw", ramp), (0x6084, U32, "rw", ramp), (0x6085, U32, "rw", ramp),
            (0x60A8, U32, "ro", 0x00B5_0000), (0x60A9, U32, "ro", 0x00B5_0300), (0x60AA, U32, "ro", SECOND_ORDER),
            (0x60FD, U32, "ro", GUARD_CLOSED), (0x60FF, I32, "rw", 0), (0x6502, U32, "ro", SUPPORTED),
        ):  # fmt: skip
            od[index] = Variable(kind, access, value)
        for index, values, kinds, access in (
            (0x607B, (-(1 << 31), (1 << 31) - 1), (I32, I32), "rw"),
            (0x607D, (-(1 << 31), (1 << 31) - 1), (I32, I32), "rw"),
            (0x608F, (device.counts_per_revolution, 1), (U32, U32), "ro"),
            (0x6091, (1, 1), (U32, U32), "ro"),
            (0x6092, (device.counts_per_revolution, 1), (U32, U32), "ro"),
            (0x60C2, (8, -3), (U8, I8), "rw"),
        ):
            od[index] = record = Record()
            for sub, (kind, value) in enumerate(zip(kinds, values, strict=True), 1):
                record[sub] = Variable(kind, access, value)
        od[0x1000].value = 0x0002_0192
        od[0x1008].value = b"another servo amplifier"
        od[0x100A].value = self.stack_name
        for sub, value in enumerate((0x0000_0BAD, 0x402, 0x0001_0003, device.serial_number), 1):
            od[0x1018][sub].value = value
        od.download_callbacks[(0x6040, 0)].add(self._control)
        od.validate_callbacks[(0x6060, 0)].add(_require_mode)
        od.update_callbacks[(0x6060, 0)].add(lambda mode: self.timers.add(2e-3, self._show_mode))
        for index in LIMITS:
            od.update_callbacks[(index, 0)].add(self._limit)
        self._show()

    # The state machine ------------------------------------------------------------------------------------------------

    def put(self, power: Power, *, mode: int = CYCLIC_VELOCITY, speed: float = 0.0) -> None:
        """As another master may have left it: in this state, turning at this speed [rad/s] where it has power."""
        self.od.write(0x6060, 0, mode)
        self.od.write(0x6061, 0, mode)
        self.od.write(0x60FF, 0, round(speed / self._count))
        words = {Power.READY: 0x06, Power.ON: 0x07, Power.ENABLED: 0x0F, Power.QUICK_STOP: 0x02}
        self.word = words.get(power, 0)
        if power in (Power.FAULT, Power.REACTION):
            self.od.write(0x603F, 0, 0x7305)
        self._arrive(power)

    def _control(self, word: int) -> None:
        before, self.word = self.word, word
        if word != before:
            self.words.append(word)
        if self.power is Power.FAULT and word & ~before & 0x80:
            self.od.write(0x603F, 0, 0)
            self.emergency(0, 0)
            self._arrive(Power.DISABLED)
            return
        self._obey()

    def _obey(self) -> None:
        """Take the next transition that the controlword asks for, by its level."""
        wanted = self._wanted()
        if self._next is not None:
            if self._next[0] is wanted:
                return
            self.timers.cancel(self._next[1])
            self._next = None
        if wanted is None:
            return
        if wanted in LASTS and self.power in (Power.READY, Power.ON):
            self._next = (wanted, self.timers.add(LASTS[wanted], self._arrive, (wanted,)))
        else:
            self._arrive(wanted)

    def _wanted(self) -> Power | None:
        switch_on, voltage, no_quick_stop, operate = (
            bool(self.word >> bit & 1) for bit in range(4)
        )
        state, stays = self.power, self.od.read(0x605A, 0) >= 5
        if state in (Power.NOT_READY, Power.REACTION, Power.FAULT):
            return None
        if self.ignores_stop and state is Power.ENABLED:
            return None
        if not voltage:
            return Power.DISABLED if state is not Power.DISABLED else None
        if not no_quick_stop:
            if state is Power.ENABLED:
                return Power.QUICK_STOP if self.od.read(0x605A, 0) else Power.DISABLED
            return Power.DISABLED if state in (Power.READY, Power.ON) else None
        if state is Power.QUICK_STOP:
            return Power.ENABLED if stays and switch_on and operate else None
        if not switch_on:
            return Power.READY if state is not Power.READY and not self._is_torque_off else None
        return {
            Power.READY: Power.ON,
            Power.ON: Power.ENABLED if operate else None,
            Power.ENABLED: None if operate else Power.ON,
        }.get(state)

    def _arrive(self, power: Power) -> None:
        if self._next is not None:
            self.timers.cancel(self._next[1])
        self._next, self.power = None, power
        self._aim = self.od.read(0x607A, 0)
        self._show()
        self._obey()

    def _show(self) -> None:
        word = self.power.value | REMOTE | (0 if self._is_torque_off else VOLTAGE)
        if self.power is Power.DISABLED:
            # Bit 5 means nothing here; this maker sets it.
            word |= 0x20
        if self.power is Power.ENABLED:
            word |= FOLLOWS | TARGET_REACHED
        self.od.write(0x6041, 0, word)

    def _show_mode(self) -> None:
        self.od.write(0x6061, 0, self.od.read(0x6060, 0))

    # What happens to it -----------------------------------------------------------------------------------------------

    def fault(self, code: int, register: int = 0x21, *, coasts: bool = False) -> None:
        if self.power in (Power.FAULT, Power.REACTION):
            return
        self.od.write(0x603F, 0, code)
        reacts = self.power in POWERED and not coasts and self.od.read(0x605E, 0) != 0
        self._arrive(Power.REACTION if reacts else Power.FAULT)
        self.emergency(code, register)

    def safe_torque_off(self, is_off: bool) -> None:
        self._is_torque_off = is_off
        if is_off and self.power not in (Power.FAULT, Power.REACTION):
            self._arrive(Power.DISABLED)
        self._show()

    def open_guard(self, is_open: bool) -> None:
        self.od.write(0x60FD, 0, 0 if is_open else GUARD_CLOSED)

    def ignore_lost_master(self) -> None:
        """It turns on whatever becomes of who commands it."""
        self.od.write(0x6007, 0, 0)

    def reverse(self) -> None:
        """Two lines of its encoder are swapped."""
        self._origin = (self._origin or 0) + 2 * self._sense * self._position
        self._sense = -self._sense

    def on_heartbeat_lost(self) -> None:
        self._connection_lost()

    def on_nmt(self, state: StateEnum) -> None:
        if state is StateEnum.STOPPED:
            self._connection_lost()
        elif state is StateEnum.INITIALISATION:
            self.word, self.limits_changed = 0, True
            self._arrive(Power.DISABLED)
            self._show_mode()

    def _connection_lost(self) -> None:
        """0x6007 in a state with power: 0 nothing, 1 fault, 2 disable voltage, 3 quick stop."""
        option = self.od.read(0x6007, 0)
        if self.power not in (Power.ENABLED, Power.QUICK_STOP) or not option:
            return
        if option == 1:
            self.fault(0x8130, 0x11)
        else:
            self.word = {2: 0x00, 3: 0x02}[option]
            self._obey()

    # In front of the plant --------------------------------------------------------------------------------------------

    def demand(self) -> tuple[Mode, float]:
        """What the plant is told from now on: mode and set-point [rad/s or N m]."""
        if self.power is Power.ENABLED and not self._is_torque_off:
            if not self.ignores_stop or self.word & 0x0F == 0x0F:
                self._last = self._set_point()
            return self._last
        if self.power is Power.QUICK_STOP and self.ignores_quick_stop:
            return self._last
        option = {Power.QUICK_STOP: 0x605A, Power.REACTION: 0x605E}.get(self.power)
        if option is None or self._is_torque_off:
            return Mode.OFF, 0.0
        by_slow_ramp = self.od.read(option, 0) in (1, 5)
        return (Mode.SPEED if by_slow_ramp else Mode.QUICK_STOP), 0.0

    def _set_point(self) -> tuple[Mode, float]:
        mode, halts = self.od.read(0x6061, 0), self.word & 0x0100
        if mode == CYCLIC_TORQUE:
            per_mille = 0 if halts else self.od.read(0x6071, 0)
            return Mode.TORQUE, per_mille * 1e-3 * self.device.rated_torque
        if mode == CYCLIC_POSITION:
            return Mode.SPEED, self._towards(self.od.read(0x607A, 0), halts=bool(halts))
        turns = mode in (CYCLIC_VELOCITY, PROFILE_VELOCITY) and not halts
        return Mode.SPEED, self.od.read(0x60FF, 0) * self._count if turns else 0.0

    def _towards(self, target: int, *, halts: bool) -> float:
        """The speed that takes it to its target: the way that this moved in a period, and what it is off."""
        step, self._aim = _wrapped(target - self._aim), target
        if halts:
            return 0.0
        period = self.od.read(0x60C2, 1) * 10.0 ** self.od.read(0x60C2, 2)
        off = _wrapped(target - self.od.read(0x6064, 0))
        return self._sense * (step / period + PULL * off) * self._count

    def limits(self) -> DriveLimits:
        torque, speed, *ramps = (self.od.read(index, 0) for index in LIMITS)
        return DriveLimits(
            torque * 1e-3 * self.device.rated_torque,
            speed * RPM,
            *(ramp * self._count for ramp in ramps),
        )

    def _limit(self, _value: int) -> None:
        self.limits_changed = True

    def take(self, position: int, torque: int, _index: int, _seen: int, speed: float) -> None:
        """One period of its control loop: what the sensors show, and the ends of the ramps."""
        if self._origin is None:
            self._origin = START_COUNT - position
        self._position = position
        self.od.write(0x6064, 0, _wrapped(self._sense * position + self._origin))
        self.od.write(0x606C, 0, _wrapped(round(speed / self._count)))
        self.od.write(0x6077, 0, max(-32768, min(32767, torque)))
        if abs(speed) > STANDSTILL:
            return
        if self.power is Power.REACTION:
            self._arrive(Power.FAULT)
        elif self.power is Power.QUICK_STOP and self.od.read(0x605A, 0) < 5:
            self._arrive(Power.DISABLED)

    @property
    def drive_state(self) -> DriveState:
        """In the bench's words."""
        return DriveState[
            {
                Power.DISABLED: "SWITCH_ON_DISABLED",
                Power.ON: "SWITCHED_ON",
                Power.REACTION: "FAULT_REACTION",
            }.get(self.power, self.power.name)
        ]

    def hear_sync(self, now_ns: int) -> None:
        self.timers.now_ns = now_ns

    def latch(self) -> None:
        return

    def apply_synchronous(self) -> None:
        return

    def send_synchronous(self) -> None:
        """Its stack hears the SYNC once the sensors are latched: it sends, then takes the set-points up."""
        self.synchronise()

    rpdos = ()

    @property
    def tpdos(self) -> list[SimpleNamespace]:
        cob_ids = [self.od.read(0x1800 + number, 1) for number in range(4)]
        return [SimpleNamespace(cob_id=c, exists=not c >> 31) for c in cob_ids]


class Objects:
    """The little that a bench and its faults ask of a dictionary."""

    def __init__(self, drive: Amplifier) -> None:
        self.store = lambda index, sub, value: drive.od.write(index, sub, value)
        self.value = drive.od.read

    def on_change(self, hook: object) -> None:
        return

    def __iter__(self) -> Iterator[Any]:
        return iter(())


def _require_mode(mode: int) -> None:
    if mode and not (mode > 0 and SUPPORTED >> (mode - 1) & 1):
        raise ValueError(mode)


def _wrapped(count: int) -> int:
    return (count + (1 << 31)) % (1 << 32) - (1 << 31)
