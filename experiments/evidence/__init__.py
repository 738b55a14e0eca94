"""What a recording must be before anything is computed from it: complete cycles, a true time base,
a few rows, known units.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.contract import Evidence
from experiments.errors import AnalysisError, SettingError
from experiments.recording import Recording, Segment, mapping_of
from model.arrays import quotient
from model.units import ARCSEC

BAD_CYCLE = 1 | 8 | 16 | 32
"""Flags of a cycle whose values cannot be used: incomplete, short frame, jumped, device says not valid."""
SATURATED = 64
"""Flag of a cycle in which the analogue input was at the end of its range."""

UNFINISHED = ("ABORTED", "TRIPPED", "ERROR", "INTERRUPTED")
"""Outcomes of a run that did not come to the end of its plan."""

_MARK_REPEATABILITY = 2
"""Counts by which an index mark may come back elsewhere without saying anything."""

PAIRED = ("input_angle", "output_angle", "torque")
"""Channels whose values are paired cycle by cycle."""

_WHOLE_CYCLE = 0.5
"""SYNC cycles of skew from which on a channel's process data are those of another cycle, not just latched later."""

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
        return quotient(self.missed, self.cycles, 0.0)


def check_recording(
    recording: Recording, purpose: str, maximum_missed_share: float, least_rows: int = 100
) -> Checked:
    """Refuse an empty or too short recording and one with too many missed cycles; return what must
    be said otherwise.
    """
    where = recording.metadata.run_id
    _refuse_polled(recording, purpose)
    if recording.rows < least_rows:
        raise AnalysisError(
            f"the recording is too short for {purpose}",
            where=where,
            value=f"{recording.rows} cycles",
            limit=f">= {least_rows} cycles",
            remedy="Record longer.",
        )
    cycles, missed, saturated = cycles_of(recording)
    share = missed / cycles
    if share > maximum_missed_share:
        raise AnalysisError(
            "too many cycles were missed for a result that can be trusted",
            where=where,
            value=f"{missed} of {cycles} ({100.0 * share:.3g} %)",
            limit=f"<= {100.0 * maximum_missed_share:g} %",
            remedy="Repair the acquisition and repeat the run, or allow more with --largest-missed-share.",
        )
    warnings: list[str] = []
    if missed:
        warnings.append(f"{missed} of {cycles} cycles are incomplete and were left out.")
    if saturated:
        warnings.append(
            f"The torque input was at the end of its range in {saturated} cycles: torques are too small there."
        )
    if recording.metadata.outcome in UNFINISHED:
        warnings.append(
            f"The run ended as {recording.metadata.outcome}: only what was recorded until then is analysed."
        )
    warnings += _index_remarks(recording) + skew_remark(recording)
    return Checked(cycles, missed, tuple(warnings))


def quality_remarks(recording: Recording, purpose: str, evidence: Evidence) -> list[str]:
    """What must be said of a recording that can be used; raises as `check_recording`."""
    return list(check_recording(recording, purpose, evidence.maximum_missed_share).warnings)


def _refuse_polled(recording: Recording, purpose: str) -> None:
    """Values that were taken at times of their own are no half of a pair."""
    signals = recording.signals
    polled = [name for name in PAIRED if name in signals and signals[name].acquired == "polled"]
    if polled:
        raise AnalysisError(
            f"{purpose} pairs values of one SYNC, and these were polled at times of their own",
            where=recording.metadata.run_id,
            value=", ".join(polled),
            limit="latched at the SYNC",
            remedy="Record them by a device that the SYNC latches; their own times are in "
            + ", ".join(f"{name}_taken" for name in polled)
            + ".",
        )


def cycles_of(recording: Recording) -> tuple[int, int, int]:
    """SYNC cycles of a recording, those of them that cannot be used, and those at the end of the torque's range."""
    missed = unrecorded = _unrecorded(recording)
    saturated = 0
    for rows in recording.blocks(size=1 << 20):
        flags = recording.flags(rows)
        missed += int(np.count_nonzero(flags & BAD_CYCLE))
        saturated += int(np.count_nonzero(flags & SATURATED))
    return recording.rows + unrecorded, missed, saturated


def _unrecorded(recording: Recording) -> int:
    """SYNC cycles that never became a row, where the source knows the cycle of each row."""
    cycles = getattr(recording.source, "cycles", None)
    if cycles is None:
        return 0
    first, last = cycles(0, 1), cycles(recording.rows - 1, recording.rows)
    return max(0, int(last[0]) - int(first[0]) + 1 - recording.rows)


def _acquisition(recording: Recording, name: str) -> Mapping[str, Any]:
    """A group of the figures that the run file keeps of its acquisition; empty where it keeps none."""
    return mapping_of(mapping_of(recording.metadata.process.get("acquisition")).get(name))


