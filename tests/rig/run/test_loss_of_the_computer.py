"""The computer is lost while the motor turns, over the hub in wall time: when it stands, by the plant's own log."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from drivers.bus.cia402.config import DriveConfig
from tests.rig.run.losing import RATE, SPEED
from tests.rig.served_rig import Served, served_rig

pytestmark = pytest.mark.realtime

CARRIERS = ("wire", "wire-csp", "wire-analog")
ATTEMPTS = 4
"""Runs that are begun until one turns: the computer may be in company."""
STANDS = 0.5
"""rad/s below which the motor stands."""
COVER = DriveConfig(node_id=1).computer_lost_ms * 1e-3
"""s after which drive or coupler has missed the computer's heartbeat."""
BEAT = DriveConfig(node_id=1).computer_heartbeat_ms * 1e-3
RAMP = 0.6
"""s for the drive's own ramp from this speed, with what a simulation in company is late."""
WITHIN = COVER + BEAT + RAMP
"""s from the loss to standstill: what covers it, a heartbeat that had just been sent, and the ramp."""


@contextmanager
def lost(served: Served, carrier: str, folder: Path, way: str) -> Iterator[subprocess.Popen[str]]:
    """A run in a process of its own, once the motor turns."""
    command = [sys.executable, "-m", "tests.rig.run.losing", carrier, str(served.port)]
    root = Path(__file__).parents[3]
    words = []
    for _ in range(ATTEMPTS):
        with subprocess.Popen(
            [*command, str(folder), way], stdout=subprocess.PIPE, text=True, cwd=root
        ) as process:
            assert process.stdout is not None
            words.append(process.stdout.readline())
            if words[-1].startswith("turning"):
                try:
                    yield process
                finally:
                    process.kill()
                return
        # In company a rig is refused before it moves, or trips: then nothing was lost yet.
        served.forget()
    pytest.fail(f"the computer was too slow to turn at all: {words}")


def standing_after(served: Served, since_ns: int, patience: float = 8.0) -> float:
    """s from an instant until the plant stands for good, as far as its log goes `patience` [s] later."""
    end = time.monotonic() + patience
    while time.monotonic() < end:
        time.sleep(0.2)
        log = served.plant()
        after = log[log[:, 0] >= since_ns]
        if len(after) and np.all(np.abs(after[after[:, 0] >= after[-1, 0] - 1e9, 1]) < STANDS):
            moving = after[np.abs(after[:, 1]) >= STANDS, 0]
            if after[-1, 0] - since_ns > 1.5e9:
                return float((moving[-1] - since_ns) * 1e-9) if len(moving) else 0.0
    return float("inf")


@pytest.fixture(params=CARRIERS)
def served(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[Served, str]]:
    """A rig of each kind behind a hub."""
    with served_rig(RATE, request.param, tmp_path / "plant.log") as found:
        yield found, request.param


def rest_of(process: subprocess.Popen[str]) -> str:
    out, _ = process.communicate(timeout=60.0)
    return out


def test_a_killed_process_leaves_a_motor_that_stands(
    served: tuple[Served, str], tmp_path: Path
) -> None:
    rig, carrier = served
    with lost(rig, carrier, tmp_path, "nothing") as process:
        process.kill()
        at = time.monotonic_ns()
        assert standing_after(rig, at) < WITHIN


def test_a_suspended_process_leaves_a_motor_that_stands_and_stays_so_when_it_wakes_up(
    served: tuple[Served, str], tmp_path: Path
) -> None:
    rig, carrier = served
    with lost(rig, carrier, tmp_path, "nothing") as process:
        process.send_signal(signal.SIGSTOP)
        at = time.monotonic_ns()
        time.sleep(3.0)
        assert standing_after(rig, at) < WITHIN
        process.send_signal(signal.SIGCONT)
        awake = time.monotonic_ns()
        told = rest_of(process)
        log = rig.plant()
        after = log[log[:, 0] >= awake]
        assert len(after)
        assert np.abs(after[:, 1]).max() < STANDS
        assert told.startswith("ended TRIPPED True"), told


def test_an_interpreter_that_is_kept_leaves_a_motor_that_stands(
    served: tuple[Served, str], tmp_path: Path
) -> None:
    rig, carrier = served
    with lost(rig, carrier, tmp_path, "interpreter") as process:
        at = time.monotonic_ns()
        assert standing_after(rig, at) < WITHIN
        told = rest_of(process)
        assert told.startswith("ended TRIPPED True"), told
        log = rig.plant()
        # From when the drive had stopped it: never again, whatever the loop had in hand.
        assert np.abs(log[log[:, 0] >= at + 2e9, 1]).max() < STANDS


def test_a_serving_thread_that_raises_ends_in_a_ramp(
    served: tuple[Served, str], tmp_path: Path
) -> None:
    rig, carrier = served
    with lost(rig, carrier, tmp_path, "serving") as process:
        at = time.monotonic_ns()
        told = rest_of(process)
        assert told.startswith("raised The run ended ABORTED, standstill was verified"), told
        assert standing_after(rig, at) < 2.0


def test_the_plant_turns_when_the_computer_is_lost(
    served: tuple[Served, str], tmp_path: Path
) -> None:
    """What the others show is not that it never turned. How long it goes on depends on the company of this computer."""
    rig, carrier = served
    with lost(rig, carrier, tmp_path, "nothing"):
        at = time.monotonic_ns()
        time.sleep(0.5)
        log = rig.plant()
        near = log[np.abs(log[:, 0] - at) <= 0.2e9]
        assert np.median(np.abs(near[:, 1])) > 0.5 * SPEED
