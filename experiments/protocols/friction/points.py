"""The points of a friction run, and what else than speed they depend on: place, temperature, reproducibility.

Friction varies over the output revolution (mesh depth) and with heat. Points start at places spread
over the output and go up and down, so that both can be told from speed. With y = friction/fitted
curve - 1 of every point, reference speed included,

    y = c_0 + sum_k (a_k cos k theta_o + b_k sin k theta_o) + (temperature - mean) (d_0 + d_1 viscous share(speed))    k = 1..4

is solved by least squares and divided out where it is significant: what is left holds at mean place
and mean temperature. Near a resonance the vibrating output takes power that is no friction: such points
count less.
"""  # noqa: E501

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from experiments.contract import Evidence
from experiments.errors import AnalysisError
from experiments.evidence import check_recording, time_base_remark
from experiments.planning.speeds import first_resonances
from experiments.recording import Recording
from experiments.torque.running_torque import Hold, foreign_holds, measured_holds
from experiments.torque.tare import read_tare
from experiments.torque.zero import TorqueZero, torque_zero
from model.arrays import FloatArray
from model.gear import HarmonicDrive
from model.identify.running_torque import RunningTorque, Tare, pair_directions

PLACE_ORDERS = (1, 2, 3, 4)
"""Orders of the output revolution that are looked at, as many from the first on as there are points for."""
POINTS_PER_TERM = 2.5
"""Pairs of points that each correcting term needs."""
LEAST_WARMING = 0.2
"""K of span below which temperature is not corrected for."""
HIGHEST_CORRELATION = 0.7
"""Correlation of temperature with log speed above which heat and speed cannot be told apart."""
SIGNIFICANCE = 0.01
FIRST_DAMPING = 0.02
"""Damping ratio of the first mode that the loss near a resonance is estimated with."""


@dataclass(frozen=True, kw_only=True)
class MeasuredFriction:
    """Everything a friction analysis takes from its recording."""

    holds: list[Hold]
    bracket: list[Hold]
    zero: TorqueZero
    tare: Tare | None
    channel: str
    unit: str
    warnings: list[str]

    @property
    def temperature(self) -> FloatArray:
        """Housing temperature of the holds [degC], NaN where it was not recorded."""
        return np.array([h.torque.temperature for h in self.holds])


def measure_friction(recording: Recording, evidence: Evidence) -> MeasuredFriction:
    """Holds, reference speed, zero and tare of a run; raises `AnalysisError` for what cannot be
    averaged over revolutions.
    """
    channel = str(evidence.settings.get("channel", "torque"))
    if channel == "torque" and not recording.has("torque"):
        channel = next(
            (name for name in ("drive_torque", "current") if recording.has(name)), channel
        )
    recording.require("running torque", "input_angle", channel)
    if recording.signals["input_angle"].unit != "rad":
        raise AnalysisError(
            "running torque is averaged over revolutions and needs a rotary input",
            where=recording.metadata.run_id,
            value=f"input_angle in {recording.signals['input_angle'].unit}",
            limit="rad",
            remedy="For a linear axis use the kind `motion`.",
        )
    warnings = list(
        check_recording(recording, "running torque", evidence.maximum_missed_share).warnings
    )
    warnings += time_base_remark(recording)
    zero = torque_zero(recording, channel)
    warnings += zero.warnings
    bracket: list[Hold] = []
    if recording.segments:
        holds, remarks = measured_holds(recording, recording.labelled("hold"), zero, channel)
        bracket, more = measured_holds(recording, recording.labelled("bracket"), zero, channel)
        remarks += more
    else:
        holds, remarks = foreign_holds(recording, zero, channel)
    if not holds:
        raise AnalysisError(
            "no stretch at constant speed over a whole input revolution was found",
            where=recording.metadata.run_id,
            remedy="Hold each speed for whole revolutions.",
        )
    speeds = [abs(h.torque.speed) for h in holds]
    tare, said = read_tare(evidence.tare, min(speeds), max(speeds))
    unit = recording.signals[channel].unit
    return MeasuredFriction(
        holds=holds,
        bracket=bracket,
        zero=zero,
        tare=tare,
        channel=channel,
        unit=unit,
        warnings=[*warnings, *remarks, *said],
    )


