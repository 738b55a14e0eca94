"""The live plots of velocity steps: each step is held against its prediction as it ends."""

from __future__ import annotations

from pathlib import Path

from pytestqt.qtbot import QtBot

from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench.backends.order import Order
from rig.run.start import run_order
from rig.runfile.read import close_recording, open_run
from rig.window.run.live_view import LiveContext
from rig.window.run.steps_view import StepView
from rig.window.shell.session import WindowSession


def test_every_step_is_scored_as_it_ends(
    session: WindowSession, qtbot: QtBot, tmp_path: Path
) -> None:
    request = Order(
        protocol="velocity-steps",
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=tmp_path,
        values={"speeds_rpm": (600.0,), "repeats": 1},
        seed=9741,
    )
    recording = open_run(run_order(request).path)
    context = LiveContext(recording)
    view = StepView(session, context)
    for plot in (view.plot, view.residual.plot):
        qtbot.addWidget(plot)
    for segment in recording.segments:
        view.ended(segment, recording)
    context.work.finish()
    view.draw(recent=True)
    steps = [segment for segment in recording.segments if segment.label == "step"]
    assert view.problem == ""
    assert [speed for speed, _ in view.residual.skills] == [step.setpoint for step in steps]
    # Without slow steps the kinematic error is not known, and what it rings is not predicted.
    assert min(skill for _, skill in view.residual.skills) > 0.0
    context.work.close()
    close_recording(recording)
