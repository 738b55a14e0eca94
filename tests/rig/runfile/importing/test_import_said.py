"""What a person has to say of a recording, and may: units, signs, ratio, sides, uncertainties, segments."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rig
from experiments.recording import Recording, Segment
from rig.errors import ConfigurationError, RunFileError
from rig.runfile.importing.channel_map import ImportOptions, read_channel_map
from rig.runfile.importing.convert import Imported, import_tables
from rig.runfile.importing.opening import open_tables
from rig.runfile.read import open_run
from tests.rig.importing import bring_in

BOTH = "t [s],in [rad],out [rad]\n" + "".join(f"{k / 100},{k},{-k / 100}\n" for k in range(30))


def text_file(folder: Path, text: str, name: str = "bench.csv") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def by_map(folder: Path, text: str, map_text: str, **given: Any) -> Imported:
    (run,) = read_channel_map(text_file(folder, map_text, "map.toml"))
    options = run.options(given)
    tables = open_tables("csv", [text_file(folder, text)], options)
    return import_tables(tables, options, lambda: folder / "00001-import-x.h5")


def opened(made: Imported) -> Recording:
    return open_run(made.path)


@pytest.mark.parametrize(
    ("heading", "channel", "line"),
    [
        (
            "M",
            "torque=M",
            r'--channel "torque=M:N m" if it is N m, or in the map \[channels.torque\] unit',
        ),
        ("q", "input_angle=q", r"allowed rad, mrad, urad, deg, .*count"),
        ("M [furlong]", "torque=M", r"nobody says its unit"),
        ("x", "something=x", r'"1" for a plain number.*something=x:UNIT'),
        ("v", "input_speed=v", r"allowed rad/s, mrad/s, deg/s, rev/s, r/min, count"),
        ("u", "torque_uncertainty=u", r"allowed N m, mN m, uN m"),
    ],
)
def test_a_unit_that_nobody_says_is_asked_for_with_the_line_to_add(
    tmp_path: Path, heading: str, channel: str, line: str
) -> None:
    path = text_file(tmp_path, f"t [s],{heading}\n0,1\n1,2\n2,3\n")
    with pytest.raises(ConfigurationError, match=line):
        bring_in(path, "time=t", channel)
    assert not list(tmp_path.glob("*.h5*"))


def test_the_time_is_asked_for_its_unit(tmp_path: Path) -> None:
    path = text_file(tmp_path, "t,M [N m]\n0,1\n1,2\n")
    with pytest.raises(ConfigurationError, match=r"time, column t: nobody says its unit.*time=t:s"):
        bring_in(path, "time=t", "torque=M")


@pytest.mark.parametrize(
    ("unit", "si"),
    [
        ("µN", ("N", 1e-6)),
        ("μN", ("N", 1e-6)),
        ("uN", ("N", 1e-6)),
        ("µrad", ("rad", 1e-6)),
        ("µN m", ("N m", 1e-6)),
        ("µV", ("V", 1e-6)),
        ("kHz", ("Hz", 1e3)),
        ("Newtons", ("N", 1.0)),
    ],
)
def test_micro_units(tmp_path: Path, unit: str, si: tuple[str, float]) -> None:
    made = bring_in(text_file(tmp_path, f"x [{unit}]\n1\n3\n"), "any=x", rate=10.0)
    recording = opened(made)
    assert recording.signals["any"].unit == si[0]
    np.testing.assert_allclose(recording.si("any"), np.array([1.0, 3.0]) * si[1], rtol=1e-15)


def test_two_angles_ask_which_way_the_second_counts(tmp_path: Path) -> None:
    path = text_file(tmp_path, BOTH)
    channels = ("time=t", "input_angle=in", "output_angle=out")
    with pytest.raises(ConfigurationError, match=r"--output-sense.*\+1 with it, -1 against it"):
        bring_in(path, *channels, ratio=100.0)
    recording = opened(bring_in(path, *channels, ratio=100.0, output_sense=-1))
    assert recording.metadata.process["stated"]["output_sense"] is True
    assert recording.output_angle()[5] == pytest.approx(0.05)


def test_one_output_angle_is_never_turned_silently(tmp_path: Path) -> None:
    recording = opened(bring_in(text_file(tmp_path, BOTH), "time=t", "output_angle=out"))
    np.testing.assert_array_equal(recording.output_angle(), recording.si("output_angle"))
    assert recording.metadata.process["stated"]["output_sense"] is False
    assert recording.metadata.process["stated"]["mounting"] is False


def test_columns_of_the_joint_are_brought_over_by_the_ratio(tmp_path: Path) -> None:
    map_text = """
        [channels.input_angle]
        column = "q"
        unit = "deg"
        side = "output"
        [channels.torque]
        column = "M"
        unit = "N m"
        side = "output"
        [recording]
        rate = 100
    """
    text = "q,M\n" + "".join(f"{k},{5 * k}\n" for k in range(5))
    with pytest.raises(
        ConfigurationError, match=r"taken at the output, and the ratio is not known"
    ):
        by_map(tmp_path, text, map_text)
    recording = opened(by_map(tmp_path, text, map_text, ratio=50.0))
    np.testing.assert_allclose(recording.si("input_angle"), np.radians(np.arange(5) * 50.0))
    np.testing.assert_allclose(recording.si("torque"), np.arange(5) * 0.1)


def test_a_negative_ratio_turns_the_joint_side(tmp_path: Path) -> None:
    map_text = """
        [channels.input_angle]
        column = 1
        unit = "rad"
        side = "output"
        [gear]
        ratio = -48
        [recording]
        rate = 10
    """
    recording = opened(by_map(tmp_path, "q\n1\n2\n", map_text))
    assert recording.si("input_angle").tolist() == [-48.0, -96.0]
    assert recording.metadata.ratio == 48.0


def test_rows_of_a_hardware_clock_are_believed_where_that_is_said(tmp_path: Path) -> None:
    path = text_file(tmp_path, "M\n1\n2\n3\n")
    said = opened(bring_in(path, "torque=M:N m", rate=5000.0, time_base="hardware"))
    assert (said.metadata.time_base, said.metadata.sample_rate) == ("hardware", 5000.0)
    (tmp_path / "00001-import-x.h5").unlink()
    assert opened(bring_in(path, "torque=M:N m", rate=5000.0)).metadata.time_base == "nominal"


@pytest.mark.parametrize(
    ("unit", "cells"),
    [
        ("count:1e-7", ["132959733843760000", "132959733843770000", "132959733843785000"]),
        ("filetime", ["132959733843760000", "132959733843770000", "132959733843785000"]),
        (
            "iso",
            [
                "2022-05-02T13:56:24.3760000Z",
                "2022-05-02T13:56:24.3770000Z",
                "2022-05-02 13:56:24.3785",
            ],
        ),
    ],
)
def test_times_as_ticks_and_as_texts(tmp_path: Path, unit: str, cells: list[str]) -> None:
    text = "t;M\n" + "".join(f"{cell};{k}\n" for k, cell in enumerate(cells))
    path = text_file(tmp_path, text)
    if unit.startswith("count"):
        # Ticks since 1601 are no time since anything that a plain number could mean.
        with pytest.raises(RunFileError, match=r"beyond any calendar"):
            bring_in(path, f"time=t:{unit}", "torque=M:N m")
        return
    recording = opened(bring_in(path, f"time=t:{unit}", "torque=M:N m"))
    np.testing.assert_allclose(recording.time(), [0.0, 1e-3, 2.5e-3], atol=1e-12)
    assert recording.metadata.start_time == "2022-05-02T13:56:24.376+00:00"


def test_ticks_that_start_again(tmp_path: Path) -> None:
    ticks = [(65500 + 10 * k) % 65536 for k in range(20)]
    text = "n,M\n" + "".join(f"{tick},1\n" for tick in ticks)
    map_text = (
        '[channels.time]\ncolumn = "n"\nunit = "count"\nscale = 1e-3\nmodulus = 65536\n'
        '[channels.torque]\ncolumn = "M"\nunit = "N m"\n'
    )
    np.testing.assert_allclose(
        opened(by_map(tmp_path, text, map_text)).time(), np.arange(20) * 0.01
    )


@pytest.mark.parametrize("cell", ["yesterday", "2022-13-01T00:00:00", "17"])
def test_a_text_that_is_no_time_is_named(tmp_path: Path, cell: str) -> None:
    path = text_file(tmp_path, f"t;M\n2022-05-02T13:56:24;1\n{cell};2\n")
    with pytest.raises(RunFileError, match=r"line 3, column t: not a date and time in ISO 8601"):
        bring_in(path, "time=t:iso", "torque=M:N m")


def test_what_an_import_states_of_the_device(tmp_path: Path) -> None:
    map_text = """
        [channels.time]
        column = "t"
        [channels.input_angle]
        column = "in"
        accuracy = 1e-4
        lag_s = 0.002
        certificate = "K-17"
        [channels.torque]
        column = "out"
        unit = "N m"
        sensor = "torque cell"
        scale_uncertainty = 0.01
        offset_uncertainty = 0.003
        [gear]
        serial = "J1"
        mounted = false
        resonance_hz = 110
        load_inertia_kg_m2 = 0.3
        [conditions]
        lubricant = "grease"
        ambient_temperature = 21.5
        [recording]
        protocol = "motion"
        operator = "Ada"
    """
    made = by_map(tmp_path, BOTH.replace("out [rad]", "out"), map_text)
    recording = opened(made)
    m = recording.metadata
    angle, torque = (recording.signals[n].calibration for n in ("input_angle", "torque"))
    assert (angle.accuracy, angle.certificate) == (1e-4, "K-17")
    assert (torque.scale_relative_uncertainty, torque.offset_uncertainty) == (0.01, 0.003)
    assert torque.sensor == "torque cell"
    stated = m.process["stated"]
    assert stated["lag_s"] == {"input_angle": 0.002}
    assert (stated["resonance_hz"], stated["load_inertia_kg_m2"]) == (110, 0.3)
    assert (m.gear_mounted, m.gear_serial, m.experiment) == (False, "J1", "motion")
    assert m.conditions == {"lubricant": "grease", "ambient_temperature": 21.5}
    assert not any("torque scale: assumed" in note for note in made.notes)


def test_what_nobody_said_is_said_to_be_missing(tmp_path: Path) -> None:
    path = text_file(tmp_path, BOTH.replace("out [rad]", "out"))
    made = bring_in(path, "time=t", "input_angle=in", "torque=out:N m")
    (note,) = [note for note in made.notes if note.startswith("not said:")]
    lines = note.splitlines()[1:]
    for word in ("motor encoder: assumed", "torque scale", "torque zero", "temperature", "lag"):
        (line,) = [line for line in lines if line.startswith(word)]
        assert "Give it: " in line


PHASES = "t [s],q [rad],phase,v [rad/s]\n" + "".join(
    f"{k / 10},{q},{phase},{v}\n"
    for k, (q, phase, v) in enumerate(
        [(0, "rest", 0)] * 3
        + [(k, "run", 10) for k in range(8)]
        + [(7, "rest", 0)] * 2
        + [(7 - 2 * k, "run", -20) for k in range(9)]
    )
)
CHANNELS = '[channels.time]\ncolumn = "t"\n[channels.input_angle]\ncolumn = "q"\n'


def test_segments_from_a_column_of_words(tmp_path: Path) -> None:
    map_text = (
        CHANNELS + '[segments_from]\ncolumn = "phase"\n[segments_from.labels]\nrun = "traverse"\n'
    )
    first, second = opened(by_map(tmp_path, PHASES, map_text)).segments
    assert (first.label, first.start, first.stop, first.direction) == ("traverse", 3, 11, 1)
    assert (second.start, second.stop, second.direction) == (13, 22, -1)
    assert first.setpoint == pytest.approx(10.0)
    assert second.setpoint == pytest.approx(-20.0)


def test_segments_from_set_points(tmp_path: Path) -> None:
    map_text = (
        CHANNELS
        + '[channels.target_speed]\ncolumn = "v"\n'
        + '[segments_from]\nsetpoint = "target_speed"\nleast_s = 0.5\nlabel = "hold"\n'
    )
    recording = opened(by_map(tmp_path, PHASES, map_text))
    assert recording.segments == (
        Segment(index=0, label="hold", start=3, stop=11, setpoint=10.0, direction=1, repeat=0),
        Segment(index=1, label="hold", start=13, stop=22, setpoint=-20.0, direction=-1, repeat=0),
    )


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (
            'column = "phase"\n[segments_from.labels]\nturn = "traverse"',
            r"nothing in the recording is labelled; value rest, run",
        ),
        ('setpoint = "input_angle2"', r"there is no such channel"),
        ('column = "phase"\nsetpoint = "v"', r"needs one of column and setpoint"),
        ('column = "none"', r"no such column"),
    ],
)
def test_segments_that_cannot_be_found(tmp_path: Path, lines: str, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        by_map(tmp_path, PHASES, f"{CHANNELS}[segments_from]\n{lines}\n")


def test_a_table_with_both_directions_in_one_row(tmp_path: Path) -> None:
    map_text = """
        [channels.speed]
        column = "n"
        unit = "r/min"
        [channels.torque]
        column = "Mf"
        unit = "mN m"
        [reverse.speed]
        column = "n"
        unit = "r/min"
        scale = -1
        [reverse.torque]
        column = "Mr"
        unit = "N m"
        scale = -1
        [recording]
        no_time = true
        protocol = "friction-curve"
    """
    recording = opened(by_map(tmp_path, "n;Mf;Mr\n60;10;0,011\n120;20;0,021\n", map_text))
    np.testing.assert_allclose(recording.si("speed") / (2 * np.pi), [1, 2, -1, -2])
    np.testing.assert_allclose(recording.si("torque"), [0.010, 0.020, -0.011, -0.021])
    assert recording.metadata.time_base == "none"
    with pytest.raises(ConfigurationError, match=r"does not have the channels of the forward half"):
        by_map(
            tmp_path,
            "n;Mf;Mr\n60;10;11\n",
            map_text.replace("[reverse.speed]", "[reverse.nothing]"),
        )


def test_a_wrapped_angle_is_noticed_and_unwrapped_when_asked(tmp_path: Path) -> None:
    true = np.arange(0.0, 1500.0, 7.0)
    text = "q [deg]\n" + "".join(f"{(x + 180) % 360 - 180}\n" for x in true)
    path = text_file(tmp_path, text)
    with pytest.raises(
        RunFileError, match=r"line 28, .*wrapped; value 353 .*--modulus output_angle=360"
    ):
        bring_in(path, "output_angle=q", rate=100.0)
    made = bring_in(path, "output_angle=q", rate=100.0, allow_jumps=True)
    assert any("WARNING: output_angle jumps 4 times" in note for note in made.notes)
    made.path.unlink()
    map_text = '[channels.output_angle]\ncolumn = "q"\nmodulus = 360\n[recording]\nrate = 100\n'
    np.testing.assert_allclose(
        opened(by_map(tmp_path, text, map_text)).si("output_angle"), np.radians(true)
    )


def test_a_reversal_is_no_wrap(tmp_path: Path) -> None:
    angle = 30.0 * np.sin(np.arange(400) * 0.05)
    path = text_file(tmp_path, "q [deg]\n" + "".join(f"{x}\n" for x in angle))
    assert not any("wrapped" in note for note in bring_in(path, "input_angle=q", rate=100.0).notes)


def test_counts_of_a_position_are_asked_what_they_are(tmp_path: Path) -> None:
    path = text_file(tmp_path, "p\n1\n2\n")
    with pytest.raises(
        ConfigurationError, match=r"counts of a position may be m or rad.*input_angle"
    ):
        bring_in(path, "position=p:count:1000", rate=10.0)


def test_an_option_goes_before_the_map(tmp_path: Path) -> None:
    (run,) = read_channel_map(
        text_file(
            tmp_path, '[channels.torque]\ncolumn = 1\nunit = "N m"\n[gear]\nratio = 100\n', "m.toml"
        )
    )
    assert run.options({"ratio": 50.0}).ratio == 50.0
    assert run.options({}).ratio == 100.0
    assert isinstance(run.options({}), ImportOptions)


def test_several_runs_of_one_file(tmp_path: Path) -> None:
    map_text = """
        [recording]
        rate = 5000
        [runs.J1]
        [runs.J1.channels.position]
        column = "a"
        unit = "rad"
        [runs.J1.gear]
        ratio = 32
        [runs.J2]
        [runs.J2.channels.position]
        column = "b"
        unit = "rad"
        [runs.J2.gear]
        ratio = -48
    """
    runs = read_channel_map(text_file(tmp_path, map_text, "map.toml"))
    assert [run.name for run in runs] == ["J1", "J2"]
    assert [run.options({}).ratio for run in runs] == [32, -48]
    assert [run.options({}).rate for run in runs] == [5000, 5000]
    assert [run.channels[0].column for run in runs] == ["a", "b"]


def test_lag_accuracy_and_range_are_stated_with_their_units(tmp_path: Path) -> None:
    rows = "".join(f"{k / 100},{k * 40 % 360},{k}\n" for k in range(30))
    path = text_file(tmp_path, f"t [s],q [deg],M [N m]\n{rows}")
    channels = {"time": "t", "output_angle": "q", "torque": "M"}
    run = rig.read_csv(
        path,
        channels=channels,
        modulus={"output_angle": 360.0},
        lag={"torque": "2ms", "output_angle": 5e-4},
        accuracy={"output_angle": "5arcsec"},
    )
    assert run["output_angle"][-1] == pytest.approx(np.radians(29 * 40))
    assert run.metadata.process["stated"]["lag_s"] == {"output_angle": 5e-4, "torque": 2e-3}
    calibration = run.recording.signals["output_angle"].calibration
    assert calibration.accuracy == pytest.approx(5.0 * np.pi / 180.0 / 3600.0)


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ({"lag": {"torque": "2"}}, r"--lag torque: nobody says its unit; value 2.* 2ms"),
        ({"lag": {"torque": "2deg"}}, r"--lag torque: is no time; value 2deg"),
        ({"lag": {"torque": "soon"}}, r"is not a number with a unit; value 'soon'"),
        ({"lag": {"force": "2ms"}}, r"--lag force: is no channel of the import, allowed torque"),
        ({"accuracy": {"torque": "5arcsec"}}, r"torque: .*another dimension; value rad, .*N m"),
        ({"accuracy": {"torque": "5furlong"}}, r"--accuracy torque: has a unit that is not known"),
    ],
)
def test_what_is_stated_without_sense_is_refused(
    tmp_path: Path, stated: dict[str, Any], words: str
) -> None:
    path = text_file(tmp_path, "t [s],M [N m]\n0,1\n1,2\n2,3\n")
    with pytest.raises(ConfigurationError, match=words):
        rig.read_csv(path, channels={"time": "t", "torque": "M"}, **stated)


@pytest.mark.parametrize("runs", ["runs = 5", "[runs]\nJ1 = 5"])
def test_runs_of_a_map_that_are_no_maps_are_refused(tmp_path: Path, runs: str) -> None:
    with pytest.raises(ConfigurationError, match="is no table of maps"):
        read_channel_map(text_file(tmp_path, f"{runs}\n", "map.toml"))
