"""What is wanted of a node before it is mapped: channels whose place in the frames is not known yet, and objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from drivers.bus.cia301 import ObjectRef
from drivers.bus.cia401 import AnalogInput
from drivers.bus.columns import Kind
from drivers.bus.status_lines import StatusLines
from drivers.channel import Channel


@dataclass(kw_only=True)
class Planned:
    """A channel before its place in the frames is known."""

    channel: Channel
    kind: Kind
    node_id: int = 0
    entry: ObjectRef | None = None
    largest_step: int = 0
    quantum: float = 0.0
    of: str = ""
    seen: tuple[int, ObjectRef, int] | None = None
    closed: int = 0
    analog: AnalogInput | None = None
    lines: StatusLines | None = None


@dataclass(frozen=True)
class Plan:
    """What a node is to send with every SYNC: its channels, and the objects in the order in which they are packed.

    `optional` are the keys of those that may stay out. `seen` is the latch of the motor encoder's index mark: node,
    object, mask.
    """

    channels: Sequence[Planned]
    objects: Sequence[ObjectRef]
    optional: frozenset[tuple[int, int]] = frozenset()
    seen: tuple[int, ObjectRef, int] | None = None
