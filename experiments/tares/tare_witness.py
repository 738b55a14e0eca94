"""A tare held against what else is known of its motor: its own line, the motor's card, the bench's other tares.

    E_n = |T - T_ref| / sqrt(U^2 + U_ref^2)

with U (k = 2) of what the two do not share: one torque channel has one scale and one zero, and they cancel between
tares. Beyond 1 the difference stands in the budget, as half the width of a rectangle, so that U reaches from the one to
the other; beyond a factor of two one of them is not of this motor. A card that states no uncertainty holds within that
factor and says no more.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from experiments.budget import torque_scale_uncertainty
from experiments.recording import Recording
from experiments.result import Result
from experiments.tares.motor_heat import FRICTION, FRICTION_UNCERTAINTY, REFERENCE, WARMER
from experiments.tares.tare import KIND, TareDoubt, tare_of
from model.arrays import FloatArray
from model.errors import ParameterError
from model.identify.estimate import NORMAL_COVERAGE_FACTOR
from model.identify.least_squares import student_quantile
from model.identify.running_torque import Tare
from model.motor import shipped_motor

CARD = "motor_friction"
"""Entry of a run's process record: what the motor's card says of its own friction, each with its standard uncertainty
where the card states one."""
FACTOR = 2.0
"""By which a tare may be away from another of the same motor, or from the motor's card."""
ENOUGH = 2
"""Other tares from which on their scatter tells how well a tare comes out again."""
UNREPEATED = 0.05
"""Relative standard uncertainty of a tare that was not taken again, assumed: coupling, seal and grease are not as they
were each time that a motor is set up."""
OWN_LINE = 0.1
"""Relative difference between the mean of a tare's points and that of the line that its own result states."""
LARGEST_CHI_SQUARE = 4.0
"""Per degree of freedom: a tare further from a straight line than this many times its own errors."""
STRAY_SHARE, STRAY_RATIO = 0.1, 5.0
"""A point of a tare is a stray one where it lies further from the line of all others than this share of the tare and
so many times as far as any of them. The slowest and the fastest are none: friction of a motor may bend there."""
STRAY_OF = 5
"""Speeds from which on a line tells a stray point."""
ANOTHER = f"rig run {KIND}"
"""The command that takes a tare."""


@dataclass(frozen=True, kw_only=True)
class MotorCard:
    """Coulomb [N m] and viscous friction [N m s/rad] that a motor's card states at 20 degC; standard uncertainties, NaN
    where it states none; the source of the numbers.
    """

    coulomb: float
    viscous: float
    coulomb_uncertainty: float = math.nan
    viscous_uncertainty: float = math.nan
    source: str = ""

    def torque(self, speed: FloatArray) -> FloatArray:
        """Its friction at speeds [rad/s]."""
        return self.coulomb + self.viscous * speed

    def uncertainty(self, speed: FloatArray) -> FloatArray:
        """The standard uncertainty of that; NaN where the card states none."""
        return np.hypot(self.coulomb_uncertainty, self.viscous_uncertainty * speed)


def motor_card(recording: Recording) -> MotorCard | None:
    """The card of the motor of a run, as the run keeps it; of a run without one by the name of a shipped motor."""
    process = recording.metadata.process
    kept = process.get(CARD)
    if not isinstance(kept, Mapping):
        try:
            kept = shipped_motor(str(process.get("motor", "")).lower()).stated_friction()
        except ParameterError:
            return None
    card = cast("Mapping[str, Any]", kept)
    return MotorCard(
        coulomb=float(card["coulomb"]),
        viscous=float(card["viscous"]),
        coulomb_uncertainty=_or_nan(card.get("coulomb_u")),
        viscous_uncertainty=_or_nan(card.get("viscous_u")),
        source=str(card.get("source", "")),
    )


