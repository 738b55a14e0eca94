"""A study of the gauge: published components, truths recovered, intervals that cover, gaps, command and page."""

from __future__ import annotations

import csv
import math
import os
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.errors import ConfigurationError
from rig.fleet.dataset import DataSet
from rig.fleet.gauge.anova import by_anova, expected_rows, gauge_of_rows
from rig.fleet.gauge.components import GAUGE, GaugeError, Values
from rig.fleet.gauge.plan import designs, factor_of_few, proposals, variances_of
from rig.fleet.gauge.reml import by_reml
from rig.fleet.gauge.study import (
    WITHOUT_ECCENTRICITY,
    gauges_of,
    studies_of,
    study_of_table,
    words_of,
)
from rig.fleet.lot import lot_of
from rig.fleet.lot_page import lot_page
from rig.fleet.rows import EMPTY
from rig.fleet.table import table_bytes
from tests.extras.lots import BEGIN
from tests.rig.commands.calling import Rig
from tests.rig.commands.printed import every_table_has_room

TABLE = (
    Path(
        os.environ.get("HARMONIC_RIG_DATA", Path(__file__).resolve().parents[3] / "shared" / "data")
    )
    / "aiag"
    / "msa4.csv"
)
KIND, NAME = "starting-torque", "starting_torque"


def values_of(y: np.ndarray) -> Values:
    """Values (gears, benches, mountings, repeats) with the names of their levels."""
    places = list(np.ndindex(y.shape))
    return Values(
        gear=[f"G{at[0]}" for at in places],
        bench=[f"B{at[1]}" for at in places],
        mounting=[f"M{at[2]}" for at in places],
        value=[float(y[at]) for at in places],
    )


def drawn(shape: tuple[int, int, int, int], deviations: dict[str, float], seed: int) -> np.ndarray:
    """A study of known components."""
    p, o, m, r = shape
    random = np.random.default_rng(seed)
    of = {"gear": (p, 1, 1, 1), "bench": (1, o, 1, 1), "interaction": (p, o, 1, 1)}
    of |= {"mounting": (p, o, m, 1), "repeat": (p, o, m, r)}
    parts = (deviations.get(term, 0.0) * random.standard_normal(of[term]) for term in of)
    return np.asarray(sum(parts, np.zeros(shape)))


@pytest.mark.skipif(not TABLE.is_file(), reason="the handbook's table is not here")
def test_the_handbooks_table_gives_the_handbooks_numbers() -> None:
    found = study_of_table(TABLE)
    (one,) = found.studies
    gauge = one.gauge
    told = [
        gauge.deviation("repeat"),
        gauge.deviation("bench", "interaction"),
        gauge.deviation(*GAUGE),
        gauge.deviation("gear"),
    ]
    assert [round(value, 5) for value in told] == [0.19993, 0.22684, 0.30237, 1.04233]
    assert round(gauge.percent_of_study, 2) == 27.86
    assert gauge.distinct == 4
    assert gauge.pooled
    assert one.unpooled is not None
    assert round(one.unpooled.percent_of_study, 2) == 28.75
    interaction = next(row for row in gauge.rows if row.term == "interaction")
    assert round(interaction.f, 2) == 0.43
    assert one.shape == "10 gears x 3 benches x 3 repeats"


def test_a_small_study_by_hand() -> None:
    """Two gears, two benches, two repeats without any noise but one of the repeats."""
    y = np.array([[[[1.0, 3.0]], [[5.0, 7.0]]], [[[11.0, 13.0]], [[15.0, 17.0]]]])
    gauge = by_anova(values_of(y), may_pool=False)
    squares = {row.term: row.squares for row in gauge.rows}
    assert squares == pytest.approx(
        {"gear": 200.0, "bench": 32.0, "interaction": 0.0, "repeat": 8.0}
    )
    # 200/1 and 32/1 over an interaction of 0; repeats 8/4.
    assert gauge.variances == pytest.approx(
        {"gear": 50.0, "bench": 8.0, "interaction": 0.0, "repeat": 2.0}
    )
    assert gauge.negative == ("interaction",)
    assert gauge.percent_of_study == pytest.approx(100.0 * math.sqrt(10.0 / 60.0))
    assert gauge.distinct == int(1.41 * math.sqrt(5.0))
    assert gauge.percent_of_tolerance(0.0, 20.0, 9.0) == pytest.approx(30.0 * math.sqrt(10.0))
    assert gauge.percent_of_tolerance(None, 19.0, 9.0) == pytest.approx(30.0 * math.sqrt(10.0))
    assert math.isnan(gauge.percent_of_tolerance(None, None, 9.0))
    assert gauge.apart(one_bench=True) == pytest.approx(1.96 * 2.0)
    assert gauge.averaged(1, 2) == pytest.approx(100.0 * math.sqrt(9.0 / 59.0))


