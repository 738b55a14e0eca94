"""The runs of a campaign in one line: which are done, which is under way, which are to come."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from html import escape

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel, QSizePolicy

from rig.window.shell.session import WindowSession
from rig.window.shell.stack import set_tip

_SYMBOLS = {"to come": "○", "under way": "▶", "counts": "✓", "COMPLETED": "✓"}
"""Before the name of a run; any other outcome has a cross."""
_OTHER = "✖"
_COLOURS = {"to come": "muted", "under way": "text", "counts": "text", "COMPLETED": "text"}
"""Colours of the palette; any other outcome is bad news."""


@dataclass(frozen=True)
class StageRow:
    """One run of a campaign: its protocol, nominal duration [s], and how it stands."""

    protocol: str
    nominal: float = 0.0
    standing: str = "to come"
    """ "to come", "under way", "counts" (run before), or the outcome of its run."""

    @property
    def is_over(self) -> bool:
        """Whether nothing more is to come of it."""
        return self.standing not in ("to come", "under way")


class StagesView(QLabel):
    """Hidden where a run is no part of a campaign. `expect` shows the runs, `stands` how one of them is."""

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self._session = session
        self.rows: list[StageRow] = []
        self.setTextFormat(Qt.TextFormat.RichText)
        self.setWordWrap(True)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Minimum)
        self.setAccessibleName("Runs of the campaign")
        session.theme_changed.connect(lambda _: self._show())
        self.clear_stages()

    def clear_stages(self) -> None:
        """No campaign."""
        self.rows = []
        self.hide()

    def expect(self, stages: Sequence[StageRow]) -> None:
        """A campaign is about to begin."""
        self.rows = list(stages)
        self._show()
        self.show()

    def stands(self, index: int, standing: str) -> None:
        """How a run stands from now on."""
        if 0 <= index < len(self.rows):
            self.rows[index] = replace(self.rows[index], standing=standing)
            self._show()

    @property
    def is_campaign(self) -> bool:
        """Whether there are stages at all."""
        return bool(self.rows)

    @property
    def is_over(self) -> bool:
        """Whether every run is over."""
        return self.is_campaign and all(row.is_over for row in self.rows)

    @property
    def left(self) -> float:
        """Nominal duration of the runs that are yet to come [s]."""
        return sum(row.nominal for row in self.rows if row.standing == "to come")

    @property
    def words(self) -> list[str]:
        """Every run with its symbol, as it is shown."""
        return [f"{_SYMBOLS.get(row.standing, _OTHER)} {row.protocol}" for row in self.rows]

    def _show(self) -> None:
        palette = self._session.palette
        parts = []
        for row, words in zip(self.rows, self.words, strict=True):
            colour = getattr(palette, _COLOURS.get(row.standing, "bad"))
            weight = 700 if row.standing == "under way" else 400
            told = escape(words).replace(" ", "&nbsp;").replace("-", "&#8209;")
            parts.append(f'<span style="color:{colour}; font-weight:{weight}">{told}</span>')
        self.setText(" &nbsp;&nbsp; ".join(parts))
        set_tip(
            self, "\n".join(f"{row.protocol}: {row.standing}" for row in self.rows) or "no campaign"
        )
