"""Velocity steps: speeds from counts, resonance and damping, inertia from torque, and what cannot be identified."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
import pytest
import scipy

from model.dynamics import simulate_prescribed
from model.errors import IdentificationError
from model.gear_file import shipped_gear
from model.identify import step_fit
from model.identify.differentiation import speed_from_counts
from model.identify.dynamics import LadderFit, fit_ladder
from model.identify.sensitivity import step_identifiability
from model.identify.step_data import score_step, step_data
from model.identify.step_fit import BAD_STEP, bounded
from model.identify.step_inertia import InertiaFit, fit_inertia
from model.identify.step_problem import BASIS, Problem, Shape, StepArrays, step_arrays
from model.identify.step_rungs import Expected
from model.identify.torsional_mode import TorsionModel
from model.linear import dynamic_parameters, modes
from model.units import ARCSEC, RPM
from tests.model.identify.rigs import INPUT_QUANTUM, OUTPUT_QUANTUM, counted

GEAR = shipped_gear()
PARAMETERS = dynamic_parameters(GEAR)
STATIC = PARAMETERS.combined_stiffness / PARAMETERS.output_inertia
MODE = modes(PARAMETERS)[0]
INPUT_INERTIA = 6.6e-5


def step(
    speed_rpm: float, seed: int, *, duration: float = 0.6, jitter: float = 3e-5, skew: float = 1e-4
):
    """A step with overshoot as a servo makes it, sampled at 1 kHz with jitter and skew, both angles counted."""
    random = np.random.default_rng(seed)
    rate = 8000
    time = np.arange(int((duration + 0.05) * rate)) / rate
    since = np.maximum(time - 0.05, 0.0)
    shape = 1.0 - np.exp(-250.0 * since) * (np.cos(200.0 * since) + 0.6 * np.sin(200.0 * since))
    speed = speed_rpm * RPM * np.where(time > 0.05, shape, 0.0)
    angle = np.concatenate(
        [[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1])) / rate]
    ) + random.uniform(0.0, 6.0)
    truth = simulate_prescribed(GEAR, angle, 1.0 / rate, input_speed=speed, smoothing_speed=0.5)
    at = np.arange(0, len(time) - 16, 8)
    stamps = time[at] + jitter * random.uniform(-1.0, 1.0, len(at))
    torque = np.interp(
        stamps, time, truth.wave_generator_torque + INPUT_INERTIA * np.gradient(speed, time)
    )
    data = step_data(
        stamps,
        counted(np.interp(stamps, time, angle), INPUT_QUANTUM),
        counted(np.interp(stamps + skew, time, truth.output_angle) + 0.3, OUTPUT_QUANTUM),
        GEAR.ratio,
        output_quantum=OUTPUT_QUANTUM,
        input_quantum=INPUT_QUANTUM,
        kinematic_error=GEAR.kinematic_error,
    )
    return (
        data,
        torque + 2e-3 * random.standard_normal(len(at)),
        np.interp(stamps, time, truth.output_angle),
    )


SPEEDS = (600.0, 1200.0, 2400.0, 3000.0, -600.0, -1200.0, -2400.0, -3000.0)
EXPECTED = Expected(
    stiffness=1.2 * STATIC,
    share=PARAMETERS.combined_stiffness
    / (PARAMETERS.bearing_stiffness * PARAMETERS.radial_lever**2),
    relaxation=PARAMETERS.bearing_damping / PARAMETERS.bearing_stiffness,
    inertia=PARAMETERS.output_inertia,
    torques=(GEAR.ratings.torque_1, GEAR.ratings.torque_2),
    hardening=(1.6, 1.8),
    loss=GEAR.ratings.hysteresis_loss,
    amplitude=0.25 * GEAR.ratings.torque_1,
)
"""The card: a fifth too stiff."""


@pytest.fixture(scope="module")
def run():
    return [step(speed, seed) for seed, speed in enumerate(SPEEDS)]


@pytest.fixture(scope="module")
def ladder(run) -> LadderFit:
    return fit_ladder([data for data, _, _ in run], EXPECTED, error_given=True)


def test_stiffness_over_inertia_is_the_secant_and_not_the_square_of_the_mode(
    ladder: LadderFit,
) -> None:
    estimates = ladder.estimates
    assert estimates["stiffness_over_inertia"].value == pytest.approx(STATIC, rel=0.003)
    assert estimates["mode_squared"].value == pytest.approx(MODE.natural_frequency**2, rel=0.003)
    assert MODE.natural_frequency**2 > 1.008 * STATIC
    assert estimates["damping_ratio"].value == pytest.approx(MODE.damping_ratio, rel=0.05)
    assert estimates["skew"].value == pytest.approx(1e-4, abs=2e-5)
    assert {"stiffness_over_inertia_forward", "stiffness_over_inertia_reverse"} <= set(estimates)


def test_steps_of_one_direction_say_nothing_of_directions(run) -> None:
    found = fit_ladder(
        [data for data, _, _ in run[:4]], EXPECTED, richest="linear", error_given=True
    )
    assert "stiffness_over_inertia" in found.estimates
    assert not [name for name in found.estimates if name.endswith(("_forward", "_reverse"))]


def test_a_linear_gear_needs_no_richer_rung(ladder: LadderFit) -> None:
    assert [r.name for r in ladder.rungs] == ["rigid", "linear", "hardening"]
    assert ladder.chosen == "linear"
    lines = ladder.estimates["stiffness_over_inertia"].budget
    assert any(line.source == "choice of the rung" for line in lines)
    left = {r.name: r.prediction for r in ladder.rungs}
    assert left["linear"] < 0.2 * left["rigid"]
    assert left["linear"] == pytest.approx(OUTPUT_QUANTUM / np.sqrt(12.0), rel=0.1)


def test_the_chosen_rung_answers_an_input_that_it_was_not_fitted_to(run, ladder: LadderFit) -> None:
    first, _, _ = run[0]
    assert ladder.answer(first) == pytest.approx(ladder.predicted[0], abs=1e-15)
    # Half the input, without the kinematic error that hangs on its angle, ends at half the way.
    half = dataclasses.replace(first, input_angle=0.5 * first.input_angle, kinematic_error=())
    travel = ladder.answer(half)[-1] - ladder.answer(half)[0]
    asked = 0.5 * (first.input_angle[-1] - first.input_angle[0]) / first.ratio
    assert travel == pytest.approx(asked, rel=0.01)


def test_an_order_that_passes_at_a_steps_speed_is_not_taken_for_the_mode(run) -> None:
    """The kinematic error is not told: order 2 passes at 80 Hz, order 4 at 160 Hz."""
    bare = [dataclasses.replace(data, kinematic_error=()) for data, _, _ in run]
    found = fit_ladder(bare, EXPECTED, richest="linear")
    value = found.estimates["stiffness_over_inertia"].value
    assert value == pytest.approx(STATIC, rel=0.01)
    own = next(h for h in GEAR.kinematic_error if h.order == 2.0)
    assert np.hypot(*found.error[2, 0]) == pytest.approx(own.amplitude, rel=0.1)


def test_a_bad_step_counts_little_and_is_named(run, ladder: LadderFit) -> None:
    data = [d for d, _, _ in run]
    random = np.random.default_rng(1)
    shaken = data[2].output_angle + 60.0 * ARCSEC * np.sin(
        2.0 * np.pi * 97.0 * data[2].time + random.uniform(0.0, 6.0)
    )
    data[2] = dataclasses.replace(data[2], output_angle=shaken)
    found = fit_ladder(data, EXPECTED, richest="linear", error_given=True)
    good = ladder.estimates["stiffness_over_inertia"].value
    assert found.estimates["stiffness_over_inertia"].value == pytest.approx(good, rel=0.003)
    assert found.weights[2] < 0.05
    assert any(w.startswith("2400 r/min forward") for w in found.warnings)


@pytest.mark.parametrize("relaxation", [1e-6, 1e-2])
def test_the_exact_step_is_the_exponential_of_the_system(relaxation: float) -> None:
    model = TorsionModel(stiffness=STATIC, relaxation=relaxation, share=0.4)
    exact = scipy.linalg.expm(model.system() * 5e-4)
    assert model.step(5e-4)[0, :, :3] == pytest.approx(exact, rel=1e-9, abs=1e-12)


def test_a_rigid_prediction_has_no_skill() -> None:
    data, _, _ = step(1200.0, 5)
    rigid = score_step(data, data.input_angle / GEAR.ratio)
    assert rigid.metrics["skill_rigid"] == pytest.approx(0.0, abs=1e-9)
    assert rigid.metrics["skill"] < 0.0


def test_the_true_output_has_the_skill_that_counting_allows() -> None:
    data, _, truth = step(3000.0, 5, skew=0.0)
    assert score_step(data, truth).metrics["skill"] > 0.98


def test_transients_that_are_not_told_from_a_rigid_gear_are_refused() -> None:
    data = [step(speed, 1, duration=3.2)[0] for speed in (12.0, -12.0)]
    with pytest.raises(IdentificationError, match="told from a rigid gear"):
        fit_ladder(data, EXPECTED, richest="linear", error_given=True)


def test_a_transient_below_one_count_is_told_by_many_samples() -> None:
    data = [step(speed, n, duration=3.2)[0] for n, speed in enumerate((60.0, -60.0) * 2)]
    found = fit_ladder(data, EXPECTED, richest="linear", error_given=True)
    assert np.max(found.transient) < OUTPUT_QUANTUM
    told = found.estimates["frequency"]
    assert told.low <= MODE.natural_frequency / (2.0 * np.pi) <= told.high


def test_a_long_step_is_predicted_to_its_end() -> None:
    data = [step(speed, n, duration=5.0)[0] for n, speed in enumerate((300.0, -300.0))]
    found = fit_ladder(data, EXPECTED, richest="linear", error_given=True)
    for measured, predicted in zip(data, found.predicted, strict=True):
        away = measured.output_angle - predicted
        assert np.ptp(away[measured.time > 3.0]) < 8.0 * OUTPUT_QUANTUM


@pytest.mark.parametrize(("soft", "observer"), [(0.0, 0.0), (0.2, 0.0), (0.2, 30.0)])
def test_the_derivatives_by_the_kinematic_error_are_those_of_the_response(
    soft: float, observer: float
) -> None:
    """Through a hardening spring and a sliding Dahl element as well: else a fit stops before its answer."""
    data, _, _ = step(1800.0, 3)
    arrays = step_arrays(data, 5e-4, BASIS)

    def model(values: Mapping[str, float]) -> TorsionModel:
        return TorsionModel(
            stiffness=STATIC,
            relaxation=2e-4,
            share=0.4,
            hysteresis=(soft * STATIC, 0.2 * soft * STATIC * 1e-4),
        )

    problem = Problem(
        steps=(arrays,), basis=BASIS, error_width=1e-4, model=model, observer=observer
    )
    values, error = {"skew": 0.0}, np.zeros(2 * len(BASIS))
    shape = Shape(names=("skew",))

    def residual(at: np.ndarray) -> np.ndarray:
        return problem.normals(shape, values, at)[0].residual

    exact = problem.normals(shape, values, error)[0].waves
    for column in (0, 6, 24):
        moved = np.zeros_like(error)
        moved[column] = 1e-8
        change = (residual(-moved) - residual(moved)) / 2e-8
        away = float(np.linalg.norm(change - exact[:, column]) / np.linalg.norm(change))
        assert away < 0.02


def test_a_step_of_the_search_to_a_spring_that_is_none_is_not_taken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    data, _, _ = step(1800.0, 3)

    def model(values: Mapping[str, float]) -> TorsionModel:
        return TorsionModel(stiffness=math.exp(values["stiffness"]), relaxation=2e-4, share=0.4)

    problem = Problem(
        steps=(step_arrays(data, 5e-4, BASIS),), basis=BASIS, error_width=1e-4, model=model
    )
    solve, wild = np.linalg.solve, [True]

    def once_too_far(matrix: np.ndarray, pull: np.ndarray) -> np.ndarray:
        change = solve(matrix, pull)
        if wild.pop() if wild else False:
            change[:] = 0.0
            change[0] = 1000.0
        return change

    monkeypatch.setattr(step_fit, "_excess", lambda names, change: 0.0)
    monkeypatch.setattr(np.linalg, "solve", once_too_far)
    start = {"stiffness": math.log(0.98 * STATIC), "skew": 0.0}
    error = np.zeros(2 * len(BASIS))
    found = step_fit.fit_all(problem, Shape(names=("stiffness", "skew")), start, error, noise=1e-5)
    assert not wild
    assert abs(found.values["stiffness"] - start["stiffness"]) < 1.0


def test_friction_of_the_bearing_ends_at_nothing_and_takes_no_other_number_with_it(run) -> None:
    """Steps that ring as if the output's bearing drove it: the answer is that without a bearing, from any start."""

    def model(values: Mapping[str, float]) -> TorsionModel:
        return TorsionModel(stiffness=math.exp(values["stiffness"]), relaxation=2e-4, share=0.4)

    def bent(arrays: StepArrays) -> StepArrays:
        away: list[np.ndarray] = []
        for drag in (0.0, 80.0):
            values = {"stiffness": math.log(STATIC), "bearing": drag}
            tables = model(values).step(arrays.interval)
            found = problem.response(arrays, values, arrays.rigid, tables)
            away.append(problem.at_samples(arrays, 0.0, found[0], found[1])[0])
        return dataclasses.replace(arrays, measured=arrays.measured + away[0] - away[1])

    steps = tuple(step_arrays(data, 2.5e-4, BASIS) for data, _, _ in run[:3])
    problem = Problem(steps=steps, basis=BASIS, error_width=1e-4, model=model)
    problem = dataclasses.replace(problem, steps=tuple(bent(s) for s in steps))
    still = np.zeros(2 * len(BASIS))

    def fitted(*names: str, bearing: float) -> step_fit.Solution:
        start = {"stiffness": math.log(0.99 * STATIC), "skew": 0.0, "bearing": bearing}
        shape = Shape(names=names)
        return step_fit.fit_all(problem, shape, start, still, noise=1e-5, converged=1e-10)

    without = fitted("stiffness", "skew", bearing=0.0)
    for bearing in (0.5, 5.0):
        found = fitted("stiffness", "skew", "bearing", bearing=bearing)
        assert found.values["bearing"] == 0.0
        assert found.values["stiffness"] == pytest.approx(without.values["stiffness"], abs=1e-5)
        assert found.robust_cost() == pytest.approx(without.robust_cost(), rel=1e-4)


