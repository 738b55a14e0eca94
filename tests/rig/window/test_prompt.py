"""A question of the run: nothing that was on its way to something else answers it, and no Enter starts a motor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QFontMetrics
from PySide6.QtTest import QTest
from pytestqt.qtbot import QtBot

from drivers.clock import VirtualClock
from experiments import catalogue
from experiments.parameters import make_parameters
from experiments.steps.note import Prompt
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench.backends.order import Order
from rig.present.preview.plan import preview_plan
from rig.run.parts import Progress
from rig.run.start import plan_order
from rig.run.state import MAKING_SAFE, RunState, State
from rig.window.main import MainWindow
from rig.window.run.banner import LOOKS
from rig.window.run.live_view import LiveContext, PredictedTorque, since_begun, torque_view
from rig.window.run.prompt_view import UNARMED_NS
from rig.window.shell.session import WindowSession
from rig.window.shell.theme import BANNER_CAPITAL
from tests.rig.window.conftest import SilentRun, silent_run

GEAR_OFF = Prompt("Take the gear off.", "gear-removed", consent="The gear is removed & warm")
READING = Prompt("Temperature [°C]?", "temperature")


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def asking(window: MainWindow, clock: VirtualClock, qtbot: QtBot) -> Iterator[SilentRun]:
    """A run that turns, in a window whose prompts live by a clock of the test."""
    window.run.prompt._clock = clock
    window.activateWindow()
    qtbot.waitUntil(window.isActiveWindow)
    run = silent_run(window)
    run.progress.emit(progress("hold"))
    assert window.run.state.state is State.RUNNING
    yield run
    window.run._change(RunState())


def progress(what: str) -> Progress:
    return Progress(step=1, steps=2, what=what, elapsed=0.0, left=1.0, speed=0.0, events=0)


def arm(window: MainWindow, clock: VirtualClock, qtbot: QtBot) -> None:
    """The first second is over."""
    clock.advance_ns(UNARMED_NS)
    qtbot.waitUntil(lambda: window.run.prompt.give.isEnabled() or not window.run.prompt.isVisible())


def tab_to_consent(window: MainWindow) -> int:
    """Tab, until the button has the keyboard; how often."""
    for count in range(1, 40):
        QTest.keyClick(window.windowHandle(), Qt.Key.Key_Tab)
        if window.run.prompt.give.hasFocus():
            return count
    raise AssertionError("Tab does not lead to the button")


def test_a_note_that_is_being_written_goes_on_and_answers_nothing(
    asking: SilentRun, window: MainWindow, clock: VirtualClock, qtbot: QtBot
) -> None:
    page, words = (
        window.run,
        "the coupling was warm to the hand before the run, and it smells of oil!",
    )
    for prompt in (GEAR_OFF, READING):
        page.events.note.setFocus()
        QTest.keyClicks(page.events.note, words[:20])
        asking.prompt.emit(prompt)
        assert page.events.note.hasFocus()
        arm(window, clock, qtbot) if prompt.consent else clock.advance_ns(UNARMED_NS)
        QTest.keyClicks(page.events.note, words[20:])
        QTest.keyClick(window.windowHandle(), Qt.Key.Key_Return)
        assert asking.said == [f"note {words}"]
        assert page.prompt.isVisible()
        assert page.state.state is State.WAITING
        asking.said.clear()


@pytest.mark.parametrize("key", [Qt.Key.Key_Return, Qt.Key.Key_Enter, Qt.Key.Key_Y])
def test_no_stray_key_is_consent(
    key: Qt.Key, asking: SilentRun, window: MainWindow, clock: VirtualClock, qtbot: QtBot
) -> None:
    """Not where the keyboard is, and not on the button itself."""
    asking.prompt.emit(GEAR_OFF)
    arm(window, clock, qtbot)
    assert window.run.buttons.stop.hasFocus(), "where it was before the question"
    window.run.events.table.setFocus()
    QTest.keyClick(window.windowHandle(), key)
    tab_to_consent(window)
    QTest.keyClick(window.windowHandle(), key)
    assert asking.said == []
    assert window.run.prompt.isVisible()


def test_tab_and_space_are_consent_and_the_answer_is_the_sentence(
    asking: SilentRun, window: MainWindow, clock: VirtualClock, qtbot: QtBot
) -> None:
    asking.prompt.emit(GEAR_OFF)
    assert window.run.prompt.give.text().replace("&&", "&") == GEAR_OFF.consent
    assert not window.run.prompt.field.isVisible()
    arm(window, clock, qtbot)
    tab_to_consent(window)
    QTest.keyClick(window.windowHandle(), Qt.Key.Key_Space)
    assert asking.said == [f"answer {GEAR_OFF.consent}"]
    assert not window.run.prompt.isVisible()
    assert window.run.state.state is State.RUNNING
    QTest.keyClick(window.windowHandle(), Qt.Key.Key_Space)
    assert asking.said[1:] == ["STOP"], "afterwards Space is STOP again"


def test_space_where_the_keyboard_came_by_itself_is_stop(
    asking: SilentRun, window: MainWindow, clock: VirtualClock, qtbot: QtBot
) -> None:
    asking.prompt.emit(GEAR_OFF)
    arm(window, clock, qtbot)
    window.run.prompt.give.setFocus(Qt.FocusReason.OtherFocusReason)
    QTest.keyClick(window.windowHandle(), Qt.Key.Key_Space)
    assert asking.said == ["STOP"]
    assert not window.run.prompt.isVisible(), "what is being stopped asks nothing any more"


def test_nothing_is_taken_in_the_first_second(
    asking: SilentRun, window: MainWindow, clock: VirtualClock, qtbot: QtBot
) -> None:
    prompt = window.run.prompt
    asking.prompt.emit(GEAR_OFF)
    clock.advance_ns(UNARMED_NS - 1)
    prompt._show_armed()
    qtbot.mouseClick(prompt.give, Qt.MouseButton.LeftButton)
    prompt.give.clicked.emit()
    assert asking.said == []
    clock.advance_ns(1)
    qtbot.waitUntil(prompt.give.isEnabled)
    qtbot.mouseClick(prompt.give, Qt.MouseButton.LeftButton)
    assert asking.said == [f"answer {GEAR_OFF.consent}"]
    # The next question has a second of its own.
    asking.prompt.emit(GEAR_OFF)
    assert not prompt.give.isEnabled()


def test_text_is_wanted_where_no_sentence_is_given(
    asking: SilentRun, window: MainWindow, clock: VirtualClock, qtbot: QtBot
) -> None:
    prompt = window.run.prompt
    asking.prompt.emit(READING)
    assert prompt.field.isVisible()
    assert not prompt.field.hasFocus()
    clock.advance_ns(UNARMED_NS)
    prompt.field.setFocus()
    QTest.keyClick(window.windowHandle(), Qt.Key.Key_Return)
    assert asking.said == [], "nothing is no reading"
    QTest.keyClicks(prompt.field, "22.5")
    QTest.keyClick(window.windowHandle(), Qt.Key.Key_Return)
    assert asking.said == ["answer 22.5"]


def test_the_banner_says_who_is_waited_for(asking: SilentRun, window: MainWindow) -> None:
    page = window.run
    asking.prompt.emit(GEAR_OFF)
    assert page.banner.word == "WAITING FOR YOU"
    assert window._buttons.button(1).text() == "Run · waiting for you"
    backgrounds = [look.background for look in LOOKS.values()]
    assert backgrounds.count(LOOKS[State.WAITING].background) == 1
    asking.progress.emit(progress("Prompt"))
    assert page.state.state is State.WAITING, "progress of a rig that is held is no going on"
    asking.progress.emit(progress(MAKING_SAFE))
    assert page.banner.word == "STOPPING"
    assert not page.prompt.isVisible()


def test_a_question_while_the_rig_is_being_stopped_is_not_put() -> None:
    stopping = RunState().armed().pressed("STOP")
    assert stopping.asked("ready?") == stopping
    assert RunState().armed().asked("ready?").answered().state is State.RUNNING


def test_the_words_of_the_banner_are_read_from_three_metres(
    asking: SilentRun, window: MainWindow
) -> None:
    window.resize(1920, 1080)
    page = window.run
    for state in LOOKS:
        page.banner.show_state(RunState(state=state), "Friction, gear SN-0815")
        word = page.banner._word
        word.ensurePolished()
        assert QFontMetrics(word.font()).capHeight() >= BANNER_CAPITAL >= 40, state
        assert word.sizeHint().width() <= page.banner.width() * 0.62, state


def test_what_is_predicted_begins_where_its_steps_have_begun(session: WindowSession) -> None:
    """A prompt that was answered 30 s late, and a step that took 2 s longer than planned."""
    gear, motor = shipped_gear(), shipped_motor()
    request = Order(protocol="motor-tare", gear=gear, motor=motor, folder=session.folder)
    seen = preview_plan(plan_order(request))
    (asked,) = [mark.step for mark in seen.marks if mark.kind == "prompt"]
    recording: Any = SimpleNamespace(has=lambda name: True)
    context = LiveContext(recording, None, seen)
    view = torque_view(session, context)
    assert isinstance(view, PredictedTorque)
    view.draw(recent=False)
    np.testing.assert_array_equal(view.predicted.item.getOriginalDataset()[0], seen.time)
    moving = sorted(set(seen.step.tolist()))
    slow = next(k for k in moving if k > asked + 1)
    begun = [float(seen.time[np.searchsorted(seen.step, k)]) for k in range(slow + 2)]
    late = [0.0 if k <= asked else 30.0 if k <= slow else 32.0 for k in range(slow + 2)]
    context.begun.extend(start + delay for start, delay in zip(begun, late, strict=True))
    view.draw(recent=False)
    expected = seen.time + np.array([late[min(k, slow + 1)] for k in seen.step])
    for item in (view.predicted.item, *view.predicted.edges):
        x, _ = item.getOriginalDataset()
        np.testing.assert_allclose(x, expected)
    assert len(view.predicted.edges) == 2


def test_a_step_that_is_over_early_ends_where_the_next_one_begins() -> None:
    time, step = np.array([0.0, 2.0, 2.0, 6.0, 6.0, 9.0]), np.array([0, 0, 2, 2, 3, 3])
    # Step 1 takes no time in the plan; the rig waited 10 s in it, and step 2 took 3 s instead of 4 s.
    moved = since_begun(time, step, [0.5, 2.5, 12.5, 15.5])
    assert moved.tolist() == [0.5, 2.5, 12.5, 15.5, 15.5, 18.5]
    # What has not begun is as late as the latest that has; nothing has begun: the plan's own times.
    assert since_begun(time, step, [0.5]).tolist() == [0.5, 2.5, 2.5, 6.5, 6.5, 9.5]
    assert since_begun(time, step, []).tolist() == time.tolist()


def test_the_begin_of_every_step_is_handed_to_the_plots(
    asking: SilentRun, window: MainWindow
) -> None:
    for begun in ([0.0], [0.0, 1.5, 31.5]):
        asking.progress.emit(replace(progress("hold"), begun=begun))
        assert window.run.plots.begun == begun


def test_only_readings_want_text() -> None:
    """No protocol asks for text today; the motor tare wants consent to one sentence."""
    prompts = []
    for name in catalogue.names():
        experiment = catalogue.load(name)
        plan = experiment.plan(make_parameters(experiment.parameters, {}, name), shipped_gear())
        prompts += [(name, step) for step in plan if isinstance(step, Prompt)]
    assert [(name, step.consent) for name, step in prompts] == [
        ("motor-tare", "The gear is removed and the motor is warm"),
        ("torque-scale", "The gear is removed; the motor has nothing on its shaft"),
    ]
