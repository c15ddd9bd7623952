"""Qt item model of the prims of a stage; children are loaded on demand."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import count
from typing import Any

from PySide6.QtCore import QAbstractItemModel, QModelIndex, QObject, Qt, Signal
from PySide6.QtGui import QColor, QFont

from usdsplat.core.errors import StageError
from usdsplat.preview.document import Document
from usdsplat.preview.qt import style
from usdsplat.preview.qt.glyphs import glyph
from usdsplat.preview.qt.panel_context import PanelContext, Question
from usdsplat.preview.stage_model import prims
from usdsplat.preview.stage_model.prims import PrimRow

NAME, TYPE, VISIBLE, PURPOSE = range(4)
_TITLES = ("Prim", "Type", "", "Purpose")
PAUSE = 250
"""Interval between updates of the open part of the tree [ms]."""
_Index = QModelIndex
_ROOT = QModelIndex()


class _Node:
    """A prim, with its children once they are loaded."""

    __slots__ = ("children", "is_asked", "number", "parent", "row")

    def __init__(self, row: PrimRow | None, parent: _Node | None, number: int) -> None:
        self.row = row
        self.parent = parent
        self.number = number
        """Id in Qt's indices; the object itself might be deleted before them."""
        self.children: list[_Node] | None = None
        self.is_asked = False

    @property
    def path(self) -> str:
        return self.row.path if self.row else "/"

    @property
    def place(self) -> int:
        """Return the row within the parent."""
        siblings = self.parent.children if self.parent else None
        return siblings.index(self) if siblings else 0


