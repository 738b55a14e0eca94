"""An independent CANopen stack as the other side: canopen's LocalNode serves SDO, a small CiA 402
drive sits on top of it.

Nothing of the drivers is used here but the clock. The peer runs in the same thread: `pump` hands it
the frames that wait for it.
"""

from __future__ import annotations

import io
import struct

import canopen
from canopen.objectdictionary import eds

from drivers.clock import VirtualClock
from drivers.python_can import can

RPDO_DEFAULT, TPDO_DEFAULT = 0x40000200, 0x40000180


def entry(
    index: int,
    sub: int | None,
    name: str,
    kind: int,
    access: str = "rw",
    default: str = "",
    mappable: int = 0,
) -> str:
    head = f"[{index:04X}]" if sub is None else f"[{index:04X}sub{sub:X}]"
    lines = [
        head,
        f"ParameterName={name}",
        "ObjectType=0x7",
        f"DataType=0x{kind:04X}",
        f"AccessType={access}",
        f"PDOMapping={mappable}",
    ]
    return "\n".join([*lines, f"DefaultValue={default}", ""])


def record(index: int, name: str, rows: list[tuple[str, int, str, str]]) -> str:
    head = f"[{index:04X}]\nParameterName={name}\nObjectType=0x9\nSubNumber={len(rows) + 1}\n"
    subs = [entry(index, 0, "count", 5, "rw", str(len(rows)))]
    subs += [
        entry(index, i, n, kind, access, default)
        for i, (n, kind, access, default) in enumerate(rows, 1)
    ]
    return head + "\n".join(subs) + "\n"


def communication(device_type: int, pdos: int = 4, entries: int = 4) -> str:
    text = "[FileInfo]\nFileName=peer.eds\n[DeviceInfo]\nVendorName=Elsewhere\nVendorNumber=0x123\nProductName=Peer\n"
    text += entry(0x1000, None, "device type", 7, "ro", hex(device_type)) + entry(
        0x1001, None, "error register", 5, "ro", "0"
    )
    text += entry(0x1005, None, "COB-ID SYNC", 7, "rw", "0x80") + entry(
        0x1006, None, "cycle period", 7, "rw", "0"
    )
    text += entry(0x1008, None, "name", 9, "const", "Peer drive with a long name")
    text += entry(0x1014, None, "COB-ID EMCY", 7, "rw", "$NODEID+0x80")
    text += record(0x1016, "consumer heartbeat", [("entry", 7, "rw", "0")])
    text += entry(0x1017, None, "producer heartbeat", 6, "rw", "0")
    text += record(
        0x1018,
        "identity",
        [
            ("vendor", 7, "ro", "0x123"),
            ("product", 7, "ro", "7"),
            ("rev", 7, "ro", "1"),
            ("serial", 7, "ro", "42"),
        ],
    )
    for n in range(pdos):
        off = 0x100 * n
        text += record(
            0x1400 + n,
            "RPDO",
            [("cob", 7, "rw", f"$NODEID+0x{RPDO_DEFAULT + off:X}"), ("type", 5, "rw", "0xFF")],
        )
        text += record(
            0x1600 + n, "RPDO map", [(f"e{i}", 7, "rw", "0") for i in range(1, entries + 1)]
        )
        text += record(
            0x1800 + n,
            "TPDO",
            [
                ("cob", 7, "rw", f"$NODEID+0x{TPDO_DEFAULT + off:X}"),
                ("type", 5, "rw", "0xFE"),
                ("inhibit", 6, "rw", "0"),
            ],
        )
        text += record(
            0x1A00 + n, "TPDO map", [(f"e{i}", 7, "rw", "0") for i in range(1, entries + 1)]
        )
    return text


def drive_eds(
    *,
    torque: bool = True,
    limits: bool = True,
    entries: int = 4,
    modes: int = 0x30D,
    probe: bool = False,
) -> str:
    text = communication(0x00020192, entries=entries)
    for index, name, kind, default in (
        (0x6007, "abort option", 3, "1"),
        (0x603F, "error code", 6, "0"),
        (0x6040, "controlword", 6, "0"),
        (0x6041, "statusword", 6, "0x0250"),
        (0x605A, "quick stop option", 3, "2"),
        (0x605E, "fault reaction", 3, "2"),
        (0x6060, "mode", 2, "0"),
        (0x6061, "mode display", 2, "0"),
        (0x6064, "position", 4, "0"),
        (0x606C, "velocity", 4, "0"),
        (0x60A9, "velocity unit", 7, "0x00B44700"),
        (0x60AA, "acc unit", 7, "0x00C00300"),
        (0x60FF, "target velocity", 4, "0"),
        (0x6502, "modes", 7, hex(modes)),
    ):
        text += entry(index, None, name=name, kind=kind, access="rw", default=default, mappable=1)
    if torque:
        for index, name, kind, default in (
            (0x6071, "target torque", 3, "0"),
            (0x6076, "rated", 7, "637"),
            (0x6077, "torque", 3, "0"),
        ):
            text += entry(
                index, None, name=name, kind=kind, access="rw", default=default, mappable=1
            )
    if probe:
        for index, name, kind in (
            (0x60B8, "touch probe", 6),
            (0x60B9, "touch probe status", 6),
            (0x60BA, "touch probe position", 4),
        ):
            text += entry(index, None, name=name, kind=kind, access="rw", default="0", mappable=1)
    if limits:
        for index, name, kind in (
            (0x6072, "max torque", 6),
            (0x6080, "max speed", 7),
            (0x6083, "acc", 7),
            (0x6084, "dec", 7),
            (0x6085, "qs", 7),
        ):
            text += entry(index, None, name, kind, "rw", "100")
    return text


