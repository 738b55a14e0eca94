"""A recording as analyses see it: SI arrays, segments, events, metadata. Simulated, recorded,
replayed or imported: one type.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from experiments.errors import AnalysisError
from model.arrays import FloatArray, IntArray
from model.channel import Channel
from model.gear import HarmonicDrive, Mounting

Origin = Literal["simulated", "replay", "imported", "hardware"]
TimeBase = Literal["hardware", "device", "virtual", "host", "nominal", "none"]


@dataclass(frozen=True, kw_only=True)
class Segment:
    """A labelled interval of rows [start, stop) of a run."""

    index: int
    label: str
    start: int
    stop: int
    setpoint: float = 0.0
    direction: int = 0
    repeat: int = 0


@dataclass(frozen=True)
class Event:
    """Something that happened: time [ns, calendar], level ("info", "warning", "error"), code, source, text."""

    time_ns: int
    level: str
    code: str
    source: str
    text: str


@dataclass(frozen=True, kw_only=True)
class RunMetadata:
    """Who, what, when and on what a run was made. `experiment` is the protocol's name ("" for a foreign recording)."""

    run_id: str
    experiment: str
    origin: Origin
    title: str = ""
    outcome: str = ""
    start_time: str = ""
    end_time: str = ""
    operator: str = ""
    gear: HarmonicDrive | None = field(default=None, repr=False)
    gear_serial: str = ""
    ratio: float = float("nan")
    mounting: Mounting = "circular-spline-fixed"
    output_sense: int = -1
    """+1 if output encoder and input encoder count in the same sense when the output follows, else -1."""
    gear_mounted: bool = True
    sample_rate: float = float("nan")
    time_base: TimeBase = "none"
    parameters: Mapping[str, Any] = field(default_factory=dict[str, Any], repr=False)
    conditions: Mapping[str, Any] = field(default_factory=dict[str, Any])
    process: Mapping[str, Any] = field(default_factory=dict[str, Any], repr=False)
    limits: Mapping[str, Any] = field(default_factory=dict[str, Any], repr=False)
    """What the rig was limited to while the run was made, as its file keeps it."""
    sha256: str = ""
    """Of the bytes of the file; "" for one that is being written, and for a recording that is no file."""
    is_sealed: bool = False
    """Whether this SHA-256 is the one that was noted when the run was sealed."""

    def is_said(self, name: str) -> bool:
        """Whether "mounting" or "output_sense" was said: a rig knows it, of an import a person may have."""
        stated = self.process.get("stated")
        return not isinstance(stated, Mapping) or bool(
            cast(Mapping[str, Any], stated).get(name, True)
        )

    @property
    def mounting_said(self) -> str:
        """The mounting, "not stated" where an import took the usual one."""
        return self.mounting if self.is_said("mounting") else "not stated"

    @property
    def seal(self) -> str:
        """The hash as a page states it."""
        mark = "" if self.is_sealed else "not sealed"
        return ", ".join(part for part in (self.sha256, mark) if part)


class SignalSource(Protocol):
    """Where a recording's stored numbers come from (a file or arrays)."""

    @property
    def rows(self) -> int: ...

    def stored(self, name: str, start: int, stop: int) -> NDArray[Any]:
        """Stored numbers of a channel, rows [start, stop): unwrapped counts, or floats of an imported recording."""
        ...

    def time_ns(self, start: int, stop: int) -> IntArray: ...

    def flags(self, start: int, stop: int) -> NDArray[np.uint16]: ...


@dataclass(frozen=True)
class ArraySource:
    """A recording that lies in memory: stored arrays by channel, all of one length."""

    arrays: Mapping[str, NDArray[Any]]
    times: IntArray
    cycle_flags: NDArray[np.uint16] | None = None

    @property
    def rows(self) -> int:
        return len(self.times)

    def stored(self, name: str, start: int, stop: int) -> NDArray[Any]:
        return self.arrays[name][start:stop]

    def time_ns(self, start: int, stop: int) -> IntArray:
        return self.times[start:stop]

    def flags(self, start: int, stop: int) -> NDArray[np.uint16]:
        if self.cycle_flags is None:
            return np.zeros(min(stop, self.rows) - start, dtype=np.uint16)
        return self.cycle_flags[start:stop]


@dataclass(frozen=True)
class Recording:
    """One run as SI arrays. Reading is lazy: only the rows that are asked for are loaded."""

    metadata: RunMetadata
    signals: Mapping[str, Channel]
    segments: tuple[Segment, ...]
    events: tuple[Event, ...]
    source: SignalSource

    @property
    def rows(self) -> int:
        """Number of cycles."""
        return self.source.rows

    def has(self, *names: str) -> bool:
        """Whether all of these channels were recorded."""
        return all(name in self.signals for name in names)

    def require(self, purpose: str, *names: str) -> None:
        """Raise `AnalysisError` naming the channels that `purpose` needs and this recording lacks."""
        missing = [name for name in names if name not in self.signals]
        if missing:
            raise AnalysisError(
                f"{purpose} needs a channel that this recording does not have",
                where=self.metadata.run_id,
                value=", ".join(missing),
                limit="channels " + ", ".join(sorted(self.signals)),
                remedy="Record the channel, or map it when importing.",
            )

    def rows_of(self, where: Segment | slice | None) -> tuple[int, int]:
        """First row and end of a segment, a slice, or the whole run."""
        if isinstance(where, Segment):
            return where.start, min(where.stop, self.rows)
        if where is None:
            return 0, self.rows
        start, stop, _ = where.indices(self.rows)
        return start, stop

    def si(self, name: str, where: Segment | slice | None = None) -> FloatArray:
        """A channel in SI over a segment (or slice, or all of it)."""
        return self.signals[name].to_si(self.stored(name, where))

    def stored(self, name: str, where: Segment | slice | None = None) -> NDArray[Any]:
        """A channel as stored: counts, or floats of an imported recording."""
        return self.source.stored(name, *self.rows_of(where))

    def output_angle(self, where: Segment | slice | None = None) -> FloatArray:
        """Output angle theta_o counted positive when the output follows a positive input [rad]."""
        return self.metadata.output_sense * self.si("output_angle", where)

    def time(self, where: Segment | slice | None = None) -> FloatArray:
        """Time since the first row of the run [s]."""
        start, stop = self.rows_of(where)
        since = self.source.time_ns(start, stop) - self.source.time_ns(0, 1)
        return np.asarray(since * 1e-9, dtype=np.float64)

    def flags(self, where: Segment | slice | None = None) -> NDArray[np.uint16]:
        """Cycle flags (0: complete and on time)."""
        return self.source.flags(*self.rows_of(where))

    def blocks(self, where: Segment | slice | None = None, size: int = 65536) -> Iterator[slice]:
        """Slices of at most `size` rows that cover the segment: for work in constant memory."""
        start, stop = self.rows_of(where)
        for begin in range(start, stop, size):
            yield slice(begin, min(begin + size, stop))

    def labelled(self, *labels: str) -> tuple[Segment, ...]:
        """The segments with one of these labels, in the order they were recorded."""
        return tuple(s for s in self.segments if s.label in labels)


def mapping_of(content: object) -> Mapping[str, Any]:
    """What a file says where it should say an object; empty where it does not."""
    return cast(Mapping[str, Any], content) if isinstance(content, Mapping) else {}