def test_components_are_recovered_from_a_large_study() -> None:
    true = {"gear": 3.0, "bench": 1.0, "interaction": 0.8, "mounting": 0.6, "repeat": 0.4}
    gauge = by_anova(values_of(drawn((60, 40, 2, 2), true, 1)))
    for term, deviation in true.items():
        assert gauge.deviation(term) == pytest.approx(deviation, rel=0.2), term


def test_intervals_cover_the_truth() -> None:
    true = {"gear": 1.0, "bench": 0.25, "interaction": 0.1, "mounting": 0.15, "repeat": 0.1}
    gauge = {term: value for term, value in true.items() if term != "gear"}
    grr = math.sqrt(sum(v**2 for v in gauge.values()))
    percent = 100.0 * grr / math.hypot(grr, true["gear"])
    inside = inside_grr = 0
    for seed in range(100, 300):
        found = by_anova(values_of(drawn((8, 4, 2, 2), true, seed)), may_pool=False)
        low, high = found.interval_of_percent
        inside += low <= percent <= high
        low, high = found.interval_of_deviation(*GAUGE)
        inside_grr += low <= grr <= high
    assert 180 <= inside <= 199
    assert 180 <= inside_grr <= 199


def test_gaps_go_by_likelihood_which_agrees_where_there_are_none() -> None:
    true = {"gear": 1.0, "bench": 0.4, "interaction": 0.3, "mounting": 0.3, "repeat": 0.2}
    whole = values_of(drawn((6, 3, 2, 2), true, 5))
    exact, likely = by_anova(whole, may_pool=False), by_reml(whole)
    assert not exact.negative
    for term in true:
        assert likely.deviation(term) == pytest.approx(exact.deviation(term), rel=2e-3), term
    kept = [at for at in range(len(whole.value)) if at % 7]
    gappy = Values(
        **{name: [getattr(whole, name)[at] for at in kept] for name in vars(whole)}  # type: ignore[arg-type]
    )
    with pytest.raises(GaugeError, match="not balanced"):
        by_anova(gappy)
    gauge, unpooled = gauges_of(gappy)
    assert (gauge.method, unpooled) == ("reml", None)
    low, high = gauge.interval_of_percent
    assert low < gauge.percent_of_study < high
    assert gauge.percent_of_study == pytest.approx(exact.percent_of_study, rel=0.25)


def test_what_nothing_tells_apart_stands_in_the_level_above() -> None:
    true = {"gear": 1.0, "bench": 0.4, "interaction": 0.3, "mounting": 0.3, "repeat": 0.2}
    assert set(by_anova(values_of(drawn((5, 3, 1, 2), true, 6)), may_pool=False).variances) == {
        *("gear", "bench", "interaction", "repeat")
    }
    one_bench = by_anova(values_of(drawn((5, 1, 3, 2), true, 7)))
    assert set(one_bench.variances) == {"gear", "mounting", "repeat"}
    assert set(by_anova(values_of(drawn((5, 3, 1, 1), true, 8))).variances) == {
        *("gear", "bench", "interaction")
    }
    for shape in ((1, 3, 1, 2), (5, 1, 1, 1)):
        with pytest.raises(GaugeError, match="at least two gears"):
            by_anova(values_of(np.ones(shape)))
        with pytest.raises(GaugeError):
            by_reml(values_of(drawn(shape, true, 9)))


def test_a_lot_that_is_no_study_is_refused_and_not_guessed_at() -> None:
    y = np.random.default_rng(1).normal(size=60)
    gears = [f"G{n}" for n in range(60)]
    once = Values(gear=gears, bench=["A", "B"] * 30, mounting=[""] * 60, value=y.tolist())
    with pytest.raises(GaugeError, match="no gear was measured twice"):
        gauges_of(once)
    again = [f"G{n // 2}" for n in range(60)]
    apart = Values(gear=again, bench=["A"] * 20 + ["B"] * 40, mounting=[""] * 60, value=y.tolist())
    with pytest.raises(GaugeError, match="no gear was on two benches"):
        gauges_of(apart)
    many = [f"G{n % 300}" for n in range(601)]
    large = np.random.default_rng(2).normal(size=601).tolist()
    with pytest.raises(GaugeError, match="601 values with gaps"):
        gauges_of(Values(gear=many, bench=["A"] * 601, mounting=[""] * 601, value=large))


