"""The search of velocity steps: what it looks at is what its prior pulls."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from model.identify import step_fit
from model.identify.step_problem import LARGEST_SKEW, Shape


def test_a_skew_at_its_bound_is_pulled_by_what_is_looked_at() -> None:
    blind: Any = SimpleNamespace(normals=lambda *where, **how: ())
    goal = step_fit._Goal(
        problem=blind,
        shape=Shape(names=("stiffness", "skew")),
        noise=1.0,
        weights=np.empty(0),
        centre=np.zeros(2),
        penalty=np.array([0.0, 1.0]),
    )
    here = step_fit._Place(np.zeros(2), {"stiffness": 0.0, "skew": 0.0}, 0.0)
    there = goal._place(here, np.array([1.0, 4.0 * LARGEST_SKEW]))
    assert there.values["skew"] == there.vector[1] == LARGEST_SKEW
    assert there.cost == pytest.approx(LARGEST_SKEW**2)
