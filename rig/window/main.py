"""The main window: Prepare, Run, Review, in that order of a day on the rig, Fleet, and the application around it."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType

import pyqtgraph as pg
from PySide6.QtCore import QEvent, QLibraryInfo, QMimeData, QObject, Qt, QTimer, Slot
from PySide6.QtGui import (
    QCloseEvent,
    QDragEnterEvent,
    QDropEvent,
    QKeyEvent,
    QKeySequence,
    QShortcut,
)
from PySide6.QtWidgets import (
    QAbstractButton,
    QApplication,
    QButtonGroup,
    QFrame,
    QMainWindow,
    QSizePolicy,
    QStackedWidget,
    QWidget,
)

from rig.errors import ConfigurationError
from rig.exits import defect_in_words
from rig.window.fleet.page import FleetPage
from rig.window.prepare.page import PreparePage
from rig.window.review.page import ReviewPage
from rig.window.run.page import RunPage
from rig.window.run.prompt_view import ConsentButton
from rig.window.run.stop_filter import StopFilter
from rig.window.shell.collector import collector_in_this_thread
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import (
    in_column,
    in_row,
    push_button,
    room_for,
    scrolled,
    set_tip,
    text_label,
)
from rig.window.shell.theme import apply_theme, theme_named
from rig.window.work.prepared import PreparedCampaign, PreparedCommission, PreparedRun

PAGES = ("prepare", "run", "review", "fleet")
"""The pages in the order of the navigation; Ctrl+1 to Ctrl+4."""
_X11_PACKAGES = ("libxcb-cursor0", "libxcb-icccm4", "libxcb-keysyms1", "libxkbcommon-x11-0")
"""What Qt needs of a Debian system that has never had a Qt window."""
SMALLEST = (860, 430)
"""Logical pixels that the window needs at least: a screen of 1366 x 768 at one and a half has 911 x 512."""


class MainWindow(QMainWindow):
    """The window of one rig and one folder of runs."""

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self.session = session
        self.setWindowTitle("harmonic-rig")
        self.setMinimumSize(*SMALLEST)
        self.setAcceptDrops(True)
        self.stack = QStackedWidget()
        self.prepare = PreparePage(session)
        self.run = RunPage(session)
        self.review = ReviewPage(session)
        self.fleet = FleetPage(session)
        self._buttons = QButtonGroup(self)
        whole = in_column(self._navigation(), (self.stack, 1), margins=(0, 0, 0, 0), spacing=0)
        self.setCentralWidget(room_for(whole))
        wide = (scrolled(page) for page in (self.review, self.fleet))
        for page in (self.prepare, self.run, *wide):
            self.stack.addWidget(page)
        self.statusBar().setSizeGripEnabled(False)
        session.message.connect(lambda text: self.statusBar().showMessage(text, 15_000))
        session.theme_changed.connect(lambda _: self._apply_theme())
        self.prepare.start_requested.connect(self.start)
        self.run.review_requested.connect(self.show_review)
        self.review.run_requested.connect(self._prepare_run)
        self.fleet.run_chosen.connect(self.show_review)
        self.run.state_changed.connect(self._show_state)
        self.prepare.asking_changed.connect(self._watch)
        self.run.next_gear_requested.connect(self._prepare_next_gear)
        self.run.closed_safely.connect(self.close)
        # Stopping works from everywhere: whoever looks at something else must not look for the button first.
        buttons = self.run.buttons
        self.stop_filter = StopFilter(
            self,
            self._stop_rig,
            self._abort_rig,
            [
                (buttons.stop, self.run.stop),
                (buttons.abort, self.run.abort),
                (self.stop, self._stop_rig),
            ],
            lambda: session.free_for("Another window"),
        )
        self.stack.currentChanged.connect(lambda _: self._show_stop())
        application = QApplication.instance()
        if isinstance(application, QApplication):
            application.focusChanged.connect(self._change_focus)
        self.show_page("prepare")

    def _navigation(self) -> QFrame:
        bar = QFrame()
        bar.setProperty("part", "bar")
        row = in_row(margins=(8, 0, 12, 0), spacing=0)
        bar.setLayout(row)
        for index, name in enumerate(PAGES):
            button = push_button(
                name.capitalize(),
                "nav",
                tip=f"{name.capitalize()} (Ctrl+{index + 1})",
                act=lambda _, name=name: self.show_page(name),
            )
            button.setCheckable(True)
            button.setAccessibleName(name.capitalize())
            if name == "run":
                button.setStyleSheet("min-width: 250px;")
            self._buttons.addButton(button, index)
            row.addWidget(button)
            shortcut = QShortcut(QKeySequence(f"Ctrl+{index + 1}"), self)
            shortcut.activated.connect(lambda name=name: self.show_page(name))
        self.stop = push_button("STOP", tip="Controlled ramp to standstill (Esc)")
        self.stop.setObjectName("small-stop")
        self.stop.pressed.connect(self._stop_rig)
        self.stop.hide()
        row.addWidget(self.stop)
        where = f"rig: {self.session.backend}   runs: {self.session.folder}"
        label = text_label(where, "muted")
        set_tip(label, where)
        # On a small screen its end is cut off before anything that is pressed.
        label.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        row.addWidget(label, 1)
        theme = push_button("◐", "nav", tip="Light or dark (Ctrl+T)", act=self.switch_theme)
        theme.setStyleSheet("min-width: 24px;")
        theme.setAccessibleName("Light or dark")
        theme.setShortcut(QKeySequence("Ctrl+T"))
        row.addWidget(theme)
        return bar

    def show_page(self, name: str) -> None:
        """Bring a page to the front."""
        index = PAGES.index(name)
        self.stack.setCurrentIndex(index)
        self._buttons.button(index).setChecked(True)

    def start(self, prepared: PreparedRun | PreparedCampaign | PreparedCommission) -> None:
        """Start a prepared run, a campaign of them, or a commissioning, and watch it."""
        if self.run.is_active:
            self.session.message.emit(
                "A run is going on: stop it or wait for its end before the next."
            )
            return
        self.show_page("run")
        if isinstance(prepared, PreparedCampaign):
            self.run.start_campaign(prepared)
        elif isinstance(prepared, PreparedCommission):
            self.run.start_commission(prepared)
        else:
            self.run.start(prepared)

    @property
    def may_turn(self) -> bool:
        """Whether something is at work that may turn the rig: a run, a campaign, or `rig doctor`."""
        return self.run.is_active or self.prepare.is_asking

    def _stop_rig(self) -> None:
        """Controlled ramp to standstill of whatever turns the rig."""
        self.run.stop()
        self.prepare.stop_asking()

    def _abort_rig(self) -> None:
        """Quick stop of whatever turns the rig."""
        self.run.abort()
        self.prepare.abort_asking()

    def _prepare_run(self, serial: str, protocol: str) -> None:
        """Bring up the page Prepare with a gear and a protocol."""
        self.prepare.gear.choose(serial)
        self.prepare.protocol.choose(protocol)
        self.show_page("prepare")

    def _prepare_next_gear(self) -> None:
        """Bring up the page Prepare for another gear of the same part."""
        self.show_page("prepare")
        self.prepare.gear.begin_next()

    def show_review(self, path: Path) -> None:
        """Open a run on the Review page."""
        self.show_page("review")
        self.review.show_run(path)

    def switch_theme(self) -> None:
        """Light to dark and back."""
        self.session.set_theme("light" if self.session.theme == "dark" else "dark")
        self.session.remember("theme", self.session.theme)

    def closeEvent(self, event: QCloseEvent) -> None:
        """During a run: ask, and only close once the rig stands."""
        if self.prepare.is_asking:
            self.prepare.stop_asking()
            self.session.message.emit(
                "The rig is being asked and is stopped: close when it stands."
            )
            event.ignore()
        elif self.run.may_close():
            # Whoever uses the application further has no run whose STOP could be hidden.
            self.stop_filter.set_active(False)
            event.accept()
        else:
            self.show_page("run")
            event.ignore()

    def dragEnterEvent(self, event: QDragEnterEvent) -> None:
        """Files may be dropped on the window."""
        if _dropped_files(event.mimeData()):
            event.acceptProposedAction()

    def dropEvent(self, event: QDropEvent) -> None:
        """Files that were dropped are one recording: it is looked at on the page Review."""
        if files := _dropped_files(event.mimeData()):
            event.acceptProposedAction()
            self.show_page("review")
            self.review.show_recording(files)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Enter presses a button, as Space does: outside of dialogs Qt leaves it without effect. Consent is not
        given by it.

        Only Enter that was meant for the button: one that ends the writing in a field, and so moves
        the focus on, is not.
        """
        if not isinstance(event, QKeyEvent) or not isinstance(watched, QAbstractButton):
            return False
        if isinstance(watched, ConsentButton):
            return False
        enter = event.type() is QEvent.Type.KeyPress and event.key() in (
            Qt.Key.Key_Return,
            Qt.Key.Key_Enter,
        )
        if not enter or event.isAutoRepeat() or not watched.isEnabled():
            return False
        watched.click()
        return True

    @Slot(QWidget, QWidget)
    def _change_focus(self, _: QWidget | None, focused: QWidget | None) -> None:
        if isinstance(focused, QAbstractButton) and focused.window() is self:
            focused.installEventFilter(self)

    def _apply_theme(self) -> None:
        application = QApplication.instance()
        if isinstance(application, QApplication):
            apply_theme(application, self.session.theme)

    def _show_state(self, state: str) -> None:
        self._buttons.button(1).setText("Run" if state == "idle" else f"Run · {state}")
        self._watch()

    def _watch(self) -> None:
        """Hear what stops the rig for as long as something may turn it."""
        self.session.run_exists = self.may_turn
        self.stop_filter.set_active(self.may_turn)
        self._show_stop()

    def _show_stop(self) -> None:
        """A STOP in the navigation while something may turn the rig and the page with the large one is not in front."""
        self.stop.setVisible(self.may_turn and self.stack.currentWidget() is not self.run)


