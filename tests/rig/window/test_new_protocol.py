"""A protocol that is added in one file and one line of the catalogue in the window as it declares itself."""

from __future__ import annotations

from pathlib import Path

import pytest
from PySide6.QtWidgets import QLabel
from pytestqt.qtbot import QtBot

from experiments import catalogue
from experiments.recording import Segment
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.analysis.fit.digest import digest
from rig.bench.backends.order import Order
from rig.run.start import run_order
from rig.run.state import RunState, State
from rig.window.prepare.protocol import ProtocolSection
from rig.window.review.marks import segment_words
from rig.window.run.live_plots import LivePlots
from rig.window.run.outcome_view import OutcomeView
from rig.window.shell.session import WindowSession
from tests.rig import toy_protocol
from tests.rig.window.conftest import LONGEST


@pytest.fixture(autouse=True)
def _in_the_catalogue(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(catalogue, "ENTRIES", (*catalogue.ENTRIES, toy_protocol.ENTRY))


@pytest.fixture
def run(session: WindowSession) -> Path:
    """A run of the toy on the simulated rig."""
    request = Order(
        protocol="toy",
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=session.folder,
        values={},
        serial="A1",
        operator="A. Example",
    )
    report = run_order(request)
    assert report.outcome == "COMPLETED"
    return report.path


def test_the_form_offers_it_with_its_fields(session: WindowSession, qtbot: QtBot) -> None:
    section = ProtocolSection(session)
    qtbot.addWidget(section)
    section.choice.setCurrentIndex(section.choice.findData("toy"))
    assert section.protocol == "toy"
    assert section.form.values() == {"pace_rpm": "120", "acceleration": "200"}
    texts = {label.text() for label in section.findChildren(QLabel)}
    assert any("r/min" in text for text in texts)


def test_its_run_shows_the_plots_that_it_asks_for(
    session: WindowSession, qtbot: QtBot, run: Path
) -> None:
    plots = LivePlots(session)
    qtbot.addWidget(plots)
    plots.finish(run)
    assert [plot.item.getAxis("left").labelText for plot in plots.plots] == [
        "input speed [r/min]",
        "motor torque [mN m]",
    ]
    plots.close_file()


@pytest.mark.usefixtures("in_process")
def test_the_end_of_its_run_names_its_key_result_first(
    session: WindowSession, qtbot: QtBot, run: Path
) -> None:
    digest(run, "2026-01-01T00:00:00+00:00")
    view = OutcomeView(session)
    qtbot.addWidget(view)
    view.show_end(RunState(state=State.FINISHED, outcome="COMPLETED"), {}, run)
    qtbot.waitUntil(lambda: "play" in view.results.text(), timeout=LONGEST)
    first, second, *_ = view.results.text().split("   ·   ")
    assert (first, second) == (
        "play of the toy 40.0 ± 2.0 arcsec",
        "static wind-up 1.500 ± 0.033 arcmin",
    )


@pytest.mark.parametrize(
    ("setpoint", "words"),
    [("speed", "4.7746 r/min"), ("torque", "0.5 N m"), ("position", "28.648°")],
)
def test_its_segments_are_set_to_what_it_says(
    setpoint: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    import dataclasses

    other = dataclasses.replace(toy_protocol.EXPERIMENT, setpoint=setpoint)
    monkeypatch.setattr(toy_protocol, "EXPERIMENT", other)
    segment = Segment(index=1, label="hold", start=0, stop=9, setpoint=0.5, direction=1, repeat=0)
    assert segment_words(segment, "toy") == f"segment 1: hold, {words}, forward"
