"""Strangers on the bus while the rig runs: a SYNC, process data or a command for our drive that did not come from us.

Three counts, each judged in every cycle whatever the length of a block (`RULES`):

- *SYNC*. Where the adapter hands back what was sent, every SYNC of ours comes back once: what comes beyond those that
  were sent is a stranger's. Where it does not, every SYNC that is heard is one.
- *Second TPDO of one COB-ID in a cycle*. What came too late was missing before; what a SYNC too many made the nodes
  send is the SYNC's. The rest has another sender: a node with a node-ID that is taken, or a program.
- *Command for our drive*. A frame with the COB-ID of one of its RPDOs that is none of those that were sent.

A quick stop that the watchdog sends by a bus handle of its own is ours: its frames are announced when they are made.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from drivers.bus.frames import CycleStore
from drivers.clock import Clock
from drivers.event import Level
from drivers.samples import CycleFlag

FOREIGN_SYNC: Final = "foreign-sync"
FOREIGN_TPDO: Final = "foreign-tpdo"
FOREIGN_COMMAND: Final = "foreign-command"
WINDOW_NS: Final = 10_000_000_000
"""Time within which strangers of one kind are counted [ns]."""
SETTLED_CYCLES: Final = 50
"""Complete cycles without a stranger after which what was still owed is lost for good."""
_HISTORY: Final = 64
"""Cycles whose commands are remembered: an echo may be late by as many."""
Tell = Callable[[Level, str, str, str], None]
"""Takes level, code, source and text of an event."""


@dataclass(frozen=True)
class Rule:
    """What a kind of stranger is in words, and how many of them within the window end the run; those before are
    warnings.
    """

    what: str
    ends_at: int


RULES: Final[Mapping[str, Rule]] = {
    FOREIGN_SYNC: Rule("a SYNC that is not ours", 3),
    FOREIGN_TPDO: Rule("process data that came twice in one cycle", 3),
    FOREIGN_COMMAND: Rule("a command that is not ours", 1),
}
"""By the code of the event."""


@dataclass
class _Kind:
    """The strangers of one kind within the window: when each was heard [ns]; whether the end of the run was told."""

    times: deque[int] = field(default_factory=deque[int])
    has_ended: bool = False


class Strangers:
    """Tells our own frames from those of others, and tells of the others. `commands` are the COB-IDs of the drive's
    RPDOs; `echoes`: the adapter hands back what was sent.
    """

    def __init__(
        self, store: CycleStore, clock: Clock, tell: Tell, commands: Sequence[int], *, echoes: bool
    ) -> None:
        self.echoes = echoes
        self._store, self._clock, self._tell, self._commands = store, clock, tell, tuple(commands)
        self._kinds = {code: _Kind() for code in RULES}
        self._sent: deque[Sequence[bytes]] = deque(maxlen=_HISTORY)
        self._in_force: Sequence[bytes | None] = [None] * len(commands)
        self._announced: set[tuple[int, bytes]] = set()
        self._owed = self._syncs = 0
        self._surplus_before = self._explained = self._doubled = self._quiet = 0
        self._base = [0] * len(store.surplus)
        self._is_settled = True

    # --- our own frames

    def sends(self, commands: Sequence[bytes]) -> None:
        """The frames of a cycle go out, then its SYNC; without `commands` the SYNC alone."""
        if commands:
            self._in_force = commands
            self._sent.append(commands)
        if self.echoes:
            self._owed += 1

    def announce(self, frames: Sequence[tuple[int, bytes]]) -> None:
        """(COB-ID, data) of a quick stop that may be sent past this loop, by another handle. From any thread."""
        # One step: the set is looked into while it grows.
        self._announced = self._announced | set(frames)

    # --- what is heard

    def sync_heard(self) -> bool:
        """Take a SYNC; whether it is ours."""
        if self._owed:
            self._owed -= 1
            return True
        self._syncs += 1
        self._is_settled, self._quiet = False, 0
        self._note(FOREIGN_SYNC, "bus", "")
        return False

    def listener(self, number: int) -> Callable[[bytes, int], None]:
        """What takes the frames of one of the drive's RPDOs, by its number among `commands`."""

        def heard(data: bytes, stamp_ns: int) -> None:
            if data != self._in_force[number]:
                self._command_heard(number, data)

        return heard

    def _command_heard(self, number: int, data: bytes) -> None:
        """A command that is not the one in force: an echo that is late, the watchdog's, or a stranger's."""
        cob_id = self._commands[number]
        if (cob_id, data) in self._announced:
            if number == 0:
                # The SYNC with which its quick stop acts comes next, and the nodes answer it.
                self._owed += 1
                self._explained += 1
                self._is_settled, self._quiet = False, 0
            return
        # Echoes keep their order: what was sent before a SYNC that has come back has come back as well.
        late = list(self._sent)[-1 - self._owed :]
        if self.echoes and any(number < len(sent) and sent[number] == data for sent in late):
            return
        force = self._in_force[number]
        mine = "nothing" if force is None else force.hex(" ")
        self._note(
            FOREIGN_COMMAND,
            f"COB-ID 0x{cob_id:03X}",
            f"{data.hex(' ') or 'no bytes'}, in force is {mine}",
        )

    # --- cycle by cycle

    def begin(self) -> None:
        """The first cycle begins: what the nodes sent before it was nobody's answer."""
        self._base = list(self._store.surplus)
        self._surplus_before = sum(self._base)

    def close_cycle(self, flags: int) -> None:
        """A cycle has been closed with these flags."""
        surplus = self._store.surplus_frames
        if surplus != self._surplus_before:
            self._surplus_before, self._is_settled, self._quiet = surplus, False, 0
            self._count_doubled()
        elif not self._is_settled or self._owed:
            self._settle(bool(flags & CycleFlag.INCOMPLETE))

    def _count_doubled(self) -> None:
        """Frames beyond one of a COB-ID in a cycle, less those that were missing before and those that a SYNC too many
        has made.
        """
        store = self._store
        beyond = [
            surplus - lost - base
            for surplus, lost, base in zip(store.surplus, store.lost, self._base, strict=True)
        ]
        most = max(beyond, default=0)
        for _ in range(self._doubled, most - self._explained - self._syncs):
            pdo = store.layout.pdos[beyond.index(most)]
            self._note(FOREIGN_TPDO, f"node {pdo.node_id}", f"COB-ID 0x{pdo.cob_id:03X}")
            self._doubled += 1

    def _settle(self, is_incomplete: bool) -> None:
        """After enough quiet cycles what is still owed was lost, and explains nothing that comes."""
        self._quiet = 0 if is_incomplete else self._quiet + 1
        if self._quiet < SETTLED_CYCLES:
            return
        store = self._store
        self._base = [
            surplus - lost for surplus, lost in zip(store.surplus, store.lost, strict=True)
        ]
        self._owed = self._syncs = self._explained = self._doubled = self._quiet = 0
        self._is_settled = True

    def _note(self, code: str, source: str, text: str) -> None:
        """Count a stranger; each is a warning, the one that is too many an error. After that nothing is told before
        the bus has been quiet for the whole window.
        """
        kind, rule, now = self._kinds[code], RULES[code], self._clock.monotonic_ns()
        while kind.times and now - kind.times[0] > WINDOW_NS:
            kind.times.popleft()
        kind.has_ended = kind.has_ended and bool(kind.times)
        kind.times.append(now)
        if len(kind.times) > rule.ends_at:
            kind.times.popleft()
        if kind.has_ended:
            return
        kind.has_ended = len(kind.times) >= rule.ends_at
        words = f"{rule.what}: {text}" if text else rule.what
        if rule.ends_at > 1:
            words += f" ({len(kind.times)} within {WINDOW_NS / 1e9:g} s, {rule.ends_at} end a run)"
        self._tell("error" if kind.has_ended else "warning", code, source, words)
