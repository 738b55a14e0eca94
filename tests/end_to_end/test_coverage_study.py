"""The study of coverage: its table from rows that are known, what it keeps, what it refuses; and one run of it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from experiments.recording import Segment
from tests.benchmarks import coverage_study, rows_file
from tests.benchmarks.coverage_study import Study, run_seed, settings_of
from tests.benchmarks.coverage_table import pooled, table
from tests.benchmarks.cramer_rao import information_bounds
from tests.benchmarks.rows_file import Line, code_commit, read_rows

STUDY = Study(population="narrow", kinds=("warm-up",), speeds=(), commit="c0ffee")


def number(seed: int, value: float, **others: Any) -> Line:
    """A found number whose truth is 10, with a statistical interval of +-1 and U = 2."""
    line: Line = {
        "what": "number",
        "seed": seed,
        "kind": "friction",
        "quantity": "coulomb",
        "called": "yes",
        "value": value,
        "low": value - 1.0,
        "high": value + 1.0,
        "expanded": 2.0,
        "type_b": 0.0,
        "seen": 10.0,
        "true": 10.0,
        "target": 4.0,
        "is_share": False,
        "is_circular": False,
    }
    return line | others


def run(seed: int, **others: Any) -> Line:
    line: Line = {"what": "run", "seed": seed, "kind": "friction", "outcome": "analysed"}
    return line | {"words": "", "bounds": {"coulomb": 0.1}} | others


def test_runs_of_a_seed_do_not_fall_with_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """A trip is latched in its folder, so that each run has its own; a defect costs its own run."""
    folders: list[Path] = []

    def one_run(seed: int, kind: str, number: int, folder: Path, *others: Any) -> Any:
        folders.append(folder)
        if kind == "home":
            raise ZeroDivisionError("a defect")
        return folder / "run.h5", {"outcome": "analysed", "words": ""}, []

    monkeypatch.setattr(coverage_study, "_one_run", one_run)
    kinds = ("home", "warm-up", "motor-tare")
    lines = run_seed(1, Study(population="narrow", kinds=kinds, speeds=(), commit="c0ffee"))
    assert [line["outcome"] for line in lines] == ["crashed", "analysed", "analysed"]
    assert "a defect" in lines[0]["words"]
    assert len(set(folders)) == 3
    assert table(lines) == []


def test_the_table_counts_what_the_intervals_hold() -> None:
    # Two of the four miss by more than the interval, one of them by more than U.
    values = (10.5, 9.5, 11.5, 13.0)
    (row,) = table([number(k, v) for k, v in enumerate(values)])
    assert (row["seeds"], row["called_yes"]) == (4, 4)
    assert (row["covered_statistical"], row["covered_expanded"]) == (0.5, 0.75)
    errors = np.array(values) - 10.0
    assert row["width_ratio"] == pytest.approx(2.0 / (3.92 * errors.std(ddof=1)), abs=1e-3)
    assert row["expanded_ratio"] == pytest.approx(2.0 / np.quantile(np.abs(errors), 0.95), abs=1e-3)
    assert row["bias_over_u"] == pytest.approx(errors.mean() / 2.0, abs=1e-3)


def test_the_two_intervals_are_held_against_their_own_truths() -> None:
    (row,) = table([number(1, 10.0, true=11.5), number(2, 10.0, true=12.5)])
    assert (row["covered_statistical"], row["covered_expanded"]) == (1.0, 0.5)


def test_errors_go_round_the_circle_and_may_be_shares_of_the_truth() -> None:
    (row,) = table([number(1, 3.0, seen=-3.0, true=-3.0, is_circular=True)])
    assert row["covered_statistical"] == 1.0
    # The same relative error on gears that differ tenfold scatters not at all.
    lines = [
        number(k, 1.01 * t, low=0.98 * t, high=1.04 * t, expanded=0.03 * t, seen=t, true=t)
        for k, t in enumerate((1.0, 10.0))
    ]
    (share,) = table([{**line, "is_share": True} for line in lines])
    assert share["bias_over_u"] == pytest.approx(1.0 / 3.0, abs=1e-3)
    assert share["expanded_ratio"] == pytest.approx(3.0, abs=1e-3)


def test_a_bench_is_one_chance_however_many_numbers_it_gives() -> None:
    """Half of the benches miss with all that they have: the interval is that of benches, not of numbers."""
    many = [number(k, 99.0 if k % 2 else 10.0) for k in range(20) for _ in range(50)]
    (row,) = pooled(many).values()
    assert (row["benches"], row["numbers"], row["U"][0]) == (20, 1000, 0.5)
    assert row["U"][1] < 0.35
    assert row["U"][2] > 0.65
    cold = pooled([number(1, 10.0, quantity="coulomb_at_20_degrees"), number(2, 99.0)])
    assert (cold["all"]["U"][0], cold["at 20 degC"]["U"][0]) == (0.5, 1.0)


def test_the_table_names_the_bars_that_a_quantity_misses() -> None:
    scatter = np.random.default_rng(1).standard_normal(200)
    good = [number(k, 10.0 + 0.5 * s, expanded=1.0) for k, s in enumerate(scatter)]
    assert table(good)[0]["misses"] == ""
    wide = [{**n, "low": n["value"] - 3.0, "high": n["value"] + 3.0} for n in good]
    assert table(wide)[0]["misses"] == "A, width"
    assert table([{**n, "expanded": 0.5} for n in good])[0]["misses"] == "U"
    assert table([{**n, "expanded": 3.0} for n in good])[0]["misses"] == "U ratio"


def test_only_what_is_called_identified_is_counted_as_claimed() -> None:
    (row,) = table([number(1, 99.0, called="weakly"), number(2, 10.0)])
    assert (row["seeds"], row["called_yes"], row["covered_expanded"]) == (2, 1, 1.0)
    (none,) = table([number(1, 99.0, called="no")])
    assert none["covered_statistical"] is None


def test_an_answer_is_missed_where_the_information_was_there() -> None:
    lines = [
        *(number(k, 10.0, called=c) for k, c in ((1, "yes"), (2, "weakly"), (3, "no"))),
        number(4, 0.1, called="weakly"),  # "not distinguishable from zero, below 2.1": an answer
        *(run(k) for k in (1, 2, 4)),
        run(3, bounds={"coulomb": 1.5}),  # too little: 1.96 x 1.5 is above half the target
        run(
            5,
            outcome="refused",
            words="saturation: the port was at the end of its range",
            bounds={"coulomb": 0.1},
        ),
        run(6, outcome="refused", words="count lattice: 600 samples per revolution"),
        run(7, outcome="not planned"),
    ]
    (row,) = table(lines)
    assert (row["enough_information"], row["not_answered"]) == (4, 2)


def test_the_jitter_of_the_stamps_is_no_motion_that_tells_a_mode() -> None:
    """A speed that rises slowly tells nothing, however its stamps lie; a jump to it does."""
    stamps = np.arange(600) / 1000.0 + 2e-5 * np.random.default_rng(3).standard_normal(600)
    segment = Segment(index=0, label="step", start=0, stop=600)

    def bounds(angle: np.ndarray) -> dict[str, float]:
        recording: Any = SimpleNamespace(
            signals={"output_angle": SimpleNamespace(quantum=1e-4)},
            metadata=SimpleNamespace(
                ratio=100.0, process={"truth": {"dynamics": {"stiffness_over_inertia": 1e6}}}
            ),
            labelled=lambda label: [segment],
            time=lambda where: stamps,
            si=lambda name, where: angle,
        )
        return information_bounds(recording, "velocity-steps")

    rise = 300.0 * (stamps - np.sin(5.0 * stamps) / 5.0)
    assert bounds(rise) == {}
    assert set(bounds(300.0 * np.maximum(stamps - 0.1, 0.0))) >= {"frequency", "damping_ratio"}


def test_a_seed_draws_for_each_kind_by_itself() -> None:
    first = [next(settings_of(9000, "kinematic-error", STUDY)) for _ in range(2)]
    assert first[0] == first[1]
    assert next(settings_of(9001, "kinematic-error", STUDY)) != first[0]
    drawn = [next(settings_of(seed, "velocity-steps", STUDY)) for seed in range(40)]
    assert {s.rate for s in drawn} == {1000.0, 625.0}
    assert all(60.0 <= s.values["speeds_rpm"][0] <= 3000.0 for s in drawn)
    at = replace(STUDY, speeds=(1800.0,))
    assert next(settings_of(1, "friction", at)).values["highest_rpm"] == 1800.0


def test_a_protocol_as_it_is_planned_has_one_setting_and_rows_of_its_own() -> None:
    whole = replace(STUDY, is_whole=True)
    (setting,) = settings_of(9000, "velocity-steps", whole)
    assert setting.values == {}
    assert whole.key != STUDY.key


def test_rows_are_taken_up_again_by_the_same_study_alone(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    mine = {"what": "run", **STUDY.key, "seed": 1, "kind": "warm-up"}
    other = {**mine, "commit": "another"}
    text = json.dumps(mine)
    path.write_text(f"{text}\n{json.dumps(other)}\n{text[:20]}", encoding="utf-8")
    assert read_rows(path, STUDY.key) == [mine]


def test_a_changed_tree_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    class Done:
        stdout = " M model/gear.py"

    monkeypatch.setattr(rows_file.subprocess, "run", lambda *a, **k: Done())
    with pytest.raises(SystemExit, match="--uncommitted"):
        code_commit(uncommitted=False)
    assert code_commit(uncommitted=True).endswith("+")


def test_a_seed_runs_from_draw_to_bound() -> None:
    lines = run_seed(9000, STUDY)
    (line,) = [one for one in lines if one["what"] == "run"]
    assert (line["outcome"], line["kind"]) == ("analysed", "warm-up")
    assert line["bounds"]["running_torque"] > 0.0
    assert {one["commit"] for one in lines} == {"c0ffee"}
    json.dumps(lines)
