"""One flag has one meaning: `--runs` is the folder of runs, `--output` the document that a command writes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from rig.gears.card import save_card, with_changes
from rig.main import app, run

AT = "2026-03-02T10:00:00+00:00"


def commands(group: Any, name: str = "rig") -> Iterator[tuple[str, Any]]:
    """Every command with its name, those of groups too."""
    parts = getattr(group, "commands", None)
    if parts is None:
        yield name, group
        return
    for part, command in parts.items():
        yield from commands(command, f"{name} {part}")


FLEET = ("rig fleet fit", "rig fleet simulate")
"""Whose output is a table of many files, or the folders of a production."""


def test_a_folder_is_runs_and_a_document_is_output_in_every_command() -> None:
    meanings: dict[str, set[str]] = {"--runs": set(), "--output": set()}
    for name, command in commands(get_command(app)):
        for parameter in command.params:
            for flag in meanings.keys() & set(parameter.opts):
                if name not in FLEET:
                    meanings[flag].add(f"{parameter.metavar} in {name}")
    assert {words.split()[0] for words in meanings["--runs"]} == {"DIR"}
    assert {words.split()[0] for words in meanings["--output"]} == {"FILE"}
    assert {"DIR in rig run", "DIR in rig gear set", "DIR in rig demo"} <= meanings["--runs"]


@pytest.mark.parametrize("flag", ["--runs", "--output", "-o", "--folder"])
@pytest.mark.parametrize("joined", [False, True])
def test_scripts_may_go_on_to_use_the_earlier_names(
    tmp_path: Path, flag: str, joined: bool
) -> None:
    save_card(tmp_path, with_changes(None, {"serial": "A1"}, "A. Example", AT))
    words = [f"{flag}={tmp_path}"] if joined else [flag, str(tmp_path)]
    answer = CliRunner().invoke(app, ["gear", "list", "--json", *words])
    assert answer.exit_code == 0, answer.output
    assert "A1" in json.dumps(json.loads(answer.output))


def test_the_help_shows_the_one_name_that_there_is_now() -> None:
    shown = CliRunner().invoke(app, ["run", "--help"]).output
    assert "--runs" in shown
    assert "--output " not in shown


def test_a_command_that_writes_a_document_keeps_its_output(tmp_path: Path) -> None:
    answer = CliRunner().invoke(
        app, ["report", "--gear", "A1", "--runs", str(tmp_path), "--output", "page.txt"]
    )
    assert str(answer.exception) == "page.txt: a report is .html or .pdf"


ADDED = {
    "rig bench check",
    "rig bench learn",
    "rig bench show",
    "rig commission",
    "rig compensate",
    "rig export-model",
    "rig fleet rr",
    "rig next",
}
"""Commands that came after the list was shortened to 35, each under its own name."""


def test_there_are_few_commands_and_each_has_one_name() -> None:
    shown = {name for name, command in commands(get_command(app)) if not command.hidden}
    assert shown >= ADDED
    assert len({name for name in shown - ADDED if not name.startswith("rig motor")}) <= 35


@pytest.mark.parametrize(
    ("words", "now", "code"),
    [
        (("drill", "--list"), "rig sim drill", 0),
        (("motor", "check", "sgmjv-02"), "rig config check FILE", 0),
        (("passport", "A1"), "rig report --gear SERIAL --passport", 6),
        (("compare", "1.h5", "--parameters", "a.toml"), "rig validate RUN --against FILE", 2),
    ],
)
def test_a_command_that_is_typed_otherwise_now_says_so_and_does_what_it_did(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: tuple[str, ...],
    now: str,
    code: int,
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        run(list(words))
    said = capsys.readouterr()
    assert ended.value.code == code
    assert said.err.splitlines()[0].endswith(f"is `{now}` from now on.")
    assert now not in said.out
    assert f"│ {words[0]} " not in CliRunner().invoke(app, ["--help"]).output


def test_a_passport_on_the_terminal_is_of_one_gear(tmp_path: Path) -> None:
    answer = CliRunner().invoke(app, ["report", "--passport", "1.h5"])
    assert answer.exit_code == 2
    assert "--gear" in answer.output


def test_a_parameter_set_is_held_against_one_run() -> None:
    answer = CliRunner().invoke(app, ["validate", "1.h5", "2.h5", "--against", "a.toml"])
    assert answer.exit_code == 2
    assert "one run" in answer.output


def test_a_motor_needs_a_file_of_its_own() -> None:
    answer = CliRunner().invoke(app, ["config", "new", "--motor", "M-1", "--by", "A. Example"])
    assert answer.exit_code == 2
    assert "FILE" in answer.output
