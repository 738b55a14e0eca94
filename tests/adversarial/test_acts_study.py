"""The study of acts: what is listed, one act from the run to its row, and what counts as missed."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from model.identify.estimate import BudgetLine, Estimate
from tests.adversarial.acts import Honest
from tests.benchmarks import acts_study
from tests.benchmarks.acts_list import REFUSED_BY_0_2_0, SEEN, UNSEEN
from tests.benchmarks.rows_file import Line


class InThisProcess:
    """A pool of no processes."""

    def __init__(self, _: int) -> None: ...

    def __enter__(self) -> InThisProcess:
        return self

    def __exit__(self, *_: object) -> None: ...

    def map(self, call: Callable[[Any], Any], jobs: Iterable[Any]) -> Iterator[Any]:
        return map(call, jobs)


def test_the_acts_are_a_hundred_and_twenty_and_each_has_a_name_of_its_own() -> None:
    names = [one.name for one in (*SEEN, *UNSEEN)]
    assert len(SEEN) == 120
    assert len(set(names)) == len(names)
    assert all(one.unseen for one in UNSEEN)
    assert not any(one.unseen for one in SEEN)
    assert set(names) >= REFUSED_BY_0_2_0


def test_one_act_from_honest_run_to_row(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    honest: Callable[[str], Honest],
) -> None:
    class Rig:
        def __init__(self, *_: Any) -> None:
            self.honest = honest

    monkeypatch.setattr(acts_study, "Rig", Rig)
    monkeypatch.setattr(acts_study, "ProcessPoolExecutor", InThisProcess)
    rows = tmp_path / "rows.jsonl"
    words = [
        "--seeds",
        "100",
        "--only",
        "starting-torque: reversed",
        "--rows",
        str(rows),
        "--uncommitted",
    ]
    assert acts_study.main(words) == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["cases"], answer["seen"]) == (1, {"refused": 1})
    (line,) = map(json.loads, rows.read_text(encoding="utf-8").splitlines())
    assert "sign of the torque" in line["words"]

    def none(*_: Any) -> Iterator[Line]:
        raise AssertionError("a case that stands in the file is run again")

    monkeypatch.setattr(acts_study, "cases_of", none)
    assert acts_study.main(words) == 0


def test_an_act_is_missed_where_both_are_sure_and_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    def number(value: float, called: Any = "yes") -> Estimate:
        lines = (BudgetLine("scatter", "B", 0.5),)
        one = Estimate(name="running_torque", value=value, unit="N m", low=0.0, high=1.0)
        return replace(one, identifiable=called, budget=lines)

    class Result:
        def __init__(self, one: Estimate) -> None:
            self.estimates = {one.name: one}

        def quantity(self, name: str) -> Any:
            return acts_study.catalogue.load("warm-up").quantities[0]

    def apart(twin: Estimate, broken: Estimate) -> list[bool]:
        found = acts_study.compared(Result(twin), Result(broken))  # type: ignore[arg-type]
        return [n["is_missed"] for n in found]

    assert apart(number(10.0), number(10.9)) == [False]
    assert apart(number(10.0), number(11.1)) == [True]
    assert apart(number(10.0), number(11.1, "weakly")) == []
