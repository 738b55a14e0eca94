"""How the window looks: one style sheet made from a palette, the fonts, and which theme the desktop asks for."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QGuiApplication, QPalette, QPixmapCache
from PySide6.QtWidgets import QApplication

from rig.window.shell.marks import mark
from rig.window.shell.palette import Palette, palette_of

THEMES = ("system", "light", "dark")
"""What `--theme` takes."""
_KEPT_PICTURES = 128 * 1024
"""kB of what was painted that Qt may keep: the still curves of all plots on a large screen. Its own
10 MB hold those of one.
"""
BANNER_CAPITAL = 40
"""Pixels of a capital letter of the state banner where there is room: a centimetre on a common screen, legible from
three metres.
"""


def theme_named(wanted: str) -> str:
    """ "light" or "dark" for any of `THEMES`: "system" asks the desktop."""
    if wanted in ("light", "dark"):
        return wanted
    scheme = QGuiApplication.styleHints().colorScheme()
    return "dark" if scheme is Qt.ColorScheme.Dark else "light"


def apply_theme(application: QApplication, theme: str) -> Palette:
    """Give the whole application the colours of a theme, unless it has them already; returns them."""
    palette = palette_of(theme)
    sheet = _style_sheet(palette)
    if application.styleSheet() == sheet:
        return palette
    QPixmapCache.setCacheLimit(_KEPT_PICTURES)
    application.setStyle("Fusion")
    application.setPalette(_qt_palette(palette))
    application.setStyleSheet(sheet)
    return palette


def _qt_palette(p: Palette) -> QPalette:
    role, palette = QPalette.ColorRole, QPalette()
    for name, colour in (
        (role.Window, p.window),
        (role.WindowText, p.text),
        (role.Base, p.surface),
        (role.AlternateBase, p.raised),
        (role.Text, p.text),
        (role.Button, p.raised),
        (role.ButtonText, p.text),
        (role.ToolTipBase, p.surface),
        (role.ToolTipText, p.text),
        (role.Highlight, p.accent),
        (role.HighlightedText, p.accent_text),
        (role.PlaceholderText, p.muted),
        (role.Link, p.accent),
        (role.BrightText, p.bad),
    ):
        palette.setColor(name, QColor(colour))
    for name in (role.WindowText, role.Text, role.ButtonText):
        palette.setColor(QPalette.ColorGroup.Disabled, name, QColor(p.muted))
    return palette


def _style_sheet(p: Palette) -> str:
    """The style sheet. Widgets choose a part by their property `part`, so that colours stand here and nowhere else."""
    return f"""
    QWidget {{ font-size: 10pt; }}
    QToolTip {{ color: {p.text}; background: {p.surface}; border: 1px solid {p.line}; padding: 4px; }}
    QLabel[part="title"] {{ font-size: 15pt; font-weight: 600; }}
    QLabel[part="heading"] {{ font-size: 11pt; font-weight: 600; }}
    QLabel[part="number"] {{ font-size: 20pt; font-weight: 700; }}
    QLabel[part="muted"] {{ color: {p.muted}; }}
    QLabel[part="good"] {{ color: {p.good}; font-weight: 600; }}
    QLabel[part="warning"] {{ color: {p.warning}; font-weight: 600; }}
    QLabel[part="bad"] {{ color: {p.bad}; font-weight: 600; }}
    QLabel[part="mark"] {{ color: {p.warning}; font-weight: 700; letter-spacing: 1px; }}
    #plot {{ background: {p.surface}; border: 1px solid {p.line}; border-radius: 6px; }}
    QFrame[part="card"] {{ background: {p.surface}; border: 1px solid {p.line}; border-radius: 6px; }}
    QPushButton {{ background: {p.raised}; border: 1px solid {p.line}; border-radius: 5px; padding: 5px 12px;
                   color: {p.text}; }}
    QPushButton:hover {{ border-color: {p.accent}; }}
    QPushButton:focus {{ border: 2px solid {p.accent}; padding: 4px 11px; }}
    QPushButton:disabled {{ color: {p.muted}; background: {p.window}; }}
    QPushButton[part="primary"] {{ background: {p.accent}; color: {p.accent_text}; border-color: {p.accent};
                                   font-weight: 600; }}
    QPushButton[part="primary"]:disabled {{ background: {p.raised}; color: {p.muted}; border-color: {p.line}; }}
    QPushButton[part="primary"]:focus {{ border-color: {p.text}; }}
    QPushButton[part="stop"] {{ background: {p.stop}; color: {p.stop_text}; font-size: 26pt; font-weight: 800;
                                border: 3px solid {p.stop}; border-radius: 10px; letter-spacing: 3px; padding: 0px; }}
    QPushButton[part="stop"]:hover, QPushButton[part="stop"]:focus {{ border-color: {p.text}; padding: 0px; }}
    QPushButton[part="stop-idle"] {{ background: {p.raised}; color: {p.muted}; font-size: 26pt; font-weight: 800;
                                     border: 3px solid {p.line}; border-radius: 10px; letter-spacing: 3px; padding: 0px; }}
    QPushButton[part="abort"] {{ color: {p.bad}; border: 2px solid {p.bad}; font-weight: 700; }}
    QPushButton[part="abort-idle"] {{ color: {p.muted}; border: 2px solid {p.line}; font-weight: 700; }}
    QPushButton#small-stop {{ background: {p.stop}; color: {p.stop_text}; font-weight: 800; padding: 5px 26px;
                             margin: 3px 16px; border: none; letter-spacing: 2px; }}
    QPushButton[part="nav"] {{ background: transparent; border: none; border-radius: 0px; padding: 8px 18px;
                               min-width: 90px; font-size: 11pt; color: {p.muted}; border-bottom: 3px solid transparent; }}
    QPushButton[part="nav"]:checked {{ color: {p.text}; font-weight: 600; border-bottom: 3px solid {p.accent}; }}
    QPushButton[part="nav"]:focus {{ color: {p.text}; background: {p.raised}; }}
    QFrame[part="bar"] {{ background: {p.surface}; border-bottom: 1px solid {p.line}; }}
    QLineEdit, QPlainTextEdit, QComboBox, QSpinBox, QDoubleSpinBox {{ background: {p.surface}; color: {p.text};
        border: 1px solid {p.line}; border-radius: 4px; padding: 3px 6px; selection-background-color: {p.accent};
        selection-color: {p.accent_text}; }}
    QCheckBox::indicator, QListView::indicator {{ width: 13px; height: 13px; border: 1px solid {p.muted}; border-radius: 3px;
        background: {p.surface}; }}
    QCheckBox::indicator:checked, QListView::indicator:checked {{ background: {p.accent}; border-color: {p.accent};
        image: url({mark("tick", p.accent_text)}); }}
    QCheckBox::indicator:disabled {{ border-color: {p.line}; background: {p.raised}; }}
    QCheckBox::indicator:checked:disabled {{ image: url({mark("tick", p.muted)}); }}
    QSpinBox::up-button, QDoubleSpinBox::up-button, QSpinBox::down-button, QDoubleSpinBox::down-button {{ border: none;
        background: transparent; width: 18px; }}
    QSpinBox::up-arrow, QDoubleSpinBox::up-arrow {{ image: url({mark("up", p.muted)}); width: 11px; height: 11px; }}
    QSpinBox::down-arrow, QDoubleSpinBox::down-arrow {{ image: url({mark("down", p.muted)}); width: 11px; height: 11px; }}
    QCheckBox::indicator:focus {{ border: 2px solid {p.accent}; }}
    QComboBox::drop-down {{ border: none; width: 20px; }}
    QComboBox::down-arrow {{ image: url({mark("down", p.muted)}); width: 12px; height: 12px; }}
    QLineEdit:focus, QPlainTextEdit:focus, QComboBox:focus, QSpinBox:focus, QDoubleSpinBox:focus {{
        border-color: {p.accent}; }}
    QLineEdit[invalid="true"] {{ border: 2px solid {p.bad}; }}
    QProgressBar {{ background: {p.raised}; border: 1px solid {p.line}; border-radius: 4px; text-align: center;
                    color: {p.text}; }}
    QProgressBar::chunk {{ background: {p.accent}; border-radius: 3px; }}
    QTableView, QTreeView, QListView {{ background: {p.surface}; alternate-background-color: {p.window};
        border: 1px solid {p.line}; gridline-color: {p.line}; }}
    QHeaderView::section {{ background: {p.raised}; color: {p.text}; border: none; border-right: 1px solid {p.line};
        padding: 4px 6px; font-weight: 600; }}
    QSplitter::handle {{ background: {p.line}; }}
    QStatusBar {{ color: {p.muted}; }}
    """  # noqa: E501
