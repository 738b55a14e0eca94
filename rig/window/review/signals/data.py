"""The channels of a run thinned to what a screen shows: smallest and largest value per pixel, in constant memory."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.samples import CycleFlag
from experiments.recording import Recording
from model.unit_text import scale_in
from rig.window.work.live_file import Block, Envelope, SlidingSpeed

FloatArray = NDArray[np.float64]
BLOCK = 65536
"""Rows that are read at once."""
BINS = 2048
"""Bins per channel over the stretch that is shown."""
FIRST_LOOK = 600_000
"""Rows that are read before something is drawn: ten minutes at 1 kHz."""
_PIECE = 8192
"""Rows in one piece where only some are read; the writer's files keep as many together."""
_LEAD = 0.03
"""s before a stretch that are read too: a speed is the difference of an angle over a little time."""
SPEEDS = {"input_speed": "input_angle", "output_speed": "output_angle"}
"""Speeds that no channel holds and that follow from an angle."""
LABORATORY, SI = "laboratory units", "SI units"
"""The two ways in which all signals are drawn."""
_READ_IN = {"rad/s": "r/min", "rad": "deg"}
"""What a laboratory reads in place of an SI unit; every other unit is read as it is."""


@dataclass(frozen=True)
class Shape:
    """One channel over one stretch: times since the first row [s] and values in `unit`."""

    name: str
    unit: str
    time: FloatArray
    values: FloatArray


def drawn_in(si: str, units: str) -> tuple[float, str]:
    """In which unit something in this SI unit is drawn, and how much of the SI unit one of it is."""
    unit = _READ_IN.get(si, si) if units == LABORATORY else si
    return scale_in(unit, si) or 1.0, unit


def channels_of(recording: Recording, units: str = LABORATORY) -> dict[str, tuple[str, str]]:
    """What can be drawn: name, what it is, unit. Speeds first, then the channels as they were recorded."""
    channels = {
        name: (f"{name.replace('_', ' ')}, from the angle", drawn_in("rad/s", units)[1])
        for name, angle in SPEEDS.items()
        if recording.has(angle) and np.isfinite(recording.metadata.sample_rate)
    }
    for name, signal in recording.signals.items():
        unit = drawn_in(signal.unit, units)[1]
        channels[name] = (signal.long_name or name.replace("_", " "), unit)
    return channels


def duration_of(recording: Recording) -> float:
    """Time from the first to the last row [s]."""
    if recording.rows:
        return float(recording.time(slice(recording.rows - 1, recording.rows))[0])
    return 0.0


def row_at(recording: Recording, moment: float) -> int:
    """The first row at or after a time since the first row [s]; the number of rows after the last one."""
    low, high = 0, recording.rows
    while low < high:
        middle = (low + high) // 2
        if float(recording.time(slice(middle, middle + 1))[0]) < moment:
            low = middle + 1
        else:
            high = middle
    return low


def rows_between(recording: Recording, begin: float, end: float) -> slice:
    """The rows between two times [s], one more on either side, and those before that a speed needs."""
    start = max(row_at(recording, begin - _LEAD) - 1, 0)
    return slice(start, min(row_at(recording, end) + 1, recording.rows))


def thinning(rows: int) -> int:
    """Of how many pieces one is read for a first look at so many rows: 1 where all of them are read at once."""
    return max(math.ceil(rows / FIRST_LOOK), 1)


def shapes_of(
    recording: Recording,
    names: list[str],
    rows: slice,
    bins: int = BINS,
    units: str = LABORATORY,
    thinned: int = 1,
) -> list[Shape]:
    """These channels over these rows. Of `thinned` pieces of rows one is read: what lies between is not seen."""
    channels = channels_of(recording, units)
    envelopes = {name: Envelope(bins) for name in names if name in channels}
    speeds = {
        name: SlidingSpeed(1.0 / recording.metadata.sample_rate)
        for name in envelopes
        if name in SPEEDS
    }
    for block in _blocks(recording, [*envelopes], rows, thinned):
        for name, envelope in envelopes.items():
            if name in speeds:
                stamps, values = speeds[name].of(block, SPEEDS[name])
            else:
                stamps, values = block.time, block.si[name]
            envelope.add(stamps, values / unit_factor(recording, name, units))
    return [
        Shape(name, channels[name][1], *envelope.curve()) for name, envelope in envelopes.items()
    ]


class Speed:
    """A speed of `SPEEDS` row by row [rad/s]: NaN in an incomplete row, and before there is a difference to take.

    Blocks are asked for in their order, from `start` on; the rows just before it are read too.
    """

    def __init__(self, recording: Recording, name: str, start: int) -> None:
        self._recording, self._angle = recording, SPEEDS[name]
        rate = recording.metadata.sample_rate
        self._sliding = SlidingSpeed(1.0 / rate)
        self.of(slice(max(start - 1 - math.ceil(_LEAD * rate), 0), start))

    def of(self, rows: slice) -> FloatArray:
        """The speed in each of these rows [rad/s]."""
        block = _block(self._recording, {self._angle}, rows)
        _, speeds = self._sliding.of(block, self._angle)
        along = np.full(len(block), np.nan)
        complete = np.flatnonzero(block.good)
        along[complete[len(complete) - len(speeds) :]] = speeds
        return along


def unit_factor(recording: Recording, name: str, units: str) -> float:
    """SI value of one unit in which a channel is drawn."""
    return drawn_in("rad/s" if name in SPEEDS else recording.signals[name].unit, units)[0]


def values_at(recording: Recording, names: list[str], moment: float) -> dict[str, float]:
    """The recorded channels at a time: of the row before it."""
    row = max(row_at(recording, moment) - 1, 0)
    if not recording.rows:
        return {}
    return {
        name: float(recording.si(name, slice(row, row + 1))[0])
        for name in names
        if name in recording.signals
    }


def _blocks(recording: Recording, names: list[str], rows: slice, thinned: int) -> Iterator[Block]:
    wanted = {SPEEDS.get(name, name) for name in names}
    size = BLOCK if thinned == 1 else _PIECE
    for place, part in enumerate(recording.blocks(rows, size=size)):
        if place % thinned == 0:
            yield _block(recording, wanted, part)


def _block(recording: Recording, names: Iterable[str], rows: slice) -> Block:
    good = (recording.flags(rows) & CycleFlag.INCOMPLETE) == 0
    channels = {name: recording.si(name, rows) for name in names}
    return Block(rows.start, recording.time(rows), channels, good)
