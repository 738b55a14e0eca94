"""What the pages of one window share: folder of runs, rig, configuration, theme, and what is
remembered between days.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, Signal

from rig.window.shell.palette import Palette, palette_of

REMEMBERED_FILE = ".window.json"
"""Lies in the folder of runs, in plain sight: no registry, no hidden settings. Deleting it forgets everything."""


class WindowSession(QObject):
    """The shared state of one window. `backend` is a name as for `rig run --backend`; `theme` is "light" or "dark"."""

    theme_changed = Signal(object)
    """Carries the new `Palette`; every plot and page restyles itself."""
    runs_changed = Signal()
    """A run was finished, imported or recovered: lists of runs look again."""
    message = Signal(str)
    """One line for the status bar."""

    def __init__(
        self,
        folder: Path,
        backend: str = "sim",
        configuration: Path | None = None,
        theme: str = "light",
    ) -> None:
        super().__init__()
        self.folder, self.backend, self.configuration = folder, backend, configuration
        self.run_exists = False
        """Whether a run exists: no dialog may stand before its STOP."""
        self._theme = theme
        self._remembered = _read(folder / REMEMBERED_FILE)

    @property
    def theme(self) -> str:
        """The name of the theme: "light" or "dark"."""
        return self._theme

    @property
    def palette(self) -> Palette:
        """The colours of the theme."""
        return palette_of(self._theme)

    def set_theme(self, theme: str) -> None:
        """Change the theme and tell everybody."""
        self._theme = theme
        self.theme_changed.emit(self.palette)

    @property
    def operator(self) -> str:
        """Who sat here last; to be confirmed, never assumed."""
        return str(self.recall("operator", ""))

    @property
    def is_hardware(self) -> bool:
        """Whether runs of this window turn a real rig."""
        return self.backend == "hardware"

    def free_for(self, what: str) -> bool:
        """Whether a dialog may be opened; during a run not, and it is said of `what`."""
        if self.run_exists:
            self.message.emit(
                f"{what} waits for the end of the run: nothing may stand before STOP."
            )
        return not self.run_exists

    def recall(self, key: str, default: Any = None) -> Any:
        """What was remembered under a name (plain JSON data)."""
        return self._remembered.get(key, default)

    def remember(self, key: str, value: Any) -> None:
        """Keep plain JSON data under a name for the next time. A folder that cannot be written forgets, and says so."""
        self._remembered[key] = value
        path = self.folder / REMEMBERED_FILE
        text = json.dumps(self._remembered, indent=1, ensure_ascii=False, sort_keys=True)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            fresh = path.with_suffix(".json.new")
            fresh.write_text(text + "\n", encoding="utf-8")
            fresh.replace(path)
        except OSError as error:
            self.message.emit(
                f"Not remembered: {path} cannot be written ({error.strerror or error})."
            )


def path_of(chosen: str) -> Path | None:
    """The path that was chosen or remembered; None where none was."""
    return Path(chosen) if chosen else None


def _read(path: Path) -> dict[str, Any]:
    """What was remembered; nothing from a file that is missing or damaged."""
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return values if isinstance(values, dict) else {}