def test_a_plan_keeps_the_wished_interval_or_says_that_none_does() -> None:
    every = designs(variances_of(20.0), 12)
    assert [one.runs for one in every] == sorted(one.runs for one in every)
    proposed = proposals(every, 12.0)
    assert proposed
    assert all(one.half_width <= 12.0 for one in proposed)
    assert not proposals(designs(variances_of(30.0), 2), 10.0)
    # The same design in the middle of many studies: its interval is as wide as was said.
    one = proposed[0]
    shape = (one.gears, one.benches, one.mountings, one.repeats)
    deviations = {term: math.sqrt(v) for term, v in variances_of(20.0).items()}
    widths = []
    for seed in range(40):
        found = by_anova(values_of(drawn(shape, deviations, 400 + seed)), may_pool=False)
        low, high = found.interval_of_percent
        widths.append(0.5 * (high - low))
    assert float(np.median(widths)) == pytest.approx(one.half_width, rel=0.2)
    assert factor_of_few(2) == pytest.approx((0.446, 31.9), rel=0.01)
    rows = expected_rows(variances_of(20.0), shape)
    assert gauge_of_rows(rows, shape).percent_of_study == pytest.approx(20.0)


def written(folder: Path, y: np.ndarray, **changes: Any) -> Path:
    """The results of a study (gears, benches, mountings, repeats) of the starting torque in N m."""
    rows = []
    for number, at in enumerate(np.ndindex(y.shape)):
        run = f"{number:05d}-{KIND}-G{at[0]}"
        rows.append(
            EMPTY
            | {
                "run_file": f"/runs/{run}.h5",
                "run": run,
                "gear": f"G{at[0]}",
                "part": "CSF-25-120-2UH",
                "bench": f"B{at[1]}",
                "mounted": f"mounting {at[2] + 1}",
                "started": BEGIN + timedelta(hours=number),
                "origin": "simulated",
                "outcome": "COMPLETED",
                "kind": KIND,
                "quantity": NAME,
                "family": NAME,
                "is_metric": False,
                "value": float(y[at]),
                "unit": "N m",
                "identifiable": "yes",
                "upper_limit": 0.080,
                "verdict": "",
                "failure": "",
                "failure_kind": "",
                "warnings": 0,
                "key": run,
                "analysis_version": 1,
            }
            | changes
        )
    with DataSet(folder).writing() as data:
        data.append(table_bytes(rows))
    return folder


@pytest.fixture
def call(capsys: pytest.CaptureFixture[str]) -> Rig:
    return Rig(capsys)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    true = {"gear": 0.004, "bench": 0.001, "mounting": 0.0012, "repeat": 0.0005}
    y = 0.060 + drawn((6, 3, 2, 2), true, 11)
    return written(tmp_path_factory.mktemp("study") / "fleet-results", y)


def test_a_study_is_read_from_all_runs_of_a_fleet(folder: Path) -> None:
    found = studies_of(folder)
    (one,) = found.studies
    assert (found.origin, one.shape) == (
        "simulated",
        "6 gears x 3 benches x 2 mountings x 2 repeats",
    )
    assert one.title == "starting torque"
    assert one.upper == 0.080
    assert one.percent_of_tolerance == pytest.approx(
        100.0 * 3.0 * one.gauge.deviation(*GAUGE) / (0.080 - one.mean)
    )
    first, *_ = words_of(one)
    apart = 1e3 * one.gauge.apart()
    assert first.startswith(
        f"Between two benches it does not tell gears closer than {apart:.2g} mN m"
    )
    assert "3 benches say little of benches" in " ".join(words_of(one))
    with pytest.raises(ConfigurationError, match="was not measured"):
        studies_of(folder, wanted=["friction.F_c"])
    with pytest.raises(ConfigurationError, match="no study of the gauge"):
        studies_of(folder, origin="hardware")


