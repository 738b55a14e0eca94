"""Velocity steps: the input jumps to a speed, the output follows; simulated output against measured output per speed.

(2) with the measured input prescribed; figure 19 from the commanded one. Steps test K/J_o, damping and kinematic error,
not friction. One fit over all steps climbs a ladder: the rigid gear and equation 2 with the card's
values, nothing fitted; then a linear spring, hardening, hysteresis (`model.identify.dynamics`).
Scored are the output's speed and x = theta_o - theta_i/N - ke against null models, never the raw
angle.
"""

from __future__ import annotations

import dataclasses
from functools import partial

import numpy as np

from experiments.angle.certified import certified_angles
from experiments.angle.phase_reference import phase_reference
from experiments.budget import budget_table
from experiments.contract import Evidence
from experiments.errors import AnalysisError, analysing
from experiments.evidence import check_settings, quality_remarks, require_time_base, rotary_ratio
from experiments.load import load_of
from experiments.planning.speeds import first_resonances
from experiments.protocols.friction.bearing import output_bearing
from experiments.protocols.velocity_steps.bearing import without_bearing
from experiments.protocols.velocity_steps.data import (
    RecordedStep,
    carries,
    even_input,
    recorded_steps,
    simulated_output,
)
from experiments.protocols.velocity_steps.declaration import SETTINGS
from experiments.protocols.velocity_steps.identified import torsional_mode
from experiments.protocols.velocity_steps.inertia import output_inertia
from experiments.protocols.velocity_steps.plan import RESONANCE_SHARE
from experiments.protocols.velocity_steps.plots import (
    fitted_step_plots,
    identifiability_table,
    ladder_table,
    score_table,
    scored_step_plots,
    step_table,
)
from experiments.protocols.velocity_steps.quantities import NAME, QUANTITIES
from experiments.recording import Recording
from experiments.result import Result
from experiments.setting import names_of
from experiments.torque.zero import recorded_zero
from model.arrays import FloatArray
from model.gear import HarmonicDrive
from model.gear_file import shipped_gear
from model.identify.dynamics import LadderFit, fit_ladder
from model.identify.estimate import Estimate
from model.identify.sensitivity import Identifiability, step_identifiability
from model.identify.step_data import StepScore, score_step
from model.identify.step_rungs import Expected
from model.linear import dynamic_parameters
from model.stiffness import drive_stiffness
from model.units import REVOLUTION

_LADDERS = {"linear": "linear", "hardening": "hardening", "full": "hysteresis"}
"""The setting `ladder`: up to which rung is fitted; full costs several times as much."""


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """Secant stiffness over inertia, mode and damping by one fit over all steps; inertia where torque shows it.

    Setting kinematic_error: "auto" (the set's if it was identified and the run saw the index marks,
    else the run's own steps), "set", "run"; it is fitted in any case, about the set's where that is
    given. Setting ladder: "linear", "hardening", "full" (default, with hysteresis). K, C_b, K_m and
    J_o alone cannot be told from the angles, and it is said. What the bench's output bearing damps is taken off the
    damping ratio, as it is entered (settings as of friction) or as the bench's card has it.
    """
    gear = evidence.gear
    richest = evidence.settings.get("ladder", "full")
    steps, named, warnings = _steps_of(recording, gear, evidence)
    given = "parameter set" in named["kinematic_error"]
    if not given:
        steps = [_without_error(step) for step in steps]
        named["kinematic_error"] = "this run's own steps, fitted with the mode"
    paper = partial(simulated_output, gear=gear)
    ladder, scores = _fit(recording, steps, gear, _LADDERS[richest], error_given=given)
    bearing = output_bearing(recording, evidence.settings)
    estimates, damped = without_bearing(ladder.estimates, bearing, load_of(recording, gear))
    _refuse_alias(recording, estimates["frequency"].value)
    if not _is_known(recording, gear):
        estimates = _with_alias(recording, estimates)
    del estimates["skew"]
    estimates |= output_inertia(recording, steps, ladder, estimates["stiffness_over_inertia"])
    warnings += ladder.warnings
    identifiability = _identifiability(steps, gear)
    warnings.append(f"{identifiability.sentence()} Friction is not tested by the output of a step.")
    return Result(
        run=recording.metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates=estimates,
        metrics=_metrics(scores, ladder, steps, gear)
        | {"output_bearing_damping_subtracted": damped},
        warnings=tuple(dict.fromkeys(warnings)),
        plots=fitted_step_plots(steps, scores, ladder, paper),
        tables=(
            ladder_table(steps, ladder),
            step_table(steps, scores, ladder),
            identifiability_table(identifiability),
            budget_table(estimates.values()),
        ),
        options=_inputs(named, steps)
        | {"output_bearing": bearing.words(), "ladder": richest, "rung": ladder.chosen}
        | {"stiffness": f"secant, at +-{_amplitude_of(gear):.3g} N m at the output"},
    )


