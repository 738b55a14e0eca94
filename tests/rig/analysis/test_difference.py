"""What differs between two runs, only that, and what a difference of results means."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import pytest

from drivers.channel import Calibration
from model.gear_file import shipped_gear
from model.identify.estimate import NORMAL_COVERAGE_FACTOR
from rig.analysis import store
from rig.analysis.difference import GROUPS, Change, Difference, difference
from rig.analysis.store import json_text
from rig.errors import RunFileError
from rig.program import Program
from rig.runfile.layout import Column
from tests.rig.library.stored import RUNNING, TORQUE, analyse, estimate, write
from tests.rig.runfile.making import reseal

SIMULATED = {"backend": "sim", "seed": 3, "program_version": "0.1.0", "git_commit": "abc"}


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two runs that differ in nothing but number and time."""
    folder = tmp_path_factory.mktemp("pair")
    return write(folder, 1), write(folder, 2)


def texts(found: Difference, group: str) -> dict[str, tuple[str, str]]:
    return {change.name: (change.first, change.second) for change in found.of(group)}


def test_two_runs_alike_differ_in_number_and_time_only(pair: tuple[Path, Path]) -> None:
    found = difference(*pair)
    assert not found.differs
    assert {change.group for change in found.changes} == {"run"}
    assert "run" in texts(found, "run")
    assert set(found.compared) == set(GROUPS)
    assert all(found.compared[group] for group in GROUPS if group != "results")
    assert len(found.same) + len(found.changes) == sum(found.compared.values())
    assert {change.group for change in found.same} >= {
        "parameters",
        "limits",
        "gear",
        "calibrations",
        "versions",
    }


def test_a_run_does_not_differ_from_itself(pair: tuple[Path, Path]) -> None:
    found = difference(pair[0], pair[0])
    assert (found.changes, found.differs) == ((), False)


def calibrated(certificate: str, scale: float) -> tuple[Column, ...]:
    """The torque channel after another calibration."""
    calibration = Calibration(
        certificate=certificate,
        date="2026-01-01",
        due="2028-01-01",
        scale_relative_uncertainty=2e-3,
        offset_uncertainty=2e-4,
        accuracy=5e-6,
    )
    channel = dataclasses.replace(TORQUE.channel, scale=scale, calibration=calibration)
    return (Column.of(channel),)


@pytest.mark.parametrize(
    ("group", "told", "expected"),
    [
        (
            "parameters",
            {"parameters": {"speeds_rpm": [1.0, 2.5], "repeats": 3, "note": "τ"}},
            {"repeats": ("2", "3")},
        ),
        (
            "parameters",
            {"parameters": {"speeds_rpm": [1.0, 2.5], "repeats": 2}},
            {"note": ("τ", "")},
        ),
        (
            "limits",
            {"changes": {"limits": {"torque": {"value": 1.5, "unit": "N m", "tier": "gear"}}}},
            {"torque": ("2", "1.5 N m (gear)")},
        ),
        (
            "conditions",
            {"conditions": {"lubricant": "SK-2", "hours": 12.5}, "operator": "Bo"},
            {"lubricant": ("SK-1A", "SK-2"), "operator": ("Ada Grün", "Bo")},
        ),
        (
            "gear",
            {"gear_serial": "B2", "mounting": "flexspline-fixed"},
            {
                "serial number": ("A1", "B2"),
                "mounting": ("circular-spline-fixed", "flexspline-fixed"),
            },
        ),
        (
            "gear",
            {"gear": shipped_gear().with_values({"mesh_friction.coulomb": 71.0})},
            {"mesh_friction.coulomb": ("70 N (assumed)", "71 N (assumed)")},
        ),
        (
            "versions",
            {"process": SIMULATED | {"program_version": "0.2.0"}},
            {"program_version": ("0.1.0", "0.2.0")},
        ),
        (
            "acquisition",
            {"process": SIMULATED | {"seed": 4}, "origin": "imported", "sample_rate": 500.0},
            {
                "seed": ("3", "4"),
                "backend": ("sim", "import"),
                "origin": ("simulated", "imported"),
                "sample rate": ("1000 Hz", "500 Hz"),
            },
        ),
        (
            "calibrations",
            {"changes": {"columns": calibrated("PTB-18", 3.2e-5)}},
            {
                "torque scale": ("-3.1e-05 N m", "-3.2e-05 N m"),
                "torque certificate": (
                    "PTB-17, 2025-02-03, 2027-02-03",
                    "PTB-18, 2026-01-01, 2028-01-01",
                ),
                "torque relative uncertainty of the scale": ("0.001", "0.002"),
            },
        ),
    ],
)
def test_what_differs_is_told_in_its_group_and_nothing_else(
    pair: tuple[Path, Path],
    tmp_path: Path,
    group: str,
    told: dict,
    expected: dict[str, tuple[str, str]],
) -> None:
    found = difference(pair[0], write(tmp_path, 3, **told))
    assert texts(found, group) == expected
    assert {change.group for change in found.changes} == {"run", group}
    assert found.differs


