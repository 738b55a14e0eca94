"""Index marks: counts between them are whole revolutions, and a counter that has lost its angle stops the run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.channel import Channel, encoder_channel
from drivers.samples import CycleFlag, SampleBlock
from experiments.steps.vocabulary import HoldRevolutions, Ramp
from rig.run.bounds import Watch
from rig.run.index_review import NO_MARKS, IndexReview
from rig.run.session import execute
from rig.run.torque_review import Agreement
from rig.run.trips import Trip
from tests.rig.fake_rig import FakeRig, ListRun, parts_of, planned_of

REVOLUTION = 32768
CHANNELS = (
    encoder_channel("input_angle", lines=8192, multiplication=4),
    encoder_channel("input_index", lines=8192, multiplication=4),
    Channel(name="index_seen", unit="1", scale=1.0),
)


def review() -> IndexReview:
    return IndexReview(
        Watch(), {c.name: c for c in CHANNELS}, {c.name: i for i, c in enumerate(CHANNELS)}
    )


def turned(speeds: list[int], lost: dict[int, int] | None = None, mark: int = 500) -> np.ndarray:
    """Counts, latch and seen bit of an encoder that turns by `speeds` per cycle and loses counts at some cycles."""
    rows, true, count, latch, seen = [], 0, 0, 0, 0
    for k, speed in enumerate(speeds):
        before, true = true, true + speed
        count += speed + (lost or {}).get(k, 0)
        for turn in range(min(before, true) // REVOLUTION - 1, max(before, true) // REVOLUTION + 2):
            at = turn * REVOLUTION + mark
            if min(before, true) < at <= max(before, true):
                latch, seen = count + at - true, 1
        rows.append((count, latch, seen))
    return np.array(rows, dtype=np.int64)


def walked(
    counts: np.ndarray, length: int = 50, flags: np.ndarray | None = None
) -> tuple[dict[str, dict[str, int]], list[Trip], list[tuple[str, str]]]:
    watcher, state = review(), NO_MARKS
    trips: list[Trip] = []
    notes: list[tuple[str, str]] = []
    marks = np.zeros(len(counts), dtype=np.uint16) if flags is None else flags
    for start in range(0, len(counts), length):
        part = counts[start : start + length]
        times = np.arange(start, start + len(part), dtype=np.int64)
        block = SampleBlock(start, times, part, marks[start : start + length])
        state, found, told = watcher.reviewed(state, block, start)
        trips, notes = trips + found, notes + list(told)
    return watcher.figures(state), trips, notes


AHEAD, BACK = [3000] * 80, [-3000] * 80


@given(st.lists(st.integers(-9000, 9000), min_size=2, max_size=120), st.integers(1, 60))
def test_a_counter_that_loses_nothing_is_never_blamed(speeds: list[int], length: int) -> None:
    figures, trips, notes = walked(turned(speeds), length)
    assert (trips, notes) == ([], [])
    assert all(found["worst_excess"] == 0 for found in figures.values())


def test_lost_counts_add_up_until_they_are_told_and_trip() -> None:
    figures, trips, notes = walked(turned(AHEAD + AHEAD, {k: -1 for k in range(10, 160, 5)}))
    assert figures["input_angle"]["marks"] >= 12
    assert figures["input_angle"]["worst_excess"] < -20
    assert notes[0][0] == "index-mark"
    assert "counts lost" in notes[0][1]
    assert trips[0].cause == "lost_counts"
    assert trips[0].limit == 20.0
    assert trips[0].action.value == "quick stop"
    assert "input_angle" in str(trips[0])


def test_one_step_is_an_event_and_both_directions_have_their_own_reference() -> None:
    figures, trips, notes = walked(turned(AHEAD + BACK + AHEAD, {100: 7}))
    assert trips == []
    # The marks of the way back tell it; those of the next way ahead find the same.
    assert [code for code, _ in notes] == ["index-mark"]
    assert figures["input_angle"]["worst_excess"] == 7
    assert "too many" in notes[0][1]


@pytest.mark.parametrize("length", [1, 7, 500])
def test_cutting_into_blocks_changes_nothing(length: int) -> None:
    counts = turned(AHEAD + BACK + AHEAD, {20: -30, 30: 30, 190: 5})
    assert walked(counts, length) == walked(counts, 240)


def test_doubtful_cycles_are_not_looked_at() -> None:
    counts = turned(AHEAD)
    flags = np.zeros(len(counts), dtype=np.uint16)
    flags[40:43] = CycleFlag.INCOMPLETE
    counts[40:43, 1] += 1234
    assert walked(counts, flags=flags)[1:] == ([], [])
    assert walked(counts)[2] != []


def test_a_rig_without_marks_is_not_reviewed() -> None:
    bare = IndexReview(Watch(), {"input_angle": CHANNELS[0]}, {"input_angle": 0})
    block = SampleBlock(
        0, np.arange(3), np.zeros((3, 1), dtype=np.int64), np.zeros(3, dtype=np.uint16)
    )
    assert bare.reviewed(NO_MARKS, block, 0) == (NO_MARKS, [], ())
    assert bare.figures(NO_MARKS) == {}


def lose(counts: int):
    """From the marked cycle on, every mark is latched with counts missing."""

    def happen(rig: FakeRig) -> None:
        original = rig._row

        def row(mode, target):  # type: ignore[no-untyped-def]
            values = original(mode, target)
            values[0] -= counts
            values[7] -= counts
            return values

        rig._row = row  # type: ignore[method-assign]

    return happen


def test_a_run_whose_motor_encoder_loses_counts_trips_and_stands() -> None:
    steps = (Ramp(60.0, 500.0), HoldRevolutions(8.0, 3.0), Ramp(0.0, 500.0))
    run = ListRun()
    rig = FakeRig(script={700: lose(25)})
    report = execute(parts_of(planned_of(*steps), rig, Path(), 50), lambda *_: run)
    assert report.outcome == "TRIPPED", report.message
    assert report.trip is not None
    assert report.trip.cause == "lost_counts"
    assert report.safe
    assert "index-mark" in run.codes()
    assert run.acquisition["index_marks"]["input_angle"]["worst_excess"] == -25


def test_agreement_of_the_torques_is_kept_in_figures() -> None:
    rng = np.random.default_rng(5)
    drive = np.linspace(-0.3, 0.3, 500)
    port = 1.1 * drive + 0.02 + rng.normal(0.0, 1e-3, 500)
    one = Agreement().after(port, drive).figures()
    two = Agreement().after(port[:123], drive[:123]).after(port[123:], drive[123:]).figures()
    assert one == pytest.approx(two)
    assert one["slope"] == pytest.approx(1.1, abs=2e-3)
    assert one["offset"] == pytest.approx(0.02, abs=1e-3)
    assert one["worst"] == pytest.approx(0.05, abs=5e-3)
    steady = (
        Agreement().after(np.full(500, 0.1) + rng.normal(0, 1e-3, 500), np.full(500, 0.1)).figures()
    )
    assert "slope" not in steady
    assert Agreement().figures() == {}
