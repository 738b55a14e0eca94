"""Text files of other rigs: found out, read in SI, marked IMPORTED; or one message that names line,
column and value.
"""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from experiments.finding import Severity
from experiments.recording import Recording, Segment
from model.gear_file import shipped_gear
from rig.bench.backends.order import Order
from rig.bench.backends.replayed import replayed
from rig.errors import ConfigurationError, RigError, RunFileError
from rig.library.folder import claim_run
from rig.runfile.importing.channel_map import (
    ForeignSegment,
    ImportOptions,
    read_channel_map,
)
from rig.runfile.importing.channel_source import parse_channel
from rig.runfile.importing.convert import Imported
from rig.runfile.importing.heading import sample_rate
from rig.runfile.read import open_run
from rig.runfile.source import FileSource
from rig.runfile.verify import verify_run
from tests.rig.importing import import_csv

DATA = Path(
    os.environ.get("HARMONIC_RIG_DATA", Path(__file__).parents[4].parent / "shared" / "data")
)
BASIC = ("time=t:s", "input_angle=angle:deg", "torque=M:mN m")


def options(*channels: str, **changes: object) -> ImportOptions:
    return ImportOptions(channels=tuple(map(parse_channel, channels or BASIC)), **changes)  # type: ignore[arg-type]


def run_import(folder: Path, text: str | bytes, chosen: ImportOptions) -> Imported:
    path = folder / "foreign.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return import_csv(path, chosen, lambda: claim_run(folder / "runs", "import", "x").path)


def imported(folder: Path, text: str | bytes, chosen: ImportOptions | None = None) -> Recording:
    return open_run(run_import(folder, text, chosen or options()).path, verify=True)


GOOD = "t,angle,M\n0.0,0,10\n0.5,90,-2.5\n1.0,180,1e1\n"


@pytest.mark.parametrize(
    "text",
    [
        GOOD,
        GOOD.replace("\n", "\r\n"),
        GOOD.replace(",", ";"),
        GOOD.replace(",", "\t"),
        GOOD.replace(",", "|"),
        GOOD.replace(",", "|").replace(".", ","),
        GOOD.replace(",", ", "),
        GOOD.replace(",", "  "),
        GOOD.replace(",", ";").replace(".", ","),
        GOOD.replace(",", "\t").replace(".", ","),
        GOOD.replace(",", " ").replace(".", ","),
        "\ufeff" + GOOD,
        "# made by rig 7\n% comment\n\n" + GOOD + "\n\n",
        '"t","angle","M"\n"0.0","0","10"\n"0.5","90","-2.5"\n"1.0","180","10"\n',
        "t,angle,M,\n0.0,0,10,\n0.5,90,-2.5,\n1.0,180,10,\n",
        "Logger 5\nSerial 17\n" + GOOD,
        "t,angle,M\ns,deg,mN m\n0.0,0,10\n0.5,90,-2.5\n1.0,180,10\n",
    ],
)
def test_every_dialect_gives_the_same_numbers(tmp_path: Path, text: str) -> None:
    recording = imported(tmp_path, text)
    np.testing.assert_allclose(recording.time(), [0.0, 0.5, 1.0], rtol=1e-12)
    np.testing.assert_allclose(recording.si("input_angle"), [0.0, np.pi / 2, np.pi], rtol=1e-12)
    np.testing.assert_allclose(recording.si("torque"), [0.010, -0.0025, 0.010], rtol=1e-12)


@pytest.mark.parametrize(
    ("delimiter", "word"), [(",", "comma"), (";", "semicolon"), ("\t", "tab"), ("|", "bar")]
)
def test_what_was_found_out_is_noted(tmp_path: Path, delimiter: str, word: str) -> None:
    for mark, name in ((".", "point"), (",", "comma")):
        if mark != delimiter:
            text = "\n".join(
                delimiter.join(line.split(",")).replace(".", mark) for line in GOOD.split("\n")
            )
            assert any(
                f"separated by {word}, decimal {name}" in note
                for note in run_import(tmp_path, text, options()).notes
            )


def test_what_is_said_goes_before_what_is_guessed(tmp_path: Path) -> None:
    text = "1,5;2,5\n2,5;3,5\n3,5;4,5\n"
    said = options("torque=2:N m", rate=100.0, delimiter="semicolon", decimal=",")
    assert imported(tmp_path, text, said).si("torque").tolist() == [2.5, 3.5, 4.5]