def test_a_direction_alone_is_in_doubt_by_as_much_as_it_leads_away(run, ladder: LadderFit) -> None:
    """Of two directions that ring alike the line is small; where they disagree it is what parts them."""

    def share(found: LadderFit, way: str) -> float:
        estimate = found.estimates[f"frequency_{way}"]
        (line,) = [line for line in estimate.budget if line.source == "first order"]
        away = abs(np.log(estimate.value / found.estimates["frequency"].value))
        assert line.kind == "B"
        assert line.standard_uncertainty == pytest.approx(
            away / np.sqrt(3.0) * estimate.value, rel=1e-6
        )
        return line.standard_uncertainty / estimate.value

    late = [
        dataclasses.replace(
            data, output_angle=np.interp(data.time, data.time + 8e-3, data.output_angle)
        )
        if data.target < 0.0
        else data
        for data, _, _ in run
    ]
    parted = fit_ladder(late, EXPECTED, richest="linear", error_given=True)
    for way in ("forward", "reverse"):
        assert share(parted, way) > 3.0 * share(ladder, way)


def test_an_inertia_is_in_doubt_by_what_a_wider_smoothing_changes(run, ladder: LadderFit) -> None:
    def doubt(lag: float) -> float:
        """Of the output's inertia, for torques whose ringing is `lag` later than the motion."""
        torques = [
            np.interp(data.time - lag, data.time, torque) + lag / 1e-3 * 0.05 * (data.time > 0.05)
            for data, torque, _ in run
        ]
        found = fit_inertia(
            [data for data, _, _ in run], torques, ladder.acceleration, GEAR.kinematic_error
        )
        return found.smoothing["output_inertia"]

    exact = doubt(0.0)
    assert 0.0 < exact < 0.02 * GEAR.inertia.output
    # A torque that jumps while nothing moves is no part of the model: how it is smoothed decides what it does.
    assert doubt(1e-3) > 2.0 * exact


