"""Stopping after an exception that nobody expected: whatever else goes wrong meanwhile, stopping goes on.

Nothing is recorded while the rig is being stopped: what came back and what make-safe says is kept, and written once
it stands. Whatever is raised on the way is counted and told.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Final

from drivers.port import Command, Guard, Mode, RigPort
from drivers.samples import SampleBlock
from experiments.steps.kind import SegmentLabel
from experiments.steps.profile import cycles_of
from rig.run.make_safe import MakeSafe
from rig.run.phases import Journal, Machine, Turn

ATTEMPTS: Final = 3
"""Exchanges in a row that bring nothing after which nothing more is tried, and times that make-safe is begun anew."""
GIVEN_UP: Final = "the rig does not answer any more"
NOT_JUDGED: Final = "nobody could judge whether it stands"
BLIND: Final = ((Mode.QUICK_STOP, 2.0), (Mode.OFF, 1.0))
"""What is commanded, and for how long [s], where make-safe itself fails every time."""


class Caught:
    """What was raised while the rig was stopped, and how often."""

    def __init__(self) -> None:
        self._times: Counter[str] = Counter()

    @contextmanager
    def catching(self) -> Generator[None, None, None]:
        """Whatever is raised in the block is counted, and goes no further."""
        try:
            yield
        except BaseException as error:  # noqa: BLE001  the rig is being stopped: nothing comes before that
            self._times[f"{type(error).__name__}: {error}"] += 1

    def texts(self) -> list[str]:
        """One sentence for each, in the order of their first times."""
        return [
            f"while the rig was stopped: {what}" + f" ({times} times)" * (times > 1)
            for what, times in self._times.items()
        ]


@dataclass
class _LaterJournal:
    """Keeps what make-safe says until the rig stands."""

    events: list[tuple[str, str, str, str]] = field(default_factory=list[tuple[str, str, str, str]])

    def event(self, level: str, code: str, source: str, text: str) -> None:
        """Keep an event."""
        self.events.append((level, code, source, text))

    def segment(self, label: SegmentLabel, start: int, stop: int) -> None:
        """Making safe has no segments."""


class Emergency:
    """Stops a rig by `make_safe(journal)`, which is begun anew where it fails itself. `stop()` once, then `keep`."""

    def __init__(
        self,
        port: RigPort,
        machine: Machine,
        block_cycles: int,
        make_safe: Callable[[Journal], MakeSafe],
    ) -> None:
        self.caught = Caught()
        self._port, self._machine, self._cycles = port, machine, block_cycles
        self._begin = make_safe
        self._journal = _LaterJournal()
        self._blocks: list[SampleBlock] = []
        self._silent = 0

    def stop(self) -> MakeSafe | None:
        """Stop, verify it where that can be done; who has done it. None: make-safe could not even be begun."""
        made: MakeSafe | None = None
        for _ in range(ATTEMPTS):
            with self.caught.catching():
                made = self._begin(self._journal)
                if self._walk(made):
                    return made
                break
        else:
            self._stop_blindly()
        if made is not None:
            made.give_up(GIVEN_UP if self._silent >= ATTEMPTS else NOT_JUDGED)
        return made

    def _walk(self, make_safe: MakeSafe) -> bool:
        """Whether make-safe was walked to its end; False when the rig does not answer. Raises what make-safe raises."""
        turn = make_safe.next(None)
        while turn is not None and self._silent < ATTEMPTS:
            block = self._exchange(turn)
            if block is not None:
                self._machine.accept(block, turn)
            turn = make_safe.next(block)
        return turn is None

    def _stop_blindly(self) -> None:
        for mode, seconds in BLIND:
            left = cycles_of(seconds, self._machine.period)
            while left > 0 and self._silent < ATTEMPTS:
                turn = Turn(Command(mode), min(left, self._cycles))
                block = self._exchange(turn)
                left -= turn.cycles if block is None else len(block)

    def _exchange(self, turn: Turn) -> SampleBlock | None:
        """One exchange; None when it brought nothing."""
        with self.caught.catching():
            block = self._port.exchange(turn.command, turn.cycles, Guard(turn.until))
            if len(block):
                self._silent = 0
                self._blocks.append(block)
                return block
        self._silent += 1
        return None

    def keep(self, put: Callable[[SampleBlock], None], journal: Journal) -> None:
        """Record what came back and what was said, then what was caught: the rig stands, or nobody can stop it."""
        for block in self._blocks:
            with self.caught.catching():
                put(block)
        for event in self._journal.events:
            with self.caught.catching():
                journal.event(*event)
        for text in self.caught.texts():
            journal.event("error", "emergency", "session", text)
