"""The report of a lot: what it counts, what it says of which gear, what it leaves unsaid, on screen and on paper."""

from __future__ import annotations

import json
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

pytest.importorskip("pyarrow")
pytest.importorskip("duckdb")

from rig.errors import ConfigurationError
from rig.fleet.capability import Capability
from rig.fleet.dataset import DataSet
from rig.fleet.lot import Lot, lot_of, why_of
from rig.fleet.lot_benches import by_bench
from rig.fleet.lot_figures import core, distribution
from rig.fleet.lot_page import lot_page, write_lot_report
from rig.fleet.table import table_bytes
from rig.gears.acceptance import shipped_acceptance
from rig.main import app
from tests.extras.lots import (
    ACCEPTANCE,
    BROKEN,
    FAILING,
    MARGINAL,
    NOT_ANALYSED,
    UNLIKE,
    shares,
    write_lot,
)
from tests.rig.library.stored import RUNNING, analyse, estimate, start, write

NOW = "2026-03-20T10:00:00+00:00"
LIMITS = shipped_acceptance(ACCEPTANCE).limits


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_lot(tmp_path_factory.mktemp("lot") / "fleet-results")


@pytest.fixture(scope="module")
def lot(folder: Path) -> Lot:
    return lot_of(folder)


def append(folder: Path, rows: list[dict[str, Any]]) -> None:
    with DataSet(folder).writing() as data:
        data.append(table_bytes(rows))


def rows_of(folder: Path) -> list[dict[str, Any]]:
    return DataSet(folder).table().to_pylist()


def test_every_gear_counts_once_with_its_verdict(lot: Lot) -> None:
    assert len(lot.gears) == 60
    assert lot.verdicts == {"PASS": 57, "MARGINAL": 1, "FAIL": 1, "NOT JUDGED": 1}
    verdicts = {gear.gear: gear.verdict for gear in lot.gears}
    assert verdicts[f"G{FAILING:03d}"] == "FAIL"
    assert verdicts[f"G{MARGINAL:03d}"] == "MARGINAL"
    assert verdicts[f"G{NOT_ANALYSED:03d}"] == "NOT JUDGED"
    assert lot.not_judged == {"no friction run of this gear is analysed": [f"G{NOT_ANALYSED:03d}"]}
    assert [gear for gear, _, _ in lot.data.failures] == [f"G{BROKEN:03d}"]


def test_capability_is_that_of_the_values_of_the_lot(lot: Lot) -> None:
    made = shares()
    for one in lot.quantities:
        place = next(i for i, limit in enumerate(LIMITS) if limit.name == one.name)
        column = made[:, place]
        if one.kind == "friction":
            column = np.delete(column, NOT_ANALYSED)
        assert isinstance(one.capability, Capability)
        expected = (1.0 - column.mean()) / (3.0 * column.std(ddof=1))
        assert one.capability.actual == pytest.approx(expected)
        assert one.capability.potential is None
        assert (one.limits and one.limits.upper, one.limits and one.limits.lower) == (
            pytest.approx(LIMITS[place].upper),
            None,
        )


def test_no_bar_stands_on_both_sides_of_a_limit_and_no_gear_is_lost(lot: Lot) -> None:
    for one in lot.quantities:
        factor, _ = one.shown_in
        values = np.array([row.value for row in one.measured], dtype=float) / factor
        low, high = core(values)
        values = values[(values >= low) & (values <= high)]
        bars, limit = distribution(one).series
        assert bars.y.sum() == len(values)
        half = 0.5 * float(bars.x[1] - bars.x[0])
        is_beyond = bars.x - half > limit.x[0] - 1e-9
        assert np.all(is_beyond | (bars.x + half < limit.x[0] + 1e-9))
        assert bars.y[is_beyond].sum() == np.sum(values > limit.x[0])


def test_the_gears_to_look_at_come_worst_first_and_say_why(lot: Lot) -> None:
    first = lot.to_look_at
    assert len(first) == 10
    assert [gear.gear for gear in first[:3]] == [f"G{n:03d}" for n in (FAILING, MARGINAL, UNLIKE)]
    assert "FAIL" in why_of(first[0])[0]
    assert "limit ≤ 1.3 arcmin" in why_of(first[0])[0]
    assert "below the median" in why_of(first[2])[0]
    assert why_of(first[3])[0].startswith("nearest to its limit")
    margins = [gear.margin for gear in first[3:]]
    assert margins == sorted(margins)


