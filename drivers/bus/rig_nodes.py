"""The nodes of a rig brought up together: who is there, what is mapped where, and what each column of the data is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from drivers import channel as names
from drivers.bus.amplifier import Amplifier
from drivers.bus.amplifiers import AmplifierConfig, amplifier_of
from drivers.bus.cia301 import ObjectRef
from drivers.bus.cia401 import AnalogModule, AnalogModuleConfig
from drivers.bus.cia406 import POSITION, Counter, CounterConfig
from drivers.bus.columns import Column, Validity
from drivers.bus.device import Identity, Missing, RemoteDevice
from drivers.bus.frames import Fields, FrameLayout
from drivers.bus.motor_encoder import MotorEncoder
from drivers.bus.network import PumpedBus
from drivers.bus.pdo import MappedPdo, map_objects
from drivers.bus.planned import Planned
from drivers.bus.request_line import Place
from drivers.bus.set_points import Key
from drivers.channel import Channel, encoder_channel
from drivers.counting import largest_step, require_range
from drivers.errors import DriverError

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


@dataclass(frozen=True)
class GuardContact:
    """The contact of the rig's guard, wired to an input of a node: closed when (value AND `mask`) equals `closed`."""

    node_id: int
    entry: ObjectRef
    mask: int
    closed: int


