"""Where angles are counted from: the index mark of the motor encoder where the run saw it, else the start of the run.

Phases of orders are stored against the index mark; without it they die with the power, and a
kinematic error cannot be carried to another run.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from experiments.recording import Recording
from experiments.steps.follow import whole_turns
from model.units import REVOLUTION

INPUT_SEEN = 1
OUTPUT_SEEN = 2


@dataclass(frozen=True)
class PhaseReference:
    """The input angle [rad] that counts as zero, and what it is: "index marks", "input index" or "start of the run".

    `gap`: how far behind the input's mark the output's lies, in input revolutions; NaN where it was not seen.
    """

    input_angle: float
    what: str
    gap: float = math.nan

    @property
    def carries(self) -> bool:
        """Whether phases against this reference mean the same in another run."""
        return self.what != "start of the run"

    def warnings(self) -> list[str]:
        """What must be said of phases against this reference."""
        if self.what == "start of the run":
            return [
                "No index mark was seen: phases count from the start of this run and cannot be carried to another."
            ]
        if self.what == "input index":
            return [
                "No output index mark was seen: phases of output orders and sidebands cannot be carried to another run."
            ]
        return []


def phase_reference(recording: Recording, gap: float | None = None) -> PhaseReference:
    """The input index mark; the one that precedes the output's index mark where both were seen.

    Whole orders repeat at every input mark. Output orders and sidebands do not, so that the output
    mark chooses the turn: the one behind it, or the one that is nearest to `gap` input revolutions away.
    """
    if not recording.has("input_index", "index_seen"):
        return PhaseReference(0.0, "start of the run")
    input_row, output_row = _first_rows(recording)
    if input_row is None:
        return PhaseReference(0.0, "start of the run")
    last = recording.rows
    mark = float(recording.si("input_index", slice(last - 1, last))[0])
    if output_row is None or not recording.has("output_index"):
        return PhaseReference(mark % REVOLUTION, "input index")
    here = float(recording.si("input_angle", slice(output_row, output_row + 1))[0])
    behind = (here - mark) / REVOLUTION
    turns = whole_turns(behind, gap)
    return PhaseReference(mark + turns * REVOLUTION, "index marks", behind - turns)


def _first_rows(recording: Recording) -> tuple[int | None, int | None]:
    """The first rows at which the input's and the output's mark had been seen."""
    rows_seen: list[int | None] = [None, None]
    for rows in recording.blocks(size=1 << 18):
        seen = recording.stored("index_seen", rows).astype(np.int64)
        for which, bit in enumerate((INPUT_SEEN, OUTPUT_SEEN)):
            if rows_seen[which] is None and (seen & bit).any():
                rows_seen[which] = rows.start + int(np.argmax((seen & bit) > 0))
        if None not in rows_seen:
            break
    return rows_seen[0], rows_seen[1]