def test_a_gear_that_lacks_a_run_is_still_looked_at_for_what_it_shows(tmp_path: Path) -> None:
    whole = write_lot(tmp_path / "whole")
    with_marginal = f"G{MARGINAL:03d}"
    rows = [
        row
        for row in rows_of(whole)
        if not (row["gear"] == with_marginal and row["kind"] == "starting-torque")
    ]
    append(tmp_path / "lacking", rows)
    lacking = lot_of(tmp_path / "lacking")
    (gear,) = (one for one in lacking.gears if one.gear == with_marginal)
    assert (gear.verdict, gear.is_complete) == ("NOT JUDGED", False)
    assert gear.because == ("no starting-torque run of this gear is analysed",)
    assert lacking.to_look_at[1] == gear
    assert why_of(gear)[0].startswith("running torque 2000 r/min at 20 °C: MARGINAL")


def test_a_gear_that_has_changed_over_its_runs_is_looked_at(tmp_path: Path) -> None:
    rows, life = rows_of(write_lot(tmp_path / "whole")), tmp_path / "life"
    life.mkdir()
    like = next(
        row for row in rows if row["kind"] == "starting-torque" and row["verdict"] == "PASS"
    )
    for number in range(1, 15):
        run = write(life, number, start_time=start(number))
        analyse(run, estimate(RUNNING, 0.08 + 0.0005 * (number % 3) + 0.02 * (number > 11)))
        rows.append(like | {"gear": "A1", "run_file": str(run), "run": run.stem})
    append(tmp_path / "more", rows)
    found = lot_of(tmp_path / "more")
    changed = {one.gear: one.changed for one in found.gears if one.changed}
    assert list(changed) == ["A1"]
    assert "is larger by" in changed["A1"][0]
    assert "since run 00012-friction-A1" in changed["A1"][0]
    assert any(gear.gear == "A1" for gear in found.to_look_at)


def test_benches_beside_each_other(lot: Lot) -> None:
    one = next(q for q in lot.quantities if q.kind == "starting-torque")
    a, b = by_bench(one)
    assert (a.bench, a.gears, b.bench, b.gears) == ("A", 30, "B", 30)
    assert a.difference is not None
    assert b.difference is not None
    assert a.difference[0] == pytest.approx(a.mean - b.mean)
    assert a.difference == (pytest.approx(-b.difference[0]), pytest.approx(b.difference[1]))


def test_a_text_that_another_program_left_out_is_an_empty_one(tmp_path: Path) -> None:
    """A row without its bench, as a column of another writer holds it, stands beside those that have one."""
    rows = rows_of(write_lot(tmp_path / "whole", 12))
    append(tmp_path / "lacking", [row | {"bench": None} for row in rows[::2]] + rows[1::2])
    lot = lot_of(tmp_path / "lacking")
    benches = {row.bench for quantity in lot.quantities for row in quantity.rows}
    assert "" in benches
    assert None not in benches
    assert all(isinstance(one.bench, str) for one in by_bench(lot.quantities[0]))


def test_a_drift_is_found_with_its_interval_and_not_told_of_two_days(tmp_path: Path) -> None:
    folder = write_lot(tmp_path / "made")
    first = min(row["started"] for row in rows_of(folder) if row["started"])
    drifting = [
        row | {"value": row["value"] * (1 + 0.02 * (row["started"] - first).days)}
        for row in rows_of(folder)
        if row["value"]
    ]
    append(tmp_path / "drifting", drifting)
    one = lot_of(tmp_path / "drifting").quantities[0]
    (slope, half), _ = (bench.slope for bench in by_bench(one) if bench.slope)
    # 2 % a day of a mean at 0.8 of the limit.
    expected = 30 * 0.02 * 0.8 * float(one.rows[0].limit_value or 0.0)
    assert half < 0.5 * expected
    assert slope == pytest.approx(expected, abs=1.5 * half)
    two_days = [row for row in drifting if (row["started"] - first).days < 2]
    append(tmp_path / "two", two_days)
    assert {bench.slope for bench in by_bench(lot_of(tmp_path / "two").quantities[0])} == {None}


def test_a_newer_run_takes_the_place_of_an_older_one_but_not_one_that_was_broken_off(
    folder: Path, tmp_path: Path
) -> None:
    copy = write_lot(tmp_path / "copy")
    failing = [
        r for r in rows_of(folder) if r["gear"] == f"G{FAILING:03d}" and r["verdict"] == "FAIL"
    ]
    for days, outcome, verdict in ((1, "COMPLETED", "PASS"), (2, "TRIPPED", "FAIL")):
        later = {
            "run_file": f"/runs/again{days}.h5",
            "run": f"again{days}",
            "started": failing[0]["started"] + timedelta(days=days),
            "outcome": outcome,
            "verdict": verdict,
            "value": 0.5 * failing[0]["limit_value"],
        }
        of_kind = [
            r
            for r in rows_of(folder)
            if (r["gear"], r["kind"]) == (failing[0]["gear"], failing[0]["kind"])
        ]
        append(copy, [row | later for row in of_kind])
    again = lot_of(copy)
    assert again.verdicts["FAIL"] == 0
    assert len(again.gears) == 60
    assert any("broken off" in note for note in again.notes)


