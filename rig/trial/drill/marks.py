"""What the run file of a drill says: whether it can be read, what its cycles are marked with, and
whether wrong counts stand there unmarked.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.samples import CycleFlag
from experiments.recording import Recording
from rig.content.phrase import phrase
from rig.errors import RigError
from rig.run.parts import RunReport
from rig.runfile.layout import PART_SUFFIX
from rig.runfile.read import close_recording, open_run
from rig.runfile.recover import recover_run
from rig.trial.drill.cause import marked


@dataclass(frozen=True)
class Marks:
    """What the cycles of a file are marked with in words and as causes, how long after the onset
    the first mark is, and how many counts are wrong unmarked.
    """

    words: str
    causes: tuple[str, ...] = ()
    after: int = 0
    wrong: int = 0


def look_at_file(
    report: RunReport, row: int, reference: Mapping[str, NDArray[np.int64]]
) -> tuple[bool, Marks]:
    """Whether the file of a run can be read and has the rows that it must, and what its cycles are marked with."""
    path = report.path
    try:
        if path.name.endswith(".part"):
            path = recover_run(path).path
        recording = open_run(path, verify=True)
    except RigError as error:
        return False, Marks(str(error))
    try:
        whole = (
            recording.rows == report.rows if report.readable else 0 < recording.rows <= report.rows
        )
        fits = recording.metadata.outcome in (report.outcome, "INTERRUPTED")
        has_rows = len(recording.si("input_angle")) == recording.rows
        return whole and fits and has_rows, _marks(recording, row, reference)
    finally:
        close_recording(recording)


def left_readable(folder: Path) -> bool:
    """Whether every file that a run left which ended in an exception can be read, recovered where it was cut off."""
    try:
        for part in sorted(folder.glob(f"*{PART_SUFFIX}")):
            recover_run(part)
        for path in sorted(folder.glob("*.h5")):
            recording = open_run(path, verify=True)
            try:
                recording.si("input_angle")
            finally:
                close_recording(recording)
    except RigError:
        return False
    return True


def _marks(recording: Recording, row: int, reference: Mapping[str, NDArray[np.int64]]) -> Marks:
    flags = recording.flags()
    counted = [(flag, int(np.count_nonzero(flags & flag))) for flag in CycleFlag if flag]
    counted = [(flag, count) for flag, count in counted if count]
    rows = np.flatnonzero(flags)
    wrong = _wrong_unmarked(recording, flags, reference) if reference else 0
    words = ", ".join(f"{count} x {flag.name}" for flag, count in counted)
    text = phrase("marked {}", words) or "nothing to detect: counts are right"
    text = phrase("{} WRONG COUNTS NOT MARKED; ", wrong) + text
    after = max(int(rows[0]) - row, 0) if len(rows) else 0
    return Marks(text, tuple(marked(flag) for flag, _ in counted), after, wrong)


def _wrong_unmarked(
    recording: Recording, flags: NDArray[np.uint16], reference: Mapping[str, NDArray[np.int64]]
) -> int:
    """Cycles without a mark whose counts differ from those of the run without the fault."""
    rows = min(len(flags), *(len(counts) for counts in reference.values()))
    differs = np.zeros(rows, dtype=bool)
    for name, counts in reference.items():
        found, origin = recording.stored(name)[:rows], name.endswith("angle")
        # A counter may begin elsewhere; how far it has turned is what counts.
        differs |= found - origin * found[0] != counts[:rows] - origin * counts[0]
    return int(np.count_nonzero(differs & (flags[:rows] == 0)))
