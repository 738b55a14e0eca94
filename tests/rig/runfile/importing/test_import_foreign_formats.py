"""Exports of scopes and of LabVIEW as they come: preambles, a column of time for each channel, ragged ends."""

import os
from pathlib import Path

import numpy as np
import pytest

from experiments.recording import Recording
from rig.errors import ConfigurationError, RunFileError
from rig.runfile.importing.channel_map import ImportOptions
from rig.runfile.importing.channel_source import parse_channel
from rig.runfile.importing.convert import Imported
from rig.runfile.read import open_run
from tests.rig.importing import import_csv

DATA = Path(
    os.environ.get("HARMONIC_RIG_DATA", Path(__file__).parents[4].parent / "shared" / "data")
)
SCOPE, LVM = DATA / "twincat_scope", DATA / "labview_lvm"
EXCERPTS = Path(__file__).parents[3] / "data" / "foreign"
NAME = "tc3_scope_3_4_3145_3"


def made(folder: Path, path: Path, *channels: str, **changes: object) -> Imported:
    options = ImportOptions(channels=tuple(map(parse_channel, channels)), **changes)  # type: ignore[arg-type]
    run = folder / f"{len(list(folder.glob('*.h5'))):05d}-import-x.h5"
    return import_csv(path, options, lambda: run)


def imported(folder: Path, path: Path, *channels: str, **changes: object) -> Recording:
    return open_run(made(folder, path, *channels, **changes).path)


def scope_text(delimiter: str = "\t", mark: str = ",") -> str:
    """An export of two channels at 1 ms with one time and one at 0.5 ms with its own, three times as long."""
    head = [
        ["Name", "x"],
        ["File", "x.csv"],
        ["Starttime of export", "132959733843760000", "Montag", "15:56"],
        ["Endtime of export", "132959733853750000", "Montag", "15:56"],
        [],
        [],
        ["Name", "angle", "M", "Name", "fast"],
        ["SampleTime[ms]", "1", "1", "SampleTime[ms]", f"0{mark}5"],
        ["ScaleFactor", "1", "-2", "ScaleFactor", "1"],
        ["Unit", "(None)", "Nm (Torque)", "Unit", "V (Voltage)"],
        [],
    ]
    rows = []
    for k in range(12):
        fast = [f"{0.5 * k:g}".replace(".", mark), f"{k:g}"]
        slow = [str(k), str(10 * k), f"{k / 4:g}".replace(".", mark)] if k < 4 else [" "] * 3
        rows.append([*slow, *fast])
    return "\n".join(delimiter.join(line) for line in [*head, *rows, ["EOF"]]) + "\n"


@pytest.mark.parametrize(("delimiter", "mark"), [("\t", ","), (";", "."), (",", ".")])
def test_a_scope_export(tmp_path: Path, delimiter: str, mark: str) -> None:
    path = tmp_path / "scope.csv"
    path.write_text(scope_text(delimiter, mark))
    recording = imported(tmp_path, path, "input_angle=angle:deg", "torque=M")
    np.testing.assert_allclose(recording.time(), np.arange(4) * 1e-3, atol=1e-12)
    np.testing.assert_allclose(recording.si("input_angle"), np.radians([0, 10, 20, 30]))
    assert recording.si("torque").tolist() == [0.0, 0.25, 0.5, 0.75]
    assert recording.metadata.start_time == "2022-05-02T13:56:24.376+00:00"
    assert recording.metadata.time_base == "device"
    assert any("M: the export states ScaleFactor -2" in event.text for event in recording.events)
    fast = imported(tmp_path, path, "voltage=fast")
    np.testing.assert_allclose(fast.time(), np.arange(12) * 5e-4, atol=1e-12)
    assert fast.si("voltage").tolist() == list(range(12))


def test_blocks_before_the_channels_of_a_scope_export_are_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "scope.csv"
    head, _, rest = scope_text().partition("\n\n\n")
    triggers = "\n".join(f"TriggerGroup\t{k}\nName\tTrigger {k}\nCombine\tAnd\n" for k in range(40))
    # With and without a blank line between.
    path.write_text(f"{head}\n\n{triggers.rstrip()}\n{rest}")
    assert imported(tmp_path, path, "torque=M").si("torque").tolist() == [0.0, 0.25, 0.5, 0.75]
    path.write_text(f"{head}\n\n{triggers}\n\n{rest}")
    recording = imported(tmp_path, path, "input_angle=angle:deg", "torque=M")
    assert recording.si("torque").tolist() == [0.0, 0.25, 0.5, 0.75]
    assert recording.metadata.start_time == "2022-05-02T13:56:24.376+00:00"
    path.write_text(f"{head}\n\n{triggers}\n")
    with pytest.raises(RunFileError, match="begins as a TwinCAT scope export and is none"):
        made(tmp_path, path, "torque=M")


