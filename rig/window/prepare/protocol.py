"""The protocol on the Prepare page: which one, what it measures, and its parameters as a form made from its model."""

from __future__ import annotations

from typing import Any

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QVBoxLayout, QWidget

from experiments import catalogue
from experiments.parameters import make_parameters, parameter_fields
from rig.window.prepare.form import CalmComboBox, ParameterForm
from rig.window.prepare.request import KNOWN_BY_THE_RIG
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import in_column, in_row, push_button, text_label


class ProtocolSection(QWidget):
    """What is to be run. `changed` tells that protocol or parameters are others; values are kept per protocol."""

    changed = Signal()

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self._session = session
        self._typed: dict[str, dict[str, Any]] = {}
        self.choice = CalmComboBox()
        self.choice.setAccessibleName("Protocol")
        for name in catalogue.names():
            self.choice.addItem(name, name)
        self.summary = text_label("", "muted", wraps=True)
        self.defaults_button = push_button(
            "&Defaults",
            tip="Put every parameter back to its default",
            act=lambda: self.form.set_values({}),
        )
        self._place = QVBoxLayout()
        self.form = ParameterForm((), lambda name, value: None)
        self._lay_out()
        remembered = str(session.recall("protocol", ""))
        self.choice.currentIndexChanged.connect(lambda _: self._show(self.protocol))
        self.choice.setCurrentIndex(max(self.choice.findData(remembered), 0))
        self._show(self.protocol)

    def _lay_out(self) -> None:
        label = text_label("&Protocol", buddy=self.choice)
        row = in_row(label, (self.choice, 1), self.defaults_button)
        self.setLayout(in_column(row, self.summary, self._place, margins=(0, 0, 0, 0)))

    @property
    def protocol(self) -> str:
        """The name of the protocol."""
        return str(self.choice.currentData())

    @property
    def values(self) -> dict[str, Any]:
        """The parameters that are not their defaults, as typed."""
        return self.form.differing()

    @property
    def gear_mounted(self) -> bool:
        """Whether this protocol turns a gear."""
        return catalogue.load(self.protocol).gear_mounted

    def choose(self, name: str) -> None:
        """Show another protocol."""
        self.choice.setCurrentIndex(self.choice.findData(name))

    def _show(self, name: str) -> None:
        experiment = catalogue.load(name)
        mounted = "" if experiment.gear_mounted else " The gear is taken off for it."
        summary = catalogue.entry(name).summary
        self.summary.setText(f"{summary[:1].upper()}{summary[1:]}.{mounted}")
        fields = [
            f for f in parameter_fields(experiment.parameters) if f.name not in KNOWN_BY_THE_RIG
        ]
        old = self.form
        self.form = ParameterForm(
            fields,
            lambda parameter, value: make_parameters(
                experiment.parameters, {parameter: value}, name
            ),
        )
        self.form.set_values(self._typed.get(name, {}))
        self.form.changed.connect(self._edited)
        self._place.removeWidget(old)
        old.hide()
        old.deleteLater()
        self._place.addWidget(self.form)
        self.changed.emit()

    def _edited(self) -> None:
        self._typed[self.protocol] = self.values
        self.changed.emit()
