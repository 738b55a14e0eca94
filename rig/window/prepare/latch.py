"""A latched trip on the Prepare page: what it was, what was found and done about it, and its
acknowledgement by name.
"""

from __future__ import annotations

from PySide6.QtWidgets import (
    QDialog,
    QWidget,
)

from rig.errors import RigError
from rig.gears.card import now_text
from rig.run.latch import CUT_OFF, LatchedTrip, TripLatch
from rig.run.trips import rule_of
from rig.window.prepare.preview_plot import short_name
from rig.window.shell.stack import in_column, in_row, line_field, push_button, restyled, text_label


class AcknowledgeDialog(QDialog):
    """What tripped, and a field for what was found and done: without a word in it nothing is acknowledged."""

    def __init__(self, latch: TripLatch, operator: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle("Acknowledge a trip")
        self.resize(560, 220)
        self._latch, self._operator = latch, operator
        trip = self._latch.read()
        self.what = text_label(
            trip_in_words(trip) if trip is not None else "No trip is latched any more.",
            wraps=True,
        )
        self.remark = line_field(
            "What was found and done", "what was found and done; kept with your name"
        )
        self.remark.textChanged.connect(
            lambda text: self.accept_button.setEnabled(bool(text.strip()) and trip is not None)
        )
        self.problem = text_label(wraps=True)
        self.problem.hide()
        self.accept_button = push_button(
            f"&Acknowledge as {short_name(operator)}", act=self.acknowledge
        )
        self.accept_button.setEnabled(False)
        later = push_button("&Not yet", act=self.reject)
        later.setDefault(True)
        row = in_row((None, 1), self.accept_button, later)
        self.setLayout(in_column(self.what, self.remark, self.problem, (None, 1), row))
        self.remark.setFocus()

    def acknowledge(self) -> None:
        """Release the latch in the operator's name. Nothing starts by itself."""
        try:
            self._latch.acknowledge(self._operator, now_text(), self.remark.text().strip())
        except RigError as error:
            restyled(self.problem, "bad")
            self.problem.setText(f"✗ {error}")
            self.problem.show()
            return
        self.accept()


def trip_in_words(trip: LatchedTrip) -> str:
    """A trip as somebody has to read it before anything turns again."""
    safe = "Standstill was NOT verified: look at the rig first."
    if trip.standstill_verified:
        safe = "Standstill was verified."
    if trip.cause == CUT_OFF:
        return (
            f"Run {trip.run}, {trip.time}, was cut off: {trip.message}.\n{safe}\n"
            "Look at the rig; then acknowledge it. Its rows are made a run by: rig recover."
        )
    rule = rule_of(trip.cause)
    return (
        f"{trip.cause.replace('_', ' ')} in run {trip.run}, {trip.time}. {trip.message}\n{safe}\n"
        f"What it means: {rule.what}. Find and remove the cause; then acknowledge it, and the next run may be started."
    )
