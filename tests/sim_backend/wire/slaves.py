"""Slaves without a bus: what they send is collected."""

from __future__ import annotations

import struct

from sim_backend.wire.analog_input import AnalogInput
from sim_backend.wire.counter import Counter
from sim_backend.wire.drive import Drive, DriveDevice
from sim_backend.wire.slave import Slave
from tests.sim_backend.rigs import MOTOR

MS = 1_000_000
DEVICE = DriveDevice(
    counts_per_revolution=32768,
    rated_torque=MOTOR.rated_torque,
    peak_torque=MOTOR.peak_torque,
    maximum_speed=MOTOR.maximum_speed,
)


class Sent(list):
    """Frames that a slave has sent: (COB-ID, data)."""

    def __call__(self, cob_id: int, data: bytes) -> None:
        self.append((cob_id, data))

    def taken(self) -> list[tuple[int, bytes]]:
        frames = list(self)
        self.clear()
        return frames


def drive() -> tuple[Drive, Sent]:
    sent = Sent()
    made = Drive(1, DEVICE, sent)
    made.boot(0)
    sent.clear()
    return made, sent


def counter(total_range: int = 0) -> tuple[Counter, Sent]:
    sent = Sent()
    made = Counter(2, 72000, sent, total_range=total_range)
    made.boot(0)
    sent.clear()
    return made, sent


def analog() -> tuple[AnalogInput, Sent]:
    sent = Sent()
    made = AnalogInput(3, sent)
    made.boot(0)
    sent.clear()
    return made, sent


def start(slave: Slave, now_ns: int = 0) -> None:
    """NMT start."""
    slave.receive(0x000, bytes([0x01, slave.node_id]), now_ns)


def sync(slave: Slave, now_ns: int = 0) -> None:
    """What a SYNC does to a slave."""
    slave.hear_sync(now_ns)
    slave.latch()
    slave.apply_synchronous()
    slave.send_synchronous()


def ask(slave: Slave, sent: Sent, request: bytes) -> bytes:
    """One SDO request and its answer."""
    sent.clear()
    slave.receive(0x600 + slave.node_id, request.ljust(8, b"\0"), 0)
    answers = [data for cob_id, data in sent.taken() if cob_id == 0x580 + slave.node_id]
    assert len(answers) == 1
    return answers[0]


def read(slave: Slave, index: int, sub: int = 0) -> int:
    """An expedited upload from inside."""
    return int.from_bytes(
        slave.dictionary.upload(index, sub), "little", signed=index in (0x6064, 0x60BA)
    )


def write(slave: Slave, sent: Sent, index: int, sub: int, value: int, size: int) -> int:
    """An expedited download by frames; 0, or the abort code."""
    data = (value & (1 << 8 * size) - 1).to_bytes(size, "little")
    answer = ask(slave, sent, struct.pack("<BHB", 0x23 | (4 - size) << 2, index, sub) + data)
    assert answer[1:4] == struct.pack("<HB", index, sub)
    return 0 if answer[0] == 0x60 else int.from_bytes(answer[4:8], "little")
