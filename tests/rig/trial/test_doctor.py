"""The command: one JSON object, an exit code that means something, a table that shows what it was told."""

from __future__ import annotations

import json
import os
from importlib import resources
from pathlib import Path

import pytest

from experiments.finding import Finding, Severity
from rig import main
from rig.commands.doctoring import _print
from rig.run.remote import RemoteOperator
from rig.trial.doctor.examine import Examination


def code_of(*words: str) -> int:
    with pytest.raises(SystemExit) as ended:
        main.run(["doctor", *words])
    assert isinstance(ended.value.code, int)
    return ended.value.code


def test_it_prints_one_object_and_its_code_means_something(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = code_of("--no-move", "--json", "--output", str(tmp_path))
    found = json.loads(capsys.readouterr().out)
    assert code == (0 if found["ok"] else 6)
    assert set(found) == {"backend", "ok", "checks"}
    assert all(
        set(check)
        == {"group", "name", "result", "evidence", "limit"}
        | {"what", "severity", "where", "found", "allowed", "remedy", "value", "unit", "follows"}
        for check in found["checks"]
    )


def test_a_program_that_goes_away_stops_it_and_the_last_line_is_its_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    ours, theirs = os.pipe()
    os.close(theirs)
    monkeypatch.setattr(RemoteOperator, "listen_in_background", RemoteOperator.listen)
    with os.fdopen(ours) as ended:
        monkeypatch.setattr("sys.stdin", ended)
        assert code_of("--stdin-control", "--output", str(tmp_path)) == 4
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert report["kind"] == "report"
    turned = [check["result"] for check in report["checks"] if check["group"] == "motion"]
    assert turned
    assert set(turned) == {"skipped"}


def test_a_line_that_failed_is_exit_code_6(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    taken = tmp_path / "runs"
    taken.write_text("a file", encoding="utf-8")
    assert code_of("--no-move", "--output", str(taken)) == 6
    assert "FAILED  computer, disk" in capsys.readouterr().out


@pytest.mark.parametrize(
    "words",
    [
        ["--mounting", "sideways"],
        ["--backend", "mystery"],
        ["--backend", "replay:run.h5"],
        ["--backend", "hardware", "--config", "no-such.toml"],
    ],
)
def test_what_cannot_be_accepted_is_exit_code_2(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert code_of(*words, "--output", str(tmp_path)) == 2
    assert words[-1] in capsys.readouterr().err


def test_motion_on_hardware_is_armed_as_a_run_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "rig.toml"
    config.write_text(
        resources.files("rig.bench.config").joinpath("template.toml").read_text(encoding="utf-8"),
        encoding="utf-8",
    )
    words = [
        "--backend",
        "hardware",
        "--config",
        str(config),
        "--move",
        "--gear",
        "A",
        "--operator",
        "B",
        "--json",
    ]
    assert code_of(*words) == 2
    assert "--confirm" in capsys.readouterr().err


def test_the_table_shows_what_it_was_told_and_every_heading_once(
    capsys: pytest.CaptureFixture[str],
) -> None:
    findings = (
        Finding("disk", Severity.PASSED, "in [/tmp] or [bold]", where="computer"),
        Finding("connection", Severity.BLOCKS, "no [drive] there", "See [drive].", where="rig"),
        Finding("calendar", Severity.NOT_LOOKED_AT, "not today", where="computer"),
    )
    _print(Examination("sim", findings))
    shown = capsys.readouterr().out
    assert "in [/tmp] or [bold]" in shown
    assert "See [drive]." in shown
    assert shown.count("\n computer") + shown.count("\ncomputer") == 1
    assert shown.rstrip().endswith("3 lines, 1 failed, 0 warnings, 1 not looked at")