def reproducibility(bracket: list[Hold]) -> float:
    """Relative standard deviation of the friction at the reference speed over the run; NaN with less than four visits.

    What a point shows when it is measured again later and elsewhere: more than the scatter between its own revolutions.
    """
    if not bracket:
        return math.nan
    points = pair_directions([h.torque for h in bracket])
    friction = points.friction[points.paired]
    return float(friction.std(ddof=1) / friction.mean()) if len(friction) >= 4 else math.nan


def weighed(holds: list[Hold], spread: float, gear: HarmonicDrive) -> list[RunningTorque]:
    """The running torques with reproducibility and resonance loss in their standard errors.

    Both directions of a point are measured together and share these, so that they must not average out between them.
    """
    share = spread if math.isfinite(spread) else 0.0
    loss = resonance_loss(gear, np.array([abs(h.torque.speed) for h in holds]))
    torques = []
    for hold, lost in zip(holds, loss.tolist(), strict=True):
        t = hold.torque
        common = math.sqrt(2.0) * math.hypot(share * t.torque, lost)
        torques.append(dataclasses.replace(t, standard_error=math.hypot(t.standard_error, common)))
    return torques


def resonance_loss(gear: HarmonicDrive, speed: FloatArray) -> FloatArray:
    """Input torque [N m] that keeps the output vibrating where orders of the kinematic error come near the first mode.

    T = sum over n of (D/2) (n w)^2 |x_n|^2/w with D = 2 zeta w_1 J_o and the relative motion
    x_n = A_n r^2/sqrt((1 - r^2)^2 + (2 zeta r)^2), r = n w/w_1; the larger of both estimates of w_1.
    """
    damping = max(FIRST_DAMPING, 1e-4)
    total = np.zeros_like(speed)
    for mode in first_resonances(gear):
        lost = np.zeros_like(speed)
        for h in gear.kinematic_error:
            r = h.order * speed / mode
            motion = h.amplitude * r**2 / np.sqrt((1.0 - r**2) ** 2 + (2.0 * damping * r) ** 2)
            lost += damping * mode * gear.inertia.output * (h.order * motion) ** 2 * speed
        total = np.maximum(total, lost)
    return total


@dataclass(frozen=True)
class Correction:
    """What was divided out: relative amplitude per output order, and the change per kelvin of the
    dry and the viscous part.
    """

    place: tuple[float, ...] = ()
    per_kelvin: tuple[float, float] | None = None

    def metrics(self) -> dict[str, float]:
        """The correction as numbers of a result."""
        numbers = {
            f"friction_over_output_order_{k}": a
            for k, a in zip(PLACE_ORDERS, self.place, strict=False)
        }
        if self.per_kelvin is not None:
            numbers["dry_friction_per_kelvin"], numbers["viscous_friction_per_kelvin"] = (
                self.per_kelvin
            )
        return numbers

    def words(self) -> str:
        """What the points were brought to."""
        parts = (["mean place on the output"] if self.place else []) + (
            ["mean warmth"] if self.per_kelvin else []
        )
        return " and ".join(parts) if parts else "nothing"


