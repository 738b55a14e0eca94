"""The guard of one cycle at a time: a SYNC that comes late is not an over-speed, a real one is found all the same."""

from __future__ import annotations

import pytest

from drivers.channel import INPUT_ANGLE, Channel
from drivers.judge import CycleJudge
from drivers.port import Bound, Guard

PERIOD_NS = 4_000_000
LIMIT = 100.0
"""Counts per second."""


def judged(steps: list[tuple[int, int]], lag: int = 1) -> float | None:
    """The value that broke the guard, given (counts moved, ns passed) per cycle; None where nothing did."""
    judge = CycleJudge([Channel(name=INPUT_ANGLE, unit="rad", scale=1.0)], PERIOD_NS)
    weight = 1.0 / (lag * PERIOD_NS * 1e-9)
    judge.adopt(
        Guard(
            (
                Bound(
                    cause="over_speed",
                    weights={INPUT_ANGLE: weight},
                    low=-LIMIT,
                    high=LIMIT,
                    lag=lag,
                    consecutive=2,
                ),
            )
        )
    )
    counts, time_ns = 0, 0
    for row, (moved, passed) in enumerate(steps):
        counts, time_ns = counts + moved, time_ns + passed
        broken = judge.judge([counts], 0, row, time_ns)
        if broken is not None:
            return broken.value
    return None


@pytest.mark.parametrize("lag", [1, 3])
@pytest.mark.parametrize("late", [2, 5, 20])
def test_a_late_sync_leaves_the_shaft_more_time(lag: int, late: int) -> None:
    # 0.3 counts per ms: below the limit, however late the SYNC comes.
    steady = [(0, PERIOD_NS)] * 4 + [
        (0, PERIOD_NS),
        *[(int(0.08 * late * 4), late * PERIOD_NS)] * 4,
    ]
    assert judged(steady, lag) is None


@pytest.mark.parametrize("late", [1, 2, 5])
def test_a_real_over_speed_breaks_it_late_or_not(late: int) -> None:
    found = judged([(0, PERIOD_NS)] * 3 + [(late, late * PERIOD_NS)] * 4)
    assert found == pytest.approx(250.0)


@pytest.mark.parametrize("late_ns", [300_000, 1_200_000, 1_900_000])
def test_any_lateness_is_taken_into_account(late_ns: int) -> None:
    found = judged([(0, PERIOD_NS)] + [(1, PERIOD_NS + late_ns)] * 3)
    assert found == pytest.approx(1e9 / (PERIOD_NS + late_ns))
