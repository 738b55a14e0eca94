"""The points of a friction run: holds at constant speed with their running torque, and what belongs to them.

What else than speed they depend on stands in `influences`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from experiments.budget import thermometer_uncertainty
from experiments.contract import Evidence
from experiments.errors import AnalysisError
from experiments.evidence import quality_remarks, time_base_remark
from experiments.protocols.friction.bearing import OutputBearing, output_bearing
from experiments.protocols.friction.temperature import TemperatureLaw, temperature_law
from experiments.protocols.friction.vibration import Ripple, ripple_of
from experiments.recording import Recording
from experiments.tares.motor_heat import MotorHeat, motor_heat
from experiments.tares.tare import REACH, TareDoubt, doubts_of, read_tare
from experiments.torque.running_torque import (
    TEMPERATURE,
    Hold,
    foreign_holds,
    measured_holds,
)
from experiments.torque.zero import TorqueZero, torque_zero
from model.arrays import FloatArray
from model.identify.running_torque import REST_LIMIT, SWING_LIMIT, Tare, pair_directions
from model.units import DEGREE, RPM

SAME_SPEED = 0.03
"""Relative difference of two speeds up to which they are visits to one."""


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
    ripple: Ripple
    """What ripples do to the torque of each hold, reference speed included."""
    law: TemperatureLaw
    output: OutputBearing
    heat: MotorHeat
    tare_doubts: tuple[TareDoubt, ...] = ()
    """What is not known of the tare as a whole."""

    @property
    def every(self) -> list[Hold]:
        """The holds, then those at the reference speed."""
        return [*self.holds, *self.bracket]

    @property
    def temperature(self) -> FloatArray:
        """Housing temperature of the holds [degC], NaN where it was not recorded."""
        return np.array([h.torque.temperature for h in self.holds])

    @property
    def subject(self) -> str:
        """Whose torque is left: with a tare the gear's alone."""
        return "motor + gear" if self.tare is None else "gear"

    def motor_torque(self, speed: FloatArray) -> FloatArray | float:
        """What the tare takes off at these speeds [rad/s]; 0 without one."""
        return 0.0 if self.tare is None else self.tare.at(speed)[0]


def measure_friction(recording: Recording, evidence: Evidence) -> MeasuredFriction:
    """Holds, reference speed, zero and tare of a run; raises `AnalysisError` for a run without a gear, and for
    what cannot be averaged over revolutions.
    """
    if not recording.metadata.gear_mounted:
        raise AnalysisError(
            "the run was made without a gear, and tells no friction of one",
            where=recording.metadata.run_id,
            remedy="Mount the gear and run friction; the motor alone is fitted as motor-tare.",
        )
    channel = _channel_of(recording, evidence)
    warnings = quality_remarks(recording, "running torque", evidence)
    warnings += time_base_remark(recording)
    zero = torque_zero(recording, channel)
    warnings += zero.warnings
    holds, bracket, remarks = _holds_of(recording, zero, channel)
    warnings += remarks
    holds, stuck = _sliding(holds)
    tare, said = read_tare(evidence.tare, _speeds(holds))
    warnings += [*stuck, *said]
    if tare is not None:
        holds, bracket = (_reached(part, tare) for part in (holds, bracket))
    law = temperature_law(
        evidence.settings,
        float(np.mean([hold.torque.temperature for hold in holds])),
        _thermometer(recording),
    )
    heat = motor_heat(recording, law.mean)
    if tare is not None and evidence.tare is not None:
        before = evidence.tare.metrics.get("housing_temperature", math.nan)
        tare, heat = heat.brought(tare, before)
    return MeasuredFriction(
        holds=holds,
        bracket=bracket,
        zero=zero,
        tare=tare,
        channel=channel,
        unit=recording.signals[channel].unit,
        warnings=warnings,
        ripple=ripple_of(recording, [*holds, *bracket], evidence.gear, channel),
        law=law,
        output=output_bearing(recording, evidence.settings),
        heat=heat,
        tare_doubts=doubts_of(evidence.tare) if tare is not None else (),
    )


def _channel_of(recording: Recording, evidence: Evidence) -> str:
    """The channel that tells the torque: the one asked for, else the drive's where there is no torque port."""
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
    return channel


def _holds_of(
    recording: Recording, zero: TorqueZero, channel: str
) -> tuple[list[Hold], list[Hold], list[str]]:
    """The holds of a run, those at the reference speed, and words on what could not be used."""
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
    return holds, bracket, remarks


def _reached(holds: list[Hold], tare: Tare) -> list[Hold]:
    """The holds at speeds that the tare reaches."""
    reached = tare.reaches(_speeds(holds), REACH)
    return [hold for hold, is_reached in zip(holds, reached, strict=True) if is_reached]


def _sliding(holds: list[Hold]) -> tuple[list[Hold], list[str]]:
    """The holds at speeds at which the input never stopped and went, and words that name the other speeds.

    Raises `AnalysisError` where it did at all of them.
    """
    speed = _speeds(holds)
    stuck = speed[[h.torque.sticks for h in holds]]
    if not len(stuck):
        return holds, []
    named = ", ".join(f"{rpm:g}" for rpm in np.unique(np.round(stuck / RPM, 1)))
    beside = np.abs(speed[:, None] / stuck - 1.0).min(axis=1)
    sliding = [h for h, away in zip(holds, beside, strict=True) if away > SAME_SPEED]
    if not sliding:
        raise AnalysisError(
            "the input stopped and went at every speed, and its mean torque is no running torque",
            where="holds",
            value=f"{named} r/min",
            limit=f"<= {REST_LIMIT / DEGREE:g} degrees of standstill at the mean speed, "
            f"a swing of the speed <= {100.0 * SWING_LIMIT:g} %",
            remedy="Run faster, or stiffen the speed loop.",
        )
    return sliding, [
        f"The input stopped and went at {named} r/min: these speeds are left out, the mean torque there is not "
        "that of one speed. Run faster, or stiffen the speed loop."
    ]


def _thermometer(recording: Recording) -> float:
    """Standard uncertainty of the housing's temperature [K]."""
    if not recording.has(TEMPERATURE):
        return 0.0
    return thermometer_uncertainty(recording)[0]


def _speeds(holds: list[Hold]) -> FloatArray:
    return np.array([abs(h.torque.speed) for h in holds])


def reproducibility(bracket: list[Hold]) -> float:
    """Relative standard deviation of the friction at the reference speed over the run; NaN with less than four visits.

    What a point shows when it is measured again later and elsewhere: more than the scatter between its own revolutions.
    """
    if not bracket:
        return math.nan
    points = pair_directions([h.torque for h in bracket])
    friction = points.friction[points.paired]
    return float(friction.std(ddof=1) / friction.mean()) if len(friction) >= 4 else math.nan