def _is_known(recording: Recording, gear: HarmonicDrive) -> bool:
    """Whether somebody says what gear it is."""
    # Where nobody does, the shipped set stands in, which tells nothing of where its mode lies.
    return recording.metadata.gear is not None or gear != shipped_gear()


def _fit(
    recording: Recording,
    steps: list[RecordedStep],
    gear: HarmonicDrive,
    richest: str,
    *,
    error_given: bool,
) -> tuple[LadderFit, list[StepScore]]:
    """One ladder over all steps up to the rung `richest`, and how the chosen rung does on each of them."""
    with analysing(recording.metadata.run_id):
        ladder = fit_ladder(
            [step.data for step in steps],
            expected_of(gear, is_known=_is_known(recording, gear)),
            richest=richest,
            paper=[simulated_output(step, gear) for step in steps],
            error_given=error_given,
        )
        return ladder, [
            score_step(step.data, angle, ideal=ideal)
            for step, angle, ideal in zip(steps, ladder.predicted, ladder.ideal, strict=True)
        ]


def _amplitude_of(gear: HarmonicDrive) -> float:
    """The torque at the output [N m] at which stiffness and damping are stated: T1/4."""
    return 0.25 * gear.ratings.torque_1


def expected_of(gear: HarmonicDrive, *, is_known: bool = True) -> Expected:
    """What the card of a gear lets a fit of its steps expect."""
    stiffness, ratings = drive_stiffness(gear), gear.ratings
    p = dynamic_parameters(gear)
    return Expected(
        stiffness=stiffness.combined_output / gear.inertia.output,
        share=stiffness.combined_output / (p.bearing_stiffness * p.radial_lever**2),
        relaxation=p.bearing_damping / p.bearing_stiffness,
        inertia=gear.inertia.output,
        torques=(ratings.torque_1, ratings.torque_2),
        hardening=(
            ratings.stiffness_2 / ratings.stiffness_1,
            ratings.stiffness_3 / ratings.stiffness_1,
        ),
        loss=ratings.hysteresis_loss,
        amplitude=_amplitude_of(gear),
        is_known=is_known,
    )


def _without_error(step: RecordedStep) -> RecordedStep:
    return dataclasses.replace(step, data=dataclasses.replace(step.data, kinematic_error=()))


def _refuse_alias(recording: Recording, frequency: float) -> None:
    """A mode that lies too near half the sampling rate may be another's alias."""
    rate = recording.metadata.sample_rate
    if frequency > RESONANCE_SHARE * rate:
        raise AnalysisError(
            "the resonance lies too near half the sampling rate: it, or its alias, would be stated",
            where=recording.metadata.run_id,
            value=f"{frequency:.4g} Hz at {rate:g} Hz",
            limit=f"<= {RESONANCE_SHARE * rate:.4g} Hz",
            remedy=f"Record at {frequency / RESONANCE_SHARE:.0f} Hz or more.",
        )


def _with_alias(recording: Recording, estimates: dict[str, Estimate]) -> dict[str, Estimate]:
    """Where nothing says how large f_1 is, what was sampled may be the alias of a higher one."""
    alias = recording.metadata.sample_rate - estimates["frequency"].value
    note = (
        f"f_1, or its alias: then f_1 is {alias:.4g} Hz (the run carries no gear that would tell)"
    )
    return {
        name: dataclasses.replace(e, identifiable="weakly", note=note)
        for name, e in estimates.items()
    }


