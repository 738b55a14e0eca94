"""Speed between SYNCs: lateness of sending, of the wire and of stamping against speeds and windows.

Late never makes an over-speed, and a real one is found within the cycles that are stated.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import pytest

from drivers.bus.network import TimeBase
from drivers.bus.sync_time import SyncTime
from drivers.channel import INPUT_ANGLE, Channel
from drivers.judge import CycleJudge
from drivers.port import MISSED_CYCLES, UNTIMED_CYCLES, Bound, Guard
from drivers.samples import Break

LIMIT = 264.7
"""rad/s: 2528 r/min."""
SCALE = 2.0 * np.pi / 32768
ONSET = 150
CYCLES = 400
CONSECUTIVE = 2


@dataclass(frozen=True)
class Line:
    """How a computer and its bus keep time: mean lateness in periods, of now and then a cycle."""

    period_ns: int
    base: TimeBase
    sending: float
    hearing: float
    stamping: float
    seed: int


def seldom(random: np.random.Generator, mean: float, period_ns: int) -> int:
    """A lateness [ns]: mostly next to none, in one cycle of four about `mean` periods, five at most."""
    size = random.exponential(mean) if random.random() < 0.25 else 0.02 * random.random()
    return round(min(size, 5.0) * period_ns)


def judged(line: Line, lag: int, speeds: np.ndarray) -> tuple[int, Break] | None:
    """The cycle and the break that end a run at `speeds` (n,) [rad/s]; None where nothing does."""
    random, period = np.random.default_rng(line.seed), line.period_ns
    judge = CycleJudge([Channel(name=INPUT_ANGLE, unit="rad", scale=SCALE)], period)
    weight = SCALE / (lag * period * 1e-9)
    judge.adopt(
        Guard(
            (
                Bound(
                    cause="over_speed",
                    weights={INPUT_ANGLE: weight},
                    low=-LIMIT,
                    high=LIMIT,
                    lag=lag,
                    consecutive=CONSECUTIVE,
                ),
            )
        )
    )
    time, angle, heard, due, answered = SyncTime(line.base), 0.0, 0, 0, 0
    for cycle, speed in enumerate(speeds):
        sent = max(due, answered) + seldom(random, line.sending, period)
        # As the loop does it: a little is made up for, more moves the schedule.
        due = (due if sent - due <= period // 2 else sent) + period
        now = sent + seldom(random, line.hearing, period)
        angle, heard = angle + speed * (now - heard) * 1e-9, now
        answered = now + period // 10
        # What is received is stamped late, without anybody waiting for it.
        received = answered + seldom(random, line.stamping, period)
        echo = now + 7 * 10**9 if line.base == "hardware" else received
        time.of_cycle(echo, [received + 7 * 10**9], sent, sent)
        count = int(angle / SCALE)
        broken = judge.judge([count], 0, cycle, time.sync_ns, time.doubt(answered - sent))
        if broken is not None:
            return cycle, broken
    return None


BASES: tuple[TimeBase, ...] = ("hardware", "host")
LINES = [
    Line(period, base, sending, hearing, 3.0 * (seed % 2), seed)
    for seed, (period, base, sending, hearing) in enumerate(
        itertools.product((1_000_000, 4_000_000), BASES, (0.0, 0.6, 3.0), (0.0, 0.6, 2.0))
    )
]


@pytest.mark.parametrize("share", [0.5, 0.8, 0.99])
@pytest.mark.parametrize("window_ns", [4_000_000, 40_000_000])
def test_late_never_makes_an_over_speed(share: float, window_ns: int) -> None:
    for line in LINES:
        lag = max(1, round(window_ns / line.period_ns))
        assert judged(line, lag, np.full(CYCLES, share * LIMIT)) is None, line


@pytest.mark.parametrize("factor", [1.1, 1.3, 3.0])
@pytest.mark.parametrize("window_ns", [4_000_000, 40_000_000])
def test_a_real_over_speed_is_found_within_the_stated_cycles(factor: float, window_ns: int) -> None:
    speeds = np.full(CYCLES, 0.8 * LIMIT)
    speeds[ONSET:] = factor * LIMIT
    for line in LINES:
        lag = max(1, round(window_ns / line.period_ns))
        found = judged(line, lag, speeds)
        assert found is not None, line
        cycle, broken = found
        assert ONSET <= cycle <= ONSET + UNTIMED_CYCLES + lag + CONSECUTIVE, line
        assert broken.is_trip
        if line.base == "hardware":
            assert broken.cause == "over_speed"
        else:
            assert broken.cause in ("over_speed", MISSED_CYCLES)


def test_the_run_away_beside_a_late_wire_is_called_what_it_is() -> None:
    # While the doubt lasts the window grows: 20 % too fast, with answers that take 0.9 ms of 4 ms, is an over-speed.
    line = Line(1_000_000, "host", 0.0, 0.0, 0.0, 1)
    speeds = np.full(CYCLES, 1.2 * LIMIT)
    found = judged(line, 4, speeds)
    assert found is not None
    assert found[1].cause == "over_speed"
    assert found[1].value == pytest.approx(1.2 * LIMIT, rel=0.02)


def test_intervals_that_stay_too_short_end_as_missed_cycles() -> None:
    judge = CycleJudge([Channel(name=INPUT_ANGLE, unit="rad", scale=1.0)], 1_000_000)
    bound = Bound(cause="over_speed", weights={INPUT_ANGLE: 1.0}, low=-9.0, high=9.0, lag=4)
    judge.adopt(Guard((bound,)))
    breaks = [judge.judge([0], 0, row, 800_000 * row) for row in range(40)]
    at = next(row for row, broken in enumerate(breaks) if broken is not None)
    broken = breaks[at]
    assert broken is not None
    assert (broken.cause, at) == (MISSED_CYCLES, 4 + UNTIMED_CYCLES - 1)


def test_a_jump_of_the_adapters_clock_is_not_taken_for_time() -> None:
    time, second = SyncTime("hardware"), 10**9
    for cycle, jump in enumerate([0, 0, 5 * second, 5 * second, 0]):
        time.of_cycle(9 * second + cycle * 1_000_000 + jump, [], cycle * 1_000_000, 0)
        assert time.sync_ns == cycle * 1_000_000
