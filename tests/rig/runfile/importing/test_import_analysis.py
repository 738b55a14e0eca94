"""What an imported recording is good for: spectrum, friction, motion; and what is said where something lacks."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.recording import Recording
from model.units import RPM
from rig.exits import explain
from rig.runfile.importing.channel_map import ImportOptions
from rig.runfile.importing.channel_source import parse_channel
from tests.rig.fitting import fit_files
from tests.rig.importing import bring_in, file_of, import_mat, table

DATA = Path(os.environ.get("HARMONIC_RIG_DATA") or Path(__file__).parents[5] / "shared" / "data")


def long_recording(folder: Path, *channels: str, **options: Any) -> Path:
    """Holds at eight speeds both ways, with a friction of 0.2 N m + 0.01 N m s and a ripple of order 2; as text."""
    rate, hold = 400.0, 4.0
    levels = [4.0, 6.0, 9.0, 13.0, 19.0, 27.0, 38.0, 50.0]
    speeds = np.concatenate(
        [np.full(int(rate * hold), s) for level in levels for s in (level, -level)]
    )
    time = np.arange(len(speeds)) / rate
    angle = np.cumsum(speeds) / rate
    noise = 1e-3 * np.random.default_rng(5).standard_normal(len(time))
    torque = 0.2 * np.sign(speeds) + 0.01 * speeds + 0.03 * np.cos(2.0 * angle) + noise
    path = folder / "holds.csv"
    names = "t [s];q [rad];M [N m]"
    np.savetxt(path, np.stack([time, angle, torque], 1), delimiter=";", header=names, comments="")
    return bring_in(path, *channels, **options).path


def test_the_order_spectrum_of_an_import(tmp_path: Path) -> None:
    run = long_recording(tmp_path, "time=t", "input_angle=q", "torque=M")
    (found,) = fit_files([run], "order-spectrum", settings={"channel": "torque"})
    assert found.recording.metadata.origin == "imported"
    assert found.result.estimates


def test_the_friction_of_an_import(tmp_path: Path) -> None:
    run = long_recording(tmp_path, "time=t", "input_angle=q", "torque=M")
    (found,) = fit_files([run], "friction")
    assert found.recording.metadata.origin == "imported"
    (points,) = [table for table in found.result.tables if table.name == "fitted-points"]
    speeds = np.array([row[0] for row in points.rows], dtype=np.float64) * RPM
    frictions = np.array([row[1] for row in points.rows], dtype=np.float64)
    assert len(np.unique(np.round(speeds, 6))) >= 6
    np.testing.assert_allclose(frictions, 0.2 + 0.01 * speeds, atol=1e-3)
    assert any("no segments" in warning for warning in found.result.warnings)


def test_the_motion_of_an_import(tmp_path: Path) -> None:
    """J a + F v + C sgn v = M with J 0.05, F 0.02, C 0.3."""
    rate = 1000.0
    time = np.arange(0, 8, 1 / rate)
    speed = 10.0 * np.sin(3.0 * time) + 4.0 * np.sin(7.3 * time)
    acceleration = 30.0 * np.cos(3.0 * time) + 29.2 * np.cos(7.3 * time)
    angle = -10.0 / 3.0 * np.cos(3.0 * time) - 4.0 / 7.3 * np.cos(7.3 * time)
    torque = 0.05 * acceleration + 0.02 * speed + 0.3 * np.sign(speed)
    path = tmp_path / "motion.csv"
    np.savetxt(path, np.stack([time, angle, torque], 1), delimiter=",")
    made = bring_in(path, "time=1:s", "input_angle=2:rad", "torque=3:N m")
    (found,) = fit_files([made.path], "motion")
    estimates = found.result.estimates
    assert estimates["inertia"].value == pytest.approx(0.05, rel=0.01)
    assert estimates["viscous"].value == pytest.approx(0.02, rel=0.05)
    assert estimates["coulomb"].value == pytest.approx(0.3, rel=0.02)


@pytest.mark.parametrize("kind", ["friction", "motion", "kinematic-error"])
def test_an_analysis_says_what_an_import_lacks(tmp_path: Path, kind: str) -> None:
    made = bring_in(file_of(tmp_path, table()), "time=t", "input_angle=Position")
    lacks = "output_angle" if kind == "kinematic-error" else "torque"
    with pytest.raises(Exception, match=lacks) as caught:
        fit_files([made.path], kind)
    assert explain(caught.value) is not None


@pytest.mark.skipif(not (DATA / "emps").is_dir(), reason="the EMPS recordings are not here")
def test_emps_from_the_file_to_the_mass(tmp_path: Path) -> None:
    """Published for this recording: 95.1089 kg."""
    path = DATA / "emps" / "DATA_EMPS.mat"
    channels = ("time=t:s", "position=qm:m", "force=vir:V:35.15065188")
    made = import_mat(
        path,
        ImportOptions(channels=tuple(map(parse_channel, channels))),
        lambda: tmp_path / "00001-import-emps.h5",
    )
    assert (made.rows, made.dropped) == (24841, 0)
    (found,) = fit_files([made.path], "motion")
    recording: Recording = found.recording
    assert recording.metadata.origin == "imported"
    assert found.result.estimates["inertia"].value == pytest.approx(95.1089, rel=0.002)
