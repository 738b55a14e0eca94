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
from rig.main import app

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
    assert answer.exit_code == 2
    assert "page.txt" in answer.output
