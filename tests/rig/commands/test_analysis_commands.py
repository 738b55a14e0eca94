"""`rig fit`, `rig validate --against`, `rig report` as people and programs call them."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner
from typer.testing import Result as Called

from experiments import catalogue
from experiments.contract import Evidence, Experiment, NoParameters, no_plan
from experiments.finding import Finding, Severity
from experiments.quantity import bare_quantity
from experiments.recording import Recording
from experiments.result import Result
from model.gear_file import load_gear, save_gear, shipped_gear
from rig.commands import analysis, reporting, validating
from tests.rig import handmade
from tests.rig.analysis.fit.test_fit import TARE_RESULT, take_over

Call = Callable[..., Called]


@pytest.fixture
def results() -> dict[str, Result]:
    """What each run analyses to, by the name of its file."""
    second = replace(handmade.friction_result(), run="R-2")
    return {
        "friction": handmade.friction_result(),
        "again": second,
        "failed": handmade.friction_result(torque=0.16),
        "marginal": handmade.friction_result(torque=0.1498),
        "slow": handmade.kinematic_result(),
        "tare": TARE_RESULT,
    }


@pytest.fixture
def call(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, results: dict[str, Result]) -> Call:
    """Call a command in a folder that holds one (pretended) run file per result."""
    monkeypatch.chdir(tmp_path)
    for name in results:
        Path(f"{name}.h5").write_text("")

    def open_run(path: Path, **_: Any) -> Recording:
        result = results[Path(path).stem]
        return handmade.recording(
            experiment=result.kind, run_id=result.run, gear_mounted=result.kind != "motor-tare"
        )

    def load(name: str) -> Experiment:
        def analyse(recording: Recording, evidence: Evidence) -> Result:
            return next(
                r
                for r in results.values()
                if r.run == recording.metadata.run_id and name in (r.kind, "motion")
            )

        def compare(recording: Recording, gear: Any, evidence: Evidence) -> Result:
            return Result(
                run=recording.metadata.run_id,
                kind=name,
                estimates={},
                metrics={"mse_of_the_set": 3.5},
                quantities=(bare_quantity("mse_of_the_set", "1"),),
                warnings=("scored",),
            )

        has = name == "friction"
        return Experiment(
            name=name,
            title=name,
            summary=name,
            parameters=NoParameters,
            plan=no_plan,
            analyse=analyse,
            compare=compare if has else None,
            identified=take_over if has else None,
            gives_tare=name == "motor-tare",
            takes_tare=has,
        )

    import rig.runfile.read

    monkeypatch.setattr(rig.runfile.read, "open_run", open_run)
    monkeypatch.setattr(catalogue, "load", load)
    # The importer first: one that is loaded while the other is replaced would keep what replaced it.
    for module in ("rig.present.build", "rig.gears.acceptance"):
        monkeypatch.setattr(f"{module}.acceptance_for", lambda *_: handmade.acceptance())
    app = typer.Typer()
    for command in (analysis.fit, validating.validate, reporting.report):
        app.command()(command)

    def run(*words: str) -> Called:
        return CliRunner().invoke(app, list(words))

    return run


def test_json_is_one_object_and_nothing_else(call: Call) -> None:
    called = call("fit", "friction.h5", "--json")
    found = json.loads(called.stdout)
    assert called.exit_code == 0
    assert found["run"] == "R-000042"
    assert found["kind"] == "friction"
    assert {"value", "unit", "low", "high", "identifiable"} <= set(found["parameters"]["F_c"])
    assert found["parameters"]["F_s"]["identifiable"] is False
    assert found["metrics"]["mse"] == 0.431
    assert (found["outcome"], found["verdict"], found["because"]) == ("COMPLETED", "PASS", [])
    assert found["limits"][0]["limit_source"] == "specification 12"
    assert found["warnings"] == ["The bracket drifted by 1.2 % over the sweep."]


def test_several_runs_are_listed_and_pooled(call: Call) -> None:
    found = json.loads(call("fit", "friction.h5", "again.h5", "--json").stdout)
    assert [f["run"] for f in found["fits"]] == ["R-000042", "R-2"]
    assert found["pooled"]["friction.F_c"]["runs"] == 2


@pytest.mark.parametrize(
    ("runs", "code"),
    [
        (["friction"], 0),
        (["failed"], 1),
        (["marginal"], 3),
        (["friction", "marginal"], 3),
        (["marginal", "failed"], 1),
    ],
)
def test_the_exit_code_is_the_worst_verdict(
    call: Call, results: dict[str, Result], runs: list[str], code: int
) -> None:
    for number, name in enumerate(runs):
        results[name] = replace(results[name], run=f"R-{number + 50}")
    assert call("fit", *(f"{name}.h5" for name in runs)).exit_code == code


def test_a_verdict_can_be_required(call: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rig.gears.acceptance.acceptance_for", lambda *_: None)
    assert call("fit", "friction.h5").exit_code == 0
    called = call("fit", "friction.h5", "--require-verdict", "--json")
    assert called.exit_code == 7
    found = json.loads(called.stdout)
    assert found["verdict"] == "NOT JUDGED"
    assert "rig gear set" in found["because"][0]


def test_the_statistical_part_stands_with_all_alone(call: Call) -> None:
    assert "68.5 … 72.1" not in call("fit", "friction.h5").stdout
    assert "68.5 … 72.1" in call("fit", "friction.h5", "--all").stdout


def test_people_get_a_table(call: Call) -> None:
    shown = call("fit", "friction.h5").stdout
    for words in (
        "70.3",
        "± U (95 %)",
        "weakly",
        "does not move",
        "verdict  PASS",
        "warning",
        "SIMULATED",
        "kept as",
    ):
        assert words in shown


def test_people_are_told_what_could_not_be_checked(call: Call, results: dict[str, Result]) -> None:
    missing = Finding("torque zero", Severity.NOT_LOOKED_AT, "no zero was taken")
    good = Finding("gaps", Severity.PASSED)
    results["friction"] = replace(results["friction"], checks=(good, missing))
    shown = call("fit", "friction.h5").stdout
    assert "not checked  torque zero: no zero was taken" in shown
    assert "gaps" not in shown


def test_the_first_word_is_a_kind_if_no_such_file_is_there(call: Call) -> None:
    assert analysis.split_kind(["friction", "a.h5"]) == ("friction", [Path("a.h5")])
    assert analysis.split_kind(["a.h5", "b.h5"]) == ("", [Path("a.h5"), Path("b.h5")])
    Path("friction").write_text("a file of this name")
    assert analysis.split_kind(["friction", "a.h5"]) == ("", [Path("friction"), Path("a.h5")])


@pytest.mark.parametrize("words", [["friction"], ["fricton", "friction.h5"]])
def test_a_wrong_kind_is_a_usage_error_that_lists_the_kinds(call: Call, words: list[str]) -> None:
    called = call("fit", *words)
    assert called.exit_code == 2
    assert "friction" in called.output


def test_a_wrong_setting_is_a_usage_error(call: Call) -> None:
    assert call("fit", "friction.h5", "--set", "orders").exit_code == 2


def test_settings_are_read_as_what_they_are() -> None:
    read = analysis.settings_of(["a=1", "b=1.5", "c=true", "d=torque", "some-orders=1,2,4"])
    assert read == {"a": 1, "b": 1.5, "c": True, "d": "torque", "some_orders": (1, 2, 4)}


def test_identified_values_are_written_as_a_parameter_set(call: Call) -> None:
    shown = call("fit", "friction.h5", "--parameters-out", "found.toml").stdout
    assert "1 identified values written" in shown
    gear = load_gear("found.toml")
    assert gear.mesh_friction.coulomb == 70.31
    assert gear.origins["mesh_friction.coulomb"].provenance == "identified"


def test_a_tare_is_named_in_the_result(call: Call) -> None:
    found = json.loads(call("fit", "friction.h5", "--tare", "tare.h5", "--json").stdout)
    assert found["options"]["tare_run"] == TARE_RESULT.run


def test_a_set_is_compared_with_a_run(call: Call) -> None:
    save_gear(shipped_gear().with_values({"mesh_friction.coulomb": 90.0}), "mine.toml")
    called = call("validate", "friction.h5", "--against", "mine.toml", "--json")
    found = json.loads(called.stdout)
    assert found["comparison"]["mesh_friction.coulomb"]["agrees"] is False
    assert found["metrics"] == {"mse_of_the_set": 3.5}
    assert "scored" in found["warnings"]
    shown = call("validate", "friction.h5", "--against", "mine.toml").stdout
    assert "Coulomb friction F_c" in " ".join(shown.split())
    assert "90" in shown


def test_a_report_subtracts_the_tare_that_is_named(call: Call) -> None:
    runs = ("slow.h5", "friction.h5", "--tare", "tare.h5")
    called = call("report", *runs, "--output", "out/report.html")
    assert called.exit_code == 0, called.output
    page = Path("out/report.html").read_text()
    assert f"run {TARE_RESULT.run}" in page
    assert "SIMULATED" in page
    assert "friction.analysis/0001.json" in page
