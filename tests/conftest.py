"""What every test has: benches whose state lies in a folder of the session, never in this computer's own."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from rig.bench.state import VARIABLE


@pytest.fixture(scope="session", autouse=True)
def state_folders(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Children inherit the variable: a hub's runs in a process of their own latch there too."""
    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = str(tmp_path_factory.mktemp("state"))
    yield
    if before is None:
        del os.environ[VARIABLE]
    else:
        os.environ[VARIABLE] = before
