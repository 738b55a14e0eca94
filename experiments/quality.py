"""What a recording must be before anything is computed from it: complete cycles, a true time base, a few rows, known units."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from experiments.errors import AnalysisError
from experiments.recording import Recording, Segment

BAD_CYCLE = 1 | 8 | 16 | 32
"""Flags of a cycle whose values cannot be used: incomplete, short frame, jumped, device says not valid."""
SATURATED = 64
"""Flag of a cycle in which the analogue input was at the end of its range."""

TRUE_TIME = ("hardware", "device", "virtual")
"""Time bases in which every cycle carries its own stamp from SYNC or device."""


@dataclass(frozen=True)
class Checked:
    """What was found of a recording's quality: usable and unusable cycles, and what has to be said about them."""

    cycles: int
    missed: int
    warnings: tuple[str, ...]

    @property
    def missed_share(self) -> float:
        """Share of cycles that cannot be used."""
        return self.missed / self.cycles if self.cycles else 0.0


def check_recording(recording: Recording, purpose: str, maximum_missed_share: float, least_rows: int = 100) -> Checked:
    """Refuse an empty or too short recording and one with too many missed cycles; return what must be said otherwise."""
    where = recording.metadata.run_id
    if recording.rows < least_rows:
        raise AnalysisError(
            f"the recording is too short for {purpose}",
            where=where,
            value=f"{recording.rows} cycles",
            limit=f">= {least_rows} cycles",
            remedy="Record longer.",
        )
    missed = saturated = 0
    for rows in recording.blocks(size=1 << 20):
        flags = recording.flags(rows)
        missed += int(np.count_nonzero(flags & BAD_CYCLE))
        saturated += int(np.count_nonzero(flags & SATURATED))
    share = missed / recording.rows
    if share > maximum_missed_share:
        raise AnalysisError(
            "too many cycles were missed for a result that can be trusted",
            where=where,
            value=f"{missed} of {recording.rows} ({100.0 * share:.3g} %)",
            limit=f"<= {100.0 * maximum_missed_share:g} %",
            remedy="Repair the acquisition and repeat the run.",
        )
    warnings = []
    if missed:
        warnings.append(f"{missed} of {recording.rows} cycles are incomplete and were left out.")
    if saturated:
        warnings.append(
            f"The torque input was at the end of its range in {saturated} cycles: torques are too small there."
        )
    if recording.metadata.outcome in ("ABORTED", "TRIPPED", "ERROR", "INTERRUPTED"):
        warnings.append(
            f"The run ended as {recording.metadata.outcome}: only what was recorded until then is analysed."
        )
    return Checked(recording.rows, missed, tuple(warnings))


def require_time_base(recording: Recording, purpose: str) -> None:
    """Refuse a speed analysis without time stamps of the device or of SYNC: index times period is no time."""
    if recording.metadata.time_base in TRUE_TIME:
        return
    found = recording.metadata.time_base
    raise AnalysisError(
        f"{purpose} needs the true time of each cycle",
        where=recording.metadata.run_id,
        value=f'time base "{found}"',
        limit=", ".join(TRUE_TIME),
        remedy="Jitter of 0.3 ms on a nominal axis is 167 arcsec at 3000 r/min. Record device or hardware stamps.",
    )


def time_base_remark(recording: Recording) -> list[str]:
    """What to say of mean speeds taken from a time axis that is not stamped by device or hardware."""
    found = recording.metadata.time_base
    if found in TRUE_TIME:
        return []
    return [f'The time base is "{found}": speeds are means over whole stretches and rest on its average rate.']


def usable(recording: Recording, where: Segment | slice | None = None) -> NDArray[np.bool_]:
    """Mask (n,) of cycles whose values can be used."""
    return (recording.flags(where) & BAD_CYCLE) == 0


def rotary_ratio(recording: Recording, fallback: float) -> float:
    """Input revolutions per output revolution: of the run as mounted, else the gear's."""
    ratio = recording.metadata.ratio
    return ratio if np.isfinite(ratio) and ratio > 0.0 else fallback


def known_settings(settings: Iterable[str], allowed: Iterable[str], kind: str) -> None:
    """Raise `AnalysisError` for a setting that this analysis does not have."""
    names = tuple(allowed)
    for name in settings:
        if name not in names:
            raise AnalysisError(
                "no such setting", where=f"{kind}.{name}", limit=", ".join(names) if names else "none for this analysis"
            )
