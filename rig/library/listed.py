"""One run as a list knows it: what its file says of itself, and in what state the file is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

COUNTED_OUTCOMES = ("COMPLETED", "")
"""Outcomes of runs that were brought to their end ("" is an imported recording's)."""
State = Literal["sealed", "being written", "left behind", "unreadable"]


@dataclass(frozen=True, kw_only=True)
class IndexedRun:
    """One run as the index knows it.

    `state`: sealed; being written by a living process; left behind by a dead one (see `rig
    recover`); or unreadable, with the reason in `problem`. `duration` in s and `ratio`, that of the part, are NaN where
    they are not known; `notes` are the operator's, in one text.
    """

    path: Path
    run_id: str
    number: int
    state: State
    protocol: str
    gear_serial: str
    gear: str
    ratio: float
    operator: str
    start: str
    duration: float
    outcome: str
    origin: str
    backend: str
    rows: int
    problem: str
    notes: str
    bench: str
    """The bench that it was made on; "" where its file does not say it."""
    mounting: str

    @property
    def unfinished(self) -> bool:
        """Whether its file is not sealed."""
        return self.path.name.endswith(".part")

    @property
    def is_complete(self) -> bool:
        """Whether it is sealed and was brought to its end: what was broken off lacks speeds."""
        return self.state == "sealed" and self.outcome in COUNTED_OUTCOMES

    def as_json(self) -> dict[str, Any]:
        """One line of `rig runs --json`."""
        return {
            "file": str(self.path),
            "run": self.run_id,
            "number": self.number,
            "state": self.state,
            "unfinished": self.unfinished,
            "protocol": self.protocol,
            "origin": self.origin,
            "backend": self.backend,
            "outcome": self.outcome,
            "started": self.start,
            "operator": self.operator,
            "gear": self.gear,
            "gear_serial": self.gear_serial,
            "rows": self.rows,
            "duration_s": self.duration,
            "notes": self.notes,
            "problem": self.problem,
            "bench": self.bench,
            "mounting": self.mounting,
        }
