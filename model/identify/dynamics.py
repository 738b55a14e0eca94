"""Resonance and damping of a gear from velocity steps, driven by the input that was measured.

With the input prescribed, the output follows u = theta_i/N + ke(theta_i) through one torsional mode
(the reduced form of equation 2; the modes of the flexspline lie above 6 kHz):

    J_o theta_o'' + D (theta_o' - u') + K (theta_o - u) = friction ,   K/J_o = w^2 ,   D/J_o = 2 zeta w

Identified are K/J_o and zeta: what these data determine. Offset, wind-up by friction and skew
between the channels are linear nuisances, solved inside (variable projection). Scored is x =
theta_o - theta_i/N - ke, never the raw angle (a rigid gear is almost perfect there), against the
null models rigid (theta_i/N) and rigid with kinematic error (x = 0).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from model.errors import IdentificationError
from model.identify.checks import Array
from model.identify.estimate import Estimate, Identifiable
from model.identify.least_squares import LinearFit, solve, student_quantile
from model.identify.step_data import Driven, StepData, StepScore, drive_of, score_step, step_data
from model.units import ARCSEC, REVOLUTION, RPM

SCAN = (0.84, 0.88, 0.92, 0.95, 0.975, 1.0, 1.025, 1.05, 1.08, 1.12, 1.16)
SCAN_STEP = 0.025
"""Factors around a start that are tried, on a grid of this step in log frequency, so that no place is tried twice."""
LOWEST_HZ, HIGHEST_HZ = 4.0, 450.0

__all__ = [
    "CombinedSteps",
    "StepData",
    "StepFit",
    "StepScore",
    "combine_steps",
    "fit_step",
    "score_step",
    "step_data",
]

STRAY_LIMIT = 0.15
"""Distance from the median of K/J_o at which a step is taken for a stray; hardening within a run is less."""


@dataclass(frozen=True, kw_only=True)
class StepFit:
    """Resonance and damping from one velocity step.

    estimates: stiffness_over_inertia [1/s2], frequency [Hz], damping_ratio, wind_up [rad], skew [s]. metrics: those of
    `StepScore`, transient_counts (largest torsional transient in output counts), speed [rad/s]. resolvable: whether the
    transient is larger than one count.
    """

    speed: float
    resolvable: bool
    estimates: dict[str, Estimate]
    metrics: dict[str, float]
    warnings: tuple[str, ...]
    score: StepScore
    predicted_acceleration: Array


def _filters(frequency: float, damping: float, interval: float) -> tuple[Array, Array, Array]:
    """Exact first-order-hold filters: u -> theta_o - u, friction -> theta_o (unit wind-up), common denominator."""
    w = 2.0 * math.pi * frequency
    state = _oscillator_step(w, damping, interval)
    system = np.array([[0.0, 1.0], [-w * w, -2.0 * damping * w]])
    inverse = np.array([[-2.0 * damping / w, -1.0 / (w * w)], [1.0, 0.0]])
    push = np.array([0.0, 1.0])
    held = inverse @ (state - np.eye(2)) @ push
    late = inverse @ inverse @ (state - np.eye(2) - system * interval) @ push / interval
    drive = held - late + state @ late
    trace, determinant = (
        state[0, 0] + state[1, 1],
        state[0, 0] * state[1, 1] - state[0, 1] * state[1, 0],
    )
    denominator = np.array([1.0, -trace, determinant])
    numerators = []
    for output in (np.array([w * w, 2.0 * damping * w]), np.array([w * w, 0.0])):
        through = float(output @ late)
        first, second = float(output @ drive), float(output @ (state @ drive - trace * drive))
        numerators.append(through * denominator + np.array([0.0, first, second]))
    return numerators[0] - denominator, numerators[1], denominator


def _oscillator_step(w: float, damping: float, interval: float) -> Array:
    """exp(A h) of x'' + 2 zeta w x' + w^2 x = 0, zeta < 1, in closed form (2, 2)."""
    turn = w * math.sqrt(1.0 - damping * damping)
    decay, c, s = (
        math.exp(-damping * w * interval),
        math.cos(turn * interval),
        math.sin(turn * interval) / turn,
    )
    return decay * np.array([[c + damping * w * s, s], [-w * w * s, c - damping * w * s]])


