"""Checks of the torque channel: its ends, its sign, its reach, its scale, its zero."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.budget import (
    PAIR,
    is_one_instrument,
    torque_scale_uncertainty,
    zero_uncertainty,
)
from experiments.evidence.holds import Recorded, part_of
from experiments.evidence.outcomes import not_checked, noted, passed, refused, refused_beyond
from experiments.finding import Finding, Severity

_StoredArray = NDArray[Any]
_PLATEAU_SHARE = 0.01
"""Share of the rows at the very extreme from which on it may be a plateau."""
_PLATEAU_EDGE = 3.0
"""How many times as many rows a plateau has as the level beside it; noise has fewer at its extreme."""
_LEAST_LEVELS = 16
"""Levels that a channel must have for its extreme to be told from its values."""
_DRIVING = 0.005
"""N m by which a torque may point along the motion because of its zero, ripple and noise."""
_DRIVING_SHARE = 0.1
"""The same as a share of the largest torque of the holds."""
_ABOVE_PEAK = 1.2
"""How far readings may lie above the motor's peak torque: scale, offset and noise."""
SLOPE_SPREAD, SLOPE_REST = 3.0, 0.02
"""Standard uncertainties of both scales, and what lag and steps add, by which port and drive may differ."""
DRIVE_RESIDUAL, DRIVE_RESIDUAL_SHARE = 0.003, 0.05
"""N m, and share of the largest torque, by which a single segment may stand beside the others' line."""
_DRIVE_SPAN = 0.02
"""N m that the holds must span for the slope to be known."""
ZERO_DRIFT, LARGEST_ZERO_DRIFT = 0.003, 0.02
"""N m between the zeros before and after: what is said, and what is refused."""
BRACKET_DRIFT, LARGEST_BRACKET_DRIFT = 0.03, 0.25
"""Relative change of the friction at the reference speed: what is said, and what is refused."""


def saturation(recorded: Recorded) -> Finding:
    """Rows of the segments that count in which the input of the torque was at the end of its range."""
    if not recorded.holds:
        return not_checked("there are no segments that count")
    rows = sum(h.rows for h in recorded.holds)
    saturated = sum(h.saturated for h in recorded.holds)
    return refused_beyond(
        saturated > 0,
        f"{saturated} of {rows} rows at the end of the range",
        "none",
        "the torque input was at the end of its range where the torque is averaged",
    )


def plateau(recorded: Recorded) -> Finding:
    """Rows at the very extreme of the torque channel: many of them, and few beside them, is a clipped signal."""
    if not recorded.torque:
        return not_checked("there is no torque channel in N m")
    recording = recorded.recording
    parts = [part_of(h.segment, recording.rows) for h in recorded.holds]
    if not parts:
        return not_checked("there are no segments that count")
    values = np.concatenate([recording.stored(recorded.torque, rows) for rows in parts])
    levels, counts = np.unique(values, return_counts=True)
    if len(levels) < _LEAST_LEVELS and _stands_at_its_ends(recorded, values, levels):
        found = f"{len(levels)} values only, most of them the outermost"
        words = "the torque is clipped: it stands at its extreme value and never goes beyond"
        return refused(found, f">= {_LEAST_LEVELS} values, as between the holds", words)
    if len(levels) < _LEAST_LEVELS:
        return not_checked(f"the torque channel has {len(levels)} levels only")
    ends = ((counts[0], counts[1]), (counts[-1], counts[-2]))
    share = max(
        (end / len(values) for end, beside in ends if end > _PLATEAU_EDGE * beside), default=0.0
    )
    return refused_beyond(
        share > _PLATEAU_SHARE,
        f"{100.0 * share:.2g} % of the rows in a plateau at the extreme",
        f"<= {100.0 * _PLATEAU_SHARE:g} %",
        "the torque is clipped: it stands at its extreme value and never goes beyond",
    )


def _stands_at_its_ends(recorded: Recorded, values: _StoredArray, levels: _StoredArray) -> bool:
    """Whether nearly all readings of the holds are the outermost of them, though the channel has many values."""
    outermost = np.isin(values, levels[[0, -1]])
    if not np.mean(outermost) > 0.5:
        return False
    recording = recorded.recording
    between: set[float] = set()
    for rows in recording.blocks():
        between.update(np.unique(recording.stored(recorded.torque, rows)).tolist())
        if len(between) >= 2 * _LEAST_LEVELS:
            return True
    return False


def sign(recorded: Recorded) -> Finding:
    """Friction takes power: at constant speed, and until it moves, the torque points along the motion."""
    known = [h for h in recorded.holds if h.works and math.isfinite(h.torque)]
    if not known:
        return not_checked("a torque over segments that count is needed")
    largest = max(abs(h.torque) for h in known)
    zero = 0.0
    if not math.isfinite(sum(recorded.zeros)):
        zero = 3.0 * zero_uncertainty(recorded.recording, recorded.torque)[0]
    allowed = max(_DRIVING, _DRIVING_SHARE * largest) + zero
    worst = min(known, key=lambda h: h.direction * h.torque)
    along = worst.direction * worst.torque
    found = f"{1e3 * along:.3g} mN m along the motion ({worst.segment.label} {worst.segment.index})"
    return refused_beyond(
        along < -allowed,
        found,
        f">= {-1e3 * allowed:.2g} mN m",
        "the torque drives where friction must brake: its sign, or that of the angle, is wrong",
    )


