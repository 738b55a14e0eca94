"""A recording in which one channel is wrong by a stated amount, all else as it was; and which channels are read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.evidence.channel_doubt import Part, cycle_of
from experiments.evidence.holds import ZERO_AFTER, ZERO_BEFORE
from experiments.recording import Recording, SignalSource
from model.arrays import FloatArray, IntArray
from model.channel import Channel

Change = Callable[[NDArray[Any], int], NDArray[Any]]
"""Stored numbers of a channel and the row of the first of them: the same, changed."""


@dataclass(frozen=True)
class Moved:
    """The recording, and how many standard uncertainties of the doubt it is moved by."""

    recording: Recording
    by: float = 1.0


def moved(recording: Recording, channel: str, part: Part, size: float, phase: float = 0.0) -> Moved:
    """The recording with one channel wrong by `size`: relative for a scale, s for a delay, in the channel's unit else.

    `phase` [rad] of a curve. A delay is moved by whole rows, so that the noise stays what it is.
    """
    signal = recording.signals[channel]
    if part is Part.SCALE:
        factor = 1.0 + size
        other = replace(signal, scale=factor * signal.scale, offset=factor * signal.offset)
        return Moved(_with_channel(recording, other))
    if part is Part.OFFSET:
        return Moved(_with_channel(recording, replace(signal, offset=signal.offset + size)))
    if part is Part.DELAY:
        rows = max(1, round(size / cycle_of(recording)))
        late = _with_source(recording, channel, _late(recording, channel, rows))
        return Moved(late, rows * cycle_of(recording) / size)
    if part is Part.CURVE:
        return Moved(_with_source(recording, channel, _wave(signal, size, phase)))
    return Moved(_with_source(recording, channel, _beside_zeros(recording, size / signal.gain)))


def _with_channel(recording: Recording, signal: Channel) -> Recording:
    return replace(recording, signals={**recording.signals, signal.name: signal})


def _with_source(recording: Recording, channel: str, change: Change) -> Recording:
    return replace(recording, source=_Changed(recording.source, channel, change))


def _late(recording: Recording, channel: str, rows: int) -> Change:
    def late(values: NDArray[Any], start: int) -> NDArray[Any]:
        stop = start + len(values)
        first = max(start - rows, 0)
        before = recording.source.stored(channel, first, max(stop - rows, first + 1))
        missing = len(values) - len(before)
        return np.concatenate([np.repeat(before[:1], max(missing, 0)), before])[: len(values)]

    return late


def _wave(signal: Channel, size: float, phase: float) -> Change:
    def wave(values: NDArray[Any], start: int) -> NDArray[Any]:
        return values + size / signal.gain * np.sin(signal.to_si(values) + phase)

    return wave


def _beside_zeros(recording: Recording, counts: float) -> Change:
    zeros = recording.labelled(ZERO_BEFORE, ZERO_AFTER)

    def beside(values: NDArray[Any], start: int) -> NDArray[Any]:
        rows = np.arange(start, start + len(values))
        added: FloatArray = np.full(len(values), counts)
        for zero in zeros:
            added[(rows >= zero.start) & (rows < zero.stop)] = 0.0
        return values + added

    return beside


@dataclass(frozen=True)
class _Passed:
    """A source that hands on what another has; what a file knows beyond (its cycles) too."""

    inner: SignalSource

    @property
    def rows(self) -> int:
        return self.inner.rows

    def stored(self, name: str, start: int, stop: int) -> NDArray[Any]:
        return self.inner.stored(name, start, stop)

    def time_ns(self, start: int, stop: int) -> IntArray:
        return self.inner.time_ns(start, stop)

    def flags(self, start: int, stop: int) -> NDArray[np.uint16]:
        return self.inner.flags(start, stop)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self.inner, name)


@dataclass(frozen=True)
class _Changed(_Passed):
    """With the stored numbers of one channel changed."""

    channel: str
    change: Change

    def stored(self, name: str, start: int, stop: int) -> NDArray[Any]:
        values = self.inner.stored(name, start, stop)
        return self.change(values, start) if name == self.channel else values


@dataclass(frozen=True)
class Noting(_Passed):
    """A source that notes which channels are read."""

    names: list[str] = field(default_factory=list[str])

    def stored(self, name: str, start: int, stop: int) -> NDArray[Any]:
        if name not in self.names:
            self.names.append(name)
        return self.inner.stored(name, start, stop)