class Peer:
    """A LocalNode of canopen on python-can's virtual bus, TPDOs on SYNC and NMT gating added by hand."""

    def __init__(self, channel: str, node_id: int, eds_text: str, clock: VirtualClock) -> None:
        self.clock, self.heartbeat_due_ns = clock, 0
        self.bus = can.Bus(interface="virtual", channel=channel, preserve_timestamps=True)
        self.network = canopen.Network(self.bus)
        dictionary = eds.import_eds(io.StringIO(eds_text), node_id)
        self.node = canopen.LocalNode(node_id, dictionary)
        self.network.add_node(self.node)
        # canopen's own heartbeat is a thread in wall time; this one beats by the clock that was handed in.
        self.node.nmt.start_heartbeat = lambda period: None  # type: ignore[method-assign]
        self.node_id = node_id
        self.stamp = 0.0
        self.syncs = 0
        self.pending: dict[int, bytes] = {}
        self.silent_at: set[int] = set()
        self.double_at: set[int] = set()
        self.short_at: set[int] = set()
        self.late_at: set[int] = set()
        self.held: list[can.Message] = []
        self.answers = True

    def get(self, index: int, sub: int = 0) -> int:
        return int.from_bytes(self.node.get_data(index, sub), "little")

    def put(self, index: int, value: int, size: int, sub: int = 0) -> None:
        self.node.data_store.setdefault(index, {})[sub] = (value & (1 << 8 * size) - 1).to_bytes(
            size, "little"
        )

    def pump(self, deadline_ns: int) -> None:
        while (message := self.bus.recv(0)) is not None:
            if not self.answers:
                continue
            if message.arbitration_id == 0x080:
                self.stamp = message.timestamp
                self.on_sync()
            elif message.arbitration_id in self.rpdos():
                self.pending[message.arbitration_id] = bytes(message.data)
            elif message.arbitration_id >= 0x580 and self.node.nmt.state == "STOPPED":
                continue
            else:
                self.network.notify(message.arbitration_id, message.data, message.timestamp)
                self.after_message()

        self.send_heartbeat()

    def send_heartbeat(self) -> None:
        period = self.get(0x1017) * 1_000_000
        if self.answers and period and self.clock.monotonic_ns() >= self.heartbeat_due_ns:
            self.heartbeat_due_ns = self.clock.monotonic_ns() + period
            state = {"OPERATIONAL": 5, "STOPPED": 4}.get(self.node.nmt.state, 0x7F)
            self.bus.send(
                can.Message(arbitration_id=0x700 + self.node_id, data=[state], is_extended_id=False)
            )

    def after_message(self) -> None:
        return

    def mapping(self, base: int, number: int) -> list[tuple[int, int, int]]:
        words = [self.get(base + number, i) for i in range(1, self.get(base + number, 0) + 1)]
        return [(w >> 16, w >> 8 & 0xFF, (w & 0xFF) // 8) for w in words]

    def rpdos(self) -> dict[int, int]:
        cobs = {self.get(0x1400 + n, 1): n for n in range(4)}
        return {c & 0x7FF: n for c, n in cobs.items() if not c >> 31}

    def on_sync(self) -> None:
        for cob, n in self.rpdos().items():
            data = self.pending.pop(cob, None)
            at = 0
            for index, sub, size in self.mapping(0x1600, n) if data is not None else []:
                self.put(index, int.from_bytes(data[at : at + size], "little"), size, sub)
                at += size
        self.step()
        for message in self.held:
            self.bus.send(message)
        self.held.clear()
        k, self.syncs = self.syncs, self.syncs + 1
        if self.node.nmt.state != "OPERATIONAL" or k in self.silent_at:
            return
        for n in range(4):
            cob = self.get(0x1800 + n, 1)
            if cob >> 31 or self.get(0x1800 + n, 2) != 1 or not self.get(0x1A00 + n, 0):
                continue
            data = b"".join(
                self.node.get_data(i, s)[:size] for i, s, size in self.mapping(0x1A00, n)
            )
            data = data[:-1] if k in self.short_at else data
            message = can.Message(
                arbitration_id=cob & 0x7FF, data=data, is_extended_id=False, timestamp=self.stamp
            )
            if k in self.late_at:
                self.held.append(message)
                continue
            for _ in range(2 if k in self.double_at else 1):
                self.bus.send(message)

    def step(self) -> None:
        return

    def emergency(self, code: int) -> None:
        self.bus.send(
            can.Message(
                arbitration_id=0x80 + self.node_id,
                data=struct.pack("<HB5x", code, 1),
                is_extended_id=False,
            )
        )

    def close(self) -> None:
        self.bus.shutdown()


class DrivePeer(Peer):
    """The CiA 402 state machine, as the standard's figure has it, over the peer's dictionary."""

    STATES = {
        "SOD": 0x0250,
        "READY": 0x0231,
        "ON": 0x0233,
        "ENABLED": 0x0237,
        "QUICK": 0x0217,
        "FAULT": 0x0218,
    }

    def __init__(
        self,
        channel: str,
        clock: VirtualClock,
        eds_text: str = "",
        *,
        state: str = "SOD",
        position: int = 0,
    ) -> None:
        super().__init__(channel, 1, eds_text or drive_eds(), clock)
        self.state, self.word, self.position, self.cause_persists = state, 0, position, False
        self.word = {"READY": 0x06, "ON": 0x07, "ENABLED": 0x0F, "QUICK": 0x02}.get(state, 0)
        self.put(0x6040, self.word, 2)
        self.publish()

    def publish(self) -> None:
        self.put(0x6041, self.STATES[self.state], 2)
        self.put(0x6061, self.get(0x6060), 1)

    def after_message(self) -> None:
        self.machine()

    def machine(self) -> None:
        word, before = self.get(0x6040), self.word
        self.word = word
        if self.state == "FAULT":
            if word & 0x80 and not before & 0x80 and not self.cause_persists:
                self.state = "SOD"
                self.put(0x603F, 0, 2)
        elif not word & 0x02:
            self.state = "SOD"
        elif not word & 0x04:
            # Quick stop option 2: ramp, then switch-on disabled; one that was set before stands until it is released.
            self.state = "QUICK" if self.state == "QUICK" else "SOD"
        elif self.state == "SOD":
            self.state = "READY" if word & 0x07 == 0x06 else "SOD"
        elif word & 0x0F == 0x06:
            self.state = "READY"
        elif word & 0x0F == 0x07:
            self.state = "ON"
        elif word & 0x0F == 0x0F and self.state in ("ON", "ENABLED"):
            self.state = "ENABLED"
        self.publish()

    def step(self) -> None:
        self.machine()
        speed = (
            struct.unpack("<i", self.node.get_data(0x60FF, 0))[0] if self.state == "ENABLED" else 0
        )
        self.position += speed
        self.put(0x6064, self.position, 4)
        self.put(0x606C, speed, 4)
        if 0x6077 in self.node.object_dictionary:
            self.put(0x6077, speed // 2, 2)

    def fail(self, code: int) -> None:
        self.state = "FAULT"
        self.put(0x603F, code, 2)
        self.publish()
        self.emergency(code)


def counter_eds() -> str:
    text = communication(0x00020196)
    for index, name, kind, default in (
        (0x6000, "operating", 6, "0"),
        (0x6001, "units", 7, "72000"),
        (0x6002, "range", 7, "720000"),
        (0x6004, "position", 7, "719990"),
        (0x6501, "steps", 7, "72000"),
        (0x6503, "alarms", 6, "0"),
    ):
        text += entry(index, None, name=name, kind=kind, access="rw", default=default, mappable=1)
    return text


class CounterPeer(Peer):
    """A CiA 406 counter that wraps at 0x6002 and turns by `speed` counts per SYNC."""

    def __init__(self, channel: str, clock: VirtualClock, *, speed: int = 7) -> None:
        super().__init__(channel, 2, counter_eds(), clock)
        self.speed = speed
        self.position = 719990

    def step(self) -> None:
        self.position = (self.position + self.speed) % 720000
        self.put(0x6004, self.position, 4)


def analog_eds() -> str:
    text = communication(0x00040191)
    text += record(
        0x6401, "analogue input 16 bit", [("in 1", 3, "rw", "100"), ("in 2", 3, "rw", "0")]
    )
    text += entry(0x6423, None, "global interrupt", 1, "rw", "0")
    return text


class Bench:
    """All peers of one rig, pumped together."""

    def __init__(self, *peers: Peer) -> None:
        self.peers = peers

    def __call__(self, deadline_ns: int) -> None:
        for peer in self.peers:
            peer.pump(deadline_ns)

    def close(self) -> None:
        for peer in self.peers:
            peer.close()
