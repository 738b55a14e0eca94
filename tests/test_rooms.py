"""How the suite is divided into processes, what they say together; and no example that a slow machine fails."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from tests import __main__ as rooms_of
from tests.__main__ import (
    ALONE,
    FAILED,
    MOST_FILES,
    NOTHING_FOUND,
    PASSED,
    TESTS,
    Outcome,
    files_below,
    main,
    processes_of,
)

PASSES = "def test_it(): pass\n"
FAILS = "def test_it(): assert not 'what is wrong'\n"


def test_the_files_that_stand_alone_are_there_and_named_once() -> None:
    assert len(set(ALONE)) == len(ALONE)
    assert [name for name in ALONE if not (TESTS / name).is_file()] == []


def test_each_file_is_in_one_process_and_none_is_crowded() -> None:
    files = files_below([TESTS])
    parts = processes_of(files)
    assert Path(__file__) in files
    assert Counter(f for part in parts for f in part) == Counter(files)
    assert max(map(len, parts)) <= MOST_FILES
    assert max(sum(f.parent.name == "extras" for f in part) for part in parts) <= 6
    assert [part[0] for part in parts[: len(ALONE)]] == [TESTS / n for n in ALONE]


def test_a_small_room_is_whole_and_shares_its_process() -> None:
    parts = processes_of(files_below([TESTS / "fuzzing", TESTS / "model" / "kernels"]))
    assert [len(part) for part in parts] == [3]
    extras = sorted((TESTS / "extras").glob("test_*.py"))[:8]
    assert max(map(len, processes_of(extras))) <= 6 < len(extras)
    window = files_below([TESTS / "rig" / "window"])
    assert len(window) > MOST_FILES
    assert {f.parent for part in processes_of(window) for f in part} == {window[0].parent}


def test_what_is_run_by_hand_is_no_part_of_it() -> None:
    assert list((TESTS / "benchmarks").glob("test_*.py"))
    assert [f for f in files_below([TESTS]) if "benchmarks" in f.parts] == []


def test_what_needs_an_extra_that_is_missing_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """pytest itself would collect a file that is named, and fail at its imports."""
    monkeypatch.setattr(rooms_of, "WITHOUT_EXTRA", ["test_fleet.py"])
    extras = [f.name for f in files_below([TESTS / "extras"])]
    assert "test_fleet.py" not in extras
    assert "test_fleet_parts.py" in extras


def test_a_place_is_a_folder_or_a_file() -> None:
    here = Path(__file__)
    assert files_below([here]) == [here]
    assert files_below([TESTS / "fuzzing", here]) == [
        TESTS / "fuzzing" / "test_fuzzing.py",
        here,
    ]


@pytest.fixture
def rooms(tmp_path: Path) -> Path:
    """Two rooms: in one both files pass, in the other one fails."""
    for name, text in (("a/test_1", PASSES), ("a/test_2", PASSES), ("b/test_3", FAILS)):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / f"{name}.py").write_text(text)
    return tmp_path


def test_a_room_that_fails_is_named_and_shown(
    rooms: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(rooms)]) == FAILED
    said = capsys.readouterr().out
    assert "what is wrong" in said
    assert "2 passed" in said
    assert "1 failed" in said
    assert said.splitlines()[-1].startswith("FAILED ")
    assert "b/test_3.py::test_it" in said.splitlines()[-1]


def test_what_follows_two_dashes_is_for_pytest(
    rooms: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(rooms / "a"), "--", "-k", "test_1"]) == PASSED
    assert "1 deselected" in capsys.readouterr().out
    assert main([str(rooms / "a"), "--", "-k", "nothing_like_it"]) == NOTHING_FOUND


def test_a_place_without_tests_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SystemExit) as ended:
        main([str(tmp_path)])
    assert ended.value.code == 2


@pytest.mark.parametrize(("code", "is_failed"), [(0, False), (5, False), (1, True), (-11, True)])
def test_a_process_that_was_killed_has_failed(code: int, is_failed: bool) -> None:
    ended = Outcome("room", code, "", 1.0)
    assert ended.is_failed is is_failed
    assert ended.failures == [f"FAILED room: ended by {code}"]


def test_an_example_may_take_as_long_as_it_takes() -> None:
    assert settings.default is not None
    assert settings.default.deadline is None
    assert HealthCheck.too_slow in settings.default.suppress_health_check
