"""A CiA 402 drive in the cycle: what it sends with every SYNC, the frames of its set-points, how it is seen to leave.

`drive.ServoAmplifier` speaks SDO; this is the same drive as the segment's amplifier (`drivers.bus.amplifier`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from drivers import channel as names
from drivers.bus.amplifier import Left, Written
from drivers.bus.cia301 import ObjectRef
from drivers.bus.cia402 import stop_words
from drivers.bus.cia402 import tables as obj
from drivers.bus.cia402.config import DriveConfig
from drivers.bus.cia402.drive import ServoAmplifier
from drivers.bus.cia402.endless import require_endless
from drivers.bus.cia402.positions import PositionTargets, speed_scale
from drivers.bus.cia402.tables import OperationMode
from drivers.bus.device import Identity
from drivers.bus.frames import SLOT_BYTES, FrameLayout
from drivers.bus.motor_encoder import MotorEncoder
from drivers.bus.network import PumpedBus
from drivers.bus.pdo import MappedPdo, map_objects, pack
from drivers.bus.planned import Plan, Planned
from drivers.bus.set_points import Key, packed_frames
from drivers.channel import Channel
from drivers.counting import largest_step, require_range
from drivers.drive_state import FOLLOWS_BIT, DriveState, drive_state
from drivers.errors import DriverError
from drivers.port import Ask, Mode

_CONTROLWORD: Final = {
    Mode.OFF: stop_words.DISABLE_VOLTAGE,
    Mode.QUICK_STOP: stop_words.QUICK_STOP,
    Mode.SPEED: obj.ENABLE,
    Mode.TORQUE: obj.ENABLE,
}
_COMMANDED: Final = frozenset(
    {
        obj.CONTROLWORD.key,
        obj.TARGET_VELOCITY.key,
        obj.TARGET_POSITION.key,
        obj.TARGET_TORQUE.key,
    }
)
"""Entries of the RPDOs that every cycle sets."""
_LARGEST: Final = {names.TARGET_SPEED: 2**31 - 1, names.TARGET_TORQUE: 2**15 - 1}
"""The largest count of 0x60FF (32 bits; in cyclic position 1/65536 count per cycle) and of 0x6071 (16 bits)."""
_MODE_CYCLES: Final = 3
"""Cycles in a row in which another mode is somebody's work, and no display that lags."""
_PROBE_LATCHED: Final = 0x0002
"""Bit 1 of the touch probe status: a position of the positive edge is stored."""


