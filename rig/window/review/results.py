"""The results of a run: what was identified with interval, verdict and catalogue value, and the fit that finds it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from PySide6.QtCore import QSignalBlocker, Qt, Signal
from PySide6.QtWidgets import (
    QFileDialog,
    QProgressBar,
    QTextBrowser,
    QWidget,
)

from experiments import catalogue
from experiments.result import Result
from model.gear import HarmonicDrive
from rig.analysis.judging import GearVerdict
from rig.analysis.rows import estimate_grid
from rig.analysis.tare import takes_tare
from rig.library.index import IndexedRun
from rig.window.review.fit import FitOrder
from rig.window.review.grid import GridTable
from rig.window.review.table_model import local_time
from rig.window.review.words import budget_page, result_page
from rig.window.shell.flow import in_flow, labelled
from rig.window.shell.session import WindowSession, path_of
from rig.window.shell.stack import (
    choice_box,
    in_column,
    in_row,
    plain_tip,
    push_button,
    restyled,
    split,
    text_label,
)

ChooseFile = Callable[[], Path | None]


class FitBar(QWidget):
    """What to fit as what, with which tare and parameter set; progress, and a way to give up."""

    fit_requested = Signal(object)
    """Carries a `FitOrder`."""
    compare_requested = Signal(object)
    """Carries a `FitOrder` whose parameter set is to be held against the run."""
    save_requested = Signal(object, Path)
    """Carries a `FitOrder` and the file that takes what it identifies as a parameter set."""
    renew_requested = Signal(object)
    """Carries the `FitOrder` that makes a stale analysis anew, as it was made."""
    cancelled = Signal()

    def __init__(self, session: WindowSession, choose_file: ChooseFile | None = None) -> None:
        super().__init__()
        self._session = session
        self._run: Path | None = None
        self._choose_file = choose_file or self._ask_file
        self.choose_target: ChooseFile = self._ask_target
        """Asks where a parameter set is to be written."""
        self.kind = choice_box("Kind of fit", letters=9)
        self.tare = choice_box("Tare", letters=9)
        self.parameters = choice_box("Parameter set", letters=9)
        self.kind.currentTextChanged.connect(lambda _: self._offer_tare())
        self.parameters.activated.connect(self._choose_parameters)
        self.tare_choice = labelled(text_label("tare"), self.tare)
        self.fit = push_button(
            "&Fit",
            "primary",
            tip="Identify the model from this run; the analysis is kept beside it",
            act=lambda: self.fit_requested.emit(self.order(keep=True)),
        )
        self._renewal: FitOrder | None = None
        self.renew = push_button(
            "Re&new",
            "primary",
            tip="Make this analysis anew as it was made: what it rests on has changed",
            act=lambda: self.renew_requested.emit(self._renewal),
        )
        self.renew.hide()
        self.compare = push_button(
            "&Compare",
            tip="Hold a parameter set against this run: what it predicts and what was measured",
            act=self._compare,
        )
        self.save = push_button(
            "&Save set …",
            tip="Write what this run identifies into a parameter set (TOML): to hold it against "
            "another run, or to plan with it",
            act=self._save,
        )
        self.cancel = push_button("Cancel", act=self.cancelled)
        self.busy = QProgressBar()
        self.busy.setRange(0, 0)
        self.busy.setTextVisible(False)
        self.busy.setFixedWidth(90)
        self.says = text_label(wraps=True, selectable=True)
        self._lay_out()
        self.set_busy(False)

    def _lay_out(self) -> None:
        choices = (
            labelled(text_label("fit as"), self.kind),
            self.tare_choice,
            labelled(text_label("parameters"), self.parameters),
        )
        row = in_flow(*choices, self.fit, self.compare, self.save)
        below = in_row(self.busy, (self.says, 1), self.renew, self.cancel)
        self.setLayout(in_column(row, below, margins=(0, 0, 0, 0), spacing=4))

    def show_run(
        self, run: Path, protocol: str, tares: Sequence[IndexedRun], used: FitOrder | None
    ) -> None:
        """Another run: the kind is that of its protocol, the tare the one that its analysis used, else the newest."""
        self._run, self._tares = run, tuple(tares)
        kinds = catalogue.kinds()
        with QSignalBlocker(self.kind):
            self.kind.clear()
            for name in sorted(kinds, key=lambda kind: kind != protocol):
                self.kind.addItem(name, name)
            chosen = (used and used.kind) or protocol
            self.kind.setCurrentIndex(max(0, self.kind.findData(chosen)))
        self.parameters.clear()
        self.parameters.addItem("the run's own", "")
        self.parameters.addItem("from a file …", "?")
        self._offer_tare()
        self.offer_renewal(None)
        if used is not None and used.tare is not None:
            self.tare.setCurrentIndex(max(0, self.tare.findData(str(used.tare))))
        self.say("")

    def choose_kind(self, kind: str) -> None:
        """Fit as this kind next."""
        self.kind.setCurrentIndex(max(0, self.kind.findData(kind)))

    def order(self, *, keep: bool) -> FitOrder:
        """The fit as it is set."""
        assert self._run is not None
        kind, tare, parameters = (
            str(box.currentData() or "") for box in (self.kind, self.tare, self.parameters)
        )
        if not takes_tare(kind):
            tare = ""
        return FitOrder(
            self._run,
            kind,
            path_of(tare),
            Path(parameters) if parameters not in ("", "?") else None,
            keep=keep,
        )

    def set_busy(self, busy: bool, words: str = "") -> None:
        """Whether a fit is at work."""
        for widget in (
            self.fit,
            self.renew,
            self.compare,
            self.save,
            self.kind,
            self.tare,
            self.parameters,
        ):
            widget.setDisabled(busy)
        self.busy.setVisible(busy)
        self.cancel.setVisible(busy)
        if words or busy:
            self.say(words)

    def offer_renewal(self, order: FitOrder | None) -> None:
        """The fit that makes what is shown anew; None where it need not, or cannot by one press."""
        self._renewal = order
        self.renew.setVisible(order is not None)

    def say(self, text: str, part: str = "muted") -> None:
        """A sentence under the choices; `part` of the style sheet says how grave it is."""
        self.says.setText(text)
        restyled(self.says, part)
        self.says.setVisible(bool(text))

    def _offer_tare(self) -> None:
        needs = takes_tare(str(self.kind.currentData()))
        self.tare.clear()
        self.tare.addItem("none", "")
        for run in self._tares:
            self.tare.addItem(f"run {run.number}, {local_time(run.start)}", str(run.path))
            self.tare.setItemData(
                self.tare.count() - 1, plain_tip(run.path.name), Qt.ItemDataRole.ToolTipRole
            )
        self.tare.setCurrentIndex(len(self._tares))
        self.tare.setVisible(needs)
        self.tare_choice.setVisible(needs)

    def _choose_parameters(self, row: int) -> None:
        if self.parameters.itemData(row) != "?":
            return
        path = self._choose_file()
        if path is None:
            self.parameters.setCurrentIndex(0)
            return
        self.parameters.insertItem(1, path.name, str(path))
        self.parameters.setItemData(1, plain_tip(str(path)), Qt.ItemDataRole.ToolTipRole)
        self.parameters.setCurrentIndex(1)

    def _compare(self) -> None:
        order = self.order(keep=False)
        if order.parameters is None:
            path = self._choose_file()
            if path is None:
                return
            self.parameters.insertItem(1, path.name, str(path))
            self.parameters.setCurrentIndex(1)
            order = self.order(keep=False)
        self.compare_requested.emit(order)

    def _save(self) -> None:
        path = self.choose_target()
        if path is not None:
            self.save_requested.emit(self.order(keep=False), path)

    def _ask_target(self) -> Path | None:
        if not self._session.free_for("Saving a parameter set"):
            return None
        begin = f"{self._run.name.removesuffix('.h5')}.toml" if self._run is not None else ""
        title = "Where is the parameter set written?"
        chosen, _ = QFileDialog.getSaveFileName(self, title, begin, "Parameter sets (*.toml)")
        return Path(chosen).with_suffix(".toml") if chosen else None

    def _ask_file(self) -> Path | None:
        if not self._session.free_for("Choosing a parameter set"):
            return None
        title = "Which parameter set is held against this run?"
        chosen, _ = QFileDialog.getOpenFileName(self, title, "", "Parameter sets (*.toml)")
        return path_of(chosen)


class ResultsView(QWidget):
    """The numbers of one analysis over what there is to beware of; of a number that is chosen, over its budget."""

    points_requested = Signal(str)
    """Carries the name of the chosen number."""

    def __init__(self, session: WindowSession, bar: FitBar) -> None:
        super().__init__()
        self._session = session
        self._shown: tuple[Result, GearVerdict] | None = None
        self.bar = bar
        self.table = GridTable(session, "Results")
        self.page = QTextBrowser()
        self.page.setAccessibleName("Warnings, figures of merit, tables")
        self.page.setOpenLinks(False)
        self.page.anchorClicked.connect(lambda _: self._ask_for_points())
        self.table.itemSelectionChanged.connect(self._write_page)
        self.hint = text_label("", "muted", wraps=True, align=Qt.AlignmentFlag.AlignCenter)
        self.table.setMinimumHeight(90)
        self.page.setMinimumHeight(70)
        self._parts = split(self.table, self.page, sizes=[260, 170], way=Qt.Orientation.Vertical)
        self.setLayout(
            in_column(bar, (self._parts, 1), (self.hint, 1), margins=(6, 6, 6, 4), spacing=6)
        )
        session.theme_changed.connect(lambda _: self._write_page())
        self.show_nothing("")

    @property
    def result(self) -> Result | None:
        """The result that is shown."""
        return self._shown[0] if self._shown else None

    def show_result(self, result: Result, gear: HarmonicDrive | None, judged: GearVerdict) -> None:
        """The numbers of a result; `gear` knows what the catalogue says, `judged` what they are worth."""
        self._shown = result, judged
        # A column in which nothing stands takes room from those that say something.
        grid = estimate_grid(result, lines=judged.of(result), gear=gear)
        self.table.show_grid(grid.without_empty())
        self._write_page()
        self._parts.show()
        self.hint.hide()

    def show_nothing(self, why: str) -> None:
        """No result, and why there is none."""
        self._shown = None
        self._parts.hide()
        self.hint.setText(why)
        self.hint.show()

    @property
    def chosen(self) -> str:
        """The name of the number that is chosen in the table; "" for none."""
        rows = self.table.selectionModel().selectedRows()
        names = list(self._shown[0].estimates) if self._shown else []
        return names[rows[0].row()] if rows and rows[0].row() < len(names) else ""

    def _ask_for_points(self) -> None:
        if self.chosen:
            self.points_requested.emit(self.chosen)

    def _write_page(self) -> None:
        if self._shown is not None:
            result, judged = self._shown
            palette = self._session.palette
            text = budget_page(result, self.chosen, palette) if self.chosen else ""
            text += result_page(result, palette, judged)
            self.page.setHtml(text)
            self.page.setVisible(bool(text))
