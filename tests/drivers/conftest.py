"""What several tests of the drivers need."""

from collections.abc import Iterator

import pytest

from tests.drivers.can_bench import Setup, close, setup


@pytest.fixture
def bench() -> Iterator[Setup]:
    made = setup()
    made.rig.open()
    yield made
    close(made)
