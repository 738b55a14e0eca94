"""The order in which several cores take the files of the suite; and no example that a slow machine fails."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

from tests.conftest import LONGEST_FIRST, TESTS, pytest_collection_modifyitems


def test_the_long_files_are_there_and_named_once() -> None:
    assert len(set(LONGEST_FIRST)) == len(LONGEST_FIRST)
    assert [name for name in LONGEST_FIRST if not (TESTS / name).is_file()] == []


def test_long_files_come_first_and_no_test_is_lost() -> None:
    names = ["test_types.py", LONGEST_FIRST[2], "test_types.py", LONGEST_FIRST[0], "test_order.py"]
    items: list[Any] = [SimpleNamespace(path=TESTS / n, nr=k) for k, n in enumerate(names)]
    pytest_collection_modifyitems(items)
    assert [item.nr for item in items] == [3, 1, 0, 2, 4]


def test_workers_keep_that_order(pytestconfig: pytest.Config) -> None:
    """xdist would begin with the files that have the most tests, and end with the long ones that have few."""
    assert getattr(pytestconfig.option, "loadscopereorder", False) is False


def test_an_example_may_take_as_long_as_it_takes() -> None:
    assert settings.default is not None
    assert settings.default.deadline is None
    assert HealthCheck.too_slow in settings.default.suppress_health_check