@pytest.fixture
def runs(pair: tuple[Path, Path], tmp_path: Path) -> tuple[Path, Path]:
    """The two runs where analyses may be laid beside them."""
    for path in pair:
        for one in (path, path.with_name(path.name + ".sha256")):
            (tmp_path / one.name).write_bytes(one.read_bytes())
    return tmp_path / pair[0].name, tmp_path / pair[1].name


def result(found: Difference, name: str = f"friction: {RUNNING}") -> Change:
    return next(change for change in (*found.changes, *found.same) if change.name == name)


def test_the_outcome_that_older_analyses_held_is_not_compared(runs: tuple[Path, Path]) -> None:
    older = analyse(runs[0], estimate(RUNNING, 0.08)).path
    content = json.loads(older.read_text(encoding="utf-8"))
    assert "outcome" not in content
    older.write_text(json.dumps(content | {"outcome": "FAIL"}), encoding="utf-8")
    reseal(older)
    analyse(runs[1], estimate(RUNNING, 0.08))
    found = difference(*runs)
    assert found.of("results") == ()
    assert {one.name for one in found.same if one.group == "results"} >= {f"friction: {RUNNING}"}


@pytest.mark.parametrize(
    ("second", "own", "significant"),
    [(0.0803, 1e-4, True), (0.08027, 1e-4, False), (0.0803, 1.2e-4, False), (0.0797, 1e-4, True)],
)
def test_a_difference_is_significant_beyond_the_root_of_the_sum_of_squares(
    runs: tuple[Path, Path], second: float, own: float, significant: bool
) -> None:
    analyse(runs[0], estimate(RUNNING, 0.08, own=1e-4))
    analyse(runs[1], estimate(RUNNING, second, own=own))
    found = result(difference(*runs))
    assert found.difference == pytest.approx(second - 0.08)
    assert found.uncertainty == pytest.approx(NORMAL_COVERAGE_FACTOR * math.hypot(1e-4, own))
    assert (found.significant, found.unit, found.own_uncertainty) == (significant, "N m", None)


def test_what_both_share_is_noted_and_taken_out(runs: tuple[Path, Path]) -> None:
    analyse(runs[0], estimate(RUNNING, 0.080, own=1e-4, scale=0.02))
    analyse(runs[1], estimate(RUNNING, 0.081, own=1e-4, scale=0.02))
    found = result(difference(*runs))
    parts = (1e-4, 1e-4, 0.02 * 0.080, 0.02 * 0.081)
    assert found.uncertainty == pytest.approx(NORMAL_COVERAGE_FACTOR * math.hypot(*parts))
    assert found.own_uncertainty == pytest.approx(
        NORMAL_COVERAGE_FACTOR * math.hypot(1e-4, 1e-4, 0.02 * 0.001)
    )
    assert (found.significant, found.significant_without_shared) == (False, True)
    assert "torque scale shared" in found.note
    assert "significant" in found.note


@pytest.mark.parametrize(
    "told",
    [
        {"changes": {"columns": calibrated("PTB-18", 3.1e-5)}},
        {"process": SIMULATED | {"seed": 4}},
        {"origin": "imported"},
    ],
)
def test_another_calibration_another_rig_share_nothing(
    runs: tuple[Path, Path], tmp_path: Path, told: dict
) -> None:
    # A simulated rig of which no truth is kept is told by its seed.
    (tmp_path / "other").mkdir()
    changes = {"truth": None} | told.pop("changes", {})
    first = write(tmp_path / "other", 1, changes={"truth": None})
    second = write(tmp_path / "other", 2, changes=changes, **told)
    for run in (first, second):
        analyse(run, estimate(RUNNING, 0.080, own=1e-4, scale=0.02))
    assert result(difference(first, second)).own_uncertainty is None
    assert result(difference(first, first)).own_uncertainty is not None