def _dropped_files(data: QMimeData) -> list[Path]:
    """The files of this computer among what is dropped; folders are none."""
    paths = [Path(url.toLocalFile()) for url in data.urls() if url.isLocalFile()]
    return [path for path in paths if path.is_file()]


def refuse_a_screen_that_qt_cannot_use(
    platform: str = sys.platform, plugins: Path | None = None
) -> None:
    """Qt ends the whole program where a system library of X11 is missing: say which one before that.

    Raises `ConfigurationError`. Only Linux leaves those libraries to the system, and only X11 needs them.
    """
    chosen = os.environ.get("QT_QPA_PLATFORM", "")
    wayland = bool(os.environ.get("WAYLAND_DISPLAY")) and not chosen
    if platform != "linux" or wayland or chosen not in ("", "xcb"):
        return
    folder = plugins or Path(QLibraryInfo.path(QLibraryInfo.LibraryPath.PluginsPath)) / "platforms"
    plugin = folder / "libqxcb.so"
    if not plugin.is_file():
        return
    try:
        ctypes.CDLL(str(plugin))
    except OSError as error:
        missing = str(error).partition(":")[0]
        raise ConfigurationError(
            "the window cannot be opened: the system lacks a library of X11",
            where=missing,
            remedy=f"On Debian and Ubuntu: sudo apt install {' '.join(_X11_PACKAGES)}. "
            "Every part also works on the command line.",
        ) from error


