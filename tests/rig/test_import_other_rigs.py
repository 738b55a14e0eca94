"""Recordings of other rigs: read right whatever their form, or refused by file, line, column and value."""

import math
import os
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from experiments.recording import Recording
from model.units import ARCMIN, DEGREE, REVOLUTION, RPM
from rig.errors import ConfigurationError, RigError, RunFileError
from rig.fit import fit_files
from rig.runfile.foreign import (
    Imported,
    ImportOptions,
    import_csv,
    import_mat,
    parse_channel,
    read_channel_map,
)
from rig.runfile.read import close_recording, open_run
from rig.runfile.verify import verify_run

DATA = Path(os.environ.get("HARMONIC_RIG_DATA") or Path(__file__).parents[3] / "shared" / "data")
TIME = np.arange(6) * 0.002
DEGREES = np.array([0.0, 1.5, 3.0, -4.25, 6.0, 7.5])
TORQUES = np.array([0.5, -0.25, 0.125, 1.0, 2.5, -1e-3])


def bring_in(path: Path, *channels: str, fmt: str = "csv", **options: Any) -> Imported:
    read = import_csv if fmt == "csv" else import_mat
    made = ImportOptions(channels=tuple(map(parse_channel, channels)), **options)
    return read(path, made, lambda: path.with_name("00001-import-x.h5"))


def columns(made: Imported, *names: str) -> list[np.ndarray]:
    recording = open_run(made.path, verify=True)
    try:
        return [recording.time() if name == "time" else recording.si(name) for name in names]
    finally:
        close_recording(recording)


def file_of(folder: Path, text: str | bytes, name: str = "bench.csv") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8"))
    return path


def table(delimiter: str = ",", mark: str = ".", head: str = "t [s]|Position [deg]|M [N m]") -> str:
    rows = [
        delimiter.join(repr(float(x)).replace(".", mark) for x in row)
        for row in zip(TIME, DEGREES, TORQUES, strict=True)
    ]
    return "\n".join([head.replace("|", delimiter), *rows]) + "\n"


MAPPED = ("time=t", "input_angle=Position", "torque=M")


@pytest.mark.parametrize(
    ("delimiter", "mark"), [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), ("|", "."), ("|", ",")]
)
@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_delimiters_and_decimal_marks_are_found_out(tmp_path: Path, delimiter: str, mark: str, ends: str) -> None:
    made = bring_in(file_of(tmp_path, table(delimiter, mark).replace("\n", ends)), *MAPPED)
    assert (made.rows, made.dropped) == (6, 0)
    time, angle, torque = columns(made, "time", "input_angle", "torque")
    np.testing.assert_allclose(time, TIME, atol=1e-12)
    np.testing.assert_array_equal(angle, DEGREES * DEGREE)
    np.testing.assert_array_equal(torque, TORQUES)
    word = {",": "comma", ";": "semicolon", "\t": "tab", "|": "bar"}[delimiter]
    assert any(f"separated by {word}, decimal {'comma' if mark == ',' else 'point'}" in note for note in made.notes)


def test_what_is_said_goes_before_what_is_guessed(tmp_path: Path) -> None:
    path = file_of(tmp_path, "1,5;2,5\n2,5;3,5\n3,5;4,5\n")
    made = bring_in(path, "torque=2", rate=100.0, delimiter="semicolon", decimal=",")
    assert columns(made, "torque")[0].tolist() == [2.5, 3.5, 4.5]
    with pytest.raises(ConfigurationError, match="decimal mark"):
        bring_in(path, "torque=2", rate=100.0, decimal="x")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16"])
def test_encodings_of_the_heading(tmp_path: Path, encoding: str) -> None:
    path = file_of(tmp_path, table(";", ",", "t [s]|Stellung [°]|Drehmoment für M").encode(encoding))
    made = bring_in(path, "time=t", "input_angle=Stellung", "torque=Drehmoment für M")
    np.testing.assert_array_equal(columns(made, "input_angle")[0], DEGREES * DEGREE)


