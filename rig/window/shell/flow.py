"""A layout whose parts go on in the next line where the window is too narrow for all of them beside each other."""

from __future__ import annotations

from PySide6.QtCore import QPoint, QRect, QSize, Qt
from PySide6.QtWidgets import QLayout, QLayoutItem, QSizePolicy, QWidget

from rig.window.shell.stack import in_row

_GROWING = (QSizePolicy.Policy.Expanding, QSizePolicy.Policy.MinimumExpanding)
Line = list[tuple[QLayoutItem, QSize]]


class FlowLayout(QLayout):
    """Parts beside each other as in a text: none is cut, the width that a line leaves goes to what can grow."""

    def __init__(self, spacing: int) -> None:
        super().__init__()
        self.setSpacing(spacing)
        self.setContentsMargins(0, 0, 0, 0)
        self._items: list[QLayoutItem] = []
        self._height = 0
        """Pixels that its lines took when it was last laid out."""

    def addItem(self, item: QLayoutItem, /) -> None:
        """Take up a part."""
        self._items.append(item)

    def count(self) -> int:
        """How many parts there are."""
        return len(self._items)

    def itemAt(self, index: int, /) -> QLayoutItem | None:  # pyright: ignore[reportIncompatibleMethodOverride]  None is Qt's end
        """One part; None beyond the last."""
        return self._items[index] if 0 <= index < len(self._items) else None

    def takeAt(self, index: int, /) -> QLayoutItem | None:  # pyright: ignore[reportIncompatibleMethodOverride]  None is Qt's end
        """Give a part away."""
        return self._items.pop(index) if 0 <= index < len(self._items) else None

    def expandingDirections(self) -> Qt.Orientation:
        """It asks for no more room than it needs."""
        return Qt.Orientation(0)

    def hasHeightForWidth(self) -> bool:
        """A narrow one is higher."""
        return True

    def heightForWidth(self, width: int, /) -> int:
        """As high as its lines at this width."""
        heights = [max(size.height() for _, size in line) for line in self._lines(width)]
        return sum(heights) + self.spacing() * max(len(heights) - 1, 0)

    def sizeHint(self) -> QSize:
        """All parts in one line."""
        sizes = [item.sizeHint() for item in self._visible_items()]
        between = self.spacing() * max(len(sizes) - 1, 0)
        return QSize(
            sum(one.width() for one in sizes) + between,
            max((one.height() for one in sizes), default=0),
        )

    def minimumSize(self) -> QSize:
        """As wide as the widest part, and as high as the lines that it has now: what is around it may scroll."""
        sizes = [item.minimumSize() for item in self._visible_items()]
        width = max((one.width() for one in sizes), default=0)
        height = max((one.height() for one in sizes), default=0)
        return QSize(width, max(height, self._height))

    def setGeometry(self, rect: QRect, /) -> None:
        """Put every part in its place."""
        super().setGeometry(rect)
        if (height := self.heightForWidth(rect.width())) != self._height:
            self._height = height
            self.update()
        top = rect.y()
        for line in self._lines(rect.width()):
            height = max(size.height() for _, size in line)
            taken = sum(size.width() for _, size in line) + self.spacing() * (len(line) - 1)
            growing = [item for item, _ in line if _grows(item)]
            more = max(rect.width() - taken, 0) // max(len(growing), 1)
            left = rect.x()
            for item, size in line:
                width = size.width() + more * (item in growing)
                place = QPoint(left, top + (height - size.height()) // 2)
                item.setGeometry(QRect(place, QSize(width, size.height())))
                left += width + self.spacing()
            top += height + self.spacing()

    def _visible_items(self) -> list[QLayoutItem]:
        return [item for item in self._items if not item.isEmpty()]

    def _lines(self, width: int) -> list[Line]:
        lines: list[Line] = []
        room = 0
        for item in self._visible_items():
            size = item.sizeHint().expandedTo(item.minimumSize())
            size.setWidth(min(size.width(), max(width, item.minimumSize().width())))
            if not lines or size.width() > room:
                lines.append([])
                room = width
            lines[-1].append((item, size))
            room -= size.width() + self.spacing()
        return lines


def _grows(item: QLayoutItem) -> bool:
    widget = item.widget()
    return widget is not None and widget.sizePolicy().horizontalPolicy() in _GROWING


def labelled(label: QWidget, field: QWidget) -> QWidget:
    """A field with its label, which stay together."""
    both = QWidget()
    both.setLayout(in_row(label, (field, 1), margins=(0, 0, 0, 0), spacing=6))
    both.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Preferred)
    return both


def in_flow(*parts: QWidget, spacing: int = 6) -> FlowLayout:
    """Parts beside each other, in as many lines as they need."""
    layout = FlowLayout(spacing)
    for part in parts:
        layout.addWidget(part)
    return layout
