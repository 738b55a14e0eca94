"""What can be read from three metres: the state in a word, a symbol and a colour; and the one large STOP beside it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QFont, QFontMetricsF, QResizeEvent
from PySide6.QtWidgets import (
    QFrame,
    QSizePolicy,
    QWidget,
)

from rig.run.state import RunState, State
from rig.window.shell.sentence import cut_short
from rig.window.shell.stack import (
    in_column,
    in_row,
    push_button,
    restyled,
    set_tip,
    text_label,
)
from rig.window.shell.theme import BANNER_CAPITAL

_WORD_SHARE = 0.6
"""Share of the banner's width that symbol and word take at most."""
_SYMBOL_WIDTH = 64
_SPACING = 2
"""Pixels between the letters of the word."""
LINES, LETTER = 3, 7.5
"""Lines of small words beside the word at most, and pixels of a letter in them."""


@dataclass(frozen=True)
class Look:
    """How a state looks: its word, its symbol, background and text colour.

    Symbol and word differ for every state; the colours differ in lightness too, so that no state is told by hue alone.
    """

    word: str
    symbol: str
    background: str
    text: str


LOOKS: dict[State, Look] = {
    State.IDLE: Look("IDLE", "○", "#8b939c", "#0d1014"),
    State.ARMED: Look("ARMED", "◎", "#f0e442", "#16191d"),
    State.RUNNING: Look("RUNNING", "▶", "#0072b2", "#ffffff"),
    State.WAITING: Look("WAITING FOR YOU", "?", "#e7b3d2", "#16191d"),
    State.STOPPING: Look("STOPPING", "▼", "#e69f00", "#16191d"),
    State.ANALYSING: Look("ANALYSING", "∿", "#cfd6dd", "#16191d"),
    State.TRIPPED: Look("TRIPPED", "✖", "#a3150c", "#ffffff"),
    State.FINISHED: Look("FINISHED", "■", "#cfd6dd", "#16191d"),
    State.REFUSED: Look("NOT STARTED", "⊘", "#8b939c", "#0d1014"),
    State.LOST: Look("LOST", "✖", "#a3150c", "#ffffff"),
}
"""Okabe-Ito yellow, blue, orange and a light purple, a dark red and greys of different lightness."""
OUTCOMES: dict[str, tuple[str, str, str]] = {
    "COMPLETED": ("■", "#cfd6dd", "#16191d"),
    "ABORTED": ("■", "#cfd6dd", "#16191d"),
    "ERROR": ("✖", "#a3150c", "#ffffff"),
}
"""Symbol and colours of a finished run's outcome; that it was completed says nothing of the gear."""
_VERDICTS: dict[str, tuple[str, str, str]] = {
    "PASS": ("✔", "#006b50", "#ffffff"),
    "MARGINAL": ("≈", "#f0e442", "#16191d"),
    "FAIL": ("✘", "#8a3800", "#ffffff"),
    "NOT JUDGED": ("■", "#cfd6dd", "#16191d"),
}
"""Symbol and colours of the verdict on the gear of a completed run; neutral where nothing was judged."""


def look_of(state: RunState) -> Look:
    """The look of a state; of a finished run that of its outcome and, where it was completed, of its verdict."""
    look = LOOKS[state.state]
    if (
        state.state is State.FINISHED
        and state.outcome == "COMPLETED"
        and state.verdict in _VERDICTS
    ):
        symbol, background, text = _VERDICTS[state.verdict]
        return Look(f"COMPLETED: {state.verdict}", symbol, background, text)
    if state.state is State.FINISHED and state.outcome in OUTCOMES:
        symbol, background, text = OUTCOMES[state.outcome]
        return Look(f"FINISHED: {state.outcome}", symbol, background, text)
    return look


