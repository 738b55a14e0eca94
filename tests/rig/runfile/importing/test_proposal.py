"""What a file's columns are is proposed from headings and numbers; what has neither is asked, and never guessed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from rig.commands.import_proposed import settled
from rig.errors import ConfigurationError, RunFileError
from rig.runfile.importing.answers import answered, corrected
from rig.runfile.importing.heading_words import read_heading
from rig.runfile.importing.opening import kind_of, open_tables
from rig.runfile.importing.proposal import propose
from rig.runfile.importing.proposed import Proposal

HEADINGS: tuple[tuple[str, str, str], ...] = (
    ("Time [s]", "time", "s"),
    ("t", "time", ""),
    ("time_ms", "time", "ms"),
    ("Timestamp (us)", "time", "us"),
    ("Position", "position", ""),
    ("Position [mm]", "position", "mm"),
    ("position in mm", "position", "mm"),
    ("Motor Position [deg]", "input_angle", "deg"),
    ("motor_pos_deg", "input_angle", "deg"),
    ("theta_m", "input_angle", ""),
    ("theta_l", "output_angle", ""),
    ("Load angle (rad)", "output_angle", "rad"),
    ("link_side_position", "output_angle", ""),
    ("enc_out", "output_angle", ""),
    ("enc in [counts]", "input_angle", "counts"),
    ("q", "position", ""),
    ("dq", "speed", ""),
    ("Velocity", "speed", ""),
    ("motor speed (r/min)", "input_speed", "r/min"),
    ("output_speed_rpm", "output_speed", "rpm"),
    ("rpm", "speed", "rpm"),
    ("Drehzahl [1/min]", "speed", "1/min"),
    ("VelocityActualValue", "speed", ""),
    ("PositionActualValue", "position", ""),
    ("tau", "torque", ""),
    ("torque_Nm", "torque", "Nm"),
    ("Torque [mN m]", "torque", "mN m"),
    ("Drehmoment [Nm]", "torque", "Nm"),
    ("load_torque", "output_torque", ""),
    ("- arm_1_joint_effort", "torque", ""),
    ("Friction [uN]", "force", "uN"),
    ("Iq", "current", ""),
    ("motor current [A]", "motor_current", "A"),
    ("actual_current_3", "current", ""),
    ("Uq", "voltage", ""),
    ("tool_force", "force", ""),
    ("temp", "housing_temperature", ""),
    ("Room temperature (C)", "ambient_temperature", "C"),
    ("ambient_temp_C", "ambient_temperature", "C"),
    ("output_angle [rad]", "output_angle", "rad"),
    ("phi_dot [rad/s]", "speed", "rad/s"),
    ("speed r/min", "speed", "r/min"),
)
"""Some forty headings as people write them."""


@pytest.mark.parametrize(("heading", "channel", "unit"), HEADINGS)
def test_headings_as_people_write_them(heading: str, channel: str, unit: str) -> None:
    found = read_heading(heading)
    assert (found.channel, found.unit) == (channel, unit)


@pytest.mark.parametrize(
    "heading",
    ["Target velocity", "goal_position", "Error Position", "torque_enable", "Vsupply", "column 4"],
)
def test_what_was_wanted_or_is_no_signal_is_no_channel(heading: str) -> None:
    assert read_heading(heading).channel == ""


Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """A text file of columns."""

    def written(columns: dict[str, np.ndarray], *, headings: bool = True, name: str = "a") -> Path:
        path = tmp_path / f"{name}.csv"
        head = ",".join(columns) if headings else ""
        rows = np.column_stack(list(columns.values()))
        np.savetxt(path, rows, delimiter=",", fmt="%.9g", header=head, comments="")
        if not headings:
            path.write_text(path.read_text(encoding="utf-8").lstrip("\n"), encoding="utf-8")
        return path

    return written


def proposed(*paths: Path) -> Proposal:
    return propose(open_tables(kind_of(paths[0]), paths))


def channels(proposal: Proposal) -> dict[str, tuple[str, str]]:
    return {one.channel: (one.heading, one.unit) for one in proposal.used}


def motion(rows: int = 3000, period: float = 0.002) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, angle [rad], speed [rad/s] of a joint that swings."""
    time = np.arange(rows) * period
    return time, 1.3 * np.sin(1.7 * time), 1.3 * 1.7 * np.cos(1.7 * time)


