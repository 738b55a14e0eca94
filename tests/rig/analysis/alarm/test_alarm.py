"""Scores, sums, thresholds and changes: against draws whose law is known, and numbers worked out by hand."""

from __future__ import annotations

import json
from pathlib import Path
from statistics import NormalDist

import numpy as np
import pytest
from scipy.stats import kstest

from rig.analysis.alarm.laboratory import watching_in_force
from rig.analysis.alarm.lines import line
from rig.analysis.alarm.noted import NotedRun, noted
from rig.analysis.alarm.promise import Promise
from rig.analysis.alarm.scores import scores_of
from rig.analysis.alarm.sums import crossing_of, sums_of
from rig.analysis.alarm.threshold import alike_days, largest_sums, threshold_of, thresholds
from rig.analysis.alarm.watching import correlation_bound, days_of, watch
from rig.analysis.alarm.wear import trend
from rig.errors import ConfigurationError, RigError

RUNS = 30


def columns(warmth: np.ndarray) -> np.ndarray:
    """Level, warmth, a bench from run 12 on and a fresh mounting from run 20 on."""
    places = np.broadcast_to(np.arange(warmth.shape[1]), warmth.shape)
    parts = [np.ones_like(warmth), warmth, places >= 12, places >= 20]
    return np.stack([np.asarray(part, dtype=float) for part in parts], axis=2)


def test_scores_of_an_unchanged_gear_are_independent_and_normal_whatever_was_noted() -> None:
    generator = np.random.default_rng(5)
    warmth = generator.normal(size=(4000, RUNS))
    z = columns(warmth)
    moved = z @ np.array([3.0, -2.0, 5.0, -4.0]) + 0.7 * generator.normal(size=(4000, RUNS))
    scores = scores_of(moved, z).normal
    told = np.isfinite(scores[0])
    # Two runs teach level and warmth, one their scatter; a new bench and a new mounting take one run each.
    assert [k for k in range(RUNS) if not told[k]] == [0, 1, 2, 12, 20]
    for run in (3, 4, 13, 21, 29):
        assert kstest(scores[:, run], "norm").pvalue > 1e-3
    near = np.corrcoef(scores[:, told].T)
    assert np.abs(near - np.eye(len(near))).max() < 0.08


def test_scores_are_by_hand_what_they_say() -> None:
    values = np.array([[1.0, 3.0, 2.0, 6.0]])
    found = scores_of(values, np.ones((1, 4, 1)))
    assert found.expected[0, 1:] == pytest.approx([1.0, 2.0, 2.0])
    # w = 2/sqrt(2), 0, 4/sqrt(4/3); the last is held against the root of (2 + 0)/2, with two degrees of freedom.
    ratio = 4.0 / np.sqrt(4.0 / 3.0)
    below = 0.5 + ratio / (2.0 * np.sqrt(2.0 + ratio**2))
    assert found.normal[0, 3] == pytest.approx(NormalDist().inv_cdf(below))


def test_sums_by_hand() -> None:
    scores = np.array([[9.0, 9.0, 1.5, np.nan, -4.0, 3.0, 3.5]])
    found = sums_of(scores, 2)
    assert found.upper[0] == pytest.approx([0.0, 0.0, 3.0, 3.0, 0.0, 2.5, 5.5])
    assert found.lower[0] == pytest.approx([0.0, 0.0, 0.0, 0.0, 3.5, 0.0, 0.0])
    assert crossing_of(found, 5.0, 2) == 6
    assert crossing_of(found, 3.2, 2) == 4
    assert crossing_of(found, 6.0, 2) is None
    # A level that begins at run 5 has sums of its own, without a head start, and forgets what was before.
    anew = sums_of(scores, 2, (5,))
    assert anew.upper[0, 5:] == pytest.approx([2.5, 5.5])
    assert crossing_of(anew, 3.2, 2, (5,)) == 6


