"""A gear seen from the motor or from the joint: its friction over speed, its inertia, and the forms that targets hold.

    motor   T = T_f(w)          J = J_wg + J_g/N^2          w: speed of the wave generator
    joint   T = N T_f(N w)      J = N^2 J_wg + J_g          w: speed of the output

J_g turns with the output where the circular spline is fixed; where the flexspline is, it stands.

T_f is equation 20. The load and the motor's rotor are no part of the gear. A target holds less than equation 20:

    linear        c + d0 w                                              URDF; MuJoCo before 4
    polynomial    c + d0 w + d1 w^2 + d2 w^3                            MuJoCo 4
    LuGre         F_c + (F_s - F_c) exp(-(w/v_s)^2) + d0 w + d1 w^2 + d2 w^3    MuJoCo 4, steady; w > 0, odd in w

Each is fitted to equation 20 by least squares of the relative error at speeds even in their logarithm. LuGre, which
can, is fitted so that a torque has its steady speed too: where friction T rises by little, e = dlnT/dlnw, an error of
torque is 1/e times that error of speed, and counts so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from model.arrays import FloatArray
from model.friction import friction_torque
from model.units import RPM
from rig.exchange.identified import IdentifiedGear

Side = Literal["motor", "joint"]
FormName = Literal["linear", "polynomial", "lugre"]
POINTS = 241
"""Speeds at which friction is compared, even in their logarithm."""
_WIDTHS = np.geomspace(0.05, 20.0, 121)
"""Stribeck velocities that are tried, over the gear's own."""


@dataclass(frozen=True, kw_only=True)
class Joint:
    """A gear seen from one side: `ratio` N, `inertia` [kg m2], `friction` over `speeds` (n,) [rad/s, N m], all at that
    side; `stribeck` [rad/s] the gear's own Stribeck velocity there.
    """

    name: str
    side: Side
    ratio: float
    inertia: float
    speeds: FloatArray
    friction: FloatArray
    stribeck: float
    largest_torque: float
    largest_speed: float

    @property
    def factor(self) -> float:
        """Speed of the wave generator over speed at this side."""
        return _factor_at(self.side, self.ratio)


@dataclass(frozen=True, kw_only=True)
class Form:
    """A law of friction that a target can hold, with its relative error against equation 20.

    `coulomb` F_c (c of the laws without LuGre) and `static` F_s [N m], `stribeck` v_s [rad/s], `damping` d0, d1, d2
    [N m s/rad, N m s2/rad2, N m s3/rad3]. `rms` and `worst` are relative, `worst_at` [rad/s] where.
    """

    name: FormName
    coulomb: float
    static: float
    stribeck: float
    damping: tuple[float, float, float]
    rms: float = math.nan
    worst: float = math.nan
    worst_at: float = math.nan

    def torque(self, speed: ArrayLike) -> FloatArray:
        """Friction torque [N m] at speeds [rad/s], odd."""
        v = np.asarray(speed, dtype=np.float64)
        size = np.abs(v)
        dip = (self.static - self.coulomb) * np.exp(-((size / self.stribeck) ** 2))
        d0, d1, d2 = self.damping
        return np.sign(v) * (self.coulomb + dip + size * (d0 + size * (d1 + size * d2)))


def _factor_at(side: Side, ratio: float) -> float:
    """Speed of the wave generator over speed at a side."""
    return ratio if side == "joint" else 1.0


def torque_at(identified: IdentifiedGear, side: Side, speed: ArrayLike) -> FloatArray:
    """The gear's own friction torque [N m] at speeds [rad/s] of one side (equation 20)."""
    factor = _factor_at(side, identified.ratio)
    return factor * friction_torque(identified.gear, factor * np.asarray(speed, dtype=np.float64))


def seen_from(identified: IdentifiedGear, side: Side) -> Joint:
    """The gear at one of its sides, over the speeds that it is compared over."""
    gear, ratio = identified.gear, identified.ratio
    factor = _factor_at(side, ratio)
    speeds = np.geomspace(*identified.compared_over, POINTS) / factor
    turning = gear.inertia.flexspline if identified.mounting == "circular-spline-fixed" else 0.0
    at_input = gear.inertia.wave_generator + turning / ratio**2
    return Joint(
        name=identified.serial or gear.name,
        side=side,
        ratio=ratio,
        inertia=at_input * factor**2,
        speeds=speeds,
        friction=torque_at(identified, side, speeds),
        stribeck=gear.mesh_friction.stribeck_velocity / factor,
        largest_torque=gear.ratings.repeated_peak_torque / ratio * factor,
        largest_speed=gear.ratings.maximum_input_speed / factor,
    )