def _or_nan(value: object) -> float:
    return float(value) if isinstance(value, (int, float)) else math.nan


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """A tare beside a reference at some speeds [rad/s]: their difference [N m], E_n (NaN where the reference has no
    uncertainty), and the ratio of their means with its standard uncertainty.
    """

    speed: FloatArray
    difference: FloatArray
    normalised: float
    ratio: float
    ratio_uncertainty: float

    @property
    def is_beyond_factor(self) -> bool:
        """Whether tare and reference are more than a factor of two apart, whatever the tare's own error."""
        reach = 2.0 * self.ratio_uncertainty
        return not self.ratio + reach >= 1.0 / FACTOR or not self.ratio - reach <= FACTOR

    @property
    def is_apart(self) -> bool:
        """Whether they differ by more than what they do not share explains."""
        return self.normalised > 1.0

    def doubt(self, source: str, note: str) -> TareDoubt:
        """The difference as a line of the budget."""
        return TareDoubt(source, self.speed, np.abs(self.difference) / math.sqrt(3.0), note)

    def words(self) -> str:
        """What was found."""
        largest = 1e3 * float(np.abs(self.difference).max())
        told = f", |E_n| {self.normalised:.2g}" if math.isfinite(self.normalised) else ""
        return f"{self.ratio:.3g} of it, at most {largest:.2g} mN m apart{told}"


def against_card(tare: Result, recording: Recording) -> Comparison | None:
    """A tare beside the card of its motor, brought to 20 degC; None where either says nothing."""
    own, card = tare_of(tare), motor_card(recording)
    if own is None or card is None or not card.torque(own.speed).min() > 0.0:
        return None
    factor, warmth = _brought(_temperature(tare), REFERENCE)
    relative = math.hypot(warmth, torque_scale_uncertainty(recording)[0])
    speed = own.speed[[0, -1]]
    torque, error, _ = own.at(speed)
    u = np.hypot(np.hypot(factor * error, relative * factor * torque), card.uncertainty(speed))
    return _compared(own, speed, factor * torque, card.torque(speed), u, relative=relative)


def against_others(tare: Result, others: Sequence[Result]) -> Comparison | None:
    """A tare beside the middle of the bench's other ones, each brought to its temperature; None without another."""
    own = tare_of(tare)
    if own is None:
        return None
    speed = own.speed[[0, -1]]
    found = [one for other in others if (one := as_warm(other, tare, speed)) is not None]
    if not found:
        return None
    torques, variances = np.array([t for t, _ in found]), np.array([v for _, v in found])
    torque, error, _ = own.at(speed)
    reference = np.median(torques, axis=0)
    # Where there are two or more, their own scatter tells how well they come out again.
    scatter = torques.var(axis=0, ddof=1) if len(torques) >= ENOUGH else 0.0
    u = np.sqrt(error**2 + (_warmth() * torque) ** 2 + np.maximum(variances.mean(axis=0), scatter))
    return _compared(own, speed, torque, reference, u, relative=_warmth())


