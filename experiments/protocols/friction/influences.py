"""What else than speed the points of a friction run depend on.

Friction varies over the output revolution (mesh depth) and with heat; the bench's output bearing and a vibrating
output take power that is no friction of the gear; the model leans on literature values. What is known of these is
taken off each hold (`corrected`); what is not known is an error that holds share (`common_errors`), one standard
uncertainty of each as a column over the holds:

    place        waves k = 1..8 over the output revolution, as large as visits to the same speed differ by place
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
from experiments.budget import stated_note, torque_scale_uncertainty
from experiments.load import is_stated
from experiments.protocols.friction.points import MeasuredFriction
from experiments.protocols.friction.temperature import DRY, THERMOMETRY, VISCOUS, TemperatureLaw
from experiments.protocols.friction.vibration import Ripple
from experiments.recording import Recording
from experiments.tares.motor_heat import WARMTH
from experiments.torque.ripple import PORT_LAG, port_lag
from experiments.torque.running_torque import Hold
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
from model.identify.running_torque import FrictionPoints, RunningTorque
from model.identify.stribeck import stribeck_curve, stribeck_jacobian

PLACE_ORDERS = tuple(range(1, 9))
"""Orders of the output revolution that friction is looked at over. A slow hold covers a small part of a turn, the same
each time: what is not looked for there bends the curve.
"""
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
SCALE, ZERO = "torque scale", "torque zero"


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
    unknown = 0.0
    if not law.is_known:
        unknown = UNKNOWN_TEMPERATURE.standard_uncertainty * law.viscous.value * 2.0 / 3.0
    return math.hypot(relative, unknown)


@dataclass(frozen=True, kw_only=True)
class _Parts:
    """The friction of each hold (n,) as a fitted curve has it, in parts [N m], at input speeds [rad/s]."""

    speed: FloatArray
    dry: FloatArray
    viscous: FloatArray
    still: FloatArray
    moving: FloatArray

    @property
    def whole(self) -> FloatArray:
        """All of it."""
        return self.dry + self.viscous + self.still + self.moving


def _parts_of(measured: MeasuredFriction, curve: FittedCurve) -> _Parts:
    """The friction of every hold, reference speed included."""
    speed = np.array([abs(h.torque.speed) for h in measured.every])
    still, moving = bearing_parts(curve, speed, {})
    dry, viscous = curve.dry(speed), curve.viscous(speed)
    return _Parts(speed=speed, dry=dry, viscous=viscous, still=still, moving=moving)


def corrected(measured: MeasuredFriction, curve: FittedCurve, ratio: float) -> list[RunningTorque]:
    """The running torques of all holds without what is known not to be the gear's at mean temperature.

    Taken off: output bearing, vibration, what the port's lag and the time between samples do to
    ripples, and the drift of temperature by the law's own coefficients.
    """
    law, warmer, ripple = measured.law, _warmer(measured), measured.ripple
    parts = _parts_of(measured, curve)
    drift = warmer * law.dry.value * parts.dry
    drift += warmer * law.viscous.value * (parts.viscous + parts.moving * 2.0 / 3.0)
    off = measured.output.torque(parts.speed, ratio) + ripple.loss + drift
    return [
        dataclasses.replace(t, torque=t.torque - t.direction * float(known))
        for t, known in zip(
            (h.torque for h in measured.every), off - ripple.lag - ripple.between, strict=True
        )
    ]


def _warmer(measured: MeasuredFriction) -> FloatArray:
    """K by which each hold was warmer than the run's mean; 0 where nobody looked."""
    temperature = np.array([h.torque.temperature for h in measured.every])
    warmer = np.where(np.isfinite(temperature), temperature - measured.law.mean, 0.0)
    return warmer * float(measured.law.is_known)


def common_errors(
    measured: MeasuredFriction,
    curve: FittedCurve,
    spread: Spread,
    recording: Recording,
    ratio: float,
) -> list[CommonError]:
    """The errors that the holds share, seen from a fitted curve."""
    parts = _parts_of(measured, curve)
    errors = _by_warmth(measured, parts)
    errors.append(
        CommonError(
            source=BEARING,
            effect=bearing_relative(curve.gear, measured.law) * (parts.still + parts.moving),
            cause=Cause.BEARING_TORQUE,
        )
    )
    if spread.place > 0.0:
        waves = _place_columns(measured.every, PLACE_ORDERS) * parts.dry[:, None]
        errors.append(
            CommonError(
                source=PLACE,
                effect=spread.place * waves,
                kind="A",
                degrees_of_freedom=float(spread.freedom),
            )
        )
    errors += _by_ripples(measured, recording, curve.gear, parts.speed)
    if measured.law.is_known:
        # It moves no hold, only what is brought to 20 degC.
        errors.append(CommonError(source=THERMOMETRY, effect=np.zeros_like(parts.speed)))
    return errors + _never_seen(measured, recording, parts, ratio)