class RigNodes:
    """Servo amplifier, counters and analog modules of one bus. `bring_up` leaves them
    PRE-OPERATIONAL, mapped and off.
    """

    def __init__(
        self,
        bus: PumpedBus,
        cycle_ns: int,
        drive: AmplifierConfig,
        motor_encoder: MotorEncoder,
        counters: tuple[CounterConfig, ...],
        modules: tuple[AnalogModuleConfig, ...],
        guard: GuardContact | None = None,
    ) -> None:
        self._bus, self._cycle_ns, self._encoder, self._guard = bus, cycle_ns, motor_encoder, guard
        self.drive = amplifier_of(bus, drive)
        _require_own_nodes(bus.own_node_id, self.drive, counters, modules)
        shared = {drive.node_id: self.drive.device}
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
        self._sources: list[Planned] = []
        self._seen: list[tuple[int, ObjectRef, int] | None] = [None, None]

    @property
    def devices(self) -> list[RemoteDevice]:
        """All nodes, the drive first; a coupler that holds several counters and inputs is one of them."""
        held = [part.device for part in (*self.counters, *self.modules)]
        return list(dict.fromkeys([self.drive.device, *held]))

    @property
    def are_simulated(self) -> bool:
        """Whether one of them calls itself simulated: then the rig is, however it is reached."""
        return any(identity.is_simulated for identity in self.identities.values())

    def read_integer(self, node_id: int, entry: ObjectRef) -> int:
        """An object of a node by SDO. Raises `DriverError`."""
        devices = {device.node_id: device for device in self.devices}
        if node_id not in devices:
            raise DriverError("no such node", where="bus", value=node_id, limit=str(list(devices)))
        return devices[node_id].read_integer(entry)

    def missing(self) -> dict[int, list[Missing]]:
        """What each node does not offer, by node-ID."""
        return {device.node_id: device.missing for device in self.devices}

    def bring_up(self) -> None:
        """Bring up every node, map its data, and lay out the record of a cycle."""
        self.drive.bring_up(self._cycle_ns)
        held = self._held()
        terminals = held.pop(self.drive.device, [])
        for part in terminals:
            part.check()
        kinds = [self.drive.kind, *(_name_of(part) for part in terminals)]
        self.identities[" and ".join(kinds)] = self.drive.identity
        for first, *others in held.values():
            identity = first.bring_up()
            for part in others:
                part.check()
            self.identities[" and ".join(_name_of(part) for part in (first, *others))] = identity
        transmitted = self._map_amplifier(terminals)
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

    # --- mapping

    def _map_amplifier(self, parts: Sequence[Counter | AnalogModule]) -> list[MappedPdo]:
        """Map what the amplifier sends, with counters and inputs that are terminals of its node, and its commands."""
        drive = self.drive
        is_counted = any(c.config.channel == names.INPUT_ANGLE for c in self.counters)
        wanted, needed = self._wanted_of(parts)
        wanted |= {entry.key: entry for entry in self._guard_of(drive.device.node_id)}
        plan = drive.plan(
            self._encoder, self._cycle_ns, is_counted=is_counted, beside=list(wanted.values())
        )
        self._sources += plan.channels
        if plan.seen is not None:
            self._seen[0] = plan.seen
        optional = frozenset(plan.optional - needed)
        mapped = map_objects(drive.device, plan.objects, is_transmit=True, optional=optional)
        self._sources += drive.map_commands(self._encoder)
        return mapped

    def _map_parts(
        self, device: RemoteDevice, parts: Sequence[Counter | AnalogModule]
    ) -> list[MappedPdo]:
        """Map what the counters and inputs of one node need, and the guard's input where it is there."""
        wanted, needed = self._wanted_of(parts)
        wanted |= {entry.key: entry for entry in self._guard_of(device.node_id)}
        optional = frozenset(wanted) - needed
        return map_objects(device, list(wanted.values()), is_transmit=True, optional=optional)

    def _wanted_of(
        self, parts: Sequence[Counter | AnalogModule]
    ) -> tuple[dict[Key, ObjectRef], set[Key]]:
        """The objects of counters and inputs, and the keys of those that must be there; their channels are planned."""
        wanted: dict[Key, ObjectRef] = {}
        needed: set[Key] = set()
        for part in parts:
            if isinstance(part, Counter):
                self._add_counter(part)
                needed |= {e.key for e in part.objects} - part.optional
            else:
                self._add_module(part)
                needed |= {e.key for e in part.objects}
            wanted = {e.key: e for e in part.objects} | wanted
        return wanted, needed

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
            Planned(
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
                Planned(
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
                Planned(
                    channel=analog.as_channel(),
                    kind="plain",
                    node_id=module.config.node_id,
                    entry=analog.source,
                    quantum=analog.quantum,
                    analog=analog,
                )
            )

    def _guard_of(self, node_id: int) -> list[ObjectRef]:
        """The guard's input, where it is one of this node."""
        guard = self._guard
        if guard is None or guard.node_id != node_id:
            return []
        channel = Channel(
            name=names.GUARD_CLOSED, unit="1", scale=1.0, long_name="the guard's contact is closed"
        )
        seen = (node_id, guard.entry, guard.mask)
        self._sources.append(
            Planned(channel=channel, kind="contact", seen=seen, closed=guard.closed)
        )
        return [guard.entry]

    # --- layout

    def _lay_out(self, pdos: list[MappedPdo]) -> None:
        """Fields and columns from the sources, in the order of the channels' names."""
        if any(self._seen):
            self._sources.append(
                Planned(
                    channel=Channel(
                        name=names.INDEX_SEEN, unit="1", scale=1.0, long_name="index marks seen"
                    ),
                    kind="seen",
                )
            )
        fields = Fields(pdos)
        number = fields.number
        present = [
            s
            for s in self._sources
            if s.entry is None or number(s.node_id, s.entry, s.quantum) >= 0
        ]
        present = [s for s in present if s.seen is None or number(s.seen[0], s.seen[1]) >= 0]
        rank = {name: place for place, name in enumerate(_ORDER)}
        present.sort(key=lambda source: rank.get(source.channel.name, len(_ORDER)))
        column_of = {s.channel.name: i for i, s in enumerate(present)}
        if len(column_of) != len(present):
            raise DriverError(
                "two channels have the same name",
                where="rig",
                value=[s.channel.name for s in present],
            )
        self.columns = [self._column(s, column_of, number) for s in present]
        for counter in self.counters:
            if counter.has_alarms and counter.config.alarms is not None:
                at = number(counter.config.node_id, counter.config.alarms)
                self.validities += [Validity(at, counter.config.alarm_mask)] if at >= 0 else []
        self.layout = FrameLayout(pdos, fields.made)
        if self._guard is not None and names.GUARD_CLOSED not in column_of:
            self._bus.emit(
                "warning",
                "guard-not-mapped",
                f"node {self._guard.node_id}",
                f"{self._guard.entry} cannot be sent with every SYNC: the guard is looked at when the rig is armed, "
                "and nobody notices when it is opened in motion",
            )

    def _column(
        self, source: Planned, column_of: Mapping[str, int], field_of: Callable[..., int]
    ) -> Column:
        seen: tuple[tuple[int, int], ...] = ()
        if source.kind == "seen":
            # Bit 0 input, bit 1 output; a side without latch state stays 0.
            pairs = [(field_of(s[0], s[1]), s[2]) if s is not None else (0, 0) for s in self._seen]
            seen = tuple((at, mask if at >= 0 else 0) for at, mask in pairs)
        elif source.seen is not None:
            seen = ((field_of(source.seen[0], source.seen[1]), source.seen[2]),)
        own = -1
        if source.entry is not None:
            own = field_of(source.node_id, source.entry, source.quantum)
        return Column(
            channel=source.channel,
            kind=source.kind,
            field=own,
            of=column_of.get(source.of, -1),
            seen_fields=seen,
            largest_step=source.largest_step,
            closed=source.closed,
            analog=source.analog,
            lines=source.lines,
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
                devices[source.node_id],
                source.entry,
                arrives(source.channel.name),
                self.drive.status_of if source.channel.name == names.STATUSWORD else int,
            )
            for source in self._sources
            if source.entry is not None and source.channel.name in present
        }

    def describe(self) -> dict[str, dict[str, str]]:
        """Identities, settings and missing objects in words, for the run file."""
        described = {name: identity.as_text() for name, identity in self.identities.items()}
        described[next(iter(described))] |= self.drive.describe()
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
    drive: Amplifier,
    counters: Sequence[CounterConfig],
    modules: Sequence[AnalogModuleConfig],
) -> None:
    """Raise `DriverError` where a node-ID is given twice. Only a coupler may hold several counters and inputs: its
    counters are objects of terminals, not the position of an encoder. It may hold an amplifier's terminals, too.
    """
    encoders = [c.node_id for c in counters if c.position.key == POSITION.key]
    couplers = {c.node_id for c in counters if c.position.key != POSITION.key}
    inputs = [m.node_id for m in modules]
    own = drive.device.node_id
    if not drive.stands_alone:
        couplers.add(own)
    alone = [own] if drive.stands_alone else []
    node_ids = [*alone, *encoders, *couplers, *(n for n in inputs if n not in couplers)]
    is_own = own_node_id not in node_ids and len(set(inputs)) == len(inputs)
    if len(set(node_ids)) != len(node_ids) or not is_own:
        raise DriverError(
            "every node needs a node-ID of its own",
            where="bus",
            value=[own, *(c.node_id for c in counters), *inputs],
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
