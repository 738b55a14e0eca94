"""An amplifier by analog reference as the amplifier of a segment: servo-on and alarm reset are outputs of a CiA 401
coupler, its status is made of contacts (`drivers.bus.status_lines`), its speed reference is a voltage.

It cannot read limits back and has no quick stop: `Mode.QUICK_STOP` is the reference of standstill with the power stage
as it is, so that nothing here can switch it on. When the coupler loses the computer it takes servo-on and reference
away by itself (error modes 0x6206, 0x6207, 0x6443, 0x6444), where it can.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from drivers import channel as names
from drivers.bus.amplifier import Left, Written
from drivers.bus.analog.config import ReferenceConfig
from drivers.bus.cia301 import I32, U8, NmtState, ObjectRef
from drivers.bus.device import Identity, RemoteDevice
from drivers.bus.frames import SLOT_BYTES, FrameLayout
from drivers.bus.motor_encoder import MotorEncoder
from drivers.bus.network import PumpedBus
from drivers.bus.pdo import MappedPdo, map_objects
from drivers.bus.planned import Plan, Planned
from drivers.bus.set_points import packed_frames
from drivers.channel import Calibration, Channel
from drivers.drive_state import POWERED_STATES, DriveState, drive_state
from drivers.errors import DriverError
from drivers.port import Ask, DriveLimits, Mode

_MS: Final = 1_000_000
_POLL_NS: Final = 2 * _MS
_RESET_MS: Final = 100
"""How long alarm reset is held: amplifiers ask for some tens of milliseconds."""
_OUTPUT_ERROR_MODE: Final = 0x6206
_OUTPUT_ERROR_VALUE: Final = 0x6207
_REFERENCE_ERROR_MODE: Final = 0x6443
_REFERENCE_ERROR_VALUE: Final = 0x6444
_CONTACTS: Final = "statusword made of contacts: alarm, power, ready, speed reached"
"""What the status channel is called: it is no word that the amplifier sent."""


class ReferenceAmplifier:
    """An amplifier behind the terminals of a coupler. `bring_up` first."""

    kind = "amplifier by analog reference"
    stands_alone = False

    def __init__(self, bus: PumpedBus, config: ReferenceConfig) -> None:
        self.bus, self.config = bus, config
        self.device = RemoteDevice(
            bus, config.node_id, config.description, config.sdo_timeout_ms * _MS
        )
        self.commands: list[MappedPdo] = []
        self._identity: Identity | None = None
        self._uncovered: list[str] = []
        self._unheard = ["nothing has been agreed yet"]
        self._is_on = False
        self._at, self._size = 0, config.inputs.value_type.size

    # --- bringing up

    @property
    def identity(self) -> Identity:
        """Who the coupler says that it is."""
        if self._identity is None:
            raise DriverError(
                "the coupler has not been brought up",
                where=self.device.where,
                remedy="Open the rig first.",
            )
        return self._identity

    def bring_up(self, cycle_ns: int) -> Identity:
        """From any state to servo off, the coupler's way out set; NMT stays PRE-OPERATIONAL."""
        device, config = self.device, self.config
        device.to_pre_operational()
        self.to_off()
        identity = self._identity = device.identity()
        if identity.profile != 401:
            text = f"device type says profile {identity.profile}, expected 401"
            self.bus.emit("warning", "profile", device.where, text)
        device.listen_to_emergencies()
        device.follow_sync()
        waits = max(10 * config.heartbeat_ms * _MS, device.watch.timeout_ns)
        if device.produce_heartbeat(config.heartbeat_ms) and not self.bus.wait_for(
            lambda: device.watch.state is not NmtState.UNKNOWN, waits
        ):
            text = "a heartbeat was configured, but none was heard"
            self.bus.emit("warning", "heartbeat", device.where, text)
        self._uncovered = self._cover()
        return identity

    def _cover(self) -> list[str]:
        """Let the coupler take servo-on and reference away when it loses the computer; what it cannot, in words.

        0 V is what an output goes to: how a count stands in the 32 bits of 0x6444 differs between makers, nought does
        not.
        """
        device, config = self.device, self.config
        why = "the outputs stay as they are when the computer is lost"
        sub_out, sub_ref = config.outputs.subindex, config.reference.subindex
        every_bit = (1 << 8 * config.outputs.value_type.size) - 1
        rows = (
            (_OUTPUT_ERROR_MODE, sub_out, config.outputs.value_type, every_bit, "servo-on"),
            (
                _OUTPUT_ERROR_VALUE,
                sub_out,
                config.outputs.value_type,
                config.idle_outputs,
                "servo-on",
            ),
            (_REFERENCE_ERROR_MODE, sub_ref, U8, 1, "the reference"),
            (_REFERENCE_ERROR_VALUE, sub_ref, I32, 0, "the reference"),
        )
        lacking: dict[str, list[str]] = {}
        for index, sub, kind, value, what in rows:
            entry = ObjectRef(index, sub, kind, f"{what} when the computer is lost")
            if not device.write_wished(entry, value, why):
                lacking.setdefault(what, []).append(f"0x{index:04X}")
        return [
            f"the coupler would not take {what} away ({', '.join(objects)})"
            for what, objects in lacking.items()
        ]

    def arm_heartbeat(self) -> bool:
        """Start the computer's heartbeat and let the coupler watch it; False if it cannot."""
        self.bus.start_heartbeat(self.config.computer_heartbeat_ms * _MS)
        is_watching = self.device.consume_heartbeat(self.config.computer_lost_ms)
        self._unheard = (
            [] if is_watching else ["the coupler does not hear the computer's heartbeat (0x1016)"]
        )
        return is_watching

    @property
    def unwatched(self) -> Sequence[str]:
        """Why the motor would go on when the computer is lost, in words; empty: the coupler switches it off."""
        return (*self._unheard, *self._uncovered)

    # --- what is mapped

    def plan(
        self,
        encoder: MotorEncoder,
        cycle_ns: int,
        *,
        is_counted: bool,
        beside: Sequence[ObjectRef] = (),
    ) -> Plan:
        """The contacts, and what other terminals of the coupler send. The motor's encoder needs a counter."""
        if not is_counted:
            raise DriverError(
                "an amplifier by analog reference counts nothing for the computer",
                where=self.device.where,
                limit=f"a counter of {names.INPUT_ANGLE}",
                remedy="Take the motor encoder's divided pulses to a counter, and give it that channel.",
            )
        inputs = self.config.inputs
        status = Channel(name=names.STATUSWORD, unit="1", scale=1.0, long_name=_CONTACTS)
        planned = Planned(
            channel=status,
            kind="lines",
            node_id=self.device.node_id,
            entry=inputs,
            lines=self.config.lines,
        )
        others = [entry for entry in beside if entry.key != inputs.key]
        return Plan([planned], [inputs, *others], frozenset(entry.key for entry in others))

    def map_commands(self, encoder: MotorEncoder) -> Sequence[Planned]:
        """Outputs and reference, and the reference as the channel of the set-point."""
        config = self.config
        entries = [config.outputs, config.reference]
        self.commands = map_objects(self.device, entries, is_transmit=False)
        sense = config.direction
        scale = config.volts_per_count * config.speed_per_volt
        # A voltage in steps: what is sent lies within half of one from what was asked.
        doubt = math.hypot(
            config.speed_per_volt * config.zero_uncertainty_volts, scale / math.sqrt(12.0)
        )
        channel = Channel(
            name=names.TARGET_SPEED,
            unit="rad/s",
            scale=scale,
            offset=-sense * scale * config.zero_count,
            direction=sense,
            long_name=f"speed reference (0x{config.reference.index:04X})",
            calibration=Calibration(
                offset_uncertainty=doubt,
                scale_relative_uncertainty=config.scale_relative_uncertainty,
            ),
        )
        return [Planned(channel=channel, kind="target_speed")]

    # --- in the cycle

    def find(self, layout: FrameLayout) -> None:
        """Remember where the contacts stand in the record of a cycle."""
        key = self.config.inputs.key
        for slot, pdo in enumerate(layout.pdos):
            offset = pdo.offset_of(key)
            if pdo.node_id == self.device.node_id and offset is not None:
                self._at = slot * SLOT_BYTES + offset + self.config.inputs.offset

    def left(self, record: bytes) -> Left | None:
        """Alarm, or no power on the motor."""
        word = int.from_bytes(record[self._at : self._at + self._size], "little")
        status = self.config.lines.of(word)
        state = drive_state(status)
        if state is DriveState.ENABLED:
            return None
        # An alarm that ends by itself must not find servo-on still there.
        self._is_on = False
        text = f"the amplifier left operation: {state.value} (contacts 0x{word:02X})"
        return Left("drive-state", text, float(status))

    @property
    def largest_counts(self) -> Mapping[str, int]:
        """The largest set-point, either way, that may be sent."""
        return {names.TARGET_SPEED: self.config.largest_count}

    def frames(
        self,
        mode: Mode,
        speeds: NDArray[np.int64],
        torques: NDArray[np.int64],
        *,
        may_ask: bool = False,
    ) -> list[list[bytes]]:
        """The bytes of every RPDO (outer) for every cycle (inner)."""
        config, cycles = self.config, len(speeds)
        if mode is Mode.OFF:
            self._is_on = False
        reference = speeds if mode is Mode.SPEED else np.full(cycles, config.zero_count)
        # A quick stop leaves the power stage as it is: on while it holds, and never from off to on.
        word = config.word(servo_on=self._is_on)
        values = {config.outputs.key: np.full(cycles, word), config.reference.key: reference}
        return packed_frames(self.commands, values, cycles)

    def frames_between(self) -> list[bytes]:
        """The reference of standstill goes on as it was written."""
        return []

    def latched(self, record: bytes) -> None:
        """Nothing of it leads the reference."""

    def sent(self, cycles: int) -> None:
        """A voltage does not go on from the one before."""

    def paused(self) -> None:
        """Nothing in the frames is older than the cycle."""

    @property
    def stops(self) -> Mapping[Ask, Written]:
        """The reference of standstill, and servo-on taken away."""
        config = self.config
        return {
            Ask.QUICK_STOP: Written(self.device.typed(config.reference), config.zero_count),
            Ask.SERVO_OFF: Written(self.device.typed(config.outputs), config.idle_outputs),
        }

    # --- switching

    def word(self) -> int:
        """The contacts by SDO."""
        return self.device.read_integer(self.config.inputs)

    def status_of(self, count: int) -> int:
        """The statusword of a word of contacts."""
        return self.config.lines.of(count)

    def state(self) -> DriveState:
        """The state by SDO."""
        return drive_state(self.status_of(self.word()))

    def error_text(self) -> str:
        """Contacts have no code."""
        state = self.state()
        if state in (DriveState.FAULT, DriveState.FAULT_REACTION):
            return "its alarm line is active; the code stands on its panel"
        return f"its contacts say {state.value} (0x{self.word():02X})"

    def enable(self, mode: Mode) -> None:
        """Servo on with the reference of standstill. Raises `DriverError`."""
        if mode is not Mode.SPEED:
            raise DriverError(
                f"an amplifier by analog speed reference does not do {mode.value}",
                where=self.device.where,
                limit=Mode.SPEED.value,
                remedy="Choose a protocol that commands speeds.",
            )
        self._still()
        try:
            self._switch_on()
        except DriverError:
            self._is_on = False
            self._write_outputs(servo_on=False)
            raise

    def _switch_on(self) -> None:
        word = self.word()
        status = self.status_of(word)
        ready = drive_state(status) in (DriveState.SWITCH_ON_DISABLED, DriveState.ENABLED)
        if not ready or not (self.config.lines.ready.is_active(word) or self._is_on):
            raise DriverError(
                f"the amplifier is not ready to be switched on: {self.error_text()}",
                where=self.device.where,
                value=f"contacts 0x{word:02X}",
                limit="ready, no alarm",
                remedy="Is the main power on, hard wire base block closed, and no alarm on the panel?",
            )
        self._write_outputs(servo_on=True)
        self._await(lambda state: state is DriveState.ENABLED, "power on the motor")
        self._is_on = True

    def to_off(self, *, resets_fault: bool = True) -> None:
        """Servo off from any state: a motor that has power is brought to rest by the reference first."""
        self._still()
        if self.state() in POWERED_STATES and self._is_on_by_outputs():
            text = "the amplifier was found switched on; reference of standstill, then servo off"
            self.bus.emit("warning", "found-enabled", self.device.where, text)
            self._await_standstill()
        self._is_on = False
        self._write_outputs(servo_on=False)
        self._await(lambda state: state not in POWERED_STATES, "no power on the motor")
        if self.state() is DriveState.FAULT and resets_fault:
            text = f"the amplifier was found in fault: {self.error_text()}"
            self.bus.emit("warning", "found-faulted", self.device.where, text)
            try:
                self.reset_fault()
            except DriverError as error:
                self.bus.emit("error", "fault", self.device.where, str(error))

    def _is_on_by_outputs(self) -> bool:
        """Whether somebody has left servo-on active; a coupler that does not tell may have."""
        word = self.device.read_optional(self.config.outputs, "what its outputs are is not known")
        return word is None or self.config.servo_on.is_active(int(word))

    def _await_standstill(self) -> None:
        """Until the line of rotation says that the motor stands, or as long as it may take without one."""
        turning, clock = self.config.turning, self.bus.clock
        deadline = clock.monotonic_ns() + self.config.standstill_ms * _MS
        while clock.monotonic_ns() < deadline:
            if turning is not None and not turning.is_active(self.word()):
                return
            self.bus.idle(_POLL_NS)
        if turning is not None:
            text = "the motor still turns with the reference of standstill; power off"
            self.bus.emit("warning", "quick-stop", self.device.where, text)

    def reset_fault(self) -> None:
        """Alarm reset held for a moment, servo off. Raises where the alarm stays, or has to be reset by hand."""
        if self.state() not in (DriveState.FAULT, DriveState.FAULT_REACTION):
            return
        if self.config.alarm_reset is None:
            raise DriverError(
                "the alarm cannot be reset from here: no output is wired to alarm reset",
                where=self.device.where,
                remedy="Remove the cause and reset it at the amplifier's panel.",
            )
        self._write_outputs(servo_on=False, resets=True)
        self.bus.idle(_RESET_MS * _MS)
        self._write_outputs(servo_on=False)
        faulted = (DriveState.FAULT, DriveState.FAULT_REACTION)
        try:
            self._await(lambda state: state not in faulted, "the end of the alarm")
        except DriverError as error:
            raise DriverError(
                f"the alarm cannot be reset: {self.error_text()}",
                where=self.device.where,
                remedy="Remove the cause (the panel shows its code), then acknowledge again.",
            ) from error
        self.bus.emit("info", "fault-reset", self.device.where, "alarm reset")

    def _still(self) -> None:
        """The reference of standstill by SDO."""
        self.device.write(self.config.reference, self.config.zero_count)

    def _write_outputs(self, *, servo_on: bool, resets: bool = False) -> None:
        self.device.write(self.config.outputs, self.config.word(servo_on=servo_on, resets=resets))

    def _await(self, holds: Callable[[DriveState], bool], words: str) -> None:
        clock = self.bus.clock
        deadline = clock.monotonic_ns() + self.config.state_timeout_ms * _MS
        while not holds(state := self.state()):
            if clock.monotonic_ns() >= deadline:
                raise DriverError(
                    f"waited in vain for {words}",
                    where=self.device.where,
                    value=state.value,
                    limit=f"{self.config.state_timeout_ms} ms",
                    remedy="Look at the wiring of its contacts and at the amplifier's panel.",
                )
            self.bus.idle(_POLL_NS)

    # --- limits

    def write_limits(self, limits: DriveLimits) -> DriveLimits:
        """Nothing can be written: what somebody has set by the maker's tool, and has said."""
        return self.config.limits_by_hand

    def describe(self) -> dict[str, str]:
        """Scale, contacts and limits in words."""
        config, lines = self.config, self.config.lines
        wired = {"alarm": lines.alarm, "power": lines.power, "ready": lines.ready}
        wired |= {"speed reached": lines.reached} if lines.reached is not None else {}
        held = config.limits_by_hand
        return {
            "reference": f"{config.speed_per_volt:g} rad/s per V, stands at {config.zero_volts:g} V, "
            f"{config.volts_per_count:g} V per count, at most {config.largest_volts:g} V",
            "statusword": "made of contacts, the amplifier sends none",
            "limits": f"set by hand: torque {held.torque:g} N m, speed {held.speed:g} rad/s",
            **{
                f"contact {name}": f"0x{line.mask:X} of {config.inputs}, "
                f"{'1' if line.active_high else '0'} says so"
                for name, line in wired.items()
            },
        }
