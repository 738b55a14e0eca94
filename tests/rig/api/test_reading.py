"""Runs from files: those of this program, and recordings of other rigs without a run file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy import io

import rig
from rig.errors import ConfigurationError, RunFileError
from tests.rig.importing import DEGREES, TORQUES, bring_in, file_of, table

CHANNELS = {"time": "t:s", "input_angle": "Position:deg", "torque": "M:N m"}


def test_delimited_text_is_a_run_as_its_import_would_be(tmp_path: Path) -> None:
    path = file_of(tmp_path, table())
    run = rig.read_csv(path, channels=CHANNELS, ratio=120.0, protocol="friction", gear="SN-7")
    assert run["input_angle"] == pytest.approx(np.radians(DEGREES))
    assert run["torque"] == pytest.approx(TORQUES)
    assert (run.metadata.ratio, run.metadata.experiment) == (120.0, "friction")
    assert run.metadata.gear_serial == "SN-7"
    made = bring_in(path, "time=t:s", "input_angle=Position:deg", "torque=M:N m")
    with rig.load(made.path) as imported:
        assert np.array_equal(imported["torque"], run["torque"])
        assert np.array_equal(imported.time, run.time)


def test_nothing_is_left_behind_and_the_run_is_no_file(tmp_path: Path) -> None:
    path = file_of(tmp_path, table())
    run = rig.read_csv(path, channels=CHANNELS)
    assert run.path is None
    assert (run.metadata.sha256, run.metadata.is_sealed) == ("", False)
    assert [one.name for one in tmp_path.iterdir()] == [path.name]


def test_a_map_and_a_channel_of_ones_own(tmp_path: Path) -> None:
    path = file_of(tmp_path, table())
    channel_map = tmp_path / "map.toml"
    channel_map.write_text(
        '[channels.time]\ncolumn = "t"\nunit = "s"\n[channels.torque]\ncolumn = "M"\nscale = 2.0\n'
        '[[segments]]\nlabel = "hold"\nstart = 0.0\nstop = 0.006\n',
        encoding="utf-8",
    )
    run = rig.read_csv(path, channels={"input_angle": "Position:deg"}, map=channel_map)
    assert run["torque"] == pytest.approx(2.0 * TORQUES)
    assert [segment.label for segment in run.segments] == ["hold"]
    assert set(run.channels) == {"input_angle", "torque"}


def test_a_matlab_file(tmp_path: Path) -> None:
    path = tmp_path / "bench.mat"
    io.savemat(path, {"t": np.arange(6) * 0.01, "M": TORQUES})
    run = rig.read_mat(path, channels={"time": "t:s", "torque": "M:N m"})
    assert run["torque"] == pytest.approx(TORQUES)


def test_a_numpy_file(tmp_path: Path) -> None:
    path = tmp_path / "bench.npz"
    np.savez(path, t=np.arange(6) * 0.01, M=TORQUES)
    run = rig.read_npz(path, channels={"time": "t:s", "torque": "M:N m"})
    assert run["torque"] == pytest.approx(TORQUES)


def test_a_list_of_objects(tmp_path: Path) -> None:
    path = tmp_path / "bench.json"
    path.write_text(json.dumps([{"t": 0.01 * k, "M": M} for k, M in enumerate(TORQUES)]))
    run = rig.read_json(path, channels={"time": "t:s", "torque": "M:N m"})
    assert run["torque"] == pytest.approx(TORQUES)


def test_a_pandas_frame(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(
        {"q [deg]": DEGREES, "M": 1e3 * TORQUES, "word": list("abcdef")},
        index=pandas.Index(2.0 * np.arange(6), name="t"),
    )
    run = rig.from_pandas(
        frame,
        {"time": "t", "input_angle": "q", "torque": "M"},
        units={"t": "ms", "M": "mN m"},
        ratio=120.0,
    )
    assert run["input_angle"] == pytest.approx(np.radians(DEGREES))
    assert run["torque"] == pytest.approx(TORQUES)
    assert run.time == pytest.approx(0.002 * np.arange(6))
    with pytest.raises(ConfigurationError, match=r"units: no such column.*'?Q'?"):
        rig.from_pandas(frame, {"torque": "M"}, units={"Q": "deg"})


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
@pytest.mark.parametrize("zone", [None, "UTC", "Europe/Berlin"])
def test_calendar_times_of_a_frame_are_the_same_in_whatever_unit_it_keeps_them(
    unit: str, zone: str | None
) -> None:
    pandas = pytest.importorskip("pandas")
    times = pandas.Series(pandas.to_datetime([f"2025-01-01T00:00:0{k}" for k in range(6)]))
    stamped = times.dt.tz_localize("UTC").dt.as_unit(unit)
    column = times.dt.as_unit(unit) if zone is None else stamped.dt.tz_convert(zone)
    frame = pandas.DataFrame({"t": column, "M": TORQUES})
    run = rig.from_pandas(frame, {"time": "t", "torque": "M"}, units={"t": "s", "M": "N m"})
    assert np.diff(run.time) == pytest.approx(np.ones(5))
    assert run.metadata.start_time == "2025-01-01T00:00:00.000+00:00"


def test_a_calendar_time_that_is_missing_is_refused_and_no_number() -> None:
    pandas = pytest.importorskip("pandas")
    times = pandas.to_datetime(["2025-01-01", None, *["2025-01-02"] * 4])
    frame = pandas.DataFrame({"t": times, "M": TORQUES})
    with pytest.raises(RunFileError, match=r"row 2|line 3"):
        rig.from_pandas(frame, {"time": "t", "torque": "M"}, units={"t": "s", "M": "N m"})


def test_a_map_of_several_runs_is_asked_which(tmp_path: Path) -> None:
    path = file_of(tmp_path, table())
    several = tmp_path / "map.toml"
    several.write_text(
        '[channels.time]\ncolumn = "t"\nunit = "s"\n'
        '[runs.one.channels.torque]\ncolumn = "M"\nunit = "N m"\n'
        '[runs.two.channels.speed]\ncolumn = "M"\nunit = "rad/s"\n',
        encoding="utf-8",
    )
    assert set(rig.read_csv(path, map=several, run="one").channels) == {"torque"}
    with pytest.raises(ConfigurationError, match="the map has several runs, allowed one, two"):
        rig.read_csv(path, map=several)


def test_a_parameter_set_by_name(tmp_path: Path) -> None:
    run = rig.read_csv(file_of(tmp_path, table()), channels=CHANNELS, parameters="csf-25-120")
    assert run.metadata.gear == rig.gear()
    assert run.metadata.ratio == 120.0


def test_errors_are_those_of_the_command_line(tmp_path: Path) -> None:
    path = file_of(tmp_path, table())
    with pytest.raises(ConfigurationError, match="sample_rate_hz: no such option of an import"):
        rig.read_csv(path, channels=CHANNELS, sample_rate_hz=1000.0)
    with pytest.raises(ConfigurationError, match="there is no such column"):
        rig.read_csv(path, channels={"time": "t:s", "torque": "Moment:N m"})
    with pytest.raises(RunFileError):
        rig.load(tmp_path / "nothing.h5")
