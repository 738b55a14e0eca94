"""What is written is read back: rows value by value, metadata, segments, events; in every way of
cutting into blocks.
"""

import os
import stat
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivers.samples import CycleFlag, SampleBlock
from experiments.recording import Event, Segment
from model.angle_certificate import AngleCertificate
from model.channel import Channel
from model.gear_file import shipped_gear
from model.units import REVOLUTION
from rig.errors import RunFileError
from rig.runfile.header import read_columns, write_header
from rig.runfile.layout import Column, create_data
from rig.runfile.read import (
    FileSource,
    close_recording,
    follow,
    open_run,
    read_run_header,
)
from rig.runfile.verify import verify_run
from rig.runfile.write import RunWriter
from tests.rig.runfile.making import (
    CALIBRATION,
    CHANNELS,
    CYCLE_NS,
    EPOCH_NS,
    block,
    counts_of,
    header,
    write_run,
)


def certified(**changes: object) -> Column:
    """The output encoder with the curve of its certificate."""
    angles = np.arange(24) * (REVOLUTION / 24)
    curve = AngleCertificate(
        angles=tuple(angles.tolist()),
        errors=tuple((1e-5 * np.cos(angles) / 3.0).tolist()),
        expanded_uncertainties=(2e-6,) * 24,
        coverage_factor=2.2,
    )
    calibration = replace(CALIBRATION, curve=curve)
    return Column.of(replace(CHANNELS[1], calibration=calibration, **changes))  # type: ignore[arg-type]


def written_with_curve(folder: Path) -> tuple[Path, Column]:
    column = certified()
    columns = (Column.of(CHANNELS[0]), column)
    with h5py.File(folder / "header.h5", "w") as file:
        write_header(file, replace(header(), columns=columns))
        create_data(file, columns, 64, compress=False)
    return folder / "header.h5", column


def test_the_curve_of_a_certificate_comes_back_number_by_number(tmp_path: Path) -> None:
    path, column = written_with_curve(tmp_path)
    with h5py.File(path) as file:
        plain, again = read_columns(file)
    assert again.channel.calibration == column.channel.calibration
    assert plain.channel.calibration.curve is None


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b'"coverage_factor": 2.2', b'"coverage_factor": 9.2', "coverage factor"),
        (b'"coverage_factor"', b'"coverage_fact0r"', "cannot be used"),
        (b'"angles": [', b'"angles": {', "not JSON"),
    ],
)
def test_a_curve_that_is_none_is_refused_with_its_place(
    tmp_path: Path, old: bytes, new: bytes, words: str
) -> None:
    path, _ = written_with_curve(tmp_path)
    name = "entry/instrument/output_angle/calibration/curve"
    with h5py.File(path, "r+") as file:
        text = bytes(file[name][()])  # type: ignore[index]
        assert old in text
        file[name][()] = text.replace(old, new)  # type: ignore[index]
    with h5py.File(path) as file, pytest.raises(RunFileError, match=words) as caught:
        read_columns(file)
    assert name in str(caught.value)


@pytest.mark.parametrize("compress", [True, False])
def test_every_value_comes_back(tmp_path: Path, compress: bool) -> None:
    recording = open_run(write_run(tmp_path, 2500, compress=compress), verify=True)
    cycles = np.arange(2500)
    assert recording.rows == 2500
    for index, channel in enumerate(CHANNELS):
        np.testing.assert_array_equal(recording.stored(channel.name), counts_of(cycles)[:, index])
        np.testing.assert_array_equal(
            recording.si(channel.name), channel.to_si(counts_of(cycles)[:, index])
        )
    np.testing.assert_array_equal(
        recording.flags(), np.where(cycles % 97 == 0, CycleFlag.INCOMPLETE, 0)
    )
    np.testing.assert_array_equal(recording.source.time_ns(0, 2500), EPOCH_NS + cycles * CYCLE_NS)
    np.testing.assert_allclose(recording.time(), cycles * 1e-3, rtol=0, atol=1e-12)
    assert (
        recording.stored("torque", recording.segments[1]).tolist()
        == counts_of(np.arange(1250, 2500))[:, 2].tolist()
    )
    close_recording(recording)


def test_metadata_comes_back(tmp_path: Path) -> None:
    path = write_run(tmp_path)
    m = open_run(path).metadata
    wanted = header().metadata
    for name in (
        "run_id",
        "experiment",
        "origin",
        "title",
        "start_time",
        "operator",
        "gear",
        "gear_serial",
        "ratio",
        "mounting",
        "output_sense",
        "gear_mounted",
        "sample_rate",
        "time_base",
        "parameters",
        "conditions",
    ):
        assert getattr(m, name) == getattr(wanted, name), name
    assert (m.outcome, m.end_time) == ("COMPLETED", "2025-11-21T04:41:00.000+00:00")
    assert m.gear == shipped_gear()
    assert m.process == {**wanted.process, "truth": {"coulomb": 70.0}}
    assert len(m.sha256) == 64