def as_warm(other: Result, tare: Result, speed: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Friction and variance of another tare at these speeds, as warm as this one was."""
    its = tare_of(other)
    if its is None:
        return None
    factor, relative = _brought(_temperature(other), _temperature(tare))
    torque, error, _ = its.at(speed)
    return factor * torque, (factor * error) ** 2 + (relative * torque) ** 2


def _compared(
    own: Tare,
    speed: FloatArray,
    torque: FloatArray,
    reference: FloatArray,
    u: FloatArray,
    *,
    relative: float,
) -> Comparison:
    """`relative`: standard uncertainty of the tare as a whole beside that of its points."""
    away = torque - reference
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = float(torque.mean() / reference.mean())
    error = float(own.at(speed)[1].mean()) / max(abs(float(reference.mean())), 1e-12)
    return Comparison(
        speed=speed,
        difference=away,
        normalised=float((np.abs(away) / (2.0 * u)).max()),
        ratio=ratio,
        ratio_uncertainty=math.hypot(error, relative * ratio),
    )


def repeatability(tare: Result, others: Sequence[Result]) -> TareDoubt | None:
    """How well this tare comes out again: by the scatter of all of them, assumed where there are too few."""
    own = tare_of(tare)
    if own is None:
        return None
    speed = own.speed[[0, -1]]
    found = [one[0] for other in others if (one := as_warm(other, tare, speed)) is not None]
    torque = own.at(speed)[0]
    if len(found) < ENOUGH:
        note = f"assumed: {100.0 * UNREPEATED:g} % of the motor's friction; too few other tares"
        return TareDoubt("tare, not repeated", speed, UNREPEATED * np.abs(torque), note)
    every = np.array([torque, *found])
    # Few tares know their own scatter poorly: as wide as Student's t makes it.
    wider = student_quantile(len(every) - 1.0) / NORMAL_COVERAGE_FACTOR
    note = f"scatter of {len(every)} tares"
    return TareDoubt("tare, from one to the next", speed, wider * every.std(axis=0, ddof=1), note)


def reduced_chi_square(tare: Tare) -> tuple[float, float]:
    """Of the tare's points about a straight line, per degree of freedom, and their r.m.s. beside it [N m]; NaN with
    less than four speeds.
    """
    freedom = len(tare.speed) - 2
    if freedom < 2:
        return math.nan, math.nan
    error = np.maximum(tare.standard_error, 1e-9)
    design = np.column_stack([np.ones_like(tare.speed), tare.speed]) / error[:, np.newaxis]
    left = tare.torque / error - design @ np.linalg.lstsq(design, tare.torque / error)[0]
    return float(left @ left) / freedom, float(np.sqrt(np.mean((left * error) ** 2)))


def stray_point(tare: Tare) -> tuple[float, float, float] | None:
    """Speed [rad/s] of the one point beside the line of all others, how far, and how far the others are at most [N m].

    The line has the median of the slopes between any two points, which one of them does not move.
    """
    speed, torque = tare.speed, tare.torque
    if len(speed) < STRAY_OF:
        return None
    one, other = np.triu_indices(len(speed), 1)
    slope = float(np.median((torque[other] - torque[one]) / (speed[other] - speed[one])))
    away = torque - slope * speed
    away = away - np.median(away)
    worst = int(np.argmax(np.abs(away)))
    rest = float(np.delete(np.abs(away), worst).max())
    least = max(STRAY_SHARE * abs(float(torque.mean())), STRAY_RATIO * rest)
    if not 0 < worst < len(speed) - 1 or not abs(away[worst]) > least:
        return None
    return float(speed[worst]), float(away[worst]), rest


def off_its_own_line(tare: Result) -> float:
    """By how much the mean of a tare's points is off the line that its own result states, relative; NaN without."""
    own = tare_of(tare)
    line = [tare.estimates.get(name) for name in ("motor_coulomb", "motor_viscous")]
    if own is None or line[0] is None or line[1] is None:
        return math.nan
    stated = float((line[0].value + line[1].value * own.speed).mean())
    return abs(float(own.torque.mean()) - stated) / max(abs(stated), 1e-12)


def remarks_of(recording: Recording, tare: Result, others: Sequence[Result]) -> tuple[str, ...]:
    """What is to be said of a tare by itself: where it is away from card and other tares, and that it stands alone."""
    said: list[str] = []
    for what, found in (
        ("the motor's card", against_card(tare, recording)),
        ("the bench's other tares", against_others(tare, others)),
    ):
        if found is not None and (found.is_apart or found.is_beyond_factor):
            said.append(
                f"This tare is away from {what}: {found.words()}. Look for a rubbing coupling, a cold motor, a wrong "
                f"scale; then take another one: {ANOTHER}."
            )
    if len(others) < ENOUGH:
        said.append(alone(len(others)))
    return tuple(said)


def alone(others: int) -> str:
    """What is said of a tare with less than two others beside it."""
    have = "no other tare" if others == 0 else "one other tare only"
    return (
        f"The motor tare has {have} of this bench beside it, so that how well it comes out again is assumed. Take one "
        f"before and one after: {ANOTHER}."
    )


def _temperature(tare: Result) -> float:
    return tare.metrics.get("housing_temperature", math.nan)


def _warmth() -> float:
    """Relative standard uncertainty of a motor's friction by what the housing does not tell of its temperature."""
    return abs(FRICTION) * WARMER


def _brought(here: float, there: float) -> tuple[float, float]:
    """Friction at `there` over that at `here` [degC], and its relative standard uncertainty; 1 where not recorded."""
    away = there - here
    if not math.isfinite(away):
        return 1.0, abs(FRICTION) * 2.0 * WARMER
    return 1.0 + FRICTION * away, math.hypot(_warmth(), FRICTION_UNCERTAINTY * away)
