"""What a count changed by, from block to block."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.counting import changes


@pytest.mark.parametrize("dtype", [np.int64, np.float64])
def test_the_changes_of_two_blocks_are_those_of_one(dtype: type) -> None:
    values = np.random.default_rng(1).integers(-(2**40), 2**40, 20).astype(dtype)
    whole = changes(values, 7)
    assert whole.dtype == dtype
    assert np.array_equal(np.concatenate([[7], values[:-1]]) + whole, values)
    parts = [changes(values[:8], 7), changes(values[8:], values[7])]
    assert np.array_equal(np.concatenate(parts), whole)
    assert len(changes(values[:0], 7)) == 0