def test_few_gears_and_no_limit_have_no_capability_and_it_is_said(tmp_path: Path) -> None:
    few = lot_of(write_lot(tmp_path / "few", 6))
    assert all("6 gears judged, 10 are needed" in str(one.capability) for one in few.quantities)
    unlimited = {
        name: value
        for name, value in (
            ("limit_value", None),
            ("verdict", ""),
            ("acceptance", ""),
            ("run_verdict", "NOT JUDGED"),
        )
    }
    none = lot_of(write_lot(tmp_path / "none", 12, **unlimited))
    assert none.verdicts["NOT JUDGED"] == 12
    assert {str(one.capability) for one in none.quantities} == {"no limit is on it"}
    (reason,) = none.not_judged
    assert "no acceptance file is named" in reason


def test_a_limit_that_nobody_confirmed_gives_no_capability(tmp_path: Path) -> None:
    doubt = {"verdict": "NOT JUDGED", "reason": "the limit is not confirmed: nobody has"}
    lot = lot_of(write_lot(tmp_path / "doubt", 20, **doubt))
    assert lot.verdicts["NOT JUDGED"] == 20
    assert {str(one.capability) for one in lot.quantities} == {
        "no gear is judged: the limit is not confirmed: nobody has"
    }


def test_an_acceptance_file_that_changed_or_is_gone_is_told(tmp_path: Path) -> None:
    changed = lot_of(write_lot(tmp_path / "changed", 12, upper_limit=1e3))
    assert any("has changed since" in note for note in changed.notes)
    gone = lot_of(write_lot(tmp_path / "gone", 12, acceptance="/no/such/file.toml"))
    assert any("cannot be read" in note for note in gone.notes)
    assert all(isinstance(one.capability, Capability) for one in gone.quantities)


def test_both_sides_of_a_limit_stand_in_the_results(tmp_path: Path) -> None:
    two = write_lot(tmp_path / "two", 12, lower_limit=0.0, acceptance="/no/such/file.toml")
    for one in lot_of(two).quantities:
        assert one.limits is not None
        assert isinstance(one.capability, Capability)
        assert one.capability.potential == pytest.approx(
            (one.limits.upper or 0.0) / (6 * one.capability.standard_deviation)
        )
    append(two, [rows_of(two)[0] | {"run_file": "/runs/x.h5", "gear": "X", "lower_limit": None}])
    told = {str(one.capability) for one in lot_of(two).quantities}
    assert "gears were judged by different lower limits" in told


def test_hardware_alone_counts_where_there_is_any(tmp_path: Path) -> None:
    mixed = write_lot(tmp_path / "mixed", 12)
    append(
        mixed,
        [
            row
            | {"run_file": row["run_file"] + "2", "gear": "H" + row["gear"], "origin": "hardware"}
            for row in rows_of(mixed)
        ],
    )
    lot = lot_of(mixed)
    assert (lot.data.origin, len(lot.gears)) == ("hardware", 12)
    assert any("12 gears of origin simulated are left out" in note for note in lot.notes)
    assert lot_of(mixed, origin="simulated").gears[0].gear == "G000"
    with pytest.raises(ConfigurationError, match="hold no gear of this lot"):
        lot_of(mixed, part="another")


def test_the_page_shows_it_and_the_same_results_give_the_same_bytes(
    lot: Lot, tmp_path: Path
) -> None:
    first = write_lot_report(lot, tmp_path / "lot.html", NOW).read_text()
    for words in (
        "Lot of 60 gears",
        "SIMULATED",
        "57 of 60 PASS",
        "Bissell",
        f"G{FAILING:03d}",
        "Bench beside bench",
    ):
        assert words in first
    assert write_lot_report(lot, tmp_path / "again.html", NOW).read_text() == first
    assert not lot_page(lot, NOW).signature.allowed
    assert write_lot_report(lot, tmp_path / "lot.pdf", NOW).read_bytes().startswith(b"%PDF")


def test_the_command(folder: Path, tmp_path: Path) -> None:
    output = tmp_path / "lot.html"
    done = CliRunner().invoke(app, ["fleet", "report", str(folder), "-o", str(output), "--json"])
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert (told["gears"], told["verdicts"]["FAIL"]) == (60, 1)
    assert told["look_at"][0]["gear"] == f"G{FAILING:03d}"
    assert output.is_file()
