"""What `rig fit` and `rig report` do with analyses that are there already: keep one by hand, read it, make it anew."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from model.gear_file import shipped_gear
from rig.analysis import judging
from rig.analysis.fit import digest as digesting
from rig.analysis.fit.recorded import Fit
from rig.analysis.in_force import InForce, in_force, kept_by_hand
from rig.analysis.store import read_analyses
from rig.main import run as command
from rig.runfile.read import open_run
from tests.rig.handmade import friction_result
from tests.rig.library.stored import RUNNING, analyse, estimate, write


def analysed(run: Path, torque: float) -> None:
    analyse(run, estimate(RUNNING, torque))


def called(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, dict[str, Any]]:
    """The exit code of a command, and its object."""
    with pytest.raises(SystemExit) as end:
        command([*map(str, words), "--json"])
    return int(str(end.value.code or 0)), json.loads(capsys.readouterr().out)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A friction run with two analyses."""
    run = write(tmp_path, 2)
    analysed(run, 0.08)
    analysed(run, 0.09)
    return run


def test_an_analysis_is_kept_by_name_and_the_choice_taken_back(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, told = called(capsys, "fit", run, "--keep", 1, "--by", "B. Example")
    assert (code, told["in_force"]["number"]) == (0, 1)
    assert told["in_force"]["why"].startswith("kept by B. Example")
    assert in_force(run).number == 1
    code, told = called(capsys, "fit", run, "--keep", 0, "--by", "B. Example")
    assert (code, told["in_force"]["number"]) == (0, 2)


def test_a_list_reads_the_analyses_of_a_run_once_for_verdict_and_analysis(
    run: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    looked: list[str] = []

    def look(path: Path, kind: str) -> InForce:
        looked.append(path.name)
        return in_force(path, kind)

    monkeypatch.setattr(judging, "in_force", look)
    [told] = called(capsys, "runs", run.parent)[1]["runs"]
    assert looked == [run.name]
    assert (told["verdict"], told["analysis"]["number"]) == ("NOT JUDGED", 2)


def test_nobody_keeps_an_analysis_without_a_name(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, told = called(capsys, "fit", run, "--keep", 1)
    assert code == 2
    assert told["error"]["where"] == "--by"
    assert kept_by_hand(run) == ()
    assert called(capsys, "fit", run, run, "--keep", 1, "--by", "B. Example")[0] == 2


def test_a_report_reads_what_is_in_force_and_refits_only_when_it_is_told_to(
    run: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fit_run(path: Path, kind: str = "", choices: object = None) -> Fit:
        result = friction_result(0.07)
        return Fit(recording=open_run(path), gear=shipped_gear(), result=result, path=path)

    monkeypatch.setattr(digesting, "fit_run", fit_run)
    page = run.parent / "page.html"
    assert called(capsys, "report", run, "--output", page)[0] == 0
    assert len(read_analyses(run)) == 2
    assert called(capsys, "report", run, "--refit", "--output", page)[0] == 0
    assert len(read_analyses(run)) == 3


def test_a_report_per_run_goes_into_a_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = [write(tmp_path, number) for number in (1, 2)]
    for one in runs:
        analysed(one, 0.08)
    folder = tmp_path / "pages"
    assert called(capsys, "report", *runs, "--per-run", "--output", folder)[0] == 0
    assert sorted(p.name for p in folder.iterdir()) == [f"{run.stem}.html" for run in runs]
    as_file = ("report", *runs, "--per-run", "--output", tmp_path / "page.html")
    code, told = called(capsys, *as_file)
    assert code == 2
    assert "with --per-run it is a folder" in told["error"]["message"]
    code, told = called(capsys, "report", runs[0], runs[0], "--per-run", "--output", folder)
    assert code == 2
    assert "more than one run has this name" in told["error"]["message"]


@pytest.mark.parametrize(("flags", "expected"), [((), 0), (("--require-verdict",), 7)])
def test_what_runs_nothing_ends_by_the_verdict_also_of_a_run_that_was_broken_off(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], flags: tuple[str, ...], expected: int
) -> None:
    run = write(tmp_path, 2, outcome="ABORTED")
    analysed(run, 0.08)
    page = tmp_path / "page.html"
    acceptance = tmp_path / "spec.toml"
    acceptance.write_text(SPECIFICATION, encoding="utf-8")
    words = ("report", run, "--output", page, "--acceptance", acceptance, *flags)
    code, told = called(capsys, *words)
    assert code == expected
    assert (told["verdict"], told["runs"][0]["outcome"]) == ("NOT JUDGED", "ABORTED")
    assert "the run ended as ABORTED" in told["because"][0]


SPECIFICATION = """
format = "acceptance-1"
name = "specification"
source = "specification 12"
use = "any"

[[limits]]
quantity = "friction.running_torque_1000_rpm"
upper = 0.1
unit = "N m"
source = "specification 12"
standing = "customer"
confirmed_by = "A. Example"
confirmed_on = "2026-11-01"
"""
