"""Curves through too few points: the plan, the preflight and the result say one sentence."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from experiments import catalogue
from experiments.contract import Evidence
from experiments.finding import Severity
from experiments.protocols.friction import analysis as friction
from experiments.protocols.friction import declaration as friction_declaration
from experiments.protocols.friction.quantities import CURVE
from experiments.recordings.friction_curve.declaration import EXPERIMENT as TABLE_OF_FRICTION
from experiments.result import Result
from experiments.shape import LEAST_FREEDOM, Standing
from model.gear import HarmonicDrive
from model.identify.estimate import Estimate
from model.identify.repeated import SMALLEST
from model.motor import shipped_motor
from rig.run.dry_run import plan_run
from rig.run.preflight import static_checks
from tests.experiments.recordings.test_friction_curve import BOTH, table
from tests.experiments.recordings.test_friction_curve import friction as law
from tests.experiments.synthetic import Bench, record

THIN = friction_declaration.Parameters(
    speeds_rpm=(1.0, 5.0, 20.0, 100.0, 300.0, 1200.0, 2800.0), up_and_down=False
)


def test_one_sweep_over_seven_speeds_is_weakly_and_the_plan_says_it_before(
    bench: Bench, gear: HarmonicDrive, tare: Result, tmp_path: Path
) -> None:
    planned = plan_run(friction_declaration.EXPERIMENT, THIN, gear, shipped_motor())
    (said,) = planned.remarks
    assert "10 points for 5 numbers, 5 degrees of freedom of 10 asked for" in said
    assert "2 points measured again of 3 asked for" in said
    assert planned.as_json()["remarks"] == [said]
    check = next(c for c in static_checks(planned, tmp_path) if c.what == "points")
    assert (check.severity, f"{check.found}.") == (Severity.WARNS, said)
    run = record(planned.plan, bench, "friction", parameters=dataclasses.asdict(THIN))
    result = friction.analyse(run, Evidence(gear, tare))
    assert said in result.warnings
    told = [e.identifiable for name, e in result.estimates.items() if name in CURVE.names]
    assert len(told) >= 5
    assert "yes" not in told
    assert f"{result.estimates['coulomb'].note}." == said
    # What was measured at a speed is told by the points there.
    assert result.estimates["running_torque_1000_rpm"].note != said


@pytest.mark.parametrize("kind", catalogue.names())
def test_no_protocol_is_thin_by_its_own_defaults(kind: str, gear: HarmonicDrive) -> None:
    experiment = catalogue.load(kind)
    planned = plan_run(experiment, experiment.parameters(), gear, shipped_motor())
    assert planned.remarks == ()


@pytest.mark.parametrize(
    ("points", "places", "scatter", "said"),
    [
        (5 + LEAST_FREEDOM, 10, 0.002, ""),
        (4 + LEAST_FREEDOM, 10, 0.002, "9 degrees of freedom of 10"),
        (20, 18, 0.005, "2 points measured again of 3"),
        (20, 10, SMALLEST, "the least that is looked for"),
        (20, 10, 1.1 * SMALLEST, ""),
    ],
)
def test_degrees_of_freedom_and_scatter_decide(
    points: int, places: int, scatter: float, said: str
) -> None:
    standing = Standing(CURVE, points, places, scatter)
    assert said in standing.thin
    assert bool(standing.thin) == bool(said)
    plain = {
        name: Estimate(name=name, value=1.0, unit="N", low=0.9, high=1.1)
        for name in ("coulomb", "offset")
    }
    called = {name: e.identifiable for name, e in standing.weakly(plain).items()}
    assert called == {"coulomb": "weakly" if said else "yes", "offset": "yes"}


def test_a_table_of_few_points_is_told_weakly(gear: HarmonicDrive) -> None:
    for speeds, called in ((BOTH, "yes"), (BOTH[::3], "weakly")):
        result = TABLE_OF_FRICTION.analyse(table(speeds, law(speeds, 1.5)), Evidence(gear))
        assert result.estimates["coulomb"].identifiable == called, len(speeds)