def test_channels_of_other_times_are_never_resampled_unasked(tmp_path: Path) -> None:
    path = tmp_path / "scope.csv"
    path.write_text(scope_text())
    channels = ("torque=M", "voltage=fast")
    with pytest.raises(
        RunFileError, match=r"no row of the other columns has this time; value 0.0005 s"
    ):
        made(tmp_path, path, *channels)
    recording = imported(tmp_path, path, *channels, interpolate=True)
    assert recording.si("voltage").tolist() == [0.0, 2.0, 4.0, 6.0]
    with pytest.raises(ConfigurationError, match=r"has a column of time of its own"):
        made(tmp_path, path, "time=1:ms", "voltage=fast")


def test_a_scope_export_whose_header_is_shifted_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "scope.csv"
    path.write_text(scope_text(",", ".").replace("SampleTime[ms],0.5", "SampleTime[ms],0,5"))
    with pytest.raises(RunFileError, match=r"more cells than there are columns.*delimiter too"):
        made(tmp_path, path, "torque=M")


def lvm_text(kind: str, mark: str = ".") -> str:
    head = f"LabVIEW Measurement\nSeparator\tTab\nDecimal_Separator\t{mark}\nX_Columns\t{kind}\n***End_of_Header***\n\n"
    units = {"No": "N\tm/s^2", "One": "N\tm/s^2", "Multi": "N\t\tm/s^2"}[kind]
    names = {"No": "X_Value\tF\ta", "One": "X_Value\tF\ta", "Multi": "X_Value\tF\tX_Value\ta"}[kind]
    block = f"Channels\t2\nSamples\t3\t3\nY_Unit_Label\t{units}\nX_Dimension\tTime\tTime\nDelta_X\t0.25E-3\t0.25E-3\n"
    rows = []
    for k in range(3):
        x = {"No": ("", ""), "One": (f"{k * 0.25e-3:f}", ""), "Multi": (f"{k * 0.25e-3:f}",) * 2}[
            kind
        ]
        cells = [x[0], f"{k / 2}", *([x[1]] if kind == "Multi" else []), f"{-k / 4}"]
        rows.append("\t".join(cells) + ("\tLOST" if k == 1 else ""))
    text = head + block + "***End_of_Header***\t\n" + names + "\tComment\n" + "\n".join(rows) + "\n"
    return text.replace("0.", f"0{mark}").replace("1.", f"1{mark}") if mark == "," else text


@pytest.mark.parametrize("kind", ["No", "One", "Multi"])
@pytest.mark.parametrize("mark", [".", ","])
def test_a_labview_file(tmp_path: Path, kind: str, mark: str) -> None:
    path = tmp_path / "x.lvm"
    path.write_text(lvm_text(kind, mark))
    done = made(tmp_path, path, "force=F", "acceleration=a")
    recording = open_run(done.path)
    np.testing.assert_allclose(recording.time(), np.arange(3) * 0.25e-3, atol=1e-9)
    assert recording.si("force").tolist() == [0.0, 0.5, 1.0]
    assert recording.si("acceleration").tolist() == [0.0, -0.25, -0.5]
    assert any("1 rows carry a comment" in note and "LOST" in note for note in done.notes)


def test_a_labview_file_with_two_blocks_or_without_a_header_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.lvm"
    path.write_text(lvm_text("One") + "***End_of_Header***\n")
    with pytest.raises(RunFileError, match=r"second block.*"):
        made(tmp_path, path, "force=F")
    path.write_text("LabVIEW Measurement\nSeparator\tTab\n")
    with pytest.raises(RunFileError, match=r"without the header of a measurement"):
        made(tmp_path, path, "force=F")


def test_a_unit_of_the_file_that_is_not_known_is_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "x.lvm"
    path.write_text(lvm_text("One").replace("\tm/s^2", "\tg"))
    with pytest.raises(
        ConfigurationError, match=r'nobody says its unit.*--channel "acceleration=a:'
    ):
        made(tmp_path, path, "acceleration=a")


needs_scope = pytest.mark.skipif(not SCOPE.is_dir(), reason="the scope exports are not here")
needs_lvm = pytest.mark.skipif(not LVM.is_dir(), reason="the LabVIEW files are not here")


