"""The spectrum over angle: a long way that is cut into windows tells what it tells in one piece."""

from __future__ import annotations

import numpy as np
import pytest

from model.identify.orders import comb
from model.identify.orders.comb import Comb


def test_a_way_in_several_windows_has_the_line_and_the_noise_of_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    turns, highest, order, size = 400.0, 20.0, 6.3, 0.5
    angle = np.linspace(0.0, 2.0 * np.pi * turns, 80_000)
    value = size * np.cos(order * angle) + np.random.default_rng(1).standard_normal(len(angle))
    part = (angle, value, np.ones(len(angle)))
    whole = Comb.of([part], (0.0, float(angle[-1])), highest, 1)
    monkeypatch.setattr(comb, "LARGEST_GRID", 4096)
    cut = Comb.of([part], (0.0, float(angle[-1])), highest, 1)
    assert (whole.windows, cut.windows) == (1, 8)
    for one in (whole, cut):
        peak = int(np.argmax(one.power))
        assert one.orders[peak] == pytest.approx(order, abs=one.resolution)
        beside = np.delete(one.power, np.arange(peak - 3, peak + 4))
        assert np.mean(beside[1:]) == pytest.approx(1.0, abs=0.1)
