"""The window without a screen: Qt draws into memory, and every test has a folder and a session of its own."""

from __future__ import annotations

import os

os.environ["QT_QPA_PLATFORM"] = "offscreen"  # before Qt is imported anywhere

from collections.abc import Iterator
from pathlib import Path

import pytest

from rig.window.session import WindowSession


@pytest.fixture
def session(tmp_path: Path, qapp: object) -> Iterator[WindowSession]:
    """The shared state of a window over an empty folder of runs."""
    made = WindowSession(tmp_path / "runs")
    made.folder.mkdir()
    yield made
    made.deleteLater()
