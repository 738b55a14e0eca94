"""What recovery does with files that a kill leaves only rarely, and what it refuses."""

import os
from pathlib import Path

import h5py
import numpy as np
import pytest

from experiments.recording import Segment
from rig.errors import RunFileError
from rig.runfile.read import open_run
from rig.runfile.recover import recover_run
from rig.runfile.write import RunWriter
from tests.rig.runfile.making import block, counts_of, header, write_run


def dead_part(folder: Path, rows: int = 300, **options: bool) -> Path:
    """A `.part` as a dead writer leaves it."""
    writer = RunWriter(folder / "00007-x-y.h5", header(), chunk_rows=64, **options)
    writer.append(block(0, rows))
    writer.segment(Segment(index=0, label="ramp", start=0, stop=100))
    writer.segment(Segment(index=1, label="hold", start=100, stop=280))
    writer.segment(Segment(index=2, label="hold", start=290, stop=-1))
    writer.flush()
    writer.abandon()
    return writer.part


def test_columns_of_unequal_length_are_cut_to_the_shortest_and_it_says_so(tmp_path: Path) -> None:
    part = dead_part(tmp_path)
    clean = tmp_path / "clean.h5"
    with (
        h5py.File(part, "r", libver="latest", swmr=True) as source,
        h5py.File(clean, "w", libver="v110") as target,
    ):
        for name in source:
            source.copy(name, target)
        for name, value in source.attrs.items():
            target.attrs[name] = value
        target["entry/data/torque"].resize((250,))
        target["entry/data/time"].resize((290,))
    os.replace(clean, part)
    recovered = recover_run(part)
    assert recovered.rows == 250
    assert "cut to 250 rows" in recovered.notes[0]
    assert "input_angle" in recovered.notes[0]
    recording = open_run(recovered.path, verify=True)
    np.testing.assert_array_equal(recording.stored("output_angle"), counts_of(np.arange(250))[:, 1])
    assert [(s.index, s.start, s.stop) for s in recording.segments] == [(0, 0, 100), (1, 100, 250)]
    assert any("cut to 250 rows" in event.text for event in recording.events)
    assert any("without rows" in note for note in recovered.notes)


def test_an_open_segment_ends_with_the_last_row(tmp_path: Path) -> None:
    recovered = recover_run(dead_part(tmp_path))
    assert open_run(recovered.path).segments[2] == Segment(
        index=2, label="hold", start=290, stop=300
    )
    assert any("segment 2" in note for note in recovered.notes)


