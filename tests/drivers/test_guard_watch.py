"""The per-cycle guard: the first cycle outside a bound is found, whatever the cut into blocks."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.channel import Channel
from drivers.judge import CycleJudge
from drivers.port import Bound, Guard, GuardWatch

CHANNELS = (
    Channel(name="input_angle", unit="rad", scale=0.5),
    Channel(name="torque", unit="N m", scale=0.1),
)


def first_break_cut(
    guard: Guard, counts: np.ndarray, flags: np.ndarray, size: int
) -> tuple[int, str] | None:
    watch = GuardWatch(CHANNELS)
    for start in range(0, len(counts), size):
        block, marks = counts[start : start + size], flags[start : start + size]
        found = watch.first_break(guard, block, marks)
        if found is not None:
            return start + found.row, found.cause
        watch.accept(block, marks)
    return None


def test_a_level_bound_names_row_value_and_limit() -> None:
    counts = np.array([[0, 1], [0, 5], [0, 9]])
    found = GuardWatch(CHANNELS).first_break(
        Guard((Bound(cause="over-torque", weights={"torque": 0.1}, high=0.4),)),
        counts,
        np.zeros(3, np.uint16),
    )
    assert found is not None
    assert (found.row, found.cause, found.limit) == (1, "over-torque", 0.4)
    assert found.value == pytest.approx(0.5)


def test_a_lagged_bound_is_a_speed() -> None:
    position = np.cumsum([0, 1, 1, 1, 7, 7, 1])
    counts = np.column_stack([position, np.zeros(7, dtype=np.int64)])
    bound = Bound(cause="over-speed", weights={"input_angle": 1.0 / 2}, low=-6.0, high=6.0, lag=2)
    found = GuardWatch(CHANNELS).first_break(Guard((bound,)), counts, np.zeros(7, np.uint16))
    assert found is not None
    assert found.row == 5


def test_an_incomplete_cycle_is_not_judged() -> None:
    counts = np.array([[0, 99], [0, 0]])
    bound = Bound(cause="over-torque", weights={"torque": 0.1}, high=0.4)
    assert (
        GuardWatch(CHANNELS).first_break(Guard((bound,)), counts, np.array([1, 0], np.uint16))
        is None
    )


@given(
    st.lists(
        st.tuples(st.integers(-5, 5), st.integers(-9, 9), st.booleans()), min_size=1, max_size=40
    ),
    st.integers(0, 3),
    st.integers(1, 3),
    st.sampled_from([1, 2, 7]),
    st.integers(1, 3),
)
def test_cutting_into_blocks_changes_nothing(
    rows: list[tuple[int, int, bool]], lag: int, consecutive: int, size: int, allowance_lag: int
) -> None:
    counts = np.array([[a, b] for a, b, _ in rows], dtype=np.int64)
    flags = np.array([int(bad) for _, _, bad in rows], dtype=np.uint16)
    guard = Guard(
        (
            Bound(
                cause="moved",
                weights={"input_angle": 1.0},
                low=-3,
                high=3,
                lag=lag,
                consecutive=consecutive,
            ),
            Bound(
                cause="torque",
                weights={"torque": 1.0},
                low=-6,
                high=6,
                consecutive=2,
                allowance={"input_angle": 0.5},
                allowance_lag=allowance_lag,
            ),
        )
    )
    found = first_break_cut(guard, counts, flags, size)
    assert found == first_break_cut(guard, counts, flags, len(rows))
    judge = CycleJudge(CHANNELS)
    judge.adopt(guard)
    breaks = (judge.judge(row, int(flags[i]), i) for i, row in enumerate(counts.tolist()))
    one = next((broken for broken in breaks if broken is not None), None)
    assert found == (None if one is None else (one.row, one.cause))


@pytest.mark.parametrize("moved", [4, -4])
@pytest.mark.parametrize("torque", [9, -9])
def test_an_allowance_lasts_as_long_as_the_motion(moved: int, torque: int) -> None:
    angle = np.cumsum([0, 0, moved, moved, moved, 0, 0, 0])
    counts = np.column_stack([angle, np.where(np.arange(8) > 2, torque, 0)])
    bound = Bound(
        cause="strained",
        weights={"torque": 1.0},
        low=-6.0,
        high=6.0,
        allowance={"input_angle": 0.5},
        allowance_lag=2,
    )
    found = GuardWatch(CHANNELS).first_break(Guard((bound,)), counts, np.zeros(8, np.uint16))
    assert found is not None
    # Two cycles after the last motion there is nothing left that could explain it; one after, half of it.
    assert (found.row, found.limit) == (5, math.copysign(6.0, torque))
    assert abs(found.value) == pytest.approx(9.0 - 0.5 * 4)
    standing = np.column_stack([np.zeros(8, dtype=np.int64), counts[:, 1]])
    found = GuardWatch(CHANNELS).first_break(Guard((bound,)), standing, np.zeros(8, np.uint16))
    assert found is not None
    assert (found.row, found.value) == (3, torque)


@pytest.mark.parametrize("size", [1, 7, 200])
@pytest.mark.parametrize("seed", range(6))
def test_blocks_are_judged_by_the_time_between_the_syncs_as_cycles_are(
    seed: int, size: int
) -> None:
    random, period = np.random.default_rng(seed), 1_000_000
    late = np.where(random.random(200) < 0.2, random.exponential(2.0, 200), 0.0)
    times = np.cumsum(period + np.rint(late * period).astype(np.int64))
    # Up to the limit until cycle 150, however late a SYNC is; above it from there.
    speed = np.where(np.arange(200) < 150, 9.9, 10.6)
    angle = np.cumsum(speed * np.diff(times, prepend=0)).astype(np.int64)
    counts = np.column_stack([angle, np.zeros(200, dtype=np.int64)])
    weight = 1.0 / (4 * period)
    bound = Bound(cause="moved", weights={"input_angle": weight}, high=10.0, lag=4, consecutive=2)
    guard, flags = Guard((bound,)), np.zeros(200, dtype=np.uint16)
    watch, judge, found = GuardWatch(CHANNELS, period), CycleJudge(CHANNELS, period), None
    for start in range(0, 200, size):
        part = slice(start, start + size)
        found = watch.first_break(guard, counts[part], flags[part], times[part])
        if found is not None:
            break
        watch.accept(counts[part], flags[part], times[part])
    judge.adopt(guard)
    breaks = (judge.judge(row, 0, i, int(times[i])) for i, row in enumerate(counts.tolist()))
    wanted = next(broken for broken in breaks if broken is not None)
    assert found is not None
    assert start + found.row == wanted.row
    assert 150 <= wanted.row <= 156
    assert found.value == pytest.approx(wanted.value)
