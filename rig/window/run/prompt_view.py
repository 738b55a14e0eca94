"""A question of the run to the operator: the plan waits while the rig stands.

It never takes the keyboard. Consent is a click on the button that carries what is consented to, or Tab to
it and then Space; text goes into a field, which is there only where text is wanted. Neither is taken in the
first second: what was on its way to something else when the question came is no answer.
"""

from __future__ import annotations

from PySide6.QtCore import QEvent, Qt, QTimer, Signal
from PySide6.QtGui import QFocusEvent, QKeyEvent, QResizeEvent
from PySide6.QtWidgets import QFrame, QPushButton

from drivers.clock import Clock, WallClock
from experiments.steps.note import Prompt
from rig.content.phrase import phrase
from rig.window.run.rig_picture import RigPicture, scene_of
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import (
    in_column,
    in_row,
    line_field,
    set_tip,
    text_label,
)

UNARMED_NS = 1_000_000_000
"""ns after a question in which nothing answers it."""
_ROOM_FOR_A_PICTURE = 560
"""Pixels of height of the window below which the buttons need the room of the picture."""
_LOOKS_MS = 50
"""ms between two looks whether they are over."""
_BY_INTENT = (
    Qt.FocusReason.TabFocusReason,
    Qt.FocusReason.BacktabFocusReason,
    Qt.FocusReason.MouseFocusReason,
)
"""How somebody brings the keyboard to a button; every other way it comes by itself."""


class ConsentButton(QPushButton):
    """A button that Space presses once somebody has gone to it, and Enter never does.

    Everywhere else on the page Space is STOP, and on this button too where the keyboard came to it by itself.
    """

    def __init__(self) -> None:
        super().__init__()
        self._is_meant = False
        self.setProperty("part", "primary")
        self.setMinimumHeight(40)

    def focusInEvent(self, event: QFocusEvent) -> None:
        """Remember how the keyboard came here."""
        self._is_meant = event.reason() in _BY_INTENT
        super().focusInEvent(event)

    def event(self, event: QEvent) -> bool:
        """Keep Space from being a shortcut of the page."""
        if (
            isinstance(event, QKeyEvent)
            and event.type() is QEvent.Type.ShortcutOverride
            and event.key() == Qt.Key.Key_Space
            and self._is_meant
        ):
            event.accept()
            return True
        return super().event(event)


class PromptView(QFrame):
    """Hidden unless something is asked."""

    answered = Signal(str)

    def __init__(self, session: WindowSession, clock: Clock | None = None) -> None:
        super().__init__()
        self._session, self._clock = session, clock or WallClock()
        self._prompt: Prompt | None = None
        self._armed_ns = 0
        self.setObjectName("prompt")
        self.question = text_label(wraps=True)
        self.question.setStyleSheet("font-size: 13pt; font-weight: 600;")
        self.field = line_field("Answer to the question of the run", "Answer")
        self.field.setMinimumWidth(220)
        self.give = ConsentButton()
        self.hint = text_label("", "muted")
        self.picture = RigPicture(session)
        row = in_row(self.field, self.give, self.hint, (None, 1))
        asked = in_column(self.question, row, spacing=6)
        self.setLayout(in_row(self.picture, (asked, 1), margins=(14, 8, 14, 8), spacing=14))
        self.give.clicked.connect(self._answer)
        self.field.returnPressed.connect(self._answer)
        self.field.textChanged.connect(lambda _: self._show_armed())
        self._looks = QTimer(self)
        self._looks.setInterval(_LOOKS_MS)
        self._looks.timeout.connect(self._show_armed)
        session.theme_changed.connect(lambda _: self._colour())
        self._colour()
        self.hide()

    @property
    def is_armed(self) -> bool:
        """Whether an answer is taken now."""
        waited = self._clock.monotonic_ns() >= self._armed_ns
        wanted = bool(self._prompt and (self._prompt.consent or self.field.text().strip()))
        return waited and wanted

    def ask(self, prompt: Prompt) -> None:
        """Put a question."""
        self._prompt = prompt
        self._armed_ns = self._clock.monotonic_ns() + UNARMED_NS
        self.question.setText(f"?  {prompt.text}")
        self.picture.show_scene(scene_of(prompt.key))
        self.give.setText((prompt.consent or "Answer and go on").replace("&", "&&"))
        self.hint.setText("A click, or Tab and then Space" if prompt.consent else "")
        self.field.clear()
        self.field.setVisible(not prompt.consent)
        set_tip(self.field, "kept in the run" + phrase(" as {}", prompt.key))
        self._show_armed()
        self._looks.start()
        self._make_room()
        self.show()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Leave the picture out where there is no room for it."""
        super().resizeEvent(event)
        self._make_room()

    def _make_room(self) -> None:
        self.picture.setVisible(self.window().height() >= _ROOM_FOR_A_PICTURE)

    def withdraw(self) -> None:
        """Nothing is asked any more."""
        self._prompt = None
        self._looks.stop()
        self.hide()

    def _answer(self) -> None:
        if self._prompt is None or not self.is_armed:
            return
        answer = self._prompt.consent or self.field.text().strip()
        self.withdraw()
        self.answered.emit(answer)

    def _show_armed(self) -> None:
        self.give.setEnabled(self.is_armed)

    def _colour(self) -> None:
        palette = self._session.palette
        self.setStyleSheet(
            f"#prompt {{ background: {palette.surface}; border: 3px solid {palette.accent}; border-radius: 8px; }}"
        )
