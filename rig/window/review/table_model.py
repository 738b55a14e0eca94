"""The table of runs as a model: what stands in its cells, how it sorts, and which runs pass the filter."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from PySide6.QtCore import (
    QAbstractTableModel,
    QModelIndex,
    QObject,
    QPersistentModelIndex,
    QSortFilterProxyModel,
    Qt,
)
from PySide6.QtGui import QColor, QFont

from experiments import catalogue
from rig.content.phrase import phrase
from rig.content.wording import duration_text
from rig.gears.card import UNNAMED
from rig.library.index import IndexedRun
from rig.runfile.header import ORIGIN_WORDS
from rig.window.shell.palette import Palette
from rig.window.shell.stack import plain_tip
from rig.window.work.verdicts import COLOURS as VERDICT_COLOURS
from rig.window.work.verdicts import ListedVerdict, verdict_reasons, verdict_text

_AnyIndex = QModelIndex | QPersistentModelIndex
_NOWHERE = QModelIndex()
RUN_ROLE = Qt.ItemDataRole.UserRole + 1
SIGNS = {
    "COMPLETED": "✓",
    "ABORTED": "■",
    "TRIPPED": "▲",
    "ERROR": "✗",
    "INTERRUPTED": "■",
    "being written": "●",
    "": "",
}
"""The sign before an outcome: a colour never carries a meaning alone."""
COLOURS = {
    "COMPLETED": "text",
    "ABORTED": "warning",
    "INTERRUPTED": "warning",
    "being written": "accent",
    "": "text",
}
"""Colours of the palette by outcome; any other one is bad news."""


def outcome_of(run: IndexedRun) -> str:
    """The word for how a run ended, or for what state its file is in."""
    return outcome_word(run.outcome, run.state)


def outcome_word(outcome: str, state: str) -> str:
    """The outcome; where there is none the state of the file, which goes without saying of a sealed one."""
    return outcome or ("" if state == "sealed" else state)


def colour_of(outcome: str, palette: Palette) -> str:
    """The colour of an outcome; that of the text for none."""
    return getattr(palette, COLOURS.get(outcome, "bad"))


def with_sign(outcome: str) -> str:
    """The outcome with its sign."""
    return f"{SIGNS.get(outcome, '!')} {outcome}".strip()


@functools.lru_cache(maxsize=100_000)
def local_time(start: str) -> str:
    """A calendar time as the clock on the wall shows it; what cannot be read stays as it is."""
    try:
        return datetime.fromisoformat(start).astimezone().strftime("%Y-%m-%d %H:%M")
    except ValueError:
        return start


@dataclass(frozen=True)
class _LibraryColumn:
    """One column: heading, text of a run, what it is sorted by, whether it is a number."""

    heading: str
    text: Callable[[IndexedRun], str]
    key: Callable[[IndexedRun], Any]
    numeric: bool = False


def _duration(run: IndexedRun) -> str:
    return duration_text(run.duration)


def gear_words(run: IndexedRun) -> str:
    """The serial number of the gear; a bare motor has none."""
    experiment = catalogue.declared(run.protocol)
    if run.gear_serial in UNNAMED and experiment is not None and not experiment.gear_mounted:
        return "no gear"
    return run.gear_serial or "–"


COLUMNS = (
    _LibraryColumn("#", lambda r: str(r.number or "–"), lambda r: r.number, numeric=True),
    _LibraryColumn("protocol", lambda r: r.protocol or "–", lambda r: r.protocol),
    _LibraryColumn("gear", gear_words, lambda r: r.gear_serial),
    _LibraryColumn("outcome", lambda r: with_sign(outcome_of(r)), outcome_of),
    _LibraryColumn("verdict", lambda _: "", lambda _: ""),
    _LibraryColumn("started", lambda r: local_time(r.start), lambda r: local_time(r.start)),
    _LibraryColumn("operator", lambda r: r.operator or "–", lambda r: r.operator),
    _LibraryColumn(
        "time", _duration, lambda r: r.duration if math.isfinite(r.duration) else -1.0, numeric=True
    ),
    _LibraryColumn(
        "origin",
        lambda r: ORIGIN_WORDS.get(r.origin, r.origin) or ("hardware" if r.origin else "–"),
        lambda r: r.origin,
    ),
    _LibraryColumn("part", lambda r: r.gear or "–", lambda r: r.gear),
)
OUTCOME, VERDICT = (
    next(i for i, column in enumerate(COLUMNS) if column.heading == heading)
    for heading in ("outcome", "verdict")
)
"""The verdict is no part of the run: the model is told it."""


class LibraryModel(QAbstractTableModel):
    """The runs of a folder, one per row."""

    def __init__(self, palette: Callable[[], Palette], parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._palette = palette
        self._runs: tuple[IndexedRun, ...] = ()
        self._rows: list[IndexedRun] = []
        """The same in the order in which they are shown."""
        self._sorted_by = 0, Qt.SortOrder.AscendingOrder
        self.verdicts: dict[Path, ListedVerdict] = {}
        """What the runs are worth, as far as it has been worked out."""

    def take_verdicts(self, found: Mapping[Path, ListedVerdict | None]) -> None:
        """Verdicts that have been worked out; None takes one away."""
        for path, verdict in found.items():
            if verdict is None:
                self.verdicts.pop(path, None)
            else:
                self.verdicts[path] = verdict
        if self.is_sorted_by_verdict:
            self.sort(*self._sorted_by)
        self._tell_changed([row for row, run in enumerate(self._rows) if run.path in found])

    @property
    def is_sorted_by_verdict(self) -> bool:
        """Whether the order of the rows needs every verdict."""
        return self._sorted_by[0] == VERDICT

    @property
    def runs(self) -> tuple[IndexedRun, ...]:
        """Every run, filtered or not."""
        return self._runs

    @property
    def rows(self) -> Sequence[IndexedRun]:
        """Every run, filtered or not, in the order of the rows."""
        return self._rows

    def set_runs(self, runs: Sequence[IndexedRun]) -> None:
        """Other runs. Rows of the same files are changed in place, so that a selection stays."""
        before, after = self._rows, self._ordered(runs)
        old, new = [run.path for run in before], [run.path for run in after]
        first = next(
            (i for i, pair in enumerate(zip(old, new, strict=False)) if pair[0] != pair[1]),
            len(old),
        )
        added = len(new) - len(old)
        self._runs = tuple(runs)
        if added > 0 and old == new[:first] + new[first + added :]:
            self.beginInsertRows(QModelIndex(), first, first + added - 1)
            self._rows = after
            self.endInsertRows()
        elif old == new:
            self._rows = after
        else:
            self.beginResetModel()
            self._rows = after
            self.endResetModel()
            return
        kept = {id(run) for run in before}
        self._tell_changed(
            [
                row
                for row, run in enumerate(after)
                if id(run) not in kept and not first <= row < first + added
            ]
        )

    def sort(self, column: int, order: Qt.SortOrder = Qt.SortOrder.AscendingOrder) -> None:
        """Put the rows in the order of a column; those that are alike stay as they are listed."""
        self._sorted_by = column, order
        self.layoutAboutToBeChanged.emit()
        before = self.persistentIndexList()
        runs = [self._rows[index.row()] for index in before]
        self._rows = self._ordered(self._runs)
        places = {run.path: row for row, run in enumerate(self._rows)}
        after = [
            self.index(places[run.path], index.column())
            for run, index in zip(runs, before, strict=True)
        ]
        self.changePersistentIndexList(before, after)
        self.layoutChanged.emit()

    def _ordered(self, runs: Sequence[IndexedRun]) -> list[IndexedRun]:
        column, order = self._sorted_by
        return sorted(
            runs,
            key=lambda run: self._sort_key(run, column),
            reverse=order is Qt.SortOrder.DescendingOrder,
        )

    def _sort_key(self, run: IndexedRun, column: int) -> Any:
        if column == VERDICT:
            return verdict_text(self.verdicts.get(run.path))
        key = COLUMNS[max(column, 0)].key(run)
        return key.casefold() if isinstance(key, str) else key

    def restyle(self) -> None:
        """The theme has changed."""
        self._tell_changed(range(len(self._rows)))

    def _tell_changed(self, rows: Sequence[int]) -> None:
        """Rows that look different now, told in as few stretches as they make."""
        stretches: list[list[int]] = []
        for row in rows:
            if stretches and stretches[-1][1] == row - 1:
                stretches[-1][1] = row
            else:
                stretches.append([row, row])
        for first, last in stretches:
            self.dataChanged.emit(self.index(first, 0), self.index(last, len(COLUMNS) - 1))

    def rowCount(self, parent: _AnyIndex = _NOWHERE) -> int:
        return 0 if parent.isValid() else len(self._rows)

    def columnCount(self, parent: _AnyIndex = _NOWHERE) -> int:
        return 0 if parent.isValid() else len(COLUMNS)

    def headerData(
        self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole
    ) -> Any:
        if orientation is Qt.Orientation.Horizontal and role == Qt.ItemDataRole.DisplayRole:
            return COLUMNS[section].heading
        return None

    def data(self, index: _AnyIndex, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        if not index.isValid():
            return None
        run, column = self._rows[index.row()], COLUMNS[index.column()]
        verdict = self.verdicts.get(run.path)
        if index.column() == VERDICT and role == Qt.ItemDataRole.DisplayRole:
            return verdict_text(verdict)
        if role == Qt.ItemDataRole.DisplayRole:
            return column.text(run)
        if role == RUN_ROLE:
            return run
        if role == Qt.ItemDataRole.ToolTipRole:
            said = (_tool_tip(run), verdict_reasons(verdict))
            return plain_tip("\n".join(part for part in said if part))
        if role == Qt.ItemDataRole.TextAlignmentRole:
            side = Qt.AlignmentFlag.AlignRight if column.numeric else Qt.AlignmentFlag.AlignLeft
            return side | Qt.AlignmentFlag.AlignVCenter
        return self._look(run, index.column(), role)

    def _look(self, run: IndexedRun, column: int, role: int) -> Any:
        """Colour and weight of a cell."""
        palette = self._palette()
        if role == Qt.ItemDataRole.ForegroundRole:
            if column == OUTCOME:
                return QColor(colour_of(outcome_of(run), palette))
            verdict = self.verdicts.get(run.path)
            if column == VERDICT and verdict is not None:
                return QColor(getattr(palette, VERDICT_COLOURS[verdict.judged.verdict]))
            if run.problem:
                return QColor(palette.muted)
        if role == Qt.ItemDataRole.FontRole and column in (OUTCOME, VERDICT) and run.outcome:
            font = QFont()
            font.setBold(True)
            return font
        return None


def _tool_tip(run: IndexedRun) -> str:
    """What does not fit into the row."""
    facts = [
        run.path.name,
        run.problem,
        phrase("{} rows", run.rows),
        phrase("backend {}", run.backend),
    ]
    if run.state in ("being written", "left behind"):
        facts.append(
            f"{run.state}"
            + ("; `rig recover` makes a run of it" if run.state == "left behind" else "")
        )
    if run.notes:
        facts.append(f"notes: {run.notes}")
    return "\n".join(fact for fact in facts if fact)


@dataclass(frozen=True)
class Wanted:
    """What the filter lets pass: every word of `text` anywhere, the rest exactly; days as YYYY-MM-DD, both included."""

    text: str = ""
    gear: str = ""
    protocol: str = ""
    outcome: str = ""
    since: str = ""
    until: str = ""

    def passes(self, run: IndexedRun) -> bool:
        """Whether a run is wanted."""
        for wanted, value in (
            (self.gear, run.gear_serial),
            (self.protocol, run.protocol),
            (self.outcome, outcome_of(run)),
        ):
            if wanted and wanted != value:
                return False
        if not (self.since or self.until or self.text):
            return True
        day = local_time(run.start)[:10]
        if (self.since and day < self.since) or (self.until and not day <= self.until):
            return False
        if not self.text:
            return True
        text = _searched(run)
        return all(word in text for word in self.text.casefold().split())


def _searched(run: IndexedRun) -> str:
    """All that the words of a search are looked for in."""
    parts = (
        run.run_id,
        run.path.name,
        run.protocol,
        run.gear_serial,
        run.gear,
        run.operator,
        outcome_of(run),
        run.notes,
        run.problem,
        ORIGIN_WORDS.get(run.origin, ""),
        local_time(run.start),
    )
    return " ".join(parts).casefold()


class LibraryFilter(QSortFilterProxyModel):
    """The runs that are wanted, in the order of their model: it sorts ten thousand rows at once, one by one takes
    seconds.
    """

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.wanted = Wanted()

    def sort(self, column: int, order: Qt.SortOrder = Qt.SortOrder.AscendingOrder) -> None:
        """Have the model put its rows in the order of a column."""
        self.sourceModel().sort(column, order)

    def set_wanted(self, wanted: Wanted) -> None:
        """Filter anew."""
        if wanted != self.wanted:
            self.wanted = wanted
            self.invalidate()

    def filterAcceptsRow(self, source_row: int, source_parent: _AnyIndex) -> bool:
        source = self.sourceModel()
        return not isinstance(source, LibraryModel) or self.wanted.passes(source.rows[source_row])
