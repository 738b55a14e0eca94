"""Whether a run file can be trusted: its hash, its counters, its time, its flags, its segments, its calibrations."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Literal

import h5py
import numpy as np

from drivers.samples import CycleFlag
from experiments.recording import Recording
from rig.errors import RigError
from rig.runfile import layout
from rig.runfile.read import FileSource, open_run
from rig.runfile.seal import file_sha256, hash_path, recorded_sha256

Level = Literal["ok", "warning", "error"]
BLOCK_ROWS = 65536


@dataclass(frozen=True)
class Finding:
    """One check of a run file and what it found."""

    check: str
    level: Level
    text: str


def verify_run(path: str | Path) -> tuple[Finding, ...]:
    """Every check of a run file; an unreadable one is an error among the findings, not an exception."""
    path = Path(path)
    findings = [_check_hash(path)]
    try:
        recording = open_run(path, digest=False)
    except RigError as error:
        return (*findings, Finding("readable", "error", str(error)))
    source = recording.source
    assert isinstance(source, FileSource)
    with source:
        try:
            findings.append(
                Finding(
                    "readable", "ok", f"{recording.rows} rows of {len(recording.signals)} channels"
                )
            )
            findings.append(_check_counters(source))
            findings += _check_rows(source)
            findings.append(_check_segments(recording))
            findings += _check_calibrations(recording, source)
        except RigError as error:
            findings.append(Finding("readable", "error", str(error)))
    return tuple(findings)


def _check_hash(path: Path) -> Finding:
    if path.name.endswith(layout.PART_SUFFIX):
        return Finding(
            "hash",
            "warning",
            "the run is not sealed: still being written, or cut off (`rig recover`)",
        )
    noted = recorded_sha256(path)
    if not noted:
        return Finding(
            "hash", "warning", f"there is no {hash_path(path).name} beside the run to compare with"
        )
    try:
        computed = file_sha256(path)
    except RigError as error:
        return Finding("hash", "error", str(error))
    if computed != noted:
        return Finding(
            "hash", "error", f"SHA-256 is {computed}, sealed with {noted}: the file was changed"
        )
    return Finding("hash", "ok", f"SHA-256 {computed}")


def _check_counters(source: FileSource) -> Finding:
    with source.file() as file:
        process = file[layout.PROCESS]
        assert isinstance(process, h5py.Group)
        written = int(layout.read_number(process, "rows_written", -1))
        dropped = int(layout.read_number(process, "rows_dropped", 0))
    if written != source.rows and not source.grows:
        return Finding("rows", "error", f"{source.rows} rows, but the writer counted {written}")
    if dropped:
        return Finding(
            "rows", "warning", f"{source.rows} rows as counted; {dropped} cycles never became a row"
        )
    return Finding("rows", "ok", f"{source.rows} rows as counted, none dropped")


def _check_rows(source: FileSource) -> list[Finding]:
    """Cycle index, time and flags in one pass, in constant memory."""
    counted = dict.fromkeys(CycleFlag, 0)
    flagged = gaps = missing = backwards = 0
    first_backwards = -1
    last_cycle = last_time = None
    for first in range(0, source.rows, BLOCK_ROWS):
        stop = min(first + BLOCK_ROWS, source.rows)
        cycles, times, flags = (
            source.cycles(first, stop),
            source.time_ns(first, stop),
            source.flags(first, stop),
        )
        flagged += int(np.count_nonzero(flags & ~np.uint16(CycleFlag.HOST_TIME)))
        for flag in counted:
            counted[flag] += int(np.count_nonzero(flags & np.uint16(flag)))
        steps = np.diff(cycles, prepend=cycles[0] - 1 if last_cycle is None else last_cycle)
        gaps += int(np.count_nonzero(steps != 1))
        missing += int((steps - 1)[steps > 1].sum())
        runs = np.diff(times, prepend=times[0] - 1 if last_time is None else last_time)
        wrong = np.flatnonzero(runs <= 0)
        if len(wrong) and first_backwards < 0:
            first_backwards = first + int(wrong[0])
        backwards += len(wrong)
        last_cycle, last_time = cycles[-1], times[-1]
    parts = ", ".join(
        f"{str(flag.name).lower()} {count}" for flag, count in counted.items() if count
    )
    share = f"{flagged} of {source.rows} cycles flagged" + (f" ({parts})" if parts else "")
    return [
        Finding(
            "sequence",
            "warning" if gaps else "ok",
            f"{gaps} gaps in the cycle index, {missing} cycles missing"
            if gaps
            else "every cycle has its row",
        ),
        Finding(
            "time",
            "error" if backwards else "ok",
            f"time does not increase at {backwards} rows, first at row {first_backwards}"
            if backwards
            else "time increases from row to row",
        ),
        Finding("flags", "warning" if flagged else "ok", share),
    ]


def _check_segments(recording: Recording) -> Finding:
    outside = [s for s in recording.segments if s.stop > recording.rows]
    if outside:
        text = f"segment {outside[0].index} ({outside[0].label}) ends at row {outside[0].stop} of {recording.rows}"
        return Finding("segments", "error", text)
    return Finding("segments", "ok", f"{len(recording.segments)} segments within the rows")


def _check_calibrations(recording: Recording, source: FileSource) -> list[Finding]:
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
    findings = []
    if overdue:
        findings.append(
            Finding("calibration", "warning", "overdue when it was recorded: " + ", ".join(overdue))
        )
    if undated:
        findings.append(
            Finding("calibration", "warning", "due date is no ISO date: " + ", ".join(undated))
        )
    return findings or [
        Finding("calibration", "ok", "no calibration was overdue when it was recorded")
    ]
