"""The least scatter that the information in a run allows (Cramer and Rao), from what was drawn.

No code of the analyses has a part in it.

For unbiased estimates from samples y with independent normal noise of variance s_i^2,

    cov >= F^-1,   F = sum (dy_i/dp)(dy_i/dp)^T / s_i^2

The sensitivities are of the law that the quantity stands in: equation 19 at the speeds that were
held; a straight line for the bare motor; sines over whole revolutions; one torsional mode driven by
the recorded input. The noise is that of the port as drawn and the quantisation of each channel, as
if it were white. Nuisances (zero, drift, temperature, other modes, patterns over the angle) are left
out, so that the bounds are lower than any analysis can come: a study asks only where they lie below
half a target.

There are bounds for: home (both marks), warm-up (running torque), motor-tare (Coulomb and viscous
friction), friction (the five parameters, running torques), kinematic-error (amplitudes),
velocity-steps (frequency, K/J_o, damping ratio), starting-torque (all three). There are none for
phases, transmission accuracy, output inertia and stiffness.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import scipy

from experiments.recording import Recording, Segment
from model.arrays import FloatArray

Bounds = dict[str, float]
"""Standard deviation by quantity; a name that ends with "_" is that of every member of a family."""

RPM = math.pi / 30.0
USUAL_DAMPING = 0.02
"""Ratio of the first mode at which its frequency is sought; the bound grows as its root."""
STEP = 1e-4
"""Relative step of numerical sensitivities."""
FINER = 4
"""Points of the prescribed motion of a velocity step per sample."""


def information_bounds(recording: Recording, kind: str) -> Bounds:
    """The bounds of one run; none for a kind or a run without a truth."""
    truth = recording.metadata.process.get("truth")
    bounds = _BOUNDS.get(kind)
    return bounds(recording, truth) if bounds is not None and isinstance(truth, Mapping) else {}


def _torque_noise(recording: Recording, truth: Mapping[str, Any]) -> float:
    """Noise of one sample of the port [N m]: as drawn, and a step of its converter."""
    step = recording.signals["torque"].quantum
    return math.hypot(float(truth["torque_port"]["noise"]), step / math.sqrt(12.0))


def _quantisation(recording: Recording, channel: str) -> float:
    return float(recording.signals[channel].quantum) / math.sqrt(12.0)


def _length(segment: Segment) -> int:
    return segment.stop - segment.start


def _least(sensitivity: FloatArray, noise: FloatArray) -> FloatArray:
    """Covariance (p, p) from sensitivities (n, p) and standard deviations (n,); NaN where something is not told."""
    weighted = sensitivity / noise[:, None]
    information = weighted.T @ weighted
    scale = np.sqrt(np.diag(information))
    if not np.all(scale > 0.0):
        return np.full_like(information, math.nan)
    scaled = information / np.outer(scale, scale)
    if np.linalg.cond(scaled) > 1e12:
        return np.full_like(information, math.nan)
    return np.linalg.inv(scaled) / np.outer(scale, scale)


def _named(names: Sequence[str], covariance: FloatArray) -> Bounds:
    roots = (math.sqrt(float(v)) for v in np.diag(covariance) if v == v)
    return dict(zip(names, roots, strict=False))


def _home(recording: Recording, truth: Mapping[str, Any]) -> Bounds:
    passes = max(len(recording.labelled("home-input")), 1)
    return {
        "input_index": _quantisation(recording, "input_angle") / math.sqrt(passes),
        "output_index": _quantisation(recording, "output_angle"),
    }


def _warm_up(recording: Recording, truth: Mapping[str, Any]) -> Bounds:
    rows = sum(map(_length, recording.labelled("warm-up")))
    return {"running_torque": _torque_noise(recording, truth) / math.sqrt(max(rows, 1))}


def _held(
    recording: Recording, truth: Mapping[str, Any], label: str
) -> tuple[FloatArray, FloatArray]:
    """Speeds [rad/s] that were held, either direction, and the noise of the mean torque of each [N m]."""
    holds = recording.labelled(label)
    rows = np.array([_length(s) for s in holds], dtype=np.float64)
    speed = np.array([abs(s.setpoint) for s in holds])
    return speed, _torque_noise(recording, truth) / np.sqrt(np.maximum(rows, 1.0))


def _motor_tare(recording: Recording, truth: Mapping[str, Any]) -> Bounds:
    speed, noise = _held(recording, truth, "hold")
    covariance = _least(np.column_stack([np.ones_like(speed), speed]), noise)
    return _named(("motor_coulomb", "motor_viscous"), covariance)


def _stribeck(p: FloatArray, speed: FloatArray) -> FloatArray:
    """Equation 19: F_c, F_s, v_s, shape, c_v [N]."""
    coulomb, static, velocity, shape, viscous = p
    return coulomb + (static - coulomb) * np.exp(-((speed / velocity) ** shape)) + viscous * speed


def _friction(recording: Recording, truth: Mapping[str, Any]) -> Bounds:
    names = ("coulomb", "static", "stribeck_velocity", "shape", "viscous")
    gear = recording.metadata.gear
    if gear is None:
        return {}
    drawn = np.array([float(truth["friction"][name]) for name in names])
    sine = math.sin(gear.geometry.tooth_angle)
    lever = gear.geometry.neutral_radius / (recording.metadata.ratio * sine)
    speed, noise = _held(recording, truth, "hold")

    def sensitivity(at: FloatArray) -> FloatArray:
        steps = np.diag(STEP * np.maximum(np.abs(drawn), 1e-3))
        columns = [
            (_stribeck(drawn + s, at) - _stribeck(drawn - s, at)) / (2.0 * s.sum()) for s in steps
        ]
        return np.column_stack(columns)

    covariance = _least(sensitivity(speed), noise / lever)
    bounds = _named(names, covariance)
    if bounds:
        for rpm in (500.0, 1000.0, 2000.0, 3500.0):
            slope = sensitivity(np.array([rpm * RPM]))[0]
            variance = float(slope @ covariance @ slope)
            bounds[f"running_torque_{rpm:.0f}_rpm"] = lever * math.sqrt(variance)
    return bounds


def _kinematic_error(recording: Recording, truth: Mapping[str, Any]) -> Bounds:
    rows = sum(map(_length, recording.labelled("traverse")))
    inner = _quantisation(recording, "input_angle") / recording.metadata.ratio
    noise = math.hypot(_quantisation(recording, "output_angle"), inner)
    return {"amplitude_": noise * math.sqrt(2.0 / max(rows, 1))}


def _velocity_steps(recording: Recording, truth: Mapping[str, Any]) -> Bounds:
    """One mode between input and output, y'' + 2 z w (y' - u') + w^2 (y - u) = 0 with u = theta_i/N."""
    square = float(truth["dynamics"]["stiffness_over_inertia"])
    own = np.array([math.sqrt(square), USUAL_DAMPING])
    noise = _quantisation(recording, "output_angle")
    information = np.zeros((2, 2))
    for segment in recording.labelled("step"):
        angle, period = _prescribed(recording, segment)
        torsion = _mode(own, angle, period) - angle
        if np.max(np.abs(torsion)) < recording.signals["output_angle"].quantum:
            # Below one count quantisation is no noise: the encoder does not see the mode at all.
            continue
        answers = []
        for k, share in ((0, STEP), (1, STEP)):
            low, high = own.copy(), own.copy()
            low[k] *= 1.0 - share
            high[k] *= 1.0 + share
            difference = _mode(high, angle, period) - _mode(low, angle, period)
            answers.append(difference[::FINER] / (2.0 * share * own[k]))
        slopes = np.column_stack(answers) / noise
        information += slopes.T @ slopes
    if not np.all(np.diag(information) > 0.0):
        return {}
    rate, damping = np.sqrt(np.diag(np.linalg.inv(information)))
    whole = {
        "stiffness_over_inertia": 2.0 * own[0] * float(rate),
        "frequency": float(rate) / (2.0 * math.pi),
        "damping_ratio": float(damping),
    }
    # Half of the steps are of each direction.
    halves = {
        f"{n}_{w}": math.sqrt(2.0) * u for n, u in whole.items() for w in ("forward", "reverse")
    }
    return whole | halves


def _prescribed(recording: Recording, segment: Segment) -> tuple[FloatArray, float]:
    """theta_i/N on an even grid and its interval [s].

    Angles stand at the stamps of their samples: SYNC's jitter at a nominal period would be a motion that rings the
    mode. The grid is `FINER` than the samples, so that no corner of a straight line between them rings it either.
    """
    time = recording.time(segment)
    interval = float(np.median(np.diff(time))) / FINER
    fine = np.arange(time[0], time[-1], interval)
    angle = recording.si("input_angle", segment) / recording.metadata.ratio
    return np.asarray(scipy.interpolate.CubicSpline(time, angle)(fine)), interval


def _mode(p: FloatArray, angle: FloatArray, period: float) -> FloatArray:
    """Output angle of the mode (w, z) that starts at rest, driven by the input angle, held straight between samples."""
    rate, damping = p
    damper = 2.0 * damping * rate
    system = ([damper, rate**2], [1.0, damper, rate**2])
    numerator, denominator, _ = scipy.signal.cont2discrete(system, period, method="foh")
    start = angle[0]
    return np.asarray(scipy.signal.lfilter(numerator.ravel(), denominator, angle - start) + start)


def _starting_torque(recording: Recording, truth: Mapping[str, Any]) -> Bounds:
    """Each ramp tells its torque to a step of the set-points."""
    ramps = max(len(recording.labelled("torque-ramp")), 1)
    channel = recording.signals.get("target_torque", recording.signals["torque"])
    one = channel.quantum / math.sqrt(12.0)
    both = one / math.sqrt(ramps)
    way = math.sqrt(2.0) * both
    return {
        "starting_torque": both,
        "starting_torque_forward": way,
        "starting_torque_reverse": way,
    }


_BOUNDS: Mapping[str, Callable[[Recording, Mapping[str, Any]], Bounds]] = {
    "home": _home,
    "warm-up": _warm_up,
    "motor-tare": _motor_tare,
    "friction": _friction,
    "kinematic-error": _kinematic_error,
    "velocity-steps": _velocity_steps,
    "starting-torque": _starting_torque,
}
