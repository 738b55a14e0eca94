"""Events of a run and the operator's notes on one clock; opening one shows the signals around it."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QWidget

from experiments.recording import Event, Recording
from rig.runfile.contents import event_grid
from rig.window.review.grid import GridTable
from rig.window.shell.sentence import listed_of
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import (
    choice_box,
    in_column,
    in_row,
    text_label,
)

FILTERS = ("everything", "notes and answers", "warnings and errors")


class RunEventsView(QWidget):
    """The events. `moment_chosen` carries a time since the first row [s]."""

    moment_chosen = Signal(float)

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self._first_ns = 0
        self._events: tuple[Event, ...] = ()
        self._shown: list[Event] = []
        self.table = GridTable(session, "Events and notes")
        self.filter = choice_box("Which events", FILTERS)
        self.filter.currentIndexChanged.connect(lambda _: self._fill())
        self.count = text_label("", "muted")
        self.table.activated.connect(
            lambda index: self.moment_chosen.emit(
                (self._shown[index.row()].time_ns - self._first_ns) * 1e-9
            )
        )
        head = in_row(text_label("show"), self.filter, (self.count, 1))
        self.setLayout(in_column(head, (self.table, 1), margins=(6, 6, 6, 4)))

    def show_recording(self, recording: Recording) -> None:
        """The events of a run."""
        first = int(recording.source.time_ns(0, 1)[0]) if recording.rows else 0
        first = first or (recording.events[0].time_ns if recording.events else 0)
        shown = (first, tuple(recording.events))
        if shown != (self._first_ns, self._events) or not self.table.columnCount():
            self._first_ns, self._events = shown
            self._fill()

    def _fill(self) -> None:
        wanted = FILTERS.index(self.filter.currentText())
        self._shown = [event for event in self._events if _passes(event, wanted)]
        self.table.show_grid(event_grid(self._shown, self._first_ns).without("time (UTC)"))
        self.count.setText(_count(self._shown, len(self._events)))


def _passes(event: Event, wanted: int) -> bool:
    if wanted == 1:
        return event.source == "operator"
    return wanted == 0 or event.level != "info"


def _count(shown: Sequence[object], every: int) -> str:
    text = listed_of(len(shown), every, "events")
    return f"{text}. Enter or double click shows the signals around one." if shown else text