class PrimModel(QAbstractItemModel):
    """A tree model of prims, loaded from the session, one request per opened parent."""

    loaded = Signal(str)
    """Path of a prim whose children are loaded."""

    def __init__(self, context: PanelContext, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._context = context
        self._root = _Node(None, None, 0)
        self._nodes = {0: self._root}
        self._numbers = count(1)
        self._question = Question(self, self._ask_all, pause=PAUSE)
        context.proxy.stage_changed.connect(lambda event: self._question.refresh())

    def refresh(self) -> None:
        """Reload everything that is loaded."""
        self._question.refresh(at_once=True)

    def row_of(self, index: QModelIndex) -> PrimRow | None:
        """Return the prim of an index; None for the root."""
        return self._node(index).row

    def index_of(self, path: str) -> QModelIndex:
        """Return the index of a prim; invalid while it is not loaded."""
        node = self._find(path)
        return self._index(node) if node is not None else QModelIndex()

    def reveal(self, path: str, done: Callable[[QModelIndex], None]) -> None:
        """Find a prim, loading its ancestors' children as needed."""
        parents = ["/", *_ancestors(path)]
        self._fetch(parents, lambda: done(self.index_of(path)))

    # --- Qt's -------------------------------------------------------------------------------

    def columnCount(self, parent: _Index = _ROOT) -> int:  # type: ignore[override]
        return len(_TITLES)

    def rowCount(self, parent: _Index = _ROOT) -> int:  # type: ignore[override]
        return len(self._node(parent).children or ()) if parent.column() <= 0 else 0

    def hasChildren(self, parent: _Index = _ROOT) -> bool:  # type: ignore[override]
        node = self._node(parent)
        if node.children is not None:
            return bool(node.children)
        return node.row is None or node.row.has_children

    def canFetchMore(self, parent: _Index) -> bool:  # type: ignore[override]
        node = self._node(parent)
        return node.children is None and not node.is_asked and self.hasChildren(parent)

    def fetchMore(self, parent: _Index) -> None:  # type: ignore[override]
        node = self._node(parent)
        node.is_asked = True
        self._fetch([node.path])

    def index(self, row: int, column: int, parent: _Index = _ROOT) -> QModelIndex:  # type: ignore[override]
        children = self._node(parent).children
        if not children or not 0 <= row < len(children):
            return QModelIndex()
        return self.createIndex(row, column, children[row].number)

    def parent(self, index: _Index) -> QModelIndex:  # type: ignore[override]
        node = self._node(index).parent
        return self._index(node) if node is not None else QModelIndex()

    def headerData(
        self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole
    ) -> Any:
        return _TITLES[section] if role == Qt.ItemDataRole.DisplayRole else None

    def data(self, index: _Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:  # type: ignore[override]
        row = self._node(index).row
        if row is None:
            return None
        match role:
            case Qt.ItemDataRole.DisplayRole:
                return _text(row, index.column())
            case Qt.ItemDataRole.DecorationRole if index.column() == VISIBLE and row.is_imageable:
                color = "" if row.is_visible else style.OFF.name()
                return glyph("eye" if row.is_visible else "eye shut", color)
            case Qt.ItemDataRole.ForegroundRole:
                return _color(row, index.column())
            case Qt.ItemDataRole.FontRole if row.is_abstract or not row.is_defined:
                font = QFont()
                font.setItalic(True)
                return font
            case Qt.ItemDataRole.ToolTipRole:
                return _tool_tip(row, index.column())
        return None

    # --- private ----------------------------------------------------------------------------

    def _node(self, index: _Index) -> _Node:
        return self._nodes.get(index.internalId(), self._root) if index.isValid() else self._root

    def _index(self, node: _Node) -> QModelIndex:
        return QModelIndex() if node.row is None else self.createIndex(node.place, 0, node.number)

    def _find(self, path: str) -> _Node | None:
        node = self._root
        for prefix in (*_ancestors(path), path):
            found = next((each for each in node.children or () if each.path == prefix), None)
            if found is None:
                return None
            node = found
        return node

    def _known(self) -> list[str]:
        """Return the paths of all prims with loaded children, parents first."""
        paths, waiting = [], [self._root]
        while waiting:
            node = waiting.pop()
            if node.children is not None:
                paths.append(node.path)
                waiting.extend(node.children)
        return paths or ["/"]

    def _ask_all(self, done: Callable[[], None]) -> None:
        self._fetch(self._known(), done)

    def _fetch(self, paths: Sequence[str], done: Callable[[], None] = lambda: None) -> None:
        def answered(found: dict[str, tuple[PrimRow, ...]]) -> None:
            for path, rows in found.items():
                self._take(path, rows)
            done()

        task = partial(_children, paths=tuple(paths), time=self._context.time)
        self._context.proxy.ask(task, answered)

    def _take(self, path: str, rows: tuple[PrimRow, ...]) -> None:
        """Update the children with minimal changes, so that open branches stay open."""
        node = self._root if path == "/" else self._find(path)
        if node is None:
            return
        parent = self._index(node)
        if node.children is None:
            node.children = []
        children = node.children
        wanted = {row.path for row in rows}
        for place in reversed(range(len(children))):
            if children[place].path not in wanted:
                self._remove(parent, children, place)
        for place, row in enumerate(rows):
            if place < len(children) and children[place].path == row.path:
                self._update(children[place], row, parent)
                continue
            later = next((i for i, each in enumerate(children) if each.path == row.path), None)
            if later is not None:
                self._remove(parent, children, later)
            self.beginInsertRows(parent, place, place)
            new = _Node(row, node, next(self._numbers))
            self._nodes[new.number] = new
            children.insert(place, new)
            self.endInsertRows()
        self.loaded.emit(path)

    def _remove(self, parent: QModelIndex, children: list[_Node], place: int) -> None:
        self.beginRemoveRows(parent, place, place)
        gone = [children.pop(place)]
        self.endRemoveRows()
        while gone:
            node = gone.pop()
            gone.extend(node.children or ())
            del self._nodes[node.number]

    def _update(self, node: _Node, row: PrimRow, parent: QModelIndex) -> None:
        if node.row != row:
            node.row = row
            place = node.place
            self.dataChanged.emit(
                self.index(place, NAME, parent), self.index(place, PURPOSE, parent)
            )


def _children(
    document: Document, *, paths: tuple[str, ...], time: float | None
) -> dict[str, tuple[PrimRow, ...]]:
    """Return the children of prims; deleted prims are omitted."""
    found = {}
    for path in paths:
        try:
            found[path] = prims.children(document.stage, path, time=time)
        except StageError:
            continue
    return found


def _ancestors(path: str) -> list[str]:
    """Return the paths of all ancestors, the highest first."""
    parts = path.strip("/").split("/")
    return ["/" + "/".join(parts[:count]) for count in range(1, len(parts))]


def _text(row: PrimRow, column: int) -> str:
    if column == NAME:
        return row.name
    if column == TYPE:
        return row.type_name.removeprefix("ParticleField") or row.type_name
    if column == PURPOSE:
        return "" if row.purpose == "default" else row.purpose
    return ""


def _color(row: PrimRow, column: int) -> QColor | None:
    if not row.is_active or not row.is_visible or not row.is_loaded:
        return style.OFF
    if column != NAME:
        return style.QUIET
    if row.is_in_instance or row.is_instance:
        return _INSTANCED
    return None


def _tool_tip(row: PrimRow, column: int) -> str:
    if column == VISIBLE and row.is_imageable:
        return "Click to hide" if row.is_visible else "Click to show"
    facts = [row.path, row.type_name, row.kind]
    facts += [
        word
        for word, is_so in (
            ("inactive", not row.is_active),
            ("not loaded", not row.is_loaded),
            ("instance", row.is_instance),
            ("in an instance", row.is_in_instance),
        )
        if is_so
    ]
    facts += [f"{name}={choice}" for name, choice, _ in row.variants]
    return " · ".join(fact for fact in facts if fact)


_INSTANCED = QColor(124, 170, 214)
