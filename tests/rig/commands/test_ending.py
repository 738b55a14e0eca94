"""How `rig run` ends on a terminal: five values with limit and verdict, the tare, and what to do next."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console
from typer.testing import CliRunner

from experiments.errors import AnalysisError
from experiments.recording import RunMetadata
from experiments.result import Result
from rig import exits
from rig.analysis.fit.digest import Digest
from rig.analysis.in_force import InForce
from rig.analysis.judging import judge_run, not_judged
from rig.analysis.tare import FoundTare
from rig.commands.ending import MOST_LINES, Ending, print_ending
from rig.main import app
from rig.runfile.prevailing import late_words
from tests.rig.handmade import acceptance, estimate, fit, friction_result

RUN = Path("runs/00001-friction-A1.h5")


def many_values() -> Result:
    """A result with eight values that matter; the one that is judged is the last of them."""
    made = friction_result()
    declared = made.quantity("running_torque")
    others = [replace(declared, name=f"torque_{n}", title=f"torque {n}") for n in range(7)]
    values = {q.name: estimate(q.name, 0.05, "N m", 0.001) for q in others}
    running = made.estimates["running_torque"]
    keys = tuple(replace(q, is_key=True) for q in (*others, declared))
    return replace(
        made, quantities=keys, metrics={}, estimates={**values, "running_torque": running}
    )


def ending(limit: float = 0.15) -> Ending:
    why = FoundTare(None, ("there is no tare in runs",))
    made = replace(fit(result=many_values()), path=RUN, found_tare=why)
    return Ending(
        judge_run(made, acceptance(limit)),
        Digest(path=RUN, fit=made, in_force=InForce(kind="friction")),
    )


def printed(what: Ending, *, everything: bool = False) -> list[str]:
    out = Console(file=io.StringIO(), width=100)
    print_ending(out, what, RUN, everything=everything)
    assert isinstance(out.file, io.StringIO)
    return out.file.getvalue().splitlines()


def test_a_number_that_the_data_do_not_bear_is_not_shown_as_one() -> None:
    made = ending()
    assert made.digest is not None
    assert made.digest.fit is not None
    result = made.digest.fit.result
    unborne = replace(result.estimates["torque_0"], identifiable="no", note="one speed")
    result = replace(result, estimates={**result.estimates, "torque_0": unborne})
    told = replace(made, digest=replace(made.digest, fit=replace(made.digest.fit, result=result)))
    lines = [line.strip() for line in printed(told)]
    assert "torque 0: not identifiable, one speed" in lines
    shown = told.as_json()
    assert "torque 0" not in shown["values"]
    assert shown["quantities"]["torque_0"]["identifiability"] == "no"
    assert shown["quantities"]["torque_0"]["note"] == "one speed"
    assert shown["quantities"]["torque_1"]["value"] == 0.05
    assert shown["values"]["torque 1"]["value"] == 0.05


def test_five_values_are_told_what_is_judged_first() -> None:
    lines = printed(ending())
    values = [line for line in lines if "±" in line]
    assert len(values) == MOST_LINES == 5
    assert "running torque" in values[0]
    assert values[0].rstrip().endswith("limit ≤ 150 mN m  PASS")
    assert any("3 more" in line for line in lines)
    assert printed(ending(0.08))[0].rstrip().endswith("FAIL")


def test_the_tare_that_is_missing_and_the_next_step_are_told() -> None:
    lines = printed(ending())
    assert any(line.startswith("  tare  there is no tare in runs") for line in lines)
    assert f"  next  rig run motor-tare, then rig fit {RUN}" in lines
    assert "  next  rig report --gear SN-0815 --runs runs" in lines


def test_all_tells_every_value_and_the_statistical_part() -> None:
    text = "\n".join(printed(ending(), everything=True))
    assert all(f"torque {n}" in text for n in range(7))
    assert "statistical part" in text
    assert "statistical part" not in "\n".join(printed(ending()))


def test_an_analysis_that_crashed_is_told_and_what_to_do() -> None:
    crashed = Ending(not_judged("the analysis failed: x"), crash="ValueError: x")
    assert printed(crashed) == [
        "The analysis failed: ValueError: x",
        f"The run is sealed; analyse it anew with: rig fit {RUN}",
    ]
    assert crashed.as_json()["analysis_error"] == "ValueError: x"


def test_a_refused_analysis_ends_the_command_as_a_fit_of_it_would(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rig.analysis.fit import run as fit_run

    def refuse(*given: object) -> None:
        raise AnalysisError("does not bear it", where="home")

    # `digest` takes the name when it is imported: a run that was not analysed before takes it from there.
    from rig.analysis.fit import digest as digesting

    monkeypatch.setattr(fit_run, "fit_run", refuse)
    monkeypatch.setattr(digesting, "fit_run", refuse)
    words = ["run", "home", "--runs", str(tmp_path), "--json"]
    answer = CliRunner().invoke(app, words)
    assert answer.exit_code == exits.ERROR
    told = json.loads(answer.stdout)
    assert told["outcome"] == "COMPLETED"
    assert told["verdict"] == "NOT JUDGED"
    assert "does not bear it" in told["analysis_refused"]
    (path,) = tmp_path.glob("*home*.h5")
    assert CliRunner().invoke(app, ["fit", str(path)]).exit_code != 0


def test_a_computer_that_came_late_and_stamps_the_rows_is_blamed() -> None:
    metadata = RunMetadata(
        run_id="1",
        experiment="motor-tare",
        origin="simulated",
        time_base="host",
        process={"acquisition": {"overruns": 6.0}},
    )
    assert "late by more than half a cycle 6 times" in late_words(metadata)
    assert late_words(replace(metadata, time_base="hardware")) == ""
    assert late_words(replace(metadata, process={"acquisition": {"overruns": 0.0}})) == ""
    assert late_words(replace(metadata, process={})) == ""