def test_what_all_steps_share_is_in_the_error_of_an_inertia(run, ladder: LadderFit) -> None:
    """A torque that comes again in each step at the same time scatters nothing between them."""

    def found(size: float) -> InertiaFit:
        torques = [
            torque
            + math.copysign(size, data.target)
            * np.sin(0.8 * math.sqrt(STATIC) * data.time)
            * (data.time > 0.0)
            for data, torque, _ in run
        ]
        data = [data for data, _, _ in run]
        return fit_inertia(data, torques, ladder.acceleration, GEAR.kinematic_error)

    still, shaken = found(0.0), found(0.05)
    away = abs(shaken.values["output_inertia"] - still.values["output_inertia"])
    assert away > 0.01 * GEAR.inertia.output
    assert away < shaken.errors["output_inertia"]


def test_noise_that_steps_do_not_share_is_counted_once(run, ladder: LadderFit) -> None:
    """The scatter between the steps holds it already."""
    random = np.random.default_rng(3)
    data = [data for data, _, _ in run]
    found = [
        fit_inertia(
            data,
            [torque + 0.05 * random.standard_normal(len(torque)) for _, torque, _ in run],
            ladder.acceleration,
            GEAR.kinematic_error,
        )
        for _ in range(30)
    ]
    scatter = np.std([f.values["output_inertia"] for f in found], ddof=1)
    errors = np.sqrt(np.mean([f.errors["output_inertia"] ** 2 for f in found]))
    assert 0.8 < errors / scatter < 1.3