def test_a_torque_constant_and_a_time_in_milliseconds(tmp_path: Path) -> None:
    chosen = options("time=t", "torque=i", torque_constant=0.25)
    recording = imported(tmp_path, "t [ms],i [A]\n0,2\n1,4\n2,6\n", chosen)
    np.testing.assert_allclose(recording.time(), [0.0, 1e-3, 2e-3], atol=1e-15)
    assert recording.si("torque").tolist() == [0.5, 1.0, 1.5]


def test_two_steps_of_which_neither_is_usual_have_a_rate() -> None:
    assert sample_rate(np.array([0, 114_000_000, 116_000_000])) == pytest.approx(1e9 / 58e6)


def test_a_count_that_is_no_whole_number_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RunFileError, match=r"line 3, column pos.*whole count"):
        run_import(
            tmp_path, "t [ms];pos\n0;1\n1;1.5\n", options("time=t", "input_angle=pos:counts:4096")
        )


def test_a_hole_in_a_column_that_is_not_wanted_does_no_harm(tmp_path: Path) -> None:
    recording = imported(
        tmp_path, "t,angle,M\n0,1,2\n0.1,,3\n0.2,x,4\n", options("time=t:s", "torque=M:N m")
    )
    assert recording.si("torque").tolist() == [2.0, 3.0, 4.0]


@pytest.mark.parametrize("encoding", ["utf-16", "cp1252", "utf-8", "utf-8-sig"])
def test_encodings(tmp_path: Path, encoding: str) -> None:
    text = "t,Winkel [°],M\n0,0,1\n1,90,2\n".encode(encoding)
    recording = imported(tmp_path, text, options("time=t:s", "input_angle=Winkel", "torque=M:N m"))
    np.testing.assert_allclose(recording.si("input_angle"), [0, np.pi / 2])


def test_the_run_says_what_it_is(tmp_path: Path) -> None:
    chosen = options(
        gear=shipped_gear(),
        mounting="flexspline-fixed",
        gear_serial="B7",
        operator="Eva",
        experiment="friction",
        start_time="2024-05-06T07:08:09+02:00",
    )
    recording = imported(tmp_path, GOOD, chosen)
    m = recording.metadata
    assert (m.origin, m.operator, m.gear_serial, m.experiment, m.time_base) == (
        "imported",
        "Eva",
        "B7",
        "friction",
        "device",
    )
    assert (m.ratio, m.output_sense, m.sample_rate, m.outcome) == (121.0, 1, 2.0, "")
    assert m.run_id == "00001-import-x"
    assert recording.source.time_ns(0, 1)[0] == 1_714_972_089_000_000_000
    assert len(m.process["source_sha256"]) == 64
    assert [entry["column"] for entry in m.process["channel_map"]] == ["t", "angle", "M"]
    assert {event.code for event in recording.events} == {"IMPORT"}
    assert m.process["source_file"] == "foreign.csv"
    assert not any(
        finding.severity is Severity.BLOCKS for finding in verify_run(recording.source.path)
    )  # type: ignore[attr-defined]
    with pytest.raises(ConfigurationError, match="can be replayed"):
        replayed(recording.source.path, Order(protocol=""))  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("channel", "values", "unit", "expected"),
    [
        ("input_angle=x:arcmin", "60,120", "rad", [np.pi / 180, np.pi / 90]),
        ("input_angle=x:rad", "1,2", "rad", [1.0, 2.0]),
        ("output_angle=x:°:-1", "90,180", "rad", [-np.pi / 2, -np.pi]),
        ("my_speed=x:deg/s", "180,360", "rad/s", [np.pi, 2 * np.pi]),
        ("torque=x:mN m", "1,2", "N m", [0.001, 0.002]),
        ("current=x:mA", "1,2", "A", [0.001, 0.002]),
        ("delay=x:ms", "1,2", "s", [0.001, 0.002]),
        ("load=x:%", "1,2", "1", [0.01, 0.02]),
        ("input_angle=x:rev", "1,2", "rad", [2 * np.pi, 4 * np.pi]),
        ("input_angle=x:deg:-1", "90,180", "rad", [-np.pi / 2, -np.pi]),
        ("output_angle=x:count:72000", "18000,36000", "rad", [np.pi / 2, np.pi]),
        ("output_angle=x:count:-72000", "18000,36000", "rad", [-np.pi / 2, -np.pi]),
        ("target_speed=x:rpm", "60,120", "rad/s", [2 * np.pi, 4 * np.pi]),
        ("torque=x:A:0.2", "1,-2", "N m", [0.2, -0.4]),
        ("torque=x:mA:0.2", "1000,-2000", "N m", [0.2, -0.4]),
        ("torque=x:V:0.5", "1,2", "N m", [0.5, 1.0]),
        ("torque=x:count:0.001", "1,2", "N m", [0.001, 0.002]),
        ("force=x:V:35.15", "1,2", "N", [35.15, 70.3]),
        ("position=x:mm", "1,2", "m", [0.001, 0.002]),
        ("current=x:A", "1,2", "A", [1.0, 2.0]),
        ("housing_temperature=x:K", "293.15,273.15", "degC", [20.0, 0.0]),
        ("strange_name=x:kN", "1,2", "N", [1e3, 2e3]),
        ("statusword=x", "39,55", "1", [39.0, 55.0]),
    ],
)
def test_units_and_scales(
    tmp_path: Path, channel: str, values: str, unit: str, expected: list[float]
) -> None:
    recording = imported(
        tmp_path, "x\n" + values.replace(",", "\n") + "\n", options(channel, rate=10.0)
    )
    name = channel.partition("=")[0]
    assert recording.signals[name].unit == unit
    np.testing.assert_allclose(recording.si(name), expected, rtol=1e-12, atol=1e-12)
    assert recording.metadata.time_base == "nominal"


