"""A few kills of the kill study, in every run of the tests."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

KILLS = 6


@pytest.mark.skipif(os.name != "posix", reason="SIGKILL and fork")
def test_kills_at_random_moments_lose_no_flushed_row_and_delete_no_byte() -> None:
    # A process of its own: it forks, which a process with a window's threads must not.
    command = [sys.executable, "-m", "tests.end_to_end.kill_study", "--kills", str(KILLS)]
    done = subprocess.run(
        command, cwd=Path(__file__).parents[2], capture_output=True, text=True, timeout=1800
    )
    outcome = json.loads(done.stdout or "{}")
    assert outcome["wrong"] == [], done.stderr
    assert sum(outcome["met"].values()) == KILLS
    assert outcome["flushed_rows"] > 0
    assert outcome["bytes_kept"] > 0
