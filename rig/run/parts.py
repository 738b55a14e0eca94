"""What a session is given and what it gives back: its parts, the open run file, the report, the progress."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from drivers.port import RigDescription
from experiments.finding import Finding
from rig.library.folder import RunPlace
from rig.run.bounds import Watch
from rig.run.dry_run import PlannedRun
from rig.run.latch import TripLatch
from rig.run.make_safe import MakeSafeReport, Patience
from rig.run.margins import with_units
from rig.run.marker import RunMarker
from rig.run.recorder import Recorder
from rig.run.trips import Trip
from rig.run.watchdog import Watchdog

if TYPE_CHECKING:
    from rig.bench.backends.assembly import AssembledRig
    from rig.bench.backends.order import Order
    from rig.bench.config.used import UsedFile
    from rig.runfile.header import RunHeader


@dataclass(frozen=True, kw_only=True)
class SessionParts:
    """What a session is put together of: the order with its plan, the rig, and what stands around it."""

    order: Order
    planned: PlannedRun
    rig: AssembledRig
    cycles: int
    """Cycles per exchange: those of the order, or fewer in real time."""
    make_safe_cycles: int = 100
    place: RunPlace | None = None
    """The number that was taken for this run before its rig was put together; None: it takes the next."""
    watch: Watch | None = None
    patience: Patience | None = None
    free_space: Callable[[], int] | None = None
    """Bytes left where the file is written; None: nobody looks."""
    bench: str = ""
    """The identity of the bench."""
    latch: TripLatch | None = None
    """Where a trip is latched until it is acknowledged by name; None: nowhere (a rig that is thrown away)."""
    marker: RunMarker | None = None
    """Says, from before arming until verified standstill, that this run may be in motion."""
    watchdog: Watchdog | None = None
    """Watches in real time that turns happen."""
    files: Sequence[UsedFile] = ()
    """The description of the rig and its calibrations: the run notes their hashes."""
    arm: Callable[[], tuple[Finding, ...]] | None = None
    """What is looked at last before a rig of hardware may move: the guard, the computer. Called
    once the rig is open.
    """


class OpenRun(Protocol):
    """A run file that has been begun: where it is, the recorder that fills it, and how it is
    brought up to date for a reader.
    """

    @property
    def run_id(self) -> str: ...

    @property
    def part(self) -> Path: ...

    @property
    def header(self) -> RunHeader: ...

    @property
    def recorder(self) -> Recorder: ...

    def flush(self) -> None: ...


Begin = Callable[[SessionParts, RigDescription, int, str], OpenRun]
"""Makes the run file: parts, what the rig says it is, calendar time of a stamp of zero [ns], start time (ISO 8601)."""


def _trip_as_json(trip: Trip) -> dict[str, Any]:
    return {
        "cause": trip.cause,
        "row": trip.row,
        "value": _finite(trip.value),
        "limit": _finite(trip.limit),
        "unit": trip.unit,
        "action": trip.action.value,
    }


@dataclass(kw_only=True)
class RunReport:
    """How a run ended."""

    run_id: str
    outcome: str
    path: Path
    rows: int
    message: str
    trip: Trip | None
    make_safe: MakeSafeReport | None
    warnings: list[str]
    metrics: dict[str, float]
    margins: dict[str, dict[str, float]]
    readable: bool = True

    @property
    def safe(self) -> bool:
        """Whether standstill was verified."""
        return self.make_safe is not None and self.make_safe.safe

    def as_json(self) -> dict[str, Any]:
        """The object that `rig run --json` prints."""
        return {
            "run": self.run_id,
            "outcome": self.outcome,
            "path": str(self.path),
            "rows": self.rows,
            "message": self.message,
            "trip": None if self.trip is None else _trip_as_json(self.trip),
            "make_safe": self.make_safe.as_json() if self.make_safe else None,
            "warnings": self.warnings,
            "metrics": self.metrics,
            "margins": with_units(self.margins),
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """One line of progress: step, nominal time done and left [s], input speed [rad/s], and the
    smallest margin so far: which
    limit, and the share of it that was left."""

    step: int
    steps: int
    what: str
    elapsed: float
    left: float
    speed: float
    events: int
    nearest: str = ""
    margin: float = 1.0
    margins: Mapping[str, Mapping[str, float]] = field(
        default_factory=dict[str, Mapping[str, float]]
    )
    """Peak, limit and share left of every limited quantity so far."""
    file: str = ""
    """The run file that grows."""
    begun: Sequence[float] = ()
    """When each step of the plan began, so far, since the start of the run [s]."""


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
