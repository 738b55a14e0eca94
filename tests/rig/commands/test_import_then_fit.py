"""After an import and a fit everybody shows that analysis; no gear is asked for where none is needed."""

from pathlib import Path

import numpy as np
import pytest

from tests.rig.commands.calling import Rig


@pytest.fixture
def rig(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Rig:
    monkeypatch.setenv("COLUMNS", "160")
    monkeypatch.chdir(tmp_path)
    return Rig(capsys)


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """J a + F v + C sgn v = M with J 0.05, F 0.02, C 0.3, over ten seconds at 250 Hz."""
    time = np.arange(2500) / 250.0
    speed = 10.0 * np.sin(3.0 * time) + 4.0 * np.sin(7.3 * time)
    acceleration = 30.0 * np.cos(3.0 * time) + 29.2 * np.cos(7.3 * time)
    angle = -10.0 / 3.0 * np.cos(3.0 * time) - 4.0 / 7.3 * np.cos(7.3 * time)
    torque = 0.05 * acceleration + 0.02 * speed + 0.3 * np.sign(speed)
    path = tmp_path / "joint.csv"
    head = "t [s],q [rad],M [N m]"
    np.savetxt(
        path, np.column_stack([time, angle, torque]), delimiter=",", header=head, comments=""
    )
    return path


CHANNELS = ("-c", "time=t", "-c", "input_angle=q", "-c", "torque=M")


@pytest.mark.parametrize("named", ["at the import", "at the fit"])
def test_the_kind_is_named_once(rig: Rig, recording: Path, named: str) -> None:
    at_import = ("--protocol", "motion") if named == "at the import" else ()
    at_fit = () if at_import else ("motion",)
    run = rig.json("import", "csv", recording, *CHANNELS, *at_import)["run"]
    if not at_import:
        assert rig("report", run, "-o", "report.html") == 6
        assert f"rig fit KIND {run}" in rig.err
    fitted = rig.json("fit", *at_fit, run)
    assert fitted["kind"] == "motion"
    assert not [text for text in fitted["warnings"] if "parameter set" in text]
    (listed,) = rig.json("runs")["runs"]
    assert listed["analysis"]["kind"] == "motion"
    for refit in ((), ("--refit",)):
        assert rig("report", run, "-o", "report.html", *refit) == 0, rig.err
        page = Path("report.html").read_text(encoding="utf-8")
        assert "Coulomb friction" in page
        assert "CSF-25-120" not in page
        assert "IMPORTED" in page


def test_models_are_judged_by_imports_of_the_kind_that_they_were_fitted_as(
    rig: Rig, recording: Path
) -> None:
    runs = [rig.json("import", "csv", recording, *CHANNELS)["run"] for _ in range(2)]
    assert rig("validate", *runs) == 6
    for run in runs:
        rig.json("fit", "motion", run)
    assert rig.json("validate", *runs)["kind"] == "motion"