def test_a_complete_run_that_was_not_sealed_keeps_its_outcome(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def disk_full(*_: object) -> Path:
        raise RunFileError("no room")

    monkeypatch.setattr("rig.runfile.write.seal_file", disk_full)
    with pytest.raises(RunFileError, match="no room"):
        write_run(tmp_path, outcome="COMPLETED")
    recovered = recover_run(tmp_path / "00001-friction-A1.h5.part")
    assert (recovered.outcome, recovered.rows, recovered.notes) == ("COMPLETED", 2500, ())
    m = open_run(recovered.path).metadata
    assert (m.outcome, m.end_time) == ("COMPLETED", "2025-11-21T04:41:00.000+00:00")


def test_a_sealing_that_was_cut_off_between_two_names_is_finished(tmp_path: Path) -> None:
    path = write_run(tmp_path)
    part = path.with_name(path.name + ".part")
    os.link(path, part)
    recovered = recover_run(part)
    assert (recovered.path, recovered.rows, recovered.outcome) == (path, 2500, "COMPLETED")
    assert not part.exists()
    assert open_run(path, verify=True).rows == 2500


def test_recovery_that_fails_leaves_the_part_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    part = dead_part(tmp_path)
    before = part.read_bytes()

    def disk_full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("rig.runfile.recover._finish", disk_full)
    with pytest.raises(RunFileError, match="No space left"):
        recover_run(part)
    assert part.read_bytes() == before
    assert sorted(path.name for path in tmp_path.iterdir()) == [part.name]
    monkeypatch.undo()
    assert recover_run(part).rows == 300


def test_of_a_damaged_column_the_rows_before_the_damage_are_recovered(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path / "00007-x-y.h5", header(), chunk_rows=8192)
    writer.append(block(0, 10_000))
    writer.flush()
    writer.abandon()
    with h5py.File(writer.part, "r", libver="latest", swmr=True) as source:
        second = source["entry/data/torque"].id.get_chunk_info(1)
    raw = bytearray(writer.part.read_bytes())
    raw[second.byte_offset + second.size // 2] ^= 0xFF
    writer.part.write_bytes(raw)
    recovered = recover_run(writer.part)
    assert (recovered.rows, recovered.unread, recovered.outcome) == (8192, 1808, "INTERRUPTED")
    assert "rows from 8192 on cannot be read in torque" in recovered.notes[0]
    assert recovered.kept is not None
    assert recovered.kept.read_bytes() == bytes(raw)
    recording = open_run(recovered.path, verify=True)
    np.testing.assert_array_equal(recording.stored("torque"), counts_of(np.arange(8192))[:, 2])


def test_a_file_of_which_no_row_can_be_read_is_left_as_it_is(tmp_path: Path) -> None:
    part = dead_part(tmp_path)
    with h5py.File(part, "r", libver="latest", swmr=True) as source:
        first = source["entry/data/torque"].id.get_chunk_info(0)
    raw = bytearray(part.read_bytes())
    raw[first.byte_offset + first.size // 2] ^= 0xFF
    part.write_bytes(raw)
    with pytest.raises(RunFileError, match="none of its 300 rows can be read"):
        recover_run(part)
    assert part.read_bytes() == bytes(raw)
    assert sorted(path.name for path in tmp_path.iterdir()) == [part.name]


def test_a_recovery_that_was_cut_off_before_the_last_rename_is_finished(tmp_path: Path) -> None:
    part = dead_part(tmp_path)
    first = recover_run(part)
    assert first.kept is not None
    first.kept.rename(part)
    before = part.read_bytes()
    again = recover_run(part)
    assert (again.path, again.rows, again.outcome) == (first.path, 300, "INTERRUPTED")
    assert again.kept is not None
    assert again.kept.read_bytes() == before


def test_what_was_kept_before_is_never_replaced(tmp_path: Path) -> None:
    first = recover_run(dead_part(tmp_path))
    assert first.kept is not None
    first.path.rename(tmp_path / "elsewhere.h5")
    second = recover_run(dead_part(tmp_path, rows=400))
    assert second.kept not in (None, first.kept)
    assert first.kept.exists()


def test_rows_beyond_the_last_complete_flush_are_counted_and_kept(tmp_path: Path) -> None:
    """A full disk lengthens columns whose rows it did not take: the counter comes last."""
    part = dead_part(tmp_path)
    with h5py.File(part, "r", libver="latest", swmr=True) as source:
        place = source["entry/process/rows_written"].id.get_offset()
    raw = bytearray(part.read_bytes())
    raw[place : place + 8] = (290).to_bytes(8, "little")
    part.write_bytes(raw)
    recovered = recover_run(part)
    assert (recovered.rows, recovered.unread) == (290, 10)
    assert recovered.kept is not None


def test_recovery_refuses_what_it_cannot_do(tmp_path: Path) -> None:
    part = dead_part(tmp_path)
    with pytest.raises(RunFileError, match="needs no recovery"):
        recover_run(write_run(tmp_path))
    with pytest.raises(RunFileError, match="no such file"):
        recover_run(tmp_path / "nothing.h5.part")
    (tmp_path / "text.h5.part").write_text("no run")
    with pytest.raises(RunFileError, match="is not an HDF5 file"):
        recover_run(tmp_path / "text.h5.part")
    (tmp_path / "00007-x-y.h5").write_text("another")
    with pytest.raises(RunFileError, match="of this name already"):
        recover_run(part)
    assert part.exists()
