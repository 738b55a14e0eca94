"""The question when somebody closes the window during a run: in the page, so that STOP stays within reach."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QFrame

from rig.window.shell.session import WindowSession
from rig.window.shell.stack import in_column, in_row, push_button, text_label


class CloseQuestion(QFrame):
    """Hidden unless the window is to be closed while a run exists. `answered`: whether it is left."""

    answered = Signal(bool)

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self._session = session
        self.setObjectName("question")
        heading = text_label("The rig may be turning. Close the window?", "heading", wraps=True)
        words = text_label(
            "With STOP the rig comes to a standstill by a controlled ramp, the run is kept as ABORTED, "
            "and the window closes once standstill has been verified.",
            wraps=True,
        )
        self.stay = push_button("Stay", act=lambda: self._answer(False))
        self.leave = push_button(
            "STOP and close when safe", "primary", act=lambda: self._answer(True)
        )
        both = in_column(heading, words, spacing=2)
        self.setLayout(in_row((both, 1), self.stay, self.leave, margins=(14, 6, 14, 6)))
        session.theme_changed.connect(lambda _: self._colour())
        self._colour()
        self.hide()

    def _answer(self, leave: bool) -> None:
        self.hide()
        self.answered.emit(leave)

    def _colour(self) -> None:
        palette = self._session.palette
        self.setStyleSheet(
            f"#question {{ background: {palette.surface}; border: 3px solid {palette.warning}; border-radius: 8px; }}"
        )
