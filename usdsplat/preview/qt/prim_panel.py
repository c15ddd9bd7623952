"""Panel of the selected prim: properties at the current time, metadata, composition."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from PySide6.QtCore import QModelIndex, QPersistentModelIndex, QPoint, Qt
from PySide6.QtGui import QColor, QFont, QGuiApplication
from PySide6.QtWidgets import (
    QAbstractItemDelegate,
    QAbstractItemView,
    QHeaderView,
    QLineEdit,
    QMenu,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QTabWidget,
    QTreeView,
    QVBoxLayout,
    QWidget,
)

from usdsplat.core.errors import StageError
from usdsplat.preview.document import Document
from usdsplat.preview.qt import style
from usdsplat.preview.qt.knob_panel import tool_tip
from usdsplat.preview.qt.knob_widgets import ValueWidget, make_widget
from usdsplat.preview.qt.panel_context import PanelContext, Question
from usdsplat.preview.qt.pose_fields import Entry, PoseFields
from usdsplat.preview.qt.row_model import Column, RowModel
from usdsplat.preview.qt.search_box import SearchBox
from usdsplat.preview.stage_model import poses, properties
from usdsplat.preview.stage_model.edits import Edits
from usdsplat.preview.stage_model.poses import Pose
from usdsplat.preview.stage_model.properties import ArcRow, MetadataRow, PropertyRow
from usdsplat.preview.stage_model.tree_facts import DRAWN, tree_facts
from usdsplat.preview.values import Picture

COLORS = {
    "time samples": style.ANIMATED,
    "value clips": style.ANIMATED,
    "default": QColor(140, 178, 214),
    "computed": QColor(170, 150, 200),
}
"""Colours of values by their source; unauthored ones are dim."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Prim:
    """The data of a prim for all tabs."""

    properties: tuple[PropertyRow, ...] = ()
    metadata: tuple[MetadataRow, ...] = ()
    composition: tuple[ArcRow, ...] = ()
    pose: Pose | None = None