def _by_warmth(measured: MeasuredFriction, parts: _Parts) -> list[CommonError]:
    """The temperature coefficients of dry and of viscous friction."""
    law, moving = measured.law, parts.moving * 2.0 / 3.0
    per_kelvin = (
        (DRY, law.dry, parts.dry + parts.still, parts.still / law.dry_factor({})),
        (VISCOUS, law.viscous, parts.viscous + moving, moving),
    )
    return [
        CommonError(
            source=source,
            effect=u.standard_uncertainty
            * (_warmer(measured) * drifting + law.warmer * literature),
            note=u.source,
            distribution=u.distribution,
        )
        for source, u, drifting, literature in per_kelvin
    ]


def _by_ripples(
    measured: MeasuredFriction, recording: Recording, gear: HarmonicDrive, speed: FloatArray
) -> list[CommonError]:
    """What the shaken output takes, and what the lag of the torque port makes of ripples."""
    errors: list[CommonError] = []
    if measured.ripple.loss.any():
        errors.append(
            CommonError(
                source=VIBRATION,
                effect=_vibration(measured.ripple, speed),
                **_size_words(
                    None if is_stated(recording, gear) else OUTPUT_INERTIA,
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
    return errors


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
    measured: MeasuredFriction, recording: Recording, parts: _Parts, ratio: float
) -> list[CommonError]:
    """Errors that no data of the run can tell: torque scale, torque zero of holds without a partner, output bearing,
    how the gear's next run would differ, and the motor's temperature in the tare.

    The friction of a motor that is warmer is less by a factor. It is a straight line over speed, as F_c and c_v are
    together: what is left of it in the torques passes for the gear's.
    """
    relative, assumed = torque_scale_uncertainty(recording, measured.channel)
    direction = np.array([h.torque.direction for h in measured.every])
    heat, output = measured.heat, measured.output
    errors = [
        CommonError(
            source=SCALE,
            effect=relative * parts.whole,
            cause=Cause.TORQUE_SCALE,
            is_fitted=False,
            **_size_words(assumed, stated_note(recording, measured.channel)),
        ),
        CommonError(
            source=ZERO,
            effect=direction * measured.zero.standard_uncertainty,
            is_fitted=False,
            **_size_words(measured.zero.assumed, ""),
        ),
        CommonError(
            source=WARMTH,
            effect=heat.constant * parts.whole,
            is_fitted=False,
            **_size_words(heat.assumed, heat.words),
        ),
        CommonError(
            source=RUN_TO_RUN,
            effect=RUN_TO_RUN_RELATIVE * parts.dry,
            note=f"assumed: {100.0 * RUN_TO_RUN_RELATIVE:g} % of dry friction",
            is_fitted=False,
        ),
    ]
    errors += _of_the_tare(measured, parts.speed)
    for part, effect in output.effects(parts.speed, ratio).items():
        said = _size_words(output.assumed, output.source)
        errors.append(CommonError(source=part, effect=effect, is_fitted=False, **said))
    return errors


def _of_the_tare(measured: MeasuredFriction, speed: FloatArray) -> list[CommonError]:
    """What is not known of the tare as a whole: how warm its motor was, and its own doubts."""
    errors = [
        CommonError(
            source=doubt.source,
            effect=doubt.at(speed),
            cause=Cause.TARE,
            note=doubt.note,
            is_fitted=False,
        )
        for doubt in measured.tare_doubts
    ]
    if measured.tare is None:
        return errors
    warmth = CommonError(
        source=TARE,
        effect=measured.heat.tare * measured.tare.at(speed)[0],
        cause=Cause.TARE,
        is_fitted=False,
        **_size_words(measured.heat.assumed, "the same motor, warmer or colder"),
    )
    return [warmth, *errors]


class _SizeWords(TypedDict):
    """What a common error says of its size."""

    note: str
    assumed: str


def _size_words(assumed: Assumed | None, note: str) -> _SizeWords:
    """The words of an error whose size somebody stated, or those of the table's row."""
    if assumed is None:
        return _SizeWords(note=note, assumed="")
    return _SizeWords(note=assumed.note, assumed=assumed.kind)


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
    tare = measured.motor_torque(points.speed)
    whole = curve.whole(points.speed)
    speed = np.array([abs(h.torque.speed) for h in every])
    orders = PLACE_ORDERS[: freedom // _REPETITIONS_PER_ORDER]
    waves = _place_columns(every, orders)
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
    # The fit gives it to all orders: together they vary as much as those by which it was sized.
    place *= math.sqrt(len(orders) / len(PLACE_ORDERS))
    return Spread(point=point, place=place, freedom=freedom)


def _place_columns(holds: list[Hold], orders: tuple[int, ...]) -> FloatArray:
    """cos and sin of the orders of the output angle, each averaged over the angle that a hold covers; (n, 2 orders)."""
    spans = [h.place for h in holds if h.place is not None]
    if len(spans) < len(holds) or not orders:
        return np.empty((len(holds), 0))
    begin, end = np.array(spans).T
    width = np.where(np.abs(end - begin) < 1e-6, 1e-6, end - begin)
    columns: list[FloatArray] = []
    for k in orders:
        columns.append((np.sin(k * (begin + width)) - np.sin(k * begin)) / (k * width))
        columns.append((np.cos(k * begin) - np.cos(k * (begin + width))) / (k * width))
    return np.column_stack(columns)
