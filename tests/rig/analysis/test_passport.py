"""A gear over its runs: which runs count, which stand in one series, what the charts say, and what is missing."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from experiments.result import Plot
from model.gear_file import gear_to_mapping, shipped_gear
from model.identify.estimate import Cause
from model.units import ARCMIN, ARCSEC
from rig.analysis.alarm.promise import Promise
from rig.analysis.passport.build import passport
from rig.analysis.passport.followed import followed, largest_members, order_of, watched
from rig.analysis.result_data import plot_from_mapping
from rig.analysis.store import json_text
from rig.errors import RigError, RunFileError
from rig.runfile.seal import hash_path
from tests.rig.analysis.passport_runs import (
    VALUES,
    WORN,
    analysed,
    folder,
    fourteen,
    history,
    runs_in,
    series,
)
from tests.rig.library.stored import RUNNING, analyse, estimate, start, write
from tests.rig.runfile.making import reseal

__all__ = ["folder", "fourteen", "history"]

ROOT = Path(__file__).parents[3]


def test_a_gear_that_does_not_change_shows_no_change(history: Path) -> None:
    analysed(history, VALUES)
    found = passport(history, "A1")
    one = series(found)
    assert (found.serial, found.gear, found.mark) == ("A1", "CSF-25-120-2UH", "SIMULATED")
    assert [point.value for point in one.points] == pytest.approx([1e-3 * v for v in VALUES])
    assert [point.run for point in one.points] == [run.run_id for run in found.runs]
    assert [point.start for point in one.points] == [start(day) for day in range(1, 15)]
    assert all(
        point.expanded_uncertainty == pytest.approx(1.96 * 0.2e-3, rel=1e-4) for point in one.points
    )
    assert (one.state, one.unit, one.display_unit, one.origin) == (
        "no change seen",
        "N m",
        "mN m",
        "simulated",
    )
    assert (one.alarm, found.alarms) == (None, ())
    assert one.points[0].expected is None
    assert one.points[10].expected == pytest.approx(1e-3 * np.mean(VALUES[:10]))
    assert [point.upper_sum is None for point in one.points] == [True] * 10 + [False] * 4
    assert "5 % are told to have changed within 20 runs after the first 10" in found.promise
    assert found.left_out == ()


def test_runs_without_an_analysis_and_quantities_without_a_run_are_missing(folder: Path) -> None:
    analysed(folder, VALUES[:3])
    found = passport(folder, "A1")
    lacking = [one for one in found.missing if one.run]
    assert [one.run for one in lacking] == ["00004-friction-A1"]
    assert "rig fit" in lacking[0].remedy
    told = " ".join(one.what for one in found.missing)
    expected = [one for kind, quantity in watched() for one in followed(kind, quantity)]
    assert len(expected) == 8
    for quantity in expected:
        assert (quantity.title in told) == (quantity.key != RUNNING)
    assert "rig run starting-torque" in {one.remedy for one in found.missing}


def test_runs_that_were_not_brought_to_their_end_do_not_count(folder: Path) -> None:
    analysed(folder, VALUES)
    for number, outcome in ((20, "ABORTED"), (21, "TRIPPED"), (22, "COMPLETED")):
        run = write(folder, number, outcome=outcome, start_time=start(number))
        analyse(run, estimate(RUNNING, 0.5))
    write(folder, 23, part=True, start_time=start(23))
    found = passport(folder, "A1")
    assert {one.run: one.what.split(":")[0] for one in found.left_out} == {
        "00020-friction-A1": "ended ABORTED",
        "00021-friction-A1": "ended TRIPPED",
        "00023-friction-A1": "left behind",
    }
    assert series(found).points[-1].run == "00022-friction-A1"


def test_origins_never_stand_in_one_series(folder: Path) -> None:
    analysed(folder, VALUES[:3])
    imported = write(folder, 20, origin="imported", outcome="", start_time=start(20))
    analyse(imported, estimate(RUNNING, 0.07))
    found = passport(folder, "A1")
    assert [(one.origin, len(one.points)) for one in found.series] == [
        ("simulated", 3),
        ("imported", 1),
    ]
    assert [one.title.split("(")[1] for one in found.series] == ["SIMULATED)", "IMPORTED)"]
    assert found.mark == "IMPORTED / SIMULATED"
    assert len({one.key for one in found.series}) == 2


def test_what_is_not_from_hardware_stays_out_of_the_history_of_a_gear_that_was_on_a_rig(
    folder: Path,
) -> None:
    analysed(folder, VALUES[:3])
    real = write(folder, 20, origin="hardware", start_time=start(20))
    analyse(real, estimate(RUNNING, 0.07))
    found = passport(folder, "A1")
    assert [run.number for run in found.runs] == [20]
    assert (found.mark, [one.origin for one in found.series]) == ("", ["hardware"])
    assert len(found.left_out) == 4
    assert "is simulated" in found.left_out[0].what
    asked = passport(folder, "A1", origin="simulated")
    assert (asked.mark, [one.origin for one in asked.series]) == ("SIMULATED", ["simulated"])


@pytest.mark.parametrize(
    ("told", "options", "word"),
    [
        ({"mounting": "flexspline-fixed"}, None, "flexspline-fixed"),
        ({}, {"torque_is_of": "motor + gear", "channel": "torque"}, "motor + gear"),
    ],
)
def test_runs_that_cannot_be_compared_are_series_of_their_own(
    folder: Path, told: dict, options: dict | None, word: str
) -> None:
    analysed(folder, VALUES[:3])
    other = write(folder, 20, start_time=start(20), **told)
    analyse(other, estimate(RUNNING, 0.12), options=options)
    found = passport(folder, "A1")
    assert [len(one.points) for one in found.series] == [3, 1]
    assert word in found.series[1].title
    assert "CSF" not in found.series[1].title
    tared = [one for one in found.missing if "no motor tare" in one.what]
    assert [one.run for one in tared] == (["00020-friction-A1"] if options else [])


def test_points_stand_in_order_of_time_not_of_number(folder: Path) -> None:
    early = write(folder, 20, start_time="2025-12-31T23:59:00+00:00")
    same_day = write(folder, 21, start_time="2026-01-02T08:30:00+01:00")
    analysed(folder, VALUES[:2])
    for run in (early, same_day):
        analyse(run, estimate(RUNNING, 0.07))
    assert [point.number for point in series(passport(folder, "A1")).points] == [20, 1, 21, 2]


def test_the_newest_analysis_counts_and_one_of_another_file_does_not(folder: Path) -> None:
    first, second = runs_in(folder)[:2]
    analyse(first, estimate(RUNNING, 0.5))
    analyse(first, estimate(RUNNING, 0.08))
    analyse(second, estimate(RUNNING, 0.08), sha256="f" * 64)
    found = passport(folder, "A1")
    assert [(p.run, p.value, p.analysis) for p in series(found).points] == [
        ("00001-friction-A1", 0.08, "00001-friction-A1.analysis/0002.json")
    ]
    assert any(
        "of another file of this name" in one.what
        for one in found.missing
        if one.run == "00002-friction-A1"
    )


def test_a_damaged_analysis_and_a_copied_run_are_named(folder: Path, tmp_path: Path) -> None:
    first, second = runs_in(folder)[:2]
    stored = analyse(first, estimate(RUNNING, 0.08))
    stored.path.unlink()
    hash_path(stored.path).unlink()
    stored.path.write_text("{", encoding="utf-8")
    analyse(second, estimate(RUNNING, 0.08))
    copies = tmp_path / "copies"
    copies.mkdir()
    for path in (second, second.with_name(second.name + ".sha256")):
        shutil.copy2(path, copies / path.name)
    found = passport([folder, copies], "A1")
    assert [point.run for point in series(found).points] == ["00002-friction-A1"]
    assert any(
        "cannot be read" in one.what for one in found.missing if one.run == "00001-friction-A1"
    )
    assert [one.what.startswith("is a copy of") for one in found.left_out] == [True]


def test_a_speed_above_the_plan_is_asked_for_by_a_run_that_reaches_it(folder: Path) -> None:
    analysed(folder, VALUES[:1])
    found = {one.what: one.remedy for one in passport(folder, "A1").missing if not one.run}
    remedies = [
        remedy
        for rpm in (2000, 3500)
        for what, remedy in found.items()
        if f"at {rpm} r/min: not among what its" in what
    ]
    assert remedies == ["rig run friction", "rig run friction --highest-rpm 3600"]
    assert not any("1 friction analyses" in what for what in found)


def test_a_number_that_the_data_cannot_tell_is_missing_not_drawn(folder: Path) -> None:
    first, second = runs_in(folder)[:2]
    analyse(first, estimate(RUNNING, 0.08, identifiable="no", note="the sweep stops at 900 r/min"))
    analyse(second, estimate(RUNNING, 0.08, identifiable="weakly", note="two points"))
    found = passport(folder, "A1")
    (point,) = series(found).points
    assert point.run == "00002-friction-A1"
    assert "weakly identifiable: two points" in point.remarks
    assert any("900 r/min" in one.what for one in found.missing if one.run == "00001-friction-A1")


def test_what_changed_since_the_run_before_stands_beside_the_point(folder: Path) -> None:
    other = write(folder, 20, start_time=start(20), conditions={"lubricant": "SK-2"})
    for run, temperature in ((runs_in(folder)[0], 23.0), (runs_in(folder)[1], 23.4), (other, 25.4)):
        analyse(run, estimate(RUNNING, 0.08), metrics={"housing_temperature": temperature})
    one = series(passport(folder, "A1"))
    assert one.points[1].remarks == ()
    assert one.points[2].remarks == (
        "lubricant: SK-1A → SK-2",
        "housing 1.5 K warmer than in the first runs",
    )
    assert one.points[2].housing_temperature == 25.4


SPECTRUM = {"1": 6.0, "2": 16.0, "4": 4.5, "1/N": 6.1, "2+2/N": 1.6, "2-1/N": 0.7, "3": 0.2}


def kinematic(folder: Path, number: int, growth: float = 1.0, **told: object) -> None:
    run = write(
        folder,
        number,
        "kinematic-error",
        start_time=start(number),
        parameters={"speed_rpm": 30.3},
        **told,
    )
    orders = [
        estimate(f"amplitude_{label}", growth * a * ARCSEC, "rad", 0.01 * ARCSEC)
        for label, a in SPECTRUM.items()
    ]
    accuracy = [
        estimate(f"transmission_accuracy_{way}", growth * 0.9 * ARCMIN, "rad", 0.01 * ARCMIN)
        for way in ("forward", "reverse")
    ]
    analyse(
        run,
        *accuracy,
        *orders,
        kind="kinematic-error",
        options={"ratio": 120.0, "highest_order": 12.0},
    )


def test_transmission_accuracy_and_the_largest_orders_are_followed(tmp_path: Path) -> None:
    for number in (1, 2, 3):
        kinematic(tmp_path, number, 1.0 + 0.1 * number)
    found = passport(tmp_path, "A1")
    assert [one.quantity for one in found.series] == [
        "transmission_accuracy_forward",
        "transmission_accuracy_reverse",
        "amplitude_1/N",
        "amplitude_1",
        "amplitude_2-1/N",
        "amplitude_2",
        "amplitude_2+2/N",
        "amplitude_4",
    ]
    (spectrum,) = found.spectra
    first, between, newest = spectrum.series
    assert first.x == pytest.approx([1 / 120, 1.0, 2 - 1 / 120, 2.0, 2 + 2 / 120, 3.0, 4.0])
    assert first.y[3] == pytest.approx(16.0 * 1.1)
    assert newest.y[3] == pytest.approx(16.0 * 1.3)
    assert between.y[3] == pytest.approx(16.0 * 1.2)
    assert between.low is not None
    assert between.low[3] == pytest.approx(16.0 * 1.1)
    assert "SIMULATED" in spectrum.note


def test_another_speed_of_the_traverse_is_another_series(tmp_path: Path) -> None:
    kinematic(tmp_path, 1)
    run = write(tmp_path, 2, "kinematic-error", start_time=start(2), parameters={"speed_rpm": 61.8})
    analyse(
        run,
        estimate("transmission_accuracy_forward", 3e-4, "rad"),
        kind="kinematic-error",
        options={"ratio": 120.0, "highest_order": 12.0},
    )
    titles = [
        one.title
        for one in passport(tmp_path, "A1").series
        if one.quantity == "transmission_accuracy_forward"
    ]
    assert titles == [
        "Transmission accuracy, forward (30.3 r/min)",
        "Transmission accuracy, forward (61.8 r/min)",
    ]


@pytest.mark.parametrize(
    ("label", "order"),
    [
        ("2", 2.0),
        ("1/N", 0.01),
        ("2+2/N", 2.02),
        ("2-1/N", 1.99),
        ("2.5", 2.5),
        ("x", None),
        ("2+x/N", None),
        ("", 0.0),
    ],
)
def test_the_order_of_a_label(label: str, order: float | None) -> None:
    found = order_of(label, 100.0)
    assert np.isnan(found) if order is None else found == pytest.approx(order)


def test_the_largest_orders_whatever_run_had_them() -> None:
    assert largest_members([{"2": 3.0, "1": 1.0}, {"2": 3.0, "7": 2.0, "9": 0.1}], most=2) == (
        "2",
        "7",
    )
    assert largest_members([]) == ()


def test_starting_torque_is_followed_beside_the_value_of_the_catalogue(tmp_path: Path) -> None:
    run = write(tmp_path, 1, "starting-torque", parameters={"rate": 0.02})
    stored = analyse(
        run,
        estimate("starting_torque", 0.07),
        kind="starting-torque",
        options={"torque_is_of": "motor + gear"},
    )
    told = json.loads(stored.path.read_text(encoding="utf-8"))
    told["gear"] = gear_to_mapping(shipped_gear())
    stored.path.unlink()
    stored.path.write_text(json.dumps(told), encoding="utf-8")
    reseal(stored.path)
    one = series(passport(tmp_path, "A1"), "starting_torque")
    assert one.limit is not None
    stated = shipped_gear().value("ratings.starting_torque")
    assert (one.limit.value, one.limit.source) == (stated.value, stated.origin.source)
    assert one.conditions["ramp"] == "0.02 N m/s"


def test_every_figure_can_be_drawn_and_goes_through_json(history: Path) -> None:
    analysed(history, WORN)
    kinematic(history, 20)
    found = passport(history, "A1")
    told = json.loads(json_text(found.as_json()))
    # The running torque alone has runs enough for its sums.
    assert len(told["plots"]) == len(found.plots) == len(found.series) + 1 + len(found.spectra)
    for plot, mapping in zip(found.plots, told["plots"], strict=True):
        assert isinstance(plot, Plot)
        assert [s.label for s in plot_from_mapping(mapping).series] == [
            s.label for s in plot.series
        ]
        assert all(len(s.x) == len(s.y) for s in plot.series)
        assert "[" in plot.y_label
        assert "SIMULATED" in plot.note
    one = series(found)
    labels = {s.label for s in one.plot.series}
    assert {"expected from the runs before", "since the change"} <= labels
    assert "changed since run 12" in one.plot.note
    assert one.sums is not None
    assert {s.label for s in one.sums.series} >= {"larger than expected", "threshold"}
    assert told["series"][-1]["state"] == "changed"
    assert told["alarms"][0]["since"] == told["series"][-1]["alarm"]["since"]
    assert [one["state"] for one in told["series"][:-1]] == ["not watched"] * 5 + ["learning"] + [
        "not watched"
    ] * 2
    table = next(t for t in found.tables if t.name == f"passport-{RUNNING}")
    assert [row[3] for row in table.rows] == pytest.approx(WORN)


def test_only_the_named_files_are_looked_at(folder: Path) -> None:
    analysed(folder, VALUES)
    found = passport(runs_in(folder)[:2], "A1")
    assert [run.number for run in found.runs] == [1, 2]


def test_a_gear_that_is_not_there_and_a_folder_that_is_none(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(RigError, match=r"no run of this gear.*'a1'"):
        passport(folder, "a1")
    with pytest.raises(RunFileError, match="no folder of runs"):
        passport(tmp_path / "none" / "x", "A1")
    with pytest.raises(RigError, match="no threshold can be drawn"):
        Promise(baseline=1)


def test_every_cause_that_is_shared_is_a_line_of_some_budget() -> None:
    sources = [
        path.read_text(encoding="utf-8")
        for floor in ("experiments", "model")
        for path in (ROOT / floor).rglob("*.py")
    ]
    # Analyses that version 0.1.0 stored know one more.
    sources.append((ROOT / "rig" / "analysis" / "format_1.py").read_text(encoding="utf-8"))
    for cause in Cause:
        assert any(f"Cause.{cause.name}" in text for text in sources if "Enum" not in text), cause
        assert cause.grounds
