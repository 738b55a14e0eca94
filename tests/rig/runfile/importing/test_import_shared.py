"""Published recordings of robots, a tribometer and a servo: several files, no time column, sides, gaps, JSON."""

import os
from pathlib import Path

import numpy as np
import pytest

from rig.runfile.importing.channel_map import ImportOptions, read_channel_map
from rig.runfile.importing.channel_source import parse_channel
from rig.runfile.importing.convert import import_tables
from rig.runfile.importing.looking import look_at
from rig.runfile.importing.opening import open_tables
from rig.runfile.read import open_run

DATA = Path(
    os.environ.get("HARMONIC_RIG_DATA", Path(__file__).parents[4].parent / "shared" / "data")
)


def needs(folder: str) -> pytest.MarkDecorator:
    return pytest.mark.skipif(not (DATA / folder).is_dir(), reason=f"{folder} is not here")


def mapped(*channels: str, **changes: object) -> ImportOptions:
    return ImportOptions(channels=tuple(map(parse_channel, channels)), **changes)  # type: ignore[arg-type]


@needs("staubli_tx40")
def test_a_robot_without_a_column_of_time_and_with_a_negative_ratio(tmp_path: Path) -> None:
    """Joint 4 counts against its motor: angle / -48, torque times -48, at the joint."""
    text = """
        [recording]
        rate = 5000
        time_base = "hardware"
        [gear]
        ratio = -48
        [channels.output_angle]
        column = "Joint_4"
        file = "1"
        unit = "rad"
        side = "input"
        [channels.output_torque]
        column = "Joint_4"
        file = "2"
        unit = "N m"
        side = "input"
    """
    path = tmp_path / "map.toml"
    path.write_text(text)
    folder = DATA / "staubli_tx40"
    paths = [folder / "pos_read_data.csv", folder / "curr_data.csv"]
    (run,) = read_channel_map(path)
    made = import_tables(
        open_tables("csv", paths), run.options({}), lambda: tmp_path / "00001-import-x.h5"
    )
    recording = open_run(made.path)
    assert (recording.rows, recording.metadata.time_base) == (45000, "hardware")
    motor, current = (np.loadtxt(p, delimiter=",", skiprows=1, usecols=3) for p in paths)
    np.testing.assert_allclose(recording.si("output_angle"), motor / -48.0, rtol=1e-12)
    np.testing.assert_allclose(recording.si("output_torque"), current * -48.0, rtol=1e-12)


@needs("tiago_arm")
@pytest.mark.parametrize(("joint", "delay"), [(1, 0.14), (2, 0.19), (3, 0.19), (4, 0.19)])
def test_a_late_speed_in_a_third_file_is_seen(joint: int, delay: float) -> None:
    """The delays are those that its README states, to two digits."""
    paths = [DATA / "tiago_arm" / f"tiago_{name}.csv" for name in ("position", "velocity")]
    column = joint + 1
    options = mapped("time=t:s", f"position={column}@1:rad", f"speed={column}@2:rad/s")
    look = look_at(open_tables("csv", paths), options)
    assert (look.rows, look.problems) == (8022, [])
    speed = look.channel("speed")
    assert speed is not None
    assert speed.lag_s == pytest.approx(delay, abs=0.01)


@needs("tribometer")
def test_single_lost_samples_stay_gaps() -> None:
    options = mapped("time=Time", "position=Position", "force=Friction:uN:-1")
    look = look_at(open_tables("csv", [DATA / "tribometer" / "test_data_2.txt"]), options)
    # 178 steps of 10 ms and one of 9 ms.
    assert (look.rows, look.gaps) == (28000, 179)


@needs("servo_pendulum")
def test_a_servo_log_in_json() -> None:
    path = DATA / "servo_pendulum" / "2026-01-15_10h29m21.json"
    options = mapped("time=timestamp:s", "position=position:rad", "speed=speed:rad/s")
    look = look_at(open_tables("json", [path]), options)
    position = look.channel("position")
    assert position is not None
    assert look.rows == 1499
    assert position.step == pytest.approx(1.534e-3, rel=1e-3)
