"""A line that grows with speed is one row of an order spectrum, with its amplitudes and a plot over speed."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.contract import Evidence
from experiments.recordings.order_spectrum.analysis import analyse
from model.gear import HarmonicDrive
from tests.experiments.test_analyses_without_plan import foreign
from tests.model.identify.orders.test_by_speed import swung


def test_it_is_one_row_and_its_sidelobes_are_none(gear: HarmonicDrive) -> None:
    one = swung()
    time = np.arange(len(one.angle)) * 1e-3
    recording = foreign(time, input_angle=(one.angle, "rad"), current=(one.value, "A"))
    result = analyse(recording, Evidence(gear, settings={"highest_order": 8}))
    near = [name for name in result.estimates if name.startswith(("amplitude_2", "amplitude_1.9"))]
    assert near == ["amplitude_2"]
    # What follows the speed is no order: far below one there is no line.
    assert set(result.estimates) == {"amplitude_1", "amplitude_2"}
    assert result.estimates["amplitude_2"].value == pytest.approx(0.2, abs=2e-3)
    assert "changes with speed, forward 0.12" in result.estimates["amplitude_2"].note
    plot = next(plot for plot in result.plots if plot.name == "amplitude-over-speed")
    assert [series.label for series in plot.series] == ["order 2, forward"]
    assert any("What follows the speed" in warning for warning in result.warnings)
    assert any("order 2 changes with speed" in warning for warning in result.warnings)
