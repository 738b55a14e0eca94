"""Every decoder of bytes from outside with messages that it accepts: CAN frames, SDO answers, lines of the readout."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from drivers.bus.cia301 import I16, U32, ObjectRef
from drivers.bus.cia401 import torque_input
from drivers.bus.device import RemoteDevice
from drivers.bus.frames import CycleStore, Field, FrameLayout
from drivers.bus.listening import listen_for_masters
from drivers.bus.network import PumpedBus
from drivers.bus.pdo import MappedPdo, map_objects, read_pdo
from drivers.bus.sdo import SdoClient
from drivers.clock import VirtualClock
from drivers.readout.nd287 import parse_line
from drivers.samples import CycleFlag
from rig.trial.doctor.second_client import SecondClient
from sim_backend.wire.hub import parse_send
from tests.drivers.foreign_drive import ForeignCounter
from tests.drivers.foreign_slave import Wire
from tests.drivers.scripted_bus import ScriptedBus
from tests.drivers.test_any_bytes import FIELDS, PDOS, decoder

Feed = Callable[[bytes], None]


@dataclass(frozen=True)
class Decoder:
    """A way in for bytes: accepted messages, and a function that takes any; it may raise our own errors alone."""

    seeds: Sequence[bytes]
    feed: Feed


class Answering(ScriptedBus):
    """A node that answers its requests with the pieces of an input, eight bytes each (the last may be shorter)."""

    def __init__(self, data: bytes) -> None:
        super().__init__()
        self._left = data

    def send(self, msg: Any) -> None:
        if msg.arbitration_id == 0x602 and msg.data[0] != 0x80:
            piece, self._left = self._left[:8], self._left[8:]
            if piece:
                self.feed(0x582, piece)


def _pdos() -> Feed:
    store, decode = CycleStore(FrameLayout(PDOS, FIELDS)), decoder()
    none = np.zeros(1, dtype=np.int64)

    def feed(data: bytes) -> None:
        # First byte: which frame; the other frames of the cycle are in order.
        slot, frame = (data[0] if data else 0) % len(PDOS), data[1:]
        store.begin_block(1)
        store.begin_cycle(False)
        for other, pdo in enumerate(PDOS):
            store.put(other, frame if other == slot else bytes(pdo.length), 1)
        flags = store.end_cycle()
        row = decode.row(store.last_record, 0, 0, flags)
        raw, bad = store.decoded()
        decode.block(raw, bad, store.flags(), none, none, store.absent())
        assert len(row) == 6
        assert bool(flags & CycleFlag.INCOMPLETE) == (len(frame) < PDOS[slot].length)

    return feed


def _analog() -> Feed:
    pdo = MappedPdo(3, True, 2, 0x283, 1, (ObjectRef(0x6401, 1, I16),))
    analog = torque_input(0.637, open_level=10.0)
    layout = FrameLayout([pdo], [Field("volts", 0, 0, I16)])
    store = CycleStore(layout)

    def feed(data: bytes) -> None:
        store.begin_block(1)
        store.begin_cycle(False)
        store.put(0, data, 1)
        store.end_cycle()
        raw, _ = store.decoded()
        assert np.isfinite(analog.as_channel().to_si(raw[:, 0])).all()
        assert analog.saturated(raw[:, 0]).shape == (1,)

    return feed


def _sdo(client: type[SdoClient], index: int) -> Feed:
    def feed(data: bytes) -> None:
        answer = client(PumpedBus(Answering(data), VirtualClock()), 2, 1_000_000).upload(index, 0)
        assert isinstance(answer, bytes)

    return feed


def _mapping(data: bytes) -> None:
    device = RemoteDevice(PumpedBus(Answering(data), VirtualClock()), 2, sdo_timeout_ns=1_000_000)
    _map(device)


def _map(device: RemoteDevice) -> None:
    read_pdo(device, 1, is_transmit=True)
    map_objects(device, [ObjectRef(0x6004, 0, U32)], is_transmit=True)


def _frame(cob_id: int) -> Feed:
    raw = ScriptedBus()
    bus = PumpedBus(raw, VirtualClock())
    bus.watch(1, 10)

    def feed(data: bytes) -> None:
        raw.feed(cob_id, data[:8])
        bus.drain()
        bus.check_heartbeats()
        assert all(event.text for event in bus.events())

    return feed


def _listening(data: bytes) -> None:
    raw = ScriptedBus()
    for at in range(0, len(data), 10):
        raw.feed(int.from_bytes(data[at : at + 2], "big") & 0x7FF, data[at + 2 : at + 10])
    listen_for_masters(
        raw, VirtualClock(), lambda until: None, node_ids=(1, 2), own_node_id=127, duration_ns=1000
    )


def _hub(data: bytes) -> None:
    frame = parse_send(data.decode("ascii", "replace"))
    assert frame is None or (0 <= frame[0] < 0x800 and len(frame[1]) <= 8)


def _readout(data: bytes) -> None:
    reading = parse_line(data)
    assert reading.is_fault or math.isfinite(reading.value)


def _shown(sign: str, number: str, unit: str, marks: str) -> bytes:
    """A line of the readout: sign, ten characters, a blank, unit, class and mode."""
    return f"{sign}{number:>10} {unit}{marks}\r\n".encode("ascii")


def mapping_answers() -> bytes:
    """What an encoder answers while its process data are read and mapped."""
    clock, answers = VirtualClock(), list[bytes]()
    wire = Wire(clock)
    ForeignCounter(wire)
    bus = PumpedBus(wire, clock, pump=wire.pump)
    device = RemoteDevice(bus, 2)
    own = bus.handler_of(0x582)
    assert own is not None
    bus.subscribe(0x582, lambda data, stamp: (answers.append(data), own(data, stamp))[1])
    _map(device)
    return b"".join(answers)


def hexes(*texts: str) -> tuple[bytes, ...]:
    return tuple(bytes.fromhex(text) for text in texts)


EXPEDITED = hexes("4B41600037020000", "4341600037020000", "4241600037020000", "8041600000000206")
SEGMENTED = hexes(
    "4108100009000000 0031323334353637 1B38390000000000",
    "4008100000000000 0031323334353637 1131323334353637 0F00000000000000",
)
READOUT = (
    _shown("-", "5.23", " ", "=A"),
    _shown("+", "12.3456", "G", "<1"),
    _shown(" ", "1.2345", "R", "=S"),
    _shown("-", "123.4506", "M", "=A"),
    _shown("+", "123.45.06", "M", "> "),
    _shown(" ", "0", "?", "?A"),
)
DECODERS: dict[str, Decoder] = {
    "process data": Decoder(
        hexes("0012345678", "01010203040200", "020102030405060708", "03FF7F"), _pdos()
    ),
    "analogue input": Decoder(hexes("0000", "FF7F", "0080", "FEFF"), _analog()),
    "SDO answer": Decoder(EXPEDITED[:3], _sdo(SdoClient, 0x6041)),
    "SDO segments": Decoder(SEGMENTED, _sdo(SdoClient, 0x1008)),
    "SDO answer, canopen's client": Decoder(EXPEDITED[:3], _sdo(SecondClient, 0x6041)),
    "SDO segments, canopen's client": Decoder(SEGMENTED, _sdo(SecondClient, 0x1008)),
    "PDO mapping": Decoder((mapping_answers(),), _mapping),
    "emergency": Decoder(hexes("3081110000000000", "0000000000000000", "1023051122334455"), _frame(0x081)),
    "heartbeat": Decoder(hexes("00", "05", "7F", "04"), _frame(0x701)),
    "readout": Decoder(READOUT, _readout),
    "listening": Decoder(hexes("0701 05", "0181 3702000000000000 0081 3081110000000000"), _listening),
    "hub's line": Decoder((b"send 201 2 0F 00", b"send 80 0"), _hub),
}  # fmt: skip