def test_a_step_that_no_model_explains_does_not_choose_the_answer() -> None:
    good = np.array([1.0, 1.0, 1.2, 1.0])
    assert bounded(good) == pytest.approx(good)
    worse, far = (float(bounded(np.array([1.0, 1.0, 1.0, bad]))[3]) for bad in (9.0, 1e6))
    assert far == pytest.approx(2.0 * BAD_STEP**2, rel=1e-3)
    assert far - worse < 1.0
    # Its slope is the weight with which such a step counts.
    near = float(bounded(np.array([1.0, 1.0, 1.0, 9.0 + 1e-4]))[3])
    assert (near - worse) / 1e-4 == pytest.approx((BAD_STEP / 3.0) ** 4, rel=1e-3)


def test_inertia_from_torque(run, ladder: LadderFit) -> None:
    found = fit_inertia(
        [data for data, _, _ in run],
        [torque for _, torque, _ in run],
        ladder.acceleration,
        GEAR.kinematic_error,
    )
    assert found.values["output_inertia"] == pytest.approx(GEAR.inertia.output, rel=0.03)
    assert found.values["input_inertia"] == pytest.approx(INPUT_INERTIA, rel=0.03)
    assert found.values["lag"] == pytest.approx(0.0, abs=1e-4)


def test_a_wrong_ratio_or_a_rest_is_refused() -> None:
    data, _, _ = step(600.0, 1)
    quanta = {"output_quantum": OUTPUT_QUANTUM, "input_quantum": INPUT_QUANTUM}
    with pytest.raises(IdentificationError, match="another ratio"):
        step_data(data.time, data.input_angle, -data.output_angle, GEAR.ratio, **quanta)
    with pytest.raises(IdentificationError, match="hardly moves"):
        step_data(data.time, 0.0 * data.input_angle, data.output_angle, GEAR.ratio, **quanta)
    with pytest.raises(IdentificationError, match="does not increase"):
        step_data(0.0 * data.time, data.input_angle, data.output_angle, GEAR.ratio, **quanta)


