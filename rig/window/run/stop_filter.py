"""Stopping from wherever the hands are: Esc, Shift+Esc and the red buttons, heard before anything else hears them.

While a run exists. A shortcut of the window is not enough: an open list or menu takes the key, and the
first press beside it, for closing itself; a dialog keeps both from the window.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from PySide6.QtCore import QEvent, QObject, QRect, Qt, QTimer
from PySide6.QtGui import QKeyEvent, QMouseEvent
from PySide6.QtWidgets import QAbstractButton, QApplication, QWidget

Act = Callable[[], object]
KEYS = (QEvent.Type.ShortcutOverride, QEvent.Type.KeyPress)
_PRESSES = (QEvent.Type.MouseButtonPress, QEvent.Type.MouseButtonDblClick)
_WINDOWS = (Qt.WindowType.Window, Qt.WindowType.Dialog, Qt.WindowType.Sheet, Qt.WindowType.Tool)
"""Kinds of windows that may keep keys and presses from the one with STOP; lists, menus and tips are none of them."""


class StopFilter(QObject):
    """The filter of one `window`, on the whole application between `set_active(True)` and `set_active(False)`.

    `buttons`: each with what a press on it does. `refused` is told when another window wanted to open.
    """

    def __init__(
        self,
        window: QWidget,
        stop: Act,
        abort: Act,
        buttons: Sequence[tuple[QAbstractButton, Act]],
        refused: Act,
    ) -> None:
        super().__init__(window)
        self._window, self._stop, self._abort = window, stop, abort
        self._buttons, self._refused = tuple(buttons), refused
        self._is_active = False

    def set_active(self, active: bool) -> None:
        """Whether a run exists. Other windows that stand open when it begins are closed."""
        application = QApplication.instance()
        if active == self._is_active or application is None:
            return
        self._is_active = active
        if not active:
            application.removeEventFilter(self)
            return
        application.installEventFilter(self)
        for other in QApplication.topLevelWidgets():
            if other.isVisible() and self._is_in_the_way(other):
                other.close()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Takes what stops the rig, and nothing else."""
        kind = event.type()
        if kind in KEYS and isinstance(event, QKeyEvent):
            return self._hear(event)
        if kind in _PRESSES and isinstance(event, QMouseEvent):
            return self._feel(event)
        if (
            kind is QEvent.Type.Show
            and isinstance(watched, QWidget)
            and self._is_in_the_way(watched)
        ):
            # Not within its own event: whoever opens it is still at work with it.
            QTimer.singleShot(0, watched, watched.close)
            self._refused()
        return False

    def _hear(self, event: QKeyEvent) -> bool:
        if event.key() != Qt.Key.Key_Escape:
            return False
        # Accepted as an override, it is nobody's shortcut and comes again as a press.
        event.accept()
        if event.type() is QEvent.Type.KeyPress and not event.isAutoRepeat():
            quick = event.modifiers() & Qt.KeyboardModifier.ShiftModifier
            (self._abort if quick else self._stop)()
            _close_popups()
        return True

    def _feel(self, event: QMouseEvent) -> bool:
        """A press on a red button beside an open list or menu: Qt would only close that."""
        popup = QApplication.activePopupWidget()
        at = event.globalPosition().toPoint()
        if popup is None or popup.frameGeometry().contains(at):
            return False
        for button, act in self._buttons:
            place = QRect(button.mapToGlobal(button.rect().topLeft()), button.size())
            if button.isVisible() and button.isEnabled() and place.contains(at):
                act()
                _close_popups()
                return True
        return False

    def _is_in_the_way(self, widget: QWidget) -> bool:
        return widget.isWindow() and widget is not self._window and widget.windowType() in _WINDOWS


def _close_popups() -> None:
    while (popup := QApplication.activePopupWidget()) is not None and popup.close():
        pass
