"""The program killed in motion by the system, over the hub: the motor stands by itself, and the stage knows of it."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from rig.bench.commissioning import FIRST_SPEED
from tests.rig.served_rig import served_rig
from tests.rig.trial.commission.killed import RATE, stop_kill

LONGEST = 2.0


@pytest.mark.realtime
def test_the_motor_stands_by_itself_and_the_stage_goes_on(tmp_path: Path) -> None:
    folder = tmp_path / "runs"
    with served_rig(RATE, "wire-bare", log=tmp_path / "plant.log") as served:
        config = served.configuration(tmp_path)
        command = [
            sys.executable,
            "-m",
            "tests.rig.trial.commission.killed",
            str(config),
            str(folder),
        ]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as program:
            assert program.stdout is not None
            turning = (float(line) for line in program.stdout)
            assert any(abs(speed) > 0.9 * FIRST_SPEED for speed in turning)
            killed_ns = time.monotonic_ns()
            program.send_signal(signal.SIGKILL)
            program.wait()
        time_ns, speed = served.plant().T
        while not len(time_ns) or time_ns[-1] < killed_ns + LONGEST * 1e9:
            time_ns, speed = served.plant().T
        late = time_ns > killed_ns + LONGEST * 1e9
        assert float(abs(speed[late]).max()) < 0.1, "it goes on turning"
        assert float(abs(speed[time_ns < killed_ns]).max()) > 0.9 * FIRST_SPEED
        seen = stop_kill(config, folder, seconds="0.5")
    assert seen.is_fine, [finding.sentence for finding in seen.findings]
    assert [finding.what for finding in seen.findings] == ["standstill", "drive"]