def test_speed_from_counts_beats_differences_by_orders() -> None:
    time = np.arange(3000) * 1e-3
    angle = counted(60.0 / 120.0 * RPM * time, OUTPUT_QUANTUM)
    motion = speed_from_counts(time, angle, OUTPUT_QUANTUM)
    inner = slice(200, -200)
    error = np.std(motion.speed[inner] - 0.5 * RPM)
    assert error < 0.01 * np.std(np.diff(angle) / 1e-3)
    assert error < 0.01 * 0.5 * RPM
    assert motion.window > 0.05


def test_the_window_is_narrow_where_the_motion_is_worth_many_counts() -> None:
    time = np.arange(2000) * 1e-3
    true = 2.6 * time + 2e-3 * np.sin(2.0 * np.pi * 60.0 * time)
    motion = speed_from_counts(time, counted(true, OUTPUT_QUANTUM), OUTPUT_QUANTUM)
    expected = 2.6 + 2e-3 * 2.0 * np.pi * 60.0 * np.cos(2.0 * np.pi * 60.0 * time)
    assert motion.window < 0.012
    assert np.std((motion.speed - expected)[20:-20]) < 0.1 * 2e-3 * 2.0 * np.pi * 60.0


def test_very_slow_motion_is_taken_from_the_edges() -> None:
    time = np.arange(20_000) * 1e-3
    motion = speed_from_counts(
        time, counted(2.0 * ARCSEC * 10.0 * time, OUTPUT_QUANTUM), OUTPUT_QUANTUM
    )
    assert motion.from_edges
    assert np.mean(motion.speed[3000:-3000]) == pytest.approx(20.0 * ARCSEC, rel=0.01)


