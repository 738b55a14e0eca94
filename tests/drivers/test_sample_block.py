"""What a block says of its complete cycles."""

from __future__ import annotations

import numpy as np

from drivers.acquisition_statistics import AcquisitionStatistics
from drivers.port import last_rows
from drivers.samples import CycleFlag, SampleBlock

COUNTS = np.arange(12, dtype=np.int64).reshape(4, 3)


def block(*flags: int) -> SampleBlock:
    """Four cycles with these flags."""
    return SampleBlock(0, np.arange(4) * 1_000_000, COUNTS, np.array(flags, dtype=np.uint16))


def test_the_counts_of_complete_cycles_alone() -> None:
    stale = CycleFlag.INCOMPLETE | CycleFlag.STALE_INPUT
    found = block(0, stale, CycleFlag.LATE, CycleFlag.INCOMPLETE)
    assert found.complete.tolist() == [True, False, True, False]
    assert np.array_equal(found.complete_counts, COUNTS[[0, 2]])


def test_complete_cycles_are_not_copied() -> None:
    assert block(0, CycleFlag.LATE, 0, 0).complete_counts is COUNTS


def test_the_last_rows_reach_into_what_was_kept_before() -> None:
    before, new = np.arange(5), np.arange(5, 8)
    assert last_rows(before, new, 4).tolist() == [4, 5, 6, 7]
    assert last_rows(before, new, 3).tolist() == [5, 6, 7]
    assert last_rows(before, new, 2).tolist() == [6, 7]
    assert last_rows(before, new, 20).tolist() == list(range(8))


def test_statistics_without_latencies_count_everything_else() -> None:
    known, unknown = AcquisitionStatistics(1_000_000), AcquisitionStatistics(1_000_000)
    times = np.cumsum(np.random.default_rng(9400).integers(900_000, 1_100_000, 500))
    flags = np.where(np.arange(500) % 7 == 0, CycleFlag.LATE, 0).astype(np.uint16)
    known.add(times, np.zeros(500, dtype=np.int64), flags)
    unknown.add(times, None, flags)
    assert known.report() == unknown.report()
    assert unknown.report().late == 72
    assert unknown.report().jitter_p99 > 0.0
