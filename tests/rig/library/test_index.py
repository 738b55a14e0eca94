"""The index of a folder: always what the files say, whatever becomes of the cache; and how it is searched."""

from __future__ import annotations

import os
import shutil
import sqlite3
import subprocess
import sys
import threading
from datetime import UTC, date, datetime
from pathlib import Path

import pytest

from rig.errors import RunFileError
from rig.library import database, index, reading
from rig.library.database import SCHEMA
from rig.library.folder import claim_run, run_files
from rig.library.index import IndexedRun, LibraryIndex
from rig.library.place import index_path
from rig.runfile.read import glance
from rig.runfile.recover import recover_run
from rig.runfile.write import RunWriter
from tests.rig.library.stored import start, write
from tests.rig.runfile.making import block, header, write_run

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def several(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five runs: two gears, three protocols, four days, an aborted one, a dead one, a damaged one."""
    folder = tmp_path_factory.mktemp("several")
    write(folder, 1, start_time="2026-01-02T23:30:00.000+01:00", operator="Ada Grün")
    write(folder, 2, "home", serial="B2", outcome="ABORTED", start_time=start(3), operator="Bo")
    write(folder, 4, "starting-torque", origin="imported", outcome="", start_time=start(4))
    write(folder, 7, part=True, start_time=start(5))
    (folder / "00009-friction-A1.h5").write_bytes(b"no run at all")
    return folder


@pytest.fixture
def folder(several: Path, tmp_path: Path) -> Path:
    """Three of them in a folder of this test: a sealed, a dead and a damaged one."""
    for name in ("00001-friction-A1.h5", "00007-friction-A1.h5.part", "00009-friction-A1.h5"):
        shutil.copy2(several / name, tmp_path / name)
    return tmp_path


def numbers(found: list[IndexedRun]) -> list[int]:
    return [run.number for run in found]


def read_count(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The files that the index opens from here on."""
    opened: list[Path] = []
    true = reading.read_one
    monkeypatch.setattr(reading, "read_one", lambda path: (opened.append(path), true(path))[1])
    return opened


def test_the_index_says_what_the_files_say(several: Path) -> None:
    found = LibraryIndex(several).search()
    assert numbers(found) == [1, 2, 4, 7, 9]
    assert [run.state for run in found] == [
        "sealed",
        "sealed",
        "sealed",
        "left behind",
        "unreadable",
    ]
    assert [run.path for run in found] == list(run_files(several))
    for run in found[:4]:
        whole = glance(run.path)
        m, process = whole.metadata, whole.metadata.process
        assert m.gear is not None
        assert (run.run_id, run.protocol, run.gear_serial) == (
            m.run_id,
            m.experiment,
            m.gear_serial,
        )
        assert (run.outcome, run.origin, run.start) == (m.outcome, m.origin, m.start_time)
        assert (run.gear, run.operator, run.mounting) == (m.gear.name, m.operator, m.mounting)
        assert (run.backend, run.bench) == (process["backend"], process.get("bench", ""))
        assert (run.rows, run.duration, run.problem) == (whole.rows, whole.duration, "")
    assert "HDF5" in found[4].problem
    assert (found[0].gear, found[0].backend, found[0].operator) == (
        "CSF-25-120-2UH",
        "sim",
        "Ada Grün",
    )


def test_only_what_changed_is_read_again(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened = read_count(monkeypatch)
    assert LibraryIndex(folder).refresh() == len(opened) == 3
    assert LibraryIndex(folder).refresh() == 0
    write(folder, 10)
    assert LibraryIndex(folder).refresh() == 1
    assert opened[-1].name == "00010-friction-A1.h5"
    changed = folder / "00009-friction-A1.h5"
    before = changed.stat()
    changed.write_bytes(b"no run as well")
    os.utime(changed, ns=(before.st_atime_ns, before.st_mtime_ns + 1))
    again = LibraryIndex(folder)
    assert again.refresh() == 1
    (folder / "00007-friction-A1.h5.part").unlink()
    assert again.refresh() == 0
    assert numbers(again.search()) == [1, 9, 10]
    assert numbers(LibraryIndex(folder).search()) == [1, 9, 10]


def test_a_file_that_was_exchanged_is_read_again_though_size_and_time_agree(folder: Path) -> None:
    first = folder / "00009-friction-A1.h5"
    found = LibraryIndex(folder)
    found.refresh()
    other = folder / "other"
    other.write_bytes(b"n" * first.stat().st_size)
    os.utime(other, ns=(first.stat().st_atime_ns, first.stat().st_mtime_ns))
    other.rename(first)
    assert found.refresh() == 1


def test_a_deleted_index_is_made_anew(folder: Path) -> None:
    before = [repr(run) for run in LibraryIndex(folder).search()]
    index_path(folder).unlink()
    found = LibraryIndex(folder)
    assert found.refresh() == 3
    assert [repr(run) for run in found.search()] == before


@pytest.mark.parametrize("damage", ["garbage", "cut", "pages", "empty"])
def test_a_damaged_index_is_made_anew_and_that_is_said(folder: Path, damage: str) -> None:
    before = [repr(run) for run in LibraryIndex(folder).search()]
    path = index_path(folder)
    good = path.read_bytes()
    path.write_bytes(
        {
            "garbage": b"this is no database, only text of some length" * 100,
            "cut": good[: len(good) // 2 + 7],
            "pages": good[:4096] + bytes(len(good) - 4096),
            "empty": b"",
        }[damage]
    )
    found = LibraryIndex(folder)
    assert [repr(run) for run in found.search()] == before
    assert ("made anew" in found.rebuilt) == (damage != "empty")
    assert [repr(run) for run in LibraryIndex(folder).search()] == before
    assert LibraryIndex(folder).refresh() == 0


def test_an_index_of_another_version_is_made_anew(folder: Path) -> None:
    LibraryIndex(folder).refresh()
    with sqlite3.connect(index_path(folder)) as database:
        database.execute("DROP TABLE runs")
        database.execute("CREATE TABLE runs (something TEXT)")
        database.execute(f"PRAGMA user_version = {SCHEMA + 1}")
    database.close()
    found = LibraryIndex(folder)
    assert numbers(found.search()) == [1, 7, 9]
    assert f"version {SCHEMA + 1}" in found.rebuilt
    assert LibraryIndex(folder).refresh() == 0


def test_where_no_file_can_be_kept_the_index_lives_in_memory(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A folder of that name stands for a folder that may not be written: no permission stops an administrator.
    index_path(folder).mkdir(parents=True)
    opened = read_count(monkeypatch)
    found = LibraryIndex(folder)
    assert numbers(found.search()) == [1, 7, 9]
    assert "kept in memory" in found.rebuilt
    assert found.refresh() == 0
    assert len(opened) == 3


def test_an_index_that_may_be_read_but_not_written_is_used(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    LibraryIndex(folder).refresh()
    write(folder, 10)
    true = sqlite3.connect
    path = index_path(folder)
    monkeypatch.setattr(
        sqlite3,
        "connect",
        lambda _, timeout: true(f"file:{path}?mode=ro", uri=True, timeout=timeout),
    )
    found = LibraryIndex(folder)
    assert found.refresh() == 1
    assert "kept in memory" in found.rebuilt
    assert numbers(found.search()) == [1, 7, 9, 10]
    assert found.refresh() == 0


def test_another_process_that_writes_for_long_is_not_waited_for(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    LibraryIndex(folder).refresh()
    write(folder, 10)
    monkeypatch.setattr(database, "WAITING_TIME", 0.01)
    other = sqlite3.connect(index_path(folder), isolation_level=None)
    other.execute("BEGIN EXCLUSIVE")
    found = LibraryIndex(folder)
    assert numbers(found.search()) == [1, 7, 9, 10]
    assert "locked" in found.rebuilt
    other.execute("ROLLBACK")
    other.close()
    found.refresh()
    assert LibraryIndex(folder).refresh() == 0


def test_another_process_and_threads_that_scan_at_once_find_the_same(folder: Path) -> None:
    code = (
        "from rig.library.index import LibraryIndex\n"
        f"print([r.number for r in LibraryIndex({str(folder)!r}).search()])"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, cwd=ROOT
    )
    shared = LibraryIndex(folder)
    results: list[list[int]] = []
    threads = [
        threading.Thread(target=lambda: results.append(numbers(shared.search()))) for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert results == [[1, 7, 9]] * 4
    assert process.communicate()[0].strip() == "[1, 7, 9]"
    assert LibraryIndex(folder).refresh() == 0


def test_a_run_that_is_written_is_shown_as_such_then_left_behind_then_recovered(
    tmp_path: Path,
) -> None:
    place = claim_run(tmp_path, "friction", "A1")
    writer = RunWriter(place.path, header(place.run_id), chunk_rows=64)
    found = LibraryIndex(tmp_path)
    rows = []
    for first in (0, 30):
        writer.append(block(first, 30))
        writer.flush()
        (run,) = found.search()
        assert run.state == "being written"
        rows.append(run.rows)
    assert rows == [30, 60]
    assert [run.state for run in LibraryIndex(tmp_path).search(outcome="being written")] == [
        "being written"
    ]
    writer.abandon()
    (run,) = found.search()
    assert (run.state, run.number, run.outcome) == ("left behind", place.number, "")
    recover_run(writer.part)
    (run,) = found.search()
    assert (run.state, run.number, run.outcome, run.rows) == (
        "sealed",
        place.number,
        "INTERRUPTED",
        60,
    )


def test_a_run_that_has_only_just_begun_is_being_written_not_unreadable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    part = tmp_path / "00001-friction-A1.h5.part"
    part.write_bytes(b"\x89HDF")
    (run,) = LibraryIndex(tmp_path).search()
    assert (run.state, run.number) == ("unreadable", 1)
    monkeypatch.setattr(index, "is_being_written", lambda path: path == part)
    (run,) = LibraryIndex(tmp_path).search()
    assert run.state == "being written"


def test_numbers_are_never_used_again_whatever_the_index_forgot(tmp_path: Path) -> None:
    numbers_given = []
    for outcome in ("COMPLETED", "ABORTED", "TRIPPED"):
        place = claim_run(tmp_path, "friction", "A1")
        write(tmp_path, place.number, outcome=outcome)
        numbers_given.append(place.number)
    found = LibraryIndex(tmp_path)
    assert [(run.number, run.outcome) for run in found.search()] == [
        (1, "COMPLETED"),
        (2, "ABORTED"),
        (3, "TRIPPED"),
    ]
    for path in tmp_path.glob("00003*"):
        path.unlink()
    index_path(tmp_path).unlink()
    assert numbers(found.search()) == [1, 2]
    assert claim_run(tmp_path, "home", "A1").number == 4
    assert numbers(found.search()) == [1, 2]


@pytest.mark.parametrize(
    ("asked", "expected"),
    [
        ({}, [1, 2, 4, 7, 9]),
        ({"gear": "a1"}, [1, 4, 7]),
        ({"gear": "A"}, []),
        ({"protocol": "HOME"}, [2]),
        ({"outcome": "aborted"}, [2]),
        ({"outcome": "left behind"}, [7]),
        ({"origin": "imported"}, [4]),
        ({"text": "grün FRICTION"}, [1, 7]),
        ({"text": "grün home"}, []),
        ({"text": "a_1"}, []),
        ({"text": "%"}, []),
        ({"text": "hdf5"}, [9]),
        ({"since": "2026-01-03"}, [2, 4, 7]),
        ({"since": date(2026, 1, 3), "until": date(2026, 1, 3)}, [2]),
        ({"until": "2026-01-02"}, [1]),
        ({"since": "2026-01-02T22:29+00:00", "until": "2026-01-02T22:31+00:00"}, [1]),
        ({"since": "2026-01-02T22:31+00:00", "until": "2026-01-02T23:59+00:00"}, []),
        ({"since": datetime(2026, 1, 5, 8, tzinfo=UTC), "gear": "A1"}, [7]),
        ({"since": "2026-01-03T09:00"}, [2, 4, 7]),
        ({"since": "2026-01-03", "protocol": "friction", "origin": "simulated"}, [7]),
    ],
)
def test_search(several: Path, asked: dict[str, str], expected: list[int]) -> None:
    assert numbers(LibraryIndex(several).search(**asked)) == expected  # type: ignore[arg-type]


def test_a_day_that_is_none_is_refused(several: Path) -> None:
    with pytest.raises(ValueError, match="isoformat"):
        LibraryIndex(several).search(since="yesterday")


def test_a_folder_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(RunFileError, match="no folder of runs"):
        LibraryIndex(tmp_path / "nowhere").search()


def test_an_empty_folder_stays_empty(tmp_path: Path) -> None:
    assert LibraryIndex(tmp_path).search() == []


def test_reading_a_folder_tells_how_far_it_is(tmp_path: Path) -> None:
    for number in range(3):
        (tmp_path / f"{number}").mkdir()
        write_run(tmp_path / f"{number}", 25).rename(tmp_path / f"0000{number + 1}-friction-A1.h5")
    told: list[tuple[int, int]] = []
    index = LibraryIndex(tmp_path, lambda done, of: told.append((done, of)))
    assert len(index.search()) == 3
    assert told == [(0, 3), (1, 3), (2, 3)]
    index.search()
    assert len(told) == 3
