"""Checks of time and sampling: gaps, the time axis, resonance and count lattice against the rate."""

from __future__ import annotations

import math
from datetime import datetime

import numpy as np

from experiments.evidence import TRUE_TIME, UNFINISHED, cycles_of, rotary_ratio
from experiments.evidence.holds import Recorded
from experiments.evidence.outcomes import not_checked, noted, passed, refused, refused_beyond
from experiments.finding import Finding
from model.identify.counting import lattice_aliases
from model.units import ARCSEC, REVOLUTION

_HOLD_GAP = 0.01
"""Share of a segment's rows that may be unusable: more is no data, and is never averaged."""
_LONGEST_GAP = 10.0
"""Sampling periods between two rows of a segment beyond which the motion between them is not known."""
_PERIOD_TOLERANCE = 0.01
"""Relative difference of the median period and the nominal one."""
CLOCK_TOLERANCE, CLOCK_RESOLUTION = 0.02, 2.0
"""Relative and absolute [s] difference of the device's time from the computer's over a run."""
EXACT_TOLERANCE, EXACT_RESOLUTION = 0.001, 0.05
"""The same for what goes with the time itself, where the computer wrote parts of a second: it starts before the first
row and ends after the last one, so that no clock of a device may have counted more."""
_TIME_ROWS = 4096
"""Rows of a stretch in which periods are looked at."""
HIGHEST_SHARE = 0.4
"""Of the sampling frequency: nothing above it is identified."""
_LARGEST_STEP = 60.0
"""arcsec. Registers with empty bits count in steps too; those are far finer."""
_LATTICE_HARMONICS = 12
"""Harmonics of the output counts that sampling may fold onto an order: those above are smaller than the noise."""
_FOLDED_ORDER = 4.5
"""Orders of the input that are judged."""
_NEAR_AN_ORDER = 0.05
"""Orders apart from which on a folded line does not stand on an order of one output revolution's fit."""


def end_of_run(recorded: Recorded) -> Finding:
    """Whether the run came to the end of its plan: what was not reached may have been the worst of it."""
    outcome = recorded.recording.metadata.outcome
    if outcome in UNFINISHED:
        return not_checked(f"the run ended as {outcome}")
    return passed(outcome, "a run to its end")


def gaps(recorded: Recorded) -> Finding:
    """Rows that cannot be used in any segment that counts, and gaps of time between rows."""
    recording, largest = recorded.recording, recorded.evidence.maximum_missed_share
    cycles, missed, _ = cycles_of(recording)
    if missed > largest * cycles:
        found = f"{missed} of {cycles} ({100.0 * missed / cycles:.3g} %)"
        words = "too many cycles were missed for a result that can be trusted"
        return refused(found, f"<= {100.0 * largest:g} %", words)
    if not recorded.holds and recording.segments:
        return passed("no segment to be averaged")
    allowed = max(_HOLD_GAP, largest)
    share = max((hold.unusable / hold.rows for hold in recorded.holds), default=0.0)
    shortest, longest = _steps_of_time(recorded)
    text = f"{100.0 * share:.2g} % of a segment's rows, {shortest:.3g} to {longest:.3g} periods between two rows"
    if recorded.experiment.cuts_gaps:
        # Its gaps end a stretch: they are no part of what is averaged.
        longest = min(longest, _LONGEST_GAP)
    return refused_beyond(
        share > allowed or longest > _LONGEST_GAP or shortest <= 0.0,
        text,
        f"{100.0 * allowed:g} %, above 0 and to {_LONGEST_GAP:g} periods",
        "rows are missing, or stand in no order of time, where the analysis averages",
    )


def _steps_of_time(recorded: Recorded) -> tuple[float, float]:
    """Smallest and largest time between two rows of the segments that count, in median periods; without any, of all."""
    recording = recorded.recording
    period = _median_period(recorded)
    if recording.metadata.time_base not in TRUE_TIME or not period > 0.0:
        return 1.0, 1.0
    stretches = [slice(h.segment.start, h.segment.stop) for h in recorded.holds]
    shortest, longest = math.inf, 0.0
    for stretch in stretches or [slice(0, recording.rows)]:
        for rows in recording.blocks(stretch, size=1 << 20):
            times = recording.source.time_ns(max(rows.start - 1, 0), rows.stop)
            steps = np.diff(times) * 1e-9
            if len(steps):
                shortest = min(shortest, float(steps.min()))
                longest = max(longest, float(steps.max()))
    return shortest / period, longest / period


