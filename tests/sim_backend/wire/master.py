"""canopen as an independent master of the simulated slaves, in one thread: what it sends is
answered before `send` returns.
"""

from __future__ import annotations

import io
from typing import Any

import canopen

from sim_backend.wire.eds import electronic_data_sheet
from sim_backend.wire.slave import Slave
from tests.sim_backend.wire.slaves import MS, Sent, analog, counter, drive, sync

MAKERS = {"drive": drive, "counter": counter, "analog": analog}


class Master(canopen.Network):
    """A network without a bus: frames go to the slave, and what the slave sends goes to canopen's subscribers."""

    def __init__(self, slave: Slave, sent: Sent) -> None:
        super().__init__()
        self.slave, self.sent, self.now_ns = slave, sent, 0
        self.frames: list[tuple[int, bytes]] = []
        text = electronic_data_sheet(
            slave.dictionary, product="simulated", vendor="nobody", vendor_number=0
        )
        self.remote = canopen.RemoteNode(slave.node_id, canopen.import_od(eds(text), slave.node_id))
        self.add_node(self.remote)

    def send_message(self, can_id: int, data: Any, remote: bool = False) -> None:
        if not remote:
            self.slave.receive(can_id, bytes(data), self.now_ns)
        self.hand_on()

    def hand_on(self) -> list[tuple[int, bytes]]:
        """Let canopen hear what the slave has sent."""
        frames = self.sent.taken()
        self.frames += frames
        for cob_id, data in frames:
            self.notify(cob_id, bytearray(data), self.now_ns * 1e-9)
        return frames

    def sync_once(self) -> list[tuple[int, bytes]]:
        """One SYNC; the process data that came of it."""
        sync(self.slave)
        return self.hand_on()

    def pass_time(self, milliseconds: int) -> list[tuple[int, bytes]]:
        """Let time pass; what the slave has sent meanwhile."""
        end, heard = self.now_ns + milliseconds * MS, []
        while self.now_ns < end:
            self.now_ns += MS
            self.slave.tick(self.now_ns)
            heard += self.hand_on()
        return heard


def eds(text: str) -> io.StringIO:
    """The text of an EDS as a file that canopen knows by its name."""
    file = io.StringIO(text)
    file.name = "simulated.eds"
    return file


def master(name: str) -> Master:
    """A master and its slave, freshly booted."""
    slave, sent = MAKERS[name]()
    return Master(slave, sent)


def abort_of(action: Any) -> int:
    """The abort code with which an action is refused, 0 if it is not."""
    try:
        action()
    except canopen.SdoAbortedError as refused:
        return refused.code
    return 0
