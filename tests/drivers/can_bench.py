"""A rig on python-can's virtual bus for tests: simulated devices, a bus that can be unplugged, and
the drivers before it.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from drivers.bus.cia401 import AnalogModuleConfig, torque_input
from drivers.bus.cia402.config import DriveConfig
from drivers.bus.cia402.drive import ServoAmplifier
from drivers.bus.cia406 import CounterConfig
from drivers.bus.cyclic import CanRig, CanRigConfig
from drivers.bus.motor_encoder import MotorEncoder
from drivers.bus.rig_nodes import RigNodes
from drivers.clock import VirtualClock
from drivers.event import Event
from drivers.port import Command, DriveLimits, Guard, Mode
from drivers.python_can import can
from tests.drivers.canopen_peer import Bench, CounterPeer, DrivePeer, Peer, analog_eds

RPM = 2 * np.pi / 60
LIMITS = DriveLimits(0.5, 300.0, 1000.0, 1000.0, 2000.0)
CHANNELS = (f"rig-{n}" for n in itertools.count())


def servo(nodes: RigNodes) -> ServoAmplifier:
    """The CiA 402 drive of a rig that has one."""
    assert isinstance(nodes.drive, ServoAmplifier)
    return nodes.drive


class Losable:
    """The master's bus, which can be pulled out."""

    def __init__(self, channel: str) -> None:
        self.bus = can.Bus(
            interface="virtual",
            channel=channel,
            receive_own_messages=True,
            preserve_timestamps=True,
        )
        self.is_gone = False

    def send(self, msg: can.Message) -> None:
        if self.is_gone:
            raise can.CanOperationError("unplugged")
        self.bus.send(msg)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if self.is_gone:
            raise can.CanOperationError("unplugged")
        return self.bus.recv(timeout)

    def shutdown(self) -> None:
        self.bus.shutdown()


@dataclass(kw_only=True)
class Setup:
    clock: VirtualClock
    drive: DrivePeer
    counter: CounterPeer
    analog: Peer
    raw: Losable
    rig: CanRig
    seen: list[Event]

    def column(self, name: str) -> int:
        return [c.name for c in self.rig.channels].index(name)

    def speed(self, rpm: float, cycles: int, guard: Guard | None = None):
        return self.rig.exchange(
            Command(Mode.SPEED, np.full(cycles, rpm * RPM)), cycles, guard or Guard()
        )

    def codes(self) -> list[str]:
        self.seen += self.rig.events()
        return [event.code for event in self.seen]


def setup(
    *,
    state: str = "SOD",
    eds_text: str = "",
    config: CanRigConfig | None = None,
    drive: DriveConfig | None = None,
) -> Setup:
    channel, clock = next(CHANNELS), VirtualClock()
    raw = Losable(channel)
    peers = (
        DrivePeer(channel, clock, eds_text, state=state),
        CounterPeer(channel, clock),
        Peer(channel, 3, analog_eds(), clock),
    )
    config = config or CanRigConfig(
        drive=drive or DriveConfig(),
        motor_encoder=MotorEncoder(lines=8192, multiplication=4, largest_speed=400.0),
        counters=(CounterConfig(node_id=2),),
        modules=(AnalogModuleConfig(3, (torque_input(0.637),)),),
    )
    rig = CanRig(
        config, clock, lambda: raw, pump=Bench(*peers), time_base="virtual", origin="simulated"
    )
    drive, counter, analog = peers
    return Setup(
        clock=clock, drive=drive, counter=counter, analog=analog, raw=raw, rig=rig, seen=[]
    )


def close(made: Setup) -> None:
    made.rig.close()
    if made.raw.is_gone:
        made.raw.shutdown()
    Bench(made.drive, made.counter, made.analog).close()
