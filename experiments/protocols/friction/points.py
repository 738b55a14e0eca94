# pyright: standard
"""The points of a friction run, and what else than speed they depend on.

Friction varies over the output revolution (mesh depth) and with heat; the bench's output bearing and a vibrating
output take power that is no friction of the gear; the model leans on literature values. What is known of these is
taken off each hold (`corrected`); what is not known is an error that holds share (`common_errors`), one standard
uncertainty of each as a column over the holds:

    place        waves k = 1..4 over the output revolution, as large as visits to the same speed differ by place
    temperature  of dry and of viscous friction: (T - mean) of each hold, and the bearing's M_0 away from 20 degC
    M_0          the factor f_0 nu^(2/3) of equation 18
    tare         the motor was warmer or colder than in the tare
    vibration    damping and first mode, behind the power that the shaken output takes
    lag          of the torque port, where torque and speed ripple together
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypedDict

import numpy as np

from experiments.assumed import OUTPUT_INERTIA, Assumed
from experiments.assumed import TEMPERATURE as UNKNOWN_TEMPERATURE
from experiments.budget import stated_note, thermometer_uncertainty, torque_scale_uncertainty
from experiments.contract import Evidence
from experiments.errors import AnalysisError
from experiments.evidence import check_recording, time_base_remark
from experiments.load import is_stated
from experiments.protocols.friction.bearing import OutputBearing, output_bearing
from experiments.protocols.friction.temperature import (
    DRY,
    THERMOMETRY,
    VISCOUS,
    TemperatureLaw,
    temperature_law,
)
from experiments.protocols.friction.vibration import Ripple, port_lag, ripple_of
from experiments.recording import Recording
from experiments.tares.motor_heat import WARMTH, MotorHeat, motor_heat
from experiments.tares.tare import REACH, TareDoubt, doubts_of, read_tare
from experiments.torque.running_torque import (
    TEMPERATURE,
    Hold,
    foreign_holds,
    measured_holds,
)
from experiments.torque.zero import TorqueZero, torque_zero
from model.arrays import FloatArray
from model.friction import TorqueBalance, bearing_lever, bearing_magnitude, mesh_lever
from model.gear import HarmonicDrive, Origin
from model.identify.common_errors import (
    UNREPEATED,
    CommonError,
    Spread,
    means_by,
    spread_beyond,
)
from model.identify.estimate import Cause
from model.identify.friction import tare_scatter
from model.identify.repeated import FEWEST
from model.identify.running_torque import (
    REST_LIMIT,
    FrictionPoints,
    RunningTorque,
    Tare,
    pair_directions,
)
from model.identify.stribeck import stribeck_curve, stribeck_jacobian
from model.units import DEGREE, RPM

PLACE_ORDERS = tuple(range(1, 9))
"""Orders of the output revolution that friction is looked at over. A slow hold covers a small part of a turn, the same
each time: what is not looked for there bends the curve.
"""
SAME_SPEED = 0.03
"""Relative difference of two speeds up to which they are visits to one."""
_REPETITIONS_PER_ORDER = 3
"""Repetitions of speeds that each order needs."""
_BEARING_RELATIVE = 0.2
"""Relative standard uncertainty of M_0 where f_0 and nu_0 are taken from the literature."""
LOSS_RELATIVE, OWN_RELATIVE, HOLD_RELATIVE = 2.0, 1.0, 0.5
"""Relative standard uncertainties of the loss by vibration: of a factor that all speeds share, since stiffness (within
40 %, a factor of 2.8), hysteresis and damping (within three) are the same gear's; of one that each speed has for
itself, since orders take their loss in other proportions; and, over that, of each hold's, whose sidebands beat. Visits
to one speed share the first two."""
PRODUCT_RELATIVE = 0.3
"""Relative standard uncertainty of what is missing of the product of ripples: six orders stand for all."""
PLACE = "place on the output"
BEARING, TARE, VIBRATION = "bearing no-load torque", "tare", "vibration near resonances"
RUN_TO_RUN = "from run to run"
RUN_TO_RUN_RELATIVE = 0.01
"""Relative standard uncertainty of dry friction from one run of a gear to the next, assumed of greased gears: a run
does not show how the next one will be."""
PORT_LAG = "lag of the torque port"
"""Relative standard uncertainty of the lag: 0 to twice as much."""
SCALE, ZERO = "torque scale", "torque zero"


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
    holds, stuck = _sliding(holds)
    tare, said = read_tare(evidence.tare, _speeds(holds))
    said = [*stuck, *said]
    if tare is not None:
        holds, bracket = (
            [
                h
                for h, reached in zip(part, tare.reaches(_speeds(part), REACH), strict=True)
                if reached
            ]
            for part in (holds, bracket)
        )
    law = temperature_law(
        evidence.settings,
        float(np.mean([hold.torque.temperature for hold in holds])),
        _thermometer(recording),
    )
    heat = motor_heat(recording, law.mean)
    if tare is not None and evidence.tare is not None:
        before = evidence.tare.metrics.get("housing_temperature", math.nan)
        tare, heat = heat.brought(tare, before)
    unit = recording.signals[channel].unit
    return MeasuredFriction(
        holds=holds,
        bracket=bracket,
        zero=zero,
        tare=tare,
        channel=channel,
        unit=unit,
        warnings=[*warnings, *remarks, *said],
        ripple=ripple_of(recording, [*holds, *bracket], evidence.gear, channel),
        law=law,
        output=output_bearing(recording, evidence.settings),
        heat=heat,
        tare_doubts=doubts_of(evidence.tare) if tare is not None else (),
    )


def _sliding(holds: list[Hold]) -> tuple[list[Hold], list[str]]:
    """The holds at speeds at which the input never stuck, and words that name the other speeds.

    Raises `AnalysisError` where it stuck at all of them.
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
            "the input stood still at every speed, and a torque at standstill is no running torque",
            where="holds",
            value=f"{named} r/min",
            limit=f"<= {REST_LIMIT / DEGREE:g} degrees of standstill at the mean speed",
            remedy="Run faster, or stiffen the speed loop.",
        )
    return sliding, [
        f"The input stopped and went at {named} r/min: these speeds are left out, standstill is no "
        "sliding friction. Run faster, or stiffen the speed loop."
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


@dataclass(frozen=True, kw_only=True)
class FittedCurve:
    """Friction over speed as a fit has it, at the run's mean temperature, in parts [N m] at input speeds [rad/s]."""

    gear: HarmonicDrive
    balance: TorqueBalance
    values: FloatArray
    law: TemperatureLaw

    def dry(self, speed: FloatArray) -> FloatArray:
        """Mesh friction without its viscous part."""
        coulomb, static, velocity, shape, _ = self.values
        lever = mesh_lever(self.gear, self.balance)
        return lever * stribeck_curve(speed, (coulomb, static, velocity, shape, 0.0))

    def viscous(self, speed: FloatArray) -> FloatArray:
        """Viscous mesh friction."""
        return mesh_lever(self.gear, self.balance) * float(self.values[4]) * np.abs(speed)

    def whole(self, speed: FloatArray) -> FloatArray:
        """All of it."""
        return self.dry(speed) + self.viscous(speed) + bearing_torque(self, speed)


def bearing_parts(
    curve: FittedCurve, speed: FloatArray, shared: Mapping[str, float]
) -> tuple[FloatArray, FloatArray]:
    """l_b M_0 at the run's mean temperature [N m]: what it has at rest, and what grows with speed.

    `shared`: what is known of the temperature coefficients (`FrictionFit.shared`).
    """
    gear, low = curve.gear, curve.gear.options.low_speed_branch
    lever = bearing_lever(gear, curve.balance)
    still = lever * bearing_magnitude(gear.bearing, 0.0, low_speed_branch=low)
    moving = lever * bearing_magnitude(gear.bearing, speed, low_speed_branch=low) - still
    thin = curve.law.viscous_factor(shared) ** (2.0 / 3.0)
    return np.full_like(moving, still * curve.law.dry_factor(shared)), moving * thin


def bearing_torque(curve: FittedCurve, speed: FloatArray) -> FloatArray:
    """l_b M_0 at the run's mean temperature [N m]."""
    still, moving = bearing_parts(curve, speed, {})
    return still + moving


def bearing_relative(gear: HarmonicDrive, law: TemperatureLaw) -> float:
    """Relative standard uncertainty of M_0: of its factor, and of a temperature that nobody measured."""
    factor = gear.origins.get("bearing.friction_factor", Origin("assumed"))
    relative = _BEARING_RELATIVE
    if factor.standard_uncertainty is not None and gear.bearing.friction_factor > 0.0:
        relative = factor.standard_uncertainty / gear.bearing.friction_factor
    unknown = (
        0.0
        if law.is_known
        else UNKNOWN_TEMPERATURE.standard_uncertainty * law.viscous.value * 2.0 / 3.0
    )
    return math.hypot(relative, unknown)


def corrected(measured: MeasuredFriction, curve: FittedCurve, ratio: float) -> list[RunningTorque]:
    """The running torques of all holds without what is known not to be the gear's at mean temperature.

    Taken off: output bearing, vibration, what the port's lag and the time between samples do to
    ripples, and the drift of temperature by the law's own coefficients.
    """
    torques = [h.torque for h in measured.every]
    speed = np.array([abs(t.speed) for t in torques])
    law, warmer, ripple = measured.law, _warmer(measured), measured.ripple
    _, moving = bearing_parts(curve, speed, {})
    drift = warmer * law.dry.value * curve.dry(speed)
    drift += warmer * law.viscous.value * (curve.viscous(speed) + moving * 2.0 / 3.0)
    off = measured.output.torque(speed, ratio) + ripple.loss + drift
    return [
        dataclasses.replace(
            t,
            torque=t.torque - t.direction * float(known),
        )
        for t, known in zip(torques, off - ripple.lag - ripple.between, strict=True)
    ]


def _warmer(measured: MeasuredFriction) -> FloatArray:
    """K by which each hold was warmer than the run's mean; 0 where nobody looked."""
    temperature = np.array([h.torque.temperature for h in measured.every])
    return np.where(np.isfinite(temperature), temperature - measured.law.mean, 0.0) * (
        1.0 if measured.law.is_known else 0.0
    )


def common_errors(
    measured: MeasuredFriction,
    curve: FittedCurve,
    spread: Spread,
    recording: Recording,
    ratio: float,
) -> list[CommonError]:
    """The errors that the holds share, seen from a fitted curve."""
    every, law = measured.every, measured.law
    speed = np.array([abs(h.torque.speed) for h in every])
    direction = np.array([h.torque.direction for h in every])
    dry, viscous = curve.dry(speed), curve.viscous(speed)
    still, moving = bearing_parts(curve, speed, {})
    tare = measured.tare.at(speed)[0] if measured.tare is not None else np.zeros_like(speed)
    gear_torque = dry + viscous + still + moving
    per_kelvin = {
        DRY: (dry + still, still / law.dry_factor({})),
        VISCOUS: (viscous + moving * 2.0 / 3.0, moving * 2.0 / 3.0),
    }
    errors = [
        CommonError(
            source=source,
            effect=u.standard_uncertainty
            * (_warmer(measured) * drifting + law.warmer * literature),
            note=u.source,
            distribution=u.distribution,
        )
        for (source, (drifting, literature)), u in zip(
            per_kelvin.items(), (law.dry, law.viscous), strict=True
        )
    ]
    errors.append(
        CommonError(
            source=BEARING,
            effect=bearing_relative(curve.gear, law) * (still + moving),
            cause=Cause.BEARING_TORQUE,
        )
    )
    if spread.place > 0.0:
        waves = _place_columns(every, PLACE_ORDERS) * dry[:, None]
        errors.append(
            CommonError(
                source=PLACE,
                effect=spread.place * waves,
                kind="A",
                degrees_of_freedom=float(spread.freedom),
            )
        )
    if measured.ripple.loss.any():
        errors.append(
            CommonError(
                source=VIBRATION,
                effect=_vibration(measured.ripple, speed),
                **_said(
                    None if is_stated(recording, curve.gear) else OUTPUT_INERTIA,
                    "damping and first mode of the parameter set",
                ),
            )
        )
    if measured.ripple.lag.any():
        errors.append(
            CommonError(
                source=PORT_LAG,
                effect=measured.ripple.lag_uncertainty,
                note=port_lag(recording, measured.channel)[2],
            )
        )
    if law.is_known:
        # It moves no hold, only what is brought to 20 degC.
        errors.append(CommonError(source=THERMOMETRY, effect=np.zeros_like(speed)))
    return errors + _never_seen(
        measured,
        recording,
        speed,
        direction,
        dry=dry,
        gear_torque=gear_torque,
        tare=tare,
        ratio=ratio,
    )


def _vibration(ripple: Ripple, speed: FloatArray) -> FloatArray:
    """What one standard uncertainty of the loss does: of the factor that all share, of each speed's, of each hold's."""
    _, level = np.unique(np.round(np.log(speed), 2), return_inverse=True)
    seen = ripple.loss - ripple.unseen
    own = (
        OWN_RELATIVE * seen + ripple.unseen + PRODUCT_RELATIVE * np.abs(ripple.lag + ripple.between)
    )
    by_speed, by_hold = np.eye(int(level.max()) + 1)[level], HOLD_RELATIVE * np.eye(len(speed))
    return np.column_stack([LOSS_RELATIVE * seen, own[:, None] * by_speed, own[:, None] * by_hold])


def _never_seen(
    measured: MeasuredFriction,
    recording: Recording,
    speed: FloatArray,
    direction: FloatArray,
    *,
    dry: FloatArray,
    gear_torque: FloatArray,
    tare: FloatArray,
    ratio: float,
) -> list[CommonError]:
    """Errors that no data of the run can tell: torque scale, torque zero of holds without a partner, output bearing,
    how the gear's next run would differ, and the motor's temperature in the tare.

    The friction of a motor that is warmer is less by a factor. It is a straight line over speed, as F_c and c_v are
    together: what is left of it in the torques passes for the gear's.
    """
    relative, assumed = torque_scale_uncertainty(recording, measured.channel)
    heat, output = measured.heat, measured.output
    errors = [
        CommonError(
            source=SCALE,
            effect=relative * gear_torque,
            cause=Cause.TORQUE_SCALE,
            is_fitted=False,
            **_said(assumed, stated_note(recording, measured.channel)),
        ),
        CommonError(
            source=ZERO,
            effect=direction * measured.zero.standard_uncertainty,
            is_fitted=False,
            **_said(measured.zero.assumed, ""),
        ),
        CommonError(
            source=WARMTH,
            effect=heat.constant * gear_torque,
            is_fitted=False,
            **_said(heat.assumed, heat.words),
        ),
        CommonError(
            source=RUN_TO_RUN,
            effect=RUN_TO_RUN_RELATIVE * dry,
            note=f"assumed: {100.0 * RUN_TO_RUN_RELATIVE:g} % of dry friction",
            is_fitted=False,
        ),
    ]
    if measured.tare is not None:
        errors.append(
            CommonError(
                source=TARE,
                effect=heat.tare * tare,
                cause=Cause.TARE,
                is_fitted=False,
                **_said(heat.assumed, "the same motor, warmer or colder"),
            )
        )
    for doubt in measured.tare_doubts:
        errors.append(
            CommonError(
                source=doubt.source,
                effect=doubt.at(speed),
                cause=Cause.TARE,
                note=doubt.note,
                is_fitted=False,
            )
        )
    for part, effect in output.effects(speed, ratio).items():
        said = _said(output.assumed, output.source)
        errors.append(CommonError(source=part, effect=effect, is_fitted=False, **said))
    return errors


class _Said(TypedDict):
    """What a common error says of its size."""

    note: str
    assumed: str


def _said(assumed: Assumed | None, note: str) -> _Said:
    """The words of an error whose size somebody stated, or those of the table's row."""
    if assumed is None:
        return _Said(note=note, assumed="")
    return _Said(note=assumed.note, assumed=assumed.kind)


def spread_of(
    measured: MeasuredFriction,
    points: FrictionPoints,
    error: FloatArray,
    curve: FittedCurve,
    others: list[CommonError],
) -> Spread:
    """How far a point comes out that is measured again, and how friction varies over the output.

    `points` are those of all holds, `error` (n,) their standard errors, `others` the further errors that they share.
    The waves over the output show between the speeds too (each has its own places); the scatter is that of visits to
    the same speed alone, so that a curve that misses its points does not pass for scatter.
    """
    every = measured.every
    freedom = len(points.speed) - len(np.unique(points.level))
    if freedom < FEWEST:
        return UNREPEATED
    tare = measured.tare.at(points.speed)[0] if measured.tare is not None else 0.0
    whole = curve.whole(points.speed)
    speed = np.array([abs(h.torque.speed) for h in every])
    waves = _place_columns(every, PLACE_ORDERS[: freedom // _REPETITIONS_PER_ORDER])
    waves = points.mean_of(waves * curve.dry(speed)[:, None]) / whole[:, None]
    if measured.tare is not None:
        others = [*others, tare_scatter(measured.tare, speed)]
    known = np.column_stack([points.mean_of(c.columns) for c in others if c.is_fitted])
    known = known / whole[:, None]
    relative = (points.friction - tare) / whole - 1.0
    tangents = stribeck_jacobian(points.speed, curve.values) / whole[:, None]
    _, place = spread_beyond(tangents, relative, error / whole, known, waves)
    point, _ = spread_beyond(
        means_by(points.level),
        relative,
        error / whole,
        np.column_stack([known, place * waves]),
        waves[:, :0],
    )
    return Spread(point=point, place=place, freedom=freedom)


def _place_columns(holds: list[Hold], orders: tuple[int, ...]) -> FloatArray:
    """cos and sin of the orders of the output angle, each averaged over the angle that a hold covers; (n, 2 orders)."""
    spans = [h.place for h in holds if h.place is not None]
    if len(spans) < len(holds) or not orders:
        return np.empty((len(holds), 0))
    begin, end = np.array(spans).T
    width = np.where(np.abs(end - begin) < 1e-6, 1e-6, end - begin)
    columns = []
    for k in orders:
        columns.append((np.sin(k * (begin + width)) - np.sin(k * begin)) / (k * width))
        columns.append((np.cos(k * begin) - np.cos(k * (begin + width))) / (k * width))
    return np.column_stack(columns)
