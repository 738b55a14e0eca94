"""Where the page of how a run stands is kept, for a phone or a wall: chosen once, and remembered."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtWidgets import QFileDialog, QPushButton

from rig.content.phrase import phrase
from rig.window.shell.session import WindowSession, path_of
from rig.window.shell.stack import push_button, set_tip


class StatusPageChoice:
    """A button: pressed it asks for a file, pressed again it ends the keeping. `kept` is the file, None for none."""

    def __init__(self, session: WindowSession) -> None:
        self._session = session
        self.button: QPushButton = push_button("Status page …", act=self.choose)
        self.button.setCheckable(True)
        self._show()

    @property
    def kept(self) -> Path | None:
        """The page that is kept of every run that is begun from now on."""
        return path_of(str(self._session.recall("status", "")))

    def choose(self) -> None:
        """Ask where it is kept; where one is kept, end it."""
        chosen = ""
        if self.kept is None and self._session.free_for("The status page"):
            usual = str(self._session.folder / "status.html")
            chosen, _ = QFileDialog.getSaveFileName(
                self.button, "Status page", usual, "Page (*.html)"
            )
        self._session.remember("status", chosen)
        self._show()

    def _show(self) -> None:
        kept = self.kept
        self.button.setChecked(kept is not None)
        what = "Keeps a page of how each run stands, for a phone or a wall."
        set_tip(self.button, what + phrase(" It is {}; press to end it.", kept))