def robot(joints: int = 6) -> dict[str, np.ndarray]:
    """A log without headings: time, angles, speeds, currents; the third joint moves most."""
    time = np.arange(4000) * 0.008
    random = np.random.default_rng(4)
    angles, speeds, currents = {}, {}, {}
    for joint in range(joints):
        rate, size = 0.3 + 0.1 * joint, 1.2 if joint == 2 else 0.2
        speed = size * rate * np.cos(rate * time + joint)
        angles[f"q{joint}"] = size * np.sin(rate * time + joint)
        speeds[f"d{joint}"] = speed + random.normal(0.0, 1e-4, 4000)
        noise = random.normal(0.0, 0.05, 4000)
        currents[f"i{joint}"] = 0.8 * np.sign(speed) + 1.5 * speed + noise
    return {"t": time, **angles, **speeds, **currents}


def typed(answers: list[str]) -> tuple[Callable[[str], str], Iterator[str]]:
    """Whoever answers so, and what is left of the answers."""
    left = iter(answers)
    return (lambda text: next(left)), left


def test_a_log_without_headings_needs_few_keys(write: Write) -> None:
    found = proposed(write(robot(), headings=False))
    assert [(one.why, one.about) for one in found.questions[:1]] == [("which", "column 4")]
    answers = ["", "rad", "A"]
    assert sum(map(len, answers)) <= 25
    ask, left = typed(answers)
    done = settled(found, ask)
    assert next(left, None) is None
    assert channels(done) == {
        "time": ("column 1", "s"),
        "position": ("column 4", "rad"),
        "speed": ("column 10", "rad/s"),
        "current": ("column 16", "A"),
    }
    assert any("is its derivative (r = 1.000)" in word for word in done.used[1].evidence)


def test_another_joint_may_be_meant(write: Write) -> None:
    found = proposed(write(robot(), headings=False))
    other = answered(found, found.questions[0], "column 2")
    assert channels(other)["position"][0] == "column 2"
    assert channels(other)["torque"][0] == "column 14"
    with pytest.raises(ConfigurationError, match="is none of them"):
        answered(found, found.questions[0], "column 99")


def test_pairs_of_speed_and_torque_are_a_table(write: Write) -> None:
    speed = np.linspace(5.0, 300.0, 40)
    found = proposed(write({"speed": speed, "torque": 0.1 + 1e-4 * speed}))
    assert found.is_table
    answers = ["r/min", "N m"]
    assert sum(map(len, answers)) <= 15
    ask, _ = typed(answers)
    assert channels(settled(found, ask)) == {
        "speed": ("speed", "r/min"),
        "torque": ("torque", "N m"),
    }


@pytest.mark.parametrize(
    ("angle", "speed", "units"),
    [
        (1.0, 30.0 / math.pi, ("rad", "r/min")),
        (180.0 / math.pi, 30.0 / math.pi, ("deg", "r/min")),
        (180.0 / math.pi, 1.0, ("deg", "rad/s")),
        (1.0, 180.0 / math.pi, ("rad", "deg/s")),
        (1.0, 1.0, ("", "")),
    ],
)
def test_units_follow_from_a_pair_where_one_alone_fits(
    write: Write, angle: float, speed: float, units: tuple[str, str]
) -> None:
    time, turned, rate = motion()
    found = proposed(write({"t": time, "pos": angle * turned, "vel": speed * rate}))
    known = channels(found)
    assert (known["position"][1], known["speed"][1]) == units
    assert len(found.questions) == (2 if units == ("", "") else 0)


