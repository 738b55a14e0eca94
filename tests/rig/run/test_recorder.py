"""Between the loop and the file: every row arrives with its values, or the run ends with an error that says so."""

import errno
import threading
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest

from drivers.clock import VirtualClock
from experiments.finding import Severity
from experiments.recording import Event, Segment
from rig.errors import RecorderOverflowError, RunFileError
from rig.run import recorder as module
from rig.run.recorder import InlineRecorder, ThreadedRecorder
from rig.runfile.read import close_recording, open_run
from rig.runfile.recover import recover_run
from rig.runfile.source import FileSource
from rig.runfile.verify import verify_run
from rig.runfile.write import RunWriter
from tests.rig.runfile.making import CHANNELS, CYCLE_NS, EPOCH_NS, block, counts_of, header

PATIENCE_S = 600.0
RUN = "00001-friction-A1.h5"


class StalledWriter(RunWriter):
    """A writer on a disk that does not answer until `release` is set."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, header(), chunk_rows=64)
        self.reached, self.release = threading.Event(), threading.Event()

    def append(self, rows) -> None:  # type: ignore[no-untyped-def]
        self.reached.set()
        assert self.release.wait(PATIENCE_S)
        super().append(rows)


class FullDisk(RunWriter):
    """A writer whose disk is full once `room` rows are on it."""

    def __init__(self, path: Path, room: int) -> None:
        super().__init__(path, header(), chunk_rows=64)
        self.room = room

    def append(self, rows) -> None:  # type: ignore[no-untyped-def]
        if self.rows + len(rows) > self.room:
            with self._disk("cannot be written"):
                raise OSError(errno.ENOSPC, "No space left on device")
        super().append(rows)


class BrokenWriter(RunWriter):
    """A writer with an error that it does not know how to word."""

    error: Exception = OSError(errno.EIO, "Input/output error")

    def append(self, rows) -> None:  # type: ignore[no-untyped-def]
        raise self.error


class CountingWriter(RunWriter):
    """A writer that counts how often it is flushed and synchronised."""

    flushes = synchronisations = 0

    def flush(self) -> None:
        self.flushes += 1
        super().flush()

    def synchronise(self) -> None:
        self.synchronisations += 1
        super().synchronise()


@pytest.fixture(autouse=True)
def _no_thread_is_left() -> Iterator[None]:
    yield
    wait_for_the_thread()


def wait_for_the_thread() -> None:
    """Until the writer threads of recorders have ended."""
    for thread in threading.enumerate():
        if thread.name == "recorder":
            thread.join(PATIENCE_S)
            assert not thread.is_alive()


def assert_holds(path: Path, cycles: np.ndarray) -> None:
    """The file holds exactly the rows of these cycles, value by value."""
    expected = counts_of(cycles)
    with FileSource(path) as source:
        assert source.rows == len(cycles)
        np.testing.assert_array_equal(source.cycles(0, source.rows), cycles)
        np.testing.assert_array_equal(source.time_ns(0, source.rows), EPOCH_NS + cycles * CYCLE_NS)
        np.testing.assert_array_equal(
            source.flags(0, source.rows), np.where(cycles % 97 == 0, 1, 0)
        )
    with h5py.File(path) as file:
        for index, channel in enumerate(CHANNELS):
            np.testing.assert_array_equal(file[f"entry/data/{channel.name}"][:], expected[:, index])


@pytest.mark.parametrize("size", [1, 7, 100, 1000])
@pytest.mark.parametrize("threaded", [True, False])
def test_every_row_arrives_value_by_value(tmp_path: Path, size: int, threaded: bool) -> None:
    writer = RunWriter(tmp_path / RUN, header(), chunk_rows=512)
    recorder = (
        ThreadedRecorder(writer, 1000.0) if threaded else InlineRecorder(writer, VirtualClock())
    )
    rows = 3 * size + 2000
    for first in range(0, rows, size):
        recorder.put(block(first, min(size, rows - first)))
    assert recorder.rows == rows
    path = recorder.close("COMPLETED", "2025-11-21T04:41:00.000+00:00")
    assert path == tmp_path / RUN
    assert_holds(path, np.arange(rows))
    assert {
        finding.severity
        for finding in verify_run(path)
        if finding.what in ("hash", "rows", "sequence", "time")
    } == {"passed"}


def test_a_ring_that_wraps_keeps_the_order(tmp_path: Path) -> None:
    recorder = ThreadedRecorder(
        RunWriter(tmp_path / RUN, header(), chunk_rows=64), 1.0, smallest_ring=50
    )
    assert recorder.capacity == 50
    for first in range(0, 7 * 200, 7):
        if first % 49 == 0:
            recorder.flush()
        recorder.put(block(first, 7))
    assert_holds(recorder.close("COMPLETED"), np.arange(1400))


@pytest.mark.parametrize("rate", [1.0, 500.0, 1000.0, 4000.0, 8333.3])
def test_the_ring_holds_ten_seconds(tmp_path: Path, rate: float) -> None:
    recorder = ThreadedRecorder(RunWriter(tmp_path / RUN, header()), rate)
    assert recorder.capacity >= 10.0 * rate
    recorder.abandon()


def test_a_full_ring_stops_the_run_and_every_earlier_row_is_kept(tmp_path: Path) -> None:
    writer = StalledWriter(tmp_path / RUN)
    recorder = ThreadedRecorder(writer, 1.0, smallest_ring=50)
    recorder.put(block(0, 10))
    assert writer.reached.wait(PATIENCE_S)
    recorder.put(block(10, 40))
    assert recorder.rows == 50
    with pytest.raises(RecorderOverflowError) as caught:
        recorder.put(block(50, 3))
    for word in ("ring is full", "50 rows waiting and 3 more", "50 rows", RUN, "sample rate"):
        assert word in str(caught.value)
    assert recorder.rows == 50
    for call in (
        lambda: recorder.put(block(53, 1)),
        lambda: recorder.event(Event(0, "info", "NOTE", "test", "")),
        lambda: recorder.segment(Segment(index=0, label="hold", start=0, stop=1)),
        recorder.flush,
    ):
        with pytest.raises(RecorderOverflowError):
            call()
    writer.release.set()
    with pytest.raises(RecorderOverflowError):
        recorder.close("COMPLETED")
    recorder.abandon()
    assert writer.rows_dropped == 3
    recovered = recover_run(writer.part)
    assert (recovered.rows, recovered.outcome) == (50, "INTERRUPTED")
    with h5py.File(recovered.path) as file:
        assert file["entry/process/rows_dropped"][()] == 3
    assert_holds(recovered.path, np.arange(50))


def test_a_block_larger_than_the_ring_is_an_overflow(tmp_path: Path) -> None:
    recorder = ThreadedRecorder(RunWriter(tmp_path / RUN, header()), 1.0, smallest_ring=50)
    with pytest.raises(RecorderOverflowError, match="0 rows waiting and 51 more"):
        recorder.put(block(0, 51))
    recorder.abandon()


def test_a_full_disk_surfaces_in_the_next_put_and_what_was_flushed_is_readable(
    tmp_path: Path,
) -> None:
    writer = FullDisk(tmp_path / RUN, room=300)
    recorder = ThreadedRecorder(writer, 1000.0)
    recorder.put(block(0, 300))
    recorder.event(Event(EPOCH_NS, "info", "NOTE", "test", "before"))
    recorder.flush()
    recorder.put(block(300, 10))
    wait_for_the_thread()
    with pytest.raises(RunFileError, match="No space left on device") as caught:
        recorder.put(block(310, 10))
    assert "rig recover" in str(caught.value)
    assert RUN in str(caught.value)
    with pytest.raises(RunFileError, match="No space left"):
        recorder.close("COMPLETED")
    recorder.abandon()
    assert not (tmp_path / RUN).exists()
    recovered = recover_run(writer.part)
    assert_holds(recovered.path, np.arange(300))
    recording = open_run(recovered.path)
    assert "before" in [event.text for event in recording.events]
    close_recording(recording)


@pytest.mark.parametrize(
    "error",
    [OSError(errno.EIO, "Input/output error"), TypeError("a defect"), MemoryError("no room")],
)
def test_no_error_of_the_writer_thread_is_lost(
    tmp_path: Path, error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(BrokenWriter, "error", error)
    recorder = ThreadedRecorder(BrokenWriter(tmp_path / RUN, header()), 1000.0)
    recorder.put(block(0, 10))
    wait_for_the_thread()
    with pytest.raises(RunFileError, match=str(error.args[-1])):
        recorder.put(block(10, 10))
    with pytest.raises(RunFileError):
        recorder.close("COMPLETED")
    recorder.abandon()
    assert not (tmp_path / RUN).exists()


def test_a_disk_that_does_not_answer_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = StalledWriter(tmp_path / RUN)
    recorder = ThreadedRecorder(writer, 1000.0)
    recorder.put(block(0, 10))
    assert writer.reached.wait(PATIENCE_S)
    with monkeypatch.context() as patch:
        patch.setattr(module, "CLOSE_TIMEOUT_S", 0.01)
        with pytest.raises(RunFileError, match="the disk does not answer"):
            recorder.flush()
        with pytest.raises(RunFileError, match="the disk does not answer"):
            recorder.close("COMPLETED")
    writer.release.set()
    recorder.abandon()


def test_closing_drains_rows_segments_and_events(tmp_path: Path) -> None:
    writer = StalledWriter(tmp_path / RUN)
    recorder = ThreadedRecorder(writer, 1000.0)
    for first in range(0, 5000, 100):
        recorder.put(block(first, 100))
    recorder.segment(
        Segment(index=0, label="hold", start=0, stop=-1, setpoint=1.0, direction=1, repeat=0)
    )
    recorder.segment(
        Segment(index=0, label="hold", start=0, stop=2500, setpoint=1.0, direction=1, repeat=0)
    )
    for index in range(20):
        recorder.event(Event(EPOCH_NS + index, "info", "NOTE", "test", str(index)))
    assert writer.rows == 0
    writer.release.set()
    path = recorder.close("COMPLETED", "2025-11-21T04:41:00.000+00:00")
    assert_holds(path, np.arange(5000))
    recording = open_run(path, verify=True)
    assert recording.metadata.outcome == "COMPLETED"
    assert [(s.start, s.stop) for s in recording.segments] == [(0, 2500)]
    assert [event.text for event in recording.events] == [str(index) for index in range(20)]
    close_recording(recording)


@pytest.mark.parametrize("threaded", [True, False])
def test_missing_cycles_are_counted_and_noted(tmp_path: Path, threaded: bool) -> None:
    writer = RunWriter(tmp_path / RUN, header())
    recorder = (
        ThreadedRecorder(writer, 1000.0) if threaded else InlineRecorder(writer, VirtualClock())
    )
    for first, rows in ((5, 10), (15, 1), (20, 30), (57, 3)):
        recorder.put(block(first, rows))
    path = recorder.close("COMPLETED")
    assert writer.rows_dropped == 4 + 7
    assert_holds(path, np.concatenate([np.arange(5, 16), np.arange(20, 50), np.arange(57, 60)]))
    recording = open_run(path)
    noted = [event.text for event in recording.events if event.code == "CYCLES_MISSING"]
    close_recording(recording)
    assert noted == [
        "4 cycles are missing before cycle 20 (row 11)",
        "7 cycles are missing before cycle 57 (row 41)",
    ]
    found = {finding.what: finding for finding in verify_run(path)}
    assert found["sequence"].severity == found["rows"].severity is Severity.WARNS
    assert "2 gaps in the cycle index, 11 cycles missing" in found["sequence"].found


def test_a_block_out_of_order_ends_the_run(tmp_path: Path) -> None:
    recorder = ThreadedRecorder(RunWriter(tmp_path / RUN, header()), 1000.0)
    recorder.put(block(0, 100))
    recorder.put(block(50, 10))
    wait_for_the_thread()
    with pytest.raises(RunFileError, match="out of order"):
        recorder.put(block(60, 10))
    recorder.abandon()


def test_the_inline_recorder_flushes_by_the_clock_that_is_handed_in(tmp_path: Path) -> None:
    clock = VirtualClock()
    writer = CountingWriter(tmp_path / RUN, header())
    recorder = InlineRecorder(writer, clock)
    seen = []
    for first in range(0, 100, 10):
        recorder.put(block(first, 10))
        seen.append(
            (writer.flushes - writer.synchronisations, writer.synchronisations, writer.rows_stored)
        )
        clock.advance_ns(250_000_000)
    # At once, after 0.5 s: flushed; 1 s: synchronised; and so on. The clock says so, not the number of rows.
    assert seen == [
        (1, 0, 10), (1, 0, 10), (2, 0, 30), (2, 0, 30), (2, 1, 50), (2, 1, 50), (3, 1, 70), (3, 1, 70), (3, 2, 90), (3, 2, 90),  # noqa: E501
    ]  # fmt: skip
    recorder.event(Event(EPOCH_NS, "info", "NOTE", "test", "flushes too"))
    assert writer.rows_stored == 100
    assert_holds(recorder.close("COMPLETED"), np.arange(100))


def rows_in(part: Path) -> int:
    """Rows that a kill at this moment would leave: the library must not know that it writes this file itself."""
    left = part.with_name("left.h5.part")
    left.write_bytes(part.read_bytes())
    with FileSource(left) as source:
        return source.rows


def test_in_virtual_time_rows_lie_in_the_file_within_half_a_second_from_the_first_block_on(
    tmp_path: Path,
) -> None:
    """By real time: many chunks come before its clock has moved, and blocks of up to 0.1 s after that."""
    clock = VirtualClock()
    writer = RunWriter(tmp_path / RUN, header(), chunk_rows=64)
    recorder = InlineRecorder(writer, clock)
    recorder.put(block(0, 200))
    assert rows_in(writer.part) == 200
    taken: list[tuple[int, int]] = []
    for step in range(1, 60):
        clock.advance_ns((7, 90, 100, 31)[step % 4] * 1_000_000)
        recorder.put(block(200 * step, 200))
        taken.append((clock.monotonic_ns(), 200 * (step + 1)))
        old = [rows for time, rows in taken if clock.monotonic_ns() - time >= 500_000_000]
        assert rows_in(writer.part) >= max(old, default=200)
    recorder.abandon()


def test_in_real_time_rows_lie_in_the_file_though_no_clock_moves(tmp_path: Path) -> None:
    """Each look of the writer thread at the ring ends with a flush, the first one as well."""

    class Told(RunWriter):
        flushed = threading.Event()

        def flush(self) -> None:
            super().flush()
            if self.rows == 30:
                self.flushed.set()

    writer = Told(tmp_path / RUN, header())
    recorder = ThreadedRecorder(writer, 1000.0, wall_clock=VirtualClock())
    recorder.put(block(0, 30))
    assert writer.flushed.wait(PATIENCE_S)
    assert rows_in(writer.part) == 30
    recorder.abandon()


def test_what_the_inline_recorder_flushed_survives_being_abandoned(tmp_path: Path) -> None:
    clock = VirtualClock()
    recorder = InlineRecorder(RunWriter(tmp_path / RUN, header()), clock)
    recorder.put(block(0, 70))
    clock.advance_ns(500_000_000)
    recorder.put(block(70, 7))
    recorder.put(block(77, 7))
    recorder.abandon()
    recorder.abandon()
    with pytest.raises(RunFileError, match="abandoned"):
        recorder.put(block(84, 7))
    assert_holds(recover_run(tmp_path / (RUN + ".part")).path, np.arange(77))
