"""What a least squares refuses is refused in its own words."""

from __future__ import annotations

import math

import numpy as np
import pytest

from model.errors import IdentificationError
from model.identify.least_squares import solve

DESIGN = np.column_stack([np.ones(50), np.arange(50.0)])


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_refused_by_its_column(bad: float) -> None:
    design, observed = DESIGN.copy(), np.arange(50.0)
    design[3, 1] = bad
    with pytest.raises(IdentificationError, match=r"not a number.*column 1"):
        solve(design, observed)
    observed[7] = bad
    with pytest.raises(IdentificationError, match="what is observed"):
        solve(DESIGN, observed)


def test_columns_that_are_empty_or_the_same_are_refused() -> None:
    with pytest.raises(IdentificationError, match="zero throughout"):
        solve(np.column_stack([DESIGN[:, 0], np.zeros(50)]), np.arange(50.0))
    with pytest.raises(IdentificationError, match="cannot separate"):
        solve(np.column_stack([DESIGN[:, 1], 2.0 * DESIGN[:, 1]]), np.arange(50.0))
