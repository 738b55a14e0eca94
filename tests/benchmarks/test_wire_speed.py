"""How much the wire costs: decoding the process data of three nodes and reading objects by SDO
against canopen's own, and `sim` against `wire`.
"""

from __future__ import annotations

import time
from typing import Any

import canopen
import numpy as np
import pytest
from canopen.objectdictionary import ObjectDictionary, ODRecord, ODVariable
from canopen.pdo.base import PdoMap

from drivers.bus.columns import ColumnDecoder
from drivers.bus.cyclic import CanRig
from drivers.bus.frames import CycleStore
from drivers.bus.network import PumpedBus
from drivers.bus.sdo import SdoClient
from drivers.clock import VirtualClock
from drivers.port import Command, DriveLimits, Guard, Mode
from drivers.python_can import can
from rig.bench.backends.assembly import AssembledRig
from rig.bench.backends.order import Order
from rig.bench.backends.registry import make_port
from rig.trial.doctor.second_client import SecondClient
from tests.benchmarks.conftest import Note

CYCLES = 1000
"""Cycles of one block."""
BLOCKS = 5
SPEED = 106.0
"""rad/s at the input."""
LIMITS = DriveLimits(1.0, 300.0, 1000.0, 1000.0, 2000.0)
Frames = list[list[bytes]]


def bench(name: str) -> AssembledRig:
    """An opened simulated rig."""
    made = make_port(Order(protocol="benchmark", serial="SPEED", backend=name))
    made.port.open()
    made.port.write_limits(LIMITS)
    return made


@pytest.fixture(scope="module")
def rig() -> Any:
    made = bench("wire").port
    yield made
    made.close()


@pytest.fixture(scope="module")
def frames(rig: CanRig) -> Frames:
    """Process data of three nodes in motion, as they came over the bus: per cycle, per slot."""
    store, kept = CycleStore(rig.nodes.layout), []
    bus = rig.segment._live_bus()
    taken = [bus._handlers[pdo.cob_id] for pdo in rig.nodes.layout.pdos]
    row = [b""] * len(taken)

    def tap(slot: int) -> Any:
        def take(data: bytes, stamp_ns: int) -> None:
            row[slot] = data
            taken[slot](data, stamp_ns)
            if all(row):
                kept.append(list(row))
                row[:] = [b""] * len(taken)

        return take

    for slot, pdo in enumerate(store.layout.pdos):
        bus.subscribe(pdo.cob_id, tap(slot))
    rig.exchange(Command(Mode.SPEED, np.full(CYCLES, SPEED)), CYCLES, Guard())
    for handler, pdo in zip(taken, store.layout.pdos, strict=True):
        bus.subscribe(pdo.cob_id, handler)
    assert len(kept) == CYCLES
    return kept


def pair(rig: CanRig, frames: Frames) -> tuple[CycleStore, np.ndarray, np.ndarray]:
    """The drivers' own way: raw frames into the store cycle by cycle, then the whole block at once."""
    layout, none = rig.nodes.layout, np.zeros(len(frames), dtype=np.int64)
    store = CycleStore(layout)
    decoder = ColumnDecoder(layout, rig.nodes.columns, rig.nodes.validities)
    store.begin_block(len(frames))
    for row in frames:
        store.begin_cycle(False)
        for slot, data in enumerate(row):
            store.put(slot, data, 1)
        store.end_cycle()
    raw, bad = store.decoded()
    flags = store.flags()
    counts = decoder.block(raw, bad, flags, none, none, store.absent())
    return store, raw, counts


class Peer:
    """canopen's remote nodes with the same process data mapped; every variable read by its `.raw`."""

    def __init__(self, rig: CanRig) -> None:
        self.maps: list[Any] = []
        for pdo in rig.nodes.layout.pdos:
            dictionary = ObjectDictionary()
            for entry in pdo.entries:
                if dictionary.get(entry.index) is None:
                    dictionary.add_object(ODRecord(f"object {entry.index:04X}", entry.index))
                variable = ODVariable(str(entry), entry.index, entry.subindex)
                variable.data_type = entry.data_type.code
                record: Any = dictionary[entry.index]
                record.add_member(variable)
            node = canopen.RemoteNode(pdo.node_id, dictionary)
            mapped = node.tpdo[1] if 1 in node.tpdo else PdoMap(node.tpdo, None, None)
            mapped.cob_id = pdo.cob_id
            for entry in pdo.entries:
                mapped.add_variable(entry.index, entry.subindex)
            self.maps.append(mapped)

    def read(self, frames: Frames) -> list[list[int]]:
        """The values of every cycle."""
        found = []
        for row in frames:
            values = []
            for mapped, data in zip(self.maps, row, strict=True):
                mapped.on_message(mapped.cob_id, bytearray(data), 1.0)
                values += [variable.raw for variable in mapped.map]
            found.append(values)
        return found