def test_counts_stay_counts(tmp_path: Path) -> None:
    recording = imported(
        tmp_path, "t;c\n0;4000000000\n1;-7\n", options("time=t:s", "input_angle=c:count:10000")
    )
    assert recording.stored("input_angle").tolist() == [4_000_000_000, -7]
    assert recording.stored("input_angle").dtype == np.int64
    assert recording.signals["input_angle"].quantum == pytest.approx(2 * np.pi / 10000)


def test_units_come_from_headings(tmp_path: Path) -> None:
    text = "t [ms],Angle (deg),Torque [N·m],note [x]\n0,0,1,a\n500,180,2,b\n"
    recording = imported(tmp_path, text, options("time=t", "input_angle=Angle", "torque=3"))
    np.testing.assert_allclose(recording.time(), [0, 0.5])
    np.testing.assert_allclose(recording.si("input_angle"), [0, np.pi])
    other = ("time=t", "input_angle=Angle:rad")
    with pytest.raises(ConfigurationError, match=r"another unit than its heading says; value rad"):
        run_import(tmp_path, text, options(*other))
    recording = imported(tmp_path, text, options("time=t:ms", other[1], ignore_headings=True))
    assert recording.si("input_angle").tolist() == [0.0, 180.0]


def test_wrapped_columns_are_unwrapped_over_batches(tmp_path: Path) -> None:
    rows = 40_000
    true = np.arange(rows) * 7 % 100_000 * 1.0
    true = np.where(np.arange(rows) < 25_000, np.arange(rows) * 7, (50_000 - np.arange(rows)) * 7)
    text = "c\n" + "\n".join(str(value % 4096) for value in true.tolist()) + "\n"
    source = replace(parse_channel("input_angle=c:count:4096"), modulus=4096.0)
    recording = imported(tmp_path, text, ImportOptions(channels=(source,), rate=1000.0))
    np.testing.assert_array_equal(recording.stored("input_angle"), true)


def test_a_column_beyond_its_modulus_is_refused(tmp_path: Path) -> None:
    source = replace(parse_channel("input_angle=c:deg"), modulus=360.0)
    with pytest.raises(RunFileError, match=r"line 3.*361.*360"):
        run_import(tmp_path, "c\n0\n361\n", ImportOptions(channels=(source,), rate=10.0))


def test_no_time_base(tmp_path: Path) -> None:
    recording = imported(
        tmp_path, "a;i\n0;1\n1;2\n", options("input_angle=a:deg", "current=i:A", no_time=True)
    )
    assert recording.metadata.time_base == "none"
    assert np.isnan(recording.metadata.sample_rate)


