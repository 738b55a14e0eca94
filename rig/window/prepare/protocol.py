"""What is run, on the Prepare page: a campaign, or one protocol with its parameters as a form made from its model."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QCheckBox, QFileDialog, QVBoxLayout, QWidget

from experiments import catalogue
from experiments.parameters import make_parameters, parameter_fields
from rig.errors import RigError
from rig.trial.campaign.plan import CampaignPlan, shipped_names
from rig.window.prepare.campaign import armed_protocol, plan_named
from rig.window.prepare.form import CalmComboBox, ParameterForm
from rig.window.prepare.request import KNOWN_BY_THE_RIG
from rig.window.shell.session import WindowSession, path_of
from rig.window.shell.stack import (
    in_column,
    in_row,
    push_button,
    set_tip,
    text_label,
)

CAMPAIGN = "campaign:"
"""Before the name of a campaign, or the path of its plan, among the choices."""
PLAN_FILE = "campaign of a plan file …"
_PlanChooser = Callable[[], "Path | None"]


class ProtocolSection(QWidget):
    """What is to be run. `changed` tells that campaign, protocol or parameters are others; values are
    kept per protocol. `choose_plan` asks for the file of a plan; tests hand in their own.
    """

    changed = Signal()

    def __init__(self, session: WindowSession, choose_plan: _PlanChooser | None = None) -> None:
        super().__init__()
        self._session = session
        self._choose_plan = choose_plan or self._ask_for_plan
        self._typed: dict[str, dict[str, Any]] = {}
        self._plan: CampaignPlan | None = None
        self._shown = 0
        self.choice = CalmComboBox()
        self.choice.setAccessibleName("Campaign or protocol")
        for name in shipped_names():
            self.choice.addItem(f"campaign: {name}", CAMPAIGN + name)
        self.choice.addItem(PLAN_FILE, PLAN_FILE)
        self.choice.insertSeparator(self.choice.count())
        for one in catalogue.every():
            if one.has_plan:
                self.choice.addItem(one.name, one.name)
        self.summary = text_label("", "muted", wraps=True)
        self.defaults_button = push_button(
            "&Defaults",
            tip="Put every parameter back to its default",
            act=lambda: self.form.set_values({}),
        )
        self.anew = QCheckBox("Begin anew instead of going on")
        set_tip(self.anew, "The runs of the unfinished campaign stay in the folder.")
        self.anew.toggled.connect(lambda _: self.changed.emit())
        self._place = QVBoxLayout()
        self.form = ParameterForm((), lambda name, value: None)
        self._lay_out()
        self.choice.setCurrentIndex(max(self._remembered(), 0))
        self.choice.currentIndexChanged.connect(lambda _: self._show())
        self._show()

    def _lay_out(self) -> None:
        label = text_label("&Protocol", buddy=self.choice)
        row = in_row(label, (self.choice, 1), self.defaults_button)
        self.setLayout(in_column(row, self.summary, self.anew, self._place, margins=(0, 0, 0, 0)))

    def _remembered(self) -> int:
        """The place of what was run last; -1 where it is not among the choices any more."""
        last = str(self._session.recall("protocol", ""))
        place = self.choice.findData(last)
        if place < 0 and last.startswith(CAMPAIGN) and Path(last.removeprefix(CAMPAIGN)).is_file():
            place = self._offer_plan(Path(last.removeprefix(CAMPAIGN)))
        return place

    @property
    def protocol(self) -> str:
        """The name of the protocol; of a campaign the one that speaks for all its runs."""
        return armed_protocol(self._plan) if self._plan is not None else str(self.chosen)

    @property
    def chosen(self) -> str:
        """What is remembered as the choice: the name of a protocol, or a campaign as such."""
        return str(self.choice.currentData())

    @property
    def campaign(self) -> str:
        """The campaign that is chosen, by name or path; "" where one protocol is."""
        return self.chosen.removeprefix(CAMPAIGN) if self._plan is not None else ""

    @property
    def values(self) -> dict[str, Any]:
        """The parameters that are not their defaults, as typed."""
        return self.form.differing()

    @property
    def gear_mounted(self) -> bool:
        """Whether this protocol turns a gear."""
        return self._plan is not None or catalogue.load(self.protocol).gear_mounted

    def choose(self, name: str) -> None:
        """Show another protocol."""
        self.choice.setCurrentIndex(self.choice.findData(name))

    def allow_anew(self, unfinished: bool) -> None:
        """Whether there is an unfinished campaign that could go on; what was asked for stays in view."""
        self.anew.setVisible(bool(self.campaign) and (unfinished or self.anew.isChecked()))

    def _ask_for_plan(self) -> Path | None:
        if not self._session.free_for("A plan file"):
            return None
        path, _ = QFileDialog.getOpenFileName(self, "Plan of a campaign", "", "Plans (*.toml)")
        return path_of(path)

    def _offer_plan(self, path: Path) -> int:
        """Put a plan of one's own among the campaigns; its place, -1 where it is refused."""
        data = CAMPAIGN + str(path)
        if self.choice.findData(data) < 0:
            try:
                plan = plan_named(str(path))
            except RigError as error:
                self._session.message.emit(str(error))
                return -1
            place = self.choice.findData(PLAN_FILE)
            self.choice.insertItem(place, f"campaign: {plan.name} ({path.name})", data)
        return self.choice.findData(data)

    def _take_plan(self) -> None:
        """Ask for a plan file, and go to it, or back to what was chosen before."""
        before = self._shown
        path = self._choose_plan()
        place = self._offer_plan(path) if path is not None else -1
        # A choice that was put in moves those that follow.
        self.choice.setCurrentIndex(place if place >= 0 else before)

    def _show(self) -> None:
        if self.chosen == PLAN_FILE:
            self._take_plan()
            return
        self._shown = self.choice.currentIndex()
        self._plan = None
        self.anew.setChecked(False)
        if self.chosen.startswith(CAMPAIGN):
            self._show_campaign(self.chosen.removeprefix(CAMPAIGN))
        else:
            self._show_protocol(self.chosen)
        self.defaults_button.setVisible(self._plan is None)
        self.allow_anew(False)
        self.changed.emit()

    def _show_campaign(self, campaign: str) -> None:
        self._plan = plan_named(campaign)
        names = ", ".join(stage.protocol for stage in self._plan.stages)
        self.summary.setText(f"{self._plan.title}: {names}. One verdict, one certificate.")
        self._replace_form(ParameterForm((), lambda name, value: None))

    def _show_protocol(self, name: str) -> None:
        experiment = catalogue.load(name)
        mounted = "" if experiment.gear_mounted else " The gear is taken off for it."
        summary = catalogue.entry(name).summary
        self.summary.setText(f"{summary[:1].upper()}{summary[1:]}.{mounted}")
        fields = [
            f for f in parameter_fields(experiment.parameters) if f.name not in KNOWN_BY_THE_RIG
        ]
        form = ParameterForm(
            fields,
            lambda parameter, value: make_parameters(
                experiment.parameters, {parameter: value}, name
            ),
        )
        form.set_values(self._typed.get(name, {}))
        form.changed.connect(self._edited)
        self._replace_form(form)

    def _replace_form(self, form: ParameterForm) -> None:
        old, self.form = self.form, form
        self._place.removeWidget(old)
        old.hide()
        old.deleteLater()
        self._place.addWidget(form)

    def _edited(self) -> None:
        self._typed[self.chosen] = self.values
        self.changed.emit()