def open_window(
    folder: Path,
    backend: str = "sim",
    configuration: Path | None = None,
    theme: str = "system",
    page: str = "prepare",
) -> int:
    """Open the window and stay until it is closed; the exit code."""
    if QApplication.instance() is None:
        refuse_a_screen_that_qt_cannot_use()
    application = QApplication.instance() or QApplication(sys.argv[:1])
    assert isinstance(application, QApplication)
    application.setApplicationName("harmonic-rig")
    pg.setConfigOptions(antialias=True)
    session = WindowSession(folder, backend, configuration)
    # A theme that was asked for by name wins over the remembered one, and that over the desktop's.
    session.set_theme(
        theme_named(str(session.recall("theme", "system")) if theme == "system" else theme)
    )
    apply_theme(application, session.theme)
    window = MainWindow(session)
    window.show_page(page)
    window.show()
    QTimer.singleShot(0, lambda: _fit_to_screen(window))
    with collector_in_this_thread(), _python_awake(window), _defects_shown(session):
        return application.exec()


@contextmanager
def _python_awake(window: MainWindow) -> Iterator[None]:
    """Ctrl-C in the terminal closes the window as its button does; Qt alone would never let Python see it."""
    before = signal.signal(signal.SIGINT, lambda *_: window.close())
    awake = QTimer(window)
    awake.timeout.connect(lambda: None)
    awake.start(250)
    try:
        yield
    finally:
        awake.stop()
        signal.signal(signal.SIGINT, before)


@contextmanager
def _defects_shown(session: WindowSession) -> Iterator[None]:
    """What nobody expected goes into a log and into the status bar, and the window stays: a run may be going on."""

    def tell(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        session.message.emit(defect_in_words(error.with_traceback(trace)))

    before = sys.excepthook
    sys.excepthook = tell
    try:
        yield
    finally:
        sys.excepthook = before


def _fit_to_screen(window: MainWindow) -> None:
    """Fill a small screen; leave air on a large one."""
    room = window.screen().availableGeometry()
    if room.width() <= 1440 or room.height() <= 800:
        window.showMaximized()
    else:
        window.resize(round(room.width() * 0.85), round(room.height() * 0.85))
