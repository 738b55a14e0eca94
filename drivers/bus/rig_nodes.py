# pyright: standard
"""The nodes of a rig brought up together: who is there, what is mapped where, and what each column of the data is."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import cast

from drivers import channel as names
from drivers.bus.cia301 import ObjectRef
from drivers.bus.cia401 import AnalogModule, AnalogModuleConfig
from drivers.bus.cia402 import tables as obj
from drivers.bus.cia402.config import DriveConfig
from drivers.bus.cia402.drive import ServoAmplifier
from drivers.bus.cia406 import POSITION, Counter, CounterConfig
from drivers.bus.columns import Column, Kind, Validity
from drivers.bus.device import Identity, Missing, RemoteDevice
from drivers.bus.frames import SLOT_BYTES, Field, FrameLayout
from drivers.bus.network import PumpedBus
from drivers.bus.pdo import MappedPdo, map_objects, pack
from drivers.bus.request_line import Place
from drivers.bus.set_points import COMMANDED
from drivers.channel import Calibration, Channel, encoder_channel
from drivers.counting import largest_step, require_range
from drivers.errors import DriverError
from drivers.port import Mode

_ORDER = (
    names.INPUT_ANGLE,
    names.OUTPUT_ANGLE,
    names.TORQUE,
    names.DRIVE_TORQUE,
    names.TARGET_SPEED,
    names.TARGET_TORQUE,
    names.INPUT_INDEX,
    names.OUTPUT_INDEX,
    names.INDEX_SEEN,
    names.STATUSWORD,
    names.HOUSING_TEMPERATURE,
    names.AMBIENT_TEMPERATURE,
)
"""The order of the columns; channels of other names come after these."""
_PROBE_LATCHED = 0x0002
"""Bit 1 of the touch probe status: a position of the positive edge is stored."""


@dataclass(frozen=True, kw_only=True)
class MotorEncoder:
    """The motor encoder as the drive reports it in 0x6064: lines and multiplication apart, sense, and
    the motor's greatest speed [rad/s], with room, which bounds the steps of both encoders' counts.

    `index_position` is the object in which the drive latches the position at the encoder's index
    mark, `index_status` and `index_mask` tell that one has been seen; None: touch probe 1 of CiA
    402, where the drive has it.
    """

    lines: int = 8192
    multiplication: int = 4
    direction: int = 1
    largest_speed: float
    modulus: int = 1 << 32
    index_position: ObjectRef | None = None
    index_status: ObjectRef | None = None
    index_mask: int = 0x0001
    long_name: str = ""
    model: str = ""
    serial_number: str = ""
    calibration: Calibration = field(default_factory=Calibration)

    def __post_init__(self) -> None:
        if not 0.0 < self.largest_speed < math.inf:
            raise DriverError(
                "the motor's greatest speed must be known: jumps of the counts are told by it",
                where="motor encoder, largest speed",
                value=self.largest_speed,
                limit="> 0 rad/s",
            )

    def as_channel(self, name: str) -> Channel:
        """The position as an angle channel."""
        return encoder_channel(
            name,
            lines=self.lines,
            multiplication=self.multiplication,
            direction=self.direction,
            modulus=self.modulus,
            long_name=self.long_name,
            model=self.model,
            serial_number=self.serial_number,
            calibration=self.calibration,
        )


@dataclass(frozen=True)
class GuardContact:
    """The contact of the rig's guard, wired to an input of a node: closed when (value AND `mask`) equals `closed`."""

    node_id: int
    entry: ObjectRef
    mask: int
    closed: int


@dataclass(kw_only=True)
class _Source:
    """A channel before its place in the frames is known."""

    channel: Channel
    kind: str
    node_id: int = 0
    entry: ObjectRef | None = None
    largest_step: int = 0
    quantum: float = 0.0
    of: str = ""
    seen: tuple[int, ObjectRef, int] | None = None
    closed: int = 0
    analog: object = None


