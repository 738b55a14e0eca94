"""Whether the content of a run can be believed: one list of checks, for `rig verify` and for every reader.

`rig verify` shows what each check found; whoever opens a run to work with it is refused at the
first error. A warning is worth knowing and stops nobody.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from datetime import date
from typing import Final

import h5py
import numpy as np

from drivers.samples import CycleFlag
from experiments.finding import Finding, Severity, first_blocking, passed_if
from experiments.recording import Recording
from rig.content.phrase import phrase
from rig.errors import RunFileError
from rig.runfile import layout
from rig.runfile.header import ORIGIN_WORDS
from rig.runfile.source import FileSource

BLOCK_ROWS = 65536
LARGEST_RATE, SMALLEST_RATE = 1e9, 1e-9
"""Hz; the time stamps count nanoseconds, and end after centuries."""
_ORIGINS_OF_BACKEND: Final[dict[str, tuple[str, ...]]] = {
    "sim": ("simulated",),
    "wire": ("simulated",),
    "wire-box": ("simulated",),
    "wire-csp": ("simulated",),
    "wire-analog": ("simulated",),
    "hardware": ("hardware", "simulated"),
    "replay": ("replay",),
    "import": ("imported",),
}
"""What a run of each rig can be; the drivers of the hardware also reach a simulated bench."""
LEVELS: Final = {
    Severity.PASSED: "ok",
    Severity.NOT_LOOKED_AT: "warning",
    Severity.NOTES: "ok",
    Severity.WARNS: "warning",
    Severity.BLOCKS: "error",
}
"""The words of `rig verify --json` for how a check came out."""
SIMULATED: Final = "simulated"
"""How certificates and models of simulated instruments begin."""


def findings_of(
    recording: Recording, source: FileSource, *, rows: bool = True
) -> Iterator[Finding]:
    """What the checks find, one after the other; without `rows` those that read no row. Raises
    `RunFileError` for rows that cannot be read.
    """
    for check in CHECKS:
        if rows or check not in _READ_ROWS:
            yield from check(recording, source)


def require_sound(recording: Recording, source: FileSource, *, rows: bool = True) -> None:
    """Raise `RunFileError` at the first check that finds an error."""
    blocking = first_blocking(findings_of(recording, source, rows=rows))
    if blocking is not None:
        raise RunFileError(
            blocking.sentence,
            where=str(source.path),
            remedy="Such a run is not used: take the original; `rig verify` shows every check.",
        )


def _check_counters(_: Recording, source: FileSource) -> Iterator[Finding]:
    with source.file() as file:
        process = file[layout.PROCESS]
        assert isinstance(process, h5py.Group)
        written = int(layout.read_number(process, "rows_written", -1))
        dropped = int(layout.read_number(process, "rows_dropped", 0))
    if written != source.rows and not source.grows:
        yield Finding(
            "rows", Severity.BLOCKS, f"{source.rows} rows, but the writer counted {written}"
        )
    elif dropped:
        yield Finding(
            "rows",
            Severity.WARNS,
            f"{source.rows} rows as counted; {dropped} cycles never became a row",
        )
    else:
        yield Finding("rows", Severity.PASSED, f"{source.rows} rows as counted, none dropped")


def _check_numbers(recording: Recording, _: FileSource) -> Iterator[Finding]:
    """Ratio and sample rate: what every analysis divides by."""
    m = recording.metadata
    may_be_unknown = {
        "ratio": m.origin == "imported" or not m.gear_mounted,
        "rate": m.time_base == "none",
    }
    wrong = []
    if not (math.isfinite(m.ratio) and m.ratio > 0.0) and not (
        math.isnan(m.ratio) and may_be_unknown["ratio"]
    ):
        wrong.append(f"the ratio of the gear is {m.ratio:g}")
    if not SMALLEST_RATE <= m.sample_rate <= LARGEST_RATE and not (
        math.isnan(m.sample_rate) and may_be_unknown["rate"]
    ):
        wrong.append(f"the sample rate is {m.sample_rate:g} Hz")
    yield passed_if("numbers", not wrong, "; ".join(wrong) or "ratio and sample rate can be used")


def _check_origin(recording: Recording, source: FileSource) -> Iterator[Finding]:
    """Whether the file agrees with itself about where it comes from."""
    m = recording.metadata
    backend = str(m.process.get("backend", "")).partition(":")[0]
    with source.file() as file:
        process = file[layout.PROCESS]
        assert isinstance(process, h5py.Group)
        mark = layout.read_text(process, "origin_mark")
    wrong = []
    if m.origin not in _ORIGINS_OF_BACKEND.get(backend, (m.origin,)):
        wrong.append(f"it says {m.origin}, but was made by the backend {backend}")
    if mark != ORIGIN_WORDS[m.origin]:
        wrong.append(f"it says {m.origin}, but is marked {mark or 'as from hardware'}")
    if m.origin == "hardware":
        instruments = [
            name
            for name, channel in recording.signals.items()
            if SIMULATED in (channel.model, channel.calibration.certificate.partition(" ")[0])
        ]
        if instruments:
            wrong.append(f"it says hardware, but simulated: {', '.join(instruments)}")
        if "truth" in m.process:
            wrong.append("it says hardware, but holds the truth of a simulated gear")
    fine = f"{m.origin}, and nothing in it says otherwise"
    yield passed_if("origin", not wrong, "; ".join(wrong) or fine)


def _check_rows(_: Recording, source: FileSource) -> Iterator[Finding]:
    """Cycle index, time and flags in one pass, in constant memory."""
    counted = dict.fromkeys(CycleFlag, 0)
    flagged = gaps = missing = backwards = 0
    first_backwards = -1
    cycle_before, time_before = source.cycles(0, 1) - 1, source.time_ns(0, 1) - 1
    for first in range(0, source.rows, BLOCK_ROWS):
        stop = min(first + BLOCK_ROWS, source.rows)
        cycles, times, flags = (
            source.cycles(first, stop),
            source.time_ns(first, stop),
            source.flags(first, stop),
        )
        if flags.any():
            flagged += int(np.count_nonzero(flags & ~np.uint16(CycleFlag.HOST_TIME)))
            for flag in counted:
                counted[flag] += int(np.count_nonzero(flags & np.uint16(flag)))
        steps = np.diff(cycles, prepend=cycle_before)
        gaps += int(np.count_nonzero(steps != 1))
        missing += int((steps - 1)[steps > 1].sum())
        runs = np.diff(times, prepend=time_before)
        wrong = np.flatnonzero(runs <= 0)
        if len(wrong) and first_backwards < 0:
            first_backwards = first + int(wrong[0])
        backwards += len(wrong)
        cycle_before, time_before = cycles[-1:], times[-1:]
    parts = ", ".join(
        f"{str(flag.name).lower()} {count}" for flag, count in counted.items() if count
    )
    share = f"{flagged} of {source.rows} cycles flagged{phrase(' ({})', parts)}"
    holes = phrase("{} gaps in the cycle index, {} cycles missing", gaps, missing)
    yield passed_if(
        "sequence", not gaps, holes or "every cycle has its row", otherwise=Severity.WARNS
    )
    turned = phrase(
        "time does not increase at {} rows, first at row {}", backwards, first_backwards
    )
    yield passed_if("time", not backwards, turned or "time increases from row to row")
    yield passed_if("flags", not flagged, share, otherwise=Severity.WARNS)


def _check_columns(_: Recording, source: FileSource) -> Iterator[Finding]:
    """Every channel to its end, in constant memory; what cannot be read is an error of the source."""
    wrong = []
    for column in source.columns:
        unusable = 0
        for first in range(0, source.rows, BLOCK_ROWS):
            stored = source.stored(column.name, first, min(first + BLOCK_ROWS, source.rows))
            if column.dtype == "float64":
                unusable += int(np.count_nonzero(~np.isfinite(stored)))
        if unusable:
            wrong.append(f"{column.name} has {unusable} values that are no numbers")
    yield passed_if(
        "channels", not wrong, "; ".join(wrong) or "every channel can be read to its end"
    )


def _check_segments(recording: Recording, source: FileSource) -> Iterator[Finding]:
    outside = [s for s in recording.segments if s.stop > recording.rows]
    if outside:
        text = f"segment {outside[0].index} ({outside[0].label}) ends at row {outside[0].stop} of {recording.rows}"
        # Of a run that is cut off the table may be ahead of the rows: recovering cuts it.
        yield Finding("segments", Severity.WARNS if source.grows else Severity.BLOCKS, text)
    else:
        yield Finding(
            "segments", Severity.PASSED, f"{len(recording.segments)} segments within the rows"
        )


def _check_calibrations(recording: Recording, source: FileSource) -> Iterator[Finding]:
    day = recording.metadata.start_time[:10]
    overdue, undated = [], []
    for column in source.columns:
        due = column.channel.calibration.due
        try:
            late = bool(due and day) and date.fromisoformat(due[:10]) < date.fromisoformat(day)
        except ValueError:
            undated.append(f"{column.name} ({due})")
            continue
        if late:
            overdue.append(f"{column.name} (due {due})")
    if overdue:
        yield Finding(
            "calibration", Severity.WARNS, "overdue when it was recorded: " + ", ".join(overdue)
        )
    if undated:
        yield Finding(
            "calibration", Severity.WARNS, "due date is no ISO date: " + ", ".join(undated)
        )
    if not overdue and not undated:
        yield Finding(
            "calibration", Severity.PASSED, "no calibration was overdue when it was recorded"
        )


_Check = Callable[[Recording, FileSource], Iterator[Finding]]
CHECKS: Final[tuple[_Check, ...]] = (
    _check_counters,
    _check_rows,
    _check_segments,
    _check_calibrations,
    _check_numbers,
    _check_origin,
    _check_columns,
)
_READ_ROWS: Final = (_check_rows, _check_columns)
