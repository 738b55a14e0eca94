"""Foreign files that are broken, and maps that lie: each is refused by name, or no wrong number is called "yes"."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io

from experiments import catalogue
from experiments.contract import Evidence
from experiments.errors import AnalysisError
from experiments.recording import Recording
from model.gear_file import shipped_gear
from rig.errors import RigError
from rig.runfile.importing.channel_map import ImportOptions
from rig.runfile.importing.channel_source import ChannelSource, parse_channel
from rig.runfile.importing.convert import import_tables
from rig.runfile.importing.opening import open_tables
from rig.runfile.read import open_run

RATE = 250.0
ROWS = 2000
TRUTH = {"inertia": 0.05, "viscous": 0.02, "coulomb": 0.3}
"""kg m2, N m s/rad, N m of the recording that is broken here."""
CHANNELS = ("time=t", "input_angle=q", "torque=M")


class Broken:
    """A recording of a motion as a text with headings, the map that it is read with, and more files beside it."""

    def __init__(self) -> None:
        time = np.arange(ROWS) / RATE
        speed = 10.0 * np.sin(3.0 * time) + 4.0 * np.sin(7.3 * time)
        acceleration = 30.0 * np.cos(3.0 * time) + 29.2 * np.cos(7.3 * time)
        self.angle = -10.0 / 3.0 * np.cos(3.0 * time) - 4.0 / 7.3 * np.cos(7.3 * time)
        self.torque = TRUTH["inertia"] * acceleration + TRUTH["viscous"] * speed
        self.torque += TRUTH["coulomb"] * np.sign(speed)
        self.time = time
        self.headings = ["t [s]", "q [rad]", "M [N m]"]
        self.channels: list[str] = list(CHANNELS)
        self.options: dict[str, Any] = {}
        self.lines = self.rows(self.time, self.angle, self.torque)
        self.others: dict[str, str] = {}
        self.packed = False

    @staticmethod
    def rows(*columns: np.ndarray) -> list[str]:
        """The lines of these columns."""
        return [",".join(f"{x:.9g}" for x in row) for row in zip(*columns, strict=True)]

    def text(self) -> str:
        """The file."""
        return "\n".join([",".join(self.headings), *self.lines]) + "\n"


def bring(
    folder: Path, broken: Broken, stated: dict[str, dict[str, Any]] | None = None
) -> Recording:
    """The recording, with what is `stated` of a channel beside its column."""
    paths = [folder / "broken.csv"]
    content = broken.text().encode()
    paths[0].write_bytes(gzip.compress(content)[:-40] if broken.packed else content)
    for name, text in broken.others.items():
        paths.append(folder / name)
        paths[-1].write_text(text)
    channels = tuple(parse_channel(text) for text in broken.channels)
    options = ImportOptions(**{"channels": channels, **broken.options})
    said = [replace(c, **(stated or {}).get(c.name, {})) for c in options.channels]
    options = replace(options, channels=tuple(said))
    tables = open_tables("csv", paths, options)
    return open_run(import_tables(tables, options, lambda: folder / "00001-import-x.h5").path)


def no_unit(b: Broken) -> None:
    b.headings[1] = "q"


def no_unit_of_the_torque(b: Broken) -> None:
    b.headings[2] = "M"


def no_unit_of_the_time(b: Broken) -> None:
    b.headings[0] = "t"


def a_unit_that_is_none(b: Broken) -> None:
    b.headings[2] = "M [ticks of oil]"


def another_unit_than_the_heading(b: Broken) -> None:
    b.headings[1] = "q [deg]"
    b.channels[1] = "input_angle=q:rad"


def another_unit_of_time_than_the_heading(b: Broken) -> None:
    b.headings[0] = "t [ms]"
    b.channels[0] = "time=t:s"


def torque_out_of_the_column_of_the_angle(b: Broken) -> None:
    b.channels[2] = "torque=q"


def a_speed_as_a_position(b: Broken) -> None:
    b.headings[1] = "v [rad/s]"
    b.channels[1] = "position=v"


def a_current_without_a_constant(b: Broken) -> None:
    b.headings[2] = "M [A]"


def counts_without_a_scale(b: Broken) -> None:
    b.channels[1] = "input_angle=q:count"
    b.headings[1] = "q"


def counts_that_are_none(b: Broken) -> None:
    b.headings[1] = "q"
    b.channels[1] = "input_angle=q:count:4096"


def a_scale_of_nothing(b: Broken) -> None:
    b.channels[1] = "input_angle=q:rad:0"


def _wrapped(b: Broken, low: float, range_: float, scale: float = 1.0) -> None:
    values = (b.angle * scale - low) % range_ + low
    b.lines = b.rows(b.time, values, b.torque)


def wrapped_at_360_degrees(b: Broken) -> None:
    b.headings[1] = "q [deg]"
    _wrapped(b, 0.0, 360.0, 180.0 / np.pi)


def wrapped_at_half_a_turn(b: Broken) -> None:
    _wrapped(b, -np.pi, 2.0 * np.pi)


def wrapped_counts(b: Broken) -> None:
    b.headings[1] = "q"
    counts = np.rint(b.angle / (2 * np.pi) * 40000.0) % 16384
    b.lines = b.rows(b.time, counts, b.torque)
    b.channels[1] = "input_angle=q:count:40000"


def a_modulus_that_is_too_small(b: Broken) -> None:
    wrapped_at_360_degrees(b)
    b.channels[1] = "input_angle=q"
    b.options["channels"] = _with_modulus(b, 90.0)


def a_modulus_that_is_too_large(b: Broken) -> None:
    wrapped_at_360_degrees(b)
    b.options["channels"] = _with_modulus(b, 1000.0)


def _with_modulus(b: Broken, modulus: float) -> tuple[ChannelSource, ...]:
    from dataclasses import replace

    time, angle, torque = map(parse_channel, b.channels)
    return time, replace(angle, modulus=modulus), torque


def time_that_goes_back(b: Broken) -> None:
    b.lines[700], b.lines[701] = b.lines[701], b.lines[700]


def a_row_twice(b: Broken) -> None:
    b.lines.insert(700, b.lines[700])


def a_time_that_starts_again(b: Broken) -> None:
    b.lines = b.rows(b.time % 4.0, b.angle, b.torque)


def no_number(b: Broken) -> None:
    b.lines[700] = "2.8,nan,0.1"


def an_empty_cell(b: Broken) -> None:
    b.lines[700] = "2.8,,0.1"


def a_word_in_a_cell(b: Broken) -> None:
    b.lines[700] = "2.8,Overflow,0.1"


def a_line_cut_short(b: Broken) -> None:
    b.lines[700] = b.lines[700][:9]


def two_lines_in_one(b: Broken) -> None:
    b.lines[700] += b.lines.pop(701)


def headings_in_the_middle(b: Broken) -> None:
    b.lines.insert(700, ",".join(b.headings))


def two_columns_of_one_name(b: Broken) -> None:
    b.headings[2] = "q [rad]"
    b.channels = ["time=t", "input_angle=q"]


def decimal_commas_among_points(b: Broken) -> None:
    b.headings = [";".join(b.headings)]
    b.lines = [line.replace(",", ";") for line in b.lines]
    b.lines[900:] = [line.replace(".", ",") for line in b.lines[900:]]


def an_archive_cut_short(b: Broken) -> None:
    b.packed = True


def both_angles_and_no_sense(b: Broken) -> None:
    b.channels[2] = "output_angle=M"
    b.headings[2] = "M [rad]"
    b.options["ratio"] = 100.0


def the_other_side_without_a_ratio(b: Broken) -> None:
    from dataclasses import replace

    time, angle, torque = map(parse_channel, b.channels)
    b.options["channels"] = (time, replace(angle, side="output"), torque)


def a_rate_beside_the_times(b: Broken) -> None:
    b.options["rate"] = 100.0


def a_second_file_that_is_shorter(b: Broken) -> None:
    b.others["second.csv"] = "t [s],current [A]\n" + "\n".join(b.rows(b.time[:-5], b.torque[:-5]))
    b.channels = ["time=t", "input_angle=q", "current=current"]


def a_second_file_of_another_clock(b: Broken) -> None:
    b.others["second.csv"] = "t [s],current [A]\n" + "\n".join(b.rows(b.time + 7e-4, b.torque))
    b.channels = ["time=t", "input_angle=q", "current=current"]


def a_channel_in_both_files(b: Broken) -> None:
    b.others["second.csv"] = b.text()


REFUSED: tuple[tuple[Callable[[Broken], None], str], ...] = (
    (no_unit, r"input_angle, column q: nobody says its unit"),
    (no_unit_of_the_torque, r"torque, column M: nobody says its unit"),
    (no_unit_of_the_time, r"time, column t: nobody says its unit"),
    (a_unit_that_is_none, r"torque, column M: nobody says its unit"),
    (another_unit_than_the_heading, r"another unit than its heading says; value rad, allowed deg"),
    (
        another_unit_of_time_than_the_heading,
        r"another unit than its heading says; value s, allowed ms",
    ),
    (torque_out_of_the_column_of_the_angle, r"torque: has a unit of another dimension; value rad"),
    (a_speed_as_a_position, r"position: has a unit of another dimension; value rad/s"),
    (a_current_without_a_constant, r"needs its scale in N m per A"),
    (counts_without_a_scale, r"counts per revolution"),
    (counts_that_are_none, r"line 2, column q: input_angle is no whole count"),
    (a_scale_of_nothing, r"input_angle.scale: is not usable"),
    (wrapped_at_360_degrees, r"wrapped.*--modulus input_angle=360"),
    (wrapped_at_half_a_turn, r"wrapped.*--modulus input_angle=6.28"),
    (wrapped_counts, r"wrapped.*--modulus input_angle=16384"),
    (a_modulus_that_is_too_small, r"beyond the range after which it should wrap"),
    (a_modulus_that_is_too_large, r"jumps as if it were wrapped"),
    (time_that_goes_back, r"line 703, column t \[s\]: the time does not increase"),
    (a_row_twice, r"line 703, column t \[s\]: the time does not increase"),
    (a_time_that_starts_again, r"line 1002, column t \[s\]: the time does not increase"),
    (no_number, r"line 702, column q \[rad\]: not finite"),
    (an_empty_cell, r"line 702, column q \[rad\]: the cell is empty"),
    (a_word_in_a_cell, r"line 702, column q \[rad\]: not a number; value 'Overflow'"),
    (a_line_cut_short, r"line 702: the line has \d cells, the table 3"),
    (two_lines_in_one, r"line 702: the line has 5 cells, the table 3"),
    (headings_in_the_middle, r"line 702, column t \[s\]: not a number"),
    (two_columns_of_one_name, r"more than one column of this name"),
    (decimal_commas_among_points, r"line 902, column t \[s\]: not a number"),
    (an_archive_cut_short, r"is damaged|cannot be read"),
    (both_angles_and_no_sense, r"--output-sense"),
    (the_other_side_without_a_ratio, r"taken at the output, and the ratio is not known"),
    (a_rate_beside_the_times, r"the time must come from one place"),
    (a_second_file_that_is_shorter, r"no row of the other columns has this time; value 7.98 s"),
    (a_second_file_of_another_clock, r"no row of the other columns has this time"),
    (a_channel_in_both_files, r"more than one of the files has this column"),
)
"""What is done to a file or to its map, and what names it."""


@pytest.mark.parametrize(("act", "words"), [pytest.param(a, w, id=a.__name__) for a, w in REFUSED])
def test_a_broken_import_is_refused_by_name(
    tmp_path: Path, act: Callable[[Broken], None], words: str
) -> None:
    broken = Broken()
    act(broken)
    with pytest.raises(RigError, match=words):
        bring(tmp_path, broken)
    assert not list(tmp_path.glob("*.h5*"))


def test_there_are_thirty_of_them() -> None:
    assert len({act for act, _ in REFUSED}) >= 30


def rows_left_out(b: Broken) -> None:
    an_empty_cell(b)
    b.options["drop_bad_rows"] = True


def unwrapped(b: Broken) -> None:
    wrapped_at_360_degrees(b)
    b.options["channels"] = _with_modulus(b, 360.0)


def joined_by_lines(b: Broken) -> None:
    """The torque of another clock, on the times of the angle."""
    later = b.time + 7e-4
    b.others["second.csv"] = "t [s],N [N m]\n" + "\n".join(
        b.rows(later, np.interp(later, b.time, b.torque))
    )
    b.channels[2] = "torque=N"
    b.options["interpolate"] = True


@pytest.mark.parametrize("act", [rows_left_out, unwrapped, joined_by_lines])
def test_what_is_mended_as_asked_for_gives_no_wrong_number(
    tmp_path: Path, act: Callable[[Broken], None]
) -> None:
    broken = Broken()
    act(broken)
    # A scale that nobody states is assumed, and nothing that rests on it is "yes".
    recording = bring(tmp_path, broken, stated={"torque": {"scale_uncertainty": 0.001}})
    result = catalogue.load("motion").analyse(recording, Evidence(shipped_gear()))
    said = {name: result.estimates[name] for name in TRUTH}
    assert any(estimate.identifiable == "yes" for estimate in said.values())
    for name, estimate in said.items():
        if estimate.identifiable == "yes":
            error = abs(estimate.value - TRUTH[name])
            assert error <= max(estimate.expanded_uncertainty, 0.05 * TRUTH[name]), name


@pytest.mark.parametrize(
    ("channels", "changes", "lacks"),
    [
        (CHANNELS[:2], {}, "torque"),
        ((CHANNELS[0], CHANNELS[2]), {}, "input_angle"),
        (CHANNELS[1:], {"no_time": True}, "time base"),
    ],
)
def test_what_a_recording_lacks_is_named_by_its_analysis(
    tmp_path: Path, channels: tuple[str, ...], changes: dict[str, Any], lacks: str
) -> None:
    broken = Broken()
    broken.channels, broken.options = list(channels), changes
    with pytest.raises(AnalysisError, match=lacks):
        catalogue.load("motion").analyse(bring(tmp_path, broken), Evidence(shipped_gear()))


def test_a_file_of_another_kind_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    scipy.io.savemat(path, {"t": np.arange(5.0)}, appendmat=False)
    with pytest.raises(RigError, match=r"not a text file.*rig import mat"):
        open_tables("csv", [path])