_RISING = 250.0 * RPM
"""rad/s at the input above which steady speeds count: below, friction of most gears falls, and there are none."""
STEADY, LEAST_RISE = 3.0, 0.1
"""Weight of the speed's relative error over the torque's; least e, for speeds at which friction is flat."""
TOP, TOP_WEIGHT = 0.85, 3.0
"""Share of the greatest speed above which errors weigh more: a polynomial strays at its end."""


def forms_of(joint: Joint) -> dict[FormName, Form]:
    """Every form fitted to a gear's friction, the poorest first."""
    return {
        "linear": _without_dip(joint, 1),
        "polynomial": _without_dip(joint, 3),
        "lugre": _lugre(joint),
    }


def _without_dip(joint: Joint, powers: int) -> Form:
    found = _passive(joint, [], powers, np.ones_like(joint.speeds))
    name: FormName = "linear" if powers == 1 else "polynomial"
    coulomb, *damping = found.tolist()
    return _compared(joint, name, coulomb, coulomb, joint.stribeck, damping)


def _lugre(joint: Joint) -> Form:
    """The Stribeck velocity by trial, the rest by least squares for each."""
    weights = _steady_weights(joint)
    tried = [_with_dip(joint, joint.stribeck * float(width), weights) for width in _WIDTHS]
    allowed = [form for form in tried if min(form.coulomb, form.static) >= 0.0]

    def left(form: Form) -> float:
        return float(np.sum((weights * _error(joint, form)) ** 2))

    return min(allowed or tried, key=left)


def _steady_weights(joint: Joint) -> FloatArray:
    """What each speed's relative error of torque counts (n,): with the error of the steady speed that it makes."""
    rise = np.gradient(np.log(joint.friction), np.log(joint.speeds))
    is_steady = (joint.speeds * joint.factor > _RISING) & (rise > 0.5 * LEAST_RISE)
    speed = np.where(is_steady, STEADY / np.maximum(rise, LEAST_RISE), 0.0)
    top = np.where(joint.speeds > TOP * joint.speeds[-1], TOP_WEIGHT, 1.0)
    return np.asarray(np.hypot(1.0, speed) * top, dtype=np.float64)


def _with_dip(joint: Joint, stribeck: float, weights: FloatArray) -> Form:
    dip = np.exp(-((joint.speeds / stribeck) ** 2))
    rise, coulomb, *damping = _passive(joint, [dip], 3, weights).tolist()
    return _compared(joint, "lugre", coulomb, coulomb + rise, stribeck, damping)


def _passive(
    joint: Joint, columns: list[FloatArray], powers: int, weights: FloatArray
) -> FloatArray:
    """Coefficients of columns and of powers 0, 1, .. of the speed whose highest power brakes.

    Far beyond the speeds that a law was fitted to its highest power alone decides: with a negative coefficient it would
    push, so it is left out and the others are fitted again.
    """
    every = [*columns, *(joint.speeds**power for power in range(powers + 1))]
    found = _relative_least_squares(joint, every, weights)
    if powers > 0 and found[-1] < 0.0:
        return np.append(_passive(joint, columns, powers - 1, weights), 0.0)
    return found


def _relative_least_squares(
    joint: Joint, columns: list[FloatArray], weights: FloatArray
) -> FloatArray:
    """Coefficients (p,) of columns (n,) that leave the least weighted sum of squares of the relative error."""
    design = np.column_stack(columns) * (weights / joint.friction)[:, np.newaxis]
    size = np.linalg.norm(design, axis=0)
    found = np.linalg.lstsq(design / size, weights, rcond=None)[0]
    return np.asarray(found / size, dtype=np.float64)


def _error(joint: Joint, form: Form) -> FloatArray:
    """Relative error (n,) of a form against equation 20."""
    return np.asarray(form.torque(joint.speeds) / joint.friction - 1.0, dtype=np.float64)


def _compared(
    joint: Joint,
    name: FormName,
    coulomb: float,
    static: float,
    stribeck: float,
    damping: list[float],
) -> Form:
    """The form with its relative error over the joint's speeds; powers that it does not have are nothing."""
    d0, d1, d2 = (*damping, 0.0, 0.0)[:3]
    form = Form(name=name, coulomb=coulomb, static=static, stribeck=stribeck, damping=(d0, d1, d2))
    error = _error(joint, form)
    worst = int(np.argmax(np.abs(error)))
    return replace(
        form,
        rms=float(np.sqrt(np.mean(error**2))),
        worst=float(np.abs(error[worst])),
        worst_at=float(joint.speeds[worst]),
    )


def in_words(joint: Joint, speed: float) -> str:
    """A speed of the joint's side, at the input in r/min."""
    return f"{speed * joint.factor / RPM:.4g} r/min at the input"