def corrected(
    measured: MeasuredFriction,
    curve: Callable[[FloatArray], FloatArray],
    dry: Callable[[FloatArray], FloatArray],
) -> tuple[MeasuredFriction, Correction]:
    """The points brought to mean place and mean temperature, seen from a fitted curve [N m] over speed [rad/s].

    `dry` is the part of the curve that does not come from the viscosity of the grease.

    Nothing is done where there are too few points, or where place and temperature explain no more
    than chance would.
    """
    every = [*measured.holds, *measured.bracket]
    speed = np.array([abs(h.torque.speed) for h in every])
    direction = np.array([h.torque.direction for h in every])
    tare = measured.tare.at(speed)[0] if measured.tare is not None else np.zeros_like(speed)
    friction = direction * np.array([h.torque.torque for h in every]) - tare
    temperature = _temperature_columns(every, 1.0 - dry(speed) / curve(speed), measured.temperature)
    room = math.floor(len(every) / (2.0 * POINTS_PER_TERM)) - 1 - temperature.shape[1]
    place = _place_columns(every, min(max(room // 2, 0), len(PLACE_ORDERS)))
    terms = place.shape[1] + temperature.shape[1]
    if terms == 0 or room < 0:
        return measured, Correction()
    columns = np.column_stack([place, temperature])
    away = friction / curve(speed) - 1.0
    design = np.column_stack([np.ones(len(every)), columns])
    solution = np.asarray(np.linalg.lstsq(design, away, rcond=None)[0], dtype=np.float64)
    left = away - design @ solution
    if not _explains(away - away.mean(), left, terms, len(every) // 2):
        return measured, Correction()
    brought = direction * (friction / (1.0 + columns @ solution[1:]) + tare)
    moved = [
        dataclasses.replace(h, torque=dataclasses.replace(h.torque, torque=float(t)))
        for h, t in zip(every, brought, strict=True)
    ]
    split = len(measured.holds)
    return dataclasses.replace(
        measured, holds=moved[:split], bracket=moved[split:]
    ), _correction_of(solution[1:], place, temperature)


def _correction_of(solution: FloatArray, place: FloatArray, temperature: FloatArray) -> Correction:
    pairs = solution[: place.shape[1]].reshape(-1, 2)
    per_kelvin = None
    if temperature.shape[1]:
        base, rise = solution[place.shape[1] :]
        per_kelvin = float(base), float(base + rise)
    return Correction(tuple(float(a) for a in np.hypot(pairs[:, 0], pairs[:, 1])), per_kelvin)


def _place_columns(holds: list[Hold], count: int) -> FloatArray:
    """cos and sin of the first `count` orders of the output angle, each averaged over the angle that a point covers."""
    spans = [h.place for h in holds if h.place is not None]
    if len(spans) < len(holds) or count == 0:
        return np.empty((len(holds), 0))
    begin, end = np.array(spans).T
    width = np.where(np.abs(end - begin) < 1e-6, 1e-6, end - begin)
    columns = []
    for k in PLACE_ORDERS[:count]:
        columns.append((np.sin(k * (begin + width)) - np.sin(k * begin)) / (k * width))
        columns.append((np.cos(k * begin) - np.cos(k * (begin + width))) / (k * width))
    return np.column_stack(columns)


def _temperature_columns(holds: list[Hold], viscous: FloatArray, about: FloatArray) -> FloatArray:
    """Temperature about the mean of `about`, and the same times the viscous share; none where heat
    and speed went together.
    """
    temperature = np.array([h.torque.temperature for h in holds])
    if (
        not np.isfinite(temperature).all()
        or float(np.ptp(temperature)) < LEAST_WARMING
        or float(np.ptp(viscous)) < 0.05
    ):
        return np.empty((len(holds), 0))
    speed = np.array([abs(h.torque.speed) for h in holds])
    correlation = float(np.corrcoef(temperature, np.log(speed))[0, 1])
    if abs(correlation) > HIGHEST_CORRELATION:
        return np.empty((len(holds), 0))
    centred = temperature - about.mean()
    return np.column_stack([centred, centred * viscous])


def _explains(before: FloatArray, after: FloatArray, terms: int, pairs: int) -> bool:
    """Whether the terms explain more than chance (F test; both directions of a point count as one)."""
    freedom = pairs - terms - 1
    rest = float(after @ after)
    if freedom < 4 or rest <= 0.0:
        return rest <= 0.0 < float(before @ before)
    ratio = (float(before @ before) - rest) / terms / (rest / freedom)
    return float(scipy.special.fdtrc(terms, freedom, max(ratio, 0.0))) < SIGNIFICANCE