def test_the_unit_of_one_gives_that_of_the_other(write: Write) -> None:
    time, turned, rate = motion()
    found = proposed(write({"t": time, "pos": turned, "vel": rate}))
    done = answered(found, found.questions[0], "deg")
    assert channels(done)["speed"] == ("vel", "deg/s")
    assert not done.questions


@pytest.mark.parametrize(
    ("ratio", "told"), [(120.0, 120.0), (-121.0, 121.0), (50.0, 50.0), (118.6, math.nan)]
)
def test_two_angles_give_ratio_and_sense(write: Write, ratio: float, told: float) -> None:
    time, turned, _ = motion()
    turned = 40.0 * turned
    columns = {
        "t": time,
        "motor_angle [rad]": turned,
        "load_angle [deg]": turned / ratio * 57.29578,
    }
    found = proposed(write(columns))
    assert found.ratio == told or (math.isnan(found.ratio) and math.isnan(told))
    assert found.output_sense == (1 if ratio > 0 else -1)


@pytest.mark.parametrize("left_out", ["input_angle", "output_angle", "input_speed"])
def test_what_is_left_out_at_the_question_for_its_unit_tells_nothing_more(
    write: Write, left_out: str
) -> None:
    """Its proportion to another was found before, and asks for it no more."""
    time, angle, speed = motion()
    found = proposed(
        write({"t": time, "motor_angle": angle, "motor_vel": speed, "load_angle": angle / 80.0})
    )
    (question,) = (one for one in found.questions if one.about == left_out)
    assert left_out not in channels(answered(found, question, ""))


def test_a_unit_alone_tells_a_torque_and_a_speed(write: Write) -> None:
    t, angle, speed = motion()
    columns = {"Zeit [s]": t, "phi [rad]": angle, "n [U/min]": speed, "M_A/Nm": speed}
    assert channels(proposed(write(columns))) == {
        "time": ("Zeit [s]", "s"),
        "position": ("phi [rad]", "rad"),
        "speed": ("n [U/min]", "U/min"),
        "torque": ("M_A/Nm", "Nm"),
    }
    table = proposed(write({"n_U/min": speed, "M [mNm]": speed}, name="table"))
    assert table.is_table
    assert channels(table) == {"speed": ("n_U/min", "U/min"), "torque": ("M [mNm]", "mNm")}


def test_a_unit_alone_tells_nothing_beside_a_name_and_two_of_it_are_asked_for(write: Write) -> None:
    t, angle, speed = motion()
    named = {"t [s]": t, "torque [Nm]": speed, "M [Nm]": angle, "Target n [rpm]": angle}
    assert channels(proposed(write(named))) == {
        "time": ("t [s]", "s"),
        "torque": ("torque [Nm]", "Nm"),
    }
    several = proposed(write({"t [s]": t, "a [Nm]": speed, "b [Nm]": angle}, name="b"))
    assert [(one.why, one.usual) for one in several.questions] == [
        ("channel", ("a [Nm]", "b [Nm]"))
    ]


