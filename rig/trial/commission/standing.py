"""The stages in which nothing is switched on: listen, read by SDO, turn by hand. Not one set-point is sent in them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass

from drivers import channel as names
from drivers.bus.analog.config import ReferenceConfig
from drivers.bus.cia301 import HEARTBEAT_BASE, HIGHEST_NODE_ID, SYNC_COB_ID, ObjectRef
from drivers.bus.cia402 import tables as obj
from drivers.bus.cia406 import POSITION, TOTAL_RANGE, CounterConfig
from drivers.bus.device import RemoteDevice
from drivers.bus.discover import FoundNode, read_node
from drivers.bus.frame_log import FrameLog
from drivers.bus.listening import LEAST_TIME_NS, ListeningBus, masters_heard
from drivers.bus.rig_config import CanRigConfig
from drivers.errors import DriverError
from experiments.finding import Finding, Severity, passed_if
from model.kinematic_error import output_sign
from model.units import REVOLUTION
from rig.bench.backends.assembly import AssembledRig
from rig.bench.backends.registry import nameplates
from rig.bench.limits import kinematic_error_margin, torsion_stiffness
from rig.run.frames import SUFFIX
from rig.runfile.sealed import seal_in_place
from rig.trial.commission.work import Seen, Work
from rig.trial.doctor.standing import ROOM_TEMPERATURES

_NOT_DIGITS = re.compile(r"\D")
TORQUE_FACTOR = 2.0
"""Factor between two statements of the rated torque from which on one of them is wrong."""
_VOLTAGE_BIT = 0x0010
"""Statusword bit 4: clear where the power stage has no voltage, or the safe torque off is active."""
LEAST_TURNS = 5.0
"""Turns by hand below which the ratio cannot be told from that of the other mounting."""
_MISCOUNT = 0.25
"""Turns by which somebody may miscount, or stop beside the mark."""


@contextmanager
def _quiet(stage: str, work: Work, seen: Seen, rig: AssembledRig) -> Iterator[ListeningBus]:
    """The bus, for whoever only listens and reads; its frames are kept. Raises `DriverError` on a rig without one."""
    if rig.quiet_bus is None or rig.described is None:
        raise DriverError("this rig has no bus to listen to", where=rig.name)
    bus = rig.quiet_bus()
    bus.log = FrameLog(rig.described.cycle_ns)
    try:
        yield bus
    finally:
        bus.close()
        epoch = bus.clock.calendar_ns() - bus.clock.monotonic_ns()
        path = (
            work.order.folder / f"commissioning-{stage}-{_NOT_DIGITS.sub('', work.now())}{SUFFIX}"
        )
        work.order.folder.mkdir(parents=True, exist_ok=True)
        bus.log.write(path, epoch)
        seen.runs[path.name] = seal_in_place(path, path.read_bytes())


# --- listen


def listen(work: Work, seen: Seen) -> None:
    """Hear who is there, and that nobody else commands."""
    rig = work.rig()
    with _quiet("listen", work, seen, rig) as bus:
        bus.listen(LEAST_TIME_NS)
        heard = dict(bus.heard)
    config = rig.described
    assert config is not None
    masters = masters_heard(bus.heard, config.node_ids, config.own_node_id)
    syncs = heard.get((SYNC_COB_ID, False), 0)
    if syncs:
        masters.append(f"SYNC (COB-ID 0x080) {syncs} times")
    seen.add(
        passed_if(
            "other masters",
            not masters,
            ", ".join(masters) or f"none within {LEAST_TIME_NS / 1e9:g} s",
            "End the other program or controller, or unplug it.",
            where="bus",
        ),
        passed_if(
            "error frames",
            not bus.errors_heard,
            f"{bus.errors_heard}",
            "Bit rate, termination, cable.",
            where="bus",
        ),
    )
    beats = {
        cob - HEARTBEAT_BASE for cob, _ in heard if 0 < cob - HEARTBEAT_BASE <= HIGHEST_NODE_ID
    }
    strangers = sorted(beats - set(config.node_ids))
    text = f"of nodes {', '.join(map(str, sorted(beats))) or 'nobody'}"
    seen.add(
        passed_if(
            "heartbeats",
            not strangers,
            text,
            f"Nodes {strangers} are not described.",
            where="bus",
            otherwise=Severity.WARNS,
        )
    )


# --- read by SDO


def read(work: Work, seen: Seen) -> None:
    """Ask every node who it is and how it is set; nothing is written."""
    rig = work.rig()
    config = rig.described
    with _quiet("read", work, seen, rig) as bus:
        assert config is not None
        for node_id, profiles in _profiles(config).items():
            group = f"node {node_id}"
            try:
                node = read_node(bus, node_id)
            except DriverError as error:
                seen.add(
                    Finding(
                        "answers",
                        Severity.BLOCKS,
                        str(error),
                        "Supply, cable, node-ID, bit rate.",
                        where=group,
                    )
                )
                continue
            seen.devices[group] = {key: str(value) for key, value in asdict(node.identity).items()}
            seen.add(_identity(node, profiles))
            if node_id == config.drive.node_id:
                seen.add(*_drive(node, config))
            seen.add(*_objects(RemoteDevice(bus, node_id), config, node))


def _profiles(config: CanRigConfig) -> dict[int, frozenset[int]]:
    """The device profiles that each described node may have; 0: any, of a coupler."""
    found: dict[int, frozenset[int]] = {}
    for counter in config.counters:
        known = counter.position.key == POSITION.key
        found[counter.node_id] = frozenset({406}) if known else frozenset()
    for module in config.modules:
        found[module.node_id] = found.get(module.node_id, frozenset()) | {401}
    analog = isinstance(config.drive, ReferenceConfig)
    return {config.drive.node_id: frozenset({401 if analog else 402})} | found


def _identity(node: FoundNode, profiles: frozenset[int]) -> Finding:
    one = node.identity
    text = (
        f"{one.name or 'no name'}, profile {one.profile}, vendor 0x{one.vendor_id:08X}, product "
        f"0x{one.product_code:08X}, serial number {one.serial_number or 'not told'}"
    )
    return passed_if(
        "identity",
        not profiles or one.profile in profiles,
        text,
        "This is another kind of node than the description says: look at its node-ID.",
        where=f"node {node.node_id}",
        allowed=" or ".join(f"profile {one}" for one in sorted(profiles)),
    )


def _drive(node: FoundNode, config: CanRigConfig) -> Iterable[Finding]:
    """What a drive states of its numbers, against what is described."""
    where = f"node {node.node_id}"
    encoder, stated = config.motor_encoder, node.statement.encoder
    if stated is not None and stated[1]:
        counts, described = stated[0] / stated[1], encoder.lines * encoder.multiplication
        own = getattr(config.drive, "counts_per_revolution", 0.0)
        yield passed_if(
            "counts per revolution",
            abs(counts - (own or described)) < 0.5,
            f"{counts:g} by the drive (0x608F), {described} described",
            "`lines` and `multiplication` of [motor_encoder]; what stands on a nameplate may be either.",
            where=where,
        )
    torque, motor = node.statement.rated_torque, getattr(config.drive, "motor_torque", None)
    said = getattr(config.drive, "rated_torque", None) or motor
    if torque and said:
        factor = 1e-3 * torque / said
        yield passed_if(
            "rated torque",
            1.0 / TORQUE_FACTOR < factor < TORQUE_FACTOR,
            f"{1e-3 * torque:g} N m by the drive (0x6076), {said:g} N m described",
            "`rated_torque_n_m` of [drive], and the motor that [rig] names.",
            where=where,
        )


def _objects(device: RemoteDevice, config: CanRigConfig, node: FoundNode) -> Iterable[Finding]:
    """Every object that the description names of a node is there, and says something that can be."""
    where = f"node {node.node_id}"
    for counter in config.counters:
        if counter.node_id != node.node_id:
            continue
        yield _readable(device, counter.position, where)
        described = counter.lines * counter.multiplication
        if node.counts_per_revolution:
            yield passed_if(
                "counts per revolution",
                node.counts_per_revolution == described,
                f"{node.counts_per_revolution} by the counter (0x6001), {described} described",
                "`lines` and `multiplication` of this [[counter]].",
                where=where,
            )
    for module in config.modules:
        if module.node_id != node.node_id:
            continue
        for analog in module.inputs:
            yield _readable(device, analog.source, where)
            if analog.unit == "degC":
                yield _temperature(
                    device,
                    analog.channel,
                    analog.source,
                    analog.unit_per_volt * analog.volts_per_count,
                    where,
                )
    if config.guard is not None and config.guard.node_id == node.node_id:
        yield _readable(device, config.guard.entry, where)


def _readable(device: RemoteDevice, entry: ObjectRef, where: str) -> Finding:
    try:
        value = device.read(entry)
    except DriverError as error:
        return Finding(
            str(entry),
            Severity.BLOCKS,
            str(error),
            "Index, sub-index and type of this object.",
            where=where,
        )
    return Finding(str(entry), Severity.PASSED, f"reads {value:g}", where=where)


def _temperature(
    device: RemoteDevice, name: str, entry: ObjectRef, per_count: float, where: str
) -> Finding:
    low, high = ROOM_TEMPERATURES
    try:
        value = float(device.read(entry)) * per_count
    except DriverError as error:
        return Finding(name, Severity.BLOCKS, str(error), where=where)
    return passed_if(
        name.replace("_", " "),
        low <= value <= high,
        f"{value:.1f} degC",
        "Is a sensor connected to this input, and is its scale right?",
        where=where,
        allowed=f"{low:g} to {high:g} degC",
    )


# --- by hand


@dataclass(frozen=True)
class _Counted:
    """A position that is read by SDO: which object, how many counts a turn, where it wraps, which way it counts."""

    device: RemoteDevice
    entry: ObjectRef
    per_turn: float
    modulus: int
    direction: int


@dataclass
class _Turned:
    """How far a shaft was turned since it was looked at first, by its counts."""

    counted: _Counted
    last: int = 0
    counts: int = 0

    def look(self) -> None:
        """Read it once more; it may have wrapped, but not turned half its range since the last look."""
        now = int(self.counted.device.read(self.counted.entry))
        half = self.counted.modulus // 2
        self.counts += (now - self.last + half) % self.counted.modulus - half
        self.last = now

    def begin(self) -> None:
        """From here on."""
        self.last, self.counts = int(self.counted.device.read(self.counted.entry)), 0

    @property
    def turns(self) -> float:
        """Turns, positive as its direction says."""
        return self.counted.direction * self.counts / self.counted.per_turn


def hand(work: Work, seen: Seen) -> None:
    """Emergency stop, the shaft turned by hand, the guard: read by SDO alone."""
    rig = work.rig()
    with _quiet("hand", work, seen, rig) as bus:
        config = rig.described
        assert config is not None
        text = (
            "Press the emergency stop and leave it pressed; the gear is coupled, the guard closed."
        )
        work.consents(seen, rig, "press-emergency-stop", text, "it is pressed")
        _cut_off(work, seen, rig, bus, config)
        if not seen.is_fine:
            return
        shafts = _shafts(bus, config)
        for shaft in shafts.values():
            shaft.begin()
        said = _turn(work, seen, rig, shafts)
        if not work.stop.level:
            seen.add(*_turned(work, said, shafts))
            _guard(work, seen, rig, bus, config)


def _cut_off(
    work: Work, seen: Seen, rig: AssembledRig, bus: ListeningBus, config: CanRigConfig
) -> None:
    """The drive tells that it has no voltage; else somebody says how it was cut off."""
    text = "the amplifier tells nothing of it"
    if not isinstance(config.drive, ReferenceConfig):
        word = int(RemoteDevice(bus, config.drive.node_id).read(obj.STATUSWORD))
        if not word & _VOLTAGE_BIT:
            told = f"statusword 0x{word:04X}: no voltage at the power stage"
            seen.add(Finding("emergency stop", Severity.PASSED, told, where="drive"))
            return
        text = f"statusword 0x{word:04X}: the power stage has its voltage"
    question = (
        "How is the motor cut off by the emergency stop (contactor, safe torque off)? Type it."
    )
    how = work.answer(rig, "how-cut-off", f"{text}. {question}")
    seen.answers["how-cut-off"] = how
    is_simulated = rig.person is not None
    seen.add(
        passed_if(
            "emergency stop",
            bool(how) or is_simulated,
            f"{text}; {how or 'simulated'}",
            "Say how, or look whether it is wired at all.",
            where="drive",
            otherwise=Severity.BLOCKS,
        )
    )


def _shafts(bus: ListeningBus, config: CanRigConfig) -> Mapping[str, _Turned]:
    """Both angles, where a node of the bus has them."""
    found: dict[str, _Turned] = {}
    if not isinstance(config.drive, ReferenceConfig):
        encoder = config.motor_encoder
        own = getattr(config.drive, "counts_per_revolution", 0.0)
        device = RemoteDevice(bus, config.drive.node_id)
        counted = _Counted(
            device,
            obj.POSITION,
            own or encoder.lines * encoder.multiplication,
            encoder.modulus,
            encoder.direction,
        )
        found[names.INPUT_ANGLE] = _Turned(counted)
    for counter in config.counters:
        found[counter.channel] = _Turned(_counter(bus, counter))
    return found


def _counter(bus: ListeningBus, counter: CounterConfig) -> _Counted:
    device = RemoteDevice(bus, counter.node_id)
    told = counter.modulus or int(device.read_optional(TOTAL_RANGE) or 0)
    size = told or 1 << 8 * counter.position.value_type.size
    per_turn = counter.lines * counter.multiplication
    return _Counted(device, counter.position, per_turn, size, counter.direction)


def _turn(work: Work, seen: Seen, rig: AssembledRig, shafts: Mapping[str, _Turned]) -> float:
    """Let somebody turn the shaft, and look meanwhile; how many turns that person counted."""
    text = (
        f"Turn the input shaft by hand by at least {LEAST_TURNS:.0f} whole turns, all in one sense "
        "(a mark on the shaft helps), then type how many it were:"
    )

    def look() -> None:
        for shaft in shafts.values():
            shaft.look()

    answer = work.answer(rig, "turn-shaft", text, meanwhile=look)
    look()
    seen.answers["turn-shaft"] = answer
    try:
        return abs(float(answer.replace(",", ".")))
    except ValueError:
        return 0.0


def _turned(work: Work, said: float, shafts: Mapping[str, _Turned]) -> Iterable[Finding]:
    """What both encoders counted, against what the hand did and what is described."""
    inner, outer = shafts.get(names.INPUT_ANGLE), shafts.get(names.OUTPUT_ANGLE)
    if said < LEAST_TURNS:
        text = f"{said:g} turns"
        remedy = f"Turn further: at least {LEAST_TURNS:g} turns, and type their number."
        yield Finding("turns by hand", Severity.BLOCKS, text, remedy, where="hand")
        return
    if inner is not None:
        yield passed_if(
            "input encoder",
            abs(abs(inner.turns) - said) <= _MISCOUNT + 0.02 * said,
            f"{inner.turns:+.3f} turns counted, {said:g} by hand",
            "`lines` and `multiplication` of the motor encoder do not fit; or the shaft was turned back and forth.",
            where="hand",
            allowed=f"{said:g} +- {_MISCOUNT + 0.02 * said:.2g}",
        )
    if outer is None or inner is None:
        yield Finding(
            "output encoder", Severity.NOT_LOOKED_AT, "it is no node of this bus", where="hand"
        )
        return
    yield from _sense_and_ratio(work, inner, outer)


def _sense_and_ratio(work: Work, inner: _Turned, outer: _Turned) -> Iterable[Finding]:
    gear, mounting = nameplates(work.order)[0], work.order.mounting
    expected = gear.mounted_ratio(mounting)
    text = f"{outer.turns:+.5f} turns at the output for {inner.turns:+.3f} at the input, {mounting}"
    if abs(outer.counts) < 8:
        remedy = "Is the output encoder coupled, and its signal there?"
        yield Finding(
            "output encoder", Severity.BLOCKS, f"{text}: it does not move", remedy, where="hand"
        )
        return
    yield passed_if(
        "sense of the output",
        outer.turns * inner.turns * output_sign(mounting) > 0.0,
        text,
        "Turn `direction` of the output counter; check --mounting: it sets the sense in which the output turns.",
        where="hand",
    )
    ratio = abs(inner.turns / outer.turns)
    wind_up = gear.ratings.running_torque * gear.ratio / torsion_stiffness(gear)
    unsure = 2.0 / outer.counted.per_turn + (kinematic_error_margin(gear) + wind_up) / REVOLUTION
    doubt = ratio * unsure / abs(outer.turns)
    yield passed_if(
        "ratio",
        abs(ratio - expected) <= doubt,
        f"{ratio:.3f} +- {doubt:.3f}, described as {expected:g}",
        "Check ratio and mounting, and lines x multiplication of both encoders.",
        where="hand",
        allowed=f"{expected:g} +- {doubt:.3f}",
    )


_CONTACT = {True: "closed", False: "open"}
"""How a guard is, by whether it is closed."""


def _guard(
    work: Work, seen: Seen, rig: AssembledRig, bus: ListeningBus, config: CanRigConfig
) -> None:
    """The guard's contact, open and closed."""
    guard = config.guard
    if guard is None:
        text = "no guard input is configured: nobody looks whether the guard is closed"
        seen.add(Finding("guard", Severity.WARNS, text, "Describe it as [guard].", where="guard"))
        return
    device = RemoteDevice(bus, guard.node_id)
    for key, wanted in (("open-guard", False), ("close-guard", True)):
        word = _CONTACT[wanted]
        work.consents(
            seen, rig, key, f"{key.split('-')[0].capitalize()} the guard.", f"it is {word}"
        )
        value = device.read_integer(guard.entry)
        is_closed = value & guard.mask == guard.closed
        seen.add(
            passed_if(
                f"guard, {word}",
                is_closed is wanted,
                f"input 0x{value:X} reads as {_CONTACT[is_closed]}",
                "`mask` and `closed` of [guard], or its contact: it must open when the guard does.",
                where="guard",
            )
        )
