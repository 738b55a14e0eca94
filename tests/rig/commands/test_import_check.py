"""`rig import --check`: writes nothing and shows what each channel is, what it is good for and what hinders it."""

from pathlib import Path

import numpy as np
import pytest

from rig.runfile.read import close_recording, open_run
from tests.rig.commands.calling import Rig

RATE = 200.0


@pytest.fixture
def rig(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Rig:
    monkeypatch.setenv("COLUMNS", "160")
    return Rig(capsys)


def staircase(folder: Path) -> Path:
    """Rest, a turn at 4 rad/s, rest, back; the measured speed is 60 ms late, the output goes against it."""
    speed = np.concatenate([np.zeros(400), np.full(600, 4.0), np.zeros(400), np.full(600, -4.0)])
    time = np.arange(len(speed)) / RATE
    angle = np.cumsum(speed) / RATE
    late = np.concatenate([np.zeros(12), speed[:-12]])
    path = folder / "joint.csv"
    columns = np.column_stack([time, angle, late, -angle / 50.0, 0.1 * np.sign(speed)])
    np.savetxt(
        path, columns, delimiter=",", comments="", header="t [s],q [rad],v [rad/s],out [rad],M"
    )
    return path


CHANNELS = ("-c", "time=t", "-c", "input_angle=q", "-c", "input_speed=v", "-c", "output_angle=out")


def test_a_first_look_lists_the_columns(rig: Rig, tmp_path: Path) -> None:
    path = staircase(tmp_path)
    found = rig.json("import", "csv", path, "--check")
    assert [c["heading"] for c in found["columns"]] == [
        "t [s]",
        "q [rad]",
        "v [rad/s]",
        "out [rad]",
        "M",
    ]
    assert [c["unit"] for c in found["columns"]] == ["s", "rad", "rad/s", "rad", ""]
    assert rig("import", "csv", path, "--check") == 0
    assert "Nothing is mapped yet" in rig.out


def test_what_each_channel_is(rig: Rig, tmp_path: Path) -> None:
    path = staircase(tmp_path)
    words = (
        "import",
        "csv",
        path,
        "--check",
        *CHANNELS,
        "-c",
        "torque=M:mN m",
        "--runs",
        tmp_path / "runs",
    )
    found = rig.json(*words)
    assert not (tmp_path / "runs").exists()
    assert (found["rows"], found["gaps"]) == (2000, 0)
    assert found["rate_hz"] == pytest.approx(RATE)
    channels = {channel["name"]: channel for channel in found["channels"]}
    angle, speed, torque = (channels[n] for n in ("input_angle", "input_speed", "torque"))
    assert (angle["unit"], angle["factor"], angle["column"]) == ("rad", 1.0, "q")
    assert angle["high"] == pytest.approx(12.0)
    assert angle["step"] == pytest.approx(0.02)
    assert angle["standstill"] == pytest.approx(0.4, abs=0.02)
    assert (torque["unit"], torque["factor"]) == ("N m", 1e-3)
    assert speed["standstill"] == pytest.approx(0.4, abs=0.02)
    assert speed["lag_s"] == pytest.approx(0.06, abs=0.003)
    assert speed["lag_against"] == "input_angle"
    assert found["output_per_input"] == pytest.approx(-1.0 / 50.0)
    assert rig(*words) == 0
    assert "0.06" in rig.out
    assert "against the input angle, 1 in 50" in rig.out


def test_what_it_is_good_for_and_why_not(rig: Rig, tmp_path: Path) -> None:
    path = staircase(tmp_path)
    words = ("import", "csv", path, "--check", *CHANNELS, "-c", "torque=M:mN m")
    good = rig.json(*words)["good_for"]
    assert good["motion"] == {"ok": True, "why": ""}
    assert good["kinematic-error"]["why"] == "no ratio (--ratio)"
    good = rig.json(*words, "--ratio", "50")["good_for"]
    assert "--output-sense" in good["kinematic-error"]["why"]
    good = rig.json(*words, "--ratio", "50", "--output-sense", "-1")["good_for"]
    assert good["kinematic-error"]["ok"]
    assert good["velocity-steps"]["why"] == "no segment labelled step"
    assert "gear was not taken off" in good["motor-tare"]["why"]


def test_labels_that_the_motion_suggests_can_be_taken_over(rig: Rig, tmp_path: Path) -> None:
    path = staircase(tmp_path)
    found = rig.json("import", "csv", path, "--check", *CHANNELS)
    forward, reverse = found["segments"]
    assert (forward["label"], forward["direction"], reverse["direction"]) == ("step", 1, -1)
    assert forward["start"] == pytest.approx(2.0, abs=0.06)
    assert forward["stop"] == pytest.approx(5.0, abs=0.06)
    assert forward["setpoint"] == pytest.approx(4.0)
    assert rig("import", "csv", path, "--check", *CHANNELS) == 0
    lines = rig.out[rig.out.index("[[segments]]") :]
    map_file = tmp_path / "map.toml"
    map_file.write_text('[channels.input_speed]\ncolumn = "v"\n' + lines)
    made = rig.json(
        "import", "csv", path, "--map", map_file, "-c", "time=t", "--runs", tmp_path / "runs"
    )
    shown = rig.json("show", made["run"])
    assert [segment["label"] for segment in shown["segments"]] == ["step", "step"]


def test_what_hinders_the_import_is_told_and_the_rest_is_shown(rig: Rig, tmp_path: Path) -> None:
    path = staircase(tmp_path)
    found = rig.json("import", "csv", path, "--check", *CHANNELS, "-c", "torque=M")
    (problem,) = found["problems"]
    assert "torque, column M: nobody says its unit" in problem
    assert "torque" not in {channel["name"] for channel in found["channels"]}
    assert found["good_for"]["motion"]["why"].startswith("no channel torque or")
    wrapped = tmp_path / "wrapped.csv"
    wrapped.write_text("q [deg]\n" + "".join(f"{7 * k % 360}\n" for k in range(300)))
    found = rig.json("import", "csv", wrapped, "--check", "-c", "input_angle=q", "--rate", "100")
    assert found["channels"][0]["wraps"] == 5
    assert (
        "--modulus" in found["good_for"]["motion"]["why"]
        or "no channel" in found["good_for"]["motion"]["why"]
    )


def test_lag_and_accuracy_go_into_the_run_and_the_map_keeps_what_no_flag_says(
    rig: Rig, tmp_path: Path
) -> None:
    path = staircase(tmp_path)
    path.write_text("made by hand, 2,3,4,5\n" + path.read_text())
    map_file = tmp_path / "map.toml"
    map_file.write_text('recording.skip = 1\n[channels.torque]\ncolumn = "M"\nunit = "mN m"\n')
    flags = ("--lag", "torque=2ms", "--accuracy", "input_angle=5arcsec", "--runs", tmp_path)
    words = ("import", "csv", path, "--map", map_file, "-c", "time=t", "-c", "input_angle=q")
    run = open_run(Path(rig.json(*words, *flags)["run"]))
    try:
        assert run.metadata.process["stated"]["lag_s"] == {"torque": 2e-3}
        accuracy = run.signals["input_angle"].calibration.accuracy
    finally:
        close_recording(run)
    assert accuracy == pytest.approx(np.radians(5.0 / 3600.0))
    assert rig(*words, "--lag", "torque", "--runs", tmp_path) == 2
    assert "write NAME=VALUE" in rig.err
