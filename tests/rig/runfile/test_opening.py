"""A growing file in one process: whoever reads it, and however many, is given the rows that stand there."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import h5py
import numpy as np
import pytest

from rig.errors import RunFileError
from rig.library.index import LibraryIndex
from rig.library.place import index_path
from rig.library.writer_alive import is_being_written
from rig.runfile.opening import open_for_reading
from rig.runfile.read import close_recording, follow, open_run
from rig.runfile.recover import recover_run
from rig.runfile.source import FileSource
from rig.runfile.write import RunWriter
from tests.rig.runfile.making import CYCLE_NS, EPOCH_NS, block, counts_of, header

ROWS, CHUNK = 700, 64


@pytest.fixture(params=[True, False], ids=["compressed", "plain"])
def part(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A file of many chunks as a writer leaves it that is at work or was killed."""
    writer = RunWriter(
        tmp_path / "00001-friction-A1.h5", header(), compress=request.param, chunk_rows=CHUNK
    )
    for first in range(0, ROWS, 50):
        writer.append(block(first, 50))
        writer.flush()
    writer.abandon()
    return writer.part


def assert_rows_are_right(source: FileSource, start: int = 0, stop: int = ROWS) -> None:
    cycles = np.arange(start, stop)
    np.testing.assert_array_equal(source.cycles(start, stop), cycles)
    np.testing.assert_array_equal(source.time_ns(start, stop), EPOCH_NS + cycles * CYCLE_NS)
    for column, expected in zip(source.columns, counts_of(cycles).T, strict=True):
        np.testing.assert_array_equal(
            source.stored(column.name, start, stop), expected, err_msg=column.name
        )


def test_every_reader_is_given_the_rows_that_stand_there(part: Path) -> None:
    with FileSource(part) as first, FileSource(part) as second:
        for _ in range(3):
            assert first.refresh() == second.refresh() == ROWS
            assert_rows_are_right(first)
            assert_rows_are_right(second, CHUNK + 3, 3 * CHUNK + 5)
        with FileSource(part) as third:
            first.refresh()
            assert_rows_are_right(third)
        second.refresh()
        assert_rows_are_right(first)


def test_the_library_may_look_while_a_run_is_watched(part: Path) -> None:
    watched = open_run(part, digest=False)
    for _ in range(3):
        (listed,) = LibraryIndex(part.parent).search()
        assert listed.rows == ROWS
        index_path(part.parent).unlink()
        watched = follow(watched)
        assert isinstance(watched.source, FileSource)
        assert_rows_are_right(watched.source)
    close_recording(watched)


def test_readers_in_many_threads_take_turns(part: Path) -> None:
    def look(_: int) -> None:
        for _ in range(10):
            with FileSource(part) as source:
                source.refresh()
                assert_rows_are_right(source, 2 * CHUNK)

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(look, range(4)))


def test_a_run_is_recovered_while_somebody_reads_it(part: Path) -> None:
    with FileSource(part) as watcher:
        assert not is_being_written(part)
        recovered = recover_run(part)
        assert_rows_are_right(watcher)
    with FileSource(recovered.path) as source:
        assert source.rows == ROWS
        assert_rows_are_right(source)


def test_one_reader_letting_go_leaves_the_file_to_the_others(part: Path) -> None:
    first, second = open_for_reading(part), open_for_reading(part)
    first.close()
    first.close()
    with pytest.raises(RunFileError, match="was closed"), first.use():
        pass
    with second.use() as file:
        assert isinstance(file, h5py.File)
    second.close()
    assert not file
    with open_for_reading(part) as again, again.use() as file:
        assert file


def test_a_file_of_the_same_name_is_another_file(part: Path, tmp_path: Path) -> None:
    with FileSource(part) as old:
        other = tmp_path / "other"
        other.mkdir()
        writer = RunWriter(other / "00001-friction-A1.h5", header(), chunk_rows=CHUNK)
        writer.append(block(0, 30))
        writer.flush()
        writer.abandon()
        writer.part.replace(part)
        with FileSource(part) as new:
            assert new.rows == 30
            assert_rows_are_right(new, 0, 30)
        old.refresh()
        assert_rows_are_right(old)
