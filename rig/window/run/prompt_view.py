"""A question of the run to the operator, with a field for the answer: the plan waits while the rig stands."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QFrame

from rig.window.shell.session import WindowSession
from rig.window.shell.stack import in_row, line_field, push_button, text_label


class PromptView(QFrame):
    """Hidden unless something is asked."""

    answered = Signal(str)

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self._session = session
        self.setObjectName("prompt")
        self.question = text_label(wraps=True)
        self.question.setStyleSheet("font-size: 13pt; font-weight: 600;")
        self.field = line_field("Answer to the question of the run", "Answer")
        self.field.setMinimumWidth(220)
        self.give = push_button("Answer and go on", "primary", act=self._answer)
        self.setLayout(in_row((self.question, 1), self.field, self.give, margins=(14, 8, 14, 8)))
        self.field.returnPressed.connect(self._answer)
        session.theme_changed.connect(lambda _: self._colour())
        self._colour()
        self.hide()

    def ask(self, text: str, key: str) -> None:
        """Put a question."""
        self.question.setText(f"?  {text}")
        self.field.clear()
        self.field.setToolTip(f"kept in the run as {key}" if key else "kept in the run")
        self.show()
        self.field.setFocus()

    def withdraw(self) -> None:
        """Nothing is asked any more."""
        self.hide()

    def _answer(self) -> None:
        self.hide()
        self.answered.emit(self.field.text().strip())

    def _colour(self) -> None:
        palette = self._session.palette
        self.setStyleSheet(
            f"#prompt {{ background: {palette.surface}; border: 3px solid {palette.accent}; border-radius: 8px; }}"
        )
