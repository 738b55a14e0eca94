"""The bench beside a question: each question of this package has its own scene, and a scene is what is drawn."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest
from PySide6.QtGui import QColor
from pytestqt.qtbot import QtBot

import experiments
import rig
from experiments.steps.note import Prompt
from rig.window.run.prompt_view import PromptView
from rig.window.run.rig_picture import SCENES, WHOLE, RigPicture, scene_of
from rig.window.shell.session import WindowSession

ASKERS = {"Prompt": 1, "answer": 1, "consents": 2}
"""Who asks, by the name of the call, and the place of the key among its arguments."""


def keys_asked() -> Iterator[str]:
    roots = (Path(experiments.__file__).parent, Path(rig.__file__).parent / "trial")
    for file in (file for root in roots for file in root.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call):
                continue
            name = getattr(node.func, "id", getattr(node.func, "attr", ""))
            place = ASKERS.get(name)
            if place is None or len(node.args) <= place:
                continue
            key = node.args[place]
            if isinstance(key, ast.Constant) and isinstance(key.value, str):
                yield key.value


def test_every_question_of_this_package_has_a_scene() -> None:
    asked = set(keys_asked())
    assert {"gear-removed", "mounted-at", "turn-shaft", "coupled"} <= asked
    assert {key for key in asked if scene_of(key) is WHOLE} == set()
    assert scene_of("ready-quick-stop") is SCENES["full-speed"]
    assert scene_of("of another package") is WHOLE


@pytest.mark.parametrize("key", SCENES)
def test_a_scene_is_drawn_and_said(key: str, session: WindowSession, qtbot: QtBot) -> None:
    picture = RigPicture(session)
    qtbot.addWidget(picture)
    picture.show_scene(WHOLE)
    before = picture.grab().toImage()
    picture.show_scene(scene_of(key))
    after = picture.grab().toImage()
    assert before != after
    accent = QColor(session.palette.accent).rgb()
    seen = sum(
        after.pixel(x, y) == accent
        for x in range(after.width())
        for y in range(after.height() - 22)
    )
    assert seen > 20, "what is looked at has the accent colour"
    assert SCENES[key].words in picture.accessibleName()


def test_the_picture_follows_the_question(session: WindowSession, qtbot: QtBot) -> None:
    view = PromptView(session)
    qtbot.addWidget(view)
    view.ask(Prompt("Take the gear off.", "gear-removed", consent="It is off"))
    assert view.picture.scene is SCENES["gear-removed"]
    assert not view.picture.scene.gear_on
    view.ask(Prompt("Temperature?", "temperature"))
    assert view.picture.scene is WHOLE
