"""One run never has two verdicts: terminal, JSON, pages, and the function that judges agree, over random stores."""

from __future__ import annotations

import json
import random
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from experiments import catalogue
from experiments.protocols.friction.quantities import QUANTITIES
from experiments.result import Result
from model.gear_file import gear_to_mapping, shipped_gear
from rig.analysis.gear_set import GearSource, set_sha256
from rig.analysis.in_force import in_force, keep
from rig.analysis.judging import GearVerdict, judge_run, stored_result
from rig.analysis.store import Basis, append_analysis, read_analyses
from rig.gears.acceptance import acceptance_for
from rig.gears.card import save_card, with_changes
from rig.main import run as command
from rig.runfile.seal import check_seal
from tests.rig.handmade import acceptance, estimate, friction_result, save_acceptance
from tests.rig.library.stored import write

AT = "2026-03-02T10:00:00+00:00"
RUNNING = "running_torque_1000_rpm"
LIMIT = 0.1
SEEDS = (0, 3, 6, 9)
"""A store of each verdict."""
TORQUES = (0.08, 0.0995, 0.13)
"""Below the limit, at it, above it; U is 0.002 N m."""


def told(capsys: pytest.CaptureFixture[str], *words: object) -> dict[str, Any]:
    """What a command prints as JSON; its exit code is the verdict's business."""
    return json.loads(printed(capsys, *words, "--json"))


def printed(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    """What a command prints."""
    with pytest.raises(SystemExit):
        command([*map(str, words)])
    return capsys.readouterr().out


def result(torque: float) -> Result:
    one = estimate(RUNNING, torque, "N m", 0.001)
    return replace(
        friction_result(), estimates={RUNNING: one}, metrics={}, quantities=QUANTITIES, run="2"
    )


def random_store(folder: Path, draw: random.Random) -> Path:
    """A run with some analyses: with or without tare, some stale, in some one kept by hand; a card with limits."""
    tare, run = write(folder, 1, "motor-tare"), write(folder, 2)
    gear, version = shipped_gear(), catalogue.load("friction").version
    number = draw.randint(1, 4)
    for count in range(number):
        named = {"run": tare.stem, "sha256": check_seal(tare).sha256, "file": tare.name}
        basis = Basis(
            check_seal(run).sha256,
            AT,
            gear=gear_to_mapping(gear),
            gear_source=GearSource("run", "A1", set_sha256(gear)).as_json(),
            tare=named if draw.random() < 0.5 else {},
            analysis_version=version - (draw.random() < 0.3),
        )
        found = replace(result(draw.choice(TORQUES)), warnings=(f"the {count}th",))
        append_analysis(run, found, basis)
    if draw.random() < 0.3:
        keep(run, draw.randint(1, number), "B. Example", AT)
    confirmed = "A. Example" if draw.random() < 0.8 else ""
    (limit,) = acceptance(LIMIT, confirmed).limits
    limit = replace(limit, quantity=f"friction.{RUNNING}")
    specification = folder / "spec.toml"
    save_acceptance(replace(acceptance(LIMIT, confirmed), limits=(limit,)), specification)
    facts = {"serial": "A1", "acceptance": str(specification)}
    save_card(folder, with_changes(None, facts, "A. Example", AT))
    return run


def judged(run: Path) -> GearVerdict:
    """What the function that judges says of the analysis in force."""
    stored = stored_result(in_force(run, "friction"), "simulated", "COMPLETED", "A1", path=run)
    return judge_run(stored, acceptance_for(run.parent, "A1"))


@pytest.mark.parametrize("seed", SEEDS)
def test_every_place_gives_the_same_verdict(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], seed: int
) -> None:
    run = random_store(tmp_path, random.Random(seed))
    (tare,) = tmp_path.glob("*motor-tare*.h5")
    expected = judged(run)
    page = tmp_path / "page.html"
    gear = ("--gear", "A1", "--runs", tmp_path, "--output", page)
    listed = told(capsys, "runs", tmp_path)["runs"]
    passport = told(capsys, "report", "--gear", "A1", "--passport", "--runs", tmp_path)
    places = {
        "list": next(one for one in listed if Path(one["file"]) == run),
        "show": told(capsys, "show", run),
        "passport": passport,
        "a run of the passport": next(r for r in passport["runs"] if Path(r["file"]) == run),
        "difference": told(capsys, "diff", tare, run)["verdicts"][1],
        "report": told(capsys, "report", run, "--output", page),
        "report of the gear": told(capsys, "report", *gear),
        "certificate": told(capsys, "certificate", *gear[:-1], tmp_path / "certificate.html"),
    }
    verdicts = {place: one["verdict"] for place, one in places.items()}
    assert verdicts == dict.fromkeys(places, expected.verdict)
    for place, one in places.items():
        assert one["because"] == list(expected.because), place
        assert one["stale"] == list(expected.stale), place
    assert page.read_text(encoding="utf-8").count(expected.verdict)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_terminal_says_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], seed: int
) -> None:
    run = random_store(tmp_path, random.Random(seed))
    (tare,) = tmp_path.glob("*motor-tare*.h5")
    expected = judged(run)
    screens = {
        "list": printed(capsys, "runs", tmp_path),
        "show": printed(capsys, "show", run),
        "passport": printed(capsys, "report", "--gear", "A1", "--passport", "--runs", tmp_path),
        "difference": printed(capsys, "diff", run, tare),
    }
    words = (expected.verdict, *(("rig fit",) if expected.stale else ()))
    for place, screen in screens.items():
        assert all(word in screen for word in words), place
        others = {"PASS", "FAIL", "MARGINAL"} - {expected.verdict}
        assert not [word for word in others if word in screen], place


@pytest.mark.parametrize("seed", range(13))
def test_no_analysis_but_the_one_in_force_has_a_verdict(tmp_path: Path, seed: int) -> None:
    run = random_store(tmp_path, random.Random(seed))
    found, asked = in_force(run, "friction"), acceptance_for(tmp_path, "A1")
    for analysis in read_analyses(run):
        one = judge_run(stored_result(found, "simulated", "COMPLETED", "A1", other=analysis), asked)
        expected = judged(run).verdict if analysis.number == found.number else "NOT JUDGED"
        assert one.verdict == expected


def test_the_stores_of_these_seeds_hold_every_verdict_and_a_stale_analysis(tmp_path: Path) -> None:
    found = []
    for seed in SEEDS:
        folder = tmp_path / str(seed)
        folder.mkdir()
        found.append(judged(random_store(folder, random.Random(seed))))
    assert len({one.verdict for one in found}) == 4
    assert {bool(one.stale) for one in found} == {True, False}
