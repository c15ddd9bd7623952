"""Style of windows: neutral greys, which do not affect the judgement of colours."""

from __future__ import annotations

from PySide6.QtGui import QColor, QFont, QFontDatabase, QPalette
from PySide6.QtWidgets import QApplication, QStyleFactory

GROUND = QColor(43, 43, 43)
SUNK = QColor(31, 31, 31)
RAISED = QColor(58, 58, 58)
LINE = QColor(24, 24, 24)
TEXT = QColor(214, 214, 214)
QUIET = QColor(150, 150, 150)
"""Colour of labels and units."""
OFF = QColor(104, 104, 104)
ACCENT = QColor(82, 130, 178)
ANIMATED = QColor(214, 158, 72)
"""Colour of values with time samples, and of the current frame."""
CACHED = QColor(96, 160, 104)
"""Colour of simulated frames, and of a running simulation."""
WRONG = QColor(214, 96, 84)

ROW = 22
"""Height of a row of a panel [pixel]."""
GAP = 6
LABELS = 118
"""Width of the labels of a panel [pixel]."""

_SHEET = """
QToolTip {{ color: {text}; background: {raised}; border: 1px solid {line}; padding: 3px; }}
QMenuBar {{ background: {ground}; padding: 1px; }}
QMenuBar::item {{ padding: 3px 9px; background: transparent; }}
QMenuBar::item:selected {{ background: {raised}; border-radius: 3px; }}
QSplitter::handle {{ background: {line}; }}
QTabWidget::pane {{ border: 0; border-top: 1px solid {line}; }}
QTabBar {{ background: {line}; qproperty-drawBase: 0; }}
QTabBar::tab {{
    background: {line}; color: {quiet}; padding: 5px 13px; border: 0; margin-right: 1px;
}}
QTabBar::tab:selected {{ background: {ground}; color: {text}; }}
QTabBar::tab:hover {{ color: {text}; }}
QTabBar#sides::tab {{ font-weight: 600; border-bottom: 2px solid {line}; }}
QTabBar#sides::tab:selected {{ color: white; border-bottom: 2px solid {accent}; }}
QHeaderView::section {{
    background: {ground}; color: {quiet}; border: 0; border-bottom: 1px solid {line};
    padding: 3px 5px;
}}
QTreeView, QListView, QTableView {{
    background: {sunk}; border: 0; alternate-background-color: {stripe};
}}
QTreeView::item, QListView::item {{ min-height: 19px; }}
QLineEdit, QComboBox, QPlainTextEdit {{
    background: {sunk}; border: 1px solid {line}; border-radius: 3px; padding: 1px 5px;
    min-height: 17px; selection-background-color: {accent};
}}
QLineEdit:focus, QComboBox:focus {{ border-color: {accent}; }}
QLineEdit {{ placeholder-text-color: {quiet}; }}
QLineEdit:disabled, QComboBox:disabled {{ color: {off}; }}
QComboBox {{ background: {raised}; }}
QComboBox::drop-down {{ border: 0; width: 16px; }}
QPushButton {{
    background: {raised}; border: 1px solid {line}; border-radius: 3px; padding: 3px 10px;
}}
QPushButton:hover {{ background: {hover}; }}
QPushButton:pressed, QPushButton:checked {{ background: {accent}; color: white; }}
QPushButton:disabled {{ color: {off}; background: {ground}; }}
QToolButton {{ border: 0; border-radius: 3px; padding: 2px; background: transparent; }}
QToolButton:hover {{ background: {raised}; }}
QToolButton:pressed, QToolButton:checked {{ background: {accent}; }}
QCheckBox::indicator, QTreeView::indicator {{
    width: 13px; height: 13px; background: {sunk}; border: 1px solid {off}; border-radius: 3px;
}}
QCheckBox::indicator:hover {{ border-color: {text}; }}
QCheckBox::indicator:checked {{ background: {accent}; border-color: {accent}; }}
QScrollBar:vertical {{ background: transparent; width: 10px; margin: 0; }}
QScrollBar:horizontal {{ background: transparent; height: 10px; margin: 0; }}
QScrollBar::handle {{ background: {hover}; border-radius: 4px; margin: 1px; min-height: 24px; }}
QScrollBar::add-line, QScrollBar::sub-line {{ width: 0; height: 0; }}
QScrollBar::add-page, QScrollBar::sub-page {{ background: transparent; }}
QSlider::groove:horizontal {{ background: {sunk}; height: 4px; border-radius: 2px; }}
QSlider::sub-page:horizontal {{ background: {accent}; height: 4px; border-radius: 2px; }}
QSlider::handle:horizontal {{
    background: {quiet}; width: 9px; height: 13px; margin: -5px 0; border-radius: 3px;
}}
QSlider::handle:horizontal:hover {{ background: {text}; }}
QSlider::sub-page:horizontal:disabled, QSlider::handle:horizontal:disabled {{
    background: {raised};
}}
QStatusBar {{ background: {ground}; color: {quiet}; }}
QStatusBar::item {{ border: 0; }}
*[role="quiet"] {{ color: {quiet}; }}
*[role="animated"] {{ color: {animated}; }}
*[role="wrong"] {{ color: {wrong}; }}
*[role="heading"] {{ color: {text}; font-weight: 600; }}
QWidget[role="bar"] {{ background: {ground}; border-top: 1px solid {line}; }}
"""


def sheet() -> str:
    """Return the style sheet; it is set on our windows only, so that a host's stay unchanged."""
    colors = {
        "ground": GROUND,
        "sunk": SUNK,
        "stripe": SUNK.lighter(112),
        "raised": RAISED,
        "hover": RAISED.lighter(125),
        "line": LINE,
        "text": TEXT,
        "quiet": QUIET,
        "off": OFF,
        "accent": ACCENT,
        "animated": ANIMATED,
        "wrong": WRONG,
    }
    return _SHEET.format(**{name: color.name() for name, color in colors.items()})


def palette() -> QPalette:
    """Return a dark, neutral palette for Fusion."""
    roles = QPalette.ColorRole
    found = QPalette()
    for role, color in (
        (roles.Window, GROUND),
        (roles.Base, SUNK),
        (roles.AlternateBase, SUNK.lighter(112)),
        (roles.Button, RAISED),
        (roles.WindowText, TEXT),
        (roles.Text, TEXT),
        (roles.ButtonText, TEXT),
        (roles.BrightText, QColor("white")),
        (roles.ToolTipBase, RAISED),
        (roles.ToolTipText, TEXT),
        (roles.PlaceholderText, QUIET),
        (roles.Highlight, ACCENT),
        (roles.HighlightedText, QColor("white")),
        (roles.Link, ACCENT.lighter(140)),
        (roles.Mid, LINE),
        (roles.Dark, LINE),
        (roles.Shadow, LINE),
    ):
        found.setColor(role, color)
    for role in (roles.WindowText, roles.Text, roles.ButtonText):
        found.setColor(QPalette.ColorGroup.Disabled, role, OFF)
    return found


def dress(application: QApplication) -> None:
    """Style our own application; a host's is left unchanged."""
    application.setStyle(QStyleFactory.create("Fusion"))
    application.setPalette(palette())
    font = application.font()
    font.setPointSizeF(9.0)
    application.setFont(font)


def digits() -> QFont:
    """Return a monospaced font, for numbers that change in place."""
    font = QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont)
    font.setPointSizeF(8.5)
    return font
