"""A run as arrays, frame, data set, figure and table."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from experiments.errors import AnalysisError
from rig.api.tables import ROWS, WIDTH, html_of, text_of
from rig.content.grid import Grid, columns
from rig.errors import RigError
from tests.rig.api.recordings import RATE, made, swinging


def test_a_channel_is_an_array_in_si() -> None:
    run = made({"speed": ("rad/s", np.arange(50.0))})
    assert np.array_equal(run["speed"], np.arange(50.0))
    assert np.array_equal(run.si("speed", run.segments[0]), np.arange(10.0, 30.0))
    assert run.time[1] == pytest.approx(1.0 / RATE)
    assert run.channels == {"speed": "rad/s"}


def test_a_channel_that_was_not_recorded_is_named_with_those_that_were() -> None:
    with pytest.raises(AnalysisError, match=r"value torque, allowed channels speed"):
        made({"speed": ("rad/s", np.arange(50.0))})["torque"]


def test_a_frame_has_time_and_units() -> None:
    pytest.importorskip("pandas")
    run = swinging()
    frame = run.to_pandas("torque", where=slice(100, 200))
    assert list(frame.columns) == ["torque"]
    assert frame.index.name == "time"
    assert frame.index[0] == pytest.approx(100 / RATE)
    assert frame["torque"].to_numpy() == pytest.approx(run["torque"][100:200])
    assert frame.attrs["units"] == {"torque": "N m"}
    assert frame.attrs["origin"] == "imported"


def test_a_data_set_has_time_units_and_names() -> None:
    pytest.importorskip("xarray")
    run = swinging()
    data = run.to_xarray()
    assert set(data.data_vars) == {"input_angle", "torque"}
    assert data["torque"].attrs == {"units": "N m", "long_name": "torque of a test"}
    assert data["time"].attrs["units"] == "s"
    assert float(data["torque"].sel(time=1.0, method="nearest")) == run["torque"][200]


def test_without_a_time_base_rows_are_counted() -> None:
    pytest.importorskip("pandas")
    run = made({"speed": ("rad/s", np.arange(50.0))}, time_base="none")
    assert run.to_pandas(where=slice(3, 5)).index.tolist() == [3, 4]
    assert run.to_pandas().index.name == "row"
    with pytest.raises(RigError, match="no time base"):
        _ = run.time


def test_a_package_that_is_missing_is_named_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(RigError, match=r"pip install 'harmonic-rig\[python\]'"):
        swinging().to_pandas()


def test_segments_are_a_sequence_a_frame_and_a_table() -> None:
    pytest.importorskip("pandas")
    segments = swinging().segments
    assert [one.label for one in segments] == ["part"]
    assert segments.labelled("step") == ()
    assert segments.to_pandas().loc[0, "stop"] == 30
    assert "part" in repr(segments)


def test_a_run_fits_a_screen_and_is_a_table_in_a_notebook() -> None:
    run = swinging(run_id="<b>bold</b>")
    assert all(len(line) <= WIDTH for line in repr(run).splitlines())
    assert "IMPORTED" in repr(run)
    assert run._repr_html_().startswith("<table>")
    assert "<b>" not in run._repr_html_()
    assert len(repr(run.metadata)) < 1000


def test_a_long_table_is_cut_and_says_by_how_much() -> None:
    table = Grid("many", columns("a", "b"), [("x" * 200, str(k)) for k in range(ROWS + 5)])
    lines = text_of(table).splitlines()
    assert lines[-1] == "... and 5 more"
    assert max(map(len, lines)) <= WIDTH
    assert html_of(table).count("<tr>") == ROWS + 6


def test_a_figure_shows_channels_over_time_one_under_the_other() -> None:
    figure = swinging().plot("torque", "input_angle")
    labels = [axes.get_ylabel().replace("\n", " ") for axes in figure.axes]
    assert [label.split()[0] for label in labels] == ["torque", "input_angle"]
    assert figure.axes[-1].get_xlabel() == "time [s]"
    assert any(text.get_text() == "IMPORTED" for axes in figure.axes for text in axes.texts)