def test_dates_are_the_time(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = "".join(f"2026-01-01T00:00:{k:02d}.500,{k}\n" for k in range(40))
    path.write_text(f"timestamp,pos [rad]\n{rows}", encoding="utf-8")
    assert channels(proposed(path))["time"] == ("timestamp", "iso")


def test_a_time_that_is_not_understood_is_named_where_a_rate_is_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time,pos [rad]\n" + "noon,1\nnoon,2\n" * 20, encoding="utf-8")
    (question,) = proposed(path).questions
    assert question.text == "sample rate in Hz (time is no time that is understood)"


def test_a_file_without_rows_is_said_to_have_none(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t [s],pos [rad]\n", encoding="utf-8")
    with pytest.raises(RunFileError, match="has no rows"):
        proposed(path)


def test_counts_ask_how_many_go_round(write: Write) -> None:
    time, turned, _ = motion()
    found = proposed(write({"t": time, "enc in [counts]": np.round(4096 * turned)}))
    (question,) = found.questions
    assert question.why == "counts per revolution"
    with pytest.raises(ConfigurationError, match="no number above 0"):
        answered(found, question, "many")
    (_, source) = answered(found, question, "8192").sources
    assert source.scale == 8192.0


def test_a_time_that_is_no_seconds_is_asked_for(write: Write) -> None:
    time, turned, _ = motion()
    found = proposed(write({"time": 1e3 * time, "pos [rad]": turned}))
    assert [one.about for one in found.questions] == ["time"], "2 a row may be ms as well as s"
    nobody = proposed(write({"pos [rad]": turned}))
    assert [one.why for one in nobody.questions] == ["rate"]


def test_the_name_of_a_file_says_what_its_columns_do_not(write: Write) -> None:
    _, turned, rate = motion()
    both = {"Joint_1": 0.1 * turned, "Joint_2": turned}
    found = proposed(
        write(both, name="pos_read"), write({"Joint_1": rate, "Joint_2": rate}, name="curr_data")
    )
    assert [(one.channel, one.file) for one in found.used] == [("position", "1"), ("current", "2")]
    assert [one.why for one in found.questions] == ["which", "rate", "unit", "unit"]


def test_arrays_of_other_lengths_are_left_out(tmp_path: Path) -> None:
    time, turned, _ = motion()
    path = tmp_path / "a.npz"
    np.savez(path, t=time, pos=turned, gain=np.array([3.0]))
    assert set(channels(proposed(path))) == {"time", "position"}


@pytest.mark.parametrize(
    "rows",
    [
        "",
        "0,0\n",
        "0,0\n" * 40,
        "1e308,-1e308\n" * 40,
        "inf,nan\n" * 40,
        "".join(f"{k * 1e300},{k}\n" for k in range(40)),
        "".join(f"{k},{(-1) ** k}\n" for k in range(40)),
        "".join(f"{k},\n" for k in range(40)),
    ],
)
def test_odd_numbers_are_no_evidence(tmp_path: Path, rows: str) -> None:
    path = tmp_path / "odd.csv"
    path.write_text(f"a,b\n{rows}", encoding="utf-8")
    try:
        found = proposed(path)
    except RunFileError:
        return
    assert not [one for one in found.used if one.channel != "time"]


@pytest.mark.parametrize(
    ("head", "name", "kind"),
    [
        (b"MATLAB 5.0 MAT-file", "a.dat", "mat"),
        (b"\x89HDF\r\n", "a.bin", "hdf5"),
        (b"PAR1....", "a", "parquet"),
        (b"TDSm", "a.x", "tdms"),
        (b"MDF     4.10", "a.mf4", "mdf"),
        (b"\x93NUMPY", "a.npy", "npz"),
        (b'\xef\xbb\xbf {"a": 1}', "a.txt", "json"),
        (b"t,q\n0,1\n", "a.log", "csv"),
        (b"\x00\x00", "old.mat", "mat"),
    ],
)
def test_the_kind_of_a_file_is_in_its_first_bytes(
    tmp_path: Path, head: bytes, name: str, kind: str
) -> None:
    path = tmp_path / name
    path.write_bytes(head)
    assert kind_of(path) == kind


def test_who_knows_better_says_what_a_column_is(write: Write) -> None:
    t, angle, speed = motion()
    made = proposed(write({"time [s]": t, "position [rad]": angle, "x": speed, "tau": -speed}))
    by_heading = {one.heading: one.key for one in made.columns}
    made = corrected(made, by_heading["x"], "position", "deg")
    assert channels(made)["position"] == ("x", "deg")
    assert "as said" in next(one for one in made.used if one.heading == "x").evidence
    assert "position [rad]" not in {one.heading for one in made.used}
    made = corrected(made, by_heading["x"], "", "")
    assert "position" not in channels(made)
    assert made.questions == proposed(write({"tau": t, "time [s]": t}, name="b")).questions
    with pytest.raises(ConfigurationError, match="is no unit of it"):
        corrected(made, by_heading["x"], "speed", "N m")
