"""What a rig is once it is put together, the same for every backend; what it is asked for is an `Order`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from drivers.clock import Clock
from drivers.port import RigPort
from experiments.extensions import Extension
from sim_backend.world import OLDEST

if TYPE_CHECKING:
    from drivers.bus.listening import ListeningBus
    from drivers.bus.network import RawBus
    from drivers.bus.rig_config import CanRigConfig
    from drivers.bus.rig_nodes import RigNodes

WORLD_OF_0_2_0: Mapping[str, Any] = {"version": OLDEST, "hours": 0.0, "day_correlation": None}
"""What the worlds in the files of program version 0.2.0 do not say, because there was no other."""


@dataclass(frozen=True, kw_only=True)
class AssembledRig:
    """A rig that can be run: its port, its clock, and whether its time is that of the wall.

    `nodes` are those of its bus, once it is open, for whoever looks them over; None: it has no bus.

    Of a rig of hardware: `second_bus` opens another handle on its bus for the watchdog, once the rig is open
    (`second_handle`: what is known of its adapter in that), `guard`
    reads the input of the guard's contact (value, whether that means closed) once the rig is open,
    `loss_covered_by` says what stops the motor when the computer is lost and the drive does not see to it,
    `reaction` [s] is how long an exchange may take, `priority` and `lock_memory` are what the loop
    asks of the computer.
    `extensions` are what other packages brought to it.

    Of a rig on a bus: `described` is what its drivers were told of it, `quiet_bus` opens the bus for whoever only
    listens and reads.

    Of a simulated rig: `person` does at the bench what the key of a question asks for, and answers;
    `world` is the world that it is in, as its run file tells it, and
    `thermal_state` tells how warm it is now ("end") and was on average ("mean") [degC].
    """

    name: str
    port: RigPort
    clock: Clock
    real_time: bool = False
    nodes: Callable[[], RigNodes] | None = None
    second_bus: Callable[[], RawBus] | None = None
    second_handle: str = ""
    guard: Callable[[], tuple[int, bool]] | None = None
    loss_covered_by: str = ""
    reaction: float = 0.02
    priority: int = 0
    lock_memory: bool = False
    world: Mapping[str, Any] = field(default_factory=dict)
    thermal_state: Callable[[], Mapping[str, Mapping[str, float]]] | None = None
    extensions: tuple[Extension, ...] = ()
    described: CanRigConfig | None = None
    quiet_bus: Callable[[], ListeningBus] | None = None
    person: Callable[[str], str] | None = None
