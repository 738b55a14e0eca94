"""Incomplete cycles in a row, and what comes after them: a slow computer is told from a cable."""

from __future__ import annotations

from typing import Final

from drivers.bus.frames import CycleStore
from drivers.bus.strangers import Tell
from drivers.errors import StaleDataError
from drivers.port import LATE_ANSWERS

_LONG_SILENCE: Final = 3
"""Incomplete cycles in a row of whose end is told whether their answers were late or lost."""
_LATEST_ANSWER: Final = 50
"""Complete cycles after a silence in which its answers are still waited for."""


class Silence:
    """Counts incomplete cycles in a row. What comes after them tells a slow computer from a cable: what was delayed
    comes in the end, what was lost does not (a controller repeats one frame at most).
    """

    def __init__(self, store: CycleStore, tell: Tell) -> None:
        self.cycles = 0
        """Incomplete cycles in a row until now."""
        self._store, self._tell = store, tell
        self._open = self._cycles_open = 0
        self._surplus_before = list(store.surplus)

    def count(self, is_incomplete: bool) -> None:
        """A cycle has been closed."""
        if is_incomplete:
            if not self.cycles and not self._open:
                self._surplus_before = list(self._store.surplus)
            self.cycles += 1
            return
        if self.cycles >= _LONG_SILENCE:
            self._open, self._cycles_open = self.cycles, 0
        self.cycles = 0
        if self._open:
            self._look_for_answers()

    def require_shorter(self, limit: int) -> None:
        """Raise `StaleDataError` where nothing complete has come back for so many cycles."""
        if self.cycles >= limit:
            raise StaleDataError(
                "no complete cycle came back",
                where=self._store.missing_text(),
                value=f"{self.cycles} cycles",
                limit=f"< {limit}",
                remedy="Stop the drive; is the node powered and on the bus?",
            )

    def _look_for_answers(self) -> None:
        """Whether the answers of the silence before have come by now."""
        self._cycles_open += 1
        late = zip(self._store.surplus, self._surplus_before, strict=True)
        # Of one COB-ID: nodes with many would make up a silence by the one frame that each controller repeats.
        if 2 * max(now - before for now, before in late) >= self._open:
            text = f"the answers of {self._open} cycles came after all, too late for their cycles"
            self._tell("warning", LATE_ANSWERS, "bus", text)
        elif self._cycles_open < _LATEST_ANSWER:
            return
        self._open = 0
