"""Checks of the tare: whose it is, how old, how warm, how large, beside which witnesses; and the tare as wide as they
make it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from datetime import datetime

import numpy as np

from experiments.evidence.holds import Recorded
from experiments.evidence.outcomes import not_checked, noted, passed, refused, refused_beyond
from experiments.finding import Finding, Severity
from experiments.recording import Recording
from experiments.result import Result
from experiments.tares import tare_witness as witness
from experiments.tares.same_rig import AGE_LIMIT, WARMER, at_the_start, rig_of_both
from experiments.tares.tare import TareDoubt, tare_of, with_doubts
from model.identify.running_torque import Tare
from model.units import RPM

_AGED = 0.05
"""Relative standard uncertainty of an old tare: bearings and seal of a motor run in, and out."""
_MUCH_WARMER = 15.0
"""K between tare and run: beyond `WARMER` the tare is widened, beyond this it is refused."""
_PER_KELVIN = 0.01
"""Relative change of a motor's friction per kelvin, of grease and seal."""
_LEAST_BESIDE = 0.02
"""Of a tare's mean: points closer than that to a line bend nothing that is subtracted."""
LARGEST_SHARE = 0.9
"""Of what it is subtracted from: above it the difference is all error."""


def origin(recorded: Recorded) -> Finding:
    """Motor, bench and calibration of the torque port: the tare's against the run's."""
    there = recorded.evidence.tare_recording
    if there is None:
        return not_checked("the run of the tare is not at hand")
    pairs = rig_of_both(recorded.recording, there)
    other = [(what, a, b) for what, a, b in pairs if a and b and a != b]
    if other:
        what, mine, its = other[0]
        words = f"the tare is of another {what}"
        return refused(f"{what} {its}", f"{what} {mine}", words)
    unknown = [what for what, a, b in pairs if not (a and b)]
    if unknown:
        return not_checked(f"{', '.join(unknown)} of tare or run is not written down")
    return passed("same motor, bench and calibration", "the same")


def age(recorded: Recorded) -> Finding:
    """Days between the tare and the run."""
    days, limit = _days(recorded), _age_limit(recorded)
    if not math.isfinite(days):
        return not_checked("when tare and run were made is not written down")
    found, allowed = f"{days:.1f} days", f"{limit:g} days"
    if days > limit:
        words = (
            f"The motor tare is {found} old: widened by {100.0 * _AGED:g} % (standard uncertainty)."
        )
        return noted(found, allowed, words)
    return passed(found, allowed)


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
    found, allowed = f"{apart:.1f} K apart", f"{_MUCH_WARMER:g} K"
    if apart > _MUCH_WARMER:
        return refused(found, allowed, "the tare was taken at another temperature")
    if apart > WARMER:
        words = f"Tare and run are {found}: the tare is widened by {100.0 * _PER_KELVIN:g} % per kelvin."
        return noted(found, allowed, words)
    return passed(found, f"{WARMER:g} K")


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
            return at_the_start(recording, name)
    return math.nan


def share_subtracted(recorded: Recorded) -> float:
    """The tare as a share of the friction that it is subtracted from, half the difference of the directions.

    NaN without a tare over speed or torques at constant speed.
    """
    tare = _points(recorded)
    holds = [h for h in recorded.turning if math.isfinite(h.torque)]
    if tare is None or not holds:
        return math.nan
    speed = np.array([abs(h.speed) for h in holds])
    braking = np.array([h.direction * h.torque for h in holds])
    subtracted = np.interp(speed, tare.speed, tare.torque)
    # Over all holds: an offset of the port cancels between the directions.
    return float(subtracted.sum() / braking.sum())


def size(recorded: Recorded) -> Finding:
    """How much of the friction the tare takes off."""
    share = share_subtracted(recorded)
    if math.isnan(share):
        return not_checked("a tare over speed and torques at constant speed are needed")
    return refused_beyond(
        not 0.0 <= share <= LARGEST_SHARE,
        f"{share:.3g} of the friction measured",
        f"0 to {LARGEST_SHARE:g}",
        "the tare leaves nothing of what it is subtracted from",
    )


def _points(recorded: Recorded) -> Tare | None:
    tare = recorded.evidence.tare
    return tare and tare_of(tare)