def _fine_columns(drive: Driven, frequency: float, damping: float) -> tuple[Array, Array]:
    """x on the fine grid for this mode, and the nuisance columns.

    Nuisances: offset, wind-up by friction, skew, and a free ring-down from the onset of motion,
    which takes up what the samples do not resolve of the onset (a drive starts within a sample or
    two) and a start that was not at rest.
    """
    deviate, wind, denominator = _filters(frequency, damping, drive.interval)
    moved = drive.ideal - drive.ideal[0]
    x = scipy.signal.lfilter(deviate, denominator, moved)
    friction = scipy.signal.lfilter(wind, denominator, drive.moving - drive.moving[0])
    rate = np.gradient(moved + x, drive.interval)
    w = 2.0 * math.pi * frequency
    since = drive.fine - drive.fine[drive.onset]
    ring = np.where(since >= 0.0, np.exp(-damping * w * np.maximum(since, 0.0)), 0.0)
    turn = w * math.sqrt(1.0 - damping**2) * since
    return x, np.column_stack(
        [np.ones_like(x), friction, rate, ring * np.cos(turn), ring * np.sin(turn)]
    )


def _columns(drive: Driven, frequency: float, damping: float) -> tuple[Array, Array]:
    """The same at the stamps of the samples."""
    x, nuisance = _fine_columns(drive, frequency, damping)
    at = [np.interp(drive.stamps, drive.fine, part) for part in (x, *nuisance.T[1:])]
    return at[0], np.column_stack([np.ones_like(at[0]), *at[1:]])


def _measured_deviation(data: StepData, drive: Driven) -> Array:
    ideal = np.interp(drive.stamps, drive.fine, drive.ideal)
    return data.output_angle - ideal


def _projected(
    drive: Driven, measured: Array, frequency: float, damping: float
) -> tuple[Array, Array, Array]:
    """Residual with the nuisances at their best, the model's x, and the coefficients of the nuisances."""
    x, nuisance = _columns(drive, frequency, damping)
    coefficients = np.asarray(
        np.linalg.lstsq(nuisance, measured - x, rcond=1e-9)[0], dtype=np.float64
    )
    return measured - x - nuisance @ coefficients, x, coefficients


def _starting_frequencies(data: StepData, measured: Array, expected: float | None) -> list[float]:
    """Where the spectrum of x peaks, and the frequency that a parameter set predicts."""
    period = float(np.median(np.diff(data.time)))
    even = np.arange(data.time[0], data.time[-1], period)
    x = np.interp(even, data.time, measured)
    x = (x - x.mean()) * np.hanning(len(x))
    power = np.abs(np.fft.rfft(x, 4 * len(x))) ** 2
    frequency = np.fft.rfftfreq(4 * len(x), period)
    power = power * frequency**2
    top = min(HIGHEST_HZ, 0.45 / period)
    inside = (frequency >= LOWEST_HZ) & (frequency <= top)
    peaks, _ = scipy.signal.find_peaks(
        np.where(inside, power, 0.0), distance=max(int(3.0 / frequency[1]), 1)
    )
    frequencies = [float(frequency[k]) for k in peaks[np.argsort(-power[peaks])][:2]]
    return ([expected] if expected else []) + frequencies