def _steps_of(
    recording: Recording, gear: HarmonicDrive, evidence: Evidence
) -> tuple[list[RecordedStep], dict[str, str], list[str]]:
    """The steps of a run, what of them an option names, and what is to be said of them."""
    check_settings(evidence.settings, names_of(SETTINGS), NAME)
    recording.require("velocity steps", "input_angle", "output_angle")
    warnings = quality_remarks(recording, "velocity steps", evidence)
    require_time_base(recording, "a velocity step")
    if not recording.labelled("step"):
        raise AnalysisError(
            "the recording has no step segments, and a step cannot be told from other motion",
            where=recording.metadata.run_id,
            remedy='Give segments labelled "step" when importing.',
        )
    wanted = evidence.settings.get("kinematic_error", "auto")
    reference = phase_reference(recording)
    use_set = wanted == "set" or (wanted == "auto" and carries(gear, reference))
    zero = recorded_zero(recording)
    ratio = rotary_ratio(recording, gear.mounted_ratio(recording.metadata.mounting))
    certified, sentences = certified_angles(recording)
    with analysing(recording.metadata.run_id):
        steps, origin, said = recorded_steps(
            recording,
            ratio=ratio,
            reference=reference,
            zero=zero,
            source=gear if use_set else None,
            resonance=first_resonances(gear)[-1],
            certified=certified,
        )
    if not steps:
        raise AnalysisError(
            "no step can be used", where=recording.metadata.run_id, value="; ".join(said)
        )
    named = {"kinematic_error": origin}
    if certified:
        named["corrected_by_certificate"] = ", ".join(sorted(certified))
    return steps, named, warnings + sentences + said


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


def _inputs(named: dict[str, str], steps: list[RecordedStep]) -> dict[str, str]:
    """What is named of the steps, what input they were simulated with, and what drives the simulation in figure 19."""
    recorded = all(step.commanded is not None for step in steps)
    return {
        **named,
        "input": "measured",
        "input_of_figure_19": "commanded, "
        + ("the recorded set-point" if recorded else "the set-point of the step"),
    }


def _metrics(
    scores: list[StepScore], ladder: LadderFit, steps: list[RecordedStep], gear: HarmonicDrive
) -> dict[str, float]:
    rings = ladder.transient > steps[0].data.output_quantum
    # Where no step alone shows the mode, all of them are scored.
    scored = [s for s, rung in zip(scores, rings, strict=True) if rung] or scores
    left = {f"left_out_{r.name}": r.prediction for r in ladder.rungs}
    return {
        "steps": float(len(steps)),
        "resolvable_steps": float(np.count_nonzero(rings)),
        **_medians(scored),
        **left,
        **ladder.metrics,
        "skew": ladder.estimates["skew"].value,
        "torque_amplitude": _amplitude_of(gear),
    }


def _medians(scores: list[StepScore]) -> dict[str, float]:
    """The median step by each score."""
    names = ("skill", "skill_rigid", "skill_speed", "skill_speed_rigid", "mse_speed")
    return {f"median_{name}": float(np.median([s.metrics[name] for s in scores])) for name in names}


def compare(recording: Recording, gear: HarmonicDrive, evidence: Evidence) -> Result:
    """Score equation 2 with a given parameter set on every step, driven by the measured input; nothing is fitted."""
    steps, named, warnings = _steps_of(recording, gear, evidence)
    with analysing(recording.metadata.run_id):

        def simulated(step: RecordedStep) -> FloatArray:
            error = step.data.kinematic_error
            return simulated_output(step, dataclasses.replace(gear, kinematic_error=error))

        scores = [score_step(step.data, simulated(step)) for step in steps]
    mode = torsional_mode(gear)
    return Result(
        run=recording.metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates={},
        metrics={
            "steps": float(len(steps)),
            **_medians(scores),
            "frequency_of_the_set": mode.natural_frequency / REVOLUTION,
            "damping_of_the_set": mode.damping_ratio,
        },
        warnings=tuple(warnings),
        plots=scored_step_plots(steps, scores, simulated, gear.name),
        tables=(score_table(steps, scores),),
        options={
            **_inputs(named, steps),
            "parameter_set": gear.name,
            "fitted": "nothing",
        },
    )
