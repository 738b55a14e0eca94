"""Labelled stretches of a foreign recording: by a table of times, by a column, by set-points."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from experiments.recording import Segment
from rig.errors import ConfigurationError
from rig.runfile.importing.channel_map import ForeignSegment, SegmentsFrom

_MOST_WORDS = 1000
"""Different words in a column of labels; more are numbers that were measured."""


class TimedSegments:
    """Segments given in seconds since the first row, found as rows while the recording passes by."""

    def __init__(self, wanted: Sequence[ForeignSegment]) -> None:
        self._wanted = wanted
        self._edges = [[0, 0] for _ in wanted]

    def see(self, times_ns: NDArray[np.int64], first_ns: int) -> None:
        """The next rows of the recording."""
        for edges, segment in zip(self._edges, self._wanted, strict=True):
            for side, seconds in enumerate((segment.start, segment.stop)):
                edges[side] += int(np.searchsorted(times_ns, first_ns + round(seconds * 1e9)))

    def segments(self, rows: int) -> Iterator[Segment]:
        """The segments as rows. Raises `ConfigurationError` for one that has none."""
        for index, (wanted, (start, stop)) in enumerate(
            zip(self._wanted, self._edges, strict=True)
        ):
            if not start < stop <= rows:
                raise ConfigurationError(
                    "the segment has no rows",
                    where=f"segments[{index}] {wanted.label}",
                    value=f"{wanted.start:g} to {wanted.stop:g} s",
                    limit="seconds within the recording",
                )
            yield Segment(
                index=index,
                label=wanted.label,
                start=start,
                stop=stop,
                setpoint=wanted.setpoint,
                direction=wanted.direction,
                repeat=wanted.repeat,
            )


@dataclass
class Words:
    """A column of words as codes: the same word, the same code."""

    codes: dict[str, int] = field(default_factory=dict)

    def read(self, text: str) -> float:
        """The code of a word; `ValueError` where there are too many."""
        code = self.codes.setdefault(text.strip('"'), len(self.codes))
        if code > _MOST_WORDS:
            raise ValueError("more different labels than a recording has segments")
        return float(code)

    def word(self, code: float) -> str:
        """The word of a code; the number itself where the column is one of numbers."""
        if not self.codes:
            return f"{code:g}"
        return list(self.codes)[int(code)]


@dataclass(frozen=True)
class MotionInterval:
    """Rows [start, stop) with one value in the deciding column, seconds between first and last, turned angle."""

    value: float
    start: int
    stop: int
    seconds: float
    turned: float


class SteadyStretches:
    """The stretches of rows in which a column keeps its value, found while the recording passes by."""

    def __init__(self) -> None:
        self._row = 0
        self._open: tuple[float, int, int, float] | None = None
        self._latest = (0, 0.0)
        self.found: list[MotionInterval] = []

    def see(
        self,
        values: NDArray[np.float64],
        times_ns: NDArray[np.int64],
        angle: NDArray[np.float64] | None,
    ) -> None:
        """The next rows: the deciding column, the time, and the angle that tells the direction."""
        turned = np.zeros(len(values)) if angle is None else angle
        starts = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)
        if self._open is not None and values[0] == self._open[0]:
            starts = starts[1:]
        for start in starts:
            before = self._latest if start == 0 else (int(times_ns[start - 1]), turned[start - 1])
            self._close(self._row + int(start), *before)
            at = self._row + int(start)
            self._open = (float(values[start]), at, int(times_ns[start]), float(turned[start]))
        self._row += len(values)
        self._latest = (int(times_ns[-1]), float(turned[-1]))

    def _close(self, stop: int, time_ns: int, angle: float) -> None:
        if self._open is not None:
            value, start, begin_ns, begin_angle = self._open
            seconds = (time_ns - begin_ns) * 1e-9
            self.found.append(
                MotionInterval(value, start, stop, seconds, float(angle) - begin_angle)
            )

    def segments(self, wanted: SegmentsFrom, words: Words) -> list[Segment]:
        """The stretches with labels: set-points other than 0 that last, or the labelled words of a column.

        Where a column labels the rows, the set-point is the mean speed of the stretch. Raises
        `ConfigurationError` where nothing is labelled.
        """
        self._close(self._row, *self._latest)
        self._open = None
        segments: list[Segment] = []
        repeats: dict[tuple[str, float], int] = {}
        for stretch in self.found:
            label = self._label(stretch, wanted, words)
            if not label or stretch.stop - stretch.start < 2:
                continue
            speed = stretch.turned / stretch.seconds if stretch.seconds > 0.0 else 0.0
            setpoint, alike = speed, float(np.sign(speed))
            if wanted.setpoint:
                setpoint, alike = stretch.value, round(stretch.value, 9)
            key = (label, alike)
            repeats[key] = repeats.get(key, -1) + 1
            segments.append(
                Segment(
                    index=len(segments),
                    label=label,
                    start=stretch.start,
                    stop=stretch.stop,
                    setpoint=setpoint,
                    direction=int(np.sign(setpoint)),
                    repeat=repeats[key],
                )
            )
        if not segments:
            seen = sorted({words.word(s.value) for s in self.found})[:8]
            raise ConfigurationError(
                "nothing in the recording is labelled",
                where="segments_from",
                value=", ".join(seen),
                limit=", ".join(wanted.labels) or f"stretches of {wanted.least_s:g} s and more",
            )
        return segments

    @staticmethod
    def _label(stretch: MotionInterval, wanted: SegmentsFrom, words: Words) -> str:
        if wanted.setpoint:
            return wanted.label if stretch.value and stretch.seconds >= wanted.least_s else ""
        word = words.word(stretch.value)
        return wanted.labels.get(word, "") if wanted.labels else word
