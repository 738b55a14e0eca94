"""Checks of the tare: whose it is, how old, how warm, how large; and the tare as wide as they make it."""

from __future__ import annotations

import dataclasses
import math
from datetime import datetime

import numpy as np

from experiments.evidence.finding import Finding, not_checked, refused_beyond
from experiments.evidence.holds import Recorded
from experiments.recording import Recording
from experiments.result import Result, Table
from model.arrays import FloatArray
from model.units import RPM

TABLE = "motor-friction"
"""The table by which a tare is carried: speed [r/min], friction [N m], standard error [N m]."""
AGE_LIMIT = 7.0
"""Days after which a tare is widened; the setting `tare_age_limit`."""
AGED = 0.05
"""Relative standard uncertainty of an old tare: bearings and seal of a motor run in, and out."""
WARMER, MUCH_WARMER = 5.0, 15.0
"""K between tare and run: beyond the first the tare is widened, beyond the second refused."""
PER_KELVIN = 0.01
"""Relative change of a motor's friction per kelvin, of grease and seal."""
LARGEST_SHARE = 0.9
"""Of what it is subtracted from: above it the difference is all error."""


def origin(recorded: Recorded) -> Finding:
    """Motor, bench and calibration of the torque port: the tare's against the run's."""
    there = recorded.evidence.tare_recording
    if there is None:
        return not_checked("the run of the tare is not at hand")
    pairs = _rig_of_both(recorded.recording, there)
    other = [(what, a, b) for what, a, b in pairs if a and b and a != b]
    if other:
        what, mine, its = other[0]
        words = f"the tare is of another {what}"
        return Finding("refused", f"{what} {its}", f"{what} {mine}", words)
    unknown = [what for what, a, b in pairs if not (a and b)]
    if unknown:
        return not_checked(f"{', '.join(unknown)} of tare or run is not written down")
    return Finding("ok", "same motor, bench and calibration", "the same")


def _rig_of_both(here: Recording, there: Recording) -> list[tuple[str, str, str]]:
    """What must be the same of a run and its tare: what it is, the run's, the tare's; "" where it is not known."""
    pairs = [(name, _named(here, name), _named(there, name)) for name in ("motor", "bench")]
    return [*pairs, ("torque channel", _torque_identity(here), _torque_identity(there))]


def refusal_of(run: Recording, tare: Recording) -> str:
    """Why a tare is not looked for further: of another rig, or more than `WARMER` apart; "" where nothing says so.

    Whoever chooses a tare asks for a housing as warm as in the run; one that is chosen by hand is
    widened by the room instead (`temperature`), and refused only beyond `MUCH_WARMER`. What neither
    of the two says, such as a temperature that was not recorded, speaks against nobody.
    """
    for what, mine, its in _rig_of_both(run, tare):
        if mine and its and mine != its:
            return f"{what} {its}, this run's is {mine}"
    place, apart = kelvin_apart(run, tare)
    if apart > WARMER:
        return f"{place} {apart:.1f} K apart, limit {WARMER:g} K"
    return ""


def kelvin_apart(run: Recording, tare: Recording) -> tuple[str, float]:
    """How far apart run and tare are [K] and where that was measured: the housing where both recorded it, else the
    room; NaN and "" where both have neither.
    """
    for place, channel in (("housing", "housing_temperature"), ("room", "ambient_temperature")):
        if run.has(channel) and tare.has(channel):
            return place, abs(_at_the_start(run, channel) - _at_the_start(tare, channel))
    return "", math.nan


def _named(recording: Recording, what: str) -> str:
    return str(recording.metadata.process.get(what, ""))


def _torque_identity(recording: Recording) -> str:
    """Device, scale and certificate of the torque channel in words."""
    channel = recording.signals.get("torque")
    if channel is None:
        return ""
    device = f"{channel.model} {channel.serial_number}".strip()
    return f"{device}, {channel.gain:.9g} per count, {channel.calibration.certificate}"


def age(recorded: Recorded) -> Finding:
    """Days between the tare and the run."""
    days, limit = _days(recorded), _age_limit(recorded)
    if not math.isfinite(days):
        return not_checked("when tare and run were made is not written down")
    found, allowed = f"{days:.1f} days", f"{limit:g} days"
    if days > limit:
        words = (
            f"The motor tare is {found} old: widened by {100.0 * AGED:g} % (standard uncertainty)."
        )
        return Finding("widened", found, allowed, words)
    return Finding("ok", found, allowed)


