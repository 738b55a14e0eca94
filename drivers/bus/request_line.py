"""The line to each device beside the cyclic data: requests by SDO and NMT that nobody waits for.

`turn` is called once per SYNC cycle while something is on its way. It sends at most one frame to each node; answers are
taken as frames arrive. A node that says nothing costs the others nothing: its time runs while the cycles go on.
"""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

from drivers.bus.amplifier import Amplifier
from drivers.bus.cia301 import NmtCommand, NmtState, ObjectRef
from drivers.bus.device import RemoteDevice
from drivers.bus.network import PumpedBus
from drivers.bus.sdo import PostedTransfer, SdoTimeoutError
from drivers.errors import DriverError
from drivers.port import Answer, Ask, Reach, Request

_STOPS: Final = (Ask.QUICK_STOP, Ask.SERVO_OFF)


@dataclass(frozen=True)
class Place:
    """Where a channel comes from: the device and the object that hold it, and whether its process data come."""

    device: RemoteDevice
    entry: ObjectRef
    arrives: Callable[[], bool]
    count_of: Callable[[int], int] = int
    """The count of the channel that a number of the object stands for."""


@dataclass(kw_only=True)
class _Conversation:
    """What one node is being asked: the requests that wait, the first of which may be on its way."""

    device: RemoteDevice
    waiting: deque[Request] = field(default_factory=deque[Request])
    posted: PostedTransfer | None = None


class RequestLine:
    """The `DirectLine` of a rig on a bus; `places` of its channels, `amplifier` that can be stopped."""

    def __init__(self, bus: PumpedBus, places: dict[str, Place], amplifier: Amplifier) -> None:
        self._bus, self._places, self._amplifier = bus, places, amplifier
        self._conversations: dict[int, _Conversation] = {}
        self._answers: list[Answer] = []
        self._unanswered: set[int] = set()
        self._refusing: set[int] = set()

    @property
    def is_busy(self) -> bool:
        """Whether `turn` has something to do."""
        return bool(self._conversations)

    def is_idle(self, channel: str) -> bool:
        """Whether the device that carries a channel is being asked nothing."""
        place = self._places.get(channel)
        return place is None or place.device.node_id not in self._conversations

    def reach(self, channel: str) -> Reach:
        """How the device that carries a channel can be reached: by its heartbeat, its frames and its latest answer.

        A channel of a source beside the bus is in the cycles or nowhere: nobody can be asked for it here.
        """
        place = self._places.get(channel)
        if place is None:
            return Reach.PROCESS_DATA
        state = place.device.watch.state
        if state is NmtState.OPERATIONAL and place.arrives():
            return Reach.PROCESS_DATA
        node_id = place.device.node_id
        is_deaf = state is NmtState.STOPPED or node_id in self._unanswered | self._refusing
        return Reach.NMT_FIRST if is_deaf else Reach.SDO

    def hand(self, requests: Sequence[Request]) -> None:
        """Ask this from the next cycle on; what is on its way to the same devices is withdrawn."""
        begun: dict[int, _Conversation] = {}
        for request in requests:
            device = self._places[request.channel].device
            conversation = begun.setdefault(device.node_id, _Conversation(device=device))
            # A node has several channels and is woken once.
            if request.ask is not Ask.WAKE or not conversation.waiting:
                conversation.waiting.append(request)
        for node_id in begun:
            self._forget(node_id)
        self._conversations |= begun

    def withdraw(self, channel: str) -> None:
        """Ask the device that carries a channel nothing any more; what still comes belongs to nobody."""
        place = self._places.get(channel)
        if place is not None:
            self._forget(place.device.node_id)

    def _forget(self, node_id: int) -> None:
        conversation = self._conversations.pop(node_id, None)
        if conversation is not None:
            conversation.device.sdo.withdraw()

    def answers(self) -> list[Answer]:
        """What has come of the requests since the last call."""
        taken, self._answers = self._answers, []
        return taken

    def turn(self, cycle: int) -> None:
        """One cycle: settle what has arrived, send at most one frame to each node. Raises `BusLostError`."""
        now = self._bus.clock.monotonic_ns()
        for node_id, conversation in list(self._conversations.items()):
            posted = conversation.posted
            if posted is not None and posted.is_over:
                self._settle(conversation, posted, cycle)
                conversation.posted = posted = None
            if posted is not None:
                posted.turn(now)
            elif not conversation.waiting:
                del self._conversations[node_id]
            elif conversation.waiting[0].ask is Ask.WAKE:
                conversation.waiting.popleft()
                self._bus.nmt(NmtCommand.PRE_OPERATIONAL, node_id)
            else:
                conversation.posted = posted = self._post(conversation.waiting[0])
                posted.turn(now)

    def _post(self, request: Request) -> PostedTransfer:
        place = self._places[request.channel]
        if request.ask is Ask.READ:
            return place.device.sdo.post_upload(*place.entry.key)
        entry, value = self._amplifier.stops[request.ask]
        return place.device.sdo.post_download(*entry.key, entry.data_type.encode(value))

    def _settle(self, conversation: _Conversation, posted: PostedTransfer, cycle: int) -> None:
        """Note what came of the first request; a node that said nothing is not asked the rest."""
        request, count = conversation.waiting.popleft(), None
        if isinstance(posted.error, SdoTimeoutError):
            self._unanswered.add(conversation.device.node_id)
            self._answers += [Answer(left, cycle, None) for left in conversation.waiting]
            conversation.waiting.clear()
        else:
            self._unanswered.discard(conversation.device.node_id)
        if request.ask in _STOPS:
            # Some take no SDO for an object that an RPDO carries, but for when they are PRE-OPERATIONAL.
            mark = self._refusing.discard if posted.error is None else self._refusing.add
            mark(conversation.device.node_id)
        if posted.error is None and request.ask is Ask.READ:
            with contextlib.suppress(DriverError):
                place = self._places[request.channel]
                number = conversation.device.number_of(place.entry, posted.data)
                count = place.count_of(int(number))
        self._answers.append(Answer(request, cycle, count))