def _descend(
    drive: Driven, measured: Array, frequency: float, damping: float
) -> tuple[float, float, float]:
    """Levenberg-Marquardt on (log f, log zeta) of the projected residual."""
    parameters = np.log([frequency, damping])
    low, high = np.log([LOWEST_HZ, 1e-4]), np.log([HIGHEST_HZ, 0.7])

    def residual(p: Array) -> Array:
        return _projected(drive, measured, math.exp(p[0]), math.exp(p[1]))[0]

    scale = max(float(np.std(measured)), 1e-12)
    result = scipy.optimize.least_squares(
        lambda p: residual(p) / scale,
        np.clip(parameters, low + 1e-6, high - 1e-6),
        bounds=(low, high),
        x_scale=[0.02, 0.5],
        diff_step=[1e-5, 1e-4],
        max_nfev=25,
        xtol=1e-6,
        ftol=1e-7,
    )
    return (
        float(math.exp(result.x[0])),
        float(math.exp(result.x[1])),
        float(2.0 * result.cost) * scale**2,
    )


def _search(drive: Driven, measured: Array, starts: list[float]) -> tuple[float, float]:
    """The best mode: a scan around each start, then descent from the two best places."""
    grid = {round(math.log(start * factor) / SCAN_STEP) for start in starts for factor in SCAN}
    trials = []
    for place in grid:
        f = min(max(math.exp(place * SCAN_STEP), LOWEST_HZ), HIGHEST_HZ)
        r = _projected(drive, measured, f, 0.02)[0]
        trials.append((float(r @ r), f))
    trials.sort()
    chosen = [trials[0][1]]
    chosen += [
        f for sse, f in trials[1:] if abs(f / chosen[0] - 1.0) > 0.1 and sse < 1.3 * trials[0][0]
    ][:1]
    minima = [_descend(drive, measured, f, 0.02) for f in chosen]
    best = min(minima, key=lambda item: item[2])
    return best[0], best[1]


