"""A gear over its runs: which runs count, which stand in one series, what the charts say, and what is missing."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from experiments.result import Plot
from model.gear_file import gear_to_mapping, shipped_gear
from model.identify.estimate import Cause
from model.units import ARCMIN, ARCSEC
from rig.analysis.alarm.promise import Promise, Watching
from rig.analysis.alarm.watching import BOUNDING_RUNS
from rig.analysis.passport.build import alarms_of, passport
from rig.analysis.passport.content import Passport, PassportSeries
from rig.analysis.passport.followed import followed, largest_members, order_of, watched
from rig.analysis.result_data import plot_from_mapping
from rig.analysis.store import json_text
from rig.errors import RigError, RunFileError
from rig.library.index import LibraryIndex
from rig.library.place import index_path
from rig.runfile.seal import hash_path
from tests.rig.analysis.test_difference import calibrated
from tests.rig.library.stored import RUNNING, analyse, estimate, start, write
from tests.rig.runfile.making import reseal

ROOT = Path(__file__).parents[3]
VALUES = (80.0, 81.0, 79.0, 80.5, 79.5, 80.0, 81.0, 80.0, 79.0, 80.0, 80.5, 79.5, 80.0, 80.5)
"""Fourteen runs [mN m] of a gear that does not change."""
WORN = (*VALUES[:11], 90.0, 91.0, 90.5)
"""The same gear, changed in the twelfth run [mN m]."""


@pytest.fixture(scope="module")
def fourteen(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Fourteen friction runs of gear A1, one a day, none of them analysed."""
    folder = tmp_path_factory.mktemp("fourteen")
    for day in range(1, 15):
        write(folder, day, start_time=start(day))
    LibraryIndex(folder).refresh()
    return folder


def taken(source: Path, target: Path, most: int) -> Path:
    """The first runs of a folder under second names, with its index, which then holds for them too
    and saves reading them.
    """
    for run in runs_in(source)[:most]:
        for path in (run, run.with_name(run.name + ".sha256")):
            (target / path.name).hardlink_to(path)
    shutil.copy2(index_path(source), index_path(target))
    return target


@pytest.fixture
def history(fourteen: Path, tmp_path: Path) -> Path:
    """The fourteen runs in a folder of this test."""
    return taken(fourteen, tmp_path, 14)


@pytest.fixture
def folder(fourteen: Path, tmp_path: Path) -> Path:
    """The first four of them."""
    return taken(fourteen, tmp_path, 4)