@pytest.mark.parametrize(
    ("channel", "factor", "unit"),
    [
        ("input_angle=2:deg", DEGREE, "rad"), ("input_angle=2:rev", REVOLUTION, "rad"), ("input_angle=2", 1.0, "rad"),
        ("output_angle=2:arcmin", ARCMIN, "rad"), ("output_angle=2:°:-1", -DEGREE, "rad"),
        ("target_speed=2:r/min", RPM, "rad/s"), ("target_speed=2:rpm", RPM, "rad/s"), ("my_speed=2:deg/s", DEGREE, "rad/s"),
        ("torque=2:mN m", 1e-3, "N m"), ("torque=2:Nm:2", 2.0, "N m"), ("torque=2:A:0.11", 0.11, "N m"),
        ("torque=2:V:5", 5.0, "N m"), ("current=2:mA", 1e-3, "A"), ("position=2:mm", 1e-3, "m"), ("delay=2:ms", 1e-3, "s"),
        ("load=2:%", 1e-2, "1"), ("anything=2", 1.0, "1"),
    ],
)  # fmt: skip
def test_units_and_scales(tmp_path: Path, channel: str, factor: float, unit: str) -> None:
    made = bring_in(file_of(tmp_path, table(head="a|b|c")), "time=1:s", channel)
    recording = open_run(made.path)
    name = channel.partition("=")[0]
    np.testing.assert_allclose(recording.si(name), DEGREES * factor, rtol=1e-15)
    np.testing.assert_array_equal(recording.stored(name), DEGREES)
    assert recording.signals[name].unit == unit
    close_recording(recording)


def test_temperatures_in_kelvin_and_a_torque_constant(tmp_path: Path) -> None:
    path = file_of(tmp_path, "t [ms],T [K],i [A]\n0,300.15,2\n1,301.15,4\n2,302.15,6\n")
    made = bring_in(path, "time=t", "housing_temperature=T", "torque=i", torque_constant=0.25)
    time, temperature, torque = columns(made, "time", "housing_temperature", "torque")
    np.testing.assert_allclose(time, [0.0, 1e-3, 2e-3], atol=1e-15)
    np.testing.assert_allclose(temperature, [27.0, 28.0, 29.0], atol=1e-12)
    assert torque.tolist() == [0.5, 1.0, 1.5]


def test_counts_stay_counts_and_wrapped_ones_are_unwrapped(tmp_path: Path) -> None:
    counts = np.arange(0, 12000, 700)
    rows = "".join(f"{k};{count % 4096}\n" for k, count in enumerate(counts))
    path = file_of(tmp_path, "t [ms];pos\n" + rows)
    map_file = file_of(
        tmp_path,
        '[channels.time]\ncolumn="t"\n[channels.input_angle]\ncolumn=2\nunit="count"\nscale=-4096\nmodulus=4096\n'
        '[[segments]]\nlabel="hold"\nstart=0.002\nstop=0.01\nsetpoint=3.0\ndirection=1\n',
        "map.toml",
    )
    channels, segments = read_channel_map(map_file)
    made = import_csv(path, ImportOptions(channels, segments=segments), lambda: tmp_path / "00001-import-x.h5")
    recording = open_run(made.path)
    assert recording.stored("input_angle").dtype.kind == "i"
    np.testing.assert_array_equal(recording.stored("input_angle"), counts)
    np.testing.assert_allclose(recording.si("input_angle"), -counts * REVOLUTION / 4096, rtol=1e-14)
    (segment,) = recording.segments
    assert (segment.label, segment.start, segment.stop, segment.setpoint, segment.direction) == ("hold", 2, 10, 3.0, 1)
    close_recording(recording)
    with pytest.raises(RunFileError, match=r"line 3, column pos.*whole count"):
        bring_in(file_of(tmp_path, "t [ms];pos\n0;1\n1;1.5\n"), "time=t", "input_angle=pos:counts:4096")