def test_calendar_time_is_recognised(tmp_path: Path) -> None:
    recording = imported(tmp_path, "t,angle,M\n1714972089.25,0,0\n1714972090.25,1,1\n")
    assert recording.metadata.start_time == "2024-05-06T05:08:09.250+00:00"


BAD_ROWS = [
    ("0.0,0,10\n0.5,,-2.5\n1.0,180,1", r"line 3, column angle: the cell is empty"),
    ("0.0,0,10\n0.5,nan,-2.5\n1.0,180,1", r"line 3, column angle: not finite; value 'nan'"),
    ("0.0,0,10\n0.5,90,inf\n1.0,180,1", r"line 3, column M: not finite; value 'inf'"),
    ("0.0,0,10\n0.5,9o,1\n1.0,180,1", r"line 3, column angle: not a number; value '9o'"),
    ("0.0,0,10\n0.5,1_000,1\n1.0,180,1", r"line 3, column angle: not a number; value '1_000'"),
    ("0.0,0,10\n0.5,90\n1.0,180,1", r"line 3: the line has 2 cells, the table 3"),
    ("0.0,0,10\n0.5,90,1,7\n1.0,180,1", r"line 3: the line has 4 cells, the table 3"),
    ("0.0,0,10\n0.0,90,1\n1.0,180,1", r"line 3, column t: the time does not increase; value 0.0"),
    (
        "0.0,0,10\n0.5,90,1\n0.25,91,1\n1.0,180,1",
        r"line 4, column t: the time does not increase; value 0.25",
    ),
    ("0.0,0,10\n1e300,90,1\n1.0,180,1", r"line 3, column t: beyond any calendar"),
    ("0.0,0,10\n0.5,1e999,1\n1.0,180,1", r"line 3, column angle: not finite"),
]


@pytest.mark.parametrize(("rows", "message"), BAD_ROWS)
def test_bad_rows_are_named(tmp_path: Path, rows: str, message: str) -> None:
    with pytest.raises(RunFileError, match=message) as caught:
        run_import(tmp_path, "t,angle,M\n" + rows + "\n", options())
    assert "--drop-bad-rows" in str(caught.value)
    assert "foreign.csv" in str(caught.value)
    assert not list((tmp_path / "runs").glob("*.h5*"))


@pytest.mark.parametrize(("rows", "message"), BAD_ROWS)
def test_bad_rows_are_left_out_counted_and_listed(tmp_path: Path, rows: str, message: str) -> None:
    done = run_import(tmp_path, "t,angle,M\n" + rows + "\n", options(drop_bad_rows=True))
    assert (done.dropped, done.rows) == (1, rows.count("\n"))
    recording = open_run(done.path)
    assert recording.time()[-1] == 1.0
    assert any("1 rows left out: line" in event.text for event in recording.events)
    assert isinstance(recording.source, FileSource)
    assert np.diff(recording.source.cycles(0, 9)).max() == 2
    assert any(
        f.what == "rows" and "1 cycles never became a row" in f.found for f in verify_run(done.path)
    )


def test_a_bad_row_in_a_later_batch_is_named_and_leaves_no_file(tmp_path: Path) -> None:
    lines = [f"{k},{k},1" for k in range(40_000)]
    lines[35_000] = "35000,?,1"
    with pytest.raises(RunFileError, match=r"line 35002, column angle: not a number; value '\?'"):
        run_import(tmp_path, "t,angle,M\n" + "\n".join(lines), options())
    assert not list((tmp_path / "runs").glob("*.h5*"))


def test_decimal_commas_do_not_mix_with_points(tmp_path: Path) -> None:
    text = "t;angle;M\n0,0;1,5;1\n0,5;1.234,5;1\n"
    with pytest.raises(
        RunFileError, match=r"line 3, column angle: a point in a number with a decimal comma"
    ):
        run_import(tmp_path, text, options())
    with pytest.raises(RunFileError, match=r"line 2, column t: not a number"):
        run_import(tmp_path, text, options(decimal="."))


