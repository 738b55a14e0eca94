"""What a run file holds, in rows: its channels with their ranges, its segments, its events."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime

from experiments.recording import Event, Recording, Segment
from model.units import RPM
from rig.content.grid import Grid, columns, number_columns
from rig.content.phrase import phrase


def channel_ranges(recording: Recording) -> dict[str, tuple[float, float]]:
    """Smallest and largest SI value of every channel, in constant memory; NaN for a run without rows."""
    ranges: dict[str, tuple[float, float]] = {}
    for name in recording.signals:
        low, high = math.inf, -math.inf
        for block in recording.blocks():
            values = recording.si(name, block)
            low, high = min(low, float(values.min())), max(high, float(values.max()))
        ranges[name] = (low, high) if low <= high else (math.nan, math.nan)
    return ranges


def channel_grid(recording: Recording) -> Grid:
    """Every channel, what a count of it is worth, and the range of its values; reads the run from end to end."""
    rows = []
    for name, (low, high) in channel_ranges(recording).items():
        signal = recording.signals[name]
        quantum = phrase("{:.4g}", signal.quantum) or "–"
        rows.append((name, signal.long_name, signal.unit, quantum, f"{low:.6g}", f"{high:.6g}"))
    heads = columns("channel", "what", ("unit", "unit"))
    numbers = number_columns("one count", "minimum", "maximum")
    return Grid("Channels", (*heads, *numbers), rows)


def segment_grid(segments: Sequence[Segment], title: str = "Segments") -> Grid:
    """Labelled stretches of a run by their rows; a set-point that is a speed in revolutions per minute as well."""
    rows = [
        (
            str(one.index),
            one.label,
            str(one.start),
            str(one.stop),
            f"{one.setpoint:.6g}",
            phrase("{:.5g}", one.setpoint / RPM) or "–",
            f"{one.direction:+d}",
            str(one.repeat),
        )
        for one in segments
    ]
    headings = ("from row", "to row", "set-point (SI)", "r/min", "direction", "repeat")
    heads = (*columns(("#", "number"), ("label", "sentence")), *number_columns(*headings))
    return Grid(title, heads, rows)


def event_grid(events: Sequence[Event], first_ns: int = 0, title: str = "Events") -> Grid:
    """Events and notes by the time since the first row (of which `first_ns` is that of the clock), and by the clock."""
    rows = [
        (
            f"{(one.time_ns - first_ns) * 1e-9:.3f}",
            moment(one.time_ns)[11:23],
            one.level,
            one.source,
            one.code,
            one.text,
        )
        for one in events
    ]
    heads = columns(
        ("time [s]", "number"),
        ("time (UTC)", "unit"),
        ("level", "word"),
        "source",
        "code",
        ("what", "sentence"),
    )
    return Grid(title, heads, rows)


def moment(time_ns: int) -> str:
    """A time of the clock [ns since 1970] as ISO 8601 in UTC, to the millisecond."""
    time = datetime.fromtimestamp(time_ns // 1_000_000 / 1e3, UTC)
    return time.isoformat(timespec="milliseconds")
