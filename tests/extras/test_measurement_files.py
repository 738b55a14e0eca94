"""Parquet, TDMS and MDF: written by their own packages, imported with units, times and starts as the files say them."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from nptdms import ChannelObject, RootObject, TdmsWriter

import rig
from rig.errors import RunFileError
from rig.runfile.importing.opening import open_table
from tests.rig.runfile.importing import ugly

ROWS = 40_000
"""More than two batches."""
STEP_NS = 500_000
TIME = np.arange(ROWS) * 5e-4
ANGLE = 30.0 * TIME
TORQUE = np.round(np.sin(TIME), 6)
START = datetime(2025, 11, 21, 8, 30, tzinfo=UTC)
START_NS = int(START.timestamp()) * 10**9
STARTED = np.datetime64("2025-11-21T08:30:00")
OIL, LINK = "oil changed on Monday", "behind the gear"
"""What stands in a file beside its numbers."""
CHANNELS = {"position": "q", "torque": "M:N m"}


def parquet_file(path: Path) -> None:
    stamps = pa.array(START_NS + np.arange(ROWS) * STEP_NS, pa.timestamp("ns", tz="UTC"))
    schema = pa.schema(
        [
            pa.field("stamp", stamps.type),
            pa.field("q", pa.float64(), metadata={"unit": "deg"}),
            pa.field("M", pa.float32()),
            pa.field("name", pa.string()),
        ]
    )
    columns = [stamps, pa.array(ANGLE), pa.array(TORQUE, pa.float32()), pa.array(["x"] * ROWS)]
    pq.write_table(pa.table(columns, schema=schema), path, row_group_size=30_000)


def tdms_file(path: Path) -> None:
    wave = {"wf_increment": 5e-4, "wf_start_offset": 0.0, "wf_start_time": STARTED}
    with TdmsWriter(path) as file:
        for part in (slice(0, 25_000), slice(25_000, ROWS)):
            said = {**wave, "unit_string": "deg", "description": LINK}
            file.write_segment(
                [
                    RootObject({"comment": OIL}),
                    ChannelObject("log", "q", ANGLE[part], said),
                    ChannelObject("log", "M", TORQUE[part], wave),
                    ChannelObject("log", "name", ["x", "y"]),
                ]
            )


def mdf_file(path: Path) -> None:
    version = "4.10" if path.suffix == ".mf4" else "3.30"
    import asammdf

    with asammdf.MDF(version=version) as file:
        file.header.start_time = START
        file.header.comment = OIL
        file.append(
            [
                asammdf.Signal(ANGLE, TIME, unit="deg", name="q", comment=LINK),
                asammdf.Signal(TORQUE, TIME, unit="Nm", name="M"),
            ]
        )
        slow = TIME[::100]
        file.append([asammdf.Signal(20.0 + slow, slow, unit="degC", name="T")])
        file.save(path, overwrite=True)


WRITERS: dict[str, tuple[str, Callable[[Path], None]]] = {
    "parquet": ("bench.parquet", parquet_file),
    "tdms": ("bench.tdms", tdms_file),
    "mdf": ("bench.mf4", mdf_file),
}
READERS: dict[str, Callable[..., rig.Run]] = {
    "parquet": rig.read_parquet,
    "tdms": rig.read_tdms,
    "mdf": rig.read_mdf,
}


def ugly_parquet(path: Path) -> None:
    names = ("time [s]", "angle [rad]", "torque [N m]")
    columns = dict(zip(names, (ugly.TIME, ugly.ANGLE, ugly.TORQUE), strict=True))
    pq.write_table(pa.table(columns), path)


def ugly_tdms(path: Path) -> None:
    wave = {"wf_increment": 4e-3, "wf_start_offset": 0.0, "wf_start_time": STARTED}
    angle, torque = {**wave, "unit_string": "rad"}, {**wave, "unit_string": "N m"}
    with TdmsWriter(path) as file:
        channels = [
            ChannelObject("log", "angle", ugly.ANGLE, angle),
            ChannelObject("log", "torque", ugly.TORQUE, torque),
        ]
        file.write_segment([RootObject({"comment": OIL}), *channels])


def ugly_mdf(path: Path) -> None:
    import asammdf

    with asammdf.MDF(version="4.10") as file:
        file.header.comment = OIL
        angle = asammdf.Signal(ugly.ANGLE, ugly.TIME, unit="rad", name="angle", comment=LINK)
        file.append([angle, asammdf.Signal(ugly.TORQUE, ugly.TIME, unit="Nm", name="torque")])
        file.save(path, overwrite=True)


@pytest.mark.parametrize(
    ("name", "write"),
    [("a.parquet", ugly_parquet), ("a.tdms", ugly_tdms), ("a.mf4", ugly_mdf)],
)
def test_a_recording_gives_the_numbers_of_its_text(
    name: str, write: Callable[[Path], None], tmp_path: Path
) -> None:
    """Proposed, accepted and fitted like the ugly texts of `test_ugly_variants`."""
    write(tmp_path / name)
    plain = np.column_stack([ugly.TIME, ugly.ANGLE, ugly.TORQUE])
    head = "time [s],pos [rad],tau [N m]"
    np.savetxt(tmp_path / "a.csv", plain, delimiter=",", header=head, comments="", fmt="%.10g")
    found, expected = (
        ugly.motion_of(ugly.run_of([tmp_path / file], tmp_path / folder)).estimates
        for file, folder in ((name, "one"), ("a.csv", "other"))
    )
    for key in ("inertia", "viscous", "coulomb", "offset"):
        assert found[key].value == pytest.approx(expected[key].value, rel=1e-6), key


@pytest.mark.parametrize("kind", WRITERS)
def test_units_time_and_start_are_those_of_the_file(kind: str, tmp_path: Path) -> None:
    name, write = WRITERS[kind]
    path = tmp_path / name
    write(path)
    run = READERS[kind](path, channels=CHANNELS)
    np.testing.assert_allclose(run["position"], np.radians(ANGLE), rtol=1e-14)
    np.testing.assert_allclose(run["torque"], TORQUE, atol=1e-7)
    stamps = run.recording.source.time_ns(0, ROWS)
    np.testing.assert_array_equal(stamps, START_NS + np.arange(ROWS) * STEP_NS)
    assert run.metadata.sample_rate == pytest.approx(2000.0)
    assert run.metadata.start_time.startswith("2025-11-21T08:30:00")
    assert run.metadata.time_base == "device"


@pytest.mark.parametrize("name", ["bench.tdms", "bench.mf4", "bench.mdf"])
def test_comments_and_units_are_kept_as_they_were_written(name: str, tmp_path: Path) -> None:
    kind = "tdms" if name.endswith("tdms") else "mdf"
    (tdms_file if kind == "tdms" else mdf_file)(tmp_path / name)
    run = READERS[kind](tmp_path / name, channels=CHANNELS)
    told = " ".join(event.text for event in run.recording.events)
    assert OIL in told
    assert f"q {LINK}" in told
    (position,) = (
        one for one in run.metadata.process["channel_map"] if one["channel"] == "position"
    )
    assert (position["unit"], position["unit_as_written"]) == ("", "deg")


@pytest.mark.parametrize("kind", WRITERS)
def test_a_damaged_file_is_named(kind: str, tmp_path: Path) -> None:
    path = tmp_path / WRITERS[kind][0]
    path.write_bytes(b"no measurement at all" * 40)
    with pytest.raises(RunFileError, match="is not a readable"):
        open_table(kind, path)
    with pytest.raises(RunFileError, match="there is no such file"):
        open_table(kind, tmp_path / "nowhere")


def test_a_file_of_the_older_mdf(tmp_path: Path) -> None:
    path = tmp_path / "bench.mdf"
    mdf_file(path)
    run = rig.read_mdf(path, channels={"position": "q", "torque": "M"})
    np.testing.assert_allclose(run["position"], np.radians(ANGLE), rtol=1e-14)
    assert run.metadata.start_time.startswith("2025-11-21T08:30:00")


def test_groups_of_other_rates_are_brought_together_only_where_that_is_asked(
    tmp_path: Path,
) -> None:
    path = tmp_path / "bench.mf4"
    mdf_file(path)
    channels = {"position": "q", "housing_temperature": "T"}
    with pytest.raises(RunFileError, match="no row of the other columns has this time"):
        rig.read_mdf(path, channels=channels)
    run = rig.read_mdf(path, channels=channels, interpolate=True)
    # The last sample of the slower group lies 99 rows before the end.
    np.testing.assert_allclose(run["housing_temperature"], 20.0 + TIME[: ROWS - 99], atol=1e-9)


def test_samples_that_an_mdf_marks_as_invalid_are_holes(tmp_path: Path) -> None:
    path = tmp_path / "bench.mf4"
    invalid = np.zeros(100, dtype=bool)
    invalid[7] = True
    import asammdf

    with asammdf.MDF(version="4.10") as file:
        signal = asammdf.Signal(
            TORQUE[:100], TIME[:100], unit="Nm", name="M", invalidation_bits=invalid
        )
        file.append([signal])
        file.save(path)
    with pytest.raises(RunFileError, match="not finite"):
        rig.read_mdf(path, channels={"torque": "M"})
    assert len(rig.read_mdf(path, channels={"torque": "M"}, drop_bad_rows=True)["torque"]) == 99


def test_another_column_of_time_may_be_named(tmp_path: Path) -> None:
    path = tmp_path / "bench.tdms"
    values: dict[str, Any] = {"t": 2.0 * TIME[:100], "M": TORQUE[:100]}
    wave = {"wf_increment": 1.0, "wf_start_time": STARTED}
    with TdmsWriter(path) as file:
        file.write_segment([ChannelObject("log", n, v, wave) for n, v in values.items()])
    run = rig.read_tdms(path, channels={"time": "t:s", "torque": "M:N m"})
    assert run.metadata.sample_rate == pytest.approx(1000.0)
    # The file says when its own clock began, not when this one did.
    assert run.metadata.start_time == ""


def test_files_of_one_run_that_began_at_different_moments(tmp_path: Path) -> None:
    for name, value, begin in (("first", ANGLE, 0), ("second", TORQUE, 2)):
        wave = {"wf_increment": 5e-4, "wf_start_time": STARTED + np.timedelta64(begin, "ms")}
        with TdmsWriter(tmp_path / f"{name}.tdms") as file:
            file.write_segment([ChannelObject("log", name, value[:100], wave)])
    paths = [tmp_path / "first.tdms", tmp_path / "second.tdms"]
    channels = {"position": "first:deg", "torque": "second:N m"}
    with pytest.raises(RunFileError, match="no row of the other columns has this time"):
        rig.read_tdms(*paths, channels=channels)
    run = rig.read_tdms(*paths, channels=channels, drop_bad_rows=True)
    np.testing.assert_allclose(run["torque"], TORQUE[:96])
    np.testing.assert_allclose(run["position"], np.radians(ANGLE[4:100]))


def test_words_that_stand_for_numbers_are_those_numbers(tmp_path: Path) -> None:
    path = tmp_path / "bench.mf4"
    state = np.arange(100, dtype=np.uint8) // 50
    words = {"val_0": 0, "text_0": b"rest", "val_1": 1, "text_1": b"run"}
    import asammdf

    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(state, TIME[:100], name="state", conversion=words)])
        file.save(path)
    np.testing.assert_array_equal(rig.read_mdf(path, channels={"phase": "state:1"})["phase"], state)


@pytest.mark.parametrize("kind", WRITERS)
def test_a_file_that_was_cut_off_is_refused_or_said_to_be_so(
    kind: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    name, write = WRITERS[kind]
    path = tmp_path / name
    write(path)
    content = path.read_bytes()
    for share in (0.001, 0.6):
        path.write_bytes(content[: int(share * len(content))])
        try:
            run = READERS[kind](path, channels=CHANNELS)
        except RunFileError:
            continue
        said = " ".join(event.text for event in run.recording.events)
        assert kind == "tdms"
        assert "cut off" in said
        assert "WARNING: nptdms says: Last segment of file has less data than expected" in said
        # On the terminal of whoever imports it there is nothing besides.
        assert capfd.readouterr() == ("", "")
