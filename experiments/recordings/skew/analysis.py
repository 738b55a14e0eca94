"""Skew: the delay between any two channels of a recording, apart from hysteresis by its growth with speed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from experiments.budget import budget_table
from experiments.contract import Evidence
from experiments.errors import AnalysisError, analysing
from experiments.evidence import check_settings, quality_remarks, require_time_base, usable
from experiments.recording import Recording
from experiments.recordings.channels import stated_lag
from experiments.recordings.orders_source import angle_of
from experiments.recordings.skew.declaration import NAME, QUANTITIES, SETTINGS
from experiments.result import Plot, Result, Series
from experiments.setting import names_of
from model.arrays import FloatArray
from model.identify.channel_skew import Pair, SkewFit, fit_skew

LONGEST = 0.5
"""s of delay that are searched, where nothing else is set; no more than a tenth of the recording."""

MOST_ROWS = 4_000_000
"""Rows that are read; of more the first."""

ANGLE, SPEED, EFFORT = 0, 1, 2
"""Kinds of channels by how often they are differentiated."""

KINDS: Mapping[str, int] = {
    "rad": ANGLE,
    "m": ANGLE,
    "rad/s": SPEED,
    "m/s": SPEED,
    "rad/s2": EFFORT,
    "m/s2": EFFORT,
    "N m": EFFORT,
    "N": EFFORT,
    "A": EFFORT,
    "V": EFFORT,
}


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """Delay of the channel `second` behind the channel `first`, their gain, and the hysteresis between them.

    Settings: first and second (names of channels), longest_delay [s]. Refused where delay and hysteresis cannot be
    told apart (angles at one speed), without a true time base, and for channels that do not follow each other. The
    delay is the whole one, as recorded; lags that the import states are compared with it.
    """
    settings = evidence.settings
    check_settings(settings, names_of(SETTINGS), NAME)
    first, second = _names(recording, settings)
    warnings = quality_remarks(recording, "a skew", evidence)
    require_time_base(recording, "a skew")
    if recording.rows > MOST_ROWS:
        warnings.append(f"The first {MOST_ROWS} of {recording.rows} rows were used.")
    pair, said = _pair(recording, first, second)
    span = float(pair.time[-1] - pair.time[0])
    longest = float(settings.get("longest_delay", min(LONGEST, 0.1 * span)))
    with analysing(recording.metadata.run_id):
        fit = fit_skew(pair, longest, recording.signals[second].unit)
    estimates = {e.name: e for e in (fit.skew, fit.gain, fit.hysteresis) if e is not None}
    return Result(
        run=recording.metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates=estimates,
        metrics={},
        warnings=(*warnings, *said, *_against_stated(recording, first, second, fit)),
        plots=(_plot(pair, fit, second, recording.signals[second].unit),),
        tables=(budget_table(estimates.values()),),
        options={
            "first": first,
            "second": second,
            "rows_averaged": fit.rows_averaged,
            "stated_s": _stated_delay(recording, first, second),
        },
    )


def _stated_delay(recording: Recording, first: str, second: str) -> float | None:
    """By how much the import states the second channel to be later [s]; None where it states nothing of either."""
    lags = stated_lag(recording, first), stated_lag(recording, second)
    return None if lags == (None, None) else (lags[1] or 0.0) - (lags[0] or 0.0)


def _against_stated(recording: Recording, first: str, second: str, fit: SkewFit) -> list[str]:
    """What is said where the delay is not the one that the import states."""
    lag, skew = _stated_delay(recording, first, second), fit.skew
    if lag is None or abs(skew.value - lag) <= skew.expanded_uncertainty:
        return []
    return [
        f"The import states that {second} is {1e3 * lag:.4g} ms later than {first}; it is {1e3 * skew.value:.4g} ± "
        f"{1e3 * skew.expanded_uncertainty:.2g} ms: correct lag_s in the map of the import."
    ]


def _names(recording: Recording, settings: Mapping[str, Any]) -> tuple[str, str]:
    wanted = tuple(str(settings[key]) for key in ("first", "second") if key in settings)
    if len(wanted) != 2 or wanted[0] == wanted[1]:
        raise AnalysisError(
            "a skew is between two channels",
            where=f"{NAME}.first, {NAME}.second",
            value=", ".join(wanted) or "none",
            limit="two of " + ", ".join(sorted(recording.signals)),
            remedy="Name them: --set first=CHANNEL --set second=CHANNEL.",
        )
    recording.require("a skew", *wanted)
    for name in wanted:
        if recording.signals[name].unit not in KINDS:
            raise AnalysisError(
                "cannot be compared with another channel in time",
                where=f"{recording.metadata.run_id}: {name}",
                value=f"in {recording.signals[name].unit}",
                limit=", ".join(KINDS),
            )
    return wanted[0], wanted[1]


def _pair(recording: Recording, first: str, second: str) -> tuple[Pair, list[str]]:
    """Both channels as one kind: what is an integral of the other is differentiated."""
    rows = slice(0, min(recording.rows, MOST_ROWS))
    good = usable(recording, rows)
    time = recording.time(rows)[good]
    if np.diff(time).min(initial=1.0) <= 0.0:
        raise AnalysisError("the time does not increase", where=recording.metadata.run_id)
    x, y = (angle_of(recording, name)(rows)[good] for name in (first, second))
    kinds = KINDS[recording.signals[first].unit], KINDS[recording.signals[second].unit]
    kind = max(kinds)
    motion = x if kinds[0] <= kinds[1] else y
    speed = motion if min(kinds) >= SPEED else np.gradient(motion, time)
    is_force = kind == EFFORT and kinds[0] != kinds[1]
    if kind == EFFORT and not is_force:
        speed = np.zeros(len(time))
    x, y = (_differentiated(v, time, kind - own) for v, own in zip((x, y), kinds, strict=True))
    pair = Pair(
        time=time,
        first=x,
        second=y,
        speed=speed,
        has_hysteresis=kind == ANGLE or is_force,
        has_friction=is_force,
    )
    return pair, _remarks(recording, kinds, first, second)


def _remarks(recording: Recording, kinds: tuple[int, int], first: str, second: str) -> list[str]:
    across = {first, second} == {"input_angle", "output_angle"}
    if kinds == (ANGLE, ANGLE) and across and recording.metadata.gear_mounted:
        return [
            "Across a gear, viscous wind-up is proportional to speed as a delay is: it is part of this number."
        ]
    return []


def _differentiated(values: FloatArray, time: FloatArray, times: int) -> FloatArray:
    for _ in range(times):
        values = np.gradient(values, time)
    return values


def _plot(pair: Pair, fit: SkewFit, name: str, unit: str) -> Plot:
    """What the second channel stands off from the first over the speed: a delay is the slope, hysteresis the step."""
    share = max(1, len(pair.time) // 4000)
    speed, off = pair.speed[::share], (pair.second - fit.gain.value * pair.first)[::share]
    return Plot(
        name="skew",
        title="Offset between the channels over speed",
        x_label="speed of the motion [1/s of its channel]",
        y_label=f"{name.replace('_', ' ')} without its gain [{unit}]",
        series=(
            Series(label="second - gain x first", x=speed, y=off - off.mean(), style="points"),
        ),
        note="What one channel differs from the other, over the speed: a delay between them is the slope. Good where "
        "the points lie on a line.",
    )
