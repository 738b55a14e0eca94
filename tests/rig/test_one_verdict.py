"""One run never has two verdicts: list, report, report of the gear, certificate and the function that judges agree."""

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
from rig.analysis.judging import judge_run, stored_result
from rig.analysis.store import Basis, append_analysis
from rig.gears.acceptance import acceptance_for, save_acceptance
from rig.gears.card import save_card, with_changes
from rig.main import run as command
from rig.runfile.seal import check_seal
from tests.rig.handmade import acceptance, estimate, friction_result
from tests.rig.library.stored import write

AT = "2026-03-02T10:00:00+00:00"
RUNNING = "running_torque_1000_rpm"
LIMIT = 0.1
TORQUES = (0.08, 0.0995, 0.13)
"""Below the limit, at it, above it; U is 0.002 N m."""


def told(capsys: pytest.CaptureFixture[str], *words: object) -> dict[str, Any]:
    """What a command prints as JSON; its exit code is the verdict's business."""
    with pytest.raises(SystemExit):
        command([*map(str, words), "--json"])
    return json.loads(capsys.readouterr().out)


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


@pytest.mark.parametrize("seed", range(6))
def test_every_place_gives_the_same_verdict(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], seed: int
) -> None:
    run = random_store(tmp_path, random.Random(seed))
    analysis = in_force(run, "friction").analysis
    assert analysis is not None
    judged = judge_run(
        stored_result(analysis, "simulated", "COMPLETED", "A1"), acceptance_for(tmp_path, "A1")
    )
    page = tmp_path / "page.html"
    listed = told(capsys, "runs", tmp_path)["runs"]
    places = {
        "list": next(one for one in listed if Path(one["file"]) == run),
        "report": told(capsys, "report", run, "--output", page),
        "report of the gear": told(
            capsys, "report", "--gear", "A1", "--runs", tmp_path, "--output", page
        ),
        "certificate": told(
            capsys, "certificate", "--gear", "A1", "--runs", tmp_path, "--output", page
        ),
    }
    verdicts = {place: one["verdict"] for place, one in places.items()}
    assert verdicts == dict.fromkeys(places, judged.verdict)
    assert page.read_text(encoding="utf-8").count(judged.verdict)


def test_the_stores_of_these_seeds_hold_every_verdict(tmp_path: Path) -> None:
    found = set()
    for seed in range(6):
        folder = tmp_path / str(seed)
        folder.mkdir()
        run = random_store(folder, random.Random(seed))
        analysis = in_force(run, "friction").analysis
        assert analysis is not None
        stored = stored_result(analysis, "simulated", "COMPLETED", "A1")
        found.add(judge_run(stored, acceptance_for(folder, "A1")).verdict)
    assert len(found) >= 3
