"""What a passport tells to have changed: since when, by how much, what hides it and what does not."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from model.gear_file import gear_to_mapping, shipped_gear
from rig.analysis.alarm.promise import Watching
from rig.analysis.alarm.watching import BOUNDING_RUNS
from rig.analysis.passport.build import alarms_of, passport
from tests.rig.analysis.passport_runs import (
    VALUES,
    WORN,
    analysed,
    folder,
    fourteen,
    history,
    series,
    taken,
)
from tests.rig.analysis.test_difference import calibrated
from tests.rig.library.stored import RUNNING, analyse, estimate, start, write
from tests.rig.runfile.making import reseal

__all__ = ["folder", "fourteen", "history"]


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
