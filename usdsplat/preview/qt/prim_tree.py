"""The tree of prims with a search box: select, hide, show, deactivate."""

from __future__ import annotations

from functools import partial

from PySide6.QtCore import (
    QItemSelection,
    QItemSelectionModel,
    QModelIndex,
    QPoint,
    Qt,
    QTimer,
    Signal,
)
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import (
    QAbstractItemView,
    QHeaderView,
    QListWidget,
    QMenu,
    QStackedWidget,
    QTreeView,
    QVBoxLayout,
    QWidget,
)

from usdsplat.preview.qt.panel_context import PanelContext
from usdsplat.preview.qt.prim_model import NAME, PURPOSE, TYPE, VISIBLE, PrimModel
from usdsplat.preview.qt.search_box import SearchBox
from usdsplat.preview.stage_model import prims
from usdsplat.preview.stage_model.edits import Edits
from usdsplat.preview.stage_model.prims import PrimRow

TYPING = 200
"""Delay of a search after the last key [ms]."""
PURPOSES = ("default", "render", "proxy", "guide")


class PrimTree(QWidget):
    """The prim tree of the stage; its selection is shared with all panels."""

    frame_requested = Signal(str)
    """Path of a double-clicked prim."""

    def __init__(self, context: PanelContext, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._context = context
        self._selected: tuple[str, ...] = ()
        self._is_following = False
        self.model = PrimModel(context, self)
        self.view = self._make_view()
        self.box = SearchBox("Search prims by name, path or type")
        self.found = QListWidget()
        self.found.itemClicked.connect(lambda item: self._context.viewer.select((item.text(),)))
        self.found.itemActivated.connect(lambda item: self._context.viewer.select((item.text(),)))
        self._typing = QTimer(self)
        self._typing.setSingleShot(True)
        self._typing.setInterval(TYPING)
        self._typing.timeout.connect(self._search)
        self.box.textChanged.connect(lambda text: self._typing.start())
        top = QVBoxLayout()
        top.setContentsMargins(6, 6, 6, 6)
        top.addWidget(self.box)
        self._pages = QStackedWidget()
        self._pages.addWidget(self.view)
        self._pages.addWidget(self.found)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        column.addLayout(top)
        column.addWidget(self._pages, 1)
        context.view_changed.connect(self._follow)

    # --- private ----------------------------------------------------------------------------

    def _make_view(self) -> QTreeView:
        view = QTreeView()
        view.setModel(self.model)
        view.setUniformRowHeights(True)
        view.setAlternatingRowColors(True)
        view.setIndentation(14)
        view.setExpandsOnDoubleClick(False)
        view.setSelectionMode(QAbstractItemView.SelectionMode.ExtendedSelection)
        view.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
        view.customContextMenuRequested.connect(self._show_menu)
        header = view.header()
        header.setStretchLastSection(False)
        header.setSectionResizeMode(NAME, QHeaderView.ResizeMode.Stretch)
        for column, width in ((TYPE, 96), (VISIBLE, 26), (PURPOSE, 66)):
            header.setSectionResizeMode(column, QHeaderView.ResizeMode.Fixed)
            header.resizeSection(column, width)
        view.clicked.connect(self._clicked)
        view.doubleClicked.connect(self._double_clicked)
        view.selectionModel().selectionChanged.connect(lambda on, off: self._chosen())
        self.model.loaded.connect(self._open_roots)
        return view

    def _open_roots(self, path: str) -> None:
        """Expand the root of a stage with a single root."""
        if path == "/" and self.model.rowCount() == 1:
            self.view.expand(self.model.index(0, 0))

    def _clicked(self, index: QModelIndex) -> None:
        row = self.model.row_of(index)
        if row and index.column() == VISIBLE and row.is_imageable:
            self._context.edit(partial(_set_visible, path=row.path, is_visible=not row.is_visible))

    def _double_clicked(self, index: QModelIndex) -> None:
        row = self.model.row_of(index)
        if row and index.column() != VISIBLE:
            self.frame_requested.emit(row.path)

    def _chosen(self) -> None:
        if self._is_following:
            return
        rows = (self.model.row_of(each) for each in self.view.selectionModel().selectedRows())
        paths = tuple(row.path for row in rows if row)
        if paths != self._context.viewer.state.selected:
            self._selected = paths
            self._context.viewer.select(paths)

    def _follow(self) -> None:
        """Follow a selection made elsewhere."""
        paths = self._context.viewer.state.selected
        if paths == self._selected:
            return
        self._selected = paths
        if not paths:
            self._show_selected(paths, QModelIndex())
        for path in paths:
            self.model.reveal(path, partial(self._show_selected, paths))

    def _show_selected(self, paths: tuple[str, ...], index: QModelIndex) -> None:
        """Show the rows of a selection that are loaded; `index` is the one that came last."""
        if paths != self._selected:
            return
        selection = QItemSelection()
        for path in paths:
            found = self.model.index_of(path)
            if found.isValid():
                selection.select(found, found)
        chosen = self.view.selectionModel()
        self._is_following = True  # rows that are not loaded yet would be lost
        try:
            flags = QItemSelectionModel.SelectionFlag
            chosen.select(selection, flags.ClearAndSelect | flags.Rows)
            if index.isValid():
                chosen.setCurrentIndex(index, flags.NoUpdate)
                self.view.scrollTo(index)
        finally:
            self._is_following = False

    def _search(self) -> None:
        text = self.box.text().strip()
        if not text:
            self._pages.setCurrentWidget(self.view)
            return
        self._context.proxy.ask(
            lambda document: prims.search(document.stage, text),
            lambda paths: self._show_found(text, paths),
        )

    def _show_found(self, text: str, paths: tuple[str, ...]) -> None:
        if text == self.box.text().strip():
            self.found.clear()
            self.found.addItems(list(paths))
            self._pages.setCurrentWidget(self.found)

    def _show_menu(self, place: QPoint) -> None:
        row = self.model.row_of(self.view.indexAt(place))
        if row is not None:
            self.menu_of(row).popup(self.view.viewport().mapToGlobal(place))

    def menu_of(self, row: PrimRow) -> QMenu:
        """Return the context menu of a prim."""
        menu = QMenu(self)
        menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        path, edit = row.path, self._context.edit
        menu.addAction("Frame", partial(self.frame_requested.emit, path))
        clipboard = QGuiApplication.clipboard()
        menu.addAction("Copy path", partial(clipboard.setText, path))
        if row.is_camera:
            menu.addAction("Look through", partial(self._context.viewer.use_camera, path))
        menu.addSeparator()
        if row.is_imageable:
            menu.addAction(
                "Hide" if row.is_visible else "Show",
                lambda: edit(partial(_set_visible, path=path, is_visible=not row.is_visible)),
            )
            purposes = menu.addMenu("Purpose")
            for each in PURPOSES:
                step = partial(_set_purpose, path=path, purpose=each)
                action = purposes.addAction(each, partial(edit, step))
                action.setCheckable(True)
                action.setChecked(each == row.purpose)
        menu.addAction(
            "Deactivate" if row.is_active else "Activate",
            partial(edit, lambda edits: edits.set_active(path, not row.is_active)),
        )
        for name, choice, choices in row.variants:
            variants = menu.addMenu(f"Variant {name}")
            for each in choices:
                step = partial(_set_variant, path=path, name=name, variant=each)
                action = variants.addAction(each, partial(edit, step))
                action.setCheckable(True)
                action.setChecked(each == choice)
        return menu


def _set_visible(edits: Edits, *, path: str, is_visible: bool) -> None:
    edits.set_visible(path, is_visible)


def _set_purpose(edits: Edits, *, path: str, purpose: str) -> None:
    edits.set_purpose(path, purpose)


def _set_variant(edits: Edits, *, path: str, name: str, variant: str) -> None:
    edits.set_variant(path, name, variant)
