"""The writer is killed, with SIGKILL, at many moments: every row that it had acknowledged is read
back, value by value.
"""

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from experiments.finding import Severity
from rig.errors import RunFileError
from rig.runfile import layout, write
from rig.runfile.empty import BEING_WRITTEN, SIGNATURE, VERSION_AND_SIZES
from rig.runfile.read import close_recording, follow, open_run
from rig.runfile.recover import recover_run
from rig.runfile.verify import verify_run
from tests.rig.runfile.making import CHANNELS, CYCLE_NS, EPOCH_NS, counts_of, header

pytestmark = pytest.mark.skipif(os.name != "posix", reason="SIGKILL")
ROOT = Path(__file__).parents[3]
UNFINISHED_HEADER = SIGNATURE + VERSION_AND_SIZES + bytes([BEING_WRITTEN])


class Writer:
    """The writer's process, driven by single letters."""

    def __init__(self, folder: Path, *, compress: bool, chunk_rows: int = 128) -> None:
        command = [
            sys.executable,
            "-m",
            "tests.rig.runfile.dying_writer",
            str(folder),
            "c" if compress else "u",
        ]
        self.process = subprocess.Popen(
            [*command, str(chunk_rows)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=ROOT,
        )
        assert self.process.stdout is not None
        assert self.process.stdin is not None
        self.out, self.into = self.process.stdout, self.process.stdin
        assert self.out.readline() == "ready\n"

    def tell(self, letters: str) -> list[int]:
        """Send letters; returns the rows that were acknowledged."""
        self.into.write(letters)
        self.into.flush()
        return [int(self.out.readline()) for letter in letters if letter in "fs"]

    def kill(self) -> list[int]:
        """SIGKILL; returns what had been acknowledged and not yet read."""
        self.process.send_signal(signal.SIGKILL)
        rest = self.out.read()
        self.process.wait()
        self.into.close()
        self.out.close()
        # A last line without its end was cut by the kill.
        return [int(line) for line in rest.split("\n")[:-1]]


def check_rows(path: Path, at_least: int) -> int:
    recording = open_run(path, verify=True)
    rows = recording.rows
    assert rows >= at_least
    found = np.stack([recording.stored(channel.name) for channel in CHANNELS], axis=1)
    np.testing.assert_array_equal(found, counts_of(np.arange(rows)))
    np.testing.assert_array_equal(
        recording.source.time_ns(0, rows), EPOCH_NS + np.arange(rows) * CYCLE_NS
    )
    close_recording(recording)
    return rows


MOMENTS = [
    "af",
    "aaaaf",
    "agafaaag",
    "aaaagfaaaa",
    "agfagfagfaaaaaaaaaa",
    "agsagsags",
    "aaaafgaaafgaaafgaaaaaaaaaaaaaaaa",
]


@pytest.mark.parametrize(("moment", "letters"), list(enumerate(MOMENTS)))
def test_acknowledged_rows_survive_a_kill(tmp_path: Path, moment: int, letters: str) -> None:
    writer = Writer(tmp_path, compress=moment % 2 == 0)
    acknowledged = writer.tell(letters)[-1]
    writer.kill()
    part = tmp_path / "00001-friction-A1.h5.part"
    before = part.read_bytes()
    recovered = recover_run(part)
    assert recovered.outcome == "INTERRUPTED"
    assert not part.exists()
    assert recovered.kept is not None
    assert recovered.kept.read_bytes() == before
    assert check_rows(recovered.path, acknowledged) == recovered.rows
    recording = open_run(recovered.path)
    assert recording.metadata.outcome == "INTERRUPTED"
    assert all(0 <= s.start < s.stop <= recovered.rows for s in recording.segments)
    assert recording.events[-1].code == "RECOVERED"
    assert not [f for f in verify_run(recovered.path) if f.severity is Severity.BLOCKS]


@pytest.mark.parametrize(
    ("compress", "acknowledged_before"), [(True, 3), (False, 40), (True, 90), (False, 7)]
)
def test_a_kill_in_full_flight(tmp_path: Path, compress: bool, acknowledged_before: int) -> None:
    writer = Writer(tmp_path, compress=compress, chunk_rows=64)
    writer.tell("w")
    acknowledged = [int(writer.out.readline()) for _ in range(acknowledged_before)] + writer.kill()
    recovered = recover_run(tmp_path / "00001-friction-A1.h5.part")
    assert acknowledged[-1] >= acknowledged_before * 37
    check_rows(recovered.path, acknowledged[-1])


def test_a_growing_run_is_read_by_another_process_and_not_recovered(tmp_path: Path) -> None:
    writer = Writer(tmp_path, compress=False)
    part = tmp_path / "00001-friction-A1.h5.part"
    try:
        (rows,) = writer.tell("aaagf")
        recording = open_run(part)
        assert recording.rows == rows
        with pytest.raises(RunFileError, match="still being written"):
            recover_run(part)
        (more,) = writer.tell("aaaaaf")
        grown = follow(recording)
        assert grown.rows == more > rows
        np.testing.assert_array_equal(
            grown.stored("output_angle"), counts_of(np.arange(more))[:, 1]
        )
        close_recording(recording)
        assert writer.tell("af") == [more + 37]
    finally:
        writer.kill()
    assert recover_run(part).rows == more + 37


@pytest.mark.parametrize("letters", ["", "f"])
def test_a_header_without_rows_is_taken_away_and_named(tmp_path: Path, letters: str) -> None:
    writer = Writer(tmp_path, compress=True)
    writer.tell(letters)
    writer.kill()
    part = tmp_path / "00001-friction-A1.h5.part"
    gone = recover_run(part)
    assert (gone.path, gone.rows, gone.is_removed) == (part, 0, True)
    assert "header without rows" in gone.notes[0]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("left", [0, 48, 70_000])
def test_a_header_that_was_never_completed_is_taken_away_and_named(
    tmp_path: Path, left: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What stands on the disk while the header is written: nothing, a superblock, most of it."""
    snapshots: list[bytes] = []
    part = tmp_path / "00001-friction-A1.h5.part"

    def first_look(*arguments: Any) -> None:
        snapshots.append(part.read_bytes())
        write_header(*arguments)

    def second_look(file: h5py.File) -> tuple[h5py.Dataset, h5py.Dataset]:
        tables = create_tables(file)
        file.flush()
        snapshots.append(part.read_bytes())
        return tables

    write_header, create_tables = write.write_header, layout.create_tables
    monkeypatch.setattr(write, "write_header", first_look)
    monkeypatch.setattr(layout, "create_tables", second_look)
    write.RunWriter(tmp_path / "00001-friction-A1.h5", header()).abandon()
    begun, nearly = snapshots
    part.write_bytes(begun[:left] if left <= len(begun) else nearly[:left])
    gone = recover_run(part)
    assert (gone.path, gone.is_removed) == (part, True)
    assert "never completed" in gone.notes[0]
    assert f"({left} bytes)" in gone.notes[0]
    assert not part.exists()


@pytest.mark.parametrize("chunk_rows", [128, 4])
def test_rows_that_no_flush_has_brought_into_the_table_are_kept(
    tmp_path: Path, chunk_rows: int
) -> None:
    """Whole chunks lie in the file before the first flush, and nothing points to them: no header without rows."""
    writer = Writer(tmp_path, compress=True, chunk_rows=chunk_rows)
    part = tmp_path / "00001-friction-A1.h5.part"
    begun = part.stat().st_size
    writer.tell("aaaaaaaa")
    writer.into.write("r")
    writer.into.flush()
    assert writer.out.readline() == "ready\n"
    writer.kill()
    before = part.read_bytes()
    assert b"EAHD" not in before
    recovered = recover_run(part)
    assert not recovered.is_removed
    assert (recovered.rows, recovered.unread, recovered.outcome) == (0, 0, "INTERRUPTED")
    assert recovered.beyond == len(before) - begun > 0
    assert "after the last flush" in recovered.notes[-1]
    assert recovered.kept is not None
    assert recovered.kept.read_bytes() == before
    assert open_run(recovered.path, verify=True).metadata.gear_serial == "A1"


def test_a_header_with_zeros_behind_it_is_not_proved_empty(tmp_path: Path) -> None:
    """Power fails: the length of a file can be on the disk before what was written there."""
    writer = Writer(tmp_path, compress=True)
    writer.kill()
    part = tmp_path / "00001-friction-A1.h5.part"
    with part.open("ab") as stream:
        stream.write(bytes(4096))
    recovered = recover_run(part)
    assert (recovered.is_removed, recovered.beyond) == (False, 4096)


def test_an_unfinished_header_that_reaches_beyond_its_stated_end_is_left_as_it_is(
    tmp_path: Path,
) -> None:
    """Killed while the header is brought to the system: its superblock, which is written last, is still the first."""
    part = tmp_path / "00001-friction-A1.h5.part"
    write.RunWriter(tmp_path / "00001-friction-A1.h5", header()).abandon()
    raw = bytearray(part.read_bytes())
    raw[: len(UNFINISHED_HEADER)] = UNFINISHED_HEADER
    raw[28:36] = (48).to_bytes(8, "little")
    part.write_bytes(raw)
    with pytest.raises(RunFileError, match=r"header was never completed; value .* left as it is"):
        recover_run(part)
    assert part.read_bytes() == bytes(raw)


def test_a_run_that_was_cut_short_by_a_copy_is_left_where_it_is(tmp_path: Path) -> None:
    writer = Writer(tmp_path, compress=True)
    writer.tell("af")
    writer.kill()
    part = tmp_path / "00001-friction-A1.h5.part"
    part.write_bytes(part.read_bytes()[:48])
    with pytest.raises(RunFileError):
        recover_run(part)
    assert part.exists()


def test_rows_behind_a_mark_that_is_older_are_not_taken_away(tmp_path: Path) -> None:
    """Power fails: what was written last can be on the disk before what was written first."""
    writer = Writer(tmp_path, compress=True)
    writer.tell("af")
    writer.kill()
    part = tmp_path / "00001-friction-A1.h5.part"
    raw = bytearray(part.read_bytes())
    raw[: len(UNFINISHED_HEADER)] = UNFINISHED_HEADER
    part.write_bytes(raw)
    with pytest.raises(RunFileError):
        recover_run(part)
    assert part.read_bytes() == bytes(raw)
