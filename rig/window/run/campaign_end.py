"""The end of a campaign, a page of its own: the verdict, one picture of all limits, the certificate, the next gear."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from PySide6.QtCore import QPointF, QRectF, QSize, Qt, QUrl, Signal
from PySide6.QtGui import QColor, QDesktopServices, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QFrame, QSizePolicy, QWidget

from experiments import catalogue
from rig.analysis.judging import room_left
from rig.content.wording import laboratory_unit, number, value_text
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import (
    in_column,
    in_row,
    push_button,
    scrolled,
    set_tip,
    text_label,
)
from rig.window.work.verdicts import COLOURS, SIGNS

MOST_REASONS = 4
"""Reasons of a verdict that are named; all stand on the certificate."""
_WIDEST, _LEAST = 2.0, 1.25
"""A lane ends at so many times the limit at most, and at least."""
_LOWEST_ROW, _HIGHEST_ROW = 44, 84
"""Logical pixels of one limit: where there is little room, and where there is plenty."""


@dataclass(frozen=True, kw_only=True)
class _LimitLine:
    """One limit as the picture has it: value and U as shares of the limit, and both in words."""

    name: str
    outcome: str
    share: float
    """Value over limit; NaN where there is no value, or the limit is no measure (0 or less)."""
    expanded: float
    """U over limit."""
    is_upper: bool
    value_text: str
    limit_text: str
    because: str = ""

    @property
    def room(self) -> float:
        """What is left of the limit, in U; what is not judged has less than any value."""
        if self.outcome == "NOT JUDGED" or not math.isfinite(self.share):
            return -math.inf
        return room_left(self.share, 1.0, self.expanded, is_upper=self.is_upper)

    @classmethod
    def of(cls, told: Mapping[str, Any]) -> Self:
        """Of an entry of `limits`, as `rig campaign --json` has it."""
        value, limit, unit = _number(told["value"]), _number(told["limit"]), str(told["unit"])
        expanded = _number(told["expanded_uncertainty"])
        kind, _, name = str(told["quantity"]).partition(".")
        quantity = catalogue.declared_quantity(kind, name)
        is_upper, measured = told["limit_is"] == "upper", math.isfinite(value)
        shown = "" if quantity is None else quantity.shown
        factor, word = laboratory_unit(unit, value if measured else limit, shown)
        words = value_text(value, expanded, unit, quantity) if measured else "–"
        return cls(
            name=str(told["name"]),
            outcome=str(told["outcome"]),
            share=_share(value, limit),
            expanded=_share(expanded, limit),
            is_upper=is_upper,
            value_text=words,
            limit_text=f"{'≤' if is_upper else '≥'} {number(limit / factor)} {word}".rstrip(),
            because=str(told.get("because", "")),
        )


def _share(value: float, limit: float) -> float:
    """A value as a share of its limit; NaN where there is nothing to share."""
    return value / limit if limit > 0.0 else math.nan


def _number(told: Any) -> float:
    """A number of a JSON object, in which one that is not known is null."""
    return math.nan if told is None else float(told)


def limit_lines(report: Mapping[str, Any]) -> list[_LimitLine]:
    """The limits of a campaign's report, the nearest to its limit first."""
    return sorted(
        (_LimitLine.of(told) for told in report.get("limits", ())), key=lambda one: one.room
    )


