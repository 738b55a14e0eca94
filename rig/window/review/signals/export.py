"""What is seen of a run's signals, taken along: the rows as text, the plots as a picture (PNG) or a drawing (SVG)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import QPoint
from PySide6.QtGui import QImage, QPainter
from PySide6.QtSvg import QSvgGenerator
from PySide6.QtWidgets import QGraphicsView, QWidget

from experiments.recording import Recording
from rig.errors import RunFileError
from rig.runfile.export import TableColumn, export_table, recorded_column
from rig.window.review.signals.data import SPEEDS, Speed
from rig.window.review.signals.stretch import rows_between

_PICTURE_SCALE = 2.0
"""Pixels of a picture per pixel of the window: letters stay sharp on paper."""
_SPEED_DIGITS = 9
"""Digits of a speed, which is a difference of counts: more of them say nothing."""


def export_rows(
    recording: Recording, names: Sequence[str], begin: float, end: float, target: Path
) -> int:
    """Write every row between two times [s] as text in SI; returns how many. Raises `RunFileError`.

    Of a speed that is not recorded the angle stands beside it.
    """
    start, stop = rows_between(recording, begin, end)
    if start == stop:
        raise RunFileError(
            "no row lies in this stretch",
            where=recording.metadata.run_id,
            value=f"{begin:.4f} s to {end:.4f} s",
            remedy="Zoom out, or move the cursors apart.",
        )
    recorded = dict.fromkeys(SPEEDS.get(name, name) for name in names)
    columns = [recorded_column(recording, name) for name in recorded]
    columns += [_speed_column(recording, name, start) for name in names if name in SPEEDS]
    notes = [f"rows {start} to {stop - 1} of {recording.rows}"]
    notes += [
        f"{name}: the difference of {SPEEDS[name]} over 20 ms, empty where a row is incomplete"
        for name in names
        if name in SPEEDS
    ]
    return export_table(recording, columns, slice(start, stop), target, notes=notes, overwrite=True)


def _speed_column(recording: Recording, name: str, start: int) -> TableColumn:
    speed = Speed(recording, name, start)

    def cells(rows: slice) -> list[str]:
        return [
            "" if value != value else f"{value:.{_SPEED_DIGITS}g}"
            for value in speed.of(rows).tolist()
        ]

    return TableColumn(f"{name} [rad/s]", cells)


def export_picture(seen: QWidget, title: str, target: Path) -> None:
    """Paint a part of the window into a file: SVG by its suffix, else PNG. Raises `RunFileError`."""
    partial = target.with_name(f".{target.stem}.{os.getpid()}{target.suffix}")
    try:
        if target.suffix.lower() == ".svg":
            good = _draw(seen, title, partial)
        else:
            good = _picture(seen).save(str(partial))
        if not good:
            raise OSError("the folder cannot be written")
        os.replace(partial, target)
    except OSError as error:
        raise RunFileError(
            f"cannot be written: {error.strerror or error}",
            where=str(target),
            remedy="Name a folder that can be written.",
        ) from error
    finally:
        partial.unlink(missing_ok=True)


def _picture(seen: QWidget) -> QImage:
    image = QImage(seen.size() * _PICTURE_SCALE, QImage.Format.Format_RGB32)
    image.setDevicePixelRatio(_PICTURE_SCALE)
    image.fill(seen.palette().window().color())
    seen.render(image)
    return image


def _draw(seen: QWidget, title: str, target: Path) -> bool:
    drawing = QSvgGenerator()
    drawing.setFileName(str(target))
    drawing.setTitle(title)
    drawing.setSize(seen.size())
    drawing.setViewBox(seen.rect())
    painter = QPainter()
    if not painter.begin(drawing):
        return False
    canvases = [(canvas, canvas.cacheMode()) for canvas in seen.findChildren(QGraphicsView)]
    for canvas, _ in canvases:
        # A background that is kept as a picture would be drawn as one.
        canvas.setCacheMode(QGraphicsView.CacheModeFlag.CacheNone)
    seen.render(painter, QPoint())
    for canvas, mode in canvases:
        canvas.setCacheMode(mode)
    return painter.end()
