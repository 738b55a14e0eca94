"""The studies of verdicts and imports: one case of each, what they keep, and what their tables say."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.benchmarks import unsaid_study, verdict_study
from tests.benchmarks.rows_file import Line, add_rows
from tests.benchmarks.unsaid_cases import MAKERS, made


def stored(seed: int, value: float, **others: Any) -> Line:
    """A number with U = 2 whose truth is 10."""
    line: Line = {"what": "number", "seed": seed, "kind": "warm-up", "quantity": "running_torque"}
    line |= {"called": "yes", "value": value, "low": value - 1.0, "high": value + 1.0}
    line |= {"expanded": 2.0, "factor": 2.0, "unit": "N m", "true": 10.0, "is_circular": False}
    return line | others


def run_of(seed: int, **others: Any) -> Line:
    line: Line = {"what": "run", "seed": seed, "kind": "warm-up", "unchecked": [], "subject": ""}
    return line | others


def test_verdicts_at_the_truth_are_those_of_the_program() -> None:
    # Below by more than U keeps an upper limit for certain, above by more than U a lower one.
    values = (6.0, 9.0, 11.0, 14.0)
    lines = [n for k, v in enumerate(values) for n in (run_of(k), stored(k, v))]
    cases = list(verdict_study.judged(lines))
    assert [c["upper"] for c in cases] == ["PASS", "MARGINAL", "MARGINAL", "FAIL"]
    assert [c["lower"] for c in cases] == ["FAIL", "MARGINAL", "MARGINAL", "PASS"]
    # Only a truth that is beyond U from its value lets a limit be kept that is broken.
    assert [c["wrong"] > 0 for c in cases] == [True, False, False, True]
    found = verdict_study.summary(cases)
    assert found["rows"][0] | {"wrong_share": 0} == {
        "kind": "warm-up",
        "quantity": "running_torque",
        "benches": 4,
        "upper": 1,
        "lower": 1,
        "allowed": 0,
        "wrong_share": 0,
    }
    assert len(found["miss"]) == 1


def test_what_lacks_evidence_or_a_number_is_not_judged() -> None:
    (unchecked,) = verdict_study.judged([run_of(1, unchecked=["torque zero"]), stored(1, 7.0)])
    assert unchecked["upper"] == "NOT JUDGED"
    (no_number,) = verdict_study.judged([run_of(1), stored(1, 7.0, called="no")])
    assert no_number["upper"] == "NOT JUDGED"
    assert verdict_study.summary([no_number])["not_judged"] == 1


def test_one_import_from_arithmetic_to_row(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = tmp_path / "rows.jsonl"
    words = ["--first-seed", "105", "--recordings", "1", "--rows", str(rows), "--uncommitted"]
    assert unsaid_study.main(words) == 0
    answer = json.loads(capsys.readouterr().out)
    (line,) = map(json.loads, rows.read_text(encoding="utf-8").splitlines())
    assert (line["kind"], line["outcome"]) == ("hysteresis", "analysed")
    assert answer["recordings"] == 1
    add_rows(rows, [{**line, "commit": "another"}])
    assert len(rows.read_text(encoding="utf-8").splitlines()) == 2


def test_a_pattern_leaves_away_what_it_names() -> None:
    seeds = range(len(MAKERS) * 8)
    told = [made(seed) for seed in seeds if seed % len(MAKERS) == 0]
    for foreign, pattern in told:
        says = {c for c, said in foreign.said.items() if said.get("accuracy") is not None}
        unsaid = {"encoders": set(), "everything": set(), "output encoder": {"input_angle"}}
        unsaid |= {"input encoder": {"output_angle"}}
        assert says == unsaid.get(pattern, {"input_angle", "output_angle"}), pattern
        assert ("resonance_hz" in foreign.options) is (pattern not in ("inertia", "everything"))


def test_a_wrong_number_that_rests_on_the_unsaid_is_counted() -> None:
    number = {"quantity": "coulomb", "true": 1.0, "value": 1.2, "expanded": 0.1, "called": "yes"}
    line = {"kind": "motion", "unsaid": "torque scale", "outcome": "analysed", "seed": 1}
    found = unsaid_study.summary([{**line, "numbers": [{**number, "rests": True}]}])
    assert (found["wrong_on_what_was_not_said"], found["allowed"]) == (1, 0)
    assert "2.0 U (rests on what was not said)" in found["wrong"][0]
    within = {**number, "value": 1.14, "rests": True}
    assert unsaid_study.summary([{**line, "numbers": [within]}])["wrong"] == []