def shape(recorded: Recorded) -> Finding:
    """The points of the tare against a straight line over speed, and against the line that its own result states."""
    tare, points = recorded.evidence.tare, _points(recorded)
    if tare is None or points is None:
        return not_checked("a tare over speed is needed")
    off = witness.off_its_own_line(tare)
    if off > witness.OWN_LINE:
        found, allowed = f"{100.0 * off:.2g} % off", f"<= {100.0 * witness.OWN_LINE:g} %"
        return refused(found, allowed, "the tare is not what its own result states")
    stray = witness.stray_point(points)
    if stray is not None:
        speed, away, rest = stray
        found = (
            f"{1e3 * away:+.3g} mN m at {speed / RPM:.4g} r/min, the others within {1e3 * rest:.2g}"
        )
        allowed = f"<= {100.0 * witness.STRAY_SHARE:g} % of the tare, or as the others"
        return refused(found, allowed, "one point of the tare is beside the line of all others")
    ratio, beside = witness.reduced_chi_square(points)
    if not math.isfinite(ratio):
        return not_checked("a tare over four speeds or more is needed")
    found = f"{ratio:.3g} per degree of freedom, {1e3 * beside:.2g} mN m beside the line"
    allowed = f"<= {witness.LARGEST_CHI_SQUARE:g}"
    if beside > 0.5 * abs(float(points.torque.mean())):
        return refused(found, allowed, "the tare is no friction of a motor over speed")
    if ratio > witness.LARGEST_CHI_SQUARE and beside > _LEAST_BESIDE * abs(points.torque.mean()):
        words = f"The points of the motor tare lie {found}: its doubt is in the budget."
        return noted(found, allowed, words)
    return passed(found, allowed)


def card(recorded: Recorded) -> Finding:
    """The tare against the friction that the card of the motor states."""
    found = _beside_card(recorded)
    if found is None:
        return not_checked("the motor's card, or the run of the tare, is not at hand")
    return _judged(found, "the card of its motor", math.isfinite(found.normalised))


def others(recorded: Recorded) -> Finding:
    """The tare against the bench's other tares of the same motor, by the same channel."""
    found = _beside_others(recorded)
    count = len(recorded.evidence.other_tares)
    if found is not None and (found.is_beyond_factor or found.is_apart):
        return _judged(found, "the bench's other tares", True)
    if count < witness.ENOUGH:
        have, need = f"{count} beside it", f">= {witness.ENOUGH}"
        return noted(have, need, witness.alone(count))
    if found is None:
        return not_checked("the other tares have no speed in common with it")
    return _judged(found, "the bench's other tares", True)


def _judged(found: witness.Comparison, what: str, has_uncertainty: bool) -> Finding:
    """Refused beyond a factor of two; widened by the difference beyond |E_n| 1, where that can be told."""
    words = found.words()
    allowed = f"|E_n| <= 1, within a factor of {witness.FACTOR:g}"
    if found.is_beyond_factor:
        return refused(words, allowed, f"the tare is not that of {what}")
    if has_uncertainty and found.is_apart:
        said = f"The motor tare is away from {what}: {words}. The difference is in the budget."
        return noted(words, allowed, said)
    return passed(words, allowed)


def _beside_card(recorded: Recorded) -> witness.Comparison | None:
    tare, there = recorded.evidence.tare, recorded.evidence.tare_recording
    return tare and there and witness.against_card(tare, there)


def _beside_others(recorded: Recorded) -> witness.Comparison | None:
    tare = recorded.evidence.tare
    return tare and witness.against_others(tare, recorded.evidence.other_tares)


def widened(recorded: Recorded) -> Result | None:
    """The tare with what age, temperature and witnesses leave open of it as a whole."""
    tare = recorded.evidence.tare
    return tare and with_doubts(tare, _doubts(recorded, tare))


def _doubts(recorded: Recorded, tare: Result) -> Iterator[TareDoubt]:
    points = tare_of(tare)
    if points is None:
        return
    days, apart = _days(recorded), _kelvin(recorded)
    if days > _age_limit(recorded):
        yield _share(points, "age of the tare", _AGED, f"{days:.1f} days")
    if apart > WARMER:
        yield _share(points, "temperature of the tare", _PER_KELVIN * apart, f"{apart:.1f} K apart")
    if shape(recorded).severity is Severity.NOTES:
        beside = np.full(len(points.speed), witness.reduced_chi_square(points)[1])
        yield TareDoubt("shape of the tare", points.speed, beside, "its points about a line")
    is_apart = False
    for what, found in (
        ("card of the motor", _beside_card(recorded)),
        ("other tares of the bench", _beside_others(recorded)),
    ):
        if found is not None and found.is_apart:
            is_apart = True
            yield found.doubt(f"tare against {what}", f"{found.words()}; rectangular")
    again = witness.repeatability(tare, recorded.evidence.other_tares)
    # A difference that stands in the budget is in the scatter of the tares too.
    if again is not None and not is_apart:
        yield again


def _share(points: Tare, source: str, relative: float, note: str) -> TareDoubt:
    return TareDoubt(source, points.speed, relative * np.abs(points.torque), note)
