"""What the tests of the Review page share: lines of the index, small run files, and how to read the page."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from PySide6.QtCore import QCoreApplication, QEvent
from PySide6.QtWidgets import QWidget

from rig.library.index import IndexedRun
from rig.runfile.write import RunWriter
from rig.window.plot.plots import Curve
from rig.window.review.page import ReviewPage
from rig.window.review.table_model import COLUMNS
from tests.rig.runfile.making import block, header

LONGEST = 600_000
"""ms that a test waits before it fails."""


def destroy(widget: QWidget) -> None:
    """Delete a widget now: the next change of theme would style it again."""
    widget.close()
    widget.deleteLater()
    QCoreApplication.sendPostedEvents(widget, QEvent.Type.DeferredDelete)


def indexed(number: int, **changes: object) -> IndexedRun:
    """A line of the index."""
    made = IndexedRun(
        path=Path(f"{number:05d}-friction-SN.h5"),
        run_id=f"{number:05d}-friction-SN",
        number=number,
        state="sealed",
        protocol="friction",
        gear_serial=f"SN-{number % 7}",
        gear="CSF-25-120",
        ratio=120.0,
        operator="A. Example",
        start=f"2025-11-{1 + number % 28:02d}T10:00:00+00:00",
        duration=61.0,
        outcome="COMPLETED",
        origin="simulated",
        backend="sim",
        bench="",
        mounting="",
        rows=61_000,
        problem="",
        notes="",
    )
    return replace(made, **changes)  # type: ignore[arg-type]


def several(folder: Path) -> None:
    """Runs of different gears, operators and days, by their headers alone."""
    for number, (serial, day, outcome) in enumerate(
        (("A1", "20", "COMPLETED"), ("B2", "21", "ABORTED"), ("B2", "25", "TRIPPED")), 1
    ):
        made = header(f"{number:05d}-friction-{serial}")
        metadata = replace(
            made.metadata, gear_serial=serial, start_time=f"2025-11-{day}T12:00:00.000+00:00"
        )
        writer = RunWriter(
            folder / f"{number:05d}-friction-{serial}.h5", replace(made, metadata=metadata)
        )
        writer.append(block(0, 100))
        writer.seal(outcome, f"2025-11-{day}T12:01:00.000+00:00")


def shown(page: ReviewPage, heading: str = "#") -> list[str]:
    """What stands in a column of the library."""
    place = next(i for i, column in enumerate(COLUMNS) if column.heading == heading)
    model = page.library.filtered
    return [str(model.index(row, place).data()) for row in range(model.rowCount())]


def drawn(curve: Curve) -> tuple[float, float]:
    """From when to when a curve is drawn [s]."""
    x, _ = curve.item.getOriginalDataset()
    return (0.0, 0.0) if x is None or not len(x) else (float(x[0]), float(x[-1]))