def test_the_run_is_imported_and_says_where_it_comes_from(tmp_path: Path) -> None:
    path = file_of(tmp_path, "# a comment\n" + table())
    made = bring_in(path, *MAPPED, start_time="2025-11-21T09:30:00+01:00", operator="Ada", gear_serial="B7", title="bench 3")
    recording = open_run(made.path, verify=True)
    m = recording.metadata
    assert (m.origin, m.operator, m.gear_serial, m.title, m.time_base) == ("imported", "Ada", "B7", "bench 3", "device")
    assert m.sample_rate == pytest.approx(500.0, rel=1e-9)
    assert m.start_time.startswith("2025-11-21")
    assert m.process["source_file"] == "bench.csv"
    assert len(m.process["source_sha256"]) == 64
    assert recording.time()[0] == 0.0
    with pytest.raises(Exception, match="output_angle"):
        recording.require("the ratio", "output_angle")
    close_recording(recording)
    assert not any(finding.level == "error" for finding in verify_run(made.path))


def test_other_places_of_the_time(tmp_path: Path) -> None:
    path = file_of(tmp_path, table())
    assert bring_in(path, "torque=M", rate=250.0).rows == 6
    recording = open_run(tmp_path / "00001-import-x.h5")
    np.testing.assert_allclose(recording.time(), np.arange(6) / 250.0, atol=1e-12)
    assert recording.metadata.time_base == "nominal"
    close_recording(recording)
    for given_ in ({}, {"rate": 10.0, "no_time": True}):
        with pytest.raises(ConfigurationError, match="time"):
            bring_in(path, "torque=M", **given_)
    for rate in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(ConfigurationError, match="sample rate"):
            bring_in(path, "torque=M", rate=rate)
    no_time = path.with_name("00002-import-x.h5")
    import_csv(path, ImportOptions((parse_channel("torque=M"),), no_time=True), lambda: no_time)
    recording = open_run(no_time)
    assert recording.metadata.time_base == "none"
    close_recording(recording)


