"""Velocity steps: the input jumps to a speed, the output follows; simulated output against measured output per speed.

(2) with the measured input prescribed; figure 19. Steps test K/J_o, damping and kinematic error,
not friction. Scored are the output's speed and x = theta_o - theta_i/N - ke against null models
(rigid gear, rigid gear with kinematic error), never the raw angle. K/J_o and damping are reported
per speed and direction, because the stiffness hardens with torque.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le

from experiments.angle.phase_reference import phase_reference
from experiments.budget import budget_table, scale_line
from experiments.contract import Evidence, Experiment
from experiments.errors import AnalysisError, PlanError, analysing
from experiments.evidence import check_recording, check_settings, require_time_base, rotary_ratio
from experiments.parameters import Help, Unit
from experiments.planning.parts import between_zeros, checked, stop
from experiments.planning.shared_parameters import Acceleration, Repeats, SlowSpeed, ZeroTime
from experiments.planning.speeds import first_resonances, refuse_speed
from experiments.protocols.velocity_steps.data import (
    RecordedStep,
    carries,
    even_input,
    recorded_steps,
    simulated_output,
)
from experiments.protocols.velocity_steps.plots import (
    fitted_step_plots,
    identifiability_table,
    score_table,
    scored_step_plots,
    step_table,
)
from experiments.protocols.velocity_steps.quantities import QUANTITIES
from experiments.recording import Recording
from experiments.result import Result
from experiments.steps.vocabulary import HoldTime, MoveToAngle, SegmentLabel, SpeedStep, Step
from experiments.terms import KINEMATIC_ERROR, NORMALISED_MSE, PaperFigure, Term
from experiments.torque.zero import torque_zero
from model.gear import HarmonicDrive, Origin
from model.identify.dynamics import StepFit, combine_steps, fit_step
from model.identify.estimate import BudgetLine, Estimate
from model.identify.least_squares import student_quantile
from model.identify.sensitivity import Identifiability, step_identifiability
from model.identify.step_data import score_step
from model.identify.step_inertia import InertiaFit, fit_step_inertia
from model.linear import Mode, dynamic_parameters, modes
from model.stiffness import drive_stiffness
from model.units import REVOLUTION, RPM

NAME = "velocity-steps"


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """What a velocity-step run can be told."""

    speeds_rpm: Annotated[
        tuple[float, ...], Gt(0.0), Le(10000.0), Unit("r/min"), Help("input speeds of the steps")
    ] = (60.0, 120.0, 300.0, 600.0, 1200.0, 1800.0, 2400.0, 3000.0)
    repeats: Repeats = 2
    duration: Annotated[
        float, Ge(0.05), Le(600.0), Unit("s"), Help("time at speed, long enough for the ring-down")
    ] = 1.5
    revolutions: Annotated[
        float, Ge(3.0), Le(1000.0), Unit("rev"), Help("least input revolutions of a step")
    ] = 3.0
    rest_time: Annotated[
        float, Ge(0.1), Le(60.0), Unit("s"), Help("standstill before each step")
    ] = 0.5
    approach_rpm: SlowSpeed = 30.0
    acceleration: Acceleration = 500.0
    zero_time: ZeroTime = 3.0


def plan(parameters: Parameters, gear: HarmonicDrive) -> Iterator[Step]:
    """Torque zero; for each repeat, speed and direction: a stated wave-generator angle, rest, step,
    stop; torque zero.
    """
    checked(parameters, Parameters, NAME)
    if not parameters.speeds_rpm:
        raise PlanError(
            "the list of speeds is empty",
            where=f"{NAME}.speeds_rpm",
            remedy="Give at least one speed.",
        )
    for rpm in (*parameters.speeds_rpm, parameters.approach_rpm):
        refuse_speed(rpm, gear, f"{NAME}.speeds_rpm")
    return between_zeros(_steps(parameters), parameters.zero_time)


def start_phase(repeat: int, repeats: int) -> float:
    """The wave-generator angle [rad] from which the steps of one repeat start."""
    return REVOLUTION * repeat / repeats


def _steps(p: Parameters) -> Iterator[Step]:
    slow = p.approach_rpm * RPM
    at_most = 5.0 * REVOLUTION / slow + 10.0
    for repeat in range(p.repeats):
        phase = start_phase(repeat, p.repeats)
        for rpm in p.speeds_rpm:
            for direction in (1, -1):
                setpoint = direction * rpm * RPM
                yield MoveToAngle(
                    phase,
                    slow,
                    p.acceleration,
                    at_most,
                    SegmentLabel("position", phase, direction, repeat),
                )
                yield HoldTime(p.rest_time, SegmentLabel("rest", setpoint, direction, repeat))
                label = SegmentLabel("step", setpoint, direction, repeat)
                yield SpeedStep(setpoint, p.duration, p.revolutions, label)
                yield stop(p.acceleration)


SETTINGS = ("kinematic_error",)
INERTIA_ABOVE = 1000.0 * RPM
"""Input speed from which the torque of a step is asked for the inertia of the output."""
CONSISTENT = 0.15
"""Relative scatter between steps up to which the inertia from torque counts as identified."""
ERROR_FROM_SET, ERROR_FROM_RUN = 0.003, 0.015
"""Relative standard uncertainty of K/J_o by a kinematic error that is not exactly the gear's:
identified by a run of its own,
and from slow steps (without sidebands and output orders)."""


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """Resonance (K/J_o) and damping per speed and direction, scores against the null models,
    inertia where torque shows it.

    Setting kinematic_error: "auto" (the set's if it was identified and the run saw the index marks,
    else the run's own slow steps), "set", "run". K, C_b, K_m and J_o alone cannot be told from
    these data, and it is said.
    """
    steps, origin, warnings = _steps_of(recording, evidence.gear, evidence)
    expected = first_resonances(evidence.gear)[-1] / REVOLUTION
    with analysing(recording.metadata.run_id):
        fits = [fit_step(s.data, expected_frequency=expected) for s in steps]
        combined = combine_steps(fits)
        inertias = _inertias(steps, fits)
    own = "slow steps" in origin
    estimates = _with_budget(combined.estimates, ERROR_FROM_RUN if own else ERROR_FROM_SET)
    estimates |= _output_inertia(recording, inertias, estimates["stiffness_over_inertia"])
    warnings += combined.warnings
    identifiability = _identifiability(steps, evidence.gear)
    warnings.append(f"{identifiability.sentence()} Friction is not tested by the output of a step.")
    if own:
        warnings.append(
            "The kinematic error is from this run's slow steps, without sidebands and output "
            "orders: K/J_o is better with "
            "one that a kinematic-error run identified."
        )
    return Result(
        run=recording.metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates=estimates,
        metrics=_metrics(fits),
        warnings=tuple(dict.fromkeys(warnings)),
        plots=fitted_step_plots(steps, fits, combined),
        tables=(
            step_table(steps, fits),
            identifiability_table(identifiability),
            budget_table(estimates.values()),
        ),
        options={
            "kinematic_error": origin,
            "input": "measured",
            "stiffness": "dynamic, small-signal",
        },
    )


def _steps_of(
    recording: Recording, gear: HarmonicDrive, evidence: Evidence
) -> tuple[list[RecordedStep], str, list[str]]:
    check_settings(evidence.settings, SETTINGS, NAME)
    recording.require("velocity steps", "input_angle", "output_angle")
    warnings = list(
        check_recording(recording, "velocity steps", evidence.maximum_missed_share).warnings
    )
    require_time_base(recording, "a velocity step")
    if not recording.labelled("step"):
        raise AnalysisError(
            "the recording has no step segments, and a step cannot be told from other motion",
            where=recording.metadata.run_id,
            remedy='Give segments labelled "step" when importing.',
        )
    wanted = evidence.settings.get("kinematic_error", "auto")
    if wanted not in ("auto", "set", "run"):
        raise AnalysisError(
            "no such choice",
            where=f"{NAME}.kinematic_error",
            value=repr(wanted),
            limit="auto, set, run",
        )
    reference = phase_reference(recording)
    use_set = wanted == "set" or (wanted == "auto" and carries(gear, reference))
    zero = torque_zero(recording) if recording.has("torque") else None
    ratio = rotary_ratio(recording, gear.mounted_ratio(recording.metadata.mounting))
    with analysing(recording.metadata.run_id):
        steps, origin, said = recorded_steps(
            recording, ratio, reference, zero, gear if use_set else None, first_resonances(gear)[-1]
        )
    if not steps:
        raise AnalysisError(
            "no step can be used", where=recording.metadata.run_id, value="; ".join(said)
        )
    return steps, origin, warnings + said


def _identifiability(steps: list[RecordedStep], gear: HarmonicDrive) -> Identifiability:
    """What the fastest step of the run could tell of equation 2 at best, with torque where it was recorded."""
    step = max(steps, key=lambda s: abs(s.segment.setpoint))
    even, angle, speed = even_input(step)
    noise = None
    if step.torque is not None:
        noise = max(float(np.median(np.abs(np.diff(step.torque)))), 1e-6)
    return step_identifiability(
        gear,
        angle,
        float(even[1] - even[0]),
        output_quantum=step.data.output_quantum,
        torque_noise=noise,
        input_speed=speed,
    )


def _inertias(steps: list[RecordedStep], fits: list[StepFit]) -> list[tuple[StepFit, InertiaFit]]:
    """The torque of the fast, resolvable steps asked for the inertia of the output."""
    return [
        (fit, fit_step_inertia(step.data, fit, step.torque))
        for step, fit in zip(steps, fits, strict=True)
        if step.torque is not None and fit.resolvable and abs(fit.speed) >= INERTIA_ABOVE
    ]


def _output_inertia(
    recording: Recording, inertias: list[tuple[StepFit, InertiaFit]], ratio: Estimate
) -> dict[str, Estimate]:
    """J_o, the inertia on the input shaft and K from torque: mean over the steps, and how well the steps agree."""
    if len(inertias) < 3:
        return {}
    estimates: dict[str, Estimate] = {}
    for name in ("output_inertia", "input_inertia"):
        parts = [inertia.estimates[name] for _, inertia in inertias]
        values = np.array([e.value for e in parts])
        mean = float(values.mean())
        error = float(values.std(ddof=1)) / math.sqrt(len(values))
        scatter = float(values.std(ddof=1)) / abs(mean) if mean else math.inf
        half = student_quantile(len(values) - 1) * max(float(values.std(ddof=1)), error)
        verdict = (
            "yes" if scatter <= CONSISTENT else "weakly" if scatter <= 3.0 * CONSISTENT else "no"
        )
        note = (
            ""
            if verdict == "yes"
            else f"the steps differ by {100.0 * scatter:.0f} % (standard deviation)"
        )
        budget = (
            BudgetLine("between steps", "A", max(0.5 * half, error)),
            scale_line(recording, mean),
        )
        estimates[name] = Estimate(
            name=name,
            value=mean,
            unit=parts[0].unit,
            low=mean - half,
            high=mean + half,
            identifiable=verdict,
            note=note,
            budget=budget,
        )
    inertia = estimates["output_inertia"]
    value = inertia.value * ratio.value
    relative = math.hypot(
        0.5 * (inertia.high - inertia.low) / abs(inertia.value),
        0.5 * (ratio.high - ratio.low) / ratio.value,
    )
    note = "dynamic, small-signal: K/J_o times the inertia from torque" + (
        f"; {inertia.note}" if inertia.note else ""
    )
    estimates["output_stiffness"] = Estimate(
        name="output_stiffness",
        value=value,
        unit="N m/rad",
        low=value * (1.0 - relative),
        high=value * (1.0 + relative),
        identifiable=inertia.identifiable,
        note=note,
        budget=(
            BudgetLine("inertia and resonance", "A", 0.5 * relative * abs(value)),
            scale_line(recording, value),
        ),
    )
    return estimates


def _with_budget(combined: dict[str, Estimate], by_error: float) -> dict[str, Estimate]:
    """The combined estimates with type A and what the kinematic error does to the resonance (type B)."""
    estimates: dict[str, Estimate] = {}
    for name, estimate in combined.items():
        lines = [
            BudgetLine(
                "fit of the steps and their scatter", "A", 0.25 * (estimate.high - estimate.low)
            )
        ]
        share = (
            by_error
            if name.startswith("stiffness")
            else 0.5 * by_error
            if name.startswith("frequency")
            else 5.0 * by_error
        )
        lines.append(
            BudgetLine(
                "kinematic error",
                "B",
                share * abs(estimate.value),
                "what it leaves out rings the mode",
            )
        )
        estimates[name] = estimate.with_budget(lines)
    return estimates


def _metrics(fits: list[StepFit]) -> dict[str, float]:
    resolvable = [f for f in fits if f.resolvable]
    names = ("skill", "skill_rigid", "skill_speed", "skill_speed_rigid", "mse_speed")
    metrics = {
        f"median_{name}": float(np.median([f.metrics[name] for f in resolvable])) for name in names
    }
    return {"steps": float(len(fits)), "resolvable_steps": float(len(resolvable)), **metrics}


def compare(recording: Recording, gear: HarmonicDrive, evidence: Evidence) -> Result:
    """Score equation 2 with a given parameter set on every step, driven by the measured input; nothing is fitted."""
    steps, origin, warnings = _steps_of(recording, gear, evidence)
    with analysing(recording.metadata.run_id):
        driven = [dataclasses.replace(gear, kinematic_error=s.data.kinematic_error) for s in steps]
        scores = [
            score_step(s.data, simulated_output(s, g)) for s, g in zip(steps, driven, strict=True)
        ]
    names = ("skill", "skill_rigid", "skill_speed", "skill_speed_rigid", "mse_speed")
    metrics = {
        f"median_{name}": float(np.median([s.metrics[name] for s in scores])) for name in names
    }
    mode = torsional_mode(gear)
    metrics |= {
        "frequency_of_the_set": mode.natural_frequency / REVOLUTION,
        "damping_of_the_set": mode.damping_ratio,
    }
    return Result(
        run=recording.metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates={},
        metrics={"steps": float(len(steps)), **metrics},
        warnings=tuple(warnings),
        plots=scored_step_plots(steps, scores, gear.name),
        tables=(score_table(steps, scores),),
        options={
            "kinematic_error": origin,
            "input": "measured",
            "parameter_set": gear.name,
            "fitted": "nothing",
        },
    )


def identified(result: Result, gear: HarmonicDrive) -> HarmonicDrive:
    """The gear with the output inertia and the damping that make equation 2 ring as the run did.

    The run tells K/J_o, not K: the stiffness of the set stays, and J_o follows from it. The radial
    damping C_b is that which gives the damping ratio; where no C_b does, the structural damping C_t
    takes the rest.
    """
    if result.kind != NAME:
        raise AnalysisError(
            "is the result of another protocol", where=result.run, value=result.kind, limit=NAME
        )
    ratio, damping = result.estimates["stiffness_over_inertia"], result.estimates["damping_ratio"]
    path, value = "bearing.damping", gear.bearing.damping
    for _ in range(4):
        # Damping moves the mode a little, and the inertia moves the damping ratio: both settle within a few rounds.
        mode = torsional_mode(gear)
        gear = gear.with_values(
            {"inertia.output": gear.inertia.output * mode.natural_frequency**2 / ratio.value}
        )
        path, value = _damping_for(gear, damping.value)
        gear = gear.with_values({path: value})
    stiffness = drive_stiffness(gear).combined_output
    source = f"run {result.run}: K/J_o = {ratio.value:.6g} 1/s2 with the set's own stiffness {stiffness:.5g} N m/rad"
    spread = ratio.standard_uncertainty / ratio.value * gear.inertia.output
    gear = gear.with_values(
        {"inertia.output": gear.inertia.output}, Origin("identified", source, spread)
    )
    source = f"run {result.run}: damping ratio {damping.value:.4g} of the first mode"
    spread = damping.standard_uncertainty / damping.value * value if damping.value > 0.0 else None
    return gear.with_values({path: value}, Origin("identified", source, spread))


def torsional_mode(gear: HarmonicDrive) -> Mode:
    """The lowest mode of equation 2 that oscillates: the output on the gear's compliance."""
    return min(
        (m for m in modes(dynamic_parameters(gear)) if m.damping_ratio < 1.0),
        key=lambda m: m.natural_frequency,
    )


def _damping_for(gear: HarmonicDrive, wanted: float) -> tuple[str, float]:
    """The parameter and its value that give the first mode this damping ratio: C_b by bisection, else C_t."""

    def ratio_of(path: str, value: float) -> float:
        return torsional_mode(gear.with_values({path: value})).damping_ratio

    trials = np.geomspace(10.0, 1e6, 41)
    ratios = np.array([ratio_of("bearing.damping", float(c)) for c in trials])
    top = int(np.argmax(ratios))
    path = "bearing.damping" if ratios[top] >= wanted >= ratios[0] else "damping.structural"
    low, high = (float(trials[0]), float(trials[top])) if path == "bearing.damping" else (0.0, 1e3)
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if ratio_of(path, middle) < wanted else (low, middle)
    return path, 0.5 * (low + high)


EXPERIMENT = Experiment(
    name=NAME,
    title="Velocity steps",
    summary="speed steps, simulated output against measured output per speed",
    parameters=Parameters,
    plan=plan,
    analyse=analyse,
    compare=compare,
    identified=identified,
    quantities=QUANTITIES,
    version=2,
    live=("speed", "steps", "torque"),
    builds_on=("kinematic-error",),
    terms=(
        KINEMATIC_ERROR,
        NORMALISED_MSE,
        Term(
            "Dynamic stiffness over inertia, K/J",
            "Square of the frequency of the pole from input to output angle. A stiffness taken "
            "from it is dynamic and for small signals; it is not the static torsional stiffness "
            "of the catalogue.",
        ),
        Term(
            "Skill",
            "One minus the squared error of the model over that of a null model (a rigid gear; a "
            "rigid gear with the kinematic error). Zero is no better than the null model, one is "
            "perfect.",
        ),
    ),
    figures=(PaperFigure(19, "output speed after velocity steps, simulated and measured"),),
)