@pytest.mark.parametrize(
    ("baseline", "days", "correlation", "low", "high"),
    [
        (10, "independent", 0.0, 0.03, 0.07),
        (20, "independent", 0.0, 0.03, 0.07),
        (10, "independent", 0.3, 0.14, 0.28),
        (10, "alike", 0.3, 0.03, 0.07),
        (20, "alike", 0.3, 0.03, 0.07),
        (20, "alike", 0.0, 0.0, 0.02),
    ],
)
def test_a_promise_is_kept(
    baseline: int, days: str, correlation: float, low: float, high: float
) -> None:
    promise = Promise(baseline=baseline)
    largest = largest_sums(promise, correlation, 4000, np.random.default_rng(11))
    for count in (1, 3):
        threshold = threshold_of(promise, count, days)
        flagged = 1.0 - (largest <= threshold).mean() ** count
        assert low <= flagged <= high


def test_the_table_is_what_its_function_draws() -> None:
    drawn = thresholds(Promise(), "alike", blocks=1, seed=3)
    table = [threshold_of(Promise(), count, "alike") for count in (1, 2, 3)]
    assert drawn == pytest.approx(table, rel=0.04)


def test_another_promise_is_drawn_once_and_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.analysis.alarm.threshold._BLOCKS", 1)
    kept = tmp_path / "cache" / "kept.json"
    rare = threshold_of(Promise(false_alarms=0.01, over=5, baseline=4), 1, "independent", kept)
    often = threshold_of(Promise(false_alarms=0.2, over=5, baseline=4), 1, "independent", kept)
    assert rare > often + 1.0
    assert len(json.loads(kept.read_text(encoding="utf-8"))) == 2
    name = next(iter(json.loads(kept.read_text(encoding="utf-8"))))
    other = tmp_path / "other.json"
    other.write_text(json.dumps({name: [1.0, 2.0, 3.0]}), encoding="utf-8")
    promise = Promise(false_alarms=0.01, over=5, baseline=4)
    assert threshold_of(promise, 2, "independent", other) == 2.0