def test_uneven_stamps_are_used() -> None:
    random = np.random.default_rng(0)
    time = np.arange(2000) * 1e-3 + 3e-4 * random.uniform(-1, 1, 2000)
    motion = speed_from_counts(time, counted(2.0 * time, OUTPUT_QUANTUM), OUTPUT_QUANTUM)
    nominal = speed_from_counts(
        np.arange(2000) * 1e-3, counted(2.0 * time, OUTPUT_QUANTUM), OUTPUT_QUANTUM
    )
    assert np.std(motion.speed[50:-50]) < 0.1 * np.std(nominal.speed[50:-50])


def test_what_steps_can_identify() -> None:
    time = np.arange(500) * 1e-3
    speed = 1200.0 * RPM * (1.0 - np.exp(-250.0 * time))
    angle = 1200.0 * RPM * (time - (1.0 - np.exp(-250.0 * time)) / 250.0)
    alone = step_identifiability(
        GEAR, angle, 1e-3, output_quantum=OUTPUT_QUANTUM, input_speed=speed
    )
    with_torque = step_identifiability(
        GEAR, angle, 1e-3, output_quantum=OUTPUT_QUANTUM, torque_noise=2e-3, input_speed=speed
    )
    assert alone.verdicts["output_inertia"] == "no"
    assert with_torque.verdicts["output_inertia"] == "yes"
    for found in (alone, with_torque):
        assert found.verdicts["mesh_stiffness"] == found.verdicts["bearing_damping"] == "no"
        assert "K_m" in found.sentence()
    best = alone.directions[0].components
    assert best["output_inertia"] * best["cup_stiffness"] < 0.0
    assert with_torque.count > alone.count
