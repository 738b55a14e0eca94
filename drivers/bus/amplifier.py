"""What turns the motor on a segment: switched by SDO, commanded by process data, seen in the record of a cycle.

The segment knows this protocol alone. Who implements it owns its objects: which frames carry a set-point, what its
status is made of, what it cannot do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.bus.cia301 import ObjectRef
from drivers.bus.device import Identity, RemoteDevice
from drivers.bus.frames import FrameLayout
from drivers.bus.motor_encoder import MotorEncoder
from drivers.bus.pdo import MappedPdo
from drivers.bus.planned import Plan, Planned
from drivers.drive_state import DriveState
from drivers.port import Ask, DriveLimits, Mode


class Left(NamedTuple):
    """The amplifier is not any more as it was enabled: code of the event, its text, the number that shows it."""

    code: str
    text: str
    value: float


class Written(NamedTuple):
    """One object of a node and the value that is written into it."""

    entry: ObjectRef
    value: int


class Amplifier(Protocol):
    """A servo amplifier on the bus. `bring_up` first, then `plan` and `map_commands`, then `find` its status."""

    kind: str
    """What it is called among the devices of a rig."""
    stands_alone: bool
    """Whether its node is all its own; False: it is terminals of a coupler that may hold other inputs."""

    @property
    def device(self) -> RemoteDevice:
        """Its node."""
        ...

    @property
    def commands(self) -> Sequence[MappedPdo]:
        """The RPDOs that carry its set-points, once they are mapped."""
        ...

    @property
    def unwatched(self) -> Sequence[str]:
        """Why the motor would go on when the computer is lost, in words; empty: it would stop."""
        ...

    @property
    def identity(self) -> Identity:
        """Who its node says that it is, once it is brought up."""
        ...

    def bring_up(self, cycle_ns: int) -> object:
        """From any state to servo off with everything read and configured; NMT stays PRE-OPERATIONAL."""
        ...

    def plan(
        self,
        encoder: MotorEncoder,
        cycle_ns: int,
        *,
        is_counted: bool,
        beside: Sequence[ObjectRef] = (),
    ) -> Plan:
        """What it sends with every SYNC; `is_counted`: a counter has the input angle already. `beside` are other
        objects of its node that are to be sent as well.
        """
        ...

    def map_commands(self, encoder: MotorEncoder) -> Sequence[Planned]:
        """Map its RPDOs; the channels of the set-points that it takes."""
        ...

    def find(self, layout: FrameLayout) -> None:
        """Remember where its status stands in the record of a cycle."""
        ...

    def left(self, record: bytes) -> Left | None:
        """Whether, by the record of a cycle, it is not any more as it was enabled."""
        ...

    @property
    def largest_counts(self) -> Mapping[str, int]:
        """The largest set-point, either way, that each of its channels can carry."""
        ...

    def frames(
        self,
        mode: Mode,
        speeds: NDArray[np.int64],
        torques: NDArray[np.int64],
        *,
        may_ask: bool = False,
    ) -> list[list[bytes]]:
        """The bytes of every RPDO (outer) for every cycle (inner), of set-points (n,) in counts. `may_ask`: what a
        frame holds beside them may be read anew by SDO.
        """
        ...

    def frames_between(self) -> Sequence[bytes]:
        """The bytes of every RPDO for a cycle that goes out while it is being enabled; empty: it needs none."""
        ...

    def latched(self, record: bytes) -> None:
        """The record of a cycle that went out while it was being enabled."""
        ...

    def sent(self, cycles: int) -> None:
        """So many of the cycles went out whose frames were made last."""
        ...

    def paused(self) -> None:
        """Something went by SDO: what a frame holds beside its set-points may be another value now."""
        ...

    def arm_heartbeat(self) -> bool:
        """Start the computer's heartbeat and let it be watched; False if the node cannot."""
        ...

    def enable(self, mode: Mode) -> None:
        """Power on in this mode with set-points of zero. Raises `DriverError`."""
        ...

    def to_off(self, *, resets_fault: bool = True) -> None:
        """Power off from any state; a motor that turns is brought to rest first. Raises `DriverError`."""
        ...

    def state(self) -> DriveState:
        """The state by SDO."""
        ...

    def status_of(self, count: int) -> int:
        """The statusword that a count of the object of the status channel stands for."""
        ...

    def error_text(self) -> str:
        """What is wrong with it, in words, by SDO."""
        ...

    def reset_fault(self) -> None:
        """Acknowledge a fault; the servo stays off. Raises `DriverError` where its cause persists."""
        ...

    def write_limits(self, limits: DriveLimits) -> DriveLimits:
        """Write the limits and return what it holds; infinite where it holds none. What cannot be written is what
        somebody has set by the maker's tool (`Abilities.reads_limits_back`). Raises `DriverError`.
        """
        ...

    @property
    def stops(self) -> Mapping[Ask, Written]:
        """What is written by SDO to stop it and to switch it off."""
        ...

    def describe(self) -> dict[str, str]:
        """Its settings in words, for the run file."""
        ...
