"""Ctrl-C outside a motion, raised at named places: exit code 4, one sentence, one object, and nothing left half."""

from __future__ import annotations

import importlib
import json
import random
import sys
from pathlib import Path

import pytest

from rig import __main__ as start
from rig import exits
from tests.rig.test_one_verdict import random_store

SENTENCE = "Stopped by the operator; no rig was moving."
PLACES = {
    "listing": ("rig.library.index", "LibraryIndex.search", "runs FOLDER"),
    "table": ("rig.commands.file_tables", "print_runs", "runs FOLDER"),
    "opening": ("rig.runfile.read", "open_run", "show RUN"),
    "judging": ("rig.analysis.judging", "judge_file", "show RUN"),
    "fit": ("rig.analysis.fit.run", "fit_run", "fit RUN"),
    "validating": ("rig.analysis.validate", "validate_runs", "validate RUN"),
    "report": ("rig.present.build", "report_on_files", "report RUN --output PAGE"),
    "page": ("rig.present.report", "report_page", "report RUN --output PAGE"),
    "certificate": (
        "rig.present.certificate.write",
        "write_certificate",
        "certificate --gear A1 --runs FOLDER --output PAGE",
    ),
    "passport": (
        "rig.analysis.passport.build",
        "passport",
        "report --gear A1 --passport --runs FOLDER",
    ),
    "export": ("rig.runfile.export", "export_csv", "export RUN --output CSV"),
    "verify": ("rig.runfile.verify", "verify_run", "verify RUN"),
    "difference": ("rig.analysis.difference", "difference", "diff RUN RUN"),
    "import": ("rig.runfile.importing.opening", "open_tables", "import csv CSV --check"),
    "model": ("model.summary", "derived_quantities", "model"),
    "plan": ("rig.run.start", "plan_order", "plan home --runs FOLDER"),
    "run": ("rig.run.start", "plan_order", "run home --runs FOLDER"),
    "campaign": ("rig.trial.campaign.walk", "walk", "campaign incoming --gear A1 --runs FOLDER"),
    "doctor": ("rig.run.start", "plan_order", "doctor --runs FOLDER"),
    "config": ("rig.bench.config.load", "inspect_configuration", "config check CSV"),
    "cards": ("rig.gears.card", "card_for", "gear show A1 --runs FOLDER"),
}
"""Module, name in it, and a command that comes by there."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return random_store(tmp_path_factory.mktemp("store"), random.Random(0))


def pressed(*_: object, **__: object) -> None:
    raise KeyboardInterrupt


def ended(words: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["rig", *words])
        with pytest.raises(SystemExit) as end:
            start.run()
    shown = capsys.readouterr()
    return int(str(end.value.code or 0)), shown.out, shown.err


@pytest.mark.parametrize("place", PLACES)
def test_a_command_ends_by_one_sentence_or_one_object(
    place: str,
    run: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    module, name, words = PLACES[place]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.csv").write_text("time [s],position [rad]\n0,1\n1,2\n")
    names = {"FOLDER": str(run.parent), "RUN": str(run), "PAGE": "page.html", "CSV": "a.csv"}
    command = [names.get(word, word) for word in words.split()]
    owner, _, function = name.rpartition(".")
    loaded = importlib.import_module(module)
    monkeypatch.setattr(getattr(loaded, owner) if owner else loaded, function, pressed)
    code, _, said = ended(command, capsys)
    assert (code, said.splitlines()[-1]) == (exits.ABORTED, SENTENCE)
    assert "Traceback" not in said
    if place != "table":
        code, told, _ = ended([*command, "--json"], capsys)
        assert code == exits.ABORTED
        assert json.loads(told)["error"]["message"] == SENTENCE
    assert not list(tmp_path.rglob("*.part*"))
    assert not list(run.parent.rglob("*.part*"))


@pytest.mark.parametrize("is_json", [False, True])
def test_while_it_starts(
    is_json: bool, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(start, "foreign_floor", pressed)
    code, told, said = ended(["runs", *(["--json"] if is_json else [])], capsys)
    assert code == exits.ABORTED
    if is_json:
        error = json.loads(told)["error"]
        assert error == exits.error_object(KeyboardInterrupt(), SENTENCE)["error"]
    else:
        assert said == f"{SENTENCE}\n"