class Banner(QFrame):
    """The state of the rig. `show_state` changes it."""

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("banner")
        self._look: Look | None = None
        self._size, self._words = 0, ""
        at_right = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        self._symbol, self._word = text_label(align=Qt.AlignmentFlag.AlignCenter), text_label()
        self._title = text_label(wraps=True, align=at_right)
        self._what = text_label(wraps=True, align=at_right)
        self._symbol.setMinimumWidth(_SYMBOL_WIDTH)
        right = in_column((None, 1), self._title, self._what, (None, 1), spacing=2)
        self.setLayout(
            in_row(self._symbol, self._word, (right, 1), margins=(14, 6, 16, 6), spacing=12)
        )
        self.setMinimumHeight(84)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Preferred)
        self.show_state(RunState())

    @property
    def word(self) -> str:
        """The word that stands on it."""
        return self._word.text()

    def show_state(self, state: RunState, title: str = "") -> None:
        """Show a state and what the rig is doing."""
        look = look_of(state)
        self._symbol.setText(look.symbol)
        self._word.setText(look.word)
        self._title.setText(title)
        # Where somebody has to act at once, what to do stands here; elsewhere what the rig is doing.
        self._words = (
            state.remedy if state.state is State.LOST or state.safe is False else state.what
        )
        set_tip(self._what, state.what)
        fresh, self._look = look != self._look, look
        self._fit()
        if not fresh:
            # Told ten times a second: a style sheet is worked through anew even when it says the same.
            return
        self.setAccessibleName(f"State of the rig: {look.word}")
        self.setStyleSheet(
            f"#banner {{ background: {look.background}; border-radius: 8px; }}"
            f"#banner QLabel {{ color: {look.text}; background: transparent; font-size: 11pt; }}"
        )
        self._title.setStyleSheet(f"font-size: 11pt; font-weight: 600; color: {look.text};")
        self._write_large()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """The word as large as it fits."""
        super().resizeEvent(event)
        self._fit()

    def _fit(self) -> None:
        if self._look is None:
            return
        letters = LINES * (1.0 - _WORD_SHARE) * self.width() / LETTER
        self._what.setText(cut_short(self._words, max(round(letters), 30)))
        size = _banner_font(self._look.word, _WORD_SHARE * self.width() - _SYMBOL_WIDTH)
        if size != self._size:
            self._size = size
            self._write_large()

    def _write_large(self) -> None:
        assert self._look is not None
        large = f"font-size: {self._size}px; font-weight: 800; color: {self._look.text};"
        self._symbol.setStyleSheet(large)
        self._word.setStyleSheet(f"{large} letter-spacing: {_SPACING}px;")


def _banner_font(word: str, room: float) -> int:
    """Pixels of the font in which a word fits into `room` [px], no larger than `BANNER_CAPITAL` asks for."""
    font = QFont()
    font.setPixelSize(100)
    font.setWeight(QFont.Weight(800))
    measured = QFontMetricsF(font)
    largest = math.ceil(100.0 * BANNER_CAPITAL / measured.capHeight())
    fitting = 100.0 * (room - _SPACING * len(word)) / measured.horizontalAdvance(word)
    return max(min(largest, int(fitting)), 12)


class StopButtons(QWidget):
    """STOP, large, and ABORT, smaller. Space and Esc are STOP, Shift+Esc is ABORT; the page looks after the keys."""

    stop_pressed = Signal()
    abort_pressed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.stop = push_button(
            "STOP",
            "stop",
            tip="Controlled ramp to standstill; the run is kept as ABORTED (Space or Esc)",
        )
        self.abort = push_button(
            "ABORT  (Shift+Esc)",
            "abort",
            tip="Quick stop: the shortest ramp that the drive has (Shift+Esc)",
        )
        self.stop.setAccessibleName("STOP: controlled ramp to standstill")
        self.stop.setMinimumSize(210, 78)
        self.stop.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setLayout(in_column((self.stop, 1), self.abort, margins=(0, 0, 0, 0), spacing=4))
        # At the press, not at the release: a finger that slips off has still stopped the rig.
        self.stop.pressed.connect(self.stop_pressed)
        self.abort.pressed.connect(self.abort_pressed)
        self.is_live = True
        self.set_live(False)

    def set_live(self, live: bool) -> None:
        """Whether there is something to stop: then they are red. They can be pressed all the same."""
        if live == self.is_live:
            return
        self.is_live = live
        for button, part in ((self.stop, "stop"), (self.abort, "abort")):
            restyled(button, part if live else f"{part}-idle")