def _index_remarks(recording: Recording) -> list[str]:
    """Encoders whose index marks did not come back to their place while the run was recorded:
    counts were lost or added.
    """
    remarks: list[str] = []
    for name, counts in _acquisition(recording, "index_marks").items():
        worst = mapping_of(counts).get("worst_excess", 0)
        if isinstance(worst, (int, float)) and abs(worst) > _MARK_REPEATABILITY:
            remarks.append(
                f"{name}: counts between index marks were off by up to {abs(worst):g}: its "
                "angle has lost or gained counts."
            )
    return remarks


def skew_remark(recording: Recording) -> list[str]:
    """What the skew between the encoders makes of the fastest set-point, where it is more than a
    count of the output encoder.
    """
    value = mapping_of(_acquisition(recording, "skew").get("encoder_skew")).get("value")
    output = recording.signals.get("output_angle")
    if not isinstance(value, (int, float)) or output is None or not output.quantum > 0.0:
        return []
    period = quotient(1.0, recording.metadata.sample_rate, math.inf)
    if abs(value) > _WHOLE_CYCLE * period:
        later, earlier = ("output", "input") if value > 0.0 else ("input", "output")
        return [
            f"The {later} angle is {1e6 * abs(value):.0f} us behind the {earlier} angle, "
            f"{abs(value) / period:.2f} SYNC cycles: "
            f"its process data are of an earlier cycle. Set the device to transmit what it latched at the same SYNC."
        ]
    ratio = rotary_ratio(recording, math.inf)
    # Set-points of segments in torque mode are torques: far below any speed.
    fastest = max((abs(segment.setpoint) for segment in recording.segments), default=0.0) / ratio
    angle = abs(value) * fastest
    if not angle > output.quantum:
        return []
    return [
        f"The output is latched {1e6 * value:.1f} us after the input (skew and viscous wind-up together): "
        f"{angle / ARCSEC:.2g} arcsec at the fastest set-point, in opposite senses in the two directions."
    ]


def require_bare_motor(recording: Recording, protocol: str, because: str) -> None:
    """Raise `AnalysisError` for a run with a gear, of which a protocol of the bare motor can make nothing."""
    if recording.metadata.gear_mounted:
        raise AnalysisError(
            f"the run was made with a gear mounted: {because}",
            where=recording.metadata.run_id,
            remedy=f"Remove the gear and run {protocol}.",
        )


def require_time_base(recording: Recording, purpose: str) -> None:
    """Refuse a speed analysis without time stamps of the device or of SYNC: index times period is no time."""
    if recording.metadata.time_base in TRUE_TIME:
        return
    time_base = recording.metadata.time_base
    remedy = "Record device or hardware stamps."
    if recording.metadata.origin == "imported":
        remedy = (
            "If a clock of the device took the rows at that rate, say so at the import: "
            "--time-base hardware."
        )
    raise AnalysisError(
        f"{purpose} needs the true time of each cycle",
        where=recording.metadata.run_id,
        value=f'time base "{time_base}"',
        limit=", ".join(TRUE_TIME),
        remedy=f"Jitter of 0.3 ms on a nominal axis is 167 arcsec at 3000 r/min. {remedy}",
    )


def time_base_remark(recording: Recording) -> list[str]:
    """What to say of mean speeds taken from a time axis that is not stamped by device or hardware.

    Raises `AnalysisError` for a recording without any time: then there is no speed at all.
    """
    time_base = recording.metadata.time_base
    if time_base in TRUE_TIME:
        return []
    if time_base == "none":
        raise AnalysisError(
            "a recording without time has no speeds",
            where=recording.metadata.run_id,
            value='time base "none"',
            limit="stamps, or at least a known rate",
            remedy="Import it again with its time column or its rate.",
        )
    return [
        f'The time base is "{time_base}": speeds are means over whole stretches and rest on its average rate.'
    ]


def usable(recording: Recording, where: Segment | slice | None = None) -> NDArray[np.bool_]:
    """Mask (n,) of cycles whose values can be used."""
    return (recording.flags(where) & BAD_CYCLE) == 0


def rotary_ratio(recording: Recording, fallback: float) -> float:
    """Input revolutions per output revolution: of the run as mounted, else the gear's."""
    ratio = recording.metadata.ratio
    return ratio if np.isfinite(ratio) and ratio > 0.0 else fallback


def check_settings(settings: Iterable[str], allowed: Iterable[str], kind: str) -> None:
    """Raise `SettingError` for a setting that this analysis does not have."""
    names = tuple(allowed)
    for name in settings:
        if name not in names:
            raise SettingError(
                "no such setting",
                where=f"{kind}.{name}",
                limit=", ".join(names) or "none for this analysis",
            )
