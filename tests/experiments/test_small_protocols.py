"""Warm-up, starting torque and home on a rig that is known."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from experiments.contract import Evidence
from experiments.errors import AnalysisError
from experiments.protocols import home, starting_torque, warm_up
from experiments.recording import ArraySource, Recording
from model.friction import friction_torque
from model.gear import HarmonicDrive, Origin
from model.units import REVOLUTION, RPM
from tests.experiments.synthetic import Bench, record


@pytest.fixture(scope="module")
def ramps(bench: Bench, gear: HarmonicDrive) -> Recording:
    parameters = starting_torque.Parameters(positions=4, approach_rpm=30.0)
    return record(starting_torque.plan(parameters, gear), bench, "starting-torque")


def test_the_starting_torque_is_where_the_input_begins_to_turn(
    ramps: Recording, bench: Bench, gear: HarmonicDrive
) -> None:
    result = starting_torque.analyse(ramps, Evidence(gear))
    assert result.estimates["starting_torque"].value == pytest.approx(bench.breakaway, rel=0.02)
    assert result.estimates["starting_torque_reverse"].value == pytest.approx(
        -bench.breakaway, rel=0.02
    )
    assert result.metrics["ramps"] == 8.0
    assert [v.outcome for v in result.verdicts] == ["NOT JUDGED"]
    assert result.options["torque_is_of"] == "motor + gear"


def test_a_starting_torque_above_a_verified_limit_fails(
    ramps: Recording, gear: HarmonicDrive
) -> None:
    known = gear.with_values({"ratings.starting_torque": 0.05}, Origin("measured", "another rig"))
    assert starting_torque.analyse(ramps, Evidence(known)).outcome == "FAIL"


def test_ramps_that_move_nothing_are_said_or_refused(ramps: Recording, gear: HarmonicDrive) -> None:
    source = ramps.source
    assert isinstance(source, ArraySource)
    stuck = source.arrays["input_angle"].copy()
    segments = ramps.labelled("torque-ramp")
    for segment in segments[:2]:
        stuck[segment.start : segment.stop] = stuck[segment.start]
    run = dataclasses.replace(
        ramps, source=dataclasses.replace(source, arrays={**source.arrays, "input_angle": stuck})
    )
    result = starting_torque.analyse(run, Evidence(gear))
    assert any("without motion" in w for w in result.warnings)
    assert result.metrics["ramps"] == 6.0
    only = tuple(s for s in run.segments if s.label != "torque-ramp" or s in segments[:2])
    with pytest.raises(AnalysisError, match="no ramp"):
        starting_torque.analyse(dataclasses.replace(run, segments=only), Evidence(gear))


def test_home_finds_both_marks(bench: Bench, gear: HarmonicDrive) -> None:
    parameters = home.Parameters(input_speed_rpm=30.0, output_speed_rpm=120.0)
    result = home.analyse(record(home.plan(parameters, gear), bench, "home"), Evidence(gear))
    assert result.estimates["input_index"].value == pytest.approx(
        bench.index % REVOLUTION, abs=4e-4
    )
    # The output encoder counts against the input's sense.
    assert result.estimates["output_index"].value == pytest.approx(
        -bench.output_index % REVOLUTION, abs=2e-4
    )
    table = result.tables[0]
    assert [row[0] for row in table.rows] == ["input"] * 3 + ["output"]


def test_home_without_index_channels_says_what_is_lacking(
    bench: Bench, gear: HarmonicDrive
) -> None:
    run = record(
        home.plan(home.Parameters(input_speed_rpm=60.0, output_speed_rpm=120.0), gear),
        bench,
        "home",
    )
    signals = {name: s for name, s in run.signals.items() if "index" not in name}
    with pytest.raises(AnalysisError, match="input_index"):
        home.analyse(dataclasses.replace(run, signals=signals), Evidence(gear))


def test_home_that_saw_no_mark_is_refused(bench: Bench, gear: HarmonicDrive) -> None:
    run = record(
        home.plan(home.Parameters(input_speed_rpm=60.0, output_speed_rpm=120.0), gear),
        bench,
        "home",
    )
    source = run.source
    assert isinstance(source, ArraySource)
    blind = {**source.arrays, "index_seen": np.zeros(run.rows, dtype=np.int64)}
    with pytest.raises(AnalysisError, match="no index mark"):
        home.analyse(
            dataclasses.replace(run, source=dataclasses.replace(source, arrays=blind)),
            Evidence(gear),
        )


def test_warm_up_sees_the_torque_become_steady(bench: Bench, gear: HarmonicDrive) -> None:
    parameters = warm_up.Parameters(speed_rpm=1500.0, window=5.0, at_most=600.0)
    run = record(
        warm_up.plan(parameters, gear), bench, "warm-up", parameters=dataclasses.asdict(parameters)
    )
    steady = warm_up.analyse(run, Evidence(gear))
    assert steady.metrics["steady"] == 1.0
    assert not any("not steady" in w for w in steady.warnings)
    truth = float(friction_torque(gear, 1500.0 * RPM)) + float(
        bench.motor(np.array([1500.0 * RPM]))[0]
    )
    assert steady.estimates["running_torque"].value == pytest.approx(truth, rel=0.01)


def test_warm_up_that_ended_too_early_says_so(bench: Bench, gear: HarmonicDrive) -> None:
    parameters = warm_up.Parameters(speed_rpm=1500.0, window=5.0, at_most=600.0)
    run = record(
        warm_up.plan(parameters, gear), bench, "warm-up", parameters=dataclasses.asdict(parameters)
    )
    source = run.source
    assert isinstance(source, ArraySource)
    falling = 0.02 * np.exp(-np.arange(run.rows) / 8000.0) / run.signals["torque"].scale
    warming = {
        **source.arrays,
        "torque": source.arrays["torque"] + np.round(falling).astype(np.int64),
    }
    result = warm_up.analyse(
        dataclasses.replace(run, source=dataclasses.replace(source, arrays=warming)), Evidence(gear)
    )
    assert result.metrics["steady"] == 0.0
    assert result.metrics["total_change"] < -1e-3
    assert any("not steady" in w for w in result.warnings)