class _LimitPicture(QWidget):
    """Every limit as a lane: the value as a dot with its U, the limit as a line, what lies beyond it shaded."""

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self._session = session
        self.lines: list[_LimitLine] = []
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Minimum)
        session.theme_changed.connect(lambda _: self.update())

    def show_lines(self, lines: list[_LimitLine]) -> None:
        """Draw these."""
        self.lines = lines
        self.setMinimumHeight(_LOWEST_ROW * max(len(lines), 1))
        told = (f"{one.name} {one.value_text}, {one.limit_text}, {one.outcome}" for one in lines)
        self.setAccessibleName("Limits: " + "; ".join(told))
        self.updateGeometry()
        self.update()

    def sizeHint(self) -> QSize:
        """As high as its lanes."""
        return QSize(520, _HIGHEST_ROW * max(len(self.lines), 1))

    @property
    def end(self) -> float:
        """Where all lanes end, as a multiple of the limit: one limit line for all of them."""
        reach = [one.share + one.expanded for one in self.lines]
        most = max((one for one in reach if math.isfinite(one)), default=1.0)
        return min(max(1.05 * most, _LEAST), _WIDEST)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the lanes."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        if not self.lines:
            painter.setPen(QColor(self._session.palette.muted))
            text = "This gear has no acceptance limits: its numbers stand on the certificate."
            painter.drawText(self.rect(), Qt.AlignmentFlag.AlignLeft, text)
        row = min(self.height() // max(len(self.lines), 1), _HIGHEST_ROW)
        for place, line in enumerate(self.lines):
            self._paint_lane(painter, place * row, row, line)
        painter.end()

    def _paint_lane(self, painter: QPainter, top: int, row: int, line: _LimitLine) -> None:
        palette, width, end = self._session.palette, float(self.width()), self.end
        colour = QColor(getattr(palette, COLOURS.get(line.outcome, "muted")))
        words = QRectF(0, top, width, 20)
        right = f"{line.value_text}   {line.limit_text}   {SIGNS[line.outcome]} {line.outcome}"
        taken = painter.fontMetrics().horizontalAdvance(right)
        name = painter.fontMetrics().elidedText(
            line.name, Qt.TextElideMode.ElideRight, max(int(width) - taken - 12, 60)
        )
        middle = Qt.AlignmentFlag.AlignVCenter
        painter.setPen(QColor(palette.text))
        painter.drawText(words, Qt.AlignmentFlag.AlignLeft | middle, name)
        painter.setPen(colour)
        painter.drawText(words, Qt.AlignmentFlag.AlignRight | middle, right)
        lane, limit = QRectF(0, top + 22, width, row - 32), width / end
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(QColor(palette.raised))
        painter.drawRoundedRect(lane, 3, 3)
        if not math.isfinite(line.share):
            self._write_why(painter, lane, line)
            return
        beyond = QRectF(lane)
        beyond.setLeft(limit) if line.is_upper else beyond.setRight(limit)
        shade = QColor(palette.bad)
        shade.setAlpha(60)
        painter.setBrush(shade)
        painter.drawRect(beyond)
        painter.setPen(QPen(QColor(palette.text), 2.0))
        painter.drawLine(QPointF(limit, lane.top() - 2), QPointF(limit, lane.bottom() + 2))
        self._paint_value(painter, lane, line, colour)

    def _write_why(self, painter: QPainter, lane: QRectF, line: _LimitLine) -> None:
        """A lane without a value says why there is none."""
        room = lane.adjusted(10, -4, -10, 4)
        words = painter.fontMetrics().elidedText(
            line.because, Qt.TextElideMode.ElideRight, int(room.width())
        )
        painter.setPen(QColor(self._session.palette.muted))
        painter.drawText(room, Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter, words)

    def _paint_value(
        self, painter: QPainter, lane: QRectF, line: _LimitLine, colour: QColor
    ) -> None:
        """The dot with its interval; one beyond the end of the lane is an arrow at it."""
        width, height = lane.width(), lane.center().y()

        def place(share: float) -> float:
            return min(max(share / self.end, 0.0), 1.0) * (width - 2.0) + 1.0

        painter.setPen(QPen(colour, 2.0))
        if math.isfinite(line.expanded):
            low, high = place(line.share - line.expanded), place(line.share + line.expanded)
            painter.drawLine(QPointF(low, height), QPointF(high, height))
            for end in (low, high):
                painter.drawLine(QPointF(end, height - 4), QPointF(end, height + 4))
        painter.setBrush(colour)
        at = place(line.share)
        if 0.0 <= line.share <= self.end:
            painter.drawEllipse(QPointF(at, height), 4.0, 4.0)
        else:
            away = -7.0 if line.share > self.end else 7.0
            tips = [QPointF(at, height), *(QPointF(at + away, height + y) for y in (-5.0, 5.0))]
            painter.drawPolygon(tips)


class CampaignEnd(QFrame):
    """Hidden until a campaign was brought to its end."""

    review_requested = Signal(Path)
    next_requested = Signal()
    """The next gear waits to be mounted."""

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self._session = session
        self.setProperty("part", "card")
        self.verdict, self.gear = (
            text_label("", "number-muted"),
            text_label("", "heading", wraps=True),
        )
        self.reasons = text_label(wraps=True, selectable=True)
        self.picture = _LimitPicture(session)
        self.print_button = push_button(
            "&Print certificate", "primary", tip="Opens the certificate for paper (PDF)"
        )
        self.open_button = push_button("Open certificate", tip="The same as a page of the browser")
        self.print_button.clicked.connect(lambda: self._open_paper(".pdf"))
        self.open_button.clicked.connect(lambda: self._open_paper(".html"))
        self.next_button = push_button("&Next gear", "primary", act=self.next_requested)
        self.review = push_button("Review the last run", act=self._ask_review)
        self._papers: dict[str, Path] = {}
        self._path: Path | None = None
        self.open_paper = lambda path: QDesktopServices.openUrl(QUrl.fromLocalFile(str(path)))
        """Opens a file with what the desktop has for it; whether there was anything."""
        ways = in_row(
            self.print_button, self.next_button, (None, 1), self.open_button, self.review, spacing=8
        )
        picture = scrolled(self.picture)
        picture.viewport().setAutoFillBackground(False)
        self.picture.setAutoFillBackground(False)
        parts = (self.gear, self.reasons, (picture, 1), ways)
        self.setLayout(in_column(*parts, margins=(16, 10, 16, 12), spacing=8))
        self.hide()

    def show_end(self, report: Mapping[str, Any], path: Path | None) -> None:
        """The end of a campaign; `path` is the file of its latest run."""
        lines = limit_lines(report)
        names = [line.name for line in lines]
        kept = sum(line.outcome == "PASS" for line in lines)
        counted = f"{kept} of {len(lines)} limits kept" if lines else "no limits"
        self.gear.setText(f"{report.get('gear', '')}: {counted}")
        self.picture.show_lines(lines)
        # What the picture shows is said there: here stands what no lane can show.
        reasons = [why for why in reasons_of(report) if not why.startswith(tuple(names))]
        self.reasons.setText("\n".join([*reasons, *remarks_of(report)]))
        self.reasons.setVisible(bool(self.reasons.text()))
        self._papers = {Path(one).suffix: Path(one) for one in report.get("certificate", ())}
        self.print_button.setEnabled(".pdf" in self._papers)
        self.open_button.setEnabled(".html" in self._papers)
        set_tip(self.print_button, str(self._papers.get(".pdf", "There is no certificate.")))
        self._path = path
        self.review.setEnabled(path is not None)
        self.show()
        first = self.print_button if self.print_button.isEnabled() else self.next_button
        first.setFocus()

    def _open_paper(self, suffix: str) -> None:
        path = self._papers[suffix].resolve()
        opened = self.open_paper(path)
        self._session.message.emit(
            f"Certificate: {path}" if opened else f"Written, but nothing here opens it: {path}"
        )

    def _ask_review(self) -> None:
        if self._path is not None:
            self.review_requested.emit(self._path)


def reasons_of(report: Mapping[str, Any]) -> list[str]:
    """Why the verdict of a campaign is no better; of many the first, and how many more there are."""
    reasons = [str(why) for why in report.get("because", ())]
    more = len(reasons) - MOST_REASONS
    return reasons if more <= 0 else [*reasons[:MOST_REASONS], f"{more} more: see the certificate"]


def remarks_of(report: Mapping[str, Any]) -> list[str]:
    """What was done again, what went wrong, and what has changed with the gear: a line each."""
    lines = [str(words) for words in report.get("resumed", ())]
    lines += [f"Analysis: {problem}" for problem in report.get("problems", ())]
    if untold := report.get("alarms_untold"):
        lines.append(f"Whether the gear has changed cannot be told: {untold}")
    changed = report.get("alarms", ())
    return lines + [f"CHANGED: {one['sentence']}. {one['decides']}" for one in changed]