def reach(recorded: Recorded) -> Finding:
    """The torque of the segments that count against the peak torque of the motor."""
    known = [abs(h.torque) for h in recorded.holds if math.isfinite(h.torque)]
    peak = _peak_torque(recorded)
    if not known or not math.isfinite(peak):
        return not_checked(
            "a torque over segments that count is needed, and the motor's peak torque"
        )
    return refused_beyond(
        max(known) > _ABOVE_PEAK * peak,
        f"{max(known):.4g} N m at constant speed",
        f"<= {_ABOVE_PEAK:g} x {peak:.4g} N m",
        "no such motor gives this torque: its unit or its scale is wrong",
    )


def _peak_torque(recorded: Recorded) -> float:
    """The most that the motor can give [N m]: the drive's own limit among those that the run was made with.

    Where none is known it is the gear's repeated peak torque at its input, which no friction of a
    gear comes near; NaN for a motor alone.
    """
    limits, gear = recorded.recording.metadata.limits, recorded.evidence.gear
    tiers = limits.get("motor_torque", {}).get("tiers", ())
    values = [float(tier["value"]) for tier in tiers if tier.get("tier") == "drive"]
    if values:
        return max(values)
    mounted = recorded.recording.metadata.gear_mounted
    return gear.ratings.repeated_peak_torque / gear.ratio if mounted else math.nan


def port_against_drive(recorded: Recorded) -> Finding:
    """The torque port over the torque that the drive reports, hold by hold.

    What they share is not looked at by this: of one sensor they are one instrument, and called so.
    """
    pairs = [(h.drive_torque, h.torque) for h in recorded.holds]
    known = np.array([pair for pair in pairs if all(map(math.isfinite, pair))]).reshape(-1, 2)
    if recorded.torque != "torque" or len(known) < 2 or np.ptp(known[:, 0]) < _DRIVE_SPAN:
        return not_checked("torque port and drive at several torques are needed")
    drive, port = (known - known.mean(axis=0)).T
    slope = float(drive @ port / (drive @ drive))
    residual = float(np.abs(port - slope * drive).max())
    scales = [
        torque_scale_uncertainty(recorded.recording, n)[0] for n in ("torque", "drive_torque")
    ]
    apart = SLOPE_SPREAD * math.hypot(*scales) + SLOPE_REST
    allowed = DRIVE_RESIDUAL + DRIVE_RESIDUAL_SHARE * float(np.abs(known[:, 1]).max())
    finding = refused_beyond(
        abs(slope - 1.0) > apart or residual > allowed,
        f"{slope:.4g} N m at the port per N m of the drive, {1e3 * residual:.2g} mN m beside that line",
        f"1 ± {apart:.2g}, {1e3 * allowed:.2g} mN m",
        "the torque port and the torque that the drive reports are not the same torque",
    )
    if finding.severity is not Severity.PASSED:
        return finding
    return replace(finding, follows=_instruments(recorded))


def _instruments(recorded: Recorded) -> str:
    """Whether port and drive are one instrument, and what their agreement is worth."""
    recording = recorded.recording
    port, drive = (recording.signals[name].calibration.sensor for name in PAIR)
    if not is_one_instrument(recording):
        return f"Two instruments: the port by {port}, the drive by {drive}."
    by = f"both by {port}" if port and drive else "nobody says by which sensor each is"
    return f"One instrument ({by}): that port and drive agree says nothing of the scale that they share."


def zero(recorded: Recorded) -> Finding:
    """Drift of the torque zero between the readings with the servo off."""
    before, after = recorded.zeros
    drift = abs(after - before)
    if not math.isfinite(drift):
        return not_checked("servo-off zeros before and after are needed")
    found, allowed = f"{1e3 * drift:.2g} mN m", f"<= {1e3 * LARGEST_ZERO_DRIFT:g} mN m"
    if drift > LARGEST_ZERO_DRIFT:
        return refused(found, allowed, "the zero of the torque drifted over the run")
    if drift > ZERO_DRIFT:
        words = f"The torque zero drifted by {found}: it is interpolated, and its doubt is in the budget."
        return noted(found, allowed, words)
    return passed(found, allowed)


def bracket(recorded: Recorded) -> Finding:
    """Change of the friction at the reference speed over the run, half the difference of the directions."""
    visits = [h for h in recorded.holds if h.segment.label == "bracket" and math.isfinite(h.torque)]
    forward, reverse = (
        np.array([h.torque for h in visits if h.direction == way]) for way in (1, -1)
    )
    both = min(len(forward), len(reverse))
    if both < 2:
        return not_checked("the reference speed was not visited twice in both directions")
    friction = 0.5 * (forward[:both] - reverse[:both])
    drift = float(np.ptp(friction) / abs(friction.mean()))
    limit = float(recorded.evidence.settings.get("bracket_refusal", LARGEST_BRACKET_DRIFT))
    words = "the friction at the reference speed changed too much over the run"
    finding = refused_beyond(
        drift > limit, f"{100.0 * drift:.2g} %", f"<= {100.0 * limit:g} %", words
    )
    if finding.severity is Severity.PASSED and drift > BRACKET_DRIFT:
        said = f"The friction at the reference speed changed by {finding.found}: its scatter is in the budget."
        return noted(finding.found, finding.allowed, said)
    return finding
