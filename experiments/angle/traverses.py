"""Traversees of a recording without segments: where the input turns one way, found from the angle itself.

Recordings of this program carry segments, and those are used. One that was imported does not: here
it is cut where the input stops or turns back, in pieces of constant memory, and the first
revolution after each reversal is left out (wind-up).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from experiments.evidence import BAD_CYCLE
from experiments.recording import Recording, Segment
from model.arrays import FloatArray, IntArray
from model.units import REVOLUTION

PIECES = 20000
"""A recording is looked at in at most this many pieces."""
LEAST_ROWS = 20


def traverses_of(
    recording: Recording, label: str = "traverse", approach: float = 1.0
) -> tuple[Segment, ...]:
    """Segments in which the input turns one way, each without its first `approach` revolutions.

    A piece belongs to a traverse if it moves in its direction, by more than what flickering counts look like.
    """
    size = max(LEAST_ROWS, recording.rows // PIECES)
    starts = np.arange(0, recording.rows - size + 1, size)
    if len(starts) == 0:
        return ()
    edges = _angles(recording, np.append(starts, starts[-1] + size - 1))
    segments: list[Segment] = []
    repeats = {1: 0, -1: 0}
    for begin, end, sense in _stretches(recording, edges):
        trimmed = _trimmed(
            recording,
            edges,
            starts=starts,
            begin=begin,
            end=end,
            size=size,
            sense=sense,
            approach=approach,
        )
        if trimmed is None:
            continue
        start, stop, speed = trimmed
        segments.append(
            Segment(
                index=len(segments),
                label=label,
                start=start,
                stop=stop,
                setpoint=speed,
                direction=sense,
                repeat=repeats[sense],
            )
        )
        repeats[sense] += 1
    return tuple(segments)


def _stretches(recording: Recording, edges: FloatArray) -> Iterator[tuple[int, int, int]]:
    """First piece, the piece after the last, and the sense of every run of pieces that turn one way; `edges` are the
    input angles [rad] at which pieces begin.
    """
    moved = np.diff(edges)
    still = max(
        3.0 * recording.signals["input_angle"].quantum, 1e-4 * float(np.abs(moved).max(initial=0.0))
    )
    direction = np.where(np.abs(moved) > still, np.sign(moved), 0.0).astype(int)
    begin = 0
    for end in range(1, len(direction) + 1):
        if end < len(direction) and direction[end] == direction[begin]:
            continue
        if direction[begin] != 0:
            yield begin, end, int(direction[begin])
        begin = end


def _trimmed(
    recording: Recording,
    edges: FloatArray,
    starts: IntArray,
    begin: int,
    end: int,
    size: int,
    sense: int,
    approach: float,
) -> tuple[int, int, float] | None:
    """Rows of a traverse without its approach, and its mean speed [rad/s]; None where too little is left."""
    travelled = sense * (edges[begin : end + 1] - edges[begin])
    first = begin + int(np.searchsorted(travelled, approach * REVOLUTION)) if begin > 0 else begin
    if first >= end or sense * (edges[end] - edges[first]) < REVOLUTION:
        return None
    start, stop = int(starts[first]), int(min(starts[end - 1] + size, recording.rows))
    time = recording.time(slice(start, start + 1))[0], recording.time(slice(stop - 1, stop))[0]
    duration = float(time[1] - time[0])
    speed = float(edges[end] - edges[first]) / duration if duration > 0.0 else 0.0
    return start, stop, speed


def _angles(recording: Recording, rows: IntArray) -> FloatArray:
    """The input angle [rad] at these ascending rows; an unusable cycle takes the usable one before it."""
    out = np.empty(len(rows))
    last = 0.0
    for part in recording.blocks(size=1 << 17):
        low, high = np.searchsorted(rows, [part.start, part.stop]).tolist()
        if low == high:
            continue
        angle = recording.si("input_angle", part)
        good = np.flatnonzero((recording.flags(part) & BAD_CYCLE) == 0)
        out[low:high] = last
        if len(good):
            at = np.searchsorted(good, rows[low:high] - int(part.start), side="right") - 1
            out[low:high] = np.where(at >= 0, angle[good[np.maximum(at, 0)]], last)
        last = float(out[high - 1])
    return out
