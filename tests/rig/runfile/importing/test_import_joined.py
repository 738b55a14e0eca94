"""Several files of one run: joined where their times are equal, resampled only when that is asked for."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.errors import ConfigurationError, RunFileError
from rig.runfile.importing.adapters.table import BATCH_ROWS
from rig.runfile.importing.channel_map import ImportOptions, SegmentsFrom, read_channel_map
from rig.runfile.importing.channel_source import parse_channel
from rig.runfile.importing.convert import Imported, import_tables
from rig.runfile.importing.opening import open_tables
from rig.runfile.read import open_run

Join = Callable[..., Imported]


@pytest.fixture
def join(tmp_path: Path) -> Join:
    def of(
        texts: dict[str, str],
        *channels: str,
        options: ImportOptions | None = None,
        name: str = "00001-import-x.h5",
        **changes: object,
    ) -> Imported:
        paths = []
        for file, text in texts.items():
            paths.append(tmp_path / file)
            paths[-1].write_text(text)
        if options is None:
            options = ImportOptions(channels=tuple(map(parse_channel, channels)), **changes)  # type: ignore[arg-type]
        tables = open_tables("csv", paths, options)
        return import_tables(tables, options, lambda: tmp_path / name)

    return of


def rows(times: list[float], scale: float = 1.0) -> str:
    return "t [s],x\n" + "".join(f"{t!r},{scale * t!r}\n" for t in times)


EVEN = [k * 0.01 for k in range(40)]
CHANNELS = ("time=t", "position=x@a:m", "force=x@b.csv:N")


def test_equal_times_join_row_by_row(join: Join) -> None:
    long = [k * 0.01 for k in range(40_000)]
    made = join({"a.csv": rows(long), "b.csv": rows(long, -2.0)}, *CHANNELS)
    recording = open_run(made.path)
    assert made.rows == 40_000
    np.testing.assert_array_equal(recording.si("force"), -2.0 * np.array(long))
    assert recording.metadata.process["source_file"] == "a.csv, b.csv"


def test_a_time_that_only_one_has_is_named(join: Join) -> None:
    texts = {"a.csv": rows(EVEN), "b.csv": rows([*EVEN[:7], *EVEN[8:]])}
    with pytest.raises(
        RunFileError, match=r"a\.csv, line 9, position: no row of the other.*0\.07 s"
    ):
        join(texts, *CHANNELS)
    made = join(texts, *CHANNELS, drop_bad_rows=True)
    assert (made.rows, made.dropped) == (39, 1)


def test_other_times_are_brought_over_by_lines_when_asked(join: Join) -> None:
    shifted = [t + 0.003 for t in EVEN]
    texts = {"a.csv": rows(EVEN), "b.csv": rows(shifted, 3.0)}
    with pytest.raises(RunFileError, match=r"--interpolate"):
        join(texts, *CHANNELS)
    made = join(texts, *CHANNELS, interpolate=True)
    recording = open_run(made.path)
    # The first sample of a lies before the first of b.
    assert (made.rows, made.dropped) == (39, 1)
    np.testing.assert_allclose(recording.si("force"), 3.0 * np.array(EVEN[1:]), atol=1e-12)


def test_nothing_is_interpolated_across_a_gap(join: Join) -> None:
    shifted = [t + 0.003 for t in EVEN if not 0.1 < t < 0.2]
    made = join({"a.csv": rows(EVEN), "b.csv": rows(shifted)}, *CHANNELS, interpolate=True)
    times = open_run(made.path).si("position")
    assert not ((times > 0.104) & (times < 0.202)).any()
    assert len(times) == 29


def test_how_long_a_gap_is_can_be_said(join: Join) -> None:
    """A logger that skips every third sample has no gaps; the same steps are some of 1.5 usual ones."""
    jittering = [t for k, t in enumerate(EVEN) if k % 3]
    texts = {"a.csv": rows(EVEN), "b.csv": rows(jittering)}
    usual = join(texts, *CHANNELS, interpolate=True)
    bridged = join(texts, *CHANNELS, interpolate=True, gap=3.0, name="00002-import-x.h5")
    assert bridged.rows > usual.rows
    assert np.diff(open_run(bridged.path).si("position")).max() < 0.011
    for words in (0.5, 1.0, math.nan):
        with pytest.raises(ConfigurationError, match=r"--gap.*> 1 usual step"):
            join(texts, *CHANNELS, interpolate=True, gap=words)


def test_a_gap_between_two_blocks_of_a_long_file_is_counted(join: Join) -> None:
    times = np.arange(BATCH_ROWS + 1000) * 1e-3
    times[BATCH_ROWS:] += 0.5
    text = "t [s],x [N]\n" + "\n".join(f"{t:.3f},1.0" for t in times)
    counted = [
        note
        for note in join({"a.csv": text}, "time=t", "force=x").notes
        if "longer than 1.5 times" in note
    ]
    assert counted == ["WARNING: 1 steps of the time are longer than 1.5 times the usual one"]


SHIFTED = [t + 0.003 for t in EVEN]
TIME_AND_FORCE = ("time=t", "force=x@b.csv:N")


@pytest.mark.parametrize(
    ("angle", "why"),
    [("x@a:count:4096", "is counted"), ("x@a:deg", "is wrapped")],
)
def test_no_line_is_drawn_between_counts_nor_across_a_range(
    join: Join, angle: str, why: str
) -> None:
    counts = "t [s],x\n" + "".join(f"{t!r},{k}\n" for k, t in enumerate(EVEN))
    texts = {"a.csv": counts, "b.csv": rows(SHIFTED)}
    modulus = {} if "count" in angle else {"modulus": 360.0}
    source = replace(parse_channel(f"input_angle={angle}"), **modulus)
    time, force = map(parse_channel, TIME_AND_FORCE)
    refused = ImportOptions(channels=(time, force, source), interpolate=True)
    with pytest.raises(
        ConfigurationError, match=rf"--interpolate, input_angle: {why}.*first channel"
    ):
        join(texts, options=refused)
    # As the first channel its own samples stay, and the force is brought onto them.
    made = join(texts, options=replace(refused, channels=(time, source, force)))
    assert made.rows == 39


def test_no_line_is_drawn_between_labels(join: Join) -> None:
    options = ImportOptions(
        channels=tuple(map(parse_channel, ("time=t", "force=x@a:N"))),
        segments_from=SegmentsFrom(column="x", file="b.csv", labels={"1": "traverse"}),
        interpolate=True,
    )
    with pytest.raises(ConfigurationError, match="--interpolate, label: holds labels"):
        join({"a.csv": rows(EVEN), "b.csv": rows(SHIFTED)}, options=options)


def test_no_line_is_drawn_across_a_jump_that_nobody_told_of(join: Join) -> None:
    """Fine times of the first channel would make a ramp of the jump, and nothing would notice it."""
    fine = [k * 0.001 for k in range(400)]
    wrapped = "t [s],x\n" + "".join(f"{t!r},{(k * 15.0) % 360.0!r}\n" for k, t in enumerate(EVEN))
    texts = {"a.csv": rows(fine), "b.csv": wrapped}
    with pytest.raises(RunFileError, match=r"b\.csv, line 26, .*jumps as if it were wrapped"):
        join(texts, "time=t", "force=x@a:N", "input_angle=x@b:deg", interpolate=True)


def test_rows_without_times_join_by_their_number(join: Join) -> None:
    text = "x\n" + "".join(f"{k}\n" for k in range(30))
    made = join({"a.csv": text, "b.csv": text}, *CHANNELS[1:], rate=100.0)
    assert made.rows == 30
    made.path.unlink()
    with pytest.raises(RunFileError, match=r"line 31, force: no row .*number; value row 30"):
        join({"a.csv": text[: text.index("29")], "b.csv": text}, *CHANNELS[1:], rate=100.0)


@pytest.mark.parametrize(
    ("channel", "message"),
    [
        ("position=x:m", r"more than one of the files has this column.*x@FILE"),
        ("position=y:m", r"no file has this column"),
        ("position=x@c:m", r"no such file among those.*1 a\.csv, 2 b\.csv"),
    ],
)
def test_which_file_is_meant_must_be_clear(join: Join, channel: str, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        join({"a.csv": rows(EVEN), "b.csv": rows(EVEN)}, "time=t", channel)


def test_a_hole_in_one_file_is_named_there(join: Join) -> None:
    texts = {"a.csv": rows(EVEN), "b.csv": rows(EVEN).replace("0.05,0.05\n", "0.05,?\n")}
    with pytest.raises(RunFileError, match=r"b\.csv, line 7, column x: not a number"):
        join(texts, *CHANNELS)
    made = join(texts, *CHANNELS, drop_bad_rows=True)
    assert made.rows == 39


MAP = """
[channels.time]
column = "t"
unit = "s"
[channels.position]
column = "x"
file = "a"
unit = "m"
[channels.force]
column = "x"
file = "2"
unit = "N"
[files."b.csv"]
skip = 3
delimiter = "semicolon"
decimal = ","
time_unit = "ms"
"""


def test_each_file_of_a_run_may_have_a_form_and_a_time_unit_of_its_own(
    join: Join, tmp_path: Path
) -> None:
    other = "made by;a logger\n1;2\n3;4\nt;x\n"
    other += "".join(f"{1e3 * t:.0f};{-2.0 * t!r}\n".replace(".", ",") for t in EVEN)
    (tmp_path / "map.toml").write_text(MAP)
    (of_map,) = read_channel_map(tmp_path / "map.toml")
    made = join(
        {"a.csv": rows(EVEN).replace(" [s]", ""), "b.csv": other}, options=of_map.options({})
    )
    np.testing.assert_array_equal(open_run(made.path).si("force"), -2.0 * np.array(EVEN))
    assert made.rows == len(EVEN)


def test_what_is_said_of_a_file_that_is_not_there_is_refused(join: Join, tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(MAP.replace("b.csv", "c.csv"))
    (of_map,) = read_channel_map(tmp_path / "map.toml")
    with pytest.raises(ConfigurationError, match=r"files\.c\.csv.*1 a\.csv, 2 b\.csv"):
        join({"a.csv": rows(EVEN), "b.csv": rows(EVEN)}, options=of_map.options({}))


def test_a_wrap_that_falls_into_a_short_gap_is_a_wrap_all_the_same(join: Join) -> None:
    """A logger that left out a row or two: the angle cannot have gone back by a turn in that time."""
    times = np.delete(np.arange(400) * 0.01, 200)
    angle = np.mod(90.0 * times + 0.1 - 180.0, 360.0)
    assert angle[199] - angle[200] > 300.0
    text = "t [s],q [deg]\n" + "\n".join(
        f"{t:.3f},{a:.6f}" for t, a in zip(times, angle, strict=True)
    )
    with pytest.raises(RunFileError, match="jumps as if it were wrapped"):
        join({"a.csv": text}, "time=t", "position=q")