def test_channels_come_back_for_replay(tmp_path: Path) -> None:
    path = write_run(tmp_path)
    stored = read_run_header(path)
    # A channel without a name for axes has got one by being written; everything else is the same.
    assert [replace(column.channel, long_name="") for column in stored.columns] == [
        replace(channel, long_name="") for channel in CHANNELS
    ]
    assert stored.columns[2].channel.calibration == CALIBRATION
    assert (stored.limits, stored.devices, stored.truth, stored.epoch_ns) == (
        {"torque": 2.0},
        {"drive": {"vendor": "x"}},
        {"coulomb": 70.0},
        EPOCH_NS,
    )


def test_a_polled_channel_comes_back_as_one(tmp_path: Path) -> None:
    columns = (Column.of(CHANNELS[0]), Column.of(replace(CHANNELS[1], acquired="polled")))
    with h5py.File(tmp_path / "header.h5", "w") as file:
        write_header(file, replace(header(), columns=columns))
        create_data(file, columns, 64, compress=False)
        assert [one.channel.acquired for one in read_columns(file)] == ["latched", "polled"]


def test_segments_and_events_come_back(tmp_path: Path) -> None:
    recording = open_run(write_run(tmp_path))
    assert recording.segments == (
        Segment(index=0, label="hold", start=0, stop=1250, setpoint=3.25, direction=1, repeat=0),
        Segment(
            index=1, label="hold", start=1250, stop=2500, setpoint=-3.25, direction=-1, repeat=1
        ),
    )
    assert recording.events[0] == Event(EPOCH_NS + 5, "info", "NOTE", "operator", "Öl nachgefüllt")
    assert recording.events[1].text == "x" * 480
    with h5py.File(recording.source.path) as file:  # type: ignore[attr-defined]
        assert file["entry/events"]["truncated"].tolist() == [0, 1]


def test_a_sealed_run_is_named_hashed_and_read_only(tmp_path: Path) -> None:
    path = write_run(tmp_path)
    assert not path.with_name(path.name + ".part").exists()
    assert stat.S_IMODE(os.stat(path).st_mode) & 0o222 == 0
    words = path.with_name(path.name + ".sha256").read_text().split()
    assert words == [open_run(path, verify=True).metadata.sha256, path.name]


def test_a_changed_run_is_refused_when_verified(tmp_path: Path) -> None:
    path = write_run(tmp_path)
    path.chmod(0o644)
    with path.open("ab") as stream:
        stream.write(b"x")
    with pytest.raises(RunFileError, match="was changed since it was sealed"):
        open_run(path, verify=True)


@settings(
    max_examples=15,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(
    sizes=st.lists(st.integers(0, 700), min_size=1, max_size=12),
    flush=st.integers(1, 4),
    compress=st.booleans(),
)
def test_how_a_run_is_cut_into_blocks_does_not_matter(
    tmp_path_factory: pytest.TempPathFactory, sizes: list[int], flush: int, compress: bool
) -> None:
    path = tmp_path_factory.mktemp("cut") / "1-x-y.h5"
    writer = RunWriter(path, header(), compress=compress, chunk_rows=256)
    first = 0
    for index, size in enumerate(sizes):
        writer.append(block(first, size))
        first += size
        if index % flush == 0:
            writer.flush()
    recording = open_run(writer.seal("COMPLETED"))
    assert recording.rows == first
    found = [recording.stored(channel.name) for channel in CHANNELS]
    np.testing.assert_array_equal(np.stack(found, axis=1), counts_of(np.arange(first)))


def test_a_growing_run_is_followed(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path / "1-x-y.h5", header(), compress=False, chunk_rows=64)
    writer.append(block(0, 100))
    writer.segment(Segment(index=0, label="hold", start=10, stop=-1))
    writer.flush()
    recording = open_run(writer.part)
    assert (recording.rows, recording.metadata.outcome) == (100, "")
    assert recording.segments == (Segment(index=0, label="hold", start=10, stop=100),)
    writer.append(block(100, 60))
    writer.segment(Segment(index=0, label="hold", start=10, stop=150))
    writer.event(Event(1, "info", "A", "b", "c"))
    writer.flush()
    grown = follow(recording)
    assert grown.rows == 160
    assert grown.segments == (Segment(index=0, label="hold", start=10, stop=150),)
    assert len(grown.events) == 1
    np.testing.assert_array_equal(grown.stored("input_angle"), counts_of(np.arange(160))[:, 0])
    close_recording(recording)
    writer.seal("COMPLETED")


def test_missing_cycles_are_counted_and_noted(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path / "1-x-y.h5", header())
    writer.append(block(7, 10))
    writer.append(block(20, 10))
    assert (writer.rows, writer.rows_dropped) == (20, 3)
    with pytest.raises(RunFileError, match="out of order"):
        writer.append(block(25, 10))
    recording = open_run(writer.seal("COMPLETED"))
    assert [event.code for event in recording.events] == ["CYCLES_MISSING"]
    assert isinstance(recording.source, FileSource)
    assert recording.source.cycles(0, 20).tolist() == [*range(7, 17), *range(20, 30)]


def test_rows_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path / "1-x-y.h5", header())
    good = block(0, 5)
    with pytest.raises(RunFileError, match="do not fit the channels"):
        writer.append(SampleBlock(0, good.time_ns, good.counts[:, :2], good.flags))
    writer.abandon()


