"""From runs to an identified gear: the covariance of its analysis, where it holds, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import rig
from model.gear_file import save_gear, shipped_gear
from model.units import RPM
from rig.analysis.in_force import in_force
from rig.errors import ConfigurationError, RunFileError
from rig.exchange.identified import identified_gear
from tests.rig.exchange.known import doubted

QUICK = {"points": 6, "measure_time": 0.2, "settle_time": 0.15, "lowest_rpm": 8.0, "seed": 9911}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A gear A1 with a tare and an analysed friction run."""
    folder = tmp_path_factory.mktemp("runs")
    rig.execute("motor-tare", folder=folder, **QUICK)
    run = rig.execute("friction", serial="A1", folder=folder, **QUICK)
    rig.fit(run).store()
    return folder


def test_friction_keeps_the_covariance_of_its_analysis(folder: Path) -> None:
    (path,) = folder.glob("*friction*.h5")
    analysis = in_force(path).analysis
    assert analysis is not None
    result = analysis.whole_result()
    assert result.covariance is not None
    for gear in (identified_gear("A1", folder), identified_gear(path)):
        assert gear.serial == "A1"
        assert gear.mark == "SIMULATED"
        assert [one.kind for one in gear.runs] == ["friction"]
        assert gear.speeds[0] == pytest.approx(8.0 * RPM, rel=0.02)
        assert len(gear.temperatures) == 2
        places = [gear.uncertain.index(f"mesh_friction.{n}") for n in result.covariance.names]
        block = gear.covariance[np.ix_(places, places)]
        whole = result.covariance.whole()
        off = ~np.eye(len(places), dtype=bool)
        np.testing.assert_array_equal(block[off], whole[off])
        assert np.all(np.diag(block) >= np.diag(whole))
        assert np.linalg.eigvalsh(gear.covariance)[0] >= -1e-18
        value = next(p.value for p in gear.parameters if p.name == "mesh_friction.coulomb")
        assert value == result.estimates["coulomb"].value


def test_the_python_call_writes_what_the_command_does(folder: Path, tmp_path: Path) -> None:
    from typer.testing import CliRunner

    from rig.main import app

    by_call = rig.export_model("A1", tmp_path / "a1.json", samples=5, folder=folder)
    command = ["export-model", "A1", "--to", "json", "--runs", str(folder), "--samples", "5"]
    told = CliRunner().invoke(app, [*command, "-o", str(tmp_path / "b.json"), "--check", "--json"])
    assert told.exit_code == 0, told.output
    answer = json.loads(told.stdout)
    assert len(answer["files"]) == 3
    assert by_call.read_text() == (tmp_path / "b.json").read_text()
    assert max(abs(row["relative_error"]) for row in answer["checked"]) < 1e-12
    rows = (tmp_path / "a1.json.samples.csv").read_text()
    assert rows == (tmp_path / "b.json.samples.csv").read_text()
    shown = CliRunner().invoke(
        app,
        [
            "export-model",
            "2",
            "--runs",
            str(folder),
            "--to",
            "urdf",
            "-o",
            str(tmp_path / "j.urdf"),
        ],
    )
    assert shown.exit_code == 0, shown.output
    assert shown.stdout.startswith("SIMULATED  A1 as URDF")
    assert "not held" in shown.stdout
    assert "Example" in (tmp_path / "j.urdf.txt").read_text()


def test_a_set_has_each_number_with_its_own_doubt(tmp_path: Path) -> None:
    save_gear(doubted(), tmp_path / "found.toml")
    gear = identified_gear(tmp_path / "found.toml")
    assert not np.any(gear.covariance - np.diag(np.diag(gear.covariance)))
    assert not gear.runs
    assert not identified_gear("csf-25-120").uncertain


def test_what_was_not_analysed_and_what_is_unknown_are_refused(tmp_path: Path) -> None:
    run = rig.execute("home", serial="A2", folder=tmp_path, seed=9912)
    with pytest.raises(RunFileError, match="nothing was identified"):
        identified_gear("A2", tmp_path)
    with pytest.raises(RunFileError, match="rig fit"):
        identified_gear(str(run.path))
    with pytest.raises(ConfigurationError, match="csf-25-120"):
        identified_gear("A3", tmp_path)
    with pytest.raises(ConfigurationError, match="suffix"):
        rig.export_model(shipped_gear(), tmp_path / "gear.step")
    with pytest.raises(ConfigurationError, match="written"):
        rig.export_model(shipped_gear(), tmp_path / "nowhere" / "gear.json")