HEAD = "t [s],Position [deg],M [N m]\n"
BAD = {
    "words": ("0,1,2\n0.1,abc,2\n0.2,1,2\n", 3, "Position [deg]", "'abc'", "not a number"),
    "hole": ("0,1,2\n0.1,1,2\n0.2,1,\n", 4, "M [N m]", "''", "empty"),
    "nan": ("0,1,2\n0.1,NaN,2\n0.2,1,1\n", 3, "Position [deg]", "'NaN'", "not finite"),
    "infinite": ("0,1,2\n0.1,1,-inf\n0.2,1,1\n", 3, "M [N m]", "'-inf'", "not finite"),
    "overflow": ("0,1,2\n0.1,1,1e999\n0.2,1,1\n", 3, "M [N m]", "'1e999'", "not finite"),
    "underscore": ("0,1,2\n0.1,1_0,2\n0.2,1,1\n", 3, "Position [deg]", "'1_0'", "not a number"),
    "short": ("0,1,2\n0.1,1\n0.2,1,1\n", 3, "", "'0.1,1'", "2 cells"),
    "long": ("0,1,2\n0.1,1,2,3\n0.2,1,1\n", 3, "", "'0.1,1,2,3'", "4 cells"),
    "time stands": ("0,1,2\n0.1,1,2\n0.1,1,1\n0.2,1,1\n", 4, "t [s]", "0.1", "does not increase"),
    "time turns back": ("0,1,2\n0.1,1,2\n0.05,1,1\n0.2,1,1\n", 4, "t [s]", "0.05", "does not increase"),
    "time is absurd": ("0,1,2\n0.1,1,2\n1e30,1,1\n", 4, "t [s]", "1e+30", "calendar"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_row_is_refused_by_file_line_column_and_value(tmp_path: Path, case: str) -> None:
    text, line, column, value, why = BAD[case]
    path = file_of(tmp_path, HEAD + text)
    with pytest.raises(RunFileError) as caught:
        bring_in(path, *MAPPED)
    message = str(caught.value)
    for word in ("bench.csv", f"line {line}", column, value, why, "--drop-bad-rows"):
        assert word in message, message
    assert [p.name for p in tmp_path.iterdir()] == ["bench.csv"]


@pytest.mark.parametrize("case", BAD)
def test_bad_rows_are_left_out_counted_and_listed_when_asked(tmp_path: Path, case: str) -> None:
    text, line, _, _, why = BAD[case]
    rows = text.count("\n")
    made = bring_in(file_of(tmp_path, HEAD + text), *MAPPED, drop_bad_rows=True)
    assert (made.rows, made.dropped) == (rows - 1, 1)
    assert any("1 rows left out" in note and f"line {line}" in note and why in note for note in made.notes)
    recording = open_run(made.path)
    assert recording.rows == rows - 1
    assert any("rows left out" in event.text for event in recording.events)
    close_recording(recording)
    assert any(f.check == "rows" and "1 cycles never became a row" in f.text for f in verify_run(made.path))


def test_a_hole_in_a_column_that_is_not_wanted_does_no_harm(tmp_path: Path) -> None:
    made = bring_in(file_of(tmp_path, HEAD + "0,1,2\n0.1,,3\n0.2,x,4\n"), "time=t", "torque=M")
    assert columns(made, "torque")[0].tolist() == [2.0, 3.0, 4.0]


@pytest.mark.parametrize(
    ("channels", "words"),
    [
        (("time=t", "input_angle=Pos:deg"), ("no such column", "Pos", "Position [deg]", "1 to 3")),
        (("time=t", "input_angle=9"), ("no such column", "9", "1 to 3")),
        (("time=t", "input_angle=0"), ("no such column",)),
        (("time=t", "input_angle=Position:degre"), ("unit that is not known", "input_angle", "'degre'", "deg")),
        (("time=t", "input_angle=Position:N m"), ("another dimension", "input_angle", "N m", "deg")),
        (("time=t", "torque=M:s"), ("another dimension", "torque")),
        (("time=t:deg", "torque=M"), ("another dimension", "time", "ms")),
        (("time=t", "torque=M:A"), ("needs its scale", "torque", "N m per A")),
        (("time=t", "input_angle=Position:count"), ("counts per revolution", "input_angle")),
        (("time=t",), ("no channels", "Position [deg]")),
        ((), ("no channels",)),
        (("time=t", "torque=M", "torque=Position"), ("given twice",)),
    ],
)
def test_a_wrong_map_says_what_there_is(tmp_path: Path, channels: tuple[str, ...], words: tuple[str, ...]) -> None:
    with pytest.raises(ConfigurationError) as caught:
        bring_in(file_of(tmp_path, table()), *channels)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize("text", ["", "x", "=1", "x=", "x=1:m:y", "x=1:m:0", "x=1:m:nan", "x=1:m:2:3", "x=1:m:inf"])
def test_a_channel_that_is_none(text: str) -> None:
    with pytest.raises(ConfigurationError):
        parse_channel(text)


@pytest.mark.parametrize(
    "text",
    ["", "[channels", "a = 1", "channels = 3", "[channels.x]", "[channels.x]\ncolumn = []", "[channels.x]\ncolumn=1\nodd=2",
     "[channels.x]\ncolumn=1\nscale='a'", "[channels.x]\ncolumn=1\nunit=3", "[channels]\nx=1",
     "[channels.x]\ncolumn=1\n[[segments]]\nlabel='a'", "segments=3\n[channels.x]\ncolumn=1", "\udcff"],
)  # fmt: skip
def test_a_channel_map_that_is_none(tmp_path: Path, text: str) -> None:
    path = file_of(tmp_path, text.encode("utf-8", "surrogateescape"), "map.toml")
    with pytest.raises(ConfigurationError, match=r"map\.toml"):
        read_channel_map(path)


@pytest.mark.parametrize("fmt", ["csv", "mat"])
@pytest.mark.parametrize(
    "content", [b"", b"\n\n  \n", b"# only a comment\n", b"t,M\n", b"t,M\n0,1\n", bytes(range(256)) * 40, b"\x89HDF\r\n\x1a\n"]
)
def test_files_without_rows_and_files_that_are_none(tmp_path: Path, fmt: str, content: bytes) -> None:
    path = file_of(tmp_path, content, "bench.dat")
    with pytest.raises(RigError, match=r"bench\.dat"):
        bring_in(path, "time=1", "torque=2", fmt=fmt)
    assert [p.name for p in tmp_path.iterdir()] == ["bench.dat"]
    with pytest.raises(RunFileError, match="nowhere"):
        bring_in(tmp_path / "nowhere", "time=1", "torque=2", fmt=fmt)
    with pytest.raises(RunFileError):
        bring_in(tmp_path, "time=1", "torque=2", fmt=fmt)


def try_import(folder: Path, content: bytes, fmt: str, drop: bool) -> None:
    """Anything is imported and readable, or refused in words."""
    run = folder / "00001-import-x.h5"
    for path in folder.iterdir():
        path.unlink()
    path = file_of(folder, content, "any")
    try:
        made = bring_in(path, "time=1", "torque=2", fmt=fmt, drop_bad_rows=drop)
    except RigError:
        assert not run.exists()
        return
    recording = open_run(made.path, verify=True)
    assert recording.metadata.origin == "imported"
    assert recording.rows == made.rows >= 2
    assert np.isfinite(recording.si("torque")).all()
    assert (np.diff(recording.time()) >= 0).all()
    close_recording(recording)
    assert not any(finding.level == "error" for finding in verify_run(made.path))


CELLS = st.one_of(
    st.floats().map(repr), st.integers(-5, 400).map(str), st.sampled_from(["", "nan", "1,5", "1e400", "-", '"', "#", "١"])
)
LINES = st.lists(st.lists(CELLS, min_size=1, max_size=3), max_size=6)
FUZZ = settings(
    max_examples=25, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@FUZZ
@given(text=st.text(max_size=120), drop=st.booleans())
def test_any_text(tmp_path: Path, text: str, drop: bool) -> None:
    try_import(tmp_path, text.encode("utf-8", "surrogatepass"), "csv", drop)


@FUZZ
@given(lines=LINES, delimiter=st.sampled_from(",;\t| "), drop=st.booleans())
def test_any_table(tmp_path: Path, lines: list[list[str]], delimiter: str, drop: bool) -> None:
    try_import(tmp_path, "\n".join(delimiter.join(line) for line in lines).encode(), "csv", drop)


@FUZZ
@given(content=st.binary(max_size=300), fmt=st.sampled_from(["csv", "mat"]), drop=st.booleans())
def test_any_bytes(tmp_path: Path, content: bytes, fmt: str, drop: bool) -> None:
    try_import(tmp_path, content, fmt, drop)


@pytest.mark.parametrize("cut", [0, 3, 100, 128, 200, 400])
def test_a_matlab_file_cut_short(tmp_path: Path, cut: int) -> None:
    whole = tmp_path / "whole.mat"
    scipy.io.savemat(whole, {"t": TIME, "M": TORQUES})
    path = file_of(tmp_path, whole.read_bytes()[:cut], "cut.mat")
    with pytest.raises(RigError, match=r"cut\.mat"):
        bring_in(path, "time=t", "torque=M", "input_angle=q", fmt="mat")


@pytest.mark.parametrize(("at", "value"), [(144, 5), (145, 8), (176, 64), (177, 6), (260, 127), (280, 0), (136, 3), (20, 0)])
def test_a_damaged_matlab_file_does_not_kill_the_program(tmp_path: Path, at: int, value: int) -> None:
    """Wrong type codes and flags end SciPy's compiled reader with a signal."""
    whole = tmp_path / "whole.mat"
    scipy.io.savemat(whole, {"t": TIME, "M": TORQUES, "s": {"q": DEGREES}})
    content = bytearray(whole.read_bytes())
    content[at] = value
    folder = tmp_path / "made"
    folder.mkdir()
    try_import(folder, bytes(content), "mat", True)


@pytest.mark.parametrize("compress", [False, True])
def test_matlab_5(tmp_path: Path, compress: bool) -> None:
    path = tmp_path / "bench.mat"
    content = {"t": TIME[:, None], "M": TORQUES[None, :], "rig": {"q": DEGREES}, "both": np.stack([TIME, TORQUES], 1)}
    scipy.io.savemat(path, content | {"note": "text", "other": np.arange(3.0)}, do_compression=compress)
    made = bring_in(path, "time=t", "input_angle=rig.q:deg", "torque=M", "drive_torque=both#2:mN m", fmt="mat")
    time, angle, torque, drive = columns(made, "time", "input_angle", "torque", "drive_torque")
    np.testing.assert_allclose(time, TIME, atol=1e-12)
    np.testing.assert_array_equal(angle, DEGREES * DEGREE)
    np.testing.assert_array_equal(torque, TORQUES)
    np.testing.assert_allclose(drive, TORQUES * 1e-3, rtol=1e-15)
    with pytest.raises(RunFileError, match="differ in length"):
        bring_in(path, "time=t", "torque=other", fmt="mat")
    with pytest.raises(ConfigurationError, match="no such column"):
        bring_in(path, "time=t", "torque=note", fmt="mat")


def test_matlab_7_3(tmp_path: Path) -> None:
    path = tmp_path / "bench.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in (("t", TIME), ("M", TORQUES), ("rig/q", DEGREES)):
            file.create_dataset(name, data=values[None, :]).attrs["MATLAB_class"] = np.bytes_("double")
        file.create_dataset("note", data=np.frombuffer(b"text", np.uint8)).attrs["MATLAB_class"] = np.bytes_("char")
    mark = b"MATLAB 7.3 MAT-file"
    path.write_bytes(mark + path.read_bytes()[len(mark) :])
    made = bring_in(path, "time=t", "input_angle=rig.q:deg", "torque=M", fmt="mat")
    time, angle, torque = columns(made, "time", "input_angle", "torque")
    np.testing.assert_allclose(time, TIME, atol=1e-12)
    np.testing.assert_array_equal(angle, DEGREES * DEGREE)
    np.testing.assert_array_equal(torque, TORQUES)


def test_a_nan_in_a_matlab_file_is_refused_by_row(tmp_path: Path) -> None:
    path = tmp_path / "bench.mat"
    values = TORQUES.copy()
    values[3] = np.nan
    scipy.io.savemat(path, {"t": TIME, "M": values})
    with pytest.raises(RunFileError, match=r"bench\.mat, row 4, column M.*nan"):
        bring_in(path, "time=t", "torque=M", fmt="mat")
    made = bring_in(path, "time=t", "torque=M", fmt="mat", drop_bad_rows=True)
    assert (made.rows, made.dropped) == (5, 1)


def long_recording(folder: Path, *channels: str, **options: Any) -> Path:
    """Holds at eight speeds both ways, with a friction of 0.2 N m + 0.01 N m s and a ripple of order 2; as text."""
    rate, hold = 400.0, 4.0
    levels = [4.0, 6.0, 9.0, 13.0, 19.0, 27.0, 38.0, 50.0]
    speeds = np.concatenate([np.full(int(rate * hold), s) for level in levels for s in (level, -level)])
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
    made = bring_in(path, "time=1", "input_angle=2:rad", "torque=3")
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
    from rig.exits import explain

    assert explain(caught.value) is not None


@pytest.mark.skipif(not (DATA / "emps").is_dir(), reason="the EMPS recordings are not here")
def test_emps_from_the_file_to_the_mass(tmp_path: Path) -> None:
    """Published for this recording: 95.1089 kg."""
    path = DATA / "emps" / "DATA_EMPS.mat"
    channels = ("time=t:s", "position=qm:m", "force=vir:V:35.15065188")
    made = import_mat(path, ImportOptions(tuple(map(parse_channel, channels))), lambda: tmp_path / "00001-import-emps.h5")
    assert (made.rows, made.dropped) == (24841, 0)
    (found,) = fit_files([made.path], "motion")
    recording: Recording = found.recording
    assert recording.metadata.origin == "imported"
    assert found.result.estimates["inertia"].value == pytest.approx(95.1089, rel=0.002)