def fit_step(data: StepData, *, expected_frequency: float | None = None) -> StepFit:
    """K/J_o and damping of the torsional mode from one velocity step, with scores against the null models.

    `expected_frequency` [Hz]: where a parameter set expects the mode; the search begins there and
    at the peaks of the spectrum. A transient below one output count gives identifiable "no" and
    `resolvable` False.
    """
    drive = drive_of(data)
    measured = _measured_deviation(data, drive)
    measured = measured - measured[: max(len(measured) // 100, 4)].mean()
    frequency, damping = _search(
        drive, measured, _starting_frequencies(data, measured, expected_frequency)
    )
    residual, x, coefficients = _projected(drive, measured, frequency, damping)
    linear = _linearised(drive, residual, frequency, damping, coefficients)
    transient = float(np.max(np.abs(x)))
    resolvable = transient > data.output_quantum
    estimates = _step_estimates(linear, frequency, damping, data, transient)
    warnings = []
    if not resolvable:
        warnings.append(
            f"{abs(data.target) / RPM:.0f} r/min: the torsional transient of "
            f"{transient / ARCSEC:.2g} arcsec is below one output "
            f"count ({data.output_quantum / ARCSEC:.3g} arcsec): not resolvable."
        )
    turns = abs(data.input_angle[-1] - data.input_angle[0]) / REVOLUTION
    if turns < 3.0:
        warnings.append(
            f"The step lasts {turns:.2g} input revolutions; at least three are needed for its ripple."
        )
    ideal = np.interp(drive.stamps, drive.fine, drive.ideal)
    score = score_step(data, ideal + measured - residual, ideal=ideal)
    w = 2.0 * math.pi * frequency
    x_fine, columns = _fine_columns(drive, frequency, damping)
    push = coefficients[1] * (drive.moving - drive.moving[0])
    torsion = x_fine + coefficients[1] * columns[:, 1] + columns[:, 3:] @ coefficients[3:]
    rate = np.gradient(torsion, drive.interval)
    acceleration = w * w * (push - torsion) - 2.0 * damping * w * rate
    metrics = {
        **score.metrics,
        "transient_counts": transient / data.output_quantum,
        "speed": data.target,
        "residual_rms": float(np.sqrt(np.mean(residual**2))),
    }
    return StepFit(
        speed=data.target,
        resolvable=resolvable,
        estimates=estimates,
        metrics=metrics,
        warnings=tuple(warnings),
        score=score,
        predicted_acceleration=np.interp(drive.stamps, drive.fine, acceleration),
    )


def _linearised(
    drive: Driven, residual: Array, frequency: float, damping: float, coefficients: Array
) -> LinearFit:
    """Least squares on derivatives by log f and zeta beside the nuisances, whose values are put back in afterwards."""

    def model(f: float, zeta: float) -> Array:
        x, nuisance = _columns(drive, f, zeta)
        return x + nuisance @ coefficients

    h, g = 1e-4, max(1e-4, 0.02 * damping)
    by_frequency = (model(frequency * (1 + h), damping) - model(frequency * (1 - h), damping)) / (
        2 * h
    )
    by_damping = (model(frequency, damping + g) - model(frequency, damping)) / g
    nuisance = _columns(drive, frequency, damping)[1]
    solution = solve(
        np.column_stack([by_frequency, by_damping, nuisance]), residual, where="velocity step"
    )
    return replace(solution, values=solution.values + np.concatenate([[0.0, 0.0], coefficients]))


def _step_estimates(
    linear: LinearFit, frequency: float, damping: float, data: StepData, transient: float
) -> dict[str, Estimate]:
    t = student_quantile(linear.freedom)
    error = t * linear.standard_error
    w2 = (2.0 * math.pi * frequency) ** 2
    verdict: Identifiable = "yes" if transient > data.output_quantum else "no"
    note = "" if verdict == "yes" else "the torsional transient is below one output count"
    if verdict == "yes" and error[0] > 0.1:
        verdict, note = "weakly", "the frequency is known to no better than 10 %"
    poor = verdict if verdict != "yes" else "weakly" if error[1] > damping else "yes"
    ratio = Estimate(
        name="stiffness_over_inertia",
        value=w2,
        unit="1/s2",
        low=w2 * (1 - 2 * error[0]),
        high=w2 * (1 + 2 * error[0]),
        identifiable=verdict,
        note=note,
    )
    return {
        "stiffness_over_inertia": ratio,
        "frequency": Estimate(
            name="frequency",
            value=frequency,
            unit="Hz",
            low=frequency * (1 - error[0]),
            high=frequency * (1 + error[0]),
            identifiable=verdict,
            note=note,
        ),
        "damping_ratio": Estimate(
            name="damping_ratio",
            value=damping,
            unit="1",
            low=max(damping - error[1], 0.0),
            high=damping + error[1],
            identifiable=poor,
            note=note,
        ),
        "wind_up": _nuisance("wind_up", linear, 3, error, "rad"),
        "skew": _nuisance("skew", linear, 4, error, "s"),
    }


def _nuisance(name: str, linear: LinearFit, index: int, error: Array, unit: str) -> Estimate:
    value = float(linear.values[index])
    note = (
        "a nuisance of the fit: friction of the output bearing is part of it"
        if name == "wind_up"
        else ""
    )
    return Estimate(
        name=name,
        value=value,
        unit=unit,
        low=value - float(error[index]),
        high=value + float(error[index]),
        identifiable="weakly",
        note=note,
    )


@dataclass(frozen=True, kw_only=True)
class CombinedSteps:
    """All steps of a run together: weighted mean of K/J_o and damping, by all and by direction, and each step's value.

    speed, stiffness_over_inertia, damping_ratio with their low and high (k,) of the resolvable
    steps: stiffness hardens with torque, so a trend over speed is shown and not averaged away.
    """

    estimates: dict[str, Estimate]
    warnings: tuple[str, ...]
    speed: Array
    stiffness_over_inertia: Array
    low: Array
    high: Array
    damping_ratio: Array


def combine_steps(fits: Sequence[StepFit]) -> CombinedSteps:
    """Weighted means over the resolvable steps; the interval widens by the scatter between steps (Birge ratio)."""
    usable = [
        f
        for f in fits
        if f.resolvable and f.estimates["stiffness_over_inertia"].identifiable != "no"
    ]
    warnings = _merged_warnings(fits)
    if not usable:
        raise IdentificationError(
            "no step has a transient above one output count",
            where="velocity steps",
            value=f"{len(fits)} steps",
            remedy="Use faster steps, more inertia at the output, or a finer output encoder.",
        )
    usable, strays = _without_strays(usable)
    warnings += [
        f"{abs(f.speed) / RPM:.0f} r/min {'forward' if f.speed > 0 else 'reverse'}: left out of the mean, a mode at "
        f"{f.estimates['frequency'].value:.1f} Hz is not that of the other steps (an order of "
        "the input was taken for it)."
        for f in strays
    ]
    estimates: dict[str, Estimate] = {}
    groups: dict[str, Callable[[StepFit], bool]] = {
        "": lambda f: True,
        "_forward": lambda f: f.speed > 0.0,
        "_reverse": lambda f: f.speed < 0.0,
    }
    for suffix, belongs in groups.items():
        part = [f for f in usable if belongs(f)]
        for name in ("stiffness_over_inertia", "damping_ratio", "frequency") if part else ():
            estimates[name + suffix] = _weighted(name + suffix, [f.estimates[name] for f in part])
    ratio = [f.estimates["stiffness_over_inertia"] for f in usable]
    whole = estimates["stiffness_over_inertia"]
    spread = float(np.ptp([e.value for e in ratio])) / whole.value
    if (
        len(usable) > 2
        and spread > 0.05
        and spread * whole.value > 3.0 * max(e.high - e.low for e in ratio)
    ):
        warnings.append(
            f"K/J_o varies by {100 * spread:.0f} % between steps, more than their intervals: "
            "the stiffness depends on the "
            "torque, so read it per speed."
        )
    return CombinedSteps(
        estimates=estimates,
        warnings=tuple(dict.fromkeys(warnings)),
        speed=np.array([f.speed for f in usable]),
        stiffness_over_inertia=np.array([e.value for e in ratio]),
        low=np.array([e.low for e in ratio]),
        high=np.array([e.high for e in ratio]),
        damping_ratio=np.array([f.estimates["damping_ratio"].value for f in usable]),
    )


def _merged_warnings(fits: Sequence[StepFit]) -> list[str]:
    """The warnings of all steps; those that only say "not resolvable" in one sentence."""
    small = [f for f in fits if not f.resolvable]
    others = [w for f in fits for w in f.warnings if "not resolvable" not in w]
    if not small:
        return others
    speeds = ", ".join(f"{s:.0f}" for s in sorted({round(abs(f.speed) / RPM) for f in small}))
    return [
        f"{len(small)} steps ({speeds} r/min) have a torsional transient below one output count: not resolvable.",
        *others,
    ]


def _without_strays(fits: list[StepFit]) -> tuple[list[StepFit], list[StepFit]]:
    """The steps that share a mode, and those whose K/J_o is further than STRAY_LIMIT from the median of all.

    A narrow line of the ripple can be fitted as a sharp mode of its own, with a small error: weights would follow it.
    """
    if len(fits) < 4:
        return fits, []
    values = np.array([f.estimates["stiffness_over_inertia"].value for f in fits])
    near = np.abs(values / np.median(values) - 1.0) <= STRAY_LIMIT
    return [f for f, n in zip(fits, near, strict=True) if n], [
        f for f, n in zip(fits, near, strict=True) if not n
    ]


def _weighted(name: str, parts: Sequence[Estimate]) -> Estimate:
    values = np.array([e.value for e in parts])
    errors = np.array([max(0.25 * (e.high - e.low), 1e-9 * abs(e.value) + 1e-300) for e in parts])
    weights = errors**-2.0 / np.sum(errors**-2.0)
    mean = float(weights @ values)
    birge = math.sqrt(
        max(float(np.sum(((values - mean) / errors) ** 2)) / max(len(values) - 1, 1), 1.0)
    )
    half = (
        student_quantile(max(len(values) - 1, 1) if birge > 1.0 else 1e6)
        * birge
        / math.sqrt(float(np.sum(errors**-2.0)))
    )
    return Estimate(name=name, value=mean, unit=parts[0].unit, low=mean - half, high=mean + half)