class PrimPanel(QTabWidget):
    """Tabs that follow the selection and the time; editable values are edited in place."""

    def __init__(self, context: PanelContext, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._context = context
        self._shown: tuple[str, float | None] | None = None
        self._rows: tuple[PropertyRow, ...] = ()
        """All properties, of which the search shows some."""
        self._entries = 0
        """Number of entered numbers of poses."""
        self._question = Question(self, self._ask)
        self.properties = RowModel(_PROPERTY, key=lambda row: row.name, parent=self)
        self.metadata = RowModel(_METADATA, key=lambda row: row.name, parent=self)
        self.composition = RowModel(
            _COMPOSITION, key=lambda row: f"{row.kind} {row.path} {row.identifier}", parent=self
        )
        self.view = _table(self.properties, (150, 0))
        delegate = _ValueDelegate(self._edit, self)
        delegate.closeEditor.connect(self._keep_focus)
        self.view.setItemDelegate(delegate)
        self.view.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
        self.view.customContextMenuRequested.connect(self._show_menu)
        self.pose = PoseFields()
        self.pose.entered.connect(self._set_pose)
        self.pose.refused.connect(context.complain)
        self.box = SearchBox("Search properties by name, type or value")
        self.box.textChanged.connect(lambda text: self._show_matching())
        line = QVBoxLayout()
        line.setContentsMargins(6, 4, 6, 4)
        line.addWidget(self.box)
        page = QWidget()
        column = QVBoxLayout(page)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        column.addWidget(self.pose)
        column.addLayout(line)
        column.addWidget(self.view, 1)
        self.addTab(page, "Properties")
        self.addTab(_table(self.metadata, (150, 0)), "Metadata")
        self.addTab(_table(self.composition, (76, 0, 120)), "Composition")
        self.setDocumentMode(True)
        context.view_changed.connect(self._follow)
        context.proxy.stage_changed.connect(lambda event: self._question.refresh())
        context.proxy.picture.connect(self._follow_tree)

    def search(self) -> None:
        """Focus the search, on whose page the properties are."""
        self.setCurrentIndex(0)
        self.box.setFocus()

    def _follow_tree(self, picture: Picture) -> None:
        """Show what is drawn of a selected splat tree, and what is in memory, after a picture."""
        if any(row.name == DRAWN for row in self._rows):
            self._question.refresh()

    def _follow(self) -> None:
        if (self._context.selected, self._context.time) != self._shown:
            is_other = self._shown is None or self._shown[0] != self._context.selected
            if is_other:
                self.pose.show_pose(self._context.selected, None)
            self._shown = self._context.selected, self._context.time
            self._question.refresh(at_once=is_other)

    def _ask(self, done: Callable[[], None]) -> None:
        path, time, near = self._context.selected, self._context.time, self.pose.pose
        entries, is_early = self._entries, self._context.is_dragging

        def answered(found: _Prim) -> None:
            done()
            if path == self._context.selected:
                self._rows = found.properties
                self._show_matching()
                self.metadata.show_rows(found.metadata)
                self.composition.show_rows(found.composition)
                if is_early or entries != self._entries:  # older than what the fields show
                    self._question.refresh()
                else:
                    self.pose.show_pose(path, found.pose)

        self._context.proxy.ask(
            partial(_read, path=path, time=time, near=near),
            answered,
            lambda error: answered(_Prim()),
        )

    def _show_matching(self) -> None:
        self.properties.show_rows(properties.matching(self._rows, self.box.text()))

    def _set_pose(self, entry: Entry) -> None:
        self._entries += 1
        self.pose.show_pose(entry.path, entry.pose.with_number(entry.part, entry.axis, entry.value))
        # Also of typed numbers: they replace a waiting step of an arrow key.
        drag = f"{entry.path} {entry.part} {entry.axis}"
        step = partial(_set_pose, entry=entry, time=self._context.time)
        self._context.edit(step, failed=lambda: self._question.refresh(at_once=True), drag=drag)

    def _edit(self, row: PropertyRow, value: Any, merge: str) -> None:
        path = f"{self._context.selected}.{row.name}"
        time = self._context.time if row.samples else None
        step = partial(_set_value, path=path, value=value, time=time, merge=merge or None)
        drag = f"{path} {merge}" if merge else ""
        self._context.edit(step, failed=lambda: self._question.refresh(at_once=True), drag=drag)
        self._question.refresh()

    def _keep_focus(self, editor: QWidget, hint: QAbstractItemDelegate.EndEditHint) -> None:
        """Keep the focus after a key has closed an editor: Qt gives it to the next widget if a
        second field had it, and tool keys would be typed there."""
        if hint != QAbstractItemDelegate.EndEditHint.NoHint:
            self.view.setFocus()

    def _show_menu(self, place: QPoint) -> None:
        index = self.view.indexAt(place)
        if index.isValid():
            menu = self.menu_of(self.properties.rows[index.row()])
            menu.popup(self.view.viewport().mapToGlobal(place))

    def menu_of(self, row: PropertyRow) -> QMenu:
        """Return the context menu of a property."""
        path = f"{self._context.selected}.{row.name}"
        menu = QMenu(self)
        menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        clipboard = QGuiApplication.clipboard()
        menu.addAction("Copy value", partial(clipboard.setText, row.text))
        menu.addAction("Copy path", partial(clipboard.setText, path))
        clear = menu.addAction(
            "Clear session edit", partial(self._context.edit, partial(_clear, path=path))
        )
        clear.setEnabled(row.is_edited)
        return menu


class _ValueDelegate(QStyledItemDelegate):
    """A delegate that edits values with the widget of their kind."""

    def __init__(self, edit: Callable[[PropertyRow, Any, str], None], parent: PrimPanel) -> None:
        super().__init__(parent)
        self._edit = edit
        self._refused = parent._context.complain

    def initStyleOption(
        self, option: QStyleOptionViewItem, index: QModelIndex | QPersistentModelIndex
    ) -> None:
        """Cut long names at their beginning: those of a namespace differ at the end."""
        super().initStyleOption(option, index)
        if index.column() == 0:
            option.textElideMode = Qt.TextElideMode.ElideLeft

    def createEditor(  # type: ignore[override]
        self, parent: QWidget, option: QStyleOptionViewItem, index: QModelIndex
    ) -> QWidget:
        row: PropertyRow = index.model().rows[index.row()]  # type: ignore[attr-defined]
        assert row.editor is not None  # only cells with an editor are editable
        widget = make_widget(row.editor)
        widget.setParent(parent)
        widget.setAutoFillBackground(True)
        widget.changed.connect(lambda value, merge: self._edit(row, value, merge))
        widget.refused.connect(self._refused)
        first = widget.findChild(QLineEdit) or widget.findChild(QWidget)  # a slider is no number
        assert first is not None  # every kind has a focusable widget
        widget.setFocusProxy(first)
        return widget

    def setEditorData(self, editor: QWidget, index: QModelIndex) -> None:  # type: ignore[override]
        row: PropertyRow = index.model().rows[index.row()]  # type: ignore[attr-defined]
        if isinstance(editor, ValueWidget) and row.editor is not None:
            editor.show_editor(row.editor)

    def setModelData(self, editor: QWidget, model: Any, index: QModelIndex) -> None:  # type: ignore[override]
        """Do nothing: each change has been signalled already."""


def _table(model: RowModel, widths: Sequence[int]) -> QTreeView:
    """Create a flat list with columns of these widths; 0 takes the remaining width."""
    view = QTreeView()
    view.setModel(model)
    view.setRootIsDecorated(False)
    view.setUniformRowHeights(True)
    view.setAlternatingRowColors(True)
    view.setEditTriggers(
        QAbstractItemView.EditTrigger.DoubleClicked | QAbstractItemView.EditTrigger.EditKeyPressed
    )
    header = view.header()
    header.setStretchLastSection(False)
    for column, width in enumerate(widths):
        mode = QHeaderView.ResizeMode.Interactive if width else QHeaderView.ResizeMode.Stretch
        header.setSectionResizeMode(column, mode)
        if width:
            header.resizeSection(column, width)
    return view


def _read(document: Document, *, path: str, time: float | None, near: Pose | None) -> _Prim:
    if not path:
        return _Prim()
    stage = document.stage
    try:
        return _Prim(
            properties=properties.properties(
                stage, path, time=time, facts=tree_facts(document.engine.render_scene, path)
            ),
            metadata=properties.metadata(stage, path),
            composition=properties.composition(stage, path),
            pose=_pose(document, path, time, near),
        )
    except StageError:  # the selected prim was deleted: not a user error
        return _Prim()


def _pose(document: Document, path: str, time: float | None, near: Pose | None) -> Pose | None:
    """Return the pose of a prim; None without one, or where its rows say what is wrong with it."""
    try:
        return poses.pose_at(document.stage, path, time=time, near=near)
    except StageError:
        return None


def _set_pose(edits: Edits, *, entry: Entry, time: float | None) -> None:
    poses.set_number(
        edits,
        entry.path,
        entry.part,
        entry.axis,
        entry.value,
        time=time,
        near=entry.pose,
        merge=entry.merge or None,
    )


def _set_value(edits: Edits, *, path: str, value: Any, time: float | None, merge: Any) -> None:
    edits.set_value(path, value, time=time, merge=merge)


def _clear(edits: Edits, *, path: str) -> None:
    edits.clear(path)


def _name_data(row: PropertyRow, role: int) -> Any:
    if role == Qt.ItemDataRole.FontRole and row.is_edited:
        font = QFont()
        font.setBold(True)
        return font
    if role == Qt.ItemDataRole.ToolTipRole:
        facts = (row.name, row.type_name, row.kind, "custom" if row.is_custom else "")
        return " · ".join(fact for fact in facts if fact)
    return None


def _value_data(row: PropertyRow, role: int) -> Any:
    if role == Qt.ItemDataRole.ForegroundRole:
        return COLORS.get(row.source, style.QUIET)
    if role == Qt.ItemDataRole.ToolTipRole:
        facts: list[str] = [row.source if row.source != "none" else "no value"]
        if row.samples:
            facts.append(f"{row.samples} samples")
        if row.layer:
            facts.append(f"from {row.layer}")
        if row.is_edited:
            facts.append("edited in this session")
        if row.editor is not None:
            facts.append("double-click to edit")
        words = f"{row.text} — {', '.join(facts)}"
        return words if row.editor is None or not row.editor.help else tool_tip(row.editor) + words
    return None


def _quiet(row: Any, role: int) -> Any:
    return style.QUIET if role == Qt.ItemDataRole.ForegroundRole else None


def _layer_data(row: ArcRow, role: int) -> Any:
    if role == Qt.ItemDataRole.ToolTipRole:
        return row.identifier
    return None if row.has_specs else _quiet(row, role)


_PROPERTY = (
    Column(title="Property", text=lambda row: row.name, data=_name_data),
    Column(
        title="Value",
        text=lambda row: row.text,
        data=_value_data,
        is_editable=lambda row: row.editor is not None and not row.editor.is_read_only,
    ),
)
_METADATA = (
    Column(title="Field", text=lambda row: row.name),
    Column(title="Value", text=lambda row: row.text, data=_quiet),
)
_COMPOSITION = (
    Column(title="Arc", text=lambda row: row.kind, data=_quiet),
    Column(title="Path", text=lambda row: row.path, data=_layer_data),
    Column(title="Layer", text=lambda row: row.layer, data=_layer_data),
)