def test_another_subject_is_another_quantity(runs: tuple[Path, Path]) -> None:
    analyse(runs[0], estimate(RUNNING, 0.08))
    analyse(
        runs[1],
        estimate(RUNNING, 0.09),
        options={"torque_is_of": "motor + gear", "channel": "torque"},
    )
    found = difference(*runs)
    assert result(found).significant is None
    assert "not the same quantity" in result(found).note
    assert texts(found, "results")["friction: torque_is_of"] == ("gear", "motor + gear")


def test_a_number_that_cannot_be_told_is_never_significant(runs: tuple[Path, Path]) -> None:
    analyse(runs[0], estimate(RUNNING, 0.08))
    analyse(runs[1], estimate(RUNNING, 0.5, identifiable="no"))
    found = result(difference(*runs))
    assert (found.significant, found.difference) == (None, pytest.approx(0.42))
    assert "not identifiable" in found.note


def test_a_phase_is_compared_the_shorter_way_round(runs: tuple[Path, Path]) -> None:
    for run, phase in zip(runs, (3.1, -3.1), strict=True):
        analyse(
            run, estimate("phase_2", phase, "rad", own=1e-3), kind="kinematic-error", options={}
        )
    found = result(difference(*runs), "kinematic-error: phase_2")
    assert found.difference == pytest.approx(2.0 * (math.pi - 3.1))
    assert found.significant


def test_the_newest_analysis_counts_and_equal_results_are_not_told(runs: tuple[Path, Path]) -> None:
    analyse(runs[0], estimate(RUNNING, 0.5))
    for run in runs:
        analyse(run, estimate(RUNNING, 0.08))
    found = difference(*runs)
    assert found.of("results") == ()
    assert f"friction: {RUNNING}" in {change.name for change in found.same}


def test_analyses_by_different_programs_are_said_to_be(
    runs: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = Program("0.3.0", "a" * 40, "b" * 64), Program("0.3.0", "a" * 40, "c" * 64)
    for run, made_by in zip(runs, (first, second), strict=True):
        monkeypatch.setattr(store, "this_program", lambda made_by=made_by: made_by)
        analyse(run, estimate(RUNNING, 0.08))
    told = texts(difference(*runs), "results")
    assert told == {"friction: program files": (first.sha256, second.sha256)}


def test_what_only_one_of_them_has(runs: tuple[Path, Path]) -> None:
    analyse(runs[0], estimate(RUNNING, 0.08), estimate("coulomb", 70.0, "N"))
    analyse(runs[0], estimate("x", 1.0), kind="motion", options={})
    analyse(runs[1], estimate(RUNNING, 0.08))
    found = difference(*runs)
    told = texts(found, "results")
    assert told["motion"] == ("analysed", "not analysed")
    assert told["friction: coulomb"][1] == "-"
    assert "rig fit" in result(found, "motion").note


def test_an_estimate_without_an_uncertainty_is_compared_without_a_verdict(
    runs: tuple[Path, Path],
) -> None:
    stored = analyse(runs[0], estimate(RUNNING, 0.08))
    analyse(runs[1], estimate(RUNNING, 0.09))
    told = json.loads(stored.path.read_text(encoding="utf-8"))
    nothing = dict.fromkeys(("expanded_uncertainty", "low", "high"))
    told["result"]["parameters"][RUNNING] |= {**nothing, "budget": []}
    stored.path.unlink()
    stored.path.write_text(json.dumps(told), encoding="utf-8")
    reseal(stored.path)
    found = result(difference(*runs))
    assert (found.significant, found.uncertainty, found.difference) == (
        None,
        None,
        pytest.approx(0.01),
    )


def test_the_difference_as_json_is_whole(runs: tuple[Path, Path]) -> None:
    analyse(runs[0], estimate(RUNNING, 0.08))
    analyse(runs[1], estimate(RUNNING, 0.09))
    told = json.loads(json_text(difference(*runs).as_json()))
    assert told["differs"] is True
    (change,) = [c for c in told["changes"] if c["name"] == f"friction: {RUNNING}"]
    assert change["significant"] is True
    assert set(told) == {"first", "second", "differs", "compared", "changes"}


def test_a_run_that_is_none(tmp_path: Path, pair: tuple[Path, Path]) -> None:
    with pytest.raises(RunFileError, match="no such file"):
        difference(pair[0], tmp_path / "nothing.h5")