class RigNodes:
    """Servo amplifier, counters and analog modules of one bus. `bring_up` leaves them
    PRE-OPERATIONAL, mapped and off.
    """

    def __init__(
        self,
        bus: PumpedBus,
        cycle_ns: int,
        drive: DriveConfig,
        motor_encoder: MotorEncoder,
        counters: tuple[CounterConfig, ...],
        modules: tuple[AnalogModuleConfig, ...],
        guard: GuardContact | None = None,
    ) -> None:
        self._bus, self._cycle_ns, self._encoder, self._guard = bus, cycle_ns, motor_encoder, guard
        _require_own_nodes(bus.own_node_id, drive, counters, modules)
        self.drive = ServoAmplifier(bus, drive)
        shared: dict[int, RemoteDevice] = {}
        self.counters: list[Counter] = []
        self.modules: list[AnalogModule] = []
        for config in counters:
            self.counters.append(Counter(bus, config, shared.get(config.node_id)))
            shared[config.node_id] = self.counters[-1].device
        for config in modules:
            self.modules.append(AnalogModule(bus, config, shared.get(config.node_id)))
            shared[config.node_id] = self.modules[-1].device
        self.identities: dict[str, Identity] = {}
        self.commands: list[MappedPdo] = []
        self.layout = FrameLayout([], [])
        self.columns: list[Column] = []
        self.validities: list[Validity] = []
        self._sources: list[_Source] = []
        self._seen: list[tuple[int, ObjectRef, int] | None] = [None, None]

    @property
    def devices(self) -> list[RemoteDevice]:
        """All nodes, the drive first; a coupler that holds several counters and inputs is one of them."""
        held = [part.device for part in (*self.counters, *self.modules)]
        return [self.drive.device, *dict.fromkeys(held)]

    def missing(self) -> dict[int, list[Missing]]:
        """What each node does not offer, by node-ID."""
        return {device.node_id: device.missing for device in self.devices}

    def bring_up(self) -> None:
        """Bring up every node, map its data, and lay out the record of a cycle."""
        readings = self.drive.bring_up(self._cycle_ns)
        self.identities["servo amplifier"] = readings.identity
        if readings.counts_per_revolution:
            self._check_encoder(readings.counts_per_revolution)
        held = self._held()
        for first, *others in held.values():
            identity = first.bring_up()
            for part in others:
                part.check()
            self.identities[" and ".join(_name_of(part) for part in (first, *others))] = identity
        transmitted = self._map_drive()
        for device, parts in held.items():
            transmitted += self._map_parts(device, parts)
        _require_own_identifiers([*transmitted, *self.commands])
        self._lay_out(transmitted)

    def _held(self) -> dict[RemoteDevice, list[Counter | AnalogModule]]:
        """The counters and inputs of each node beside the drive."""
        held: dict[RemoteDevice, list[Counter | AnalogModule]] = {}
        for part in (*self.counters, *self.modules):
            held.setdefault(part.device, []).append(part)
        return held

    def _check_encoder(self, reported: float) -> None:
        counts = self._encoder.lines * self._encoder.multiplication
        if not math.isclose(reported, counts, rel_tol=1e-9):
            self._bus.emit(
                "warning",
                "counts-per-revolution",
                self.drive.device.where,
                f"0x6064 has {reported:g} counts per revolution by the drive, {counts} by the configuration "
                f"({self._encoder.lines} lines x {self._encoder.multiplication}); the configuration holds",
            )

    # --- mapping

    def _map_drive(self) -> list[MappedPdo]:
        device, readings, sense = self.drive.device, self.drive.readings, self._encoder.direction
        node_id = device.node_id
        wanted, optional = [obj.STATUSWORD], []
        status = Channel(name=names.STATUSWORD, unit="1", scale=1.0, long_name="CiA 402 statusword")
        self._sources.append(
            _Source(channel=status, kind="plain", node_id=node_id, entry=obj.STATUSWORD)
        )
        if not any(c.config.channel == names.INPUT_ANGLE for c in self.counters):
            wanted.append(obj.POSITION)
            encoder = self._encoder
            resolution = encoder.lines * encoder.multiplication
            most = largest_step(resolution, encoder.largest_speed, self._cycle_ns)
            require_range(most, encoder.modulus, self._cycle_ns, f"{device.where}, {obj.POSITION}")
            self._sources.append(
                _Source(
                    channel=encoder.as_channel(names.INPUT_ANGLE),
                    kind="count",
                    node_id=node_id,
                    entry=obj.POSITION,
                    largest_step=most,
                )
            )
            optional += self._latch_sources()
        torque, unit = (
            self.drive.config.actual_torque,
            self.drive.config.torque_unit or readings.rated_torque / 1000.0,
        )
        if self._is_offered(torque, "no cross-check of the torque port") and unit > 0.0:
            optional.append(torque)
            long_name = f"torque by the drive (0x{torque.index:04X})"
            channel = Channel(
                name=names.DRIVE_TORQUE,
                unit="N m",
                scale=unit,
                direction=sense,
                long_name=long_name,
            )
            self._sources.append(
                _Source(channel=channel, kind="plain", node_id=node_id, entry=torque)
            )
        optional += self._guard_of(node_id, [*wanted, *optional])
        # Watched where it rides along: a frame of its own in every cycle it is not worth.
        full = [*wanted, *optional, obj.MODE_DISPLAY]
        if len(pack(full)) == len(pack(full[:-1])) and self._is_offered(
            obj.MODE_DISPLAY, "another master that changes the mode shows only by the motion"
        ):
            optional.append(obj.MODE_DISPLAY)
        mapped = map_objects(
            device,
            sorted([*wanted, *optional], key=_by_importance),
            is_transmit=True,
            optional=frozenset(e.key for e in optional),
        )
        self.commands = self._map_commands()
        return mapped

    def _map_commands(self) -> list[MappedPdo]:
        readings, sense = self.drive.readings, self._encoder.direction
        entries = [obj.CONTROLWORD]
        if readings.speed_mode is not None and self._is_offered(
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
                self._sources.append(_Source(channel=channel, kind="target_speed"))
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
                self._sources.append(_Source(channel=channel, kind="target_torque"))
        optional = frozenset({obj.TARGET_TORQUE.key})
        mapped = map_objects(self.drive.device, entries, is_transmit=False, optional=optional)
        if all(pdo.offset_of(obj.TARGET_TORQUE.key) is None for pdo in mapped):
            # Without a way into the drive there is no set-point: torque mode is refused, not run at standstill.
            self._sources = [source for source in self._sources if source.kind != "target_torque"]
        return mapped

    def _latch_sources(self) -> list[ObjectRef]:
        """The latch of the motor encoder's index mark: the configured objects, else touch probe 1, else none."""
        device, encoder = self.drive.device, self._encoder
        why = "the motor encoder's index mark is not seen: phases are not carried from run to run"
        position, status, mask = encoder.index_position, encoder.index_status, encoder.index_mask
        if position is None:
            if not self.drive.config.latch_index or not self._is_offered(obj.TOUCH_PROBE, why):
                return []
            position, status, mask = (
                obj.TOUCH_PROBE_POSITION,
                obj.TOUCH_PROBE_STATUS,
                _PROBE_LATCHED,
            )
        objects = [entry for entry in (position, status) if entry is not None]
        if not all([self._is_offered(entry, why) for entry in objects]):
            return []
        if position is obj.TOUCH_PROBE_POSITION and not device.write_checked(
            obj.TOUCH_PROBE, obj.TOUCH_PROBE_ON_INDEX, why
        ):
            return []
        seen = (device.node_id, status, mask) if status is not None else None
        channel = encoder.as_channel(names.INPUT_INDEX)
        self._sources.append(
            _Source(
                channel=channel,
                kind="latch",
                node_id=device.node_id,
                entry=position,
                of=names.INPUT_ANGLE,
                seen=seen,
            )
        )
        self._seen[0] = seen
        return objects

    def _map_parts(
        self, device: RemoteDevice, parts: Sequence[Counter | AnalogModule]
    ) -> list[MappedPdo]:
        """Map what the counters and inputs of one node need, and the guard's input where it is there."""
        wanted: dict[tuple[int, int], ObjectRef] = {}
        needed: set[tuple[int, int]] = set()
        for part in parts:
            if isinstance(part, Counter):
                self._add_counter(part)
                needed |= {e.key for e in part.objects} - part.optional
            else:
                self._add_module(part)
                needed |= {e.key for e in part.objects}
            wanted = {e.key: e for e in part.objects} | wanted
        wanted |= {e.key: e for e in self._guard_of(device.node_id, list(wanted.values()))}
        return map_objects(
            device,
            list(wanted.values()),
            is_transmit=True,
            optional=frozenset(wanted) - needed,
        )

    def _add_counter(self, counter: Counter) -> None:
        config = counter.config
        whole = counter.modulus if counter.modulus <= 1 << 32 else 0
        channel = config.as_channel(whole)
        # Without a speed of its own its shaft turns no faster than the motor's.
        speed = config.largest_speed or self._encoder.largest_speed
        resolution = config.lines * config.multiplication
        most = largest_step(resolution, speed, self._cycle_ns)
        where = f"{counter.device.where}, {config.position}"
        require_range(most, whole, self._cycle_ns, where)
        self._sources.append(
            _Source(
                channel=channel,
                kind="count",
                node_id=config.node_id,
                entry=config.position,
                largest_step=most,
            )
        )
        if config.index_position is not None:
            seen = None
            if config.index_status is not None:
                seen = (config.node_id, config.index_status, config.index_mask)
                self._seen[1 if config.channel == names.OUTPUT_ANGLE else 0] = seen
            latch = encoder_channel(
                config.index_channel,
                lines=config.lines,
                multiplication=config.multiplication,
                direction=config.direction,
                modulus=whole,
            )
            self._sources.append(
                _Source(
                    channel=latch,
                    kind="latch",
                    node_id=config.node_id,
                    entry=config.index_position,
                    of=config.channel,
                    seen=seen,
                )
            )

    def _add_module(self, module: AnalogModule) -> None:
        for analog in module.config.inputs:
            self._sources.append(
                _Source(
                    channel=analog.as_channel(),
                    kind="plain",
                    node_id=module.config.node_id,
                    entry=analog.source,
                    quantum=analog.quantum,
                    analog=analog,
                )
            )

    def _guard_of(self, node_id: int, others: Sequence[ObjectRef]) -> list[ObjectRef]:
        """The guard's input, where it is one of this node and not mapped with its other objects anyway."""
        guard = self._guard
        if guard is None or guard.node_id != node_id:
            return []
        channel = Channel(
            name=names.GUARD_CLOSED, unit="1", scale=1.0, long_name="the guard's contact is closed"
        )
        seen = (node_id, guard.entry, guard.mask)
        self._sources.append(
            _Source(channel=channel, kind="contact", seen=seen, closed=guard.closed)
        )
        return [guard.entry] if guard.entry.key not in {other.key for other in others} else []

    def _is_offered(self, entry: ObjectRef, consequence: str) -> bool:
        return self.drive.device.read_optional(entry, consequence) is not None

    # --- layout

    def _lay_out(self, pdos: list[MappedPdo]) -> None:
        """Fields and columns from the sources, in the order of the channels' names."""
        if any(self._seen):
            self._sources.append(
                _Source(
                    channel=Channel(
                        name=names.INDEX_SEEN, unit="1", scale=1.0, long_name="index marks seen"
                    ),
                    kind="seen",
                )
            )
        fields: list[Field] = []
        place: dict[tuple[int, tuple[int, int], int], int] = {}

        def field_of(node_id: int, entry: ObjectRef, quantum: float = 0.0) -> int:
            key = (node_id, entry.key, entry.offset)
            if key not in place:
                for slot, pdo in enumerate(pdos):
                    offset = pdo.offset_of(entry.key) if pdo.node_id == node_id else None
                    if offset is not None:
                        mapped = next(e for e in pdo.entries if e.key == entry.key)
                        place[key] = len(fields)
                        kind = mapped.data_type if entry.part is None else entry.value_type
                        at = offset + entry.offset
                        fields.append(Field(str(entry), slot, at, kind, quantum))
                        break
            return place.get(key, -1)

        present = [
            s
            for s in self._sources
            if s.entry is None or field_of(s.node_id, s.entry, s.quantum) >= 0
        ]
        present = [s for s in present if s.seen is None or field_of(s.seen[0], s.seen[1]) >= 0]
        present.sort(
            key=lambda s: _ORDER.index(s.channel.name) if s.channel.name in _ORDER else len(_ORDER)
        )
        column_of = {s.channel.name: i for i, s in enumerate(present)}
        if len(column_of) != len(present):
            raise DriverError(
                "two channels have the same name",
                where="rig",
                value=[s.channel.name for s in present],
            )
        self.columns = [self._column(s, column_of, field_of) for s in present]
        for counter in self.counters:
            if counter.has_alarms and counter.config.alarms is not None:
                at = field_of(counter.config.node_id, counter.config.alarms)
                self.validities += [Validity(at, counter.config.alarm_mask)] if at >= 0 else []
        self.layout = FrameLayout(pdos, fields)
        if self._guard is not None and names.GUARD_CLOSED not in column_of:
            self._bus.emit(
                "warning",
                "guard-not-mapped",
                f"node {self._guard.node_id}",
                f"{self._guard.entry} cannot be sent with every SYNC: the guard is looked at when the rig is armed, "
                "and nobody notices when it is opened in motion",
            )

    def _column(
        self, source: _Source, column_of: Mapping[str, int], field_of: Callable[..., int]
    ) -> Column:
        seen: tuple[tuple[int, int], ...] = ()
        if source.kind == "seen":
            # Bit 0 input, bit 1 output; a side without latch state stays 0.
            pairs = [(field_of(s[0], s[1]), s[2]) if s is not None else (0, 0) for s in self._seen]
            seen = tuple((at, mask if at >= 0 else 0) for at, mask in pairs)
        elif source.seen is not None:
            seen = ((field_of(source.seen[0], source.seen[1]), source.seen[2]),)
        own = (
            field_of(source.node_id, source.entry, source.quantum)
            if source.entry is not None
            else -1
        )
        return Column(
            channel=source.channel,
            kind=cast("Kind", source.kind),
            field=own,
            of=column_of.get(source.of, -1),
            seen_fields=seen,
            largest_step=source.largest_step,
            closed=source.closed,
            analog=source.analog,  # type: ignore[arg-type]
        )

    # --- starting and stopping

    def start(self) -> None:
        """NMT start of every node; then the drive's watch over the computer."""
        for device in self.devices:
            device.start()
        self.drive.arm_heartbeat()

    def require_unbroken(self) -> None:
        """Raise `DriverError` if a node has restarted since it was brought up: mapping, limits and
        watch are gone with it.
        """
        restarted = [device.where for device in self.devices if device.has_restarted]
        if restarted:
            raise DriverError(
                "the node has restarted and is no longer as it was set up",
                where=", ".join(restarted),
                remedy="Close the rig and open it again.",
            )

    def held_values(self) -> dict[tuple[int, int], int]:
        """What the entries of a fixed RPDO mapping hold that no cycle sets: the mode, a limit. They
        must be sent as they are.

        Dummy entries (below 0x1000) take anything.
        """
        others = [
            e
            for pdo in self.commands
            for e in pdo.entries
            if e.key not in COMMANDED and e.index >= 0x1000
        ]
        values = {
            e.key: self.drive.device.read_optional(e, "it is sent as 0 in a fixed RPDO")
            for e in others
        }
        if obj.MODE.key in values and self.drive.mode is not None:
            # Older drives let 0x6060 be written only; what they were given is known here.
            values[obj.MODE.key] = self.drive.mode
        return {key: int(value) for key, value in values.items() if value is not None}

    def byte_of(self, entry: ObjectRef) -> int | None:
        """Where an entry of the drive begins in the record of a cycle; None: it is not in it."""
        for slot, pdo in enumerate(self.layout.pdos):
            offset = pdo.offset_of(entry.key)
            if pdo.node_id == self.drive.device.node_id and offset is not None:
                return slot * SLOT_BYTES + offset
        return None

    def places(self, is_absent: Callable[[int], bool]) -> dict[str, Place]:
        """Device and object of every channel that one device holds; `is_absent` of a slot of the layout."""

        def arrives(name: str) -> Callable[[], bool]:
            column = next(column for column in self.columns if column.channel.name == name)
            slot = self.layout.fields[column.field].slot
            return lambda: not is_absent(slot)

        devices = {device.node_id: device for device in self.devices}
        present = {column.channel.name for column in self.columns if column.field >= 0}
        return {
            source.channel.name: Place(
                devices[source.node_id], source.entry, arrives(source.channel.name)
            )
            for source in self._sources
            if source.entry is not None and source.channel.name in present
        }

    def describe(self) -> dict[str, dict[str, str]]:
        """Identities, settings and missing objects in words, for the run file."""
        described = {name: identity.as_text() for name, identity in self.identities.items()}
        readings = self.drive.readings
        described["servo amplifier"] |= {
            "rated_torque": f"{readings.rated_torque:g} N m",
            "velocity_unit": f"{readings.velocity_unit:g} rad/s",
            "speed_mode": " or ".join(mode.name for mode in self.drive.modes_for(Mode.SPEED))
            or "none",
            "torque_mode": " or ".join(mode.name for mode in self.drive.modes_for(Mode.TORQUE))
            or "none",
            **{name: f"{value:g}" for name, value in readings.settings.items()},
        }
        described["mapping"] = {f"slot {i}": str(pdo) for i, pdo in enumerate(self.layout.pdos)}
        described["mapping"] |= {f"command {i}": str(pdo) for i, pdo in enumerate(self.commands)}
        for node_id, missing in self.missing().items():
            for entry in missing:
                text = f"{entry.name}: {entry.consequence}" if entry.consequence else entry.name
                described.setdefault("missing", {})[
                    f"node {node_id} 0x{entry.index:04X}:{entry.subindex}"
                ] = text
        return described


def _name_of(part: Counter | AnalogModule) -> str:
    if isinstance(part, Counter):
        return f"counter {part.config.channel}"
    return f"analog module {part.config.node_id}"


def _require_own_nodes(
    own_node_id: int,
    drive: DriveConfig,
    counters: Sequence[CounterConfig],
    modules: Sequence[AnalogModuleConfig],
) -> None:
    """Raise `DriverError` where a node-ID is given twice. Only a coupler may hold several counters and inputs: its
    counters are objects of terminals, not the position of an encoder.
    """
    encoders = [c.node_id for c in counters if c.position.key == POSITION.key]
    couplers = {c.node_id for c in counters if c.position.key != POSITION.key}
    inputs = [m.node_id for m in modules]
    node_ids = [drive.node_id, *encoders, *couplers, *(n for n in inputs if n not in couplers)]
    is_own = own_node_id not in node_ids and len(set(inputs)) == len(inputs)
    if len(set(node_ids)) != len(node_ids) or not is_own:
        raise DriverError(
            "every node needs a node-ID of its own",
            where="bus",
            value=[drive.node_id, *(c.node_id for c in counters), *inputs],
            limit=f"distinct (but for the terminals of one coupler), and not {own_node_id}, the computer's own",
        )


def _require_own_identifiers(pdos: Sequence[MappedPdo]) -> None:
    """Raise `DriverError` where two PDOs have the same COB-ID: what arrives under it could be either."""
    by_cob_id: dict[int, MappedPdo] = {}
    for pdo in pdos:
        other = by_cob_id.setdefault(pdo.cob_id, pdo)
        if other is not pdo:
            raise DriverError(
                "two PDOs share a COB-ID",
                where="bus",
                value=f"{other}; {pdo}",
                limit="one PDO per COB-ID",
                remedy="Give one of them another COB-ID with the vendor's tool, or reset the "
                "device to its factory settings.",
            )


def _by_importance(entry: ObjectRef) -> int:
    """Statusword, position and torque share the first frame; the latch has one of its own."""
    first = (obj.STATUSWORD.key, obj.POSITION.key, obj.TORQUE.key)
    return first.index(entry.key) if entry.key in first else len(first)