@needs_scope
@pytest.mark.parametrize("name", ["noOS.csv", "noOS.csv.gz", "-default.csv", "-DecimalMark_,.csv"])
def test_published_scope_exports_exactly(tmp_path: Path, name: str) -> None:
    path = SCOPE / f"{NAME}{'_' if name.startswith('no') else ''}{name}"
    recording = imported(tmp_path, path, "x=var_REAL64:1", "wrapped=var_INT8:1", "bit=var_BIT:1")
    k = np.arange(1000)
    np.testing.assert_array_equal(recording.si("x"), k)
    np.testing.assert_array_equal(recording.si("wrapped"), (k + 128) % 256 - 128)
    np.testing.assert_array_equal(recording.si("bit"), k > 0)
    np.testing.assert_allclose(recording.time(), k * 1e-3, atol=1e-12)
    assert recording.metadata.sample_rate == pytest.approx(1000.0)


@needs_scope
def test_fast_and_free_channels_of_published_exports(tmp_path: Path) -> None:
    path = SCOPE / f"{NAME}-default.csv"
    fast = imported(tmp_path, path, "x=func_OS:1")
    assert fast.rows == 4996
    np.testing.assert_allclose(fast.si("x"), np.arange(4996) * 0.2, atol=1e-9)
    np.testing.assert_allclose(fast.time(), np.arange(4996) * 2e-4, atol=1e-12)
    free = imported(tmp_path, path, "x=func_freesample:1")
    assert free.rows == 201
    assert free.si("x")[:3].tolist() == [997.0, 2.0, 7.0]
    # Its first sample lies 3 ms before the start of the export.
    assert free.metadata.start_time == "2022-05-02T13:56:24.373+00:00"
    with pytest.raises(RunFileError, match=r"more cells than there are columns"):
        made(tmp_path, SCOPE / f"{NAME}-Seperator_4.csv", "x=var_REAL64:1")


@needs_lvm
def test_published_labview_files_exactly(tmp_path: Path) -> None:
    path = LVM / "long_single_header_multi_ch.lvm"
    long = imported(tmp_path, path, "F=F:1", "m_1=m_1", "m_2=m_2")
    assert long.rows == 16384
    assert long.metadata.sample_rate == pytest.approx(1.0 / 0.000977)
    assert long.si("F")[0] == 0.052530
    means = [round(float(long.si(name).mean()), 6) for name in ("F", "m_1", "m_2")]
    assert means == [0.052415, 0.230589, 0.243345]
    deviations = [round(float(long.si(name).std()), 6) for name in ("F", "m_1", "m_2")]
    # The published third one, 0.231720, is rounded up from 0.2317195.
    assert deviations == pytest.approx([0.203210, 0.171302, 0.231720], abs=1.1e-6)
    for name, columns, first in (
        ("short.lvm", ("a=2:N", "b=3:m/s2"), [0.914018, 1.204792]),
        ("no_decimal_separator.lvm", ("a=ax:1",), [-0.008807]),
        ("multi_time_column.lvm", ("a=Voltage", "b=Acceleration:1"), [-0.035229, 0.532608]),
        ("with_comments.lvm", ("a=2", "b=3"), [1833787.0, 5.479238]),
        ("with_empty_fields.lvm", ("a=8:V",), [-0.011923]),
    ):
        recording = imported(tmp_path, LVM / name, *columns)
        assert [float(recording.si(c[0])[0]) for c in columns] == first


def test_excerpts_that_stand_in_the_repository(tmp_path: Path) -> None:
    """The beginnings of published files, with their notices beside them."""
    scope = imported(tmp_path, EXCERPTS / "twincat_scope_default.csv", "x=func_OS:1", "y=func_OS:1")
    np.testing.assert_allclose(scope.si("x"), np.arange(scope.rows) * 0.2, atol=1e-9)
    short = imported(tmp_path, EXCERPTS / "labview_short.lvm", "force=2", "acceleration=3")
    assert short.rows == 10
    assert [short.si("force")[0], short.si("acceleration")[0]] == [0.914018, 1.204792]
    tribometer = imported(
        tmp_path,
        EXCERPTS / "tribometer.txt",
        "time=Time",
        "position=Position",
        "force=Friction:uN:-1",
    )
    assert tribometer.si("position")[0] == pytest.approx(-0.1100355)
    assert tribometer.si("force")[0] == pytest.approx(-242.2e-6)
