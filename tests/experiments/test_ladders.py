"""Ladders of models: what a run shows to them, and that each rung finds what it is the model of."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from experiments import catalogue
from experiments.contract import Evidence
from experiments.errors import AnalysisError, PlanError
from experiments.ladder import Ladder, Sample, centred
from experiments.protocols.friction import ladder as friction
from experiments.protocols.kinematic_error import ladder as kinematic_error
from experiments.protocols.velocity_steps import declaration as velocity_steps_declaration
from experiments.protocols.velocity_steps import ladder as velocity_steps
from experiments.protocols.velocity_steps import plan as velocity_steps_plan
from experiments.recording import Recording
from experiments.result import Result
from model.friction import friction_torque
from model.gear import Harmonic, HarmonicDrive
from model.kinematic_error import series_value
from model.units import ARCSEC, RPM
from tests.experiments.synthetic import Bench, record

NOISE = 1e-4


def left(ladder: Ladder, samples: list[Sample], judged: Sample) -> dict[str, float]:
    """Root mean square of what every rung leaves of a sample that it was not fitted to."""
    return {
        rung.name: float(np.sqrt(np.mean(ladder.left(rung, rung.fit(samples), judged) ** 2)))
        for rung in ladder.rungs
    }


def sample_of(gear: HarmonicDrive, at: object, measured: np.ndarray, run: str = "A") -> Sample:
    part = np.zeros(len(measured), dtype=np.int64)
    return Sample(run=run, origin="simulated", measured=measured, part=part, at=at, gear=gear)


def test_kinds_with_a_ladder_and_without() -> None:
    of_protocols = {"kinematic-error", "friction", "velocity-steps"}
    assert set(catalogue.ladders()) == of_protocols | {"motion", "order-spectrum"}
    for kind in catalogue.ladders():
        assert catalogue.ladder(kind).rungs[0].name.endswith("(null)")
    with pytest.raises(PlanError, match="no ladder of models of this kind; value 'home'"):
        catalogue.ladder("home")


def test_a_constant_of_every_part_is_taken_out() -> None:
    part = np.array([0, 0, 1, 1, 1])
    values = centred(np.array([1.0, 3.0, 5.0, 6.0, 7.0]), part)
    assert values == pytest.approx([-1.0, 1.0, -1.0, 0.0, 1.0])


def friction_samples(gear: HarmonicDrive, mesh: dict[str, float]) -> list[Sample]:
    """Two runs of a gear with this mesh friction, seen through the set of another one."""
    speed = np.geomspace(1.0, 3000.0, 20) * RPM
    rng = np.random.default_rng(9930)
    torque = friction_torque(gear.with_values(mesh), speed)
    return [sample_of(gear, speed, torque + rng.normal(0.0, NOISE, 20), run) for run in "AB"]


def test_the_paper_s_friction_is_found_by_its_own_rung(gear: HarmonicDrive) -> None:
    mesh = {"mesh_friction.coulomb": 90.0, "mesh_friction.static": 130.0}
    first, second = friction_samples(gear, mesh)
    found = left(friction.LADDER, [first], second)
    assert found["paper (18)-(20), fitted"] < 2.0 * NOISE
    assert found["paper (18)-(20), as stated"] > 10.0 * NOISE
    ladder = ["mean torque (null)", "Coulomb and viscous", "Stribeck, exponential"]
    assert [found[name] for name in ladder] == sorted((found[n] for n in ladder), reverse=True)
    values = friction.LADDER.rungs[-1].fit([first, second])
    assert values[:2] == pytest.approx([90.0, 130.0], rel=0.02)


def test_a_run_shows_the_torque_that_its_analysis_compares(
    friction_run: Recording, gear: HarmonicDrive, tare: Result
) -> None:
    evidence = Evidence(gear, tare)
    shown = catalogue.ladder("friction").sample(friction_run, evidence)
    compared = catalogue.load("friction").compare
    assert compared is not None
    scored = compared(friction_run, gear, evidence)
    as_stated = friction.LADDER.rungs[4]
    residual = friction.LADDER.left(as_stated, None, shown)
    assert np.sqrt(np.mean(residual**2)) == pytest.approx(scored.metrics["residual_rms"], rel=1e-6)
    assert len(shown.measured) == scored.metrics["points"]


def test_orders_are_found_and_carried_to_another_run(gear: HarmonicDrive) -> None:
    series = (
        Harmonic(2.0, 15.0 * ARCSEC, -6.0 * ARCSEC),
        Harmonic(4.0, 3.0 * ARCSEC, 1.0 * ARCSEC),
    )
    angles = (np.linspace(0.0, 700.0, 5000), np.linspace(-40.0, 300.0, 3000))
    first, second = (sample_of(gear, a, series_value(series, a)) for a in angles)
    # What the bench adds as a constant is no error of the gear.
    second = dataclasses.replace(second, measured=second.measured + 1e-3)
    found = left(kinematic_error.LADDER, [first], second)
    assert found["orders 2 and 4"] < 1e-3 * ARCSEC
    assert found["order 2"] == pytest.approx(np.hypot(3.0, 1.0) * ARCSEC / np.sqrt(2.0), rel=0.05)
    assert found["no error (null)"] > 10.0 * ARCSEC
    known = dataclasses.replace(gear, kinematic_error=series)
    stated = kinematic_error.LADDER.rungs[1]
    seen = dataclasses.replace(second, gear=known)
    assert np.std(kinematic_error.LADDER.left(stated, None, seen)) < 1e-9


def test_a_rung_of_orders_has_as_many_parameters_as_it_says(gear: HarmonicDrive) -> None:
    """What a model may fit is what its score is charged for."""
    angle = np.linspace(0.0, 3000.0, 20_000)
    sample = sample_of(gear, angle, series_value((Harmonic(2.0, 1e-5, 0.0),), angle))
    fitted = {rung.name: rung.fit([sample]) for rung in kinematic_error.LADDER.rungs}
    for rung in kinematic_error.LADDER.rungs:
        values = fitted[rung.name]
        assert rung.parameters == (0 if values is None else len(values)), rung.name


@pytest.mark.parametrize(
    "place", [1.0 - 1.0 / 120.0, 2.0 - 2.0 / 120.0, 1.0 / 120.0, 4.0 + 1.0 / 120.0]
)
def test_a_sideband_is_found_by_the_rung_of_sidebands_alone(
    gear: HarmonicDrive, place: float
) -> None:
    angles = (np.linspace(0.0, 3000.0, 20_000), np.linspace(-900.0, 2000.0, 20_000))
    series = (Harmonic(2.0, 15.0 * ARCSEC, 0.0), Harmonic(place, 5.0 * ARCSEC, 2.0 * ARCSEC))
    first, second = (sample_of(gear, a, series_value(series, a)) for a in angles)
    found = left(kinematic_error.LADDER, [first], second)
    assert found["and sidebands"] < 1e-3 * ARCSEC
    assert found["orders 1 to 12"] > ARCSEC


def test_a_run_shows_its_kinematic_error_from_the_index_marks(
    kinematic_error_run: Recording, gear: HarmonicDrive
) -> None:
    shown = kinematic_error.sample(kinematic_error_run, Evidence(gear))
    assert set(shown.part) == {0, 1}
    assert 5.0 * ARCSEC < np.std(shown.measured) < 20.0 * ARCSEC


@pytest.fixture(scope="module")
def steps_run(gear: HarmonicDrive) -> Recording:
    """Four quick steps of a gear that has more inertia than its set says."""
    heavier = gear.with_values({"inertia.output": 0.13})
    parameters = velocity_steps_declaration.Parameters(
        speeds_rpm=(1200.0, 2400.0), repeats=1, duration=0.4
    )
    bench = Bench(gear=heavier, error=(), elastic=True)
    return record(velocity_steps_plan.plan(parameters, heavier), bench, "velocity-steps")


def test_a_fitted_spring_predicts_steps_that_it_has_not_seen(
    steps_run: Recording, gear: HarmonicDrive
) -> None:
    shown = velocity_steps.sample(steps_run, Evidence(gear))
    assert set(shown.part) == set(range(8))
    rows = [shown.part // 2 == k for k in range(4)]
    halves = [
        dataclasses.replace(
            shown,
            measured=shown.measured[rows[a] | rows[b]],
            part=shown.part[rows[a] | rows[b]],
            at=[shown.at[a], shown.at[b]],
        )
        for a, b in ((0, 1), (2, 3))
    ]
    rigid, stated, linear = velocity_steps.LADDER.rungs[:3]
    ladder = velocity_steps.LADDER
    left_of = {
        rung.name: np.std(ladder.left(rung, rung.fit([halves[0]]), halves[1]))
        for rung in (rigid, stated, linear)
    }
    assert left_of[linear.name] < 0.3 * left_of[stated.name]
    assert left_of[linear.name] < 0.3 * left_of[rigid.name]


def test_steps_without_an_index_mark_are_refused(gear: HarmonicDrive, steps_run: Recording) -> None:
    without = dataclasses.replace(
        steps_run, signals={k: v for k, v in steps_run.signals.items() if k != "index_seen"}
    )
    with pytest.raises(AnalysisError, match="index mark"):
        velocity_steps.sample(without, Evidence(gear))