def test_decoding_a_cycle_of_three_nodes(
    rig: CanRig, frames: Frames, benchmark: Any, note: Note
) -> None:
    """Microseconds per cycle from the frames to counts that do not jump; canopen's to the bare values."""
    layout, peer = rig.nodes.layout, Peer(rig)
    variables = [(slot, entry) for slot, pdo in enumerate(layout.pdos) for entry in pdo.entries]
    _, raw, _ = pair(rig, frames)
    theirs = np.array(peer.read(frames))
    for column, field in enumerate(layout.fields):
        key = [
            i
            for i, (slot, e) in enumerate(variables)
            if slot == field.slot and layout.pdos[slot].offset_of(e.key) == field.offset
        ]
        assert np.array_equal(theirs[:, key[0]], raw[:, column]), field.name
    benchmark.pedantic(pair, (rig, frames), rounds=15, warmup_rounds=2)
    ours = float(benchmark.stats.stats.min) / CYCLES * 1e6
    foreign = min(_seconds(peer.read, frames) for _ in range(7)) / CYCLES * 1e6
    nodes = len({pdo.node_id for pdo in layout.pdos})
    what = f"{nodes} nodes, {len(layout.pdos)} frames, {len(variables)} values"
    note(f"decoding a cycle ({what}), paired, unwrapped, checked", ours, "us", "")
    note("the same by canopen's PDO variables, values only", foreign, "us", "")
    note("canopen's over ours", foreign / ours, "x", ">= 9")


READS = 300
NAME = b"servo amplifier"


class Prompt:
    """A node that answers at once and costs next to nothing: 0x6041 expedited, 0x1008 in segments."""

    def __init__(self) -> None:
        head = bytes.fromhex("41081000") + len(NAME).to_bytes(4, "little")
        self._answers = {
            bytes.fromhex("40416000"): message(bytes.fromhex("4B41600037020000")),
            bytes.fromhex("40081000"): message(head),
        }
        self._segments = [message(bytes([0x00 | t << 4]) + NAME[7 * t : 7 * t + 7]) for t in (0, 1)]
        self._segments.append(message(bytes([0x0D]) + NAME[14:] + bytes(6)))
        self._next: can.Message | None = None
        self._turn = 0

    def send(self, msg: can.Message) -> None:
        key = bytes(msg.data[:4])
        if key in self._answers:
            self._next, self._turn = self._answers[key], 0
        else:
            self._next, self._turn = self._segments[self._turn], self._turn + 1

    def recv(self, timeout: float | None = None) -> can.Message | None:
        answer, self._next = self._next, None
        return answer

    def shutdown(self) -> None:
        return


def message(data: bytes) -> can.Message:
    return can.Message(arbitration_id=0x581, data=data, is_extended_id=False)


@pytest.mark.parametrize(("index", "what"), [(0x6041, "expedited"), (0x1008, "3 segments")])
def test_reading_an_object_by_sdo(note: Note, index: int, what: str) -> None:
    """Microseconds per object over the pumped bus, the device's time left out; by turns, the best of fifteen."""
    bus, clients = PumpedBus(Prompt(), VirtualClock()), (SdoClient, SecondClient)
    best, answers = dict.fromkeys(clients, np.inf), set[bytes]()

    def read(client: SdoClient) -> None:
        for _ in range(READS):
            answers.add(client.upload(index, 0))

    for make in clients * 15:
        best[make] = min(best[make], _seconds(read, make(bus, 1)))
    assert answers == {NAME if index == 0x1008 else b"\x37\x02"}
    ours, foreign = (best[make] / READS * 1e6 for make in clients)
    note(f"reading an object by SDO ({what})", ours, "us", "")
    note(f"the same by canopen's client ({what})", foreign, "us", "")
    note(f"canopen's over ours ({what})", foreign / ours, "x", "")


def _seconds(work: Any, *arguments: Any) -> float:
    start = time.perf_counter()
    work(*arguments)
    return time.perf_counter() - start


def test_sim_against_wire(note: Note) -> None:
    """Rig-seconds per second of the port alone, in motion, in blocks of 1000 cycles at 1 kHz; by
    turns, the best of five.
    """
    best = {"sim": np.inf, "wire": np.inf}
    ports = {name: bench(name).port for name in best}
    command, counts = Command(Mode.SPEED, np.full(CYCLES, SPEED)), {}
    try:
        for name, port in ports.items():
            counts[name] = port.exchange(command, CYCLES, Guard()).counts
        # The same run on both: what is compared is what it costs, not what it does.
        assert np.array_equal(counts["sim"], counts["wire"])
        for _ in range(BLOCKS):
            for name, port in ports.items():
                best[name] = min(best[name], _seconds(port.exchange, command, CYCLES, Guard()))
    finally:
        for port in ports.values():
            port.close()
    speed = {name: CYCLES * 1e-3 / seconds for name, seconds in best.items()}
    note("sim, the port alone at 1 kHz", speed["sim"], "x real time", "")
    note("wire, the port alone at 1 kHz", speed["wire"], "x real time", "")
    note("sim over wire", speed["sim"] / speed["wire"], "x", "")
    assert speed["wire"] > 1.0