def _age_limit(recorded: Recorded) -> float:
    return float(recorded.evidence.settings.get("tare_age_limit", AGE_LIMIT))


def _days(recorded: Recorded) -> float:
    there = recorded.evidence.tare_recording
    if there is None:
        return math.nan
    try:
        times = [datetime.fromisoformat(r.metadata.start_time) for r in (recorded.recording, there)]
        return abs((times[0] - times[1]).total_seconds()) / 86400.0
    except (ValueError, TypeError):
        return math.nan


def temperature(recorded: Recorded) -> Finding:
    """Temperature of the room in the run against that in the tare's."""
    apart = _kelvin(recorded)
    if not math.isfinite(apart):
        return not_checked("the temperature of tare or run was not recorded")
    found, allowed = f"{apart:.1f} K apart", f"{MUCH_WARMER:g} K"
    if apart > MUCH_WARMER:
        return Finding("refused", found, allowed, "the tare was taken at another temperature")
    if apart > WARMER:
        words = (
            f"Tare and run are {found}: the tare is widened by {100.0 * PER_KELVIN:g} % per kelvin."
        )
        return Finding("widened", found, allowed, words)
    return Finding("ok", found, f"{WARMER:g} K")


def _kelvin(recorded: Recorded) -> float:
    there = recorded.evidence.tare_recording
    if there is None:
        return math.nan
    return _kelvin_between(recorded.recording, there)


def _kelvin_between(run: Recording, tare: Recording) -> float:
    return abs(_room(run) - _room(tare))


def _room(recording: Recording) -> float:
    """Mean temperature of the room, else of the housing, over the first rows [degC]; NaN where none was recorded."""
    for name in ("ambient_temperature", "housing_temperature"):
        if recording.has(name):
            return _at_the_start(recording, name)
    return math.nan


def _at_the_start(recording: Recording, channel: str) -> float:
    """Mean of a temperature over the first rows [degC]."""
    return float(recording.si(channel, slice(0, 4096)).mean())


def size(recorded: Recorded) -> Finding:
    """The tare as a share of the friction that it is subtracted from, half the difference of the directions."""
    tare = recorded.evidence.tare
    table = _table(tare) if tare is not None else None
    holds = [h for h in recorded.turning if math.isfinite(h.torque)]
    if table is None or not holds:
        return not_checked("a tare over speed and torques at constant speed are needed")
    speed = np.array([abs(h.speed) for h in holds])
    braking = np.array([h.direction * h.torque for h in holds])
    subtracted = np.interp(speed, table[:, 0] * RPM, table[:, 1])
    # Over all holds: an offset of the port cancels between the directions.
    share = float(subtracted.sum() / braking.sum())
    return refused_beyond(
        not 0.0 <= share <= LARGEST_SHARE,
        f"{share:.3g} of the friction measured",
        f"0 to {LARGEST_SHARE:g}",
        "the tare leaves nothing of what it is subtracted from",
    )


def _table(tare: Result) -> FloatArray | None:
    """Speed [r/min], friction and standard error [N m] of a tare, by speed; None where it has less than two speeds."""
    table = next((t for t in tare.tables if t.name == TABLE), None)
    if table is None or len(table.rows) < 2:
        return None
    rows = np.array([[float(cell) for cell in row] for row in table.rows])
    return np.asarray(rows[np.argsort(rows[:, 0])], dtype=np.float64)


def widened(recorded: Recorded) -> Result | None:
    """The tare with what age and temperature add to its standard errors."""
    tare = recorded.evidence.tare
    if tare is None:
        return None
    old = AGED if _days(recorded) > _age_limit(recorded) else 0.0
    apart = _kelvin(recorded)
    warm = PER_KELVIN * apart if apart > WARMER else 0.0
    if not old and not warm:
        return tare
    relative = math.hypot(old, warm)
    tables = tuple(_with_errors(t, relative) if t.name == TABLE else t for t in tare.tables)
    return dataclasses.replace(tare, tables=tables)


def _with_errors(table: Table, relative: float) -> Table:
    rows = tuple(
        (speed, friction, math.hypot(float(error), relative * float(friction)))
        for speed, friction, error in table.rows
    )
    return dataclasses.replace(table, rows=rows)