@pytest.mark.parametrize(
    ("channels", "changes", "message"),
    [
        (("time=t:s", "input_angle=angle:furlong"), {}, "unit that is not known.*furlong"),
        (
            ("time=t:s", "input_angle=angle:N m"),
            {},
            "input_angle: has a unit of another dimension.*rad",
        ),
        (("time=t:deg", "input_angle=angle:deg"), {}, "time: has a unit of another dimension"),
        (("time=t:s", "torque=M:A"), {}, "needs its scale in N m per A"),
        (("time=t:s", "torque=M:V"), {"torque_constant": 0.2}, "needs its scale in N m per V"),
        (("time=t:s", "input_angle=angle:count"), {}, "counts per revolution"),
        (("time=t:s", "input_angle=angel"), {}, "no such column.*angel.*t, angle, M"),
        (("time=t:s", "input_angle=4"), {}, "no such column"),
        (("time=t:s", "input_angle=0"), {}, "no such column"),
        (("time=t:s",), {}, "no channels are mapped"),
        (("input_angle=angle",), {}, "there is no time.*--rate"),
        (("time=t:s", "input_angle=angle"), {"rate": 100.0}, "must come from one place"),
        (("input_angle=angle",), {"rate": 0.0}, "no sample rate"),
        (("input_angle=angle",), {"rate": float("nan")}, "no sample rate"),
        (("time=t:s", "input_angle=angle", "input_angle=M:deg"), {}, "given twice"),
        (("time=t:s", "input angle=angle:deg"), {}, "not a name for a channel"),
        (("time=t:s", "flags=angle:1"), {}, "not a name for a channel"),
        (("time=t:s", "input_angle=angle:deg"), {"start_time": "yesterday"}, "no date and time"),
        (("time=t:s", "input_angle=angle:deg"), {"decimal": "x"}, "no decimal mark"),
        (
            ("time=t:s", "input_angle=angle:deg"),
            {"segments": (ForeignSegment("a", 5.0, 9.0),)},
            "segment has no rows",
        ),
    ],
)
def test_maps_that_cannot_be_right(
    tmp_path: Path, channels: tuple[str, ...], changes: dict, message: str
) -> None:
    with pytest.raises(RigError, match=message):
        run_import(tmp_path, GOOD, options(*channels, **changes))
    assert not list((tmp_path / "runs").glob("*.h5*"))