def runs_in(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.h5"))


def analysed(folder: Path, values: Sequence[float], own: float = 0.2, scale: float = 0.0) -> None:
    """Lay running torques [mN m] beside the first runs of a folder."""
    for run, value in zip(runs_in(folder), values, strict=False):
        analyse(run, estimate(RUNNING, 1e-3 * value, own=1e-3 * own, scale=scale))


def series(found: Passport, quantity: str = RUNNING) -> PassportSeries:
    (one,) = [one for one in found.series if one.quantity == quantity]
    return one


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


def test_a_worn_gear_has_changed_since_the_run_that_shows_it(history: Path) -> None:
    analysed(history, WORN)
    one = series(passport(history, "A1"))
    assert (one.state, one.threshold) == ("changed", pytest.approx(7.104))
    assert one.alarm is not None
    assert (one.alarm.since, one.alarm.direction) == ("00012-friction-A1", "larger")
    assert one.alarm.size == pytest.approx(1e-3 * (90.5 - np.mean(VALUES[:11])))
    assert one.alarm.size_low < one.alarm.size < one.alarm.size_high
    assert 10.0 < one.alarm.size_in_scatters < 20.0
    assert one.alarm.within_uncertainty is False
    assert "is larger by 10.5 ± 1.2 mN m since run 00012-friction-A1" in one.alarm.sentence
    assert "another gear" in one.alarm.decides
    assert [point.is_changed for point in one.points] == [False] * 11 + [True] * 3
    assert [point.run for point in one.points if point.is_alarm] == [one.alarm.run]


def test_a_step_after_fresh_grease_begins_a_new_level_and_is_no_alarm(
    fourteen: Path, tmp_path: Path
) -> None:
    folder = taken(fourteen, tmp_path, 11)
    for day in (12, 13, 14):
        write(folder, day, start_time=start(day), conditions={"lubricant": "SK-2"})
    analysed(folder, WORN)
    one = series(passport(folder, "A1"))
    assert (one.state, one.alarm) == ("no change seen", None)
    assert "A new level begins with run 00012-friction-A1: fresh lubricant." in one.notes
    # Of the first run with other grease nothing is expected; of the next what that one showed.
    assert one.points[11].expected is None
    assert one.points[12].expected == pytest.approx(90e-3)


def test_one_outlier_alone_is_no_lasting_change(history: Path) -> None:
    analysed(history, (*VALUES[:11], 84.0, *VALUES[12:]))
    assert series(passport(history, "A1")).state == "no change seen"


def test_a_change_within_the_measuring_uncertainty_says_so(history: Path) -> None:
    analysed(history, WORN, own=6.0)
    one = series(passport(history, "A1"))
    assert one.alarm is not None
    assert one.alarm.within_uncertainty is True
    assert "The change is no larger than U of one run." in one.notes


@pytest.mark.parametrize(("calibration", "within"), [(None, False), ("PTB-18", True)])
def test_an_uncertainty_that_all_runs_share_excuses_no_change(
    fourteen: Path, tmp_path: Path, calibration: str | None, within: bool
) -> None:
    """A torque scale that may be wrong by 10 % is wrong alike in every run, until it is calibrated anew."""
    folder = taken(fourteen, tmp_path, 11)
    changes = {"columns": calibrated(calibration, 3.1e-5)} if calibration else {}
    for day in (12, 13, 14):
        write(folder, day, start_time=start(day), changes=changes)
    analysed(folder, WORN, scale=0.1)
    one = series(passport(folder, "A1"))
    assert one.alarm is not None
    assert one.points[13].expanded_uncertainty > 10e-3
    assert one.alarm.within_uncertainty is within
    assert any("torque calibration changed (00012" in text for text in one.alarm.beside) is within
    assert ("beside it changed: torque calibration" in one.alarm.sentence) is within


def test_the_golden_gear_is_the_run_that_decides(history: Path) -> None:
    analysed(history, WORN)
    found = passport(history, "A1", watching=Watching(golden_gear="GOLD-1"))
    (alarm,) = found.alarms
    assert alarm.command == "rig run friction --gear GOLD-1"
    assert "golden gear GOLD-1" in alarm.decides


def test_the_golden_gear_shows_that_days_are_independent(history: Path) -> None:
    analysed(history, VALUES)
    generator = np.random.default_rng(6)
    for number in range(101, 101 + BOUNDING_RUNS + 3):
        run = write(history, number, serial="GOLD-1", start_time=start(number), rows=2)
        analyse(run, estimate(RUNNING, 0.08 + 1e-4 * generator.normal()))
    alone = series(passport(history, "A1"))
    beside = series(passport(history, "A1", watching=Watching(golden_gear="GOLD-1")))
    assert (alone.threshold, beside.threshold) == (pytest.approx(7.104), pytest.approx(5.309))
    assert "days are independent" in " ".join(beside.notes)
    # Whoever asks for the alarms alone, as campaign and lot do, hears the golden gear too.
    bent = (*VALUES[:10], *(value + 1.4 for value in VALUES[10:]))
    analysed(history, bent)
    told = {
        golden: [one.quantity for one in alarms_of(history, "A1", Watching(golden_gear=golden))]
        for golden in ("", "GOLD-1")
    }
    assert told == {"": [], "GOLD-1": [RUNNING]}


def test_few_runs_are_still_learning(folder: Path) -> None:
    analysed(folder, VALUES)
    one = series(passport(folder, "A1"))
    assert (one.state, one.threshold, len(one.points)) == ("learning", None, 4)
    assert "Nothing is told yet: 4 of 10 runs have taught what is usual." in one.notes
    assert one.sums is None


def test_hours_on_the_card_give_a_slope_and_the_time_to_the_limit(tmp_path: Path) -> None:
    for day in range(1, 13):
        run = write(
            tmp_path, day, start_time=start(day), conditions={"lubricant": "A", "hours": 50.0 * day}
        )
        found = analyse(run, estimate(RUNNING, 1e-3 * (VALUES[day - 1] + 1.0 * day)))
        told = json.loads(found.path.read_text(encoding="utf-8"))
        told["gear"] = gear_to_mapping(shipped_gear())
        found.path.unlink()
        found.path.write_text(json.dumps(told), encoding="utf-8")
        reseal(found.path)
    one = series(passport(tmp_path, "A1"))
    assert one.wear is not None
    value, low, high = one.wear.per_1000_hours
    assert low < 0.02 < high
    assert value == pytest.approx(0.02, rel=0.1)
    assert one.wear.hours_to_limit is not None
    assert one.limit is not None
    hours, least, most = one.wear.hours_to_limit
    assert least < 50.0 * (1e3 * one.limit.value - 92.0) < most
    assert least < hours < most
    assert "No remaining life is promised" in one.wear.sentence


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
