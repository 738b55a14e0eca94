"""Whose a tare is: the motor, bench and torque channel of a run and of a tare, and how warm both were.

Nothing here computes with a tare, so that whoever only looks for one loads no numerics.
"""

from __future__ import annotations

import math

from experiments.recording import Recording

AGE_LIMIT = 7.0
"""Days after which a tare is widened; the setting `tare_age_limit`."""
WARMER = 5.0
"""K between tare and run beyond which a tare is widened, and not chosen where there is another."""


def rig_of_both(here: Recording, there: Recording) -> list[tuple[str, str, str]]:
    """What must be the same of a run and its tare: what it is, the run's, the tare's; "" where it is not known."""
    pairs = [(name, _named(here, name), _named(there, name)) for name in ("motor", "bench")]
    return [*pairs, ("torque channel", _torque_identity(here), _torque_identity(there))]


def refusal_of(run: Recording, tare: Recording) -> str:
    """Why a tare is not looked for further: of another rig, or more than `WARMER` apart; "" where nothing says so.

    Whoever chooses a tare asks for a housing as warm as in the run; one that is chosen by hand is
    widened by the room instead, and refused only where it is much warmer (`experiments.evidence.tare`). What neither
    of the two says, such as a temperature that was not recorded, speaks against nobody.
    """
    other = other_rig(run, tare)
    if other:
        return other
    place, apart = kelvin_apart(run, tare)
    if apart > WARMER:
        return f"{place} {apart:.1f} K apart, limit {WARMER:g} K"
    return ""


def other_rig(run: Recording, tare: Recording) -> str:
    """What of motor, bench and torque channel is another one in a tare than in a run; "" where nothing is."""
    for what, mine, its in rig_of_both(run, tare):
        if mine and its and mine != its:
            return f"{what} {its}, this run's is {mine}"
    return ""


def kelvin_apart(run: Recording, tare: Recording) -> tuple[str, float]:
    """How far apart run and tare are [K] and where that was measured: the housing where both recorded it, else the
    room; NaN and "" where both have neither.
    """
    for place, channel in (("housing", "housing_temperature"), ("room", "ambient_temperature")):
        if run.has(channel) and tare.has(channel):
            return place, abs(at_the_start(run, channel) - at_the_start(tare, channel))
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


def at_the_start(recording: Recording, channel: str) -> float:
    """Mean of a temperature over the first rows [degC]."""
    return float(recording.si(channel, slice(0, 4096)).mean())
