"""A CiA 402 servo amplifier: brought up from any state, moved by a table of transitions, its numbers in SI.

Torque: T = x / 1000 * (0x6076) with 0x6076 in mN m. Speed: 0x60FF in the drive's velocity unit,
taken from the configuration, else from 0x60A9, else from 0x6094. What the device does not offer
stands in `missing`, with its consequence.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Final

from drivers.bus.cia301 import NmtState, error_code_text
from drivers.bus.cia402 import stop_words
from drivers.bus.cia402 import tables as obj
from drivers.bus.cia402.config import DriveConfig, DriveReadings
from drivers.bus.cia402.limits import write_limits
from drivers.bus.cia402.settings import read_settings, write_interpolation_time
from drivers.bus.cia402.tables import OperationMode
from drivers.bus.cia402.units import read_units
from drivers.bus.device import RemoteDevice
from drivers.bus.network import PumpedBus
from drivers.bus.sdo import SdoAbortError
from drivers.drive_state import DriveState, drive_state
from drivers.errors import DriverError, ReadbackError
from drivers.port import DriveLimits, Mode

_MS: Final = 1_000_000
_POLL_NS: Final = 2 * _MS
_MOST_STEPS: Final = 8
"""Controlwords that a way through the state machine can need; more of them go by the poll."""
_RESET_MS: Final = 3000
"""How long a drive may take to come out of a fault: some restart their power stage or their encoder for it."""


class ServoAmplifier:
    """A drive on the bus. `bring_up` first; PDOs are the acquisition's business, this class speaks SDO."""

    def __init__(self, bus: PumpedBus, config: DriveConfig) -> None:
        self.config, self.bus = config, bus
        self.device = RemoteDevice(
            bus, config.node_id, config.description, config.sdo_timeout_ms * _MS
        )
        self._readings: DriveReadings | None = None
        self._unwatched: tuple[str, ...] = ("nothing has been agreed yet",)
        self._unstopped: tuple[str, ...] = ()
        self._mode_now: OperationMode | None = None
        self._is_mode_unknown = False
        self.limits: DriveLimits | None = None

    @property
    def readings(self) -> DriveReadings:
        """What was read when the drive was brought up."""
        if self._readings is None:
            raise DriverError(
                "the drive has not been brought up",
                where=self.device.where,
                remedy="Open the rig first.",
            )
        return self._readings

    # --- bringing up

    def bring_up(self, cycle_ns: int) -> DriveReadings:
        """From any NMT and drive state to servo off with everything read and configured; NMT stays PRE-OPERATIONAL."""
        device, config = self.device, self.config
        device.to_pre_operational()
        self.to_off()
        identity = device.identity()
        if identity.profile != 402:
            self.bus.emit(
                "warning",
                "profile",
                device.where,
                f"device type says profile {identity.profile}, expected 402",
            )
        device.listen_to_emergencies(obj.ERROR_CODES)
        device.follow_sync()
        if device.produce_heartbeat(config.heartbeat_ms) and not self.bus.wait_for(
            lambda: device.watch.state is not NmtState.UNKNOWN,
            max(10 * config.heartbeat_ms * _MS, device.watch.timeout_ns),
        ):
            self.bus.emit(
                "warning",
                "heartbeat",
                device.where,
                "a heartbeat was configured, but none was heard",
            )
        found = read_units(device, config.units, identity.vendor_id)
        settings = self._write_options() | read_settings(device, config.gains)
        is_interpolating = write_interpolation_time(device, cycle_ns)
        supported = device.read_optional(
            obj.SUPPORTED_MODES, "whether a mode is supported shows only when it is chosen"
        )
        self._is_mode_unknown = supported is None
        self._readings = DriveReadings(
            identity=identity,
            rated_torque=found.rated_torque,
            torque_limit_unit=found.torque_limit_unit,
            counts_per_revolution=found.counts_per_revolution,
            velocity_unit=found.velocity_unit,
            acceleration_unit=found.acceleration_unit,
            questions=found.questions,
            is_interpolating=is_interpolating,
            speed_mode=self._choose(config.speed_modes, supported),
            torque_mode=self._choose(config.torque_modes, supported),
            settings=settings,
            missing=[],
        )
        self._read_torque_slope(self._readings)
        self._readings.missing.extend(device.missing)
        return self._readings

    def _read_torque_slope(self, readings: DriveReadings) -> None:
        """Profile torque goes by a slope (0x6087); one of 0 never arrives."""
        if readings.torque_mode is not OperationMode.PROFILE_TORQUE:
            return
        slope = self.device.read_optional(
            obj.TORQUE_SLOPE, "how fast torque rises in profile torque mode is not known"
        )
        if slope is not None:
            readings.settings[f"{obj.TORQUE_SLOPE}"] = float(slope)
        if slope == 0:
            self.bus.emit(
                "warning",
                "torque-slope",
                self.device.where,
                "0x6087 is 0: torque may never rise; set it by the drive's manual",
            )

    def arm_heartbeat(self) -> bool:
        """Start the computer's heartbeat and let the drive watch it; False if the drive cannot."""
        self.bus.start_heartbeat(self.config.computer_heartbeat_ms * _MS)
        is_watching = self.device.consume_heartbeat(self.config.computer_lost_ms)
        self._unwatched = (
            () if is_watching else ("it does not hear the computer's heartbeat (0x1016)",)
        )
        return is_watching

    @property
    def unwatched(self) -> tuple[str, ...]:
        """Why the drive would not stop by itself when the computer is lost, in words; empty: it would."""
        return (*self._unwatched, *self._unstopped)

    def _write_options(self) -> dict[str, float]:
        config, written = self.config, dict[str, float]()
        for entry, value, consequence in (
            (
                obj.ABORT_OPTION,
                config.abort_connection_option,
                "the drive's reaction to a lost computer is its own",
            ),
            (
                obj.QUICK_STOP_OPTION,
                config.quick_stop_option,
                "the quick stop is the drive's default",
            ),
            (
                obj.FAULT_REACTION,
                config.fault_reaction_option,
                "the reaction to a fault is the drive's default",
            ),
        ):
            try:
                done = self.device.write_checked(entry, value, consequence)
            except ReadbackError as error:
                self.bus.emit("warning", "option-code", self.device.where, str(error))
                done = False
            if done:
                written[entry.name] = float(value)
            elif entry is obj.ABORT_OPTION:
                self._unstopped = (
                    f"it cannot be told to stop then (0x6007 = {config.abort_connection_option})",
                )
        return written

    def _choose(
        self, preferred: tuple[int, ...], supported: int | float | None
    ) -> OperationMode | None:
        for mode in preferred:
            if supported is None or int(supported) >> (mode - 1) & 1:
                return OperationMode(mode)
        return None

    # --- the state machine

    def statusword(self) -> int:
        """The statusword by SDO."""
        return self.device.read_integer(obj.STATUSWORD)

    def state(self) -> DriveState:
        """The state by SDO."""
        return drive_state(self.statusword())

    def error_text(self) -> str:
        """The error code 0x603F in words."""
        code = self.device.read_optional(obj.ERROR_CODE, "faults have no code")
        if code is None:
            return "no error code"
        return f"0x{int(code):04X} {error_code_text(int(code), obj.ERROR_CODES)}"

    def to_off(self, *, resets_fault: bool = True) -> None:
        """Servo off from any state: a turning drive is quick-stopped first, a fault is reset where its cause is gone.

        A fault that persists, or that is not to be reset, leaves the power stage off all the same;
        one that persists is an event. Raises if the drive does not obey, and if its fault reaction
        does not end.
        """
        state = self.state()
        if state is DriveState.ENABLED:
            self.bus.emit(
                "warning",
                "found-enabled",
                self.device.where,
                "the drive was found enabled; quick stop",
            )
            self._control(stop_words.QUICK_STOP)
        if state in (DriveState.ENABLED, DriveState.QUICK_STOP):
            self._await_standstill()
        if state in (DriveState.FAULT, DriveState.FAULT_REACTION) and not resets_fault:
            self._await(
                lambda s: s is not DriveState.FAULT_REACTION, "the end of the fault reaction"
            )
            self._control(stop_words.DISABLE_VOLTAGE)
            return
        if state in (DriveState.FAULT, DriveState.FAULT_REACTION):
            self.bus.emit(
                "warning",
                "found-faulted",
                self.device.where,
                f"the drive was found in fault: {self.error_text()}",
            )
            try:
                self.reset_fault()
            except DriverError as error:
                self.bus.emit("error", "fault", self.device.where, str(error))
                if self.state() is not DriveState.FAULT:
                    raise
                return
        self._walk(stop_words.TO_OFF, DriveState.SWITCH_ON_DISABLED, "servo off")

    def enable(self, mode: Mode) -> None:
        """Operation enabled in the drive's speed or torque mode; set-points are zero. Raises `DriverError`."""
        candidates = self.modes_for(mode)
        if not candidates:
            preferred = self.config.speed_modes if mode is Mode.SPEED else self.config.torque_modes
            raise DriverError(
                f"the drive supports none of the modes for {mode.value}",
                where=f"{self.device.where}, 0x6502:0",
                limit=", ".join(str(m) for m in preferred),
            )
        if OperationMode.CYCLIC_POSITION not in candidates:
            self._require("velocity_unit_rad_s" if mode is Mode.SPEED else "rated_torque_n_m")
        if mode is Mode.TORQUE and (self.limits is None or not math.isfinite(self.limits.speed)):
            raise DriverError(
                "torque mode needs a speed limit that the drive holds itself",
                where=self.device.where,
                limit="0x6080 written and read back",
                remedy="Write the limits first; a drive without 0x6080 cannot do this.",
            )
        self._rest(mode)
        try:
            self._switch_on(candidates)
        except DriverError:
            self._give_up()
            raise

    def _rest(self, mode: Mode) -> None:
        """The set-point of standstill, before it acts."""
        if mode is Mode.TORQUE:
            self.device.write(obj.TARGET_TORQUE, 0)
        elif self.state() is not DriveState.ENABLED:
            self.device.write(obj.TARGET_VELOCITY, 0)

    def _switch_on(self, candidates: Sequence[OperationMode]) -> None:
        """The first of the modes that the drive takes, then operation enabled."""
        self._choose_one(candidates)
        self._walk(obj.TO_ENABLED, DriveState.ENABLED, "operation enabled")

    def modes_for(self, mode: Mode) -> tuple[OperationMode, ...]:
        """The modes of operation that it turns in by speed or by torque: one, unless only choosing them shows which
        of the preferred ones it has.
        """
        readings, config = self.readings, self.config
        chosen, preferred = readings.torque_mode, config.torque_modes
        if mode is Mode.SPEED:
            chosen, preferred = readings.speed_mode, config.speed_modes
        if chosen is None:
            return ()
        if self._is_mode_unknown and chosen is not OperationMode.CYCLIC_POSITION:
            # Positions go by another object: that mode is not tried out, it is chosen.
            return tuple(OperationMode(m) for m in preferred if m != OperationMode.CYCLIC_POSITION)
        return (chosen,)

    def _require(self, *entries: str) -> None:
        """Raise `DriverError` where a unit is not known that is needed now, with the question that is open."""
        for question in self.readings.questions:
            if question.entry in entries:
                raise DriverError(
                    question.why,
                    where=self.device.where,
                    remedy=f"Give `{question.entry}` in [drive] of the rig's description. {question.hint}",
                )

    def _give_up(self) -> None:
        """Enabling has failed, and nothing may come of it later: an enabled drive is quick-stopped,
        any other switched off.
        """
        with contextlib.suppress(DriverError):
            is_enabled = self.state() is DriveState.ENABLED
            self._control(stop_words.QUICK_STOP if is_enabled else stop_words.DISABLE_VOLTAGE)

    def _choose_one(self, candidates: Sequence[OperationMode]) -> None:
        """The first of the modes that the drive takes: one without 0x6502 shows by refusing what it does not have."""
        for operation in candidates[:-1]:
            try:
                self._choose_anyhow(operation)
            except (SdoAbortError, ReadbackError) as error:
                self.bus.emit("warning", "mode", self.device.where, str(error))
            else:
                return
        self._choose_anyhow(candidates[-1])

    def _choose_anyhow(self, operation: OperationMode) -> None:
        """Choose a mode; a drive that does not change it while it is enabled is disabled for the
        change (transition 5).
        """
        try:
            self.choose_mode(operation)
        except (SdoAbortError, ReadbackError):
            if self.state() is not DriveState.ENABLED:
                raise
            self._control(obj.SWITCH_ON)
            self._await(
                lambda state: state is not DriveState.ENABLED, "the end of operation enabled", 500
            )
            self.choose_mode(operation)

    @property
    def mode(self) -> OperationMode | None:
        """The mode of operation that the drive was given and took; None before the first and while
        it is not certain.
        """
        return self._mode_now

    def choose_mode(self, operation: OperationMode) -> None:
        """Write 0x6060 and wait until 0x6061 shows it; one that is still shown is not written again."""
        if operation is self._mode_now and self._shows(operation):
            return
        self._mode_now = None
        self.device.write(obj.MODE, operation)
        shown: int | float | None = None
        for _ in range(250):
            shown = self.device.read_optional(
                obj.MODE_DISPLAY, "whether the drive took a mode is not known"
            )
            if shown is None or shown == operation:
                self._mode_now = operation
                return
            self.bus.idle(_POLL_NS)
        raise ReadbackError(
            "the drive does not take the mode",
            where=f"{self.device.where}, 0x6061:0",
            value=shown,
            limit=operation.name,
        )

    def _shows(self, operation: OperationMode) -> bool:
        """Whether the drive still shows the mode that it was given, as far as it shows any."""
        shown = self.device.read_optional(obj.MODE_DISPLAY)
        if shown is None or shown == operation:
            return True
        text = f"it shows mode of operation {shown} (0x6061), it was given {operation}: given again"
        self.bus.emit("warning", "mode", self.device.where, text)
        return False

    def reset_fault(self) -> None:
        """Fault reset by a rising edge of bit 7, from a low level. Raises when the cause persists."""
        self._await(lambda s: s is not DriveState.FAULT_REACTION, "the end of the fault reaction")
        if self.state() is DriveState.FAULT:
            self._control(stop_words.DISABLE_VOLTAGE)
            self._control(obj.FAULT_RESET)
            was = self.error_text()
            try:
                self._await(lambda s: s is not DriveState.FAULT, "the end of the fault", _RESET_MS)
            except DriverError as error:
                raise DriverError(
                    f"the fault cannot be reset: {self.error_text()}",
                    where=self.device.where,
                    remedy="Remove the cause (see the drive's manual), then acknowledge again.",
                ) from error
            finally:
                self._control(stop_words.DISABLE_VOLTAGE)
            self.bus.emit("info", "fault-reset", self.device.where, f"fault reset; it was {was}")

    def _walk(self, table: Mapping[DriveState, int], goal: DriveState, words: str) -> None:
        """Follow a table of transitions until the goal is shown."""
        deadline = self.bus.clock.monotonic_ns() + self.config.state_timeout_ms * _MS
        sent_in: DriveState | None = None
        steps = 0
        while (state := self.state()) is not goal:
            if state is DriveState.FAULT:
                raise DriverError(
                    f"the drive is in fault: {self.error_text()}",
                    where=self.device.where,
                    remedy="Remove the cause, acknowledge the fault, then start again.",
                )
            if state in table and state is not sent_in:
                self._control(table[state])
                sent_in = state
                steps += 1
                # A drive that falls back again and again would be pushed for ever.
                if steps < _MOST_STEPS:
                    continue
            if self.bus.clock.monotonic_ns() >= deadline:
                word = self.statusword()
                remedy = "Is the main power on, the STO input closed, and the drive not locked by a panel?"
                if not word & obj.REMOTE_BIT:
                    remedy = (
                        "It says that it does not listen to the bus (remote, bit 9): "
                        "release it from its panel or its tool."
                    )
                raise DriverError(
                    f"the drive does not reach {words}",
                    where=self.device.where,
                    value=f"{state.value} (0x{word:04X})",
                    limit=f"within {self.config.state_timeout_ms} ms",
                    remedy=remedy,
                )
            self.bus.idle(_POLL_NS)

    def _await_standstill(self) -> None:
        """After a quick stop: until the power is off by itself, or the speed reads zero or has passed through it."""
        first: int | float | None = None
        deadline = self.bus.clock.monotonic_ns() + self.config.state_timeout_ms * _MS
        while self.state() in (DriveState.ENABLED, DriveState.QUICK_STOP):
            speed = self.device.read_optional(obj.VELOCITY, "standstill shows only by the encoders")
            first = speed if first is None else first
            # At standstill the reading of many drives trembles around zero and hardly ever is zero.
            if (
                self.state() is DriveState.QUICK_STOP
                and speed is not None
                and (first or 0) * speed <= 0
            ):
                return
            if self.bus.clock.monotonic_ns() >= deadline:
                self.bus.emit(
                    "warning",
                    "quick-stop",
                    self.device.where,
                    "no standstill after a quick stop; power off",
                )
                return
            self.bus.idle(_POLL_NS)

    def _await(
        self, holds: Callable[[DriveState], bool], words: str, timeout_ms: int | None = None
    ) -> None:
        timeout = timeout_ms or self.config.state_timeout_ms
        deadline = self.bus.clock.monotonic_ns() + timeout * _MS
        while not holds(self.state()):
            if self.bus.clock.monotonic_ns() >= deadline:
                raise DriverError(
                    f"waited in vain for {words}", where=self.device.where, limit=f"{timeout} ms"
                )
            self.bus.idle(_POLL_NS)

    def _control(self, word: int) -> None:
        self.device.write(obj.CONTROLWORD, word)

    # --- limits

    def write_limits(self, limits: DriveLimits) -> DriveLimits:
        """Write torque, speed and ramp limits, rounded to the safe side, and return what reads back; inf: not held."""
        readings = self.readings
        self._require("rated_torque_n_m", "velocity_unit_rad_s", "acceleration_unit_rad_s2")
        self.limits, profile = write_limits(
            self.device,
            limits,
            torque_unit=self.config.torque_limit_unit or readings.torque_limit_unit,
            torque_entry=self.config.torque_limit,
            velocity_unit=readings.velocity_unit,
            acceleration_unit=readings.acceleration_unit,
        )
        readings.missing[:] = self.device.missing
        if math.isfinite(self.limits.speed):
            return self.limits
        return replace(self.limits, speed=math.inf if readings.speed_mode is None else profile)