def test_a_count_beyond_its_column_is_an_error(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path / "1-x-y.h5", header())
    good = block(0, 5)
    good.counts[3, 3] = 2**31
    writer.append(good)
    with pytest.raises(RunFileError, match=r"does not fit its column.*2147483648"):
        writer.flush()
    writer.abandon()


def test_a_run_without_rows_is_a_run(tmp_path: Path) -> None:
    recording = open_run(write_run(tmp_path, 0), verify=True)
    assert recording.rows == 0
    assert len(recording.si("torque")) == len(recording.time()) == 0


def test_long_texts_and_large_truths_come_back(tmp_path: Path) -> None:
    truth = {"series": list(range(20_000)), "not a number": float("nan"), "array": np.arange(3)}
    found = open_run(write_run(tmp_path, 30, truth=truth)).metadata.process["truth"]
    assert found == {"series": list(range(20_000)), "not a number": None, "array": [0, 1, 2]}


def test_no_run_is_ever_overwritten(tmp_path: Path) -> None:
    path = write_run(tmp_path, 30)
    before = path.read_bytes()
    with pytest.raises(RunFileError, match="of this name already"):
        RunWriter(path, header())
    writer = RunWriter(tmp_path / "2.h5", header())
    with pytest.raises(RunFileError, match="cannot be created"):
        RunWriter(tmp_path / "2.h5", header())
    (tmp_path / "2.h5").write_text("somebody else's")
    with pytest.raises(RunFileError, match="of this name already"):
        writer.seal("COMPLETED")
    assert path.read_bytes() == before
    assert (tmp_path / "2.h5").read_text() == "somebody else's"


def test_an_outcome_that_nobody_knows_is_refused(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path / "1-x-y.h5", header())
    with pytest.raises(RunFileError, match="no outcome"):
        writer.seal("GREAT")
    with pytest.raises(RunFileError, match="no outcome"):
        writer.seal("PASS")
    assert writer.seal("ABORTED").exists()


@pytest.mark.parametrize("word", ["PASS", "MARGINAL", "FAIL"])
def test_a_verdict_of_an_earlier_version_reads_as_completed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, word: str
) -> None:
    with monkeypatch.context() as earlier:
        earlier.setattr("rig.runfile.write.OUTCOMES", (word,))
        path = write_run(tmp_path, outcome=word)
    with h5py.File(path) as file:
        assert file["entry/outcome"][()] == word.encode()
    recording = open_run(path, verify=True)
    assert recording.metadata.outcome == "COMPLETED"
    close_recording(recording)
    assert "blocks" not in {finding.severity for finding in verify_run(path)}


@pytest.mark.parametrize("name", ["time", "flags", "a b", "", "x/y", "ä"])
def test_channel_names_that_would_break_the_file_are_refused(name: str) -> None:
    from rig.runfile.layout import Column

    with pytest.raises(RunFileError, match="not a name for a channel"):
        Column(Channel(name=name, unit="rad"))


def test_reading_takes_constant_memory(tmp_path: Path) -> None:
    import tracemalloc

    recording = open_run(write_run(tmp_path, 200_000))
    list(recording.blocks(size=4096))
    tracemalloc.start()
    total = sum(
        float(recording.si("input_angle", rows).sum()) for rows in recording.blocks(size=4096)
    )
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert total == pytest.approx(
        float(CHANNELS[0].to_si(counts_of(np.arange(200_000))[:, 0]).sum()), rel=1e-9
    )
    assert peak < 200_000 * 8 / 4