def test_what_a_laboratory_says_goes_before_what_is_usual(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert watching_in_force().promise == Promise(0.05, 20, 10)
    (tmp_path / "rig.toml").write_text(
        '[alarms]\nfalse_alarms = 0.02\nbaseline = 15\ngolden_gear = "G-1"\n', encoding="utf-8"
    )
    found = watching_in_force(over=40)
    assert found.promise == Promise(0.02, 40, 15)
    assert found.golden_gear == "G-1"
    with pytest.raises(RigError, match=r"alarms\.over.*5 to 200"):
        watching_in_force(over=1000)
    (tmp_path / "rig.toml").write_text("[alarms]\nfalse_alarm = 0.02\n", encoding="utf-8")
    with pytest.raises(ConfigurationError, match="false_alarm"):
        watching_in_force()
    # What no threshold is drawn for is refused where the file is read, in the same range.
    (tmp_path / "rig.toml").write_text("[alarms]\nbaseline = 3\n", encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"alarms\.baseline.*4"):
        watching_in_force()


def test_size_since_and_slope_of_a_change_are_recovered() -> None:
    generator = np.random.default_rng(8)
    warmth = 22.0 + generator.normal(size=40)
    runs = [NotedRun(temperature=float(t), bench="a") for t in warmth]
    values = 50.0 - 0.6 * warmth + 0.3 * generator.normal(size=40)
    values[25:] += 2.0
    found = watch(values.tolist(), runs, Promise(), 1, "independent")
    assert found.change is not None
    assert (found.change.since, found.change.direction) == (25, "larger")
    assert found.change.size.low < 2.0 < found.change.size.high
    assert found.change.scatter == pytest.approx(0.3, rel=0.3)
    drifting = values - 2.0 * (np.arange(40) >= 25) - 0.15 * np.maximum(np.arange(40) - 14, 0)
    drift = watch(drifting.tolist(), runs, Promise(), 1, "independent").change
    assert drift is not None
    assert drift.direction == "smaller"
    assert drift.per_run.value == pytest.approx(-0.15, rel=0.35)


@pytest.mark.parametrize(("correlation", "least"), [(0.0, 0.93), (0.3, 0.93)])
def test_the_interval_of_a_step_is_as_wide_as_its_days_make_it(
    correlation: float, least: float
) -> None:
    generator = np.random.default_rng(29)
    places = np.arange(30)
    matrix = np.column_stack([np.ones(30), places >= 18]).astype(float)
    held = 0
    for values in alike_days(600, 30, correlation, generator):
        found = line(values + 2.0 * (places >= 18), matrix, correlation)
        reach = found.quantile * float(np.sqrt(found.covariance[-1, -1]))
        held += abs(float(found.coefficients[-1]) - 2.0) <= reach
    assert least <= held / 600 <= 0.97


def test_warmth_that_moves_a_quantity_is_no_change() -> None:
    generator = np.random.default_rng(9)
    warmth = 22.0 + generator.normal(size=30)
    warmth[12:] += 6.0
    values = 80.0 - 1.2 * warmth + 0.2 * generator.normal(size=30)
    runs = [NotedRun(temperature=float(t)) for t in warmth]
    assert watch(values.tolist(), runs, Promise(), 1, "alike").change is None
    bare = [NotedRun() for _ in warmth]
    assert watch(values.tolist(), bare, Promise(), 1, "alike").change is not None


def test_a_gear_that_is_refitted_every_time_has_its_mounting_in_its_scatter() -> None:
    often = noted([NotedRun(mounting=f"{k}") for k in range(12)], 10)
    assert (often.columns, often.begins) == (("level",), {})
    once = noted([NotedRun(mounting=f"m{k // 6}", bench="ab"[k // 8]) for k in range(12)], 10)
    assert once.columns == ("level", "bench b", "new mounting at 6")
    assert once.begins == {6: "new mounting"}


def test_a_card_that_is_filled_in_later_begins_no_level_and_hides_no_change() -> None:
    runs = [NotedRun(lubricant="A" * (k > 4), bench="b" * (k > 5)) for k in range(30)]
    assert noted(runs, 10).columns == ("level",)
    generator = np.random.default_rng(17)
    values = 80.0 + 0.2 * generator.normal(size=30) + 1.0 * (np.arange(30) >= 12)
    blank = [NotedRun(lubricant="A" * (k > 11), mounting="m" * (k > 11)) for k in range(30)]
    found = watch(values.tolist(), blank, Promise(), 1, "alike")
    assert found.change is not None
    assert found.change.since == 12
    # Forgotten once and noted the same again is no change either; another grease is.
    gaps = [NotedRun(lubricant=name) for name in ("A", "", "A", "B", "", "B")]
    assert noted(gaps, 10).begins == {3: "fresh lubricant"}


def test_a_run_without_its_warmth_is_left_out() -> None:
    runs = [NotedRun(temperature=20.0 + 0.1 * (k % 4)) for k in range(12)]
    runs[11] = NotedRun()
    found = watch([80.0 + 0.1 * (k % 3) for k in range(11)] + [200.0], runs, Promise(), 1, "alike")
    assert np.isnan(found.scores[11])
    assert found.change is None


def test_days_are_alike_until_runs_enough_say_otherwise() -> None:
    generator = np.random.default_rng(4)
    few, many = generator.normal(size=49), generator.normal(size=400)
    alike = alike_days(1, 400, 0.3, generator)[0]
    assert correlation_bound(few) is None
    assert days_of([many]) == "independent"
    assert days_of([many, few]) == "alike"
    assert days_of([alike]) == "alike"
    assert days_of([]) == "alike"


def test_the_time_to_a_limit_holds_the_truth_as_often_as_it_says() -> None:
    generator = np.random.default_rng(13)
    hours, level = np.linspace(0.0, 500.0, 20), np.ones((20, 1))
    held = told = 0
    for _ in range(400):
        values = 80.0 + 0.02 * hours + generator.normal(size=20)
        found = trend(values, level, hours, 95.0, 0.0)
        assert found is not None
        if found.to_limit is not None:
            told += 1
            held += found.to_limit.low <= 250.0 <= found.to_limit.high
    assert told > 380
    assert 0.92 <= held / told <= 0.98


def test_hours_that_tell_nothing_promise_nothing() -> None:
    level = np.ones((12, 1))
    flat = np.array([80.0, 81.0, 79.0] * 4)
    assert trend(flat, level, np.full(12, 100.0), 95.0, 0.0) is None
    assert trend(flat, level, np.full(12, np.nan), 95.0, 0.0) is None
    found = trend(flat, level, np.arange(12.0), 95.0, 0.0)
    assert found is not None
    assert found.to_limit is None