def _median_period(recorded: Recorded) -> float:
    """The median time between two rows [s], from the beginning, the middle and the end; NaN for a row or two."""
    rows = recorded.recording.rows
    starts = {0, max(0, rows // 2), max(0, rows - _TIME_ROWS)}
    source = recorded.recording.source
    parts = [np.diff(source.time_ns(s, min(s + _TIME_ROWS, rows))) for s in sorted(starts)]
    steps = np.concatenate(parts)
    return float(np.median(steps)) * 1e-9 if len(steps) else math.nan


def time_axis(recorded: Recorded) -> Finding:
    """The period of the rows against the nominal one, and the device's time against the computer's over the run."""
    metadata = recorded.recording.metadata
    if metadata.time_base not in TRUE_TIME:
        return not_checked(f'time base "{metadata.time_base}": no cycle has a stamp of its own')
    if not metadata.sample_rate > 0.0:
        return not_checked("the recording does not say at which rate it was made")
    if metadata.origin == "imported":
        # An import takes its rate from the stamps, or its stamps from a stated rate: neither can judge the other.
        return not_checked("the rate of an import is that of its own stamps")
    ratio = _median_period(recorded) * metadata.sample_rate
    found = f"{ratio:.4f} nominal periods from row to row"
    elapsed = _computer_time(metadata.start_time, metadata.end_time)
    span = _span(recorded)
    tolerance, resolution = CLOCK_TOLERANCE, CLOCK_RESOLUTION
    is_exact = "." in metadata.start_time and "." in metadata.end_time
    if is_exact and "frequency" in recorded.quantities:
        tolerance, resolution = EXACT_TOLERANCE, EXACT_RESOLUTION
    is_slow = span > (1.0 + tolerance) * elapsed + resolution
    if math.isfinite(elapsed):
        found += f"; {span:.2f} s of the device in {elapsed:.2f} s of the computer"
    return refused_beyond(
        abs(ratio - 1.0) > _PERIOD_TOLERANCE or is_slow,
        found,
        f"1 ± {_PERIOD_TOLERANCE:g}; no more than the computer's by {100.0 * tolerance:g} % + {resolution:g} s",
        "the time axis is not that of the run",
    )


def _span(recorded: Recorded) -> float:
    source, rows = recorded.recording.source, recorded.recording.rows
    return float(source.time_ns(rows - 1, rows)[0] - source.time_ns(0, 1)[0]) * 1e-9


def _computer_time(start: str, end: str) -> float:
    """From start to end of the run by the computer's clock [s]; NaN where one is not written."""
    try:
        return (datetime.fromisoformat(end) - datetime.fromisoformat(start)).total_seconds()
    except (ValueError, TypeError):
        return math.nan


def resonance(recorded: Recorded) -> Finding:
    """The first torsional mode of the parameter set against the sampling rate."""
    gear, rate = recorded.evidence.gear, recorded.recording.metadata.sample_rate
    if not rate > 0.0:
        return not_checked("the recording does not say at which rate it was made")
    expected = math.sqrt(gear.ratings.stiffness_1 / gear.inertia.output) / REVOLUTION
    return refused_beyond(
        expected > HIGHEST_SHARE * rate,
        f"{expected:.4g} Hz by the parameter set",
        f"<= {HIGHEST_SHARE:g} of {rate:g} Hz",
        "the first torsional mode lies too near the sampling rate: it, or its alias, would be found",
    )


def steps_of_the_output(recorded: Recorded) -> Finding:
    """The step in which the output angle comes against the count that is stated of it."""
    recording = recorded.recording
    output = recording.signals.get("output_angle")
    if output is None or not (output.is_counted and output.quantum > 0.0):
        return not_checked("counts of an output encoder are needed")
    step = 0
    for rows in recording.blocks(size=1 << 18):
        counts = recording.stored("output_angle", rows)
        if not np.issubdtype(counts.dtype, np.integer):
            return not_checked("the output angle is not stored in counts")
        step = math.gcd(step, int(np.gcd.reduce(np.abs(np.diff(counts.astype(np.int64))))))
        if step == 1:
            break
    angle = step * output.quantum / ARCSEC
    return refused_beyond(
        step > 1 and angle > _LARGEST_STEP,
        f"steps of {step} counts, {angle:.3g} arcsec",
        f"single counts, or steps to {_LARGEST_STEP:g} arcsec",
        "the output angle comes in coarser steps than is stated: counts that were cut off, or lines that are wrong",
    )


def count_lattice(recorded: Recorded) -> Finding:
    """Harmonics of the output encoder's counts that sampling folds onto an order that is judged."""
    recording = recorded.recording
    output, rate = recording.signals.get("output_angle"), recording.metadata.sample_rate
    if output is None or not output.quantum > 0.0 or not rate > 0.0 or not recorded.turning:
        return not_checked("counts, rate and a segment that turns are needed")
    ratio = rotary_ratio(
        recording, recorded.evidence.gear.mounted_ratio(recording.metadata.mounting)
    )
    counts = REVOLUTION / (ratio * output.quantum)
    worst = 0.0
    for hold in recorded.turning:
        per_turn = REVOLUTION * rate / abs(hold.speed)
        folded = lattice_aliases(
            per_turn, counts, output.quantum, _FOLDED_ORDER, harmonics=_LATTICE_HARMONICS
        )
        on_order = [a.amplitude for a in folded if abs(a.order - round(a.order)) < _NEAR_AN_ORDER]
        worst = max(worst, *on_order, 0.0)
    found = f"up to {worst / ARCSEC:.2g} arcsec folded onto an order"
    if worst == 0.0:
        return passed("nothing folded onto an order", "nothing")
    words = "The sampling repeats on the lattice of the output counts: quantisation does not average out."
    return noted(found, "nothing", words)
