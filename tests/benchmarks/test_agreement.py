"""E_n of two results: what both share does not count."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from experiments.errors import AnalysisError
from model.identify.estimate import BudgetLine, Cause, Estimate
from rig.bench.backends.order import Order
from tests.benchmarks.agreement_study import main, normalised_error, pair_line, table


def estimate(value: float, scatter: float, shared: float) -> Estimate:
    lines = (
        BudgetLine("scatter between revolutions and points", "A", scatter),
        BudgetLine("torque scale", "B", shared, cause=Cause.TORQUE_SCALE),
        BudgetLine("output bearing", "B", shared),
    )
    return Estimate(
        name="coulomb",
        value=value,
        unit="N",
        low=value - 2.0 * scatter,
        high=value + 2.0 * scatter,
        budget=lines,
    )


def test_an_error_that_both_share_does_not_make_them_agree() -> None:
    a, b = estimate(70.0, 0.5, 10.0), estimate(73.0, 0.5, 10.0)
    assert normalised_error(a, b) == pytest.approx(-3.0 / (1.96 * 0.5 * np.sqrt(2.0)), rel=1e-3)


def test_honest_results_agree_in_about_95_of_100_pairs() -> None:
    random = np.random.default_rng(5)
    shared = 10.0 * random.standard_normal(400)
    values = shared + 70.0 + 0.5 * random.standard_normal((2, 400))
    numbers = [pair_line(estimate(a, 0.5, 10.0), estimate(b, 0.5, 10.0)) for a, b in values.T]
    (row,) = table([{"numbers": numbers}])
    assert row["quantity"] == "coulomb"
    assert row["pairs"] == 400
    assert 0.92 <= row["within"] / 400 <= 0.98
    assert row["worst"] == pytest.approx(
        max(abs(number["normalised_error"]) for number in numbers), abs=1e-3
    )


def test_a_quantity_that_one_of_both_cannot_tell_makes_no_pair() -> None:
    unsure = replace(estimate(70.0, 0.5, 1.0), identifiable="weakly")
    line = pair_line(estimate(70.0, 0.5, 1.0), unsure)
    assert line == {"quantity": "coulomb", "normalised_error": None}
    assert table([{"numbers": [line]}]) == []


def report(outcome: str, safe: bool = True) -> SimpleNamespace:
    return SimpleNamespace(outcome=outcome, safe=safe, message="it tripped", path=Path("run.h5"))


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch) -> dict[int, object]:
    """What the second run of a seed comes to; the fits of all others are alike."""
    second: dict[int, object] = {}

    def run(request: Order, *, judged: bool) -> SimpleNamespace:
        found = second.get(request.seed, report("PASS")) if request.world.number == 2 else None
        if isinstance(found, BaseException):
            raise found
        return found or report("PASS")  # type: ignore[return-value]

    fit = SimpleNamespace(result=SimpleNamespace(estimates={"coulomb": estimate(70.0, 0.5, 1.0)}))
    monkeypatch.setattr("rig.run.start.run_order", run)
    monkeypatch.setattr("tests.rig.fitting.fit_files", lambda *a, **k: (fit, fit))
    return second


def test_a_pair_that_comes_to_nothing_is_named_and_the_others_go_on(
    runs: dict[int, object], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs |= {
        41: report("TRIPPED"),
        42: AnalysisError("cannot be fitted", where="run 2"),
        43: ZeroDivisionError("a defect"),
    }
    rows = tmp_path / "rows.jsonl"
    words = ["--first-seed", "40", "--seeds", "5", "--rows", str(rows), "--uncommitted", "--json"]
    assert main(words) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["first_seed"] == 40
    assert answer["commit"]
    assert answer["rows"] == [{"quantity": "coulomb", "pairs": 2, "within": 2, "worst": 0.0}]
    assert answer["without_result"] == [
        {
            "seed": 41,
            "outcome": "failed",
            "words": "friction, run 2 of 3: it tripped",
        },
        {"seed": 42, "outcome": "refused", "words": "run 2: cannot be fitted"},
        {"seed": 43, "outcome": "crashed", "words": "ZeroDivisionError('a defect')"},
    ]
    written = [json.loads(line) for line in rows.read_text().splitlines()]
    assert [line["seed"] for line in written] == [40, 41, 42, 43, 44]
    assert {line["commit"] for line in written} == {answer["commit"]}


def test_rows_are_there_when_the_study_is_cut_off(runs: dict[int, object], tmp_path: Path) -> None:
    runs[42] = KeyboardInterrupt()  # type: ignore[assignment]
    rows = tmp_path / "rows.jsonl"
    with pytest.raises(KeyboardInterrupt):
        main(["--first-seed", "40", "--seeds", "5", "--rows", str(rows), "--uncommitted"])
    assert [json.loads(line)["seed"] for line in rows.read_text().splitlines()] == [40, 41]