def test_runs_of_one_mounting_are_its_repeats_and_not_mountings(tmp_path: Path) -> None:
    y = 0.06 + drawn((4, 2, 2, 2), {"gear": 0.004, "bench": 0.001, "repeat": 0.0005}, 12)
    (one,) = studies_of(written(tmp_path / "fleet-results", y, mounted="")).studies
    assert one.shape == "4 gears x 2 benches x 4 repeats"
    assert "mounting" not in one.gauge.variances


def test_a_lot_says_how_good_its_gauge_is_where_its_runs_are_a_study(folder: Path) -> None:
    page = lot_page(lot_of(folder), "2026-03-20T10:00:00+00:00")
    section = next(one for one in page.sections if one.anchor == "gauge")
    assert section.grids[0].texts("ndc") == [str(studies_of(folder).studies[0].gauge.distinct)]


def test_the_command_prints_writes_and_plans(folder: Path, call: Rig, tmp_path: Path) -> None:
    page = tmp_path / "gauge.html"
    told = call.json("fleet", "rr", folder, "--output", page)
    (one,) = told["studies"]
    study = studies_of(folder).studies[0]
    assert one["percent_of_study"] == pytest.approx(study.gauge.percent_of_study)
    assert one["deviations"]["GRR"]["value"] == pytest.approx(study.gauge.deviation(*GAUGE))
    assert one["ndc"] == study.gauge.distinct
    text = page.read_text(encoding="utf-8")
    assert "Gauge repeatability and reproducibility: 6 gears on 3 benches" in text
    assert "Analysis of variance" in text
    with every_table_has_room():
        assert call("fleet", "rr", folder) == 0
    assert "6 gears x 3 benches x 2 mountings x 2 repeats" in call.out
    assert "SIMULATED" in call.out
    plan = call.json("fleet", "rr", "--plan", "--benches", 3, "--within", 5)
    assert (plan["is_kept"], plan["assumed"], len(plan["designs"])) == (False, True, 1)
    with every_table_has_room():
        assert call("fleet", "rr", "--plan", "--benches", 3) == 0
    assert "No study with 3 benches" in call.out


def test_a_table_that_is_none_is_refused_by_its_place(tmp_path: Path, call: Rig) -> None:
    table = tmp_path / "t.csv"
    table.write_text("gear,value\nA,1\n", encoding="utf-8")
    assert call("fleet", "rr", table) == 2
    assert "bench" in call.err
    with table.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([["part", "operator", "value"], ["A", "1", "x"]])
    assert call("fleet", "rr", table) == 2
    assert "line 2" in call.err


def test_without_order_one_over_n_the_mounting_is_not_seen(tmp_path: Path) -> None:
    """Two orders, of which the mounting moves one: without it all that is left is the gear's own."""
    names = {"amplitude_2": 8e-5, "phase_2": 0.3, "phase_1/N": 0.0}
    rows: list[dict[str, Any]] = []
    for gear, bench, repeat in np.ndindex(3, 2, 2):
        own = names | {"amplitude_2": 8e-5 + 1e-5 * gear, "amplitude_1/N": 2e-5 * (1 + bench)}
        run = f"{gear}{bench}{repeat}"
        for name, value in own.items():
            rows.append(
                EMPTY
                | {
                    "run_file": run,
                    "run": run,
                    "gear": f"G{gear}",
                    "bench": f"B{bench}",
                    "part": "CSF-25-120-2UH",
                    "mounted": "",
                    "origin": "simulated",
                    "outcome": "COMPLETED",
                    "kind": "kinematic-error",
                    "quantity": name,
                    "family": f"{name.partition('_')[0]}_{{order}}",
                    "is_metric": False,
                    "value": value,
                    "unit": "rad",
                    "identifiable": "yes",
                    "failure": "",
                    "verdict": "",
                    "failure_kind": "",
                    "warnings": 0,
                    "key": run,
                    "analysis_version": 1,
                }
            )
    with DataSet(tmp_path / "fleet-results").writing() as data:
        data.append(table_bytes(rows))
    with_it = {one.name: one for one in studies_of(tmp_path / "fleet-results").studies}
    one = with_it[WITHOUT_ECCENTRICITY]
    assert one.values.value[0] == pytest.approx(2.0 * 8e-5, rel=1e-6)
    assert one.gauge.percent_of_study == pytest.approx(0.0, abs=1e-3)