class CyclicDrive(ServoAmplifier):
    """A CiA 402 drive as the amplifier of a segment."""

    kind = "servo amplifier"
    stands_alone = True

    def __init__(self, bus: PumpedBus, config: DriveConfig) -> None:
        super().__init__(bus, config)
        self.commands: list[MappedPdo] = []
        self._held: dict[Key, int] = {}
        self._held_is_old = True
        self._status = slice(0, 2)
        self._mode_at: int | None = None
        self._position_at: int | None = None
        self._strange_cycles = self._unfollowed_cycles = 0
        self._has_followed = False
        self._targets = PositionTargets()
        self._goes_along = False
        self._cycle_ns = self._resolution = 0
        self._largest_speed = math.inf
        self._offsets: tuple[ObjectRef, ...] = ()

    @property
    def identity(self) -> Identity:
        """Who its node says that it is."""
        return self.readings.identity

    # --- what is mapped

    def plan(
        self,
        encoder: MotorEncoder,
        cycle_ns: int,
        *,
        is_counted: bool,
        beside: Sequence[ObjectRef] = (),
    ) -> Plan:
        """Statusword, position, torque, the latch of the index mark, and the mode where it rides along."""
        self._compare(encoder)
        self._cycle_ns, self._resolution = cycle_ns, encoder.lines * encoder.multiplication
        self._largest_speed = encoder.largest_speed
        if self.is_by_position:
            self._offsets = require_endless(self.device, self.readings, cycle_ns)
        status = Channel(name=names.STATUSWORD, unit="1", scale=1.0, long_name="CiA 402 statusword")
        channels = [self._planned(status, "plain", obj.STATUSWORD)]
        wanted: list[ObjectRef] = [obj.STATUSWORD]
        optional: list[ObjectRef] = []
        seen: tuple[int, ObjectRef, int] | None = None
        if self.is_by_position or not is_counted:
            wanted.append(obj.POSITION)
        if not is_counted:
            channels.append(self._position(encoder, cycle_ns))
            latch, objects = self._latch(encoder)
            optional += objects
            if latch is not None:
                channels.append(latch)
                seen = latch.seen
        torque = self._torque(encoder.direction)
        if torque is not None:
            optional.append(self.config.actual_torque)
            channels.append(torque)
        keys = {entry.key for entry in (*wanted, *optional)}
        optional += [entry for entry in beside if entry.key not in keys]
        # Watched where it rides along: a frame of its own in every cycle it is not worth.
        full = [*wanted, *optional, obj.MODE_DISPLAY]
        if len(pack(full)) == len(pack(full[:-1])) and self._is_offered(
            obj.MODE_DISPLAY, "another master that changes the mode shows only by the motion"
        ):
            optional.append(obj.MODE_DISPLAY)
        objects = sorted([*wanted, *optional], key=_by_importance)
        return Plan(channels, objects, frozenset(entry.key for entry in optional), seen)

    def _compare(self, encoder: MotorEncoder) -> None:
        """The counts of a revolution by the drive, held against those of the configuration."""
        reported, counts = (
            self.readings.counts_per_revolution,
            encoder.lines * encoder.multiplication,
        )
        if reported and not math.isclose(reported, counts, rel_tol=1e-9):
            self.bus.emit(
                "warning",
                "counts-per-revolution",
                self.device.where,
                f"0x6064 has {reported:g} counts per revolution by the drive, {counts} by the configuration "
                f"({encoder.lines} lines x {encoder.multiplication}); the configuration holds",
            )

    def _planned(self, channel: Channel, kind: str, entry: ObjectRef, **more: object) -> Planned:
        return Planned(
            channel=channel,
            kind=kind,  # type: ignore[arg-type]
            node_id=self.device.node_id,
            entry=entry,
            **more,  # type: ignore[arg-type]
        )

    def _position(self, encoder: MotorEncoder, cycle_ns: int) -> Planned:
        resolution = encoder.lines * encoder.multiplication
        most = largest_step(resolution, encoder.largest_speed, cycle_ns)
        require_range(most, encoder.modulus, cycle_ns, f"{self.device.where}, {obj.POSITION}")
        channel = encoder.as_channel(names.INPUT_ANGLE)
        return self._planned(channel, "count", obj.POSITION, largest_step=most)

    def _torque(self, sense: int) -> Planned | None:
        """The drive's own torque, where it tells it in a unit that is known."""
        entry = self.config.actual_torque
        unit = self.config.torque_unit or self.readings.rated_torque / 1000.0
        if not (self._is_offered(entry, "no cross-check of the torque port") and unit > 0.0):
            return None
        channel = Channel(
            name=names.DRIVE_TORQUE,
            unit="N m",
            scale=unit,
            direction=sense,
            long_name=f"torque by the drive (0x{entry.index:04X})",
            calibration=self.config.torque_calibration,
        )
        return self._planned(channel, "plain", entry)

    def _latch(self, encoder: MotorEncoder) -> tuple[Planned | None, list[ObjectRef]]:
        """The latch of the motor encoder's index mark: the configured objects, else touch probe 1, else none."""
        why = "the motor encoder's index mark is not seen: phases are not carried from run to run"
        position, status, mask = encoder.index_position, encoder.index_status, encoder.index_mask
        if position is None:
            if not self.config.latch_index or not self._is_offered(obj.TOUCH_PROBE, why):
                return None, []
            position, status, mask = (
                obj.TOUCH_PROBE_POSITION,
                obj.TOUCH_PROBE_STATUS,
                _PROBE_LATCHED,
            )
        objects = [entry for entry in (position, status) if entry is not None]
        if not all([self._is_offered(entry, why) for entry in objects]):
            return None, []
        if position is obj.TOUCH_PROBE_POSITION and not self.device.write_checked(
            obj.TOUCH_PROBE, obj.TOUCH_PROBE_ON_INDEX, why
        ):
            return None, []
        seen = (self.device.node_id, status, mask) if status is not None else None
        channel = encoder.as_channel(names.INPUT_INDEX)
        return self._planned(channel, "latch", position, of=names.INPUT_ANGLE, seen=seen), objects

    def map_commands(self, encoder: MotorEncoder) -> Sequence[Planned]:
        """Controlword, target velocity and target torque, as far as the drive takes them."""
        readings, sense = self.readings, encoder.direction
        channels: list[Planned] = []
        entries = [obj.CONTROLWORD]
        if self.is_by_position and self._is_offered(obj.TARGET_POSITION, "no speed mode"):
            entries.append(obj.TARGET_POSITION)
            channel = Channel(
                name=names.TARGET_SPEED,
                unit="rad/s",
                scale=speed_scale(self._resolution, self._cycle_ns),
                direction=sense,
                long_name="speed of the target position (0x607A)",
            )
            channels.append(Planned(channel=channel, kind="target_speed"))
        elif readings.speed_mode is not None and self._is_offered(
            obj.TARGET_VELOCITY, "no speed mode"
        ):
            entries.append(obj.TARGET_VELOCITY)
            if readings.velocity_unit > 0.0:
                channel = Channel(
                    name=names.TARGET_SPEED,
                    unit="rad/s",
                    scale=readings.velocity_unit,
                    direction=sense,
                )
                channels.append(Planned(channel=channel, kind="target_speed"))
        if readings.torque_mode is not None and self._is_offered(
            obj.TARGET_TORQUE, "no torque mode"
        ):
            entries.append(obj.TARGET_TORQUE)
            if readings.rated_torque > 0.0:
                channel = Channel(
                    name=names.TARGET_TORQUE,
                    unit="N m",
                    scale=readings.rated_torque / 1000.0,
                    direction=sense,
                )
                channels.append(Planned(channel=channel, kind="target_torque"))
        optional = frozenset({obj.TARGET_TORQUE.key})
        self.commands = map_objects(self.device, entries, is_transmit=False, optional=optional)
        if all(pdo.offset_of(obj.TARGET_TORQUE.key) is None for pdo in self.commands):
            # Without a way into the drive there is no set-point: torque mode is refused, not run at standstill.
            channels = [planned for planned in channels if planned.kind != "target_torque"]
        return channels

    # --- cyclic synchronous position

    @property
    def is_by_position(self) -> bool:
        """Whether it turns by target positions."""
        return self.readings.speed_mode is OperationMode.CYCLIC_POSITION

    def _rest(self, mode: Mode) -> None:
        """In cyclic position the target is set once nothing can follow it any more: in `_switch_on`."""
        if not (mode is Mode.SPEED and self.is_by_position):
            super()._rest(mode)

    def _switch_on(self, candidates: Sequence[OperationMode]) -> None:
        """In cyclic position by way of switched on: from there to its first set speed the target goes with the shaft.

        A drive that takes its time to release a brake, before a shaft that turns, would else pull it back.
        """
        if OperationMode.CYCLIC_POSITION not in candidates:
            super()._switch_on(candidates)
            return
        if self.state() is DriveState.ENABLED:
            # An old target must not act for a moment: another mode is left before this one is chosen.
            self._walk(obj.TO_SWITCHED_ON, DriveState.SWITCHED_ON, "switched on")
        self._choose_one(candidates)
        self._walk(obj.TO_SWITCHED_ON, DriveState.SWITCHED_ON, "switched on")
        self._held, self._held_is_old = self._held_values(), False
        position = self.device.read_integer(obj.POSITION)
        if not self.device.write_checked(obj.TARGET_POSITION, position, "no speed mode"):
            raise DriverError(
                "the drive does not take a target position",
                where=f"{self.device.where}, {obj.TARGET_POSITION}",
                remedy="Choose another of `speed_modes`.",
            )
        self._targets.begin(position)
        self._has_followed, self._unfollowed_cycles, self._goes_along = False, 0, True
        try:
            self._walk(obj.TO_ENABLED, DriveState.ENABLED, "operation enabled")
        finally:
            self._goes_along = False

    def frames_between(self) -> list[bytes]:
        """While it is being enabled in cyclic position: operation enabled, and the position latched last as the
        target. Else none: what it held goes on.
        """
        if not self._goes_along:
            return []
        none = np.zeros(1, dtype=np.int64)
        values = self._set_points(Mode.SPEED, none, none)
        values |= {obj.TARGET_POSITION.key: self._targets.hold(1)}
        return [frame for (frame,) in packed_frames(self.commands, values, 1)]

    def latched(self, record: bytes) -> None:
        """Where the shaft was at the SYNC of a cycle that went out while it was being enabled."""
        if self._goes_along and self._position_at is not None:
            found = record[self._position_at : self._position_at + 4]
            self._targets.begin(int.from_bytes(found, "little", signed=True))

    def to_off(self, *, resets_fault: bool = True) -> None:
        """Servo off from any state; what is added to the set-points is zero when it is left."""
        super().to_off(resets_fault=resets_fault)
        for entry in self._offsets:
            self.device.write_wished(entry, 0)

    def _greatest_travel(self) -> int:
        """Counts that the shaft turns at most in one cycle, by the limit that the drive holds."""
        held = math.inf if self.limits is None else self.limits.speed
        speed = min(held, self._largest_speed)
        return math.ceil(speed * self._cycle_ns * 1e-9 * self._resolution / (2.0 * math.pi))

    def _target_positions(
        self, mode: Mode, speeds: NDArray[np.int64]
    ) -> dict[Key, NDArray[np.int64]]:
        """What goes as 0x607A; a drive that is not led by positions is sent none."""
        if not self.is_by_position:
            return {}
        if mode is not Mode.SPEED:
            return {obj.TARGET_POSITION.key: self._targets.hold(len(speeds))}
        where = f"{self.device.where}, {obj.TARGET_POSITION}"
        planned = self._targets.plan(speeds, self._greatest_travel(), where)
        return {obj.TARGET_POSITION.key: planned}

    def sent(self, cycles: int) -> None:
        """The target goes on from the last one that was sent."""
        self._targets.sent(cycles)

    def _is_offered(self, entry: ObjectRef, consequence: str) -> bool:
        return self.device.read_optional(entry, consequence) is not None

    # --- in the cycle

    def find(self, layout: FrameLayout) -> None:
        """Remember where statusword and mode of operation stand in the record of a cycle."""
        at = self._byte_of(layout, obj.STATUSWORD) or 0
        self._status = slice(at, at + 2)
        self._mode_at = self._byte_of(layout, obj.MODE_DISPLAY)
        self._position_at = self._byte_of(layout, obj.POSITION)
        self._strange_cycles = 0
        self.paused()
        self._held = {}

    def _byte_of(self, layout: FrameLayout, entry: ObjectRef) -> int | None:
        """Where an entry begins in the record of a cycle; None: it is not in it."""
        for slot, pdo in enumerate(layout.pdos):
            offset = pdo.offset_of(entry.key)
            if pdo.node_id == self.device.node_id and offset is not None:
                return slot * SLOT_BYTES + offset
        return None

    def left(self, record: bytes) -> Left | None:
        """Another state than operation enabled, or for some cycles another mode than it was given."""
        word = int.from_bytes(record[self._status], "little")
        state = drive_state(word)
        if state is not DriveState.ENABLED:
            text = f"the drive left operation enabled: {state.value} (statusword 0x{word:04X})"
            return Left("drive-state", text, float(word))
        given = self.mode
        shown = given if self._mode_at is None else record[self._mode_at]
        self._strange_cycles = self._strange_cycles + 1 if shown != given else 0
        if self._strange_cycles >= _MODE_CYCLES:
            text = f"the drive shows mode of operation {shown} (0x6061), it was given {given}"
            return Left("drive-mode", text, float(shown or 0))
        # In another mode the bits below mean something else.
        is_led = given is OperationMode.CYCLIC_POSITION and not self._strange_cycles
        return self._lost_target(word) if is_led else None

    def _lost_target(self, word: int) -> Left | None:
        """The shaft too far behind its target, or the target not followed any more by a drive that said it does."""
        if word & obj.FOLLOWING_ERROR_BIT:
            text = "the shaft is too far behind its target position (statusword 0x{:04X}, bit 13)"
            return Left("drive-following", text.format(word), float(word))
        if word & FOLLOWS_BIT:
            self._has_followed, self._unfollowed_cycles = True, 0
        elif self._has_followed:
            self._unfollowed_cycles += 1
        if self._unfollowed_cycles < _MODE_CYCLES:
            return None
        text = (
            "the drive does not follow its target position any more (statusword 0x{:04X}, bit 12)"
        )
        return Left("drive-not-following", text.format(word), float(word))

    @property
    def largest_counts(self) -> Mapping[str, int]:
        """What the objects of the set-points can hold."""
        return _LARGEST

    def frames(
        self,
        mode: Mode,
        speeds: NDArray[np.int64],
        torques: NDArray[np.int64],
        *,
        may_ask: bool = False,
    ) -> list[list[bytes]]:
        """The bytes of every RPDO (outer) for every cycle (inner)."""
        # After enabling, which may have gone by SDO: a fixed RPDO must carry what now holds.
        if self._held_is_old and may_ask:
            self._held, self._held_is_old = self._held_values(), False
        values = self._set_points(mode, speeds, torques) | self._target_positions(mode, speeds)
        return packed_frames(self.commands, values, len(speeds))

    def _set_points(
        self, mode: Mode, speeds: NDArray[np.int64], torques: NDArray[np.int64]
    ) -> dict[Key, NDArray[np.int64]]:
        """What every RPDO carries, target positions left out."""
        cycles = len(speeds)
        values = {key: np.full(cycles, value) for key, value in self._held.items()}
        return values | {
            obj.CONTROLWORD.key: np.full(cycles, _CONTROLWORD[mode]),
            obj.TARGET_VELOCITY.key: speeds,
            obj.TARGET_TORQUE.key: torques,
        }

    def paused(self) -> None:
        """Something went by SDO: what a fixed RPDO holds beside the set-points is read again."""
        self._held_is_old = True

    def _held_values(self) -> dict[Key, int]:
        """What the entries of a fixed RPDO mapping hold that no cycle sets: the mode, a limit. They
        must be sent as they are.

        Dummy entries (below 0x1000) take anything.
        """
        others = [
            e
            for pdo in self.commands
            for e in pdo.entries
            if e.key not in _COMMANDED and e.index >= 0x1000
        ]
        values = {
            e.key: self.device.read_optional(e, "it is sent as 0 in a fixed RPDO") for e in others
        }
        if obj.MODE.key in values and self.mode is not None:
            # Older drives let 0x6060 be written only; what they were given is known here.
            values[obj.MODE.key] = self.mode
        return {key: int(value) for key, value in values.items() if value is not None}

    @property
    def stops(self) -> Mapping[Ask, Written]:
        """The controlwords that stop it and switch it off."""
        word = self.device.typed(obj.CONTROLWORD)
        return {ask: Written(word, said) for ask, said in stop_words.STOP_WORDS.items()}

    def status_of(self, count: int) -> int:
        """The statusword is what it is."""
        return count

    def describe(self) -> dict[str, str]:
        """Units, modes and settings in words."""
        readings = self.readings
        return {
            "rated_torque": f"{readings.rated_torque:g} N m",
            "velocity_unit": f"{readings.velocity_unit:g} rad/s",
            "speed_mode": " or ".join(mode.name for mode in self.modes_for(Mode.SPEED)) or "none",
            "torque_mode": " or ".join(mode.name for mode in self.modes_for(Mode.TORQUE)) or "none",
            **{name: f"{value:g}" for name, value in readings.settings.items()},
        }


def _by_importance(entry: ObjectRef) -> int:
    """Statusword, position and torque share the first frame; the latch has one of its own."""
    first = (obj.STATUSWORD.key, obj.POSITION.key, obj.TORQUE.key)
    return first.index(entry.key) if entry.key in first else len(first)
