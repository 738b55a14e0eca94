"""Noise is a function of seed, channel and cycle; SYNC of seed and cycle; the drive's registers hold whole counts."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.drive_state import STATUSWORD_OF, DriveState
from drivers.port import Mode
from model import closed_loop
from sim_backend.clock import SyncTimer
from sim_backend.servo_drive import ServoDrive
from sim_backend.streams import CHUNK, CycleNoise, stream
from tests.sim_backend.rigs import MOTOR


def test_noise_does_not_depend_on_how_it_is_asked_for() -> None:
    whole = CycleNoise(5, "torque").at(0, 3 * CHUNK)
    cut = CycleNoise(5, "torque")
    rng = np.random.default_rng(1)
    for start in rng.integers(0, 3 * CHUNK - 700, 30):
        length = int(rng.integers(1, 700))
        assert np.array_equal(cut.at(int(start), length), whole[start : start + length])


def test_channels_and_seeds_have_their_own_noise() -> None:
    found = [CycleNoise(s, n).at(0, 2000) for s in (1, 2) for n in ("torque", "jitter")]
    correlation = np.corrcoef(found) - np.eye(4)
    assert np.max(np.abs(correlation)) < 4.0 / np.sqrt(2000)
    assert stream(1, "a").normal() != stream(1, "b").normal()
    assert stream(-1, "a").normal() == stream(-1, "a").normal()


@pytest.mark.parametrize("jitter", [15e-6, 5e-3])
def test_stamps_never_run_backwards(jitter: float) -> None:
    timer = SyncTimer(1_000_000, jitter, 3, start_ns=17)
    late = timer.lateness_ns(100, 5000)
    stamps = timer.stamps_ns(100, late)
    assert np.all(np.diff(stamps) > 0)
    assert np.array_equal(stamps - late, 17 + 1_000_000 * np.arange(100, 5100))


def test_drive_walks_the_same_states_however_a_block_is_cut() -> None:
    def walked(length: int) -> list[tuple[int, int]]:
        drive, found = ServoDrive(MOTOR), []
        for mode in (Mode.OFF, Mode.SPEED, Mode.QUICK_STOP, Mode.TORQUE, Mode.OFF):
            for _ in range(0, 12, length):
                for part in drive.stretches(mode, length):
                    found += [(part.statusword, part.loop_mode)] * (part.stop - part.start)
        return found

    assert walked(1) == walked(3) == walked(12)
    assert walked(12)[11:14] == [
        (STATUSWORD_OF[DriveState.SWITCH_ON_DISABLED], closed_loop.OFF),
        (STATUSWORD_OF[DriveState.ENABLED], closed_loop.SPEED),
        (STATUSWORD_OF[DriveState.ENABLED], closed_loop.SPEED),
    ]