@pytest.mark.parametrize(
    "text",
    ["", "=a", "a", "a=", "a=b:c:d:e", "a=b:rad:x", "a=b:rad:nan", "a=b:rad:0", "a=b:rad:inf"],
)
def test_channels_that_are_none(text: str) -> None:
    with pytest.raises(ConfigurationError):
        parse_channel(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has no rows"),
        ("\n\n# x\n", "has no rows"),
        ("t,angle,M\n", "no usable rows"),
        ("t,angle,M\n0,1,2\n", "too short"),
    ],
)
def test_empty_and_too_short_files(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(RunFileError, match=message):
        run_import(tmp_path, text, options())


def test_files_that_are_no_text(tmp_path: Path) -> None:
    with pytest.raises(RunFileError, match="not a text file"):
        run_import(tmp_path, b"MATLAB\0\0\0\1", options())
    with pytest.raises(RunFileError, match="there is no such file"):
        import_csv(tmp_path / "none.csv", options(), lambda: tmp_path / "x.h5")
    with pytest.raises(RunFileError, match="cannot be read"):
        import_csv(tmp_path, options(), lambda: tmp_path / "x.h5")


def test_headings_that_appear_twice_need_a_number(tmp_path: Path) -> None:
    text = "t,x,x\n0,1,2\n1,2,3\n"
    with pytest.raises(ConfigurationError, match="more than one column"):
        run_import(tmp_path, text, options("time=t:s", "input_angle=x:rad"))
    assert imported(tmp_path, text, options("time=t:s", "input_angle=3:rad")).si(
        "input_angle"
    ).tolist() == [2.0, 3.0]


def test_files_without_headings_go_by_number(tmp_path: Path) -> None:
    recording = imported(tmp_path, "0 1.5 7\n1 2.5 8\n", options("time=1:s", "input_angle=2:rad"))
    assert recording.si("input_angle").tolist() == [1.5, 2.5]


def test_implausible_units_are_pointed_out(tmp_path: Path) -> None:
    fast = "t,angle\n" + "".join(f"{k / 1000},{k * 9}\n" for k in range(100))
    done = run_import(tmp_path, fast, options("time=t:s", "input_angle=angle:rad"))
    assert any("turns at up to 9e+03 rad/s" in note for note in done.notes)
    slow = "t,angle\n" + "".join(f"{k * 1000},{k}\n" for k in range(100))
    done = run_import(tmp_path, slow, options("time=t:s", "input_angle=angle:rad"))
    assert any("unit of the time column" in note for note in done.notes)


def test_a_channel_map_in_a_file(tmp_path: Path) -> None:
    path = tmp_path / "map.toml"
    path.write_text(
        '[channels.time]\ncolumn = "t"\nunit = "s"\n[channels.input_angle]\ncolumn = 2\nunit = "deg"\noffset = 0.5\n'
        '[channels.current]\ncolumn = "M"\nunit = "A"\nlong_name = "Iq"\n'
        '[[segments]]\nlabel = "hold"\nstart = 0.5\nstop = 1.5\nsetpoint = 3.0\ndirection = 1\n'
    )
    (run,) = read_channel_map(path)
    recording = imported(tmp_path, GOOD, run.options({}))
    np.testing.assert_allclose(recording.si("input_angle"), np.array([0, np.pi / 2, np.pi]) + 0.5)
    assert recording.signals["current"].long_name == "Iq"
    assert recording.segments == (
        Segment(index=0, label="hold", start=1, stop=3, setpoint=3.0, direction=1, repeat=0),
    )


@pytest.mark.parametrize(
    "text",
    [
        "",
        "x = 1",
        "[channels]\na = 1",
        "[channels.x]",
        "[channels.x]\ncolumn = 1\nunit = 3",
        "segments=3\n[channels.x]\ncolumn=1",
        "[channels.a]\nunit = 'rad'",
        "[channels.a]\ncolumn = 'x'\nscales = 1",
        "[channels.a]\ncolumn = 'x'\nscale = 'big'",
        "[channels.a]\ncolumn = 'x'\nscale = true",
        "[channels.a]\ncolumn = []",
        "[channels.a]\ncolumn = 'x'\n[[segments]]\nlabel = 'a'",
        "channels = 3",
        "[channels.a\n",
        "[channels.a]\ncolumn = 'x'\n[segments]\nlabel = 3",
        "\udcff",
    ],
)
def test_map_files_that_are_none(tmp_path: Path, text: str) -> None:
    path = tmp_path / "map.toml"
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(ConfigurationError):
        read_channel_map(path)


@settings(max_examples=40, derandomize=True)
@given(
    values=st.lists(st.floats(-1e9, 1e9, allow_subnormal=False), min_size=2, max_size=20),
    delimiter=st.sampled_from([",", ";", "\t", "|", " "]),
    comma=st.booleans(),
)
def test_numbers_come_back_exactly(
    tmp_path_factory: pytest.TempPathFactory, values: list[float], delimiter: str, comma: bool
) -> None:
    lines = [f"{index / 8!r}{delimiter}{value!r}" for index, value in enumerate(values)]
    text = "\n".join(lines) + "\n"
    text = text.replace(".", ",") if comma and delimiter != "," else text
    recording = imported(
        tmp_path_factory.mktemp("exact"), text, options("time=1:s", "position=2:m")
    )
    assert recording.si("position").tolist() == values


@pytest.mark.skipif(
    not (DATA / "laas_cogging").is_dir(), reason="recordings of other rigs are not here"
)
def test_a_real_cogging_map(tmp_path: Path) -> None:
    chosen = options("time=Time:s", "input_angle=Position:rad", "current=Iq:A")
    file = DATA / "laas_cogging" / "stopped_data.txt"
    done = import_csv(file, chosen, lambda: claim_run(tmp_path, "import", "laas").path)
    recording = open_run(done.path)
    raw = np.loadtxt(file, delimiter=",", skiprows=1)
    assert done.dropped == 0
    np.testing.assert_array_equal(recording.si("input_angle"), raw[:, 1])
    np.testing.assert_array_equal(recording.si("current"), raw[:, 3])
    np.testing.assert_allclose(recording.time(), raw[:, 0] - raw[0, 0], atol=1e-9)
    assert any("longer than 1.5 times" in note for note in done.notes)


def test_whole_numbers_with_comma_and_blank_are_no_decimal_commas(tmp_path: Path) -> None:
    recording = imported(
        tmp_path, "1, 5, 7\n2, 6, 8\n3, 7, 9\n", options("time=1:s", "input_angle=2:rad")
    )
    assert recording.si("input_angle").tolist() == [5.0, 6.0, 7.0]
