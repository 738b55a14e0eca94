"""Recordings of other rigs from their files to published figures: by `rig import` and `rig fit`, and by Python alike.

Excerpts stand in tests/data; the whole recordings are looked for beside the checkout, or where HARMONIC_RIG_DATA says.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import rig
from rig.main import app

HERE = Path(__file__).parents[1] / "data"
DATA = Path(os.environ.get("HARMONIC_RIG_DATA") or Path(__file__).parents[3] / "shared" / "data")
READERS: dict[str, Callable[..., rig.Run]] = {
    "csv": rig.read_csv,
    "mat": rig.read_mat,
    "json": rig.read_json,
}
WITHIN = 0.08
"""Of the published viscous and Coulomb friction of the Staubli."""


def needs(folder: str) -> pytest.MarkDecorator:
    return pytest.mark.skipif(not (DATA / folder).is_dir(), reason=f"{folder} is not here")


@dataclass(frozen=True)
class Foreign:
    """A recording in files: what stands in which column, and what else an import is told."""

    files: tuple[Path, ...]
    channels: Mapping[str, str]
    options: Mapping[str, Any] = field(default_factory=dict)
    form: str = "csv"

    def by_command(self, runs: Path) -> Path:
        """The run file that `rig import` makes."""
        words = [str(path) for path in self.files]
        for name, text in self.channels.items():
            words += ["-c", f"{name}={text}"]
        for name, value in self.options.items():
            words += [f"--{name.replace('_', '-')}"] + ([] if value is True else [str(value)])
        called("import", self.form, *words, "--runs", str(runs), "--json")
        (made,) = runs.glob("*.h5")
        return made

    def by_python(self) -> rig.Run:
        return READERS[self.form](*self.files, channels=self.channels, **self.options)


def called(*words: str) -> Any:
    """What a command answers under `--json`."""
    answer = CliRunner().invoke(app, list(words))
    assert answer.exit_code == 0, answer.output or repr(answer.exception)
    return json.loads(answer.stdout)


def fitted(
    recording: Foreign, kind: str, runs: Path, **settings: Any
) -> tuple[dict[str, Any], rig.Result]:
    """The numbers that `rig fit --json` prints and the result of `rig.fit`, which are the same."""
    run = recording.by_command(runs)
    words = [word for name, value in settings.items() for word in ("--set", f"{name}={value}")]
    answer = called("fit", kind, str(run), *words, "--no-keep", "--json")
    result = rig.fit(recording.by_python(), kind, **settings)
    printed = answer["parameters"]
    assert set(printed) == set(result)
    for name, one in result.items():
        assert printed[name]["value"] == pytest.approx(one.value, rel=1e-9), name
        assert printed[name]["expanded_uncertainty"] == pytest.approx(one.uncertainty, rel=1e-6)
        assert printed[name]["identifiability"] == one.identifiable, name
    return printed, result


def values(printed: Mapping[str, Any], *names: str) -> list[float]:
    return [printed[name]["value"] for name in names]


def both_ways(recording: Foreign, runs: Path, channel: str) -> tuple[np.ndarray, np.ndarray]:
    """Time [s] and SI values of a channel, which are the same in the run file and in memory."""
    run = recording.by_python()
    with rig.load(recording.by_command(runs)) as written:
        np.testing.assert_array_equal(written[channel], run[channel])
        np.testing.assert_array_equal(written.time, run.time)
    return run.time, run[channel]


def test_the_excerpt_of_a_joint_without_time(tmp_path: Path) -> None:
    """Published: viscous 8.0278 N m s/rad, Coulomb 7.2318 N m."""
    joint = Foreign(
        (HERE / "staubli_tx40" / "joint_1.csv",),
        {"position": "1:rad:0.03125", "torque": "2:N m:32"},
        {"rate": 1000.0, "time_base": "hardware"},
    )
    printed, _ = fitted(joint, "motion", tmp_path)
    assert values(printed, "viscous", "coulomb") == pytest.approx([8.0278, 7.2318], rel=WITHIN)


@needs("staubli_tx40")
@pytest.mark.parametrize(
    ("joint", "ratio", "viscous", "coulomb", "settings"),
    [
        (1, 32, 8.0278, 7.2318, {}),
        (2, 32, 5.5201, 8.2505, {"load": "gravity"}),
        (3, 45, 1.9963, 6.2877, {}),
        (4, -48, 1.1087, 2.5145, {}),
    ],
)
def test_every_joint_of_the_staubli(
    tmp_path: Path,
    joint: int,
    ratio: int,
    viscous: float,
    coulomb: float,
    settings: dict[str, str],
) -> None:
    folder = DATA / "staubli_tx40"
    recording = Foreign(
        (folder / "pos_read_data.csv", folder / "curr_data.csv"),
        {
            "position": f"Joint_{joint}@1:rad:{1 / ratio!r}",
            "torque": f"Joint_{joint}@2:N m:{ratio}",
        },
        {"rate": 5000.0, "time_base": "hardware"},
    )
    printed, _ = fitted(recording, "motion", tmp_path, **settings)
    assert values(printed, "viscous", "coulomb") == pytest.approx([viscous, coulomb], rel=WITHIN)


def test_the_excerpt_of_an_arm_that_stands_still(tmp_path: Path) -> None:
    """0.144 A by a least squares with a dead zone; half of that would be the standstill, taken for friction."""
    arm = Foreign(
        (HERE / "tiago_arm" / "arm_1.csv",),
        {"time": "1:s", "position": "2:rad", "current": "3:A"},
    )
    printed, _ = fitted(arm, "motion", tmp_path)
    assert values(printed, "coulomb") == pytest.approx([0.144], abs=0.008)
    assert values(printed, "viscous") == pytest.approx([2.2], abs=0.06)


def arm(joint: int) -> Foreign:
    """A joint of the TIAGo: position and current lie in two files with the same times."""
    folder, column = DATA / "tiago_arm", joint + 1
    return Foreign(
        (folder / "tiago_position.csv", folder / "tiago_effort.csv"),
        {"time": "1@1:s", "position": f"{column}@1:rad", "current": f"{column}@2:A"},
    )


@needs("tiago_arm")
def test_an_arm_in_two_files(tmp_path: Path) -> None:
    printed, _ = fitted(arm(1), "motion", tmp_path)
    assert values(printed, "coulomb") == pytest.approx([0.144], abs=0.008)


@needs("tiago_arm")
@pytest.mark.parametrize(("joint", "orders"), [(1, []), (2, [200]), (3, [200, 400])])
def test_the_ripple_of_a_joint(tmp_path: Path, joint: int, orders: list[int]) -> None:
    """Two and four periods per turn of the motor behind a gear of 100; nothing stands out on joint 1."""
    printed, _ = fitted(arm(joint), "order-spectrum", tmp_path, highest_order=500)
    found = sorted(float(n.removeprefix("amplitude_")) for n in printed if n.startswith("amp"))
    assert len(found) == len(orders)
    assert found == pytest.approx(orders, abs=2.0)
    for name in (n for n in printed if n.startswith("amplitude_")):
        assert 0.015 < printed[name]["value"] < 0.04


def test_pairs_of_speed_and_force_do_not_collapse(tmp_path: Path) -> None:
    """Coulomb coefficient 0.1475, published interval 0.1408 to 0.1543; a plain fit of all rows gives -0.93."""
    pairs = Foreign(
        (HERE / "stribeck_pairs" / "test_data_1.csv",),
        {"speed": "Velocity:rad/s", "torque": "Friction:N m:0.01"},
        {"protocol": "friction-curve"},
    )
    printed, _ = fitted(pairs, "friction-curve", tmp_path)
    (coulomb,) = values(printed, "coulomb")
    assert 0.140794 < coulomb < 0.154256
    found = values(printed, "static", "stribeck_velocity")
    assert found == pytest.approx([0.25, 0.25], rel=0.08)


@needs("tribometer")
def test_a_tribometer_is_read_as_it_is_and_is_no_sliding_joint(tmp_path: Path) -> None:
    """Friction coefficient while it slides: +0.4643 and -0.4642, with 5 N of normal force."""
    recording = Foreign(
        (DATA / "tribometer" / "test_data_2.txt",),
        {"time": "Time", "position": "Position", "force": "Friction:uN:-1"},
    )
    time, force = both_ways(recording, tmp_path / "read", "force")
    position = recording.by_python()["position"]
    assert len(time) == 28000
    way, speed = position - position[0], np.gradient(position, time)
    cycles = (time > 20.0) & (time < 132.0)
    forward = cycles & (speed > 20e-6) & (way > 170e-6) & (way < 225e-6)
    back = cycles & (speed < -20e-6) & (way > 25e-6) & (way < 80e-6)
    assert force[forward].mean() / 5.0 == pytest.approx(0.4643, abs=0.0034)
    assert force[back].mean() / 5.0 == pytest.approx(-0.4642, abs=0.0032)
    # Its stroke is mostly presliding: no law of sliding friction may be said to hold.
    printed, _ = fitted(recording, "motion", tmp_path / "fit")
    assert {printed[n]["identifiability"] for n in ("inertia", "coulomb")} <= {"no", "weak"}


SCOPE = "tc3_scope_3_4_3145_3"


@needs("twincat_scope")
@pytest.mark.parametrize("name", ["_noOS", "-default", "-DecimalMark_,"])
def test_a_scope_that_counts(tmp_path: Path, name: str) -> None:
    path = DATA / "twincat_scope" / f"{SCOPE}{name}.csv"
    time, value = both_ways(Foreign((path,), {"torque": "var_REAL64:N m"}), tmp_path, "torque")
    np.testing.assert_array_equal(value, np.arange(1000.0))
    np.testing.assert_allclose(time, 1e-3 * np.arange(1000), atol=1e-12)


@needs("twincat_scope")
@pytest.mark.parametrize(
    ("channel", "rows", "step", "first"),
    [("func_OS", 4996, 2e-4, 0.0), ("func_freesample", 201, 5e-3, 997.0)],
)
def test_other_rates_of_a_scope_stay_their_own(
    tmp_path: Path, channel: str, rows: int, step: float, first: float
) -> None:
    path = DATA / "twincat_scope" / f"{SCOPE}-default.csv"
    time, value = both_ways(Foreign((path,), {"voltage": f"{channel}:V"}), tmp_path, "voltage")
    assert (len(value), value[0]) == (rows, first)
    np.testing.assert_allclose(np.diff(time), step, atol=1e-9)


def test_the_excerpt_of_a_scope(tmp_path: Path) -> None:
    path = HERE / "foreign" / "twincat_scope_default.csv"
    _, value = both_ways(Foreign((path,), {"torque": "var_REAL64:N m"}), tmp_path, "torque")
    np.testing.assert_array_equal(value, np.arange(float(len(value))))
    assert len(value) > 50


def test_the_excerpt_of_labview(tmp_path: Path) -> None:
    path = HERE / "foreign" / "labview_short.lvm"
    time, force = both_ways(Foreign((path,), {"force": "2"}), tmp_path, "force")
    assert (len(force), force[0]) == (10, 0.914018)
    np.testing.assert_allclose(np.diff(time), 39.0625e-6, atol=1e-9)


@needs("labview_lvm")
def test_a_long_record_of_labview(tmp_path: Path) -> None:
    """Two blocks under one header, of which it states one."""
    path = DATA / "labview_lvm" / "long_single_header_multi_ch.lvm"
    recording = Foreign((path,), {"acceleration": "m_1", "acceleration_2": "m_2"})
    time, first = both_ways(recording, tmp_path, "acceleration")
    second = recording.by_python()["acceleration_2"]
    assert len(time) == 16384
    assert [first.mean(), second.mean()] == pytest.approx([0.230589, 0.243345], abs=5e-7)
    assert [first.std(), second.std()] == pytest.approx([0.171302, 0.231720], abs=1e-6)


@needs("labview_lvm")
@pytest.mark.parametrize(
    ("name", "column", "rows", "first", "step"),
    [
        ("no_decimal_separator", "2:m/s^2", 4, -0.008807, 0.25e-3),
        ("multi_time_column", "4:m/s^2", 3, 0.532608, 19.53125e-6),
        ("with_empty_fields", "8:m/s^2", 7, -0.011923, 1e-3),
    ],
)
def test_odd_records_of_labview(
    tmp_path: Path, name: str, column: str, rows: int, first: float, step: float
) -> None:
    path = DATA / "labview_lvm" / f"{name}.lvm"
    time, value = both_ways(Foreign((path,), {"acceleration": column}), tmp_path, "acceleration")
    assert (len(value), value[0]) == (rows, first)
    np.testing.assert_allclose(np.diff(time), step, atol=2e-9)


@needs("emps")
def test_the_mass_of_emps(tmp_path: Path) -> None:
    """Published: 95.109 kg, 203.5 N s/m, 20.39 N, -3.165 N; relative error 4.08 %."""
    recording = Foreign(
        (DATA / "emps" / "DATA_EMPS.mat",),
        {"time": "t:s", "position": "qm:m", "force": "vir:V:35.15065188"},
        form="mat",
    )
    printed, result = fitted(recording, "motion", tmp_path)
    found = values(printed, "inertia", "viscous", "coulomb")
    assert found == pytest.approx([95.1089, 203.5034, 20.3935], rel=0.01)
    assert values(printed, "offset") == pytest.approx([-3.1648], abs=0.05)
    assert 3.8 <= result.metrics["relative_error_percent"] <= 4.2


@needs("laas_cogging")
def test_the_cogging_of_a_motor(tmp_path: Path) -> None:
    """Held at place after place both ways: the strongest orders are 72, 18, 12, 144, 24, 36."""
    recording = Foreign(
        (DATA / "laas_cogging" / "stopped_data.txt",),
        {"time": "Time:s", "input_angle": "Position:rad", "current": "Iq:A"},
    )
    printed, _ = fitted(recording, "revolution", tmp_path)
    orders = [int(n.removeprefix("amplitude_")) for n in printed if n.startswith("amplitude_")]
    assert set(orders[:6]) == {72, 18, 12, 144, 24, 36}
    assert abs(printed["friction"]["value"]) == pytest.approx(0.054, abs=0.003)


@needs("servo_pendulum")
def test_a_log_of_a_servo_in_json(tmp_path: Path) -> None:
    recording = Foreign(
        (DATA / "servo_pendulum" / "2026-01-15_10h29m21.json",),
        {"time": "timestamp:s", "position": "position:rad", "speed": "speed:rad/s"},
        form="json",
    )
    time, position = both_ways(recording, tmp_path, "position")
    assert len(time) == 1499
    steps = np.abs(np.diff(position))
    assert steps[steps > 0.0].min() == pytest.approx(1.534e-3, rel=1e-3)


@needs("servo_pendulum")
def test_a_pendulum_that_swings_out(tmp_path: Path) -> None:
    """Free of torque it brakes by its own friction: 0.0250 N m at 2 rad/s, and turns 0.00695 kg m2.

    The effort is the weight of the known mass (0.49 kg at 0.1 m), a column that whoever imports it has to add.
    """
    log = json.loads((DATA / "servo_pendulum" / "2026-01-15_10h29m21.json").read_text())
    rows = [entry for entry in log["entries"] if 2.02 <= entry["timestamp"] <= 4.4]
    time, angle = (np.array([row[name] for row in rows]) for name in ("timestamp", "position"))
    path = tmp_path / "swing.csv"
    table = np.column_stack([time, angle, -0.4807 * np.sin(angle)])
    np.savetxt(path, table, delimiter=",", header="t [s],q [rad],weight [N m]", comments="")
    swing = Foreign((path,), {"time": "t", "position": "q", "torque": "weight"})
    printed, _ = fitted(swing, "motion", tmp_path, cutoff_hz=20.0)
    coulomb, viscous, inertia = values(printed, "coulomb", "viscous", "inertia")
    assert coulomb + 2.0 * viscous == pytest.approx(0.0250, rel=0.15)
    assert inertia == pytest.approx(0.00695, rel=0.1)
