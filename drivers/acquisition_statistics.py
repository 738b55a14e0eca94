"""How well the acquisition kept time: achieved rate, jitter, missed cycles, latency; counted as the cycles come."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from drivers.counting import changes
from drivers.samples import CycleFlag

_BINS: Final = np.concatenate([[0.0], np.geomspace(1e2, 1e11, 541)])
"""Edges [ns] of the histogram that percentiles are read from: 60 per decade, so within 4 %."""


@dataclass(frozen=True, kw_only=True)
class AcquisitionReport:
    """What the acquisition did since the rig was opened; times in seconds, rates in Hz, shares of 1."""

    cycles: int
    duration: float
    nominal_rate: float
    achieved_rate: float
    jitter_rms: float
    """Standard deviation of the SYNC interval, stops of the acquisition left out."""
    jitter_p99: float
    """99th percentile of |interval - nominal|."""
    jitter_max: float
    latency_p50: float
    """From SYNC sent to the last frame of its cycle received, on the computer."""
    latency_p99: float
    latency_max: float
    incomplete: int
    late: int
    doubled: int
    short: int
    jumped: int
    signal_error: int
    saturated: int
    host_time: int
    overruns: int
    """Cycles whose SYNC went out more than half a period late."""
    pauses: int
    """Gaps between blocks in which no SYNC was due: transitions of the drive, prompts."""

    @property
    def missed_share(self) -> float:
        """Share of the cycles that are incomplete, late, doubled or short."""
        missed = self.incomplete + self.late + self.doubled + self.short
        return missed / self.cycles if self.cycles else 0.0


class AcquisitionStatistics:
    """Streaming counters: constant memory, whatever the length of a run."""

    def __init__(self, cycle_ns: int) -> None:
        self._cycle_ns = cycle_ns
        self._flags: dict[CycleFlag, int] = dict.fromkeys(CycleFlag, 0)
        self._cycles = self._intervals = 0
        self._sum = self._sum_squares = self._jitter_max = self._latency_max = 0.0
        self._jitter = np.zeros(len(_BINS) + 1, dtype=np.int64)
        self._latency = np.zeros(len(_BINS) + 1, dtype=np.int64)
        self._last_ns: int | None = None
        self.overruns = self.pauses = 0

    def pause(self) -> None:
        """The next interval is a stop of the acquisition, not jitter."""
        if self._last_ns is not None:
            self.pauses += 1
        self._last_ns = None

    def add(
        self,
        time_ns: NDArray[np.int64],
        latency_ns: NDArray[np.int64] | None,
        flags: NDArray[np.uint16],
    ) -> None:
        """Count a block: stamps (n,), latencies (n,), None where they are not known, flags (n,)."""
        if not len(time_ns):
            return
        self._cycles += len(time_ns)
        if flags.any():
            for flag in CycleFlag:
                if flag:
                    self._flags[flag] += int(np.count_nonzero(flags & flag))
        last = self._last_ns
        intervals = np.diff(time_ns) if last is None else changes(time_ns, last)
        deviation = intervals.astype(np.float64) - self._cycle_ns
        self._last_ns = int(time_ns[-1])
        if len(deviation):
            self._intervals += len(deviation)
            self._sum += float(deviation.sum())
            self._sum_squares += float(np.dot(deviation, deviation))
            jitter = np.abs(deviation)
            self._jitter_max = max(self._jitter_max, float(jitter.max()))
            self._jitter += _histogram(jitter)
        if latency_ns is not None:
            self._latency_max = max(self._latency_max, float(latency_ns.max()))
            self._latency += _histogram(latency_ns)

    def report(self) -> AcquisitionReport:
        """The figures so far."""
        n = self._intervals
        mean = self._sum / n if n else 0.0
        period = self._cycle_ns + mean
        variance = max(0.0, self._sum_squares / n - mean * mean) if n else 0.0
        count = self._flags
        return AcquisitionReport(
            cycles=self._cycles,
            duration=n * period * 1e-9,
            nominal_rate=1e9 / self._cycle_ns,
            achieved_rate=1e9 / period if n and period > 0.0 else math.nan,
            jitter_rms=math.sqrt(variance) * 1e-9,
            jitter_p99=_percentile(self._jitter, 0.99),
            jitter_max=self._jitter_max * 1e-9,
            latency_p50=_percentile(self._latency, 0.5),
            latency_p99=_percentile(self._latency, 0.99),
            latency_max=self._latency_max * 1e-9,
            incomplete=count[CycleFlag.INCOMPLETE],
            late=count[CycleFlag.LATE],
            doubled=count[CycleFlag.DOUBLED],
            short=count[CycleFlag.SHORT],
            jumped=count[CycleFlag.JUMPED],
            signal_error=count[CycleFlag.SIGNAL_ERROR],
            saturated=count[CycleFlag.SATURATED],
            host_time=count[CycleFlag.HOST_TIME],
            overruns=self.overruns,
            pauses=self.pauses,
        )


def _histogram(times: NDArray[Any]) -> NDArray[np.int64]:
    """How many times [ns] (n,) lie between which edges, an edge itself below it; the last are those beyond all edges.

    The edges are looked up among the sorted times: there are fewer of them than times in a block.
    """
    below = np.searchsorted(np.sort(times), _BINS, side="right")
    return np.diff(below, prepend=0, append=len(times))


def _percentile(histogram: NDArray[np.int64], share: float) -> float:
    """The upper edge [s] of the bin in which the share is reached."""
    total = int(histogram.sum())
    if not total:
        return 0.0
    position = int(np.searchsorted(np.cumsum(histogram), math.ceil(share * total)))
    return float(_BINS[min(position, len(_BINS) - 1)]) * 1e-9
